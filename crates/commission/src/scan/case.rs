//! One module under inspection: it was heard, and is asked on until it is known what it is.

use super::ask::{Ask, PATIENCE, Question};
use super::identify::{Answer, follow_up, is_certain};
use super::{Found, Met};
use railbus_bus::Probed;
use railbus_wire::{Instant, Micros};

/// How often a module is asked whose reply is garbled.
const TRIES: usize = 3;
/// A module that is there is waited for no shorter than this.
const PATIENCE_MIN: Micros = Micros::from_millis(30);
/// As long as the line waits before it asks the like again, after an answer and without one.
const AFTER_ANSWER: Micros = Micros::from_millis(100);
const AFTER_SILENCE: Micros = Micros::from_millis(500);

/// A module under inspection.
#[derive(Clone, Debug)]
pub(super) struct Case {
    /// The question by which it was heard.
    pub(super) asked: Question,
    /// What it is asked next.
    pub(super) next: Ask,
    /// When that may be asked without waiting for the line.
    pub(super) ready_at: Instant,
    /// The questions before its own that whoever disturbed it may have been asked.
    pub(super) suspects: Vec<Question>,
    answers: Vec<Answer>,
    garbled: Vec<Vec<u8>>,
    /// How often the first question was asked in vain.
    vain: usize,
    /// Silent answers, and since when: each counts only when it is silent again.
    unsure: Vec<(Ask, Instant)>,
    /// The present question was met by silence before.
    asks_again: bool,
    rtt: Micros,
}

/// What became of a case.
#[derive(Clone, Debug)]
pub(super) enum Turn {
    /// It is to be asked on.
    Open(Case),
    /// It is known what it is.
    Found(Found, Vec<Question>),
    /// Nobody is there. Somebody else was heard.
    Nobody(Vec<Question>),
}

impl Case {
    /// A module was heard for the first time: well, or not.
    pub(super) fn open(
        now: Instant,
        asked: Question,
        met: Met,
        suspects: impl Iterator<Item = Question>,
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

    /// What it is asked next.
    pub(super) fn question(&self) -> Question {
        self.asked.with(self.next)
    }

    /// How long it is waited for: some time more than it took before.
    pub(super) fn patience(&self) -> Micros {
        let known = self.rtt * 2 + Micros::from_millis(8);
        match self.answers.is_empty() {
            true => PATIENCE,
            false => known.max(PATIENCE_MIN).min(PATIENCE),
        }
    }

    /// Goes on with what it answered.
    pub(super) fn met(mut self, now: Instant, met: Met) -> Turn {
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

    /// The first question was asked in vain.
    fn vainly(mut self, now: Instant, met: Met) -> Turn {
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

    /// Notes the answer to the present question, in the place of silence where that came first.
    fn note(&mut self, bytes: Vec<u8>) {
        let next = self.next;
        match self.answers.iter_mut().find(|(ask, _)| *ask == next) {
            Some((_, before)) => *before = bytes,
            None => self.answers.push((next, bytes)),
        }
    }

    /// Its next question must not be asked: what is known has to do.
    pub(super) fn unasked(self) -> Turn {
        match self.answers.is_empty() {
            true => Turn::Nobody(Vec::new()),
            false => self.found(),
        }
    }

    /// Chooses the next question, or comes to a verdict.
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

    /// Asks once more what was met by silence; where nothing was, it is known what this is.
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
        let found = Found::of(self.asked, self.answers, self.garbled, self.rtt);
        // Garbled every time is nobody else's fault.
        let suspects = match found.answers.is_empty() {
            true => Vec::new(),
            false => self.suspects,
        };
        Turn::Found(found, suspects)
    }

    fn with_itself(mut self) -> Vec<Question> {
        self.suspects.push(self.asked);
        self.suspects
    }
}
