//! A *ghost* is a request whose reply may still come.
//!
//! A request that was not answered in time stays a ghost until no late reply can arrive: until the
//! module has answered something it was asked later (docs/decisions/0015), or until its time is
//! over. Meanwhile no request is sent that could be confused with a ghost, so a late reply is never
//! taken for another module's, nor for a newer one.

use crate::ModuleId;
use alloc::vec;
use alloc::vec::Vec;
use core::ops::Range;
use railbus_wire::{Decoded, Exchange, Instant, Micros, Reply, Response};

/// The most ghosts of a line; with that many, it sends nothing until one is gone.
const GHOSTS_MAX: usize = 192;

/// How long after its request a late reply may reach the next user of the port, if nothing is known
/// of the module.
const LATE_UNKNOWN: Micros = Micros::from_millis(900);

/// This many bytes of a reply tell whose it is, and of what kind.
const HEAD: usize = 3;

/// A request whose reply may still come.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ghost {
    pub(crate) exchange: Exchange<'static>,
    pub(crate) module: Option<ModuleId>,
    /// When its request had been sent.
    pub(crate) sent: Instant,
    /// Until when the module itself may answer it.
    pub(crate) late: Instant,
    /// Until when the reply may arrive, if it is held back on its way.
    pub(crate) until: Instant,
    /// The request was answered: only a duplicate may still come.
    pub(crate) answered: bool,
    /// It was a fence: only a good reply counts ([`Exchange::stands_apart`]).
    pub(crate) fence: bool,
}

impl Ghost {
    /// Whether its reply could be taken for a reply to this exchange.
    fn is_confusable(&self, exchange: &Exchange<'_>) -> bool {
        if self.fence {
            !self.exchange.stands_apart(exchange)
        } else {
            self.exchange.confusable(exchange)
        }
    }

    /// Until when the next user of the port has to expect it. The fence showed how fast the module
    /// is, which says nothing about the missing reply.
    fn late_reply_until(&self) -> Instant {
        self.late.max((self.sent + LATE_UNKNOWN).min(self.until))
    }

    /// Whether it may block other modules than its own. ASCII data may look like a reply that
    /// begins with an address.
    const fn is_common(&self) -> bool {
        matches!(self.exchange, Exchange::Ascii(_))
    }
}

/// The ghosts of a line.
#[derive(Debug)]
pub(crate) struct Ghosts {
    /// Room for [`GHOSTS_MAX`], on the heap: inline it would make the stack frame of the task that
    /// drives the line nine pages large, at each wake-up.
    slots: Vec<Option<Ghost>>,
    /// The number of ghosts: zero on a good line, which then spends no time here.
    count: usize,
    /// Until when modules may still answer what a fence has ended: the next user of the port can't
    /// rely on the order of replies.
    ended: Option<Instant>,
    /// Whether ghosts are kept at all.
    kept: bool,
}

impl Ghosts {
    pub(crate) fn new(kept: bool) -> Ghosts {
        Ghosts {
            slots: vec![None; GHOSTS_MAX],
            count: 0,
            ended: None,
            kept,
        }
    }

    /// Adds one. There is always room, since nothing is sent when there is none.
    pub(crate) fn add(&mut self, ghost: Ghost) {
        if let Some(slot) = self.slots.iter_mut().find(|slot| slot.is_none())
            && self.kept
        {
            *slot = Some(ghost);
            self.count += 1;
        }
    }

    pub(crate) fn clear(&mut self) {
        self.slots.fill(None);
        self.count = 0;
        self.ended = None;
    }

    pub(crate) fn expire(&mut self, now: Instant) {
        self.retain(|ghost| ghost.until > now);
        if self.ended.is_some_and(|late| late <= now) {
            self.ended = None;
        }
    }

    /// A module answered a request of this moment. Its earlier requests are answered or lost.
    /// Requests to other modules are lost too if their time to answer was over by then, unless
    /// their reply is held back on its way: this is assumed only for ghosts that would block all
    /// others, and when there is little room left.
    #[inline]
    pub(crate) fn end_before(&mut self, module: ModuleId, asked: Instant) {
        if !self.is_empty() {
            self.end_some_before(module, asked);
        }
    }

    #[cold]
    fn end_some_before(&mut self, module: ModuleId, asked: Instant) {
        let is_crowded = self.is_crowded();
        let mut ended = self.ended;
        self.retain(|ghost| {
            let is_own = ghost.module == Some(module) && ghost.sent <= asked;
            let is_common = is_crowded || ghost.is_common();
            let is_over = is_own || is_common && ghost.late <= asked;
            let goes = is_over && !ghost.answered;
            if goes {
                ended = ended.max(Some(ghost.late_reply_until()));
            }
            !goes
        });
        self.ended = ended;
    }

