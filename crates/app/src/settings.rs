//! Changing what modules keep, as commands and gateway do it: the module to work on, the port, what
//! a change would write, and how it ended.

pub mod log;
pub mod outcome;
pub mod plan;
pub mod talk;
pub mod target;
mod texts;

pub use texts::SettingsText;
