//! One rule as a state machine.

use super::clock::{self, LATE_MAX_MS};
use crate::config::{Limit, Rule, When};
use jiff::tz::TimeZone;
use railbus_wire::Micros;
use std::collections::VecDeque;

/// The minimum time between two actions of a rule. An earlier one is delayed.
pub const BETWEEN_ACTS: Micros = Micros::from_secs(1);
/// A rule that would act more often than this within an hour is stopped: two rules that undo each
/// other would oscillate for ever.
pub const ACTS_PER_HOUR: usize = 60;

const HOUR: Micros = Micros::from_secs(3_600);

/// A moment, on both clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// The monotonic clock: for durations.
    pub steady: Micros,
    /// The wall clock, in milliseconds since 1970: for times of day.
    pub wall: i64,
}

/// What is known of a rule's condition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fact {
    /// Nothing: the value is stale or bad, or the line is under exclusive access.
    Unknown,
    /// An output is on, an input high, a module or a line offline; or not.
    Is(bool),
    /// A value in the unit of its point.
    Value(f64),
}

/// When an engine must be polled next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deadline {
    /// A moment of the monotonic clock.
    Steady(Micros),
    /// A moment of the wall clock, in milliseconds since 1970.
    Wall(i64),
}

/// What an engine returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// The rule acts now.
    Act,
    /// It would act too often, and is stopped.
    Stop,
    /// There is nothing to do until then, or until another fact is known.
    Wait(Option<Deadline>),
}

/// The state of a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Its condition is not known to hold.
    Resting,
    /// The condition has held since then.
    Holding(Micros),
    /// It has acted, and its condition is not known to have ended since.
    Acted,
    /// It acted too often.
    Stopped,
}

/// One rule in operation.
#[derive(Clone, Debug)]
pub struct RuleEngine {
    when: When,
    hold: Micros,
    zone: TimeZone,
    phase: Phase,
    /// When it acted within the last hour.
    acts: VecDeque<Micros>,
    /// The next time of day, and when that was computed.
    next: Option<(i64, i64)>,
}

impl RuleEngine {
    /// A rule with no facts yet. Times of day are in this zone.
    #[must_use]
    pub fn new(rule: &Rule, zone: TimeZone) -> RuleEngine {
        RuleEngine {
            when: rule.when.clone(),
            hold: rule.hold,
            zone,
            phase: Phase::Resting,
            acts: VecDeque::new(),
            next: None,
        }
    }

    /// Its state.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// When it acts if nothing changes, as far as computed.
    #[must_use]
    pub fn deadline(&self) -> Option<Deadline> {
        match self.phase {
            Phase::Holding(since) => Some(Deadline::Steady(self.due(since))),
            Phase::Stopped => None,
            Phase::Resting | Phase::Acted => self.next.map(|(due, _)| Deadline::Wall(due)),
        }
    }

    fn due(&self, since: Micros) -> Micros {
        let rested = self.acts.back().map(|last| *last + BETWEEN_ACTS);
        (since + self.hold).max(rested.unwrap_or_default())
    }

    /// Takes a fact that holds from now on. An unknown one fulfils no condition; a rule that has
    /// acted is ready again only when its condition is known to have ended.
    pub fn handle(&mut self, now: Moment, fact: Fact) {
        self.phase = match (self.phase, self.holds(fact)) {
            (Phase::Stopped, _) => Phase::Stopped,
            (Phase::Resting, Some(true)) => Phase::Holding(now.steady),
            (phase, Some(true)) => phase,
            (_, Some(false)) | (Phase::Holding(_), None) => Phase::Resting,
            (phase, None) => phase,
        };
    }

    /// Whether the condition holds; `None` if that is unknown. A value that was past the limit
    /// counts as past it until it has come back by the hysteresis.
    fn holds(&self, fact: Fact) -> Option<bool> {
        let was_over = matches!(self.phase, Phase::Holding(_) | Phase::Acted);
        match (&self.when, fact) {
            (When::Switch(_, wanted), Fact::Is(is)) => Some(is == *wanted),
            (When::ModuleOffline(_) | When::LineOffline(_), Fact::Is(is)) => Some(is),
            (When::Analog(_, limit), Fact::Value(value)) => Some(is_over(limit, value, was_over)),
            _ => None,
        }
    }

    /// What there is to do. Must be polled until it waits.
    pub fn poll(&mut self, now: Moment) -> Output {
        match self.phase {
            Phase::Stopped => Output::Wait(None),
            Phase::Holding(since) => {
                let due = self.due(since);
                match now.steady >= due {
                    true => self.act(now, Phase::Acted),
                    false => Output::Wait(Some(Deadline::Steady(due))),
                }
            }
            Phase::Resting | Phase::Acted => self.poll_clock(now),
        }
    }

    fn poll_clock(&mut self, now: Moment) -> Output {
        let When::Clock(clock) = self.when else {
            return Output::Wait(None);
        };
        // A clock that was set back invalidates what was computed from it.
        self.next = self
            .next
            .filter(|(_, asked)| now.wall >= asked - LATE_MAX_MS);
        let next = |after| clock::next(clock, &self.zone, after).map(|due| (due, now.wall));
        self.next = self.next.or_else(|| next(now.wall));
        let Some((due, _)) = self.next else {
            return Output::Wait(None);
        };
        if now.wall < due {
            return Output::Wait(Some(Deadline::Wall(due)));
        }
        self.next = next(now.wall);
        match now.wall - due <= LATE_MAX_MS {
            true => self.act(now, Phase::Resting),
            false => Output::Wait(self.next.map(|(due, _)| Deadline::Wall(due))),
        }
    }

    fn act(&mut self, now: Moment, then: Phase) -> Output {
        while self
            .acts
            .front()
            .is_some_and(|act| now.steady - *act >= HOUR)
        {
            self.acts.pop_front();
        }
        if self.acts.len() >= ACTS_PER_HOUR {
            self.phase = Phase::Stopped;
            return Output::Stop;
        }
        self.acts.push_back(now.steady);
        self.phase = then;
        Output::Act
    }
}

fn is_over(limit: &Limit, value: f64, was_over: bool) -> bool {
    let back = if was_over { limit.hysteresis } else { 0.0 };
    match limit.above {
        true => value > limit.value - back,
        false => value < limit.value + back,
    }
}
