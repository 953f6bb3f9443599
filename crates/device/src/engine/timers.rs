//! Outputs that change by themselves: pulses and jogs.

use crate::Family;
use railbus_wire::{Channel, Instant};

/// How many outputs of a module may have a timer.
const COUNT: usize = match Family::ONLY {
    None | Some(Family::R55) => 32,
    Some(Family::Eda9060a) => 4,
    Some(Family::Eda9050 | Family::Erc8 | Family::Emd2a2q) => 0,
};

/// One timer for each output.
#[derive(Clone, Debug)]
pub(super) struct Timers {
    /// When each running timer ends.
    at: [Instant; COUNT],
    /// Bit n = the timer of output n is running.
    running: u32,
    /// Bit n = output n will be on.
    on: u32,
}

impl Timers {
    /// No timer is running.
    pub(super) const NONE: Timers = Timers {
        at: [Instant(0); COUNT],
        running: 0,
        on: 0,
    };

    /// The output will be on or off at that time. Replaces its previous timer.
    pub(super) fn start(&mut self, channel: Channel, at: Instant, on: bool) {
        if let Some(slot) = self.at.get_mut(usize::from(channel.index())) {
            *slot = at;
            self.running |= channel.mask();
            self.on = self.on & !channel.mask() | if on { channel.mask() } else { 0 };
        }
    }

    /// Stops the timers of the mask.
    pub(super) const fn stop(&mut self, mask: u32) {
        self.running &= !mask;
    }

    /// Stops the timers that have ended: their outputs, and which of them are on now.
    pub(super) fn over(&mut self, now: Instant) -> (u32, u32) {
        if self.running == 0 {
            return (0, 0);
        }
        let mut over = 0;
        for (at, index) in self.at.iter().zip(0..) {
            if self.runs(index) && *at <= now {
                over |= 1 << index;
            }
        }
        self.stop(over);
        (over, self.on & over)
    }

    /// When the next timer ends.
    pub(super) fn next(&self) -> Option<Instant> {
        if self.running == 0 {
            return None;
        }
        let mut next = None;
        for (at, index) in self.at.iter().zip(0..) {
            if self.runs(index) && next.is_none_or(|next| *at < next) {
                next = Some(*at);
            }
        }
        next
    }

    const fn runs(&self, index: u32) -> bool {
        self.running >> index & 1 == 1
    }
}
