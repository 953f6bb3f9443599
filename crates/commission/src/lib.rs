//! Finding modules ([`scan`]), and changing the stored settings that their datasheets list.
//!
//! Each procedure is sequential: it reads like the steps of a manual. It does no I/O and uses no
//! clock: it hands out one [`DriverAction`] after the other and takes in the results
//! ([`Procedure::next`]), so the same code runs on a real line and, interrupted at every step, on a
//! simulated one. Nothing is written to a module before it is in the journal.
//!
//! # Where things are
//! - Finding modules: the folder `scan`. Speeds, addresses, questions and their order:
//!   `scan/scope`; the questions as bytes: `scan/ask`; taking them in turn: `scan/planner`;
//!   what replies prove, by the signs of the datasheets, and what is asked next because of it:
//!   `scan/identify`; a second look where nothing was found: `scan/likely`. Nothing here reads
//!   a configuration: what it says comes in with the scope.
//! - A change of settings, step by step: `change`, in the order of `stages`, finding the module
//!   again with `locate`, after `vacant` has checked the new place; after an interruption
//!   `recover`. What a settings word means: `settings`. What is written down before and after:
//!   `journal`. Where a module answers: `place`.
//! - Calibration, and a module's own reset: `calibrate`. All boards of a line at once: `boards`.
//! - A further procedure is a file beside these; how it talks to its driver: `context`. The one
//!   driver is `railbus_app::settings`.
//! - Frames typed by hand: `frame`, and what they may do: `risk`.

#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

mod boards;
mod calibrate;
mod change;
mod context;
mod frame;
mod journal;
mod locate;
mod place;
mod recover;
mod risk;
pub mod scan;
pub mod settings;
mod stages;
mod vacant;

pub use boards::{BoardState, all_boards};
pub use calibrate::{Blocker, Calibrated, calibrate, restore_factory};
pub use change::{Ended, Job, Neighbour, WriteFailure, change};
pub use context::{
    DriverAction, Event, Procedure, ProcedureError, ProcedureStep, Progress, Question, RxBytes,
    TimedExchange,
};
pub use frame::{read_request, request};
pub use journal::{ChangeOrigin, JournalRecord, Log, RECORDS_MAX, RecordState, Spot};
pub use locate::{LocateResult, read};
pub use place::{BusAddress, Found, Kept, PulseSetup};
pub use recover::{Recovered, Search, look_up, recover};
pub use risk::{Risk, is_answered};
pub use stages::{NotWritable, WriteStep, stages};
pub use vacant::{Taken, vacant};
