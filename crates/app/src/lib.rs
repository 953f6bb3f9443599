//! What the command line, the gateway and the simulated plant share: failures as people and
//! programs read them, results in their forms, what a site tells in the types of the API, what is
//! wrong with it, how settings are changed, where files and sockets lie.

#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod api;
pub mod config_check;
pub mod config_file;
pub mod doctor;
pub mod failure;
pub mod frames;
pub mod machine;
pub mod render;
pub mod scan;
pub mod settings;
pub mod socket;
pub mod texts;

pub use failure::Failure;

/// An address as manuals write it: `10`, `0x0A`, `0Ah`.
///
/// # Errors
/// Why it is none, in the words of the parser of numbers.
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
