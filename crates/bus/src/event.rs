//! What a line tells: what was seen, how commands ended, and how the line itself is.

use crate::ModuleId;
use alloc::collections::VecDeque;
use core::fmt;
use railbus_device::{Observation, Op, Refusal};
use railbus_wire::{Exchange, Instant, Malformed, Micros};

/// A command's number, unique on its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub u64);

/// How far it is certain that a command was carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Confirmed {
    /// The state was read again afterwards and is as commanded.
    Readback,
    /// The module acknowledged.
    Reply,
    /// The frame was sent; nobody answers it, so nobody can know.
    Sent,
}

/// What was heard instead of a good reply, at all tries together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Evidence {
    /// How often it was tried.
    pub attempts: u8,
    /// How often something came that is no reply.
    pub garbled: u8,
    /// How many bytes came back in all, echo apart.
    pub bytes: u16,
    /// Why the first of them were no reply.
    pub why: Option<Malformed>,
}

impl Evidence {
    /// What one try met: so many bytes, and why they are no reply.
    pub(crate) const fn of_try(bytes: u16, why: Option<Malformed>) -> Evidence {
        Evidence {
            attempts: 1,
            garbled: why.is_some() as u8,
            bytes,
            why,
        }
    }

    /// With what another try met, which was counted when it was sent.
    pub(crate) fn add(&mut self, other: Evidence) {
        self.garbled = self.garbled.saturating_add(other.garbled);
        self.bytes = self.bytes.saturating_add(other.bytes);
        self.why = self.why.or(other.why);
    }

    /// The fault of an exchange without a good reply: silence only where nothing else ever came.
    pub(crate) const fn fault(self) -> Fault {
        match self.why {
            Some(_) => Fault::Garbled(self),
            None => Fault::NoReply(self),
        }
    }
}

/// Why a command was not confirmed, and whether the module may have acted all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Not sent: the model has no such command.
    Unsupported,
    /// Not sent: too much is waiting already.
    Overloaded,
    /// Not sent: its time to live ran out.
    Expired,
    /// Not sent: the point is locked.
    Locked,
    /// Not sent: the line is closed.
    Closed,
    /// What answers there says that it is another model.
    OtherModel {
        /// It was sent before that was known.
        sent: bool,
    },
    /// The module answered no.
    Refused(Refusal),
    /// Nothing came back that could be a reply to it.
    NoReply(Evidence),
    /// Something came back that is no reply to this.
    Garbled(Evidence),
    /// Acknowledged, but read back otherwise.
    NotVerified,
    /// It was cut short: the port vanished while it was under way.
    Unknown,
}

impl Fault {
    /// Whether the module may have acted on the command.
    #[must_use]
    pub const fn may_have_acted(&self) -> bool {
        match self {
            Fault::Unsupported
            | Fault::Overloaded
            | Fault::Expired
            | Fault::Locked
            | Fault::Closed
            | Fault::Refused(_) => false,
            Fault::OtherModel { sent } => *sent,
            Fault::NoReply(_) | Fault::Garbled(_) | Fault::NotVerified | Fault::Unknown => true,
        }
    }

    /// The name in JSON and logs.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Fault::Unsupported => "unsupported",
            Fault::Overloaded => "overloaded",
            Fault::Expired => "expired",
            Fault::Locked => "locked",
            Fault::Closed => "closed",
            Fault::OtherModel { .. } => "other_model",
            Fault::Refused(_) => "refused",
            Fault::NoReply(_) => "no_reply",
            Fault::Garbled(_) => "garbled",
            Fault::NotVerified => "not_verified",
            Fault::Unknown => "unknown",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl core::error::Error for Fault {}

/// Whether a module is heard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Presence {
    /// It was never heard since the line was opened.
    #[default]
    Unheard,
    /// It answers.
    Online,
    /// It answered before and does not now.
    Silent,
    /// Something answers that says it is another model. What it reads is not told, and it gets no
    /// commands.
    OtherModel,
}

/// Something that happened on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A module said something. It was true at some moment between `asked` and `heard`.
    Seen {
        /// Who.
        module: ModuleId,
        /// What it was asked.
        op: Op,
        /// What it said.
        seen: Observation,
        /// When the request began.
        asked: Instant,
        /// When the reply had come in.
        heard: Instant,
    },
    /// An exchange with a module failed. Not told of commands, whose end says so.
    Missed {
        /// Who.
        module: ModuleId,
        /// What it was asked.
        op: Op,
        /// What happened instead.
        fault: Fault,
    },
    /// A command ended. Every command does, exactly once.
    Done {
        /// Which.
        ticket: Ticket,
        /// How.
        end: Result<Confirmed, Fault>,
        /// From handing it in to the last byte of its own reply, the read-back apart.
        took: Micros,
    },
    /// A module is heard, or no longer.
    Presence {
        /// Who.
        module: ModuleId,
        /// From now on.
        presence: Presence,
    },
    /// A reply came so late that it was no longer waited for. It was not taken for another.
    Late {
        /// Whose.
        module: ModuleId,
        /// From the end of its request to its end.
        after: Micros,
    },
    /// What was sent comes back: the adapter echoes. The echo is taken out from now on.
    Echo,
    /// Several replies in a row came without an echo: there is none any more.
    EchoGone,
    /// A reply came twice. From now on the line waits a little before it asks the like again.
    Duplicates,
    /// The line is never silent.
    Babble,
    /// The line is silent again after a babble.
    Quiet,
    /// What a probe met.
    Probed {
        /// What came back.
        outcome: Probed,
        /// From the end of the request to the end of what came back.
        after: Micros,
    },
    /// A reply came to a probe that was over. It was not taken for another.
    ProbedLate {
        /// What was asked.
        exchange: Exchange<'static>,
        /// From the end of the request to the end of the reply.
        after: Micros,
        /// The probe had been answered: this is a second reply to it.
        again: bool,
    },
}

/// A reply to a probe that was over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LateReply {
    /// What was asked.
    pub exchange: Exchange<'static>,
    /// From the end of the request to the end of the reply.
    pub after: Micros,
    /// The probe had been answered: two modules have the address, or the line doubles.
    pub again: bool,
}

/// What a probe met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Probed {
    /// A good reply, or a refusal, which is a sign of life too. Its bytes are in
    /// [`Bus::heard`](crate::Bus::heard) until the next event.
    Answered,
    /// Bytes that are no good reply.
    Garbled,
    /// Nothing.
    Silent,
    /// Not sent: another module on the line could take the frame for a command.
    Unsafe,
}

/// The most events that wait for the driver, who fetches all of them after each input; no input
/// makes so many but a closing with a full queue of commands.
const EVENTS_MAX: usize = 512;

/// The events that the driver has not fetched yet.
#[derive(Debug)]
pub(crate) struct Events(VecDeque<Event>);

impl Events {
    pub(crate) fn new() -> Events {
        Events(VecDeque::with_capacity(EVENTS_MAX))
    }

    pub(crate) fn push(&mut self, event: Event) {
        if self.0.len() < EVENTS_MAX {
            self.0.push_back(event);
        }
    }

    pub(crate) fn next(&mut self) -> Option<Event> {
        self.0.pop_front()
    }
}
