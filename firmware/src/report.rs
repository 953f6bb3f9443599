//! The text on the console. It does without `core::fmt`, which takes 3 KiB.

use crate::{Module, Origin};
use railbus_nvm::Counters;

/// Why the module has started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Power-up, or the reset button.
    Power,
    /// The loop had stopped.
    Watchdog,
    /// A panic, in this line of the source.
    Panic(u32),
    /// A fault of the processor.
    Fault,
}

/// What the board knows besides the module.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// The board's name.
    pub board: &'static str,
    /// Why it started.
    pub reset: Reset,
    /// Where the settings came from.
    pub origin: Origin,
    /// How often settings were stored, and how that went.
    pub store: Counters,
    /// The most stack that was in use, in bytes.
    pub stack: u32,
    /// Seconds since start-up.
    pub uptime: u32,
}

/// One line of text, truncated if it is too long.
#[derive(Debug)]
pub struct Text {
    bytes: [u8; Text::MAX],
    len: usize,
}

impl Text {
    /// The longest line in bytes.
    pub const MAX: usize = 80;

    /// An empty line.
    #[must_use]
    pub const fn new() -> Text {
        Text {
            bytes: [0; Text::MAX],
            len: 0,
        }
    }

    /// What was written.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    // Not inlined: it is called some thirty times, with fewer arguments than what it calls.
    #[inline(never)]
    fn say(&mut self, text: &str) {
        self.fill(text, &[]);
    }

    /// Adds text, in which each `#` is replaced by the next of the numbers.
    fn fill(&mut self, text: &str, numbers: &[u32]) {
        let mut numbers = numbers.iter();
        for byte in text.bytes() {
            match byte {
                b'#' => self.number(numbers.next().copied().unwrap_or_default()),
                _ => self.push(byte),
            }
        }
    }

    fn number(&mut self, number: u32) {
        let mut place = 1_000_000_000;
        while place > 1 && number < place {
            place /= 10;
        }
        while place > 0 {
            self.push(b'0' + (number / place % 10) as u8);
            place /= 10;
        }
    }

    fn push(&mut self, byte: u8) {
        let at = self.len;
        if let Some(slot) = self.bytes.get_mut(at) {
            *slot = byte;
            self.len = at + 1;
        }
    }
}

impl Default for Text {
    fn default() -> Text {
        Text::new()
    }
}

/// Line `number` of the report, from 0; none after the last. `missing` are the chips that do not
/// answer.
pub fn line(
    number: u8,
    module: &Module,
    about: &About,
    mut missing: impl Iterator<Item = &'static str>,
) -> Option<Text> {
    let mut text = Text::new();
    match number {
        0 => {
            let model = crate::FAMILY.profile().model;
            text.say(concat!("railbus ", env!("CARGO_PKG_VERSION"), " "));
            text.say(model);
            text.say(" on ");
            text.say(about.board);
        }
        1 => {
            let engine = module.engine();
            let serial = engine.active().serial;
            text.fill("address #, ", &[engine.address().0.into()]);
            text.say(engine.protocol().name());
            text.fill(", # ", &[serial.baud.rate()]);
            text.say(serial.character.name());
        }
        2 => {
            text.say("reset: ");
            say_reset(about.reset, &mut text);
            text.say("; settings: ");
            text.say(about.origin.text());
        }
        3 => {
            text.say("missing chips: ");
            text.say(missing.next().unwrap_or("none"));
            for name in missing {
                text.say(" ");
                text.say(name);
            }
        }
        4 => {
            let counts = module.counts();
            text.fill(
                "heard #, bad #, lost #, replies #, stalled #",
                &[
                    counts.heard,
                    counts.bad,
                    counts.lost,
                    counts.replies,
                    counts.stalled,
                ],
            );
        }
        5 => {
            let store = about.store;
            let counts = [
                store.written,
                store.unchanged,
                store.deferred,
                store.failed,
                store.refused,
            ];
            text.fill(
                "kept #, unchanged #, deferred #, failed #, refused #",
                &counts.map(u32::from),
            );
        }
        6 => text.fill("up # s, stack # bytes", &[about.uptime, about.stack]),
        _ => return None,
    }
    text.say("\r\n");
    Some(text)
}

fn say_reset(reset: Reset, text: &mut Text) {
    match reset {
        Reset::Power => text.say("power"),
        Reset::Watchdog => text.say("watchdog"),
        Reset::Panic(line) => text.fill("panic, line #", &[line]),
        Reset::Fault => text.say("fault"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_decimal_and_lines_end_where_they_are_full() {
        let mut text = Text::new();
        text.fill("# # #, #", &[0, u32::MAX, 100]);
        assert_eq!(text.bytes(), b"0 4294967295 100, 0");
        text.say(&"x".repeat(Text::MAX));
        assert_eq!(text.bytes().len(), Text::MAX);
    }
}
