//! Frames as they pass, in fixed columns (`-v`).

use super::texts::SimText;
use railbus_words::Lang;
use railbus_words::width;

use railbus_sim::{Direction, Entry, Trace};
use railbus_wire::Instant;
use std::io::Write;

/// Shows what passes on the line.
pub(super) struct Frames {
    last: Instant,
    /// The name of the line, where there are several.
    line: Option<String>,
    /// How wide the names are.
    width: usize,
    /// On stderr: what stdout says is for a program.
    aside: bool,
}

/// How wide names are at least.
pub(super) const WIDTH: usize = 8;

impl Frames {
    /// The frames of the only line, or of one that is named.
    pub(super) const fn new(line: Option<String>, width: usize, aside: bool) -> Frames {
        Frames {
            last: Instant(0),
            line,
            width,
            aside,
        }
    }

    /// Takes all out of the trace, and shows what people want to see of it: who sends what, but
    /// not that the host hears it, character by character, nor that an input moves.
    pub(super) fn show(&mut self, trace: &mut Trace) {
        while let Some(entry) = trace.take() {
            if !matches!(entry.direction(), Direction::In | Direction::Panel) {
                say(&self.line(&entry), self.aside);
                self.last = entry.at();
            }
        }
    }

    fn line(&self, entry: &Entry) -> String {
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

/// Shows what the columns are.
pub(super) fn heading(lang: Lang, width: usize, aside: bool) {
    let who = width::pad(lang.get(SimText::Who), width);
    let columns = lang.fill(SimText::FrameColumns, &[("who", &who)]);
    say(&format!("\n{columns}"), aside);
}

/// Who reads it may have gone; the line is served all the same.
fn say(line: &str, aside: bool) {
    let _ = match aside {
        true => writeln!(std::io::stderr(), "{line}"),
        false => writeln!(std::io::stdout(), "{line}"),
    };
}
