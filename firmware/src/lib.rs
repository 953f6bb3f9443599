//! The modules as firmware: everything that is not specific to a board.
//!
//! [`Module`] is the loop around the engine, which is the simulator's, too. A board provides the
//! functions of [`Board`], and calls [`Module::step`] whenever something happened or the time has
//! come that the last step returned. [`Ring`] and [`Outbox`] are shared by interrupts and loop;
//! [`Panel`] is a module's relays and inputs on I2C chips.
//!
//! All of it is tested on the host, and none of it is unsafe.

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::unreachable
)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::indexing_slicing))]

mod eeprom;
mod i2c;
mod kept;
mod module;
mod outbox;
mod panel;
mod report;
mod ring;

pub use eeprom::At24c;
pub use i2c::{Absent, I2c, Pins};
pub use kept::{Kept, Origin};
pub use module::{Board, Counts, Module};
pub use outbox::Outbox;
pub use panel::{Panel, Pinned, Sensed};
pub use report::{About, Reset, Text, line};
pub use ring::{Heard, Ring, What};

use railbus_device::{Family, Setup};
use railbus_wire::Address;

/// The family that this image was built for.
pub const FAMILY: Family = if cfg!(feature = "eda9060a") {
    Family::Eda9060a
} else if cfg!(feature = "eda9050") {
    Family::Eda9050
} else if cfg!(feature = "r55") {
    Family::R55
} else if cfg!(feature = "emd2a2q") {
    Family::Emd2a2q
} else {
    Family::Erc8
};

/// A module with factory settings: address 1.
#[must_use]
pub fn factory() -> Setup {
    Setup::new(FAMILY, Address(1))
}
