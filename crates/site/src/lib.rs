//! The truth about a site: its lines, modules and points, what is known of them, and how good
//! that knowledge is. There is no network here.
//!
//! [`Service`] opens the lines of a [`Config`], keeps the truth ([`Site`]) up to date, and takes
//! commands. Whoever shows or commands a site, over whatever network, does it through a clone of
//! the one `Service`.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod config;
mod core;
mod failure;
mod health;
pub mod rules;
mod service;
mod truth;

pub use self::core::{
    BatchDone, BatchTerms, By, COMMANDS_KEPT, Command, GroupState, LEASE_MAX, LEASE_MIN, Leased,
    PULSE_MAX, Part, PartDone, Pulse, PulseDone, ToggleTerms, WriteDone, WriteTerms,
};
pub use config::Config;
pub use failure::Failure;
pub use service::{
    Counts, Events, LOAN_MAX, Left, LineStatus, Loan, ModuleStatus, PointStatus, RawTerms,
    Reloaded, RuleStatus, STEPS, Sent, Service, StartError, Update, Updates, Work, is_refused,
};
pub use truth::{Change, PointState, Pulses, Quality, Reason, Site, Value};
