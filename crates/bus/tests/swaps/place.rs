//! What the judge knows of each address: which module was there when, what was received, and the
//! state of the outputs.

use railbus_bus::Presence;
use railbus_device::{Bank, Module};
use railbus_wire::Instant;

/// What is at an address. The numbers are those of the engines there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Who {
    Right = 0,
    Other = 1,
    Nobody,
}

/// What was at an address, and since when.
#[derive(Debug)]
pub(crate) struct Stay {
    pub(crate) who: Who,
    pub(crate) since: Instant,
    /// When a request to it was first seen unanswered since the right module was removed: from then
    /// on the line can know that it may have been replaced.
    pub(crate) missed: Option<Instant>,
    /// The end of its first reply that was received.
    pub(crate) first: Option<Instant>,
    /// When the first value of the right module was reported.
    pub(crate) told: Option<Instant>,
}

impl Stay {
    /// From when on it can be known which module is there: it has answered, and something has
    /// failed.
    pub(crate) fn noticeable(&self) -> Option<Instant> {
        Some(self.first?.max(self.missed?))
    }
}

/// An address, and what the judge knows of it.
pub(crate) struct Place {
    pub(crate) address: u8,
    pub(crate) module: Module,
    pub(crate) stays: Vec<Stay>,
    /// The output states of both engines, with their times.
    pub(crate) outputs: [Vec<(Instant, u32)>; 2],
    /// When it was last addressed, when that had reached it, and whether nothing was received from
    /// there since.
    pub(crate) asked: Instant,
    pub(crate) reached: Instant,
    pub(crate) unanswered: bool,
    /// What was received from there: which module sent it, and its end.
    pub(crate) replies: Vec<(Who, Instant)>,
    /// When a frame to or from it was last lost.
    pub(crate) lost: Instant,
    /// The last presence that the line reported, and when it last reported a value of the right
    /// module.
    pub(crate) presence: Presence,
    pub(crate) read: Instant,
    /// Its replies may be too late for a probe ([`IN_TIME`]).
    pub(crate) is_late: bool,
    pub(crate) swap_at: Option<Instant>,
}

impl Place {
    pub(crate) fn stay(&self) -> &Stay {
        self.stays.last().expect("one at least")
    }

    /// What was there at that moment.
    pub(crate) fn stay_at(&self, at: Instant) -> &Stay {
        let mut before = self.stays.iter().rev();
        before.find(|stay| stay.since <= at).expect("the first one")
    }

    /// Whether this was there at some moment between these.
    pub(crate) fn stood(&self, who: Who, from: Instant, to: Instant) -> bool {
        let ends = self.stays.iter().skip(1).map(|stay| stay.since);
        let ends = ends.chain([Instant(u64::MAX)]);
        let mut stays = self.stays.iter().zip(ends);
        stays.any(|(stay, end)| stay.who == who && stay.since <= to && end >= from)
    }

    /// Whether an engine's outputs had these states at some moment between these.
    pub(crate) fn were(&self, who: Who, outputs: Bank, from: Instant, to: Instant) -> bool {
        let known = &self.outputs[who as usize];
        let ends = known.iter().skip(1).map(|(since, _)| *since);
        let ends = ends.chain([Instant(u64::MAX)]);
        let mut times = known.iter().zip(ends);
        times.any(|((since, is), end)| {
            *since <= to && end >= from && is & outputs.mask == outputs.on
        })
    }

    /// Which module's reply was the last received by then.
    pub(crate) fn answered_by(&self, by: Instant) -> Option<Who> {
        let mut replies = self.replies.iter().rev();
        replies.find(|(_, end)| *end <= by).map(|(who, _)| *who)
    }

    /// From when on the last other model could be detected.
    pub(crate) fn other_since(&self) -> Option<Instant> {
        let mut before = self.stays.iter().rev();
        before.find(|stay| stay.who == Who::Other)?.noticeable()
    }

    /// Whether the right module came after another model, and was received, between these.
    pub(crate) fn came_back(&self, from: Instant, to: Instant) -> bool {
        let mut stays = self.stays.iter();
        let is_other = |stay: &Stay| stay.who == Who::Other;
        let is_heard = |stay: &Stay| stay.first.is_some_and(|at| from <= at && at <= to);
        stays.any(|stay| is_other(stay) && is_heard(stay))
            && stays.any(|stay| stay.who == Who::Right && is_heard(stay))
    }

    /// Whether another model was there at some moment between these that could not be detected: no
    /// request to it had failed since the right one was removed.
    pub(crate) fn was_unnoticed(&self, from: Instant, to: Instant) -> bool {
        let ends = self.stays.iter().skip(1).map(|stay| stay.since);
        let ends = ends.chain([Instant(u64::MAX)]);
        let mut stays = self.stays.iter().zip(ends);
        stays.any(|(stay, end)| {
            stay.who == Who::Other
                && stay.missed.is_none_or(|at| at > from)
                && stay.since <= to
                && end >= from
        })
    }
}
