//! Boards with our firmware in QEMU.
//!
//! A [`Emulator`] is one QEMU with the chips of `firmware/README.md`: it ends when it is dropped,
//! and when this process ends in any way. A [`Board`] is a machine with its EEPROM file, on a
//! bench: it runs the datasheets' cases like the simulated module. A [`Hub`] connects boards and a
//! pseudo terminal to one half-duplex line.
//!
//! QEMU paces no characters and wakes late: nothing here judges exact times. What reaches a board
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
pub use machine::Emulator;
pub use pty::Pty;
