//! What the site tells, in the types of the API, and what those ask of it.

pub(crate) mod ask;
pub(crate) mod config_words;
pub(crate) mod control;
pub(crate) mod convert;
pub(crate) mod failures;
pub(crate) mod past;
pub(crate) mod paths;
pub(crate) mod rules;
pub(crate) mod sending;
pub(crate) mod settings;
pub(crate) mod watching;
