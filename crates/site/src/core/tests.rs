//! The core in virtual time: scenarios, and seeds with an independent judge.

mod disk;
mod outputs;
mod soak;
mod stream;
mod turns;
mod world;
