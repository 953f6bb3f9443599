//! Bytes to requests and replies, and back, for the four protocols that railbus speaks:
//! Modbus RTU, the EDA/ADAM ASCII set, LC-02 and the 0x55/0x22 relay boards.
//!
//! The crate knows no clock, no port and no module: it is total on any input, allocates nothing
//! and never panics. Its one idea is [`Exchange`]: an address and a request that encodes itself
//! and decodes *its own* reply. Replies are decoded with their request because two of the
//! protocols leave out what a reply answers: LC-02 replies name no command, ASCII data replies
//! carry no address.
//!
//! ```
//! use railbus_wire::{Address, Decoded, Exchange, Frame, rtu};
//!
//! // The example of the ERC-8 manual: is relay 1 (coil 60) of module 1 on?
//! let span = rtu::BitSpan::new(60, 1).ok_or("1 to 2000 coils")?;
//! let ask = Exchange::rtu(Address(1), rtu::Request::ReadCoils(span));
//! let mut frame = Frame::new();
//! ask.encode(&mut frame);
//! assert_eq!(frame.bytes(), [0x01, 0x01, 0x00, 0x3C, 0x00, 0x01, 0x3D, 0xC6]);
//!
//! let reply = ask.decode_response(&[0x01, 0x01, 0x01, 0x01, 0x90, 0x48]);
//! assert!(matches!(reply, Decoded::Whole { len: 6, .. }));
//! # Ok::<(), &str>(())
//! ```
//!
//! With the feature `small` the tables are small or computed, for a microcontroller: a KiB less,
//! and slower.
//!
//! Sections in brackets, as `[ERC-8 §2.1]`, are numbered facts of `docs/datasheets`.
//!
//! # Where things are
//! - A protocol: `rtu` (Modbus), `ascii` (EDA, ADAM/DCON), `lc02`, `r55` (0x55/0x22). A new one is
//!   a file here and a variant of [`Exchange`]. `lcus` is only recognised, and has none. Modbus
//!   TCP is `mbap` around what `rtu` has inside.
//! - Why bytes are not a valid frame: `decoded`. What another protocol would make of a frame:
//!   `foreign`. Speeds, formats, character times: `serial`, `time`.

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

mod address;
pub mod ascii;
mod checksum;
mod decoded;
mod exchange;
mod foreign;
mod frame;
mod hex;
pub mod lc02;
pub mod lcus;
pub mod mbap;
mod payload;
pub mod r55;
pub mod rtu;
mod serial;
mod time;

pub use address::{Address, Channel, PulseWidth};
pub use checksum::{crc16, sum8};
pub use decoded::{Decoded, Malformed, Reply};
pub use exchange::{Exchange, Protocol, Response};
pub use foreign::{carries_command, foreign_command};
pub use frame::{FRAME_MAX, Frame};
pub use payload::{Bits, Words};
pub use serial::{Baud, Character, SerialSettings};
pub use time::{Instant, Micros, REPLY_TIMEOUT};
