//! Conversion between the site and the types of the API, in both directions.

pub mod ask;
pub mod config_words;
pub mod control;
pub mod convert;
pub mod failures;
pub mod models;
pub mod past;
pub mod print;
pub mod rules;
pub mod sending;
pub mod settings;
pub mod watching;
