//! What the judge knows of each address: who stood there when, what was heard, and how the outputs
//! were.

use railbus_bus::Presence;
use railbus_device::{Bank, Module};
use railbus_wire::Instant;

/// What stands at an address. The numbers are those of the engines there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Who {
    Right = 0,
    Other = 1,
    Nobody,
}

/// What stood at an address, and since when.
#[derive(Debug)]
pub(crate) struct Stay {
    pub(crate) who: Who,
    pub(crate) since: Instant,
    /// When it was first seen that something asked there was not answered since the right module
    /// went: from then on the line can know that it may have been replaced.
    pub(crate) missed: Option<Instant>,
    /// The end of its first reply that was heard.
    pub(crate) first: Option<Instant>,
    /// When the first value of the right module was told.
    pub(crate) told: Option<Instant>,
}

impl Stay {
    /// From when on it can be known who is there: it has answered, and something has failed.
    pub(crate) fn noticeable(&self) -> Option<Instant> {
        Some(self.first?.max(self.missed?))
    }
}

/// An address, and what the judge knows of it.
pub(crate) struct Place {
    pub(crate) address: u8,
    pub(crate) module: Module,
    pub(crate) stays: Vec<Stay>,
    /// The outputs of both engines, since when.
    pub(crate) outputs: [Vec<(Instant, u32)>; 2],
    /// When it was last asked, when that had reached it, and whether nothing was heard from there
    /// since.
    pub(crate) asked: Instant,
    pub(crate) reached: Instant,
    pub(crate) unanswered: bool,
    /// What was heard from there: whose it was, and its end.
    pub(crate) replies: Vec<(Who, Instant)>,
    /// When something to or from there was last lost.
    pub(crate) lost: Instant,
    /// What the line told last of how it is, and when it last told a value of the right module.
    pub(crate) presence: Presence,
    pub(crate) read: Instant,
    /// Its replies may be too late for the line that asks whether it is back ([`IN_TIME`]).
    pub(crate) is_late: bool,
    pub(crate) swap_at: Option<Instant>,
}

impl Place {
    pub(crate) fn stay(&self) -> &Stay {
        self.stays.last().expect("one at least")
    }

    /// What stood there at that moment.
    pub(crate) fn stay_at(&self, at: Instant) -> &Stay {
        let mut before = self.stays.iter().rev();
        before.find(|stay| stay.since <= at).expect("the first one")
    }

    /// Whether this stood there at some moment between these.
    pub(crate) fn stood(&self, who: Who, from: Instant, to: Instant) -> bool {
        let ends = self.stays.iter().skip(1).map(|stay| stay.since);
        let ends = ends.chain([Instant(u64::MAX)]);
        let mut stays = self.stays.iter().zip(ends);
        stays.any(|(stay, end)| stay.who == who && stay.since <= to && end >= from)
    }

    /// Whether these outputs of an engine were so at some moment between these.
    pub(crate) fn were(&self, who: Who, outputs: Bank, from: Instant, to: Instant) -> bool {
        let known = &self.outputs[who as usize];
        let ends = known.iter().skip(1).map(|(since, _)| *since);
        let ends = ends.chain([Instant(u64::MAX)]);
        let mut times = known.iter().zip(ends);
        times.any(|((since, is), end)| {
            *since <= to && end >= from && is & outputs.mask == outputs.on
        })
    }

    /// Whose reply was the last to be heard by then.
    pub(crate) fn answered_by(&self, by: Instant) -> Option<Who> {
        let mut replies = self.replies.iter().rev();
        replies.find(|(_, end)| *end <= by).map(|(who, _)| *who)
    }

    /// From when on it could be known of the other model that was there last.
    pub(crate) fn other_since(&self) -> Option<Instant> {
        let mut before = self.stays.iter().rev();
        before.find(|stay| stay.who == Who::Other)?.noticeable()
    }

    /// Whether the right module came after another model, and was heard, between these.
    pub(crate) fn came_back(&self, from: Instant, to: Instant) -> bool {
        let mut stays = self.stays.iter();
        let is_other = |stay: &Stay| stay.who == Who::Other;
        let is_heard = |stay: &Stay| stay.first.is_some_and(|at| from <= at && at <= to);
        stays.any(|stay| is_other(stay) && is_heard(stay))
            && stays.any(|stay| stay.who == Who::Right && is_heard(stay))
    }

    /// Whether another model stood there at some moment between these that could not be noticed:
    /// nothing asked there had failed since the right one went.
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
