//! Frames as they are sent, in fixed columns (`-v`).

use super::texts::SimText;
use railbus_words::Lang;
use railbus_words::width;

use railbus_sim::{Trace, TraceDirection, TraceEntry};
use railbus_wire::Instant;
use std::io::Write;

/// Shows the traffic on a line.
pub(super) struct Frames {
    last: Instant,
    /// The name of the line, if there are several.
    line: Option<String>,
    /// The width of the names.
    width: usize,
    /// To stderr: stdout is for programs.
    aside: bool,
}

/// Minimum width of names.
pub(super) const WIDTH: usize = 8;

impl Frames {
    /// The frames of the only line, or of the given one.
    pub(super) const fn new(line: Option<String>, width: usize, aside: bool) -> Frames {
        Frames {
            last: Instant(0),
            line,
            width,
            aside,
        }
    }

    /// Drains the trace, and shows what is of interest to people: frames and their senders, but not
    /// each character received by the host, nor changing inputs.
    pub(super) fn show(&mut self, trace: &mut Trace) {
        while let Some(entry) = trace.take() {
            if !matches!(
                entry.direction(),
                TraceDirection::In | TraceDirection::Panel
            ) {
                say(&self.line(&entry), self.aside);
                self.last = entry.at();
            }
        }
    }

    fn line(&self, entry: &TraceEntry) -> String {
        let bytes: Vec<String> = entry.bytes().iter().map(|b| format!("{b:02X}")).collect();
        let who = match (&self.line, entry.who()) {
            (Some(line), who @ ("host" | "line")) => format!("{who}.{line}"),
            (_, who) => who.to_owned(),
        };
        let width = self.width;
        format!(
            "{:>8.3} {:>7.1}  {who:<width$}  {:<11}  {}",
            entry.at().0 as f64 / 1e6,
            entry.at().since(self.last).0 as f64 / 1e3,
            entry.event(),
            bytes.join(" ")
        )
    }
}

/// Prints the column headings.
pub(super) fn heading(lang: Lang, width: usize, aside: bool) {
    let who = width::pad(lang.get(SimText::Who), width);
    let columns = lang.fill(SimText::FrameColumns, &[("who", &who)]);
    say(&format!("\n{columns}"), aside);
}

/// The reader may have gone; the line is served nevertheless.
fn say(line: &str, aside: bool) {
    let _ = match aside {
        true => writeln!(std::io::stderr(), "{line}"),
        false => writeln!(std::io::stdout(), "{line}"),
    };
}
