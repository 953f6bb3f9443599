//! What a module says that it is, and what that means for its being heard and for the commands
//! to it (docs/decisions/0031).

use crate::command::{Stage, end_commands};
use crate::in_flight::InFlight;
use crate::module_state::{LATE_MIN, ModuleState};
use crate::{Bus, Confirmed, Event, Evidence, ModuleId};
use railbus_device::{Observation, Op};
use railbus_wire::Instant;

/// How often a module is asked for its model, each time it is heard anew, if it does not answer.
const TRIES: u8 = 4;
/// How many of these have to fail before its values are told and commands are sent to it.
const TRIES_FIRST: u8 = 2;

/// What a module is, as far as it has said.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Identity {
    /// It can say it, and is to be asked.
    can: bool,
    /// So often it is still to be asked, where it does not answer.
    tries: u8,
    /// Not before this moment.
    at: Instant,
    /// It has said that it is what it should be since it was heard anew: so it can, and is asked
    /// again after a miss.
    named: bool,
    claim: Claim,
}

/// The other model that a module says that it is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Claim {
    /// None.
    No,
    /// This one stood in its place before it was silent.
    Past(Observation),
    /// Said once: without a checksum the reply may have been spoilt.
    Once(Observation),
    /// Said again in the same words: another model stands in its place.
    Confirmed(Observation),
}

/// What came of asking a module what it is.
#[derive(Clone, Copy, Debug)]
pub(crate) enum IdentityReply {
    /// What it should be.
    Itself,
    /// Another model.
    Other(Observation),
    /// That it does not say it.
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

    /// The module is heard anew, or was changed: it is asked again from the beginning. Another
    /// model that was there before needs to say it once only, and all questions have to be in vain
    /// until it counts as gone.
    pub(crate) const fn invalidate(&mut self) {
        self.claim = match self.claim {
            Claim::Confirmed(other) | Claim::Past(other) => Claim::Past(other),
            Claim::No | Claim::Once(_) => Claim::No,
        };
        self.tries = if self.can { TRIES } else { 0 };
        self.at = Instant(0);
        self.named = false;
    }

    /// An exchange failed: the module may just be being replaced.
    pub(crate) const fn suspect(&mut self) {
        if self.named && self.tries == 0 {
            self.tries = 1;
        }
    }

    /// Whether it may be asked, where nothing waits for that.
    #[inline]
    pub(crate) fn is_suspected(&self, now: Instant) -> bool {
        self.tries > 0 && self.claim == Claim::No && self.at <= now
    }

    /// Whether it has answered the question, and so is able to.
    pub(crate) const fn has_answered(&self) -> bool {
        self.named || self.claims_other_model()
    }

    /// Whether it is to be asked.
    #[inline]
    pub(crate) const fn is_to_be_asked(&self) -> bool {
        self.tries > 0
    }

    /// From when on.
    pub(crate) const fn at(&self) -> Instant {
        self.at
    }

    /// Whether it is to be asked before anything else is done with the module: it was not yet, or
    /// may be another model and does not count as one.
    pub(crate) const fn comes_first(&self) -> bool {
        match self.claim {
            Claim::No => self.tries > TRIES - TRIES_FIRST,
            Claim::Past(_) | Claim::Once(_) => true,
            Claim::Confirmed(_) => false,
        }
    }

    /// Whether another model is known to stand in its place.
    pub(crate) const fn is_other_model(&self) -> bool {
        matches!(self.claim, Claim::Confirmed(_))
    }

    /// Whether what answers there has said that it is another model.
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
                // Whether it was spoilt is known at once.
                if !matches!(before, Claim::Once(_)) {
                    self.at = now;
                }
                self.claim(Claim::Once(other));
            }
            // A question may come spoilt as well, and is refused then.
            (IdentityReply::Refusal, _) => self.lost(now),
        }
    }

    const fn claim(&mut self, claim: Claim) {
        self.named = false;
        self.tries = TRIES;
        self.claim = claim;
    }

    /// It did not answer what was sent then.
    pub(crate) const fn lost(&mut self, sent: Instant) {
        self.attempt_failed();
        // At once, but for what may still come: everything else waits for it.
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

    /// A question failed. A module that has said that it is another model is asked until it says so
    /// again; any other one counts after the last question as what it should be. One that has named
    /// itself starts again as if it were heard anew.
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

    /// Nothing that it says contradicts what it should be.
    pub(crate) const fn settle(&mut self) {
        self.tries = 0;
        self.claim = Claim::No;
    }
}

impl Bus {
    /// Tells how a module is heard, where that is news.
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
        // Who waits for just that need not have it read once more.
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            let waits = command.module == module && command.stage == Stage::Queued;
            let is_it = command.op == reading.op && command.submitted <= reading.asked;
            (waits && is_it).then_some(Ok(Confirmed::Reply))
        });
    }

    /// A module said what it is. What was on its way to another one ends.
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
                // Who asks just that has his answer.
                Op::Identify => {
                    (is_settled && command.stage == Stage::Queued).then_some(Ok(Confirmed::Reply))
                }
                _ => is_other_model.then(|| command.end_by_other_model()),
            }
        });
    }

    /// A module did not say what it is. A command that asks for it ends with the last question.
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

    /// A greeting must not be put on this line.
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
