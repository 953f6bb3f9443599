//! A passive listener on an RS-485 line: finds the frames of the four protocols among the bytes,
//! judges them, and pairs replies with their requests. Also the capture files to store them.
//!
//! There is no port here and nothing that could send: the listener can't disturb the line. Like the
//! line master it has no clock; the same code runs on a live line, on the daemon's own frames and
//! on a file.
//!
//! ```
//! use railbus_sniff::{SniffEvent, Input, Listener, Output};
//! use railbus_wire::{Instant, SerialSettings};
//!
//! let mut listener = Listener::new(SerialSettings::FACTORY);
//! listener.handle(Instant(20_000), Input::Bytes(b"$016\r!030200\r"));
//! let mut frames = Vec::new();
//! while let Output::Heard(SniffEvent::Frame(frame)) = listener.poll() {
//!     frames.push(frame.bytes);
//! }
//! assert_eq!(frames, [b"$016\r".to_vec(), b"!030200\r".to_vec()]);
//! ```

#![forbid(unsafe_code)]
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]
#![cfg_attr(
    test,
    allow(clippy::unwrap_used, clippy::panic, clippy::indexing_slicing)
)]

pub mod capture;
mod frame;
mod judge;
mod listener;
mod look;
mod replies;

pub use frame::{Asked, Flaw, FrameRole, FrameVerdict, Missing, Reading, SniffEvent, SniffedFrame};
pub use listener::{Input, Listener, Output, PATIENCE};
pub use replies::replies;
