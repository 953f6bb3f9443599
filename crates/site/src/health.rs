//! How well a module answers: response times and error counts.

use crate::Counts;
use railbus_host::{Evidence, Fault};
use railbus_wire::Micros;
use std::collections::VecDeque;

/// A minute, in microseconds.
const MINUTE: u64 = 60_000_000;
/// How many minutes are counted.
const MINUTES: u64 = 60;

/// How many exchanges since the last good reply are kept as evidence.
const LOST_MAX: usize = 16;

/// How well a module answers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Health {
    pub(crate) counts: Counts,
    /// From the start of a request to the end of its reply, smoothed.
    rtt: Option<Micros>,
    pub(crate) errors: Hourly,
    pub(crate) late: Hourly,
    /// What was received instead of a good reply since the last one: of at most the last
    /// [`LOST_MAX`] exchanges.
    lost: VecDeque<Evidence>,
}

impl Health {
    /// A reply came after this time. Exponential smoothing: each new time counts an eighth.
    pub(crate) fn replied(&mut self, after: Micros) {
        self.counts.replied(after);
        self.lost.clear();
        let smoothed = self.rtt.map_or(after.0, |rtt| (rtt.0 * 7 + after.0) / 8);
        self.rtt = Some(Micros(smoothed));
    }

    /// An exchange failed at this time since the start.
    pub(crate) fn failed(&mut self, now: Micros, fault: &Fault) {
        self.errors.count(now);
        self.counts.failed(fault);
        match fault {
            Fault::NoReply(met) | Fault::Garbled(met) => {
                if self.lost.len() == LOST_MAX {
                    self.lost.pop_front();
                }
                self.lost.push_back(*met);
            }
            // A refusal is a good reply.
            _ => self.lost.clear(),
        }
    }

    /// What was received instead of a good reply since the last one.
    pub(crate) fn lost(&self) -> Evidence {
        let together = |all: Evidence, one: &Evidence| Evidence {
            attempts: all.attempts.saturating_add(one.attempts),
            garbled: all.garbled.saturating_add(one.garbled),
            bytes: all.bytes.saturating_add(one.bytes),
            why: all.why.or(one.why),
        };
        self.lost.iter().fold(Evidence::default(), together)
    }

    pub(crate) const fn rtt(&self) -> Option<Micros> {
        self.rtt
    }
}

/// How often something happened within the last hour, in steps of a minute.
#[derive(Clone, Debug)]
pub(crate) struct Hourly {
    minutes: [u32; MINUTES as usize],
    /// The current minute.
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
    /// Counts one at this time since the start.
    pub(crate) fn count(&mut self, now: Micros) {
        self.forget(now);
        if let Some(minute) = self.minutes.get_mut((self.newest % MINUTES) as usize) {
            *minute = minute.saturating_add(1);
        }
    }

    /// The sum over the last hour.
    pub(crate) fn total(&mut self, now: Micros) -> u32 {
        self.forget(now);
        self.minutes
            .iter()
            .fold(0, |sum, count| sum.saturating_add(*count))
    }

    /// Clears the minutes that are reused.
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
    use railbus_device::Refusal;
    use railbus_wire::Malformed;

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
    fn what_came_since_the_last_good_reply_is_kept_for_a_while() {
        let mut health = Health::default();
        let met = |bytes, why: Option<Malformed>| Evidence {
            attempts: 1,
            garbled: u8::from(why.is_some()),
            bytes,
            why,
        };
        let garbled = met(6, Some(Malformed::Checksum));
        health.failed(Micros(0), &Fault::Garbled(garbled));
        health.failed(Micros(0), &Fault::NoReply(met(0, None)));
        let both = Evidence {
            attempts: 2,
            ..garbled
        };
        assert_eq!(health.lost(), both);
        for _ in 0..LOST_MAX {
            health.failed(Micros(0), &Fault::NoReply(met(0, None)));
        }
        let silent = Evidence {
            attempts: LOST_MAX as u8,
            ..Evidence::default()
        };
        assert_eq!(health.lost(), silent);
        health.replied(Micros(8_000));
        assert_eq!(health.lost(), Evidence::default());
        health.failed(Micros(0), &Fault::Garbled(garbled));
        health.failed(Micros(0), &Fault::Refused(Refusal::Invalid));
        assert_eq!(health.lost(), Evidence::default());
    }

    #[test]
    fn the_round_trip_is_smoothed() {
        let mut health = Health::default();
        health.replied(Micros(8_000));
        health.replied(Micros(16_000));
        assert_eq!(health.rtt(), Some(Micros(9_000)));
    }
}
