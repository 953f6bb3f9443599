//! User-visible texts, in English and Simplified Chinese: the two languages and the catalogues of
//! texts, failures by their codes, reasons reported by others, times, bytes, and widths of text on
//! a terminal.
//!
//! # Where things are
//! - A failure's number (`E0402`), causes and next steps, which are also its page for `railbus
//!   explain`: `codes`, by the first two digits: 01 and 02 `own`, 03 to 06 `module`, 07 `port`, 08
//!   `config`, 09 `ends`. What `doctor` and `config check` find (`D307`): `findings`. Exit codes:
//!   `exits`.
//! - The form of all other texts, which stand next to their users: `catalogue`. What parsers and
//!   the system say, in Chinese: `reasons`.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod catalogue;
mod codes;
mod exits;
pub mod findings;
pub mod hex;
mod lang;
pub mod reasons;
pub mod time;
pub mod width;

pub use catalogue::Phrase;
pub use codes::{Code, Page};
pub use exits::{EXITS, Exit};
pub use lang::Lang;
