//! The commands, one file each.

pub(crate) mod audit;
pub(crate) mod bench;
pub(crate) mod complete;
pub(crate) mod completions;
pub(crate) mod config;
pub(crate) mod decode;
pub(crate) mod doctor;
pub(crate) mod explain;
pub(crate) mod export;
pub(crate) mod extcap;
pub(crate) mod fleet;
pub(crate) mod get;
pub(crate) mod help;
pub(crate) mod history;
pub(crate) mod ls;
pub(crate) mod man;
pub(crate) mod outlet;
pub(crate) mod pulse;
pub(crate) mod raw;
pub(crate) mod replay;
pub(crate) mod scan;
pub(crate) mod scene;
pub(crate) mod schema;
pub(crate) mod serve;
pub(crate) mod set;
pub(crate) mod sim;
pub(crate) mod sniff;
pub(crate) mod token;
pub(crate) mod user;
pub(crate) mod version;
pub(crate) mod wait;
pub(crate) mod watch;

mod accounts_client;
mod accounts_table;
mod config_check;
mod context;
mod install;
mod own_line;
mod place;
mod stop;
mod trace;
mod wireshark;

pub(crate) use context::{Context, global_flags};

use std::fs::File;
use std::io::{self, Read};

/// A name that no other one has: 16 random hexadecimal digits.
fn random_id() -> io::Result<String> {
    let mut bytes = [0; 8];
    File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(hex(&bytes))
}

/// Bytes as lower-case hexadecimal digits.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
