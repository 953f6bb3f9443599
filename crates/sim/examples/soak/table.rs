//! The published table: faults x line -> rate, and what was reported or done wrongly.

use crate::cells::Cell;
use crate::run::Report;
use std::fmt::Write;

/// The rows, one for each cell.
pub(crate) fn render(cells: &[Cell]) -> String {
    let mut text = String::from(
        "| faults | line | requests/s | readings | commands confirmed | late replies known | \
         misattributed | false confirmations | false denials | doubled | past the checksum |\n\
         |---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    for cell in cells {
        let Report {
            verdicts: v,
            exchanges,
            time,
            late,
            ..
        } = &cell.report;
        let rate = *exchanges as f64 / (*time as f64 / 1e6);
        let confirmed = 100.0 * v.confirmed as f64 / v.commands.max(1) as f64;
        // Writing to a string can't fail.
        let _ = writeln!(
            text,
            "| {} | {} | {rate:.1} | {} | {confirmed:.1} % | {late} | {} | {} | {} | {} | {} |",
            cell.campaign_name(),
            cell.line_name(),
            v.readings,
            v.misattributed,
            v.falsely_confirmed,
            v.falsely_denied,
            v.doubled,
            v.undetected + v.confirmed_undetected + v.denied_undetected + v.acted_undetected,
        );
    }
    text
}

/// The whole page.
pub(crate) fn page(cells: &[Cell], sum: &Report) -> String {
    format!(
        "# What a line tells under faults\n\n\
         Made by the soak (`crates/sim/examples/soak`), a simulation in virtual time from seeds, \
         and compared by every CI run: a change of behaviour shows up as a difference here. The \
         judge knows what the modules really did, and nothing of the line master or the \
         protocols.\n\n\
         - **misattributed**: a value was told that was not so between question and answer, though \
         every character heard was as sent: another module's value, or another moment's.\n\
         - **false confirmations**: a command was said to be done and was not.\n\
         - **false denials**: a command was said not to have acted, and had.\n\
         - **doubled**: an output that is toggled or pulsed acted more often than commanded.\n\
         - **past the checksum**: a value, confirmation, denial or action that was wrong where \
         characters had been spoilt on the way. ASCII without its checksum has no means to \
         notice; the 8-bit \
         sums of LC-02, the 0x55 boards and ASCII miss one spoilt frame in some hundreds. Use \
         Modbus RTU, or the ASCII checksum, where a line is bad.\n\n\
         Half of the seeds have an echoing adapter, a third hear everything in random pieces; \
         in the lines `ascii` and `mixed` some modules are dead. With \
         \"replies held back\" all that is heard stands still for up to five seconds and then \
         comes at once, in order.\n\n\
         {} exchanges, {} faults, {:.1} line-hours.\n\n{}",
        sum.exchanges,
        sum.faults,
        sum.time as f64 / 3.6e9,
        render(cells)
    )
}
