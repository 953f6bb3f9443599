//! Frames on the line: their meaning in words, for programs and in capture files.

mod facts;
mod json;
pub mod meaning;
pub mod packet;
pub mod readings;
mod texts;
pub mod words;

pub use facts::{Facts, Named, addressee};
pub use json::{as_json, at, rfc3339, timestamp};
