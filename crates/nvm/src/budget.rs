//! How often a store may be written.
//!
//! A 24C EEPROM endures a million writes at each location, the flash of an RP2040 board 100,000
//! erasures of each sector. A master that writes a configuration register with every poll would
//! reach that in a day. So writes are rationed: [`BURST`] at once, which is more than setting up a
//! module takes, and then one every [`PERIOD`]. With such a master that is at most 36 in any hour
//! and 52,590 in a year. Two slots share them, so an EEPROM lasts 38 years, and one that endures
//! only 100,000 still lasts nearly four. Flash of two 4 KiB sectors, which hold 32 slots each, is
//! erased 822 times a sector in that year.
//!
//! The count restarts at each power-up: a user who can switch the power on and off can also wear
//! out the relays.

use railbus_wire::{Instant, Micros};

/// How many writes may follow each other immediately.
pub const BURST: u64 = 30;

/// The time after which one more write is allowed.
pub const PERIOD: Micros = Micros::from_secs(600);

/// How much may still be written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Budget {
    /// When all writes so far are paid for, at one write per period.
    paid: Instant,
}

impl Budget {
    /// The full budget.
    pub(crate) const fn new() -> Budget {
        Budget { paid: Instant(0) }
    }

    /// Takes one write.
    ///
    /// # Errors
    /// When the next one will be available.
    pub(crate) fn take(&mut self, now: Instant) -> Result<(), Instant> {
        let credit = PERIOD * (BURST - 1);
        let from = self.paid.max(now);
        if from.since(now) > credit {
            return Err(Instant(from.0.saturating_sub(credit.0)));
        }
        self.paid = from + PERIOD;
        Ok(())
    }
}
