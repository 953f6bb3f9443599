//! Targets for random bytes, and a generator of bytes that get further than random ones.
//!
//! [`targets`] are plain `fn(&[u8])` that panic where an invariant breaks, so that a coverage
//! guided fuzzer can be pointed at them as they are. `src/main.rs` feeds them without one: from
//! a seed, on a stable compiler, the same inputs in every run.

pub mod generate;
pub mod sniffed;
pub mod targets;
