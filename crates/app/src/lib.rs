//! What the command line, the gateway and the simulated plant share: failures as people and
//! programs read them, results in their forms, what a site tells in the types of the API, where
//! files and sockets lie.

#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod api;
pub mod config_file;
pub mod failure;
pub mod machine;
pub mod meaning;
pub mod render;
pub mod socket;
pub mod texts;

pub use failure::Failure;
