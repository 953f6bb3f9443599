//! How often a store may be written.
//!
//! A chip of the 24C kind takes a million writes at each place, the flash of an RP2040 board
//! 100,000 erasures of each sector. A master that writes a configuration register with every
//! poll would be through with that in a day. So writes are counted out: [`BURST`] at once, which
//! is more than setting up a module takes, and then one every [`PERIOD`]. That is at most 36 in
//! any hour and 52,590 in a year of such a master. Two slots share them, so an EEPROM lasts 38
//! years of it, and one that takes only 100,000 still lasts nearly four. Flash of
//! two 4 KiB sectors, which hold 32 slots each, is erased 822 times a sector in that year.
//!
//! The count begins anew with each power-up: who can switch the power on and off can also wear
//! out the relays.

use railbus_wire::{Instant, Micros};

/// How many writes may follow each other at once.
pub const BURST: u64 = 30;

/// The time that allows one more write.
pub const PERIOD: Micros = Micros::from_secs(600);

/// What may still be written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Budget {
    /// When everything written will have been paid for, at one write per period.
    paid: Instant,
}

impl Budget {
    /// All of it.
    pub(crate) const fn new() -> Budget {
        Budget { paid: Instant(0) }
    }

    /// Takes one write.
    ///
    /// # Errors
    /// When there will be one again.
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
