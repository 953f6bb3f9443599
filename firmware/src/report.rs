//! What the console says. It goes without `core::fmt`, which takes 3 KiB.

use crate::{Module, Origin};
use railbus_keep::Counters;

/// Why the module starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Power came, or somebody pressed the button.
    Power,
    /// The loop had stopped.
    Watchdog,
    /// The program found itself broken, in this line of its source.
    Panic(u32),
    /// The processor refused an instruction.
    Fault,
}

/// What the board knows besides the module.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// The board's name.
    pub board: &'static str,
    /// Why it started.
    pub reset: Reset,
    /// Where the settings come from.
    pub origin: Origin,
    /// What became of settings to be kept.
    pub store: Counters,
    /// The most bytes of stack that were in use.
    pub stack: u32,
    /// Seconds since the start.
    pub uptime: u32,
}

/// One line of text, cut off where it is too long.
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

    fn say(&mut self, text: &str) -> &mut Text {
        text.bytes().for_each(|byte| self.push(byte));
        self
    }

    fn number(&mut self, number: u32) -> &mut Text {
        if number >= 10 {
            self.number(number / 10);
        }
        self.push(b'0' + (number % 10) as u8);
        self
    }

    fn push(&mut self, byte: u8) {
        if let Some(slot) = self.bytes.get_mut(self.len) {
            *slot = byte;
            self.len += 1;
        }
    }
}

impl Default for Text {
    fn default() -> Text {
        Text::new()
    }
}

/// Line `number` of what the module says of itself, from 0; nothing after the last. `missing`
/// names the chips that do not answer.
pub fn line(
    number: u8,
    module: &Module,
    about: &About,
    mut missing: impl Iterator<Item = &'static str>,
) -> Option<Text> {
    let mut line = Text::new();
    let text = &mut line;
    match number {
        0 => {
            let model = crate::FAMILY.profile().model;
            text.say("railbus ").say(env!("CARGO_PKG_VERSION"));
            text.say(" ").say(model).say(" on ").say(about.board);
        }
        1 => {
            let engine = module.engine();
            let serial = engine.active().serial;
            text.say("address ").number(engine.address().0.into());
            text.say(", ").say(engine.protocol().name()).say(", ");
            text.number(serial.baud.rate())
                .say(" ")
                .say(serial.character.name());
        }
        2 => {
            say_reset(about.reset, text.say("reset: "));
            text.say("; settings: ").say(about.origin.text());
        }
        3 => {
            text.say("missing chips: ")
                .say(missing.next().unwrap_or("none"));
            for name in missing {
                text.say(" ").say(name);
            }
        }
        4 => {
            let counts = module.counts();
            text.say("heard ").number(counts.heard);
            text.say(", bad ").number(counts.bad);
            text.say(", lost ").number(counts.lost);
            text.say(", replies ").number(counts.replies);
            text.say(", stalled ").number(counts.stalled);
        }
        5 => {
            let store = about.store;
            text.say("kept ").number(store.written.into());
            text.say(", unchanged ").number(store.unchanged.into());
            text.say(", deferred ").number(store.deferred.into());
            text.say(", failed ").number(store.failed.into());
            text.say(", refused ").number(store.refused.into());
        }
        6 => {
            text.say("up ").number(about.uptime);
            text.say(" s, stack ").number(about.stack).say(" bytes");
        }
        _ => return None,
    }
    text.say("\r\n");
    Some(line)
}

fn say_reset(reset: Reset, text: &mut Text) {
    match reset {
        Reset::Power => text.say("power"),
        Reset::Watchdog => text.say("watchdog"),
        Reset::Panic(line) => text.say("panic, line ").number(line),
        Reset::Fault => text.say("fault"),
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_decimal_and_lines_end_where_they_are_full() {
        let mut text = Text::new();
        text.number(0)
            .say(" ")
            .number(u32::MAX)
            .say(" ")
            .number(100);
        assert_eq!(text.bytes(), b"0 4294967295 100");
        text.say(&"x".repeat(Text::MAX));
        assert_eq!(text.bytes().len(), Text::MAX);
    }
}
