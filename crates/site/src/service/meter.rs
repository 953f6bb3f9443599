//! What the exchanges of a site came to, counted since its start.

use super::Service;
use railbus_host::Fault;
use railbus_wire::Micros;
use std::collections::BTreeMap;

/// The upper ends of the steps in which times of exchanges are counted; the last has none.
pub const STEPS: [Micros; 11] = [
    Micros::from_millis(5),
    Micros::from_millis(10),
    Micros::from_millis(20),
    Micros::from_millis(30),
    Micros::from_millis(50),
    Micros::from_millis(75),
    Micros::from_millis(100),
    Micros::from_millis(200),
    Micros::from_millis(500),
    Micros::from_millis(1_000),
    Micros(u64::MAX),
];

/// What the exchanges with a module came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Exchanges that were answered.
    pub replies: u64,
    /// Exchanges that failed, by the name of what went wrong.
    pub failed: BTreeMap<&'static str, u64>,
    /// Replies that came too late.
    pub late: u64,
    /// How long those took that were answered: how many ended in each of [`STEPS`].
    pub steps: [u64; STEPS.len()],
    /// How long they took together.
    pub time: Micros,
}

impl Counts {
    pub(crate) fn replied(&mut self, took: Micros) {
        self.replies += 1;
        self.time += took;
        let step = STEPS.iter().position(|end| took <= *end);
        if let Some(count) = step.and_then(|step| self.steps.get_mut(step)) {
            *count += 1;
        }
    }

    pub(crate) fn failed(&mut self, fault: &Fault) {
        *self.failed.entry(fault.name()).or_default() += 1;
    }

    /// All exchanges.
    #[must_use]
    pub fn exchanges(&self) -> u64 {
        self.replies + self.failed.values().sum::<u64>()
    }
}

/// A minute.
const MINUTE: Micros = Micros::from_secs(60);

/// How much of a line's time is taken.
#[derive(Clone, Debug, Default)]
pub(crate) struct Busy {
    /// The minute that is counted, by its number.
    minute: u64,
    taken: Micros,
    /// The whole minute before it.
    before: Option<Micros>,
}

impl Busy {
    /// An exchange ended now that took so long.
    pub(crate) fn add(&mut self, now: Micros, took: Micros) {
        self.turn(now);
        self.taken += took;
    }

    /// Which share of the last whole minute was taken; until there is one, of the time so far.
    pub(crate) fn ratio(&mut self, now: Micros) -> f64 {
        self.turn(now);
        let (taken, of) = match self.before {
            Some(before) => (before, MINUTE),
            None => (self.taken, now),
        };
        (taken.0 as f64 / of.0.max(1) as f64).min(1.0)
    }

    fn turn(&mut self, now: Micros) {
        let minute = now.0 / MINUTE.0;
        if minute != self.minute {
            let is_next = minute == self.minute + 1;
            self.before = Some(if is_next { self.taken } else { Micros(0) });
            (self.minute, self.taken) = (minute, Micros(0));
        }
    }
}

impl Service {
    /// What the exchanges with each module came to since the start.
    #[must_use]
    pub fn counts(&self) -> BTreeMap<String, Counts> {
        self.inner.read(|state| {
            let modules = state.site.config().modules.keys();
            let of = |name: &String| {
                let counts = state.health.get(name).map(|health| health.counts.clone());
                (name.clone(), counts.unwrap_or_default())
            };
            modules.map(of).collect()
        })
    }

    /// Which share of a line's time is taken by exchanges that are answered: of the last whole
    /// minute, or of the time so far. None where there is no such line.
    #[must_use]
    pub fn busy(&self, line: &str) -> Option<f64> {
        self.inner.read(|state| {
            let now = state.now.site;
            Some(state.lines.get_mut(line)?.busy.ratio(now))
        })
    }

    /// How long the site has been at work.
    #[must_use]
    pub fn age(&self) -> Micros {
        self.inner.now().site
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_counted_in_steps() {
        let mut counts = Counts::default();
        for millis in [4, 5, 6, 2_000] {
            counts.replied(Micros::from_millis(millis));
        }
        counts.failed(&Fault::NotVerified);
        assert_eq!(
            (counts.steps[0], counts.steps[1], counts.steps[10]),
            (2, 1, 1)
        );
        assert_eq!(
            (counts.exchanges(), counts.time),
            (5, Micros::from_millis(2_015))
        );
    }

    #[test]
    fn a_line_is_as_busy_as_it_was_in_the_last_minute() {
        let mut busy = Busy::default();
        busy.add(Micros::from_secs(10), Micros::from_secs(5));
        assert_eq!(busy.ratio(Micros::from_secs(20)), 0.25);
        busy.add(Micros::from_secs(50), Micros::from_secs(25));
        assert_eq!(busy.ratio(Micros::from_secs(61)), 0.5);
        assert_eq!(busy.ratio(Micros::from_secs(119)), 0.5);
        assert_eq!(busy.ratio(Micros::from_secs(300)), 0.0);
    }
}
