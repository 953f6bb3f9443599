//! The non-volatile memory of a module.
//!
//! A [`Record`] is everything that defines a module: its family, how it is built and behaves, and
//! its settings. It is encoded ([`Record::encode`]) in a versioned layout. A [`Store`] holds such
//! bytes so that a loss of power at any moment leaves either the old ones or the new ones:
//! [`Slots`] in a byte EEPROM, [`Flash`] in NOR flash. A [`SettingsStore`] in front of either
//! writes nothing that is already stored, and never so often that the chip wears out.
//!
//! The image of a module in its factory state, for a programmer or an emulator:
//!
//! ```
//! use railbus_device::{Family, Setup};
//! use railbus_nvm::{Record, slot_image};
//! use railbus_wire::Address;
//!
//! let record = Record::factory(&Setup::new(Family::Erc8, Address(7)))?;
//! let image = slot_image(&record.encode(), 1);
//! assert_eq!(image.bytes().len(), Record::LEN + 9, "it goes to offset 0 of the EEPROM");
//! # Ok::<(), railbus_nvm::RecordError>(())
//! ```

#![no_std]
#![forbid(unsafe_code)]
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::unreachable
)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::indexing_slicing))]

mod budget;
mod bytes;
mod flash;
mod keeper;
mod record;
mod slot;
mod slots;

pub use budget::{BURST, PERIOD};
pub use bytes::Bytes;
pub use flash::{BadRange, Flash};
pub use keeper::{Counters, Held, RETRY, SettingsStore, Store};
pub use record::{Record, RecordError, Unreadable};
pub use slot::{SLOT, slot_image};
pub use slots::Slots;