    /// Whether a reply of another module can end this one.
    pub(crate) fn ends_by_others(&self, ghost: &Ghost) -> bool {
        ghost.is_common() || self.is_crowded()
    }

    /// Whether there is none.
    #[inline]
    pub(crate) const fn is_empty(&self) -> bool {
        self.count == 0
    }

    const fn is_crowded(&self) -> bool {
        self.count > GHOSTS_MAX / 2
    }

    /// Reassigns ghosts of removed modules to the modules that `successor` gives.
    pub(crate) fn reassign(&mut self, successor: impl Fn(&Ghost) -> Option<ModuleId>) {
        for ghost in self.slots.iter_mut().flatten() {
            ghost.module = successor(ghost).or(ghost.module);
        }
    }

    /// A module answered a request of this moment; only its own earlier fences are over.
    pub(crate) fn end_fences_before(&mut self, module: ModuleId, asked: Instant) {
        self.retain(|ghost| {
            let is_own = ghost.module == Some(module) && ghost.sent <= asked;
            ghost.answered || !ghost.fence || !is_own
        });
    }

    fn retain(&mut self, mut stays: impl FnMut(&Ghost) -> bool) {
        if self.count == 0 {
            return;
        }
        for slot in &mut self.slots {
            if slot.take_if(|ghost| !stays(ghost)).is_some() {
                self.count -= 1;
            }
        }
    }

    fn iter(&self) -> impl Iterator<Item = &Ghost> {
        self.slots.iter().flatten()
    }

    /// Until when this exchange must not be sent: the end of the last ghost it could be confused
    /// with, or of the first one if there is no room for more.
    pub(crate) fn blocked_until(&self, exchange: &Exchange<'_>) -> Option<Instant> {
        if self.count == 0 {
            return None;
        }
        let confusable = self.iter().filter(|ghost| ghost.is_confusable(exchange));
        confusable.map(|ghost| ghost.until).max().max(self.room())
    }

    /// The same, but waits only for what modules may still answer, not for replies held back on
    /// their way.
    pub(crate) fn late_until(&self, exchange: &Exchange<'_>, now: Instant) -> Option<Instant> {
        let late = self.iter().filter(|ghost| ghost.late > now);
        let confusable = late.filter(|ghost| ghost.is_confusable(exchange));
        confusable.map(|ghost| ghost.late).max().max(self.room())
    }

    /// The same for a fence, which may be repeated while it is a ghost.
    pub(crate) fn fence_blocked_until(&self, exchange: &Exchange<'_>) -> Option<Instant> {
        let answered = self.iter().filter(|ghost| ghost.answered);
        let confusable = answered.filter(|ghost| ghost.is_confusable(exchange));
        confusable.map(|ghost| ghost.until).max().max(self.room())
    }

    /// Whether there is no room for one more.
    pub(crate) const fn are_full(&self) -> bool {
        self.count == GHOSTS_MAX
    }

    /// When there will be room for one more, if there is none now.
    fn room(&self) -> Option<Instant> {
        let full = self.count == GHOSTS_MAX;
        self.iter().map(|ghost| ghost.until).min().filter(|_| full)
    }

    /// The last unanswered request that this exchange could be confused with.
    pub(crate) fn in_the_way(&self, exchange: &Exchange<'_>) -> Option<&Ghost> {
        let given_up = self.iter().filter(|ghost| !ghost.answered);
        let confusable = given_up.filter(|ghost| ghost.is_confusable(exchange));
        confusable.max_by_key(|ghost| ghost.sent)
    }

    /// The first unanswered request whose reply could be taken for a good reply to this fence.
    pub(crate) fn first_like(&self, fence: &Exchange<'_>) -> Option<&Ghost> {
        if self.count == 0 {
            return None;
        }
        let given_up = self.iter().filter(|ghost| !ghost.answered);
        let alike = given_up.filter(|ghost| !fence.stands_apart(&ghost.exchange));
        alike.min_by_key(|ghost| ghost.sent)
    }

    /// Removes and returns that one.
    pub(crate) fn take_first_like(&mut self, fence: &Exchange<'_>) -> Option<Ghost> {
        let first = *self.first_like(fence)?;
        let is_it = |ghost: &mut Ghost| {
            !ghost.answered && ghost.sent == first.sent && ghost.exchange == first.exchange
        };
        let taken = self.slots.iter_mut().find_map(|slot| slot.take_if(is_it));
        self.count -= usize::from(taken.is_some());
        taken
    }

    /// When the next ghost can no longer be answered by its module.
    pub(crate) fn next_late(&self, now: Instant) -> Option<Instant> {
        let late = self.iter().filter(|ghost| ghost.late > now);
        late.map(|ghost| ghost.late).min()
    }

