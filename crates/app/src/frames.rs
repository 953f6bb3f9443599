//! Frames on the line: their meaning in words, for programs and in capture files.

pub mod decodings;
mod facts;
mod json;
pub mod meaning;
pub mod packet;
mod texts;
pub mod words;

pub use facts::{Facts, Named, addressee};
pub use json::{as_json, at, rfc3339, timestamp};
