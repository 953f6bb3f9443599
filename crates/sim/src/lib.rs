//! A half-duplex line of I/O modules in virtual time.
//!
//! [`VirtualLine`] connects modules, a host and faults: characters take their time, two
//! simultaneous senders collide, a module at another speed receives garbage, and faults are drawn
//! from one seed, so a seed reproduces a run. Like all state machines in railbus it is driven by
//! [`VirtualLine::handle`], which takes what happens, and [`VirtualLine::poll`], which is drained
//! until it returns [`Output::Wait`]; each `Wait` replaces the previous deadline. There is no clock
//! here: the driver may jump from deadline to deadline, or wait for a real clock to reach them.
//!
//! # Where things are
//! - How a healthy module answers, and when, is `railbus_device`'s; here is what befalls it.
//! - Who hears what, and collisions: `line`, `talk`. A module on it, and what can be done to it,
//!   such as a stuck relay ([`Act`]): `slot`. What befalls requests, replies and characters, by
//!   chance or always: `faults`. The name and syntax of a fault that a user can order are in
//!   `railbus_site::config::faults`; `railbus_plant` hands it on to here (`active_faults`,
//!   `stage`). The modules of the demo: `demo`.
//!
//! ```
//! use railbus_sim::{Input, VirtualLine, VirtualLineConfig, Output};
//! use railbus_device::{Eeprom, Family, Options, Setup};
//! use railbus_wire::{Address, Instant, SerialSettings};
//!
//! let mut line = VirtualLine::new(VirtualLineConfig::default());
//! let oven = Setup::new(Family::Erc8, Address(1));
//! line.add(Instant(0), "oven", &oven, Eeprom::of(&oven), Options::default())?;
//!
//! // Relay 1 on, as the manual prints it; it is answered by its echo.
//! let mut now = Instant(100_000);
//! let request = [0x01, 0x05, 0x00, 0x3C, 0xFF, 0x00, 0x4C, 0x36];
//! line.handle(now, Input::Send { bytes: &request, settings: SerialSettings::FACTORY });
//! let mut reply = Vec::new();
//! while reply.len() < 8 {
//!     match line.poll() {
//!         Output::Heard { bytes, .. } => reply.extend_from_slice(bytes),
//!         Output::Effect { .. } => {}
//!         Output::Wait(at) => {
//!             now = at.ok_or("nothing will happen any more")?;
//!             line.handle(now, Input::Timeout);
//!         }
//!     }
//! }
//! assert_eq!(reply, request);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

pub mod demo;
mod faults;
mod line;
mod random;
mod slot;
mod talk;
mod trace;

pub use faults::{Chance, DurationRange, Faults, Injected};
pub use line::{Chunks, Input, Output, VirtualLine, VirtualLineConfig};
pub use slot::{Act, ModuleCounts, Power, SlotId};
pub use trace::{Trace, TraceDirection, TraceEntry};
