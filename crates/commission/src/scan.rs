//! Who is on a line: what to ask next, and what the answers amount to. There is no I/O here.
//!
//! The driver asks [`Scanner::next`] what to do, puts the probe on the line, and says with
//! [`Scanner::met`] what came of it; so the whole scan runs in virtual time as well as on a real
//! line, alone or between the polls of a daemon.
//!
//! Silence is believed after 30 ms, in a deeper scan somewhat later. A reply that comes after that
//! is not lost: it is known by its ghost, or leaves its trace in what comes to another question;
//! whoever may have sent it is asked again and waited for. Lost is only a module that is slower
//! and gives up its reply when somebody else talks, unless it is known or the scan is told to
//! wait longer; or unless nobody at all was found: then the scan waits for a module as the factory
//! sends it, and for all where only few were to be asked.

mod ask;
mod case;
mod found;
mod identify;
mod likely;
mod planner;
mod reach;
mod scope;

pub use ask::{Ask, Question, SLOW_TIMEOUT};
pub use found::{Detail, Found, Verdict};
pub use identify::{Answer, Identity};
pub use planner::Scanner;
pub use reach::{Counts, LeftOut, Place, Progress};
pub use scope::{Depth, Known, Run, Scope, Wish};

use railbus_bus::LateReply;
use railbus_bus::{Probe, Probed};
use railbus_wire::Micros;

/// What the driver has to do.
#[derive(Clone, Copy, Debug)]
pub enum Step {
    /// Put this on the line, and say with [`Scanner::met`] what came of it.
    Ask(Probe),
    /// A module was found, or is known better: the one of this number in [`Scanner::found`].
    Found(usize),
    /// All were asked.
    Done,
}

/// What came of a question.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Met {
    /// In one word.
    pub outcome: Probed,
    /// What came back, echo taken out.
    pub bytes: Vec<u8>,
    /// From the end of the request to the beginning of the reply.
    pub after: Micros,
    /// Replies to earlier questions that came meanwhile.
    pub late: Vec<LateReply>,
}
