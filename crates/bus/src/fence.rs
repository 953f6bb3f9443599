//! The fence after a miss: a request whose reply shows that no older reply can come
//! (docs/decisions/0015).
//!
//! A module answers in the order in which it was asked, and neither a line nor a network lets one
//! reply overtake another. So after an unanswered request the module is sent one whose reply can't
//! be taken for the missing reply: once it has answered that, the missing reply has come or never
//! will.

use crate::ghost::{Ghost, names};
use crate::in_flight::{InFlight, Job, Probe};
use crate::module_state::{HELD_BACK_MAX, LATE_MIN, ModuleState};
use crate::{Bus, Event, ModuleId, Presence, Probed};
use railbus_device::Op;
use railbus_wire::{Exchange, Instant, Micros, Reply, Response, ascii};

impl Bus {
    /// What to ask so that this exchange need not wait until all ghosts time out; otherwise when to
    /// look again.
    pub(crate) fn fence_for(
        &self,
        wanted: ModuleId,
        exchange: &Exchange<'_>,
    ) -> Result<Job, Option<Instant>> {
        let ghost = self.ghosts.in_the_way(exchange).ok_or(None)?;
        // A module that does not answer what it is asked on coming online may not answer a fence
        // either: wait for its reply.
        let asked = ghost.module.and_then(|id| self.modules.get(id.0));
        let is_short = ghost.until <= ghost.late;
        if is_short && asked.is_some_and(|state| state.may_be_mute_to(&ghost.exchange)) {
            return Err(Some(ghost.until));
        }
        let is_up = |id: &ModuleId| {
            let state = self.modules.get(id.0);
            state.is_some_and(|state| !state.retired && !state.is_silent())
        };
        // A module that has never answered may be dead.
        let is_heard = |id: &ModuleId| {
            let state = self.modules.get(id.0);
            state.is_some_and(|state| state.presence != Presence::Unheard)
        };
        let by_others = ghost.late <= self.now && self.ghosts.ends_by_others(ghost);
        let owner = ghost.module.filter(is_up);
        let asked = match owner.filter(|id| is_heard(id) || !by_others) {
            Some(owner) => owner,
            // A module that does not answer is given its time; after that, a reply of any other
            // module shows that nothing is held back on its way.
            None if ghost.late > self.now => return Err(Some(ghost.late)),
            None if !self.ghosts.ends_by_others(ghost) => return Err(None),
            None => Some(wanted).filter(is_up).ok_or(None)?,
        };
        let fence = self.fence_of(asked, Some(ghost));
        fence.ok_or_else(|| self.ghosts.next_late(self.now))
    }

    /// What to ask a module to get a reply that ends one of its ghosts. That reply may belong to
    /// the first ghost like it, and ends everything older. So of several candidates choose the one
    /// whose first ghost is the youngest, even if it is like this ghost and even if it has to wait:
    /// otherwise two kinds of reads would alternate for ever.
    pub(crate) fn fence_of(&self, module: ModuleId, ghost: Option<&Ghost>) -> Option<Job> {
        let state = self
            .modules
            .get(module.0)
            .filter(|state| state.has_fence())?;
        let mut best: Option<((Instant, bool), Job)> = None;
        // A ghost that is a fence ends as soon as a poll is answered.
        let by_polls = ghost.is_some_and(|ghost| ghost.fence && state.is_fence(&ghost.exchange));
        for op in state.fences(by_polls) {
            let Ok(exchange) = state.module.exchange(&op) else {
                continue;
            };
            let job = Job::Fence { module, op };
            let is_like = ghost.is_some_and(|ghost| !exchange.stands_apart(&ghost.exchange));
            if is_like && (by_polls || op == Op::Fence) || self.is_unsafe_for(&job, &exchange) {
                continue;
            }
            let (since, job) = match self.ghosts.first_like(&exchange) {
                Some(_) if by_polls => continue,
                // A ghost of another module, which may answer later than this one.
                Some(first) if first.module != Some(module) && first.late > self.now => continue,
                Some(first) => (first.sent, job),
                // Nothing it could be confused with: it counts as a normal read.
                None if op != Op::Fence => (Instant(u64::MAX), Job::Poll { module, op }),
                None => (Instant(u64::MAX), job),
            };
            let is_free = self.ghosts.fence_blocked_until(&exchange).is_none();
            let rank = (since, is_free);
            if best.is_none_or(|(known, _)| rank > known) {
                best = Some((rank, job));
            }
        }
        best.map(|(_, job)| job)
    }

    /// Whether a good reply certainly belongs to this request, and not to an earlier one that could
    /// be confused with it. With `in_order` it shows that older requests are done. It was received
    /// after `skip` bytes.
    pub(crate) fn is_own(&mut self, flight: &InFlight, in_order: bool, skip: usize) -> bool {
        let Some(module) = flight.job.module() else {
            return true;
        };
        if self.ghosts.is_empty() {
            self.note_fence(flight, module, in_order);
            return true;
        }
        self.expect_copies_before(skip);
        self.is_own_among_ghosts(flight, module, in_order)
    }

    /// Late replies came in one piece with this one, in front of it. This one ends their ghosts;
    /// but where replies may be duplicated, each may come a second time.
    #[cold]
    fn expect_copies_before(&mut self, skip: usize) {
        let mut before = self.rx.heard_before(skip);
        while self.rx.is_cautious() {
            let heard = self.rx.heard().get(..before).unwrap_or_default();
            let Some(met) = self.ghosts.take_reply(heard) else {
                break;
            };
            self.rx.cut_heard(met.at, met.len);
            before = before.saturating_sub(met.len);
            if let Some(ghost) = met.ghost {
                self.expect_copy(ghost);
            }
        }
    }

