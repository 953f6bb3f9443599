//! What the console says.

use crate::{Module, Origin};
use core::fmt::{self, Write};
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

impl fmt::Display for Reset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reset::Power => f.write_str("power"),
            Reset::Watchdog => f.write_str("watchdog"),
            Reset::Panic(line) => write!(f, "panic, line {line}"),
            Reset::Fault => f.write_str("fault"),
        }
    }
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
    /// Characters lost since nobody took them in time.
    pub overruns: u32,
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
}

impl Default for Text {
    fn default() -> Text {
        Text::new()
    }
}

impl Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = self.bytes.get_mut(self.len..).unwrap_or_default();
        for (slot, byte) in room.iter_mut().zip(text.bytes()) {
            *slot = byte;
            self.len += 1;
        }
        Ok(())
    }
}

/// Line `number` of what the module says of itself, from 0; nothing after the last. `missing`
/// names the chips that do not answer.
///
/// # Errors
/// None that a [`Text`] has.
pub fn line(
    number: u8,
    module: &Module,
    about: &About,
    missing: impl Iterator<Item = &'static str>,
    text: &mut Text,
) -> Result<bool, fmt::Error> {
    let engine = module.engine();
    let counts = module.counts();
    let store = about.store;
    match number {
        0 => write!(
            text,
            "railbus {} {} on {}",
            env!("CARGO_PKG_VERSION"),
            crate::FAMILY,
            about.board
        )?,
        1 => write!(
            text,
            "address {}, {}, {}",
            engine.address().0,
            engine.protocol().name(),
            engine.active().serial
        )?,
        2 => write!(
            text,
            "reset: {}; settings: {}",
            about.reset,
            about.origin.text()
        )?,
        3 => {
            text.write_str("missing chips:")?;
            let mut none = true;
            for name in missing {
                none = false;
                write!(text, " {name}")?;
            }
            if none {
                text.write_str(" none")?;
            }
        }
        4 => write!(
            text,
            "heard {}, bad {}, lost {}, replies {}, stalled {}",
            counts.heard, counts.bad, about.overruns, counts.replies, counts.stalled
        )?,
        5 => write!(
            text,
            "kept {}, unchanged {}, deferred {}, failed {}, refused {}",
            store.written, store.unchanged, store.deferred, store.failed, store.refused
        )?,
        6 => write!(text, "up {} s, stack {} bytes", about.uptime, about.stack)?,
        _ => return Ok(false),
    }
    text.write_str("\r\n")?;
    Ok(true)
}
