//! Targets for random bytes, and a generator of bytes that get further than random ones.
//!
//! [`targets`] are plain `fn(&[u8])` that panic if an invariant is violated, so a coverage guided
//! fuzzer can use them as they are. `src/main.rs` runs them without one: from a seed, on a stable
//! compiler, with the same inputs in every run.

pub mod generate;
pub mod sniffed;
pub mod targets;