    /// Until when a module may still reply to a request that was given up.
    pub(crate) fn late_replies_until(&self) -> Option<Instant> {
        let given_up = self.iter().filter(|ghost| !ghost.answered);
        given_up.map(Ghost::late_reply_until).max().max(self.ended)
    }

    /// Whether the reply found at this place shares bytes with a reply that is, or may become, a
    /// ghost's: LC-02 data may contain what an ASCII module says, and where a late reply runs into
    /// another one, the checksum of both may match.
    #[inline]
    pub(crate) fn overlaps(&self, bytes: &[u8], reply: Range<usize>) -> bool {
        !self.is_empty() && self.any_overlaps(bytes, reply)
    }

    #[cold]
    fn any_overlaps(&self, bytes: &[u8], reply: Range<usize>) -> bool {
        self.iter()
            .any(|ghost| match ghost.exchange.find_response(bytes) {
                (at, Decoded::Whole { len, .. }) => {
                    at != reply.start && at < reply.end && reply.start < at + len
                }
                // Fewer bytes than a head can't be told apart.
                (at, Decoded::Partial { .. }) => {
                    at < reply.start || at > reply.start && at + HEAD < reply.end
                }
                (_, Decoded::Malformed(_)) => false,
            })
    }

    /// Removes the ghost whose reply is in these bytes.
    pub(crate) fn take_reply(&mut self, bytes: &[u8]) -> Option<GhostReply> {
        if self.count == 0 {
            return None;
        }
        let reply_of = |ghost: &Ghost| match ghost.exchange.find_response(bytes) {
            (at, Decoded::Whole { len, value }) => Some((at, len, value)),
            (_, Decoded::Partial { .. } | Decoded::Malformed(_)) => None,
        };
        let (mut first, mut unnamed): (Option<(usize, Instant, usize, usize)>, _) = (None, None);
        for (index, ghost) in self.slots.iter().enumerate() {
            let Some(ghost) = ghost else { continue };
            let Some((at, len, reply)) = reply_of(ghost) else {
                continue;
            };
            // A reply that names no module may be a duplicate of any module's.
            if !ghost.answered && !names(&reply) {
                unnamed = Some((at, len));
            } else if first.is_none_or(|(_, sent, ..)| ghost.sent < sent) {
                first = Some((index, ghost.sent, at, len));
            }
        }
        let Some((index, _, at, len)) = first else {
            return unnamed.map(|(at, len)| GhostReply {
                ghost: None,
                at,
                len,
            });
        };
        let ghost = self.slots.get_mut(index).and_then(Option::take);
        self.count -= usize::from(ghost.is_some());
        Some(GhostReply { ghost, at, len })
    }
}

/// Whether a reply names the module that it is from.
pub(crate) const fn names(reply: &Reply<Response<'_>>) -> bool {
    reply.from.is_some()
}

/// A late reply.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GhostReply {
    /// The ghost it belongs to, which is removed; none if the reply names no module, so that it may
    /// be anyone's.
    pub(crate) ghost: Option<Ghost>,
    /// Its offset.
    pub(crate) at: usize,
    /// Its length.
    pub(crate) len: usize,
}

#[cfg(test)]
mod tests {
    use super::{GHOSTS_MAX, Ghost, Ghosts};
    use crate::ModuleId;
    use railbus_wire::{Address, Exchange, Instant, rtu};

    fn read(address: u8) -> Exchange<'static> {
        let span = rtu::BitSpan::new(0, 8).unwrap();
        Exchange::rtu(Address(address), rtu::Request::ReadCoils(span))
    }

    /// When all slots are taken nothing is sent until the first ghost is gone, by its timeout or by
    /// its late reply.
    #[test]
    fn a_line_full_of_ghosts_waits_for_the_first_to_go() {
        for late in [false, true] {
            let mut ghosts = Ghosts::new(true);
            for nth in 0..GHOSTS_MAX {
                let at = Instant(nth as u64);
                assert_eq!(ghosts.blocked_until(&read(200)), None, "{nth} of them");
                ghosts.add(Ghost {
                    exchange: read(nth as u8 + 1),
                    module: Some(ModuleId(nth)),
                    sent: at,
                    late: Instant(1000 + at.0),
                    until: Instant(5000 + at.0),
                    answered: false,
                    fence: false,
                });
            }
            assert_eq!(ghosts.blocked_until(&read(200)), Some(Instant(5000)));
            if late {
                // The first one's reply, with its CRC.
                let reply = [0x01, 0x01, 0x01, 0x00, 0x51, 0x88];
                let met = ghosts.take_reply(&reply).unwrap();
                assert_eq!(met.ghost.unwrap().module, Some(ModuleId(0)));
            } else {
                ghosts.expire(Instant(5000));
            }
            assert_eq!(ghosts.blocked_until(&read(200)), None, "late: {late}");
            assert_eq!(ghosts.blocked_until(&read(2)), Some(Instant(5001)));
        }
    }
}
