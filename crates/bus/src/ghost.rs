//! Ghosts: requests whose reply may still come.
//!
//! A request that was not answered in time stays a ghost until no late reply can arrive. No
//! request that could be confused with a ghost is sent meanwhile: so a late reply is never taken
//! for another module's, or for another moment's.

use crate::ModuleId;
use railbus_wire::{Decoded, Exchange, Instant};

/// How many ghosts a line holds; with that many, it asks nothing until one is gone.
pub const GHOSTS_MAX: usize = 16;

/// A request whose reply may still come.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ghost {
    pub(crate) exchange: Exchange<'static>,
    pub(crate) module: Option<ModuleId>,
    /// When its request had left.
    pub(crate) sent: Instant,
    pub(crate) until: Instant,
    /// The request was answered: what may come is the same reply again.
    pub(crate) answered: bool,
}

/// The ghosts of a line.
#[derive(Debug)]
pub(crate) struct Ghosts {
    slots: [Option<Ghost>; GHOSTS_MAX],
    /// How many slots are taken: none on a good line, which then spends no time here.
    count: usize,
    /// Whether any are kept at all.
    kept: bool,
}

impl Ghosts {
    pub(crate) const fn new(kept: bool) -> Ghosts {
        Ghosts {
            slots: [None; GHOSTS_MAX],
            count: 0,
            kept,
        }
    }

    /// Adds one. There is always room, since nothing is sent while there is none.
    pub(crate) fn add(&mut self, ghost: Ghost) {
        if let Some(slot) = self.slots.iter_mut().find(|slot| slot.is_none())
            && self.kept
        {
            *slot = Some(ghost);
            self.count += 1;
        }
    }

    pub(crate) fn clear(&mut self) {
        self.slots = [None; GHOSTS_MAX];
        self.count = 0;
    }

    pub(crate) fn expire(&mut self, now: Instant) {
        if self.count == 0 {
            return;
        }
        for slot in &mut self.slots {
            if slot.take_if(|ghost| ghost.until <= now).is_some() {
                self.count -= 1;
            }
        }
    }

    /// Until when this exchange must not be sent: the end of the last ghost it could be
    /// confused with, or of the first one where there is no room for more.
    pub(crate) fn blocked_until(&self, exchange: &Exchange<'_>) -> Option<Instant> {
        if self.count == 0 {
            return None;
        }
        let ghosts = || self.slots.iter().flatten();
        let confusable = ghosts().filter(|ghost| ghost.exchange.confusable(exchange));
        let full = self.count == GHOSTS_MAX;
        let room = ghosts().map(|ghost| ghost.until).min().filter(|_| full);
        confusable.map(|ghost| ghost.until).max().max(room)
    }

    /// Until when a reply may still come to a request that was given up.
    pub(crate) fn haunted_until(&self) -> Option<Instant> {
        let given_up = self.slots.iter().flatten().filter(|ghost| !ghost.answered);
        given_up.map(|ghost| ghost.until).max()
    }

    /// Whether a reply found so far into these bytes lies within what is, or may become, a
    /// ghost's: LC-02 data may hold what an ASCII module says.
    pub(crate) fn hide(&self, bytes: &[u8], at: usize) -> bool {
        at > 0
            && self
                .slots
                .iter()
                .flatten()
                .any(|ghost| match ghost.exchange.find_response(bytes) {
                    (skip, Decoded::Whole { len, .. }) => skip < at && at < skip + len,
                    (skip, Decoded::Partial { .. }) => skip < at,
                    (_, Decoded::Malformed(_)) => false,
                })
    }

    /// Takes the ghost that these bytes hold a reply to; where that stands, and its length.
    pub(crate) fn take_answered(&mut self, bytes: &[u8]) -> Option<(Ghost, usize, usize)> {
        let answered = self.slots.iter_mut().find_map(|slot| {
            match slot.as_ref()?.exchange.find_response(bytes) {
                (skip, Decoded::Whole { len, .. }) => slot.take().map(|ghost| (ghost, skip, len)),
                (_, Decoded::Partial { .. } | Decoded::Malformed(_)) => None,
            }
        });
        self.count -= usize::from(answered.is_some());
        answered
    }
}
