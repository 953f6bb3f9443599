//! The messages between `railbus serve` and its clients: one set of types for the server, the
//! client, and the machine-readable output of every command.
//!
//! # Where things are
//! - Points, modules, lines and commands to outputs: `types`, `control`; history and audit log:
//!   `past`; the datasheets of models: `models`; the other files are named after their subjects. A
//!   further field is added here and filled in `railbus_app::api`; the OpenAPI document follows
//!   from the type, and the types of the web pages from that document. A field of a point stands
//!   twice: in `types::PointInfo`, filled in `railbus_app::api::convert`, and in
//!   `view::PointView`, which borrows, filled in `railbus_app::api::print`.
//! - What a failed request returns: `problem`; its codes are defined in `railbus_words::codes`.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod control;
pub mod fleet;
pub mod models;
pub mod ops;
pub mod outlets;
pub mod past;
pub mod problem;
pub mod rules;
pub mod sending;
pub mod settings;
pub mod sim;
pub mod types;
pub mod view;
pub mod webhooks;
pub mod words;
