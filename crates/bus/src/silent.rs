//! Silent modules: what they are asked, and how little of the time that may take
//! (docs/decisions/0004).

use crate::command::{Stage, end_commands};
use crate::in_flight::{InFlight, Job};
use crate::module_state::ModuleState;
use crate::schedule::Search;
use crate::{Bus, Event, Evidence, ModuleId, State};
use railbus_wire::{Instant, Malformed, Micros};

/// All silent modules together get one part in this many of the time.
const SILENT_SHARE: u64 = 20;
/// A check of a silent module that is due gives way to others for so long.
const CHECK_PATIENCE: Micros = Micros::from_millis(200);
/// Reads that callers ask of silent modules together get one part in this many of the time besides:
/// a caller that asks again and again must not cost the others more than their checks do.
const ASKED_SHARE: u64 = 40;
/// So much of that time may be used at once: who asks for the first time gets an answer soon.
const ASKED_AT_ONCE: Micros = Micros::from_secs(2);

impl Bus {
    /// The same if others have left a check no room since it was due. That a module answers again
    /// is noticed in time however many commands wait, and on a line that can't read all as often as
    /// it should.
    pub(crate) fn search_overdue_silent(&self, search: &mut Search) -> bool {
        let is_overdue = self.probe_silent_at + CHECK_PATIENCE <= self.now;
        let is_found = is_overdue && self.search_silent(search);
        let mut commands = self.commands.iter();
        if is_found && commands.any(|command| !self.is_silent(command.module)) {
            let module = search.module().and_then(|id| self.modules.get(id.0));
            search.cut_short(module.map_or(Micros::ZERO, ModuleState::probe_least));
        }
        is_found
    }

    /// The next silent module, if their share of the time allows it.
    pub(crate) fn search_silent(&self, search: &mut Search) -> bool {
        if !self.modules.iter().any(ModuleState::is_silent) {
            return false;
        }
        let count = self.modules.len();
        let turns = (self.next_silent..count).chain(0..self.next_silent.min(count));
        for index in turns {
            let Some(state) = self.modules.get(index) else {
                continue;
            };
            if !state.plan.enabled || !state.is_silent() {
                continue;
            }
            if self.probe_silent_at > self.now {
                search.look_again(self.probe_silent_at);
                return false;
            }
            let module = ModuleId(index);
            let work = state.probe_op().and_then(|op| {
                let exchange = state.module.exchange(&op).ok()?;
                let timeout = state.probe_timeout(&exchange);
                self.work(module, Job::Poll { module, op }, timeout)
            });
            if let Some(work) = work
                && self.offer(search, work)
            {
                return true;
            }
            // Its read has to wait for its ghost; a fence need not.
            let fence = self.fence_of(module, None).and_then(|job| {
                let exchange = state.module.exchange(&job.op()).ok()?;
                self.work(module, job, state.probe_timeout(&exchange))
            });
            if let Some(work) = fence
                && self.offer(search, work)
            {
                return true;
            }
        }
        false
    }

    /// A silent module did not answer: the others have the line to themselves for a while.
    fn throttle_silent(&mut self, asked: Instant, gap: Micros) {
        let cost = self.now.since(asked) + gap;
        self.probe_silent_at = asked + cost * SILENT_SHARE;
    }

    /// How long a caller's read of a silent module has to wait.
    pub(crate) fn asked_wait(&self) -> Micros {
        self.asked_paid_until.since(self.now) - ASKED_AT_ONCE * ASKED_SHARE
    }

    /// A silent module did not answer what it was asked for a caller.
    fn throttle_asked(&mut self, asked: Instant, gap: Micros) {
        let cost = self.now.since(asked) + gap;
        self.asked_paid_until = self.asked_paid_until.max(asked) + cost * ASKED_SHARE;
    }

    /// No good reply came in time.
    pub(crate) fn missed(&mut self, flight: InFlight) {
        self.state = State::Idle;
        if self.rx.missed(self.now, self.busy_until) {
            self.events.push(Event::Babble);
        }
        // What was received may be the reply to an older request.
        let late = self.ghosts.take_reply(self.rx.heard());
        let why = match late {
            Some(_) => None,
            None => self.rx.why(&flight.exchange),
        };
        self.add_ghost(&flight);
        if let Some(met) = late {
            self.on_late_reply(met);
        }
        let mut ends_reads = false;
        if let Some(module) = flight.job.module()
            && let Some(state) = self.modules.get_mut(module.0)
        {
            let was_silent = state.is_silent();
            let gap = state.module.setup().request_gap();
            // A module without a fence, or one that does not report its model, is not counted as
            // silent for that.
            let has_none = match flight.job {
                Job::Fence { .. } => state.missed_fence(),
                job => job.identifies() && state.may_be_mute(),
            };
            if flight.is_fence() && state.identifies(&flight.exchange) {
                state.not_identified(flight.sent);
            }
            if flight.is_fence() && !has_none {
                // The next check is as far off as after a poll.
                state.put_off(flight.asked + state.plan.interval);
            }
            if !has_none {
                state.missed();
            }
            self.publish_presence(module);
            let is_in_turn = self.probe_silent_at <= flight.asked;
            let is_for_a_caller = match flight.job {
                Job::Command { op, .. } => op.is_read(),
                Job::Fence { .. } => !is_in_turn,
                _ => false,
            };
            if was_silent && is_for_a_caller {
                self.throttle_asked(flight.asked, gap);
            }
            if was_silent && flight.job.is_status_check() {
                self.throttle_silent(flight.asked, gap);
            }
            ends_reads = was_silent && !has_none;
        }
        self.fail(&flight, 0, why);
        if ends_reads {
            self.end_reads(&flight, why);
        }
        self.end_if_left(&flight);
    }

    /// A silent module did not answer: what callers had asked of it before this request was sent
    /// ends with it.
    fn end_reads(&mut self, flight: &InFlight, why: Option<Malformed>) {
        let bytes = u16::try_from(self.rx.heard().len()).unwrap_or(u16::MAX);
        let evidence = Evidence::of_try(bytes, why);
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            let is_waiting = flight.job.module() == Some(command.module)
                && command.stage == Stage::Queued
                && command.op.is_read()
                && command.submitted <= flight.asked;
            is_waiting.then(|| {
                command.evidence.attempts = command.evidence.attempts.saturating_add(1);
                command.evidence.add(evidence);
                Err(command.lost())
            })
        });
    }
}
