//! The core in virtual time: scenarios, and seeds with an independent judge.

mod chance;
mod clocks;
mod closing;
mod disk;
mod ends;
mod names;
mod outputs;
mod own_pulses;
mod places;
mod reloading;
mod rules;
mod soak;
mod stream;
mod turns;
mod within;
mod world;
