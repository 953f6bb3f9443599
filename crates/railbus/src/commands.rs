//! The commands of daily work, one file each.

pub(crate) mod config;
pub(crate) mod decode;
pub(crate) mod explain;
pub(crate) mod extcap;
pub(crate) mod get;
pub(crate) mod ls;
pub(crate) mod pulse;
pub(crate) mod raw;
pub(crate) mod scan;
pub(crate) mod set;
pub(crate) mod sniff;
pub(crate) mod watch;

mod context;
mod place;
mod stop;
mod wireshark;

pub(crate) use context::{Context, address, global_flags};
