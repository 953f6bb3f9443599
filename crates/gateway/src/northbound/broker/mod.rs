//! What all outlets at a broker share: how one is reached, in both versions of its protocol.
//!
//! - The settings, and how they stand in the form: `settings`, `fields`.
//! - TCP and TLS: `dial`. Both versions of the protocol: `link`. What goes there and comes from
//!   there: `message`. Which of it went in which packet: `numbers`.
//! - How a connection is made, tried and made again: `session`. Whether the program stood still
//!   meanwhile: `alive`.

mod alive;
mod dial;
pub(super) mod fields;
pub(super) mod link;
pub(super) mod message;
mod numbers;
pub(crate) mod session;
pub(super) mod settings;

pub(super) use alive::Alive;
pub(super) use dial::Dial;
#[cfg(feature = "fleet")]
pub(crate) use dial::{tls_reason, trusting};

/// How many messages are with the broker, or on their way to it, at a time.
pub(super) const WINDOW: usize = 64;

/// A name as one level of a topic.
pub(super) fn level(name: &str) -> String {
    let fits = |char: char| match char {
        '/' | '+' | '#' | '$' => '_',
        char if char.is_control() || char.is_whitespace() => '_',
        char => char,
    };
    match name.is_empty() {
        true => "site".to_owned(),
        false => name.chars().map(fits).collect(),
    }
}
