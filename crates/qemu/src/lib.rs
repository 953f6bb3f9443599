//! Boards with our firmware in QEMU.
//!
//! A [`Machine`] is one QEMU with the chips of `firmware/README.md`: it ends when it is dropped,
//! and when this process ends, however it ends. A [`Board`] is a machine with its EEPROM's file,
//! on a bench: it goes through the datasheets' cases as the simulated module does. A [`Hub`] joins
//! boards and a pseudo terminal to one half-duplex line.
//!
//! QEMU paces no characters and wakes late: nothing here judges exact times.

mod board;
mod folder;
mod hub;
mod machine;
mod pty;
mod qmp;

pub use board::{Board, family_image};
pub use folder::Folder;
pub use hub::{Hub, Turn};
pub use machine::Machine;
pub use pty::Pty;
