//! What `railbus serve` and its callers say to each other: one set of types for the server, the
//! client, and the machine-readable output of every command.

pub(crate) mod ask;
pub(crate) mod config_words;
pub(crate) mod control;
pub(crate) mod control_types;
pub(crate) mod convert;
pub(crate) mod failures;
pub(crate) mod ops;
pub(crate) mod past;
pub(crate) mod paths;
pub(crate) mod problem;
pub(crate) mod rules;
pub(crate) mod send_types;
pub(crate) mod sending;
pub(crate) mod settings;
pub(crate) mod sim_types;
pub(crate) mod types;
pub(crate) mod watching;
pub(crate) mod webhooks;
