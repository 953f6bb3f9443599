//! What a site keeps on the disk: its history, its audit log, and the journal of the settings that
//! were changed. Nobody who switches something waits for the history; where there is an audit log
//! and it can be written, nothing is switched before it holds that.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod audit;
pub mod durable;
pub mod history;
pub mod journal;
mod ulid;

pub use ulid::Ulids;
