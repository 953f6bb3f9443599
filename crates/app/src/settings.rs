//! Changes of module settings for commands and gateway: the module, the port, what a change would
//! write, the driver of its procedure, and its result.

pub mod drive;
pub mod log;
pub mod outcome;
pub mod plan;
pub mod port;
pub mod target;
mod texts;

pub use texts::SettingsText;
