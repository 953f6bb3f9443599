//! The events of a line: readings, ends of commands, and changes of the line itself.

use crate::{COMMANDS_MAX, ModuleId};
use alloc::collections::VecDeque;
#[cfg(test)]
use alloc::vec::Vec;
use core::fmt;
use railbus_device::{Observation, Op, Refusal};
use railbus_wire::{Exchange, Instant, Malformed, Micros};

/// A command's number, unique on its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub u64);

/// How a command was confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Confirmation {
    /// The state was read back and matches.
    Readback,
    /// The module acknowledged.
    Reply,
    /// The frame was sent; it gets no reply, so nothing more can be known.
    Sent,
}

/// What was received instead of a good reply, over all attempts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Evidence {
    /// The number of attempts.
    pub attempts: u8,
    /// How many attempts got something that is not a valid reply.
    pub garbled: u8,
    /// How many bytes came back in all, without echoes.
    pub bytes: u16,
    /// Why the first of them were not a valid reply.
    pub why: Option<Malformed>,
}

impl Evidence {
    /// The evidence of one attempt: how many bytes, and why they are not a valid reply.
    pub(crate) const fn of_try(bytes: u16, why: Option<Malformed>) -> Evidence {
        Evidence {
            attempts: 1,
            garbled: why.is_some() as u8,
            bytes,
            why,
        }
    }

    /// Adds the evidence of another attempt, which was counted when it was sent.
    pub(crate) fn add(&mut self, other: Evidence) {
        self.garbled = self.garbled.saturating_add(other.garbled);
        self.bytes = self.bytes.saturating_add(other.bytes);
        self.why = self.why.or(other.why);
    }

    /// The fault of an exchange without a good reply: silence only if nothing was ever received.
    pub(crate) const fn fault(self) -> Fault {
        match self.why {
            Some(_) => Fault::Garbled(self),
            None => Fault::NoReply(self),
        }
    }
}

/// Why a command was not confirmed, and whether the module may have acted anyway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Not sent: the model has no such command.
    Unsupported,
    /// Not sent: the queue is full.
    Overloaded,
    /// Not sent: it expired.
    Expired,
    /// Not sent: the point is locked.
    Locked,
    /// Not sent: the line is closed.
    Closed,
    /// The module at the address identifies itself as another model.
    OtherModel {
        /// It was sent before that was known.
        sent: bool,
    },
    /// The module refused it.
    Refused(Refusal),
    /// Nothing came back that could be its reply.
    NoReply(Evidence),
    /// Something came back that is not its reply.
    Garbled(Evidence),
    /// Acknowledged, but the read-back does not match.
    NotVerified,
    /// Interrupted: the port was lost while it was pending.
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

/// Whether a module answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Presence {
    /// It has not answered since the line was opened.
    #[default]
    Unheard,
    /// It answers.
    Online,
    /// It answered before and no longer does.
    Silent,
    /// The module at the address identifies itself as another model. Its readings are withheld, and
    /// it gets no commands.
    OtherModel,
}

/// Something that happened on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A module reported something. It was true at some moment between `asked` and `heard`.
    Seen {
        /// Which module.
        module: ModuleId,
        /// The request.
        op: Op,
        /// Its answer.
        seen: Observation,
        /// When the request began.
        asked: Instant,
        /// When the reply was complete.
        heard: Instant,
    },
    /// An exchange with a module failed. Commands report this in their end instead.
    Missed {
        /// Which module.
        module: ModuleId,
        /// The request.
        op: Op,
        /// What happened.
        fault: Fault,
    },
    /// A command ended. Every command does, exactly once.
    Done {
        /// Which command.
        ticket: Ticket,
        /// How it ended.
        end: Result<Confirmation, Fault>,
        /// From submission to the last byte of its own reply, without the read-back.
        took: Micros,
    },
    /// A module came online, or stopped answering.
    Presence {
        /// Which module.
        module: ModuleId,
        /// Its new state.
        presence: Presence,
    },
    /// A reply came after its timeout. It was not taken for another.
    Late {
        /// Whose reply.
        module: ModuleId,
        /// From the end of the request to the end of the reply.
        after: Micros,
    },
    /// Requests come back: the adapter echoes. The echo is removed from now on.
    Echo,
    /// Several replies in a row came without an echo: there is none any more.
    EchoGone,
    /// A reply came twice. From now on the line waits a little before it repeats a similar request.
    Duplicates,
    /// A babble: the line is never silent.
    Babble,
    /// The line is silent again after a babble.
    Quiet,
    /// The result of a probe.
    Probed {
        /// What came back.
        outcome: Probed,
        /// From the end of the request to the end of what came back.
        after: Micros,
    },
    /// A late reply to a probe. It was not taken for another.
    ProbedLate {
        /// The request.
        exchange: Exchange<'static>,
        /// From the end of the request to the end of the reply.
        after: Micros,
        /// The probe was answered before: this is a second reply.
        again: bool,
    },
    /// The driver did not fetch the events in time, and so many were lost; ends of commands and
    /// probes only after all others. Whether modules answer is to be asked anew
    /// ([`Bus::presence`](crate::Bus::presence)), and everything is read again.
    Overflow {
        /// How many events were lost.
        lost: u32,
    },
}

