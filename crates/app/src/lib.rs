//! Shared by the command line, the gateway and the simulated plant: failures for people and
//! programs, results in all output formats, the state of a site in the types of the API, the
//! doctor's findings, changes of settings, and the paths of files and sockets.
//!
//! # Where things are
//! - The site in the types of the API, both ways: `api`. A failure with its code, cause and next
//!   step, as text and as JSON: `failure`; its words are in `railbus_words::codes`.
//! - Findings of the doctor: `doctor`, a file for each thing that it looks at (`system`, `port`,
//!   `line`, …); their codes and causes are in `railbus_words::findings`. Findings of `config
//!   check`: `config_check`. Finding the configuration: `config_file`.
//! - Frames in words: `frames`. Tables and JSON: `render`; the columns of a command are in its file
//!   in `railbus/src/commands`. The drivers of a scan and of a change of
//!   settings, on a real line: `scan`, `settings`. So a procedure is `railbus_commission`'s, its
//!   messages `railbus_api`'s, the two meet here, its endpoint is in the gateway and its command in
//!   `railbus`.
//! - Ports and users of this machine: `machine`.

#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod api;
pub mod config_check;
pub mod config_file;
pub mod doctor;
pub mod failure;
pub mod frames;
pub mod machine;
pub mod own_folder;
pub mod render;
pub mod scan;
pub mod settings;
pub mod socket;
pub mod texts;

pub use failure::Failure;

/// An address as written in manuals: `10`, `0x0A`, `0Ah`.
///
/// # Errors
/// Why it is not valid, in the words of the number parser.
pub fn address(text: &str) -> Result<u8, String> {
    let hexadecimal = text
        .strip_prefix("0x")
        .or_else(|| text.strip_suffix(['h', 'H']));
    match hexadecimal {
        Some(digits) => u8::from_str_radix(digits, 16),
        None => text.parse(),
    }
    .map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_in_both_systems() {
        for (text, number) in [("10", 10), ("0x0A", 10), ("0Ah", 10), ("F5h", 245)] {
            assert_eq!(address(text), Ok(number), "{text}");
        }
        for wrong in ["256", "-1", "x", "", "h"] {
            assert!(address(wrong).is_err(), "{wrong}");
        }
    }
}
