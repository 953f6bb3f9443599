//! Serial and TCP ports on tokio, and [`Line`]: the handle of one RS-485 line of I/O modules. This
//! is the crate to add to a Rust program.
//!
//! A line is opened with the name of its port and a list of modules. One task per line runs the
//! line's state machine ([`railbus_bus::Bus`]); the handle takes commands and provides events. A
//! lost port is a state of the line, not its end: the task keeps trying to open it under the same
//! name.
//!
//! ```no_run
//! use railbus_host::{Line, LineOptions, LineName, Op, Plan, Terms};
//! use railbus_host::{Address, Bank, Channel, Family, Module, ModuleId, Setup};
//!
//! # async fn run() -> Result<(), Box<dyn std::error::Error>> {
//! let name: LineName = "/dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0".parse()?;
//! let oven = Module::new(Setup::new(Family::Erc8, Address(3)))?;
//! let line = Line::open(LineOptions::new(name).with(oven, Plan::default()))?;
//! line.opened().await?;
//! let k3 = Channel::new(2).ok_or("32 channels at most")?;
//! let on = Op::Write(Bank::one(k3, true));
//! let done = line.run(ModuleId(0), on, Terms::default()).await?;
//! println!("{:?}", done.confirmed);
//! # Ok(())
//! # }
//! ```
//!
//! # Where things are
//! - A kind of port: `serial`, `tcp`, `mbtcp`, behind `port`. Losing and reopening it: `task`;
//!   how often that is tried, for every kind of port: `backoff`.
//! - What a caller can ask of a line: `line`; what waits for its result: `pending`. Watching its
//!   bytes: `tap`.

#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

#[cfg(not(target_os = "linux"))]
compile_error!(
    "railbus-host drives serial ports by Linux's own calls; other systems are not supported yet. \
     railbus-wire, railbus-device, railbus-bus and railbus-sim build everywhere."
);

mod backoff;
mod clock;

mod error;
mod event;
mod ioctl;
mod line;
mod mbap;
mod mbtcp;
mod name;
mod pending;
mod port;
mod serial;
mod tap;
mod task;
mod tcp;
mod wake_flag;

pub use error::{Holder, PortAccess, PortError};
pub use event::{LineEvent, LineEvents, LineState, Observer};
pub use line::{
    Done, JOBS_MAX, LATE_MAX, Line, LineOptions, ModuleChanges, ProbeResult, RunId, reply_in,
};
pub use mbtcp::ModbusTcpPort;
pub use name::{LineName, NameError};
pub use port::{AnyPort, Port};
pub use serial::{Granted, Rs485, SerialOptions, SerialPort};
pub use tap::{Tap, TapFrame};
pub use tcp::TcpPort;

pub use railbus_bus::{
    Config, Confirmation, EchoMode, Event, Evidence, Fault, LateReply, MISSES_SILENT, Medium,
    ModuleId, PIECE_PAUSE, Plan, PortHistory, Presence, Probe, Probed, Terms,
};
pub use railbus_device::{
    Bank, Family, Module, Observation, Op, Point, PointKind, Refusal, SettingWrite, Setup,
};
pub use railbus_wire::{
    Address, Baud, Channel, Character, Exchange, Instant, Micros, Protocol, SerialSettings,
};
