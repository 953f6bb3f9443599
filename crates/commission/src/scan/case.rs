//! One module under inspection: it has answered, and is sent requests until it is identified.

use super::ask::{PATIENCE, ProbeKind, ScanProbe};
use super::identify::{Answer, follow_up, is_certain};
use super::{FoundModule, ProbeOutcome};
use railbus_bus::Probed;
use railbus_wire::{Instant, Micros};

/// How often a module with garbled replies is tried.
const TRIES: usize = 3;
/// Minimum timeout for a module that is there.
const PATIENCE_MIN: Micros = Micros::from_millis(30);
/// The line's pause before a similar request, after a reply and without one.
const AFTER_ANSWER: Micros = Micros::from_millis(100);
const AFTER_SILENCE: Micros = Micros::from_millis(500);

/// A module under inspection.
#[derive(Clone, Debug)]
pub(super) struct Case {
    /// The request by which it was found.
    pub(super) asked: ScanProbe,
    /// The next request.
    pub(super) next: ProbeKind,
    /// When that may be sent without waiting for the line.
    pub(super) ready_at: Instant,
    /// Earlier requests to modules whose late replies may have disturbed its own.
    pub(super) suspects: Vec<ScanProbe>,
    answers: Vec<Answer>,
    garbled: Vec<Vec<u8>>,
    /// How often the first request was not answered.
    vain: usize,
    /// Requests without a reply, and since when: each counts only when it is confirmed.
    unsure: Vec<(ProbeKind, Instant)>,
    /// The current request was not answered before.
    asks_again: bool,
    rtt: Micros,
}

/// The state of a case.
#[derive(Clone, Debug)]
pub(super) enum Turn {
    /// More requests are needed.
    Open(Case),
    /// The module is identified.
    Found(FoundModule, Vec<ScanProbe>),
    /// There is no module. The reply was another one's.
    Nobody(Vec<ScanProbe>),
}

impl Case {
    /// A module answered for the first time, validly or not.
    pub(super) fn open(
        now: Instant,
        asked: ScanProbe,
        met: ProbeOutcome,
        suspects: impl Iterator<Item = ScanProbe>,
    ) -> Turn {
        let mut case = Case {
            asked,
            next: asked.ask,
            ready_at: now,
            suspects: Vec::new(),
            answers: Vec::new(),
            garbled: Vec::new(),
            vain: 0,
            unsure: Vec::new(),
            asks_again: false,
            rtt: met.after,
        };
        if met.outcome == Probed::Garbled {
            case.suspects = suspects.collect();
        }
        case.met(now, met)
    }

    /// The next request.
    pub(super) fn question(&self) -> ScanProbe {
        self.asked.with(self.next)
    }

    /// Its timeout: somewhat more than the module took before.
    pub(super) fn patience(&self) -> Micros {
        let known = self.rtt * 2 + Micros::from_millis(8);
        match self.answers.is_empty() {
            true => PATIENCE,
            false => known.max(PATIENCE_MIN).min(PATIENCE),
        }
    }

    /// Continues with its response.
    pub(super) fn met(mut self, now: Instant, met: ProbeOutcome) -> Turn {
        match met.outcome {
            Probed::Unsafe => self.unasked(),
            Probed::Answered => {
                if self.answers.is_empty() {
                    self.rtt = met.after;
                }
                self.note(met.bytes);
                self.go_on(now, AFTER_ANSWER)
            }
            Probed::Garbled | Probed::Silent if self.answers.is_empty() => self.vainly(now, met),
            Probed::Garbled | Probed::Silent => {
                if !self.asks_again {
                    self.unsure.push((self.next, now));
                    self.note(Vec::new());
                }
                self.go_on(now, AFTER_SILENCE)
            }
        }
    }

    /// The first request was not answered.
    fn vainly(mut self, now: Instant, met: ProbeOutcome) -> Turn {
        if met.outcome == Probed::Garbled {
            self.garbled.push(met.bytes);
        }
        self.vain += 1;
        if self.vain < TRIES {
            self.ready_at = now + AFTER_SILENCE;
            return Turn::Open(self);
        }
        match self.garbled.len() {
            0 | 1 => Turn::Nobody(self.with_itself()),
            _ => self.found(),
        }
    }

    /// Records the result of the current request, replacing an earlier silence.
    fn note(&mut self, bytes: Vec<u8>) {
        let next = self.next;
        match self.answers.iter_mut().find(|(ask, _)| *ask == next) {
            Some((_, before)) => *before = bytes,
            None => self.answers.push((next, bytes)),
        }
    }

    /// Its next request must not be sent: what is known has to do.
    pub(super) fn unasked(self) -> Turn {
        match self.answers.is_empty() {
            true => Turn::Nobody(Vec::new()),
            false => self.found(),
        }
    }

    /// Chooses the next request, or comes to a verdict.
    fn go_on(mut self, now: Instant, pause: Micros) -> Turn {
        let Some(next) = follow_up(self.asked, &self.answers) else {
            return self.make_sure();
        };
        let before = self.question().exchange();
        let after = self.asked.with(next).exchange();
        let confusable = before.zip(after).is_some_and(|(a, b)| a.confusable(&b));
        self.ready_at = if confusable { now + pause } else { now };
        self.next = next;
        self.asks_again = false;
        Turn::Open(self)
    }

    /// Repeats requests that were not answered; if there are none, the module is identified.
    fn make_sure(mut self) -> Turn {
        while let Some((ask, since)) = self.unsure.pop() {
            if !is_certain(self.asked, &self.answers, ask) {
                self.next = ask;
                self.asks_again = true;
                self.ready_at = since + AFTER_SILENCE;
                return Turn::Open(self);
            }
        }
        self.found()
    }

    fn found(self) -> Turn {
        let found = FoundModule::of(self.asked, self.answers, self.garbled, self.rtt);
        // Garbled every time is not caused by another module.
        let suspects = match found.answers.is_empty() {
            true => Vec::new(),
            false => self.suspects,
        };
        Turn::Found(found, suspects)
    }

    fn with_itself(mut self) -> Vec<ScanProbe> {
        self.suspects.push(self.asked);
        self.suspects
    }
}
