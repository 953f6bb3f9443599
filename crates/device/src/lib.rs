//! Five families of DIN-rail I/O modules, both ends of the wire.
//!
//! Each family has one module here. It holds the datasheet as data (a [`Profile`], and a
//! [`Datasheet`] of what only a host asks), the host side
//! ([`Module`]: an [`Op`] becomes one exchange, its reply becomes an [`Observation`]) and the
//! device side (its half of [`Engine`], which is both the simulated module and the firmware).
//! Nothing here uses a clock, a port or an allocator.
//!
//! Sections in brackets, as `[ERC-8 §2.1]`, are numbered facts of `docs/datasheets`.
//!
//! # Where things are
//! - A family: its own file (`eda9060a`, `eda9050`, `eda` for what both share, `erc8`,
//!   `emd2a2q`, `r55` for the 0x55/0x22 relay boards). Addresses of coils and registers that
//!   both ends use are constants in it (runs of coils: `modbus`). Ranges, terminals and timing,
//!   such as the silence before a request, are in its [`Profile`]; stored settings, registers
//!   and identification, which only a host asks for, in its [`Datasheet`]. Nothing above this
//!   crate matches on a family.
//! - The forms of that data: `family` ([`Profile`]) and `datasheet`. A further setting of a kind in
//!   `datasheet::Key` is a line of the family's sheet and its half of the engine; a new kind is
//!   also a [`SettingWrite`], a field of `railbus_nvm::Record` and a step of
//!   `railbus_commission::stages`.
//! - What a host wants of a module: `op`, `module`. How the module itself behaves: `engine`, which
//!   is also the firmware: what only a simulation does is in `railbus_sim`. What our own firmware
//!   can beyond the makers': `extensions`.

#![no_std]
#![forbid(unsafe_code)]
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::unreachable
)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::indexing_slicing))]

mod datasheet;
mod eda;
mod eda9050;
mod eda9060a;
mod emd2a2q;
mod engine;
mod erc8;
mod extensions;
mod family;
mod modbus;
mod module;
mod op;
mod r55;
mod sign;

pub use datasheet::{
    Access, Bilingual, Datasheet, Factory, Holds, Key, PerProtocol, PulseTiming, Recognition,
    Register, ScanEvidence, Separation, StoredSetting, Terminal,
};
pub use engine::{AnalogCalibration, Applies, Eeprom, Effect, Engine, Input, Options, Output};
pub use extensions::Extensions;
pub use family::{Family, Layout, Point, PointKind, Profile, Setup, SetupError};
pub use module::Module;
pub use op::{Bank, Observation, Op, Refusal, SettingWrite, Unsupported};
pub use r55::board_address;
pub use sign::{ReadOutcome, Sign};