    #[cold]
    fn is_own_among_ghosts(&mut self, flight: &InFlight, module: ModuleId, in_order: bool) -> bool {
        // Another module, asked earlier, may answer later until its time is over.
        let like = self.ghosts.first_like(&flight.exchange);
        let ends_older = in_order
            && like.is_none_or(|like| like.module == Some(module) || like.late <= flight.asked);
        let first = match ends_older {
            true => self.ghosts.take_first_like(&flight.exchange),
            false => self.ghosts.first_like(&flight.exchange).copied(),
        };
        self.note_fence(flight, module, in_order);
        match (first, ends_older) {
            (None, true) => self.ghosts.end_before(module, flight.asked),
            // A reply that names no module is enough to end fences.
            (None, false) => self.ghosts.end_fences_before(module, flight.asked),
            // The reply to this request is still to come.
            (Some(first), true) => {
                self.ghosts.end_before(module, first.sent);
                self.add_ghost(flight);
            }
            (Some(_), false) => {}
        }
        first.is_none() || flight.is_fence()
    }

    /// Notes whether the module answered [`Op::Fence`].
    fn note_fence(&mut self, flight: &InFlight, module: ModuleId, in_order: bool) {
        if matches!(flight.job.op(), Op::Fence) {
            if flight.is_fence() && !in_order {
                self.refused_fence(flight, module);
            } else {
                self.answered_fence(module);
            }
        } else if let Some(state) = self.modules.get_mut(module.0) {
            state.answered_no_fence();
        }
    }

    /// The module of the line that a probe is taken to be for.
    pub(crate) fn addressee(&self, probe: &Probe) -> Option<ModuleId> {
        let is_it = |state: &ModuleState| {
            let setup = state.module.setup();
            !state.retired
                && setup.address == probe.exchange.address()
                && setup.protocol == probe.exchange.protocol()
                && setup.serial == probe.settings
        };
        let found = self.modules.iter().position(is_it);
        found.filter(|_| probe.as_module).map(ModuleId)
    }

    /// Ends a probe that would have to wait for the reply of a module that does not answer: for
    /// seconds, and all that come after it, too. The line asks such a module by itself.
    #[cold]
    pub(crate) fn end_held_probe(&mut self) {
        let Some(probe) = self.probe else {
            return;
        };
        let is_silent = self.addressee(&probe).is_some_and(|id| self.is_silent(id));
        if is_silent && self.ghosts.blocked_until(&probe.exchange).is_some() {
            self.probe = None;
            let (outcome, after) = (Probed::Silent, Micros::ZERO);
            self.events.push(Event::Probed { outcome, after });
        }
    }

    /// The request becomes a ghost: its reply may still come.
    pub(crate) fn add_ghost(&mut self, flight: &InFlight) {
        let module = flight.job.addressee();
        let state = module.and_then(|id| self.modules.get(id.0));
        let late = flight.sent + state.map_or(LATE_MIN, ModuleState::late_max);
        // If nothing can end it early, it must not block the line for long.
        let on_online = matches!(flight.job, Job::OnOnline { .. }) || flight.job.identifies();
        let ends_by_fence = |state: &ModuleState| match on_online {
            true => state.knows_fence(),
            false => state.relies_on_fence(),
        };
        let until = match state {
            Some(state) if ends_by_fence(state) => late.max(flight.sent + HELD_BACK_MAX),
            _ => late,
        };
        self.ghosts.add(Ghost {
            exchange: flight.exchange,
            module,
            sent: flight.sent,
            late,
            until,
            answered: false,
            fence: flight.is_fence() || state.is_some_and(|state| state.is_fence(&flight.exchange)),
        });
    }

    /// The module refused. If that may be the reply to an older request, the reply to this one may
    /// still come.
    #[cold]
    fn refused_fence(&mut self, flight: &InFlight, module: ModuleId) {
        if self.ghosts.in_the_way(&flight.exchange).is_some() {
            self.add_ghost(flight);
        }
        if let Some(state) = self.modules.get_mut(module.0) {
            state.refused_fence();
        }
    }

    /// Ghosts of a module that was removed go to the module now at its address.
    pub(crate) fn reassign_ghosts(&mut self) {
        let modules = &self.modules;
        self.ghosts.reassign(|ghost| {
            let owner = ghost.module.and_then(|id| modules.get(id.0));
            owner.filter(|state| state.retired)?;
            let exchange = &ghost.exchange;
            let successor = modules.iter().position(|state| {
                let setup = state.module.setup();
                !state.retired
                    && setup.protocol == exchange.protocol()
                    && setup.address == exchange.address()
            });
            successor.map(ModuleId)
        });
    }

    /// The module answers [`Op::Fence`].
    pub(crate) fn answered_fence(&mut self, module: ModuleId) {
        if let Some(state) = self.modules.get_mut(module.0) {
            state.answered_fence();
        }
    }
}

/// Whether a reply shows that older requests to the module are done. A reply that names no module
/// may be a repeated one of any module; a refusal that does not name its request may belong to an
/// older one.
pub(crate) fn shows_order(flight: &InFlight, reply: &Reply<Response<'_>>) -> bool {
    let refuses = matches!(
        reply.response,
        Response::Ascii(ascii::Response::Invalid | ascii::Response::Ignored)
    );
    names(reply) && !(flight.is_fence() && refuses)
}
