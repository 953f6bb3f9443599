//! The exchange in flight, and what it is for.

use crate::ModuleId;
use railbus_device::Op;
use railbus_wire::{Exchange, Frame, Instant, Micros, SerialSettings, ascii};

/// The longest pause inside a reply that an adapter delivers in pieces.
pub const PIECE_PAUSE: Micros = Micros::from_millis(50);
/// The most that such pauses extend a reply's deadline, in all.
const PIECES_MAX: Micros = Micros::from_millis(300);

/// What an exchange is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Job {
    /// A read of the poll plan, or a check whether a silent module is back.
    Poll { module: ModuleId, op: Op },
    /// A read that a module is asked when it comes online.
    OnOnline { module: ModuleId, op: Op },
    /// The frame of one or more commands.
    Command { module: ModuleId, op: Op },
    /// A fence: its reply has another shape than the missing one and shows that older requests are
    /// done.
    Fence { module: ModuleId, op: Op },
    /// The outputs are read for commands that wait for their read-back.
    ReadBack { module: ModuleId },
    /// A probe of a scan.
    Probe {
        /// A lone CR is sent before it.
        clear: bool,
        /// The module of the line that it is taken to be for ([`super::Probe::as_module`]).
        addressee: Option<ModuleId>,
    },
}

impl Job {
    /// Its module; a probe has none.
    pub(crate) const fn module(&self) -> Option<ModuleId> {
        match self {
            Job::Poll { module, .. }
            | Job::OnOnline { module, .. }
            | Job::Command { module, .. }
            | Job::Fence { module, .. }
            | Job::ReadBack { module } => Some(*module),
            Job::Probe { .. } => None,
        }
    }

    /// The module whose reply is awaited, as far as that is known.
    pub(crate) const fn addressee(&self) -> Option<ModuleId> {
        match self {
            Job::Probe { addressee, .. } => *addressee,
            other => other.module(),
        }
    }

    /// Whether it only checks the state of a module: for silent modules these are throttled.
    pub(crate) const fn is_status_check(&self) -> bool {
        matches!(self, Job::Poll { .. } | Job::Fence { .. })
    }

    /// Whether it asks a module for its model.
    pub(crate) const fn identifies(&self) -> bool {
        matches!(
            self,
            Job::OnOnline {
                op: Op::Identify,
                ..
            } | Job::Command {
                op: Op::Identify,
                ..
            }
        )
    }

    /// The op of its exchange.
    pub(crate) const fn op(&self) -> Op {
        match self {
            Job::Poll { op, .. }
            | Job::OnOnline { op, .. }
            | Job::Command { op, .. }
            | Job::Fence { op, .. } => *op,
            Job::ReadBack { .. } | Job::Probe { .. } => Op::ReadOutputs,
        }
    }
}

/// An exchange in flight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InFlight {
    pub(crate) job: Job,
    pub(crate) exchange: Exchange<'static>,
    /// When the request began.
    pub(crate) asked: Instant,
    /// When the request has been sent.
    pub(crate) sent: Instant,
    /// When the reply times out.
    pub(crate) deadline: Instant,
    /// The latest that `deadline` may become.
    pub(crate) limit: Instant,
}

impl InFlight {
    pub(crate) fn new(
        job: Job,
        exchange: Exchange<'static>,
        (asked, sent, deadline): (Instant, Instant, Instant),
    ) -> InFlight {
        InFlight {
            job,
            exchange,
            asked,
            sent,
            deadline,
            limit: deadline + PIECES_MAX,
        }
    }

    /// Whether its reply only serves to end older requests.
    pub(crate) const fn is_fence(&self) -> bool {
        matches!(self.job, Job::Fence { .. })
    }

    /// The reply has begun: its other pieces may be a little late.
    pub(crate) fn extend(&mut self, now: Instant, rest: Micros) {
        self.deadline = self.deadline.max(now + rest + PIECE_PAUSE).min(self.limit);
    }
}

/// A raw exchange between those of the line: a read of a scan, or a raw frame of a user.
/// It is sent at most once, and its reply is not interpreted here.
#[derive(Clone, Copy, Debug)]
pub struct Probe {
    /// What to ask.
    pub exchange: Exchange<'static>,
    /// Speed and character format to ask in.
    pub settings: SerialSettings,
    /// The silence before it.
    pub gap: Micros,
    /// How long to wait for the reply to begin, from the end of the request.
    pub timeout: Micros,
    /// Send a lone CR right before it: an ASCII module that has taken bytes of other protocols for
    /// the beginning of a command drops them.
    pub clear: bool,
    /// It may change something: everything known of the modules is read again after it.
    pub changes: bool,
    /// Where a module of the line has its address and settings, it is asked as if by a poll: no
    /// second module is expected to answer, and a missing reply is that module's.
    pub as_module: bool,
}

/// Writes the frame of an exchange as it is sent for a job.
pub(crate) fn write_frame(job: &Job, exchange: &Exchange<'_>, out: &mut Frame) {
    exchange.encode(out);
    if let Job::Probe { clear: true, .. } = job {
        let bare = out.clone();
        out.clear();
        // A probe is far shorter than the longest frame.
        let _ = out.extend(&[ascii::CR]) && out.extend(bare.bytes());
    }
}
