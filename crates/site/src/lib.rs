//! A site: its lines, modules and points, their values, and the quality of each. There is no
//! network here.
//!
//! [`Service`] opens the lines of a [`Config`], keeps the readings ([`Site`]) up to date, and
//! executes commands. Everything that shows or commands a site, over any network, does so through a
//! clone of the one `Service`.
//!
//! # Where things are
//! - What happens between a command and its end, and everything that depends on time (turns,
//!   interlocks, pulses, leases, policies, scenes, lines that are lent, reloads, staleness,
//!   the stream of changes): `core`, a state machine without I/O, one file for each. Whether a
//!   command is refused is decided there, in the file of its subject: the shortest and longest
//!   times that callers may ask for (`LEASE_MIN`, `PULSE_MAX`) stand in it; interlocks and
//!   `min_off` in `core/guard`. How long a command may wait it says itself ([`Within`]); the line
//!   gets the same deadline with it, as [`railbus_bus::Terms`].
//! - What drives it, and what callers see of it (one file for orders, status, followers, reloads,
//!   lines held exclusively, raw frames, running rules): `service`.
//! - What holds over a restart: ends of pulses, leases, longest times and pauses (`min_off`) as
//!   promises in `core/promises`, pulses that modules time by themselves in `core/own_pulses`,
//!   the file of both in `service/promise_file`; commands under an
//!   `Idempotency-Key`, and what is said of one that a crash interrupted, in `service/once`.
//! - Who may command what: `rights`. Why something failed: `failure`. Values and their quality:
//!   `points`.
//! - Keys of `railbus.toml`, with their checks and the edits that keep comments: `config`.
//! - Rules: their keys in `config/rules.rs`; when one is true in `rules`, as a state machine
//!   (`engine`) with times of day (`clock`); what it does then in `core/rules`, by the same
//!   steps and checks as the commands of any caller.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod config;
mod core;
mod failure;
mod health;
pub mod paths;
mod points;
mod rights;
pub mod rules;
mod service;

pub use self::core::{
    Batch, BatchDone, BatchTerms, By, COMMANDS_KEPT, Command, GroupState, LEASE_MAX, LEASE_MIN,
    LOAN_MAX, LeaseTerms, Leased, News, PULSE_MAX, Part, PartDone, Picture, PointReading, Pulse,
    PulseDone, Reloaded, ToggleTerms, WITHIN_MAX, WITHIN_MIN, Within, WriteDone, WriteTerms,
};
pub use config::Config;
pub use failure::CommandError;
pub use points::{BadReason, PointChange, PointQuality, PointState, PointValue, Pulses, Site};
pub use rights::{Rights, Role};
pub use service::{
    CommandKey, Counts, Events, ExclusiveHold, Follower, KEY_LEN_MAX, KeyRefusal, KeyTold, Left,
    LineStatus, ModuleStatus, PointNow, PointStatus, RawTerms, ReloadError, RuleStatus, STEPS,
    Sent, Service, StartError, Update, Updates, Work, is_refused,
};
