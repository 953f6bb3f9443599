//! A fleet: many sites behind one centre on NATS. No clock, no socket and no file: time is passed
//! in, and files are returned as texts.
//!
//! # Where things are
//! - What a site and a server may be called: `names`.
//! - Who may publish and hear what: `grants`. The same as signed claims that NATS servers obey:
//!   `claims`. A key and its claims as a file: `creds`.
//! - What lets a site in once: `invitation`. Keys that the centre issues for it, and renews:
//!   `issuing`.
//! - What site and centre say to each other: `message`. What a site says when, and up to where the
//!   centre has its data: `uplink`. Which machine is a site, which sites are there, and what is
//!   known of their points: `centre`. Commands to sites, and their results: `ledger`; one to many
//!   sites: `bulk`.
//! - A configuration for a site, signed: `desired`; tried there: `trial`; to many sites,
//!   a few first: `rollout`.
//! - Keys that are let in no longer: `revocation`.
//! - A new fleet with all its files: `founding`; a server's configuration: `server_file`; its
//!   certificates: `certificates`.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

/// A day, in seconds.
const DAY_S: u64 = 86_400;
/// How long the key of a site is valid, in seconds: 90 days.
pub const SITE_VALID_S: u64 = 90 * DAY_S;
/// A key that is valid for less than this should have been renewed long ago, in seconds: 21 days.
pub const KEY_ENDS_SOON_S: u64 = 21 * DAY_S;
/// A clock that differs from the centre's by more than this is said to, in milliseconds.
pub const CLOCK_OFF_MS: u64 = 2_000;
/// Clocks that differ by more need attention, in milliseconds. A slow connection delays
/// heartbeats by ten seconds and more.
pub const CLOCKS_DIFFER_MS: u64 = 30_000;
/// A second machine asks for the session of a site every five minutes. One that has not asked for
/// longer than this is gone.
pub const COPY_GONE: std::time::Duration = std::time::Duration::from_secs(600);

/// How long the centre waits for an answer of a site's API.
pub const API_ANSWER_MAX: std::time::Duration = std::time::Duration::from_secs(25);

pub mod bulk;
pub mod centre;
mod certificates;
mod claims;
mod creds;
pub mod desired;
#[cfg(test)]
mod dice;
pub mod founding;
mod grants;
pub mod invitation;
pub mod issuing;
pub mod ledger;
pub mod message;
mod names;
pub mod revocation;
pub mod rollout;
mod server_file;
pub mod trial;
pub mod uplink;

pub use creds::{
    CredsError, SiteClaims, SiteSigner, joined_creds, new_site_key, public_site_key,
    read_site_creds, renewed_creds, site_token,
};
pub use founding::NodeAddress;
pub use grants::JOIN_INBOX;
pub use names::{is_node_name, is_site_name};
