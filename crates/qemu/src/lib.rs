//! Boards with our firmware in QEMU.
//!
//! A [`Machine`] is one QEMU with the chips of `firmware/README.md`: it ends when it is dropped,
//! and when this process ends, however it ends. A [`Board`] is a machine with its EEPROM's file,
//! on a bench: it goes through the datasheets' cases as the simulated module does. A [`Hub`] joins
//! boards and a pseudo terminal to one half-duplex line.
//!
//! QEMU paces no characters and wakes late: nothing here judges exact times. What comes to a board
//! as one burst is one, however busy the machine is ([`Ear`]), and silence is measured by the
//! board's own clock.

mod board;
mod ear;
mod folder;
mod hub;
mod machine;
mod pty;
mod qmp;
mod taken;

pub use board::{Board, family_image};
pub use ear::Ear;
pub use folder::Folder;
pub use hub::{Hub, Turn};
pub use machine::Machine;
pub use pty::Pty;
