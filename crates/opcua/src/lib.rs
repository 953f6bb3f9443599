//! A site as an OPC UA server: lines, modules and points as nodes, each value with its quality and
//! source time, and each write answered with how the command ended.
//!
//! - The status of a value and of a command: `status`.
//! - The nodes: `space`. What is known of them: `known`. What each monitored item may report:
//!   `items`.
//! - What the library asks of us: `manager`. Commands: `orders`. The history: `past`.
//! - Who a client is: `login`. Whom to trust: `certificates`.
//! - What drives it all: `server`.
//!
//! It listens on this machine only. Who connects from where is up to its caller, which brings the
//! connections in ([`OpcuaServer::address`]).

mod certificates;
mod items;
mod known;
mod login;
mod manager;
mod orders;
mod past;
mod server;
mod space;
mod status;
mod units;

pub use certificates::{Thumbprint, UnknownCertificate};
pub use login::{ANONYMOUS, OpcuaUser, OpcuaUsers, SignIn};
pub use server::{OpcuaEnd, OpcuaError, OpcuaServer, OpcuaSetup, TurnedAway};
