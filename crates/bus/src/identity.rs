//! The model a module reports, and what that means for its presence and for its commands
//! (docs/decisions/0031).

use crate::command::{Stage, end_commands};
use crate::in_flight::InFlight;
use crate::module_state::{LATE_MIN, ModuleState};
use crate::{Bus, Confirmation, Event, Evidence, ModuleId};
use railbus_device::{Observation, Op};
use railbus_wire::Instant;

/// How often a module is asked for its model each time it comes online, if it does not answer.
const TRIES: u8 = 4;
/// How many of these must fail before its values are published and commands are sent to it.
const TRIES_FIRST: u8 = 2;

/// What a module has said about its model.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Identity {
    /// It can report its model, and is to be asked.
    can: bool,
    /// How many attempts are left if it does not answer.
    tries: u8,
    /// Not to be asked before this moment.
    at: Instant,
    /// It has named the configured model since it came online: so it can, and is asked again after
    /// a miss.
    named: bool,
    claim: Claim,
}

/// The other model that a module reports.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Claim {
    /// None.
    No,
    /// This model was there before the module went silent.
    Past(Observation),
    /// Reported once: without a checksum the reply may have been corrupted.
    Once(Observation),
    /// Reported twice in the same words: another model is there.
    Confirmed(Observation),
}

/// The result of asking a module for its model.
#[derive(Clone, Copy, Debug)]
pub(crate) enum IdentityReply {
    /// The configured model.
    Itself,
    /// Another model.
    Other(Observation),
    /// A refusal.
    Refusal,
}

impl Identity {
    pub(crate) const fn new(can: bool) -> Identity {
        Identity {
            can,
            tries: if can { TRIES } else { 0 },
            at: Instant(0),
            named: false,
            claim: Claim::No,
        }
    }

    /// The module came online again, or may have changed: it is asked from the beginning. Another
    /// model known from before needs to report itself only once, and counts as gone only after all
    /// attempts have failed.
    pub(crate) const fn invalidate(&mut self) {
        self.claim = match self.claim {
            Claim::Confirmed(other) | Claim::Past(other) => Claim::Past(other),
            Claim::No | Claim::Once(_) => Claim::No,
        };
        self.tries = if self.can { TRIES } else { 0 };
        self.at = Instant(0);
        self.named = false;
    }

    /// An exchange failed: someone may be replacing the module right now.
    pub(crate) const fn suspect(&mut self) {
        if self.named && self.tries == 0 {
            self.tries = 1;
        }
    }

    /// Whether to ask it, when nothing waits for the answer.
    #[inline]
    pub(crate) fn is_suspected(&self, now: Instant) -> bool {
        self.tries > 0 && self.claim == Claim::No && self.at <= now
    }

    /// Whether it has answered the question, so that it can.
    pub(crate) const fn has_answered(&self) -> bool {
        self.named || self.claims_other_model()
    }

    /// Whether it is to be asked.
    #[inline]
    pub(crate) const fn is_to_be_asked(&self) -> bool {
        self.tries > 0
    }

    /// When to ask it.
    pub(crate) const fn at(&self) -> Instant {
        self.at
    }

    /// Whether it must be asked before anything else: it has not been asked yet, or it may be
    /// another model but does not count as one.
    pub(crate) const fn comes_first(&self) -> bool {
        match self.claim {
            Claim::No => self.tries > TRIES - TRIES_FIRST,
            Claim::Past(_) | Claim::Once(_) => true,
            Claim::Confirmed(_) => false,
        }
    }

    /// Whether another model is confirmed.
    pub(crate) const fn is_other_model(&self) -> bool {
        matches!(self.claim, Claim::Confirmed(_))
    }

    /// Whether it has reported another model at least once.
    pub(crate) const fn claims_other_model(&self) -> bool {
        matches!(self.claim, Claim::Once(_) | Claim::Confirmed(_))
    }

    /// It answered.
    pub(crate) fn said(&mut self, said: IdentityReply, now: Instant) {
        if !self.can {
            return;
        }
        self.at = now + LATE_MIN;
        match (said, self.claim) {
            (IdentityReply::Itself, _) => {
                self.named = true;
                self.settle();
            }
            (IdentityReply::Other(_), Claim::Confirmed(_)) => {}
            (IdentityReply::Other(other), Claim::Once(before) | Claim::Past(before))
                if other == before =>
            {
                self.claim(Claim::Confirmed(other));
            }
            (IdentityReply::Other(other), before) => {
                // Ask again at once to see whether the reply was corrupted.
                if !matches!(before, Claim::Once(_)) {
                    self.at = now;
                }
                self.claim(Claim::Once(other));
            }
            // The request may have been corrupted too, and is refused then.
            (IdentityReply::Refusal, _) => self.lost(now),
        }
    }

