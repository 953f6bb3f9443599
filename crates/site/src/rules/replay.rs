//! Computes when a rule would have acted.

use super::engine::{Deadline, Fact, Moment, Output, RuleEngine};
use crate::config::Rule;
use jiff::tz::TimeZone;
use railbus_wire::Micros;

/// How many actions are listed; the rest is counted only.
pub const LISTED_MAX: usize = 500;

/// The result of running a rule over the history. All times are in milliseconds since 1970.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tried {
    /// The start.
    pub since: i64,
    /// The end.
    pub until: i64,
    /// When it would have acted: the first [`LISTED_MAX`] times.
    pub acts: Vec<i64>,
    /// How often it would have acted.
    pub count: usize,
    /// When it would have been stopped for acting too often.
    pub stopped: Option<i64>,
    /// For how long the condition was unknown, in milliseconds.
    pub unknown_ms: i64,
    /// There was more history than one run reads: it ends early.
    pub is_cut: bool,
}

/// A rule that is run over the past. It is given the facts in order of time.
#[derive(Debug)]
pub struct Replay {
    engine: RuleEngine,
    now: i64,
    is_known: bool,
    tried: Tried,
}

impl Replay {
    /// A run from one moment to another, both in milliseconds since 1970. Earlier facts set the
    /// initial state, but actions before the start are not listed.
    #[must_use]
    pub fn new(rule: &Rule, zone: TimeZone, since: i64, until: i64) -> Replay {
        let is_clock = rule.when.is_clock();
        Replay {
            engine: RuleEngine::new(rule, zone),
            // A clock rule has no earlier state, and facts about a point may be of any time before.
            now: if is_clock { since - 1 } else { 0 },
            is_known: is_clock,
            tried: Tried {
                since,
                until,
                ..Tried::default()
            },
        }
    }

    /// Takes a fact that holds from this time on. One after the end is ignored.
    pub fn take(&mut self, at: i64, fact: Fact) {
        if at >= self.tried.until {
            return;
        }
        self.run(at);
        self.engine.handle(moment(at), fact);
        self.is_known = fact != Fact::Unknown;
        self.ask(at);
    }

    /// The result.
    #[must_use]
    pub fn end(mut self) -> Tried {
        self.run(self.tried.until - 1);
        self.pass(self.tried.until);
        self.tried
    }

    /// The result of a run that covers the history up to this moment only.
    #[must_use]
    pub fn cut(mut self, at: i64) -> Tried {
        self.tried.until = at;
        self.tried.is_cut = true;
        self.end()
    }

    /// Advances to a moment.
    fn run(&mut self, to: i64) {
        while let Some(due) = self.ask(self.now).filter(|due| *due <= to) {
            // An engine's deadline must advance the time.
            self.pass(due.max(self.now + 1));
        }
        self.pass(to);
    }

    fn pass(&mut self, to: i64) {
        let from = self.now.max(self.tried.since);
        if !self.is_known && to > from {
            self.tried.unknown_ms += to - from;
        }
        self.now = self.now.max(to);
    }

    /// Does what is due; returns when more is due.
    fn ask(&mut self, at: i64) -> Option<i64> {
        loop {
            match self.engine.poll(moment(at)) {
                Output::Act => self.acted(at),
                Output::Stop => self.tried.stopped = Some(at).filter(|at| *at >= self.tried.since),
                Output::Wait(None) => return None,
                Output::Wait(Some(Deadline::Wall(due))) => return Some(due),
                Output::Wait(Some(Deadline::Steady(due))) => {
                    return i64::try_from(due.0.div_ceil(1_000)).ok();
                }
            }
        }
    }

    fn acted(&mut self, at: i64) {
        if at < self.tried.since {
            return;
        }
        self.tried.count += 1;
        if self.tried.acts.len() < LISTED_MAX {
            self.tried.acts.push(at);
        }
    }
}

/// In the past both clocks are the same.
fn moment(at: i64) -> Moment {
    Moment {
        steady: Micros::from_millis(u64::try_from(at).unwrap_or_default()),
        wall: at,
    }
}
