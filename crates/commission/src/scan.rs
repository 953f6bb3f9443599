//! Finds the modules on a line: what to send next, and what the replies mean. There is no I/O here.
//!
//! The driver calls [`Scanner::next`], puts the probe on the line, and reports the result with
//! [`Scanner::met`]; so the whole scan runs in virtual time as well as on a real line, alone or
//! between the polls of a daemon.
//!
//! Silence counts as no reply after 30 ms, somewhat later in a deeper scan. A reply that comes
//! after that is not lost: it is recognised by its ghost, or corrupts the reply to another request;
//! every module that may have sent it is tried again with a long timeout. The only modules missed
//! are slower ones that give up their reply when another request is sent, unless they are
//! configured or a longer timeout is given; or unless no module was found at all: then the scan
//! waits for a module with factory settings, and for all if its scope is small.

mod ask;
mod case;
mod found;
mod identify;
mod likely;
mod planner;
mod reach;
mod scope;

pub use ask::{ProbeKind, SLOW_TIMEOUT, ScanProbe};
pub use found::{Detail, FoundModule, Verdict};
pub use identify::{Answer, Identity};
pub use planner::Scanner;
pub use reach::{LeftOut, ScanCounts, ScanPosition, ScanProgress};
pub use scope::{Depth, Known, Run, SPEEDS, ScanOptions, Scope};

use railbus_bus::LateReply;
use railbus_bus::{Probe, Probed};
use railbus_wire::Micros;

/// The driver's next action.
#[derive(Clone, Copy, Debug)]
pub enum ScanStep {
    /// Put this on the line, and report the result with [`Scanner::met`].
    Ask(Probe),
    /// A module was found, or more is known about it: the one with this index in
    /// [`Scanner::found`].
    Found(usize),
    /// The scan is complete.
    Done,
}

/// The result of a probe.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProbeOutcome {
    /// Its kind.
    pub outcome: Probed,
    /// The bytes received, without the echo.
    pub bytes: Vec<u8>,
    /// From the end of the request to the beginning of the reply.
    pub after: Micros,
    /// Replies to earlier requests that arrived meanwhile.
    pub late: Vec<LateReply>,
}