/// A late reply to a probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LateReply {
    /// The request.
    pub exchange: Exchange<'static>,
    /// From the end of the request to the end of the reply.
    pub after: Micros,
    /// The probe was answered before: two modules share the address, or the line duplicates
    /// replies.
    pub again: bool,
}

/// The result of a probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Probed {
    /// A good reply, or a refusal, which also shows that a module is there. Its bytes are in
    /// [`Bus::heard`](crate::Bus::heard) until the next event.
    Answered,
    /// Bytes that are not a valid reply.
    Garbled,
    /// Nothing. A module that does not answer the line either may not have been asked
    /// ([`Probe::as_module`](crate::Probe::as_module)).
    Silent,
    /// Not sent: another module on the line could take the frame for a command.
    Unsafe,
}

/// The most events that wait for the driver, which fetches all of them after each input: only
/// closing a line with hundreds of modules makes this many.
const EVENTS_MAX: usize = 512;
/// Room kept for what must not be lost: the ends of all commands, and of a probe.
const ENDS_MAX: usize = COMMANDS_MAX + 1;

/// The events that the driver has not fetched yet.
#[derive(Debug)]
pub(crate) struct Events {
    waiting: VecDeque<Event>,
    /// How many found no room since the driver last fetched all.
    lost: u32,
}

impl Events {
    pub(crate) fn new() -> Events {
        Events {
            waiting: VecDeque::with_capacity(EVENTS_MAX),
            lost: 0,
        }
    }

    pub(crate) fn push(&mut self, event: Event) {
        let most = match event {
            Event::Done { .. } | Event::Probed { .. } => EVENTS_MAX,
            _ => EVENTS_MAX - ENDS_MAX,
        };
        if self.waiting.len() < most {
            self.waiting.push_back(event);
        } else {
            self.lost = self.lost.saturating_add(1);
        }
    }

    /// The next event.
    pub(crate) fn next(&mut self) -> Option<Event> {
        self.waiting.pop_front()
    }

    /// How many were lost, if any: asked after all that wait.
    pub(crate) fn take_lost(&mut self) -> Option<u32> {
        (self.lost > 0).then(|| core::mem::take(&mut self.lost))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bus, Config, Output};

    /// What finds no room is counted; ends still find some.
    #[test]
    fn lost_events_are_counted_and_ends_are_not_among_them() {
        let mut bus = Bus::new(Config::default());
        let events = &mut bus.events;
        for _ in 0..EVENTS_MAX {
            events.push(Event::Babble);
        }
        for number in 0..COMMANDS_MAX as u64 {
            events.push(Event::Done {
                ticket: Ticket(number),
                end: Err(Fault::Closed),
                took: Micros::ZERO,
            });
        }
        events.push(Event::Probed {
            outcome: Probed::Silent,
            after: Micros::ZERO,
        });
        let mut next = || match bus.poll() {
            Output::Event(event) => Some(event),
            _ => None,
        };
        let all: Vec<Event> = core::iter::from_fn(&mut next).collect();
        let count = |is: fn(&Event) -> bool| all.iter().filter(|event| is(event)).count();
        assert_eq!(
            count(|event| matches!(event, Event::Babble)),
            EVENTS_MAX - ENDS_MAX
        );
        assert_eq!(
            count(|event| matches!(event, Event::Done { .. })),
            COMMANDS_MAX
        );
        assert_eq!(count(|event| matches!(event, Event::Probed { .. })), 1);
        let lost = ENDS_MAX as u32;
        assert_eq!(
            all.last(),
            Some(&Event::Overflow { lost }),
            "after all others"
        );
        assert_eq!(next(), None, "reported once");
    }
}
