//! An exchange under way, and on whose account.

use crate::ModuleId;
use railbus_device::Op;
use railbus_wire::{Exchange, Frame, Instant, Micros, Settings, ascii};

/// The longest pause inside a reply, as adapters hand it over in pieces.
pub const PIECE_PAUSE: Micros = Micros::from_millis(50);
/// The longest that pauses inside a reply put off its deadline, in all.
const PIECES_MAX: Micros = Micros::from_millis(300);

/// On whose account an exchange is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Job {
    /// A read of the poll plan, or a look whether a silent module is back.
    Poll { module: ModuleId, op: Op },
    /// A read that a module is greeted with.
    OnOnline { module: ModuleId, op: Op },
    /// The frame of one or more commands.
    Command { module: ModuleId, op: Op },
    /// What was asked before and not answered is to be over: something whose reply is of another
    /// shape.
    Fence { module: ModuleId, op: Op },
    /// The outputs are read for commands that wait for it.
    ReadBack { module: ModuleId },
    /// A probe of a scan.
    Probe {
        /// A lone CR goes before it.
        clear: bool,
    },
}

impl Job {
    /// The module it is for; a probe is for none.
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

    /// Whether it looks how a module is: what one costs that is silent is paid for.
    pub(crate) const fn is_status_check(&self) -> bool {
        matches!(self, Job::Poll { .. } | Job::Fence { .. })
    }

    /// Whether it asks a module what it is.
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

    /// The op of its exchange, where it has one.
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

/// An exchange under way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InFlight {
    pub(crate) job: Job,
    pub(crate) exchange: Exchange<'static>,
    /// When the request began.
    pub(crate) asked: Instant,
    /// When the request has left.
    pub(crate) sent: Instant,
    /// When the reply is given up.
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

    /// Whether its reply is wanted for nothing but what it shows of requests before it.
    pub(crate) const fn is_fence(&self) -> bool {
        matches!(self.job, Job::Fence { .. })
    }

    /// The reply has begun: its other pieces may be a little late.
    pub(crate) fn extend(&mut self, now: Instant, rest: Micros) {
        self.deadline = self.deadline.max(now + rest + PIECE_PAUSE).min(self.limit);
    }
}

/// An exchange of somebody's own between the line's: a read of a scan, or a frame that somebody
/// composed. It is sent once at most, and nothing is made of its reply here.
#[derive(Clone, Copy, Debug)]
pub struct Probe {
    /// What to ask.
    pub exchange: Exchange<'static>,
    /// Speed and character format to ask in.
    pub settings: Settings,
    /// The silence before it.
    pub gap: Micros,
    /// How long to wait for the reply to begin, from the end of the request.
    pub timeout: Micros,
    /// A lone CR goes before it, in the same breath: an ASCII module that has taken bytes of other
    /// protocols for the beginning of a command drops them.
    pub clear: bool,
    /// It may change something: whatever was learned of the modules is asked for anew after it.
    pub changes: bool,
}

/// Writes the frame of an exchange as it goes out for a job.
pub(crate) fn write_frame(job: &Job, exchange: &Exchange<'_>, out: &mut Frame) {
    exchange.encode(out);
    if let Job::Probe { clear: true } = job {
        let bare = out.clone();
        out.clear();
        // A probe is far shorter than the longest frame.
        let _ = out.extend(&[ascii::CR]) && out.extend(bare.bytes());
    }
}
