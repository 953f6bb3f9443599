//! How well a module answers: how fast, and how often not.

use crate::Counts;
use railbus_wire::Micros;

/// A minute, in microseconds.
const MINUTE: u64 = 60_000_000;
/// How many minutes are counted.
const MINUTES: u64 = 60;

/// How well a module answers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Health {
    pub(crate) counts: Counts,
    /// From the beginning of a request to the end of its reply, smoothed.
    rtt: Option<Micros>,
    pub(crate) errors: Hourly,
    pub(crate) late: Hourly,
}

impl Health {
    /// A reply took so long. Old ones count less and less: an eighth of each new one goes in.
    pub(crate) fn replied(&mut self, after: Micros) {
        self.counts.replied(after);
        let smoothed = self.rtt.map_or(after.0, |rtt| (rtt.0 * 7 + after.0) / 8);
        self.rtt = Some(Micros(smoothed));
    }

    pub(crate) const fn rtt(&self) -> Option<Micros> {
        self.rtt
    }
}

/// How often something happened within the last hour, in steps of a minute.
#[derive(Clone, Debug)]
pub(crate) struct Hourly {
    minutes: [u32; MINUTES as usize],
    /// The minute that is counted now.
    newest: u64,
}

impl Default for Hourly {
    fn default() -> Hourly {
        Hourly {
            minutes: [0; MINUTES as usize],
            newest: 0,
        }
    }
}

impl Hourly {
    /// It happened, so long after the start.
    pub(crate) fn count(&mut self, now: Micros) {
        self.forget(now);
        if let Some(minute) = self.minutes.get_mut((self.newest % MINUTES) as usize) {
            *minute = minute.saturating_add(1);
        }
    }

    /// How often, until now.
    pub(crate) fn total(&mut self, now: Micros) -> u32 {
        self.forget(now);
        self.minutes
            .iter()
            .fold(0, |sum, count| sum.saturating_add(*count))
    }

    /// Clears the minutes that have come round again.
    fn forget(&mut self, now: Micros) {
        let minute = now.0 / MINUTE;
        let passed = minute.saturating_sub(self.newest).min(MINUTES);
        self.newest = self.newest.max(minute);
        for back in 0..passed {
            if let Some(count) = self
                .minutes
                .get_mut(((self.newest - back) % MINUTES) as usize)
            {
                *count = 0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_hour_later_it_is_forgotten() {
        let mut hourly = Hourly::default();
        let at = |minute: u64| Micros(minute * MINUTE);
        hourly.count(at(0));
        hourly.count(at(0));
        hourly.count(at(30));
        assert_eq!(hourly.total(at(59)), 3);
        assert_eq!(hourly.total(at(60)), 1);
        assert_eq!(hourly.total(at(89)), 1);
        assert_eq!(hourly.total(at(90)), 0);
        hourly.count(at(1_000));
        assert_eq!(hourly.total(at(1_000)), 1);
    }

    #[test]
    fn the_round_trip_is_smoothed() {
        let mut health = Health::default();
        health.replied(Micros(8_000));
        health.replied(Micros(16_000));
        assert_eq!(health.rtt(), Some(Micros(9_000)));
    }
}
