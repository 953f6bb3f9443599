//! Frames as they pass, in fixed columns (`-v`).

use super::texts::SimText;
use crate::i18n::Lang;

use railbus_sim::{Direction, Entry, Trace};
use railbus_wire::Instant;
use std::io::Write;

/// Shows what passes on the line.
pub(super) struct Frames {
    last: Instant,
    /// The name of the line, where there are several.
    line: Option<String>,
}

impl Frames {
    /// Shows the heading.
    pub(super) fn begin(lang: Lang) -> Frames {
        say(&format!("\n{}", lang.get(SimText::FrameColumns)));
        Frames::of(None)
    }

    /// The frames of one line, without the heading.
    pub(super) const fn of(line: Option<String>) -> Frames {
        let last = Instant(0);
        Frames { last, line }
    }

    /// Takes all out of the trace, and shows what people want to see of it: who sends what, but
    /// not that the host hears it, character by character, nor that an input moves.
    pub(super) fn show(&mut self, trace: &mut Trace) {
        while let Some(entry) = trace.take() {
            if !matches!(entry.direction(), Direction::In | Direction::Panel) {
                say(&self.line(&entry));
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
        format!(
            "{:>8.3} {:>7.1}  {:<8}  {:<11}  {}",
            entry.at().0 as f64 / 1e6,
            entry.at().since(self.last).0 as f64 / 1e3,
            who,
            entry.event(),
            bytes.join(" ")
        )
    }
}

/// Who reads it may have gone; the line is served all the same.
fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}
