//! What a site keeps on disk: its history, its audit log, the journal of changed settings,
//! and what other programs are still to get. No
//! command waits for the history; if there is a working audit log, no output is switched before the
//! command is in it.
//!
//! # Where things are
//! - Samples and events: `history`. They are written by its thread (`history/writer`), which also
//!   deletes what is too old or too much (`history/prune`, with the times and sizes that hold
//!   where the configuration says none); charts: `history/chart`.
//! - Who did what and how it ended: `audit` (when a new file begins: `audit/files`; hashes:
//!   `audit/chain`).
//! - What another program is still to get, until it has it: `outbox`.
//! - What history and outbox do with their files: `database`.
//! - What must be whole after a loss of power: `durable`; the file of the journal of changed
//!   settings, whose records are `railbus_commission`'s: `journal`.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod audit;
mod database;
pub mod durable;
pub mod history;
pub mod journal;
pub mod outbox;
mod ulid;

pub use ulid::Ulids;
