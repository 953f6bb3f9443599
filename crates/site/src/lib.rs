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
mod failure;
mod health;
pub mod rules;
mod service;
mod truth;

pub use config::Config;
pub use failure::Failure;
pub use service::{
    BatchDone, BatchTerms, By, COMMANDS_KEPT, Command, Counts, Events, GroupState, LEASE_MAX,
    LEASE_MIN, LOAN_MAX, Leased, Left, LineStatus, Loan, ModuleStatus, PULSE_MAX, Part, PartDone,
    PointStatus, Pulse, PulseDone, RawTerms, Reloaded, RuleStatus, STEPS, Sent, Service,
    StartError, ToggleTerms, Update, Updates, Work, WriteDone, WriteTerms, is_refused,
};
pub use truth::{Change, PointState, Pulses, Quality, Reason, Site, Value};