    const fn claim(&mut self, claim: Claim) {
        self.named = false;
        self.tries = TRIES;
        self.claim = claim;
    }

    /// It did not answer the request sent at this moment.
    pub(crate) const fn lost(&mut self, sent: Instant) {
        self.attempt_failed();
        // Ask again at once, except for late replies: everything else waits for the answer.
        self.at = match self.claim {
            Claim::No if self.comes_first() => sent,
            _ => Instant(sent.0 + LATE_MIN.0),
        };
    }

    /// Its reply came after the timeout and was dropped. The timeout is longer now, so it is asked
    /// again.
    pub(crate) const fn said_late(&mut self, now: Instant) {
        if self.can && matches!(self.claim, Claim::No) {
            self.tries = TRIES;
            self.at = now;
        }
    }

    /// An attempt failed. A module that has reported another model is asked until it does so again;
    /// any other counts as the configured model after the last attempt. One that had named itself
    /// starts again as if it had just come online.
    const fn attempt_failed(&mut self) {
        match (self.claim, self.tries) {
            (Claim::Once(_) | Claim::Confirmed(_), _) => {}
            (Claim::No, _) if self.named => {
                self.named = false;
                self.tries = TRIES;
            }
            (_, 0 | 1) => self.settle(),
            (_, tries) => self.tries = tries - 1,
        }
    }

    /// Nothing it reports contradicts the configured model.
    pub(crate) const fn settle(&mut self) {
        self.tries = 0;
        self.claim = Claim::No;
    }
}

impl Bus {
    /// Publishes a module's presence if it has changed.
    #[cold]
    pub(crate) fn publish_presence(&mut self, module: ModuleId) {
        let Some(state) = self.modules.get_mut(module.0) else {
            return;
        };
        if let Some(presence) = state.take_change() {
            self.events.push(Event::Presence { module, presence });
        }
        let Some(reading) = state.release_withheld(self.now) else {
            return;
        };
        self.events.push(Event::Seen {
            module,
            op: reading.op,
            seen: reading.seen,
            asked: reading.asked,
            heard: reading.heard,
        });
        // A queued command for just that reading ends with it.
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            let waits = command.module == module && command.stage == Stage::Queued;
            let is_it = command.op == reading.op && command.submitted <= reading.asked;
            (waits && is_it).then_some(Ok(Confirmation::Reply))
        });
    }

    /// A module reported its model. If it is another one, commands for the module end.
    #[cold]
    pub(crate) fn identified(&mut self, module: ModuleId, seen: &Observation) {
        let now = self.now;
        if let Some(state) = self.modules.get_mut(module.0) {
            state.identified(seen, now);
        }
        self.publish_presence(module);
        let state = self.modules.get(module.0);
        let is_other_model = state.is_some_and(ModuleState::is_other_model);
        let is_settled = state.is_some_and(ModuleState::is_settled);
        end_commands(&mut self.commands, &mut self.events, now, |command| {
            if command.module != module {
                return None;
            }
            match command.op {
                // A command for just that has its answer.
                Op::Identify => (is_settled && command.stage == Stage::Queued)
                    .then_some(Ok(Confirmation::Reply)),
                _ => is_other_model.then(|| command.end_by_other_model()),
            }
        });
    }

    /// A module did not report its model. A command that asks for it ends with the last attempt.
    #[cold]
    pub(crate) fn not_identified(&mut self, module: ModuleId, flight: &InFlight, met: Evidence) {
        let mut is_asked_again = false;
        if let Some(state) = self.modules.get_mut(module.0) {
            state.not_identified(flight.sent);
            is_asked_again = state.is_to_be_identified();
        }
        self.publish_presence(module);
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            let asks = command.module == module && command.op == Op::Identify;
            if !asks || command.stage != Stage::Queued {
                return None;
            }
            command.evidence.attempts = command.evidence.attempts.saturating_add(1);
            command.evidence.add(met);
            let is_last = !is_asked_again || command.evidence.attempts >= TRIES;
            is_last.then(|| Err(command.lost()))
        });
    }

    /// This on-online request must not be sent on this line.
    #[cold]
    pub(crate) fn skip_on_online(&mut self, module: ModuleId, op: &Op) {
        let Some(state) = self.modules.get_mut(module.0) else {
            return;
        };
        if *op == Op::Identify {
            state.skip_identity();
            self.publish_presence(module);
        } else {
            state.answered_pulses();
            self.publish_pulses(module);
        }
    }
}
