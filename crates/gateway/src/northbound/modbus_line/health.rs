//! How long a unit is waited for, and when one that did not answer is asked again.
//!
//! A unit that does not answer costs all others its timeout. So from its second silence on it is
//! asked only now and then, and its requests get the same answer meanwhile. One that the site hears
//! may only not answer what it is asked for: it is asked again as soon as it may be. The units that
//! don't answer have a fortieth of the time together, as long as there are few: each is asked every
//! ten seconds at least.
//!
//! A module that the site polls and does not hear is hardly asked at all: the line asks it already,
//! and a read of it would have to wait until no reply to that can come, and all others behind it.
//! It is asked at once when the site has heard it again.

use railbus_wire::{Micros, REPLY_TIMEOUT};
use std::collections::BTreeMap;
use std::time::Duration;

/// The least and the most that a unit which answered before is waited for.
const WAIT_MIN: Micros = Micros::from_millis(98);
const WAIT_MAX: Micros = Micros::from_secs(1);
/// So long after a silence the reply may still come, and the line asks nothing that it could be
/// mistaken for: it would hold up what comes after it.
const LATE: Duration = Duration::from_millis(500);
/// Units that don't answer have one part in this many of the time.
const SHARE: u32 = 40;
/// But one that masters ask for is asked as often as this.
const PAUSE_MAX: Duration = Duration::from_secs(10);
/// The same for one that the site does not hear: perhaps it is not polled.
const LOST_PAUSE: Duration = Duration::from_secs(60);
/// After so many silences in a row the requests of a unit wait no more for its next turn.
const SILENT: u32 = 2;

/// What is known of a unit.
#[derive(Clone, Copy, Debug, Default)]
struct Unit {
    /// How long it took lately; none if it never answered.
    lately: Option<Micros>,
    /// How often in a row it did not answer.
    misses: u32,
    /// When it may be asked again.
    from: Duration,
    /// When a master last asked for it.
    wanted: Duration,
    /// When it last did not answer.
    missed: Duration,
    /// The site does not hear it.
    is_lost: bool,
    /// The site hears it: it may only not answer what it was asked for.
    is_heard: bool,
}

/// What is known of all units.
#[derive(Debug, Default)]
pub(super) struct Health {
    units: BTreeMap<u8, Unit>,
}

/// Whether a unit may be asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// Now.
    Now,
    /// Not before then.
    From(Duration),
    /// It did not answer lately, and is not asked for this.
    Silent,
}

impl Health {
    /// Whether a unit may be asked now. `is_online` is what the site knows of it, if it does.
    pub(super) fn turn(&mut self, now: Duration, unit: u8, is_online: Option<bool>) -> Turn {
        if is_online == Some(false) {
            self.units.entry(unit).or_default();
        }
        let Some(known) = self.units.get_mut(&unit) else {
            return Turn::Now;
        };
        known.wanted = now;
        known.is_heard = is_online == Some(true);
        match (is_online, known.is_lost) {
            (Some(false), false) => {
                (known.is_lost, known.misses) = (true, known.misses.max(SILENT));
                known.from = now + LOST_PAUSE;
            }
            (Some(false), true) => {}
            // It is back, or its line has gone, which the line will say.
            (_, true) => (known.is_lost, known.misses) = (false, 0),
            (_, false) => {}
        }
        let from = match known.is_heard {
            true => known.from.min(known.missed + LATE),
            false => known.from,
        };
        match known.misses == 0 || from <= now {
            true => Turn::Now,
            false if known.misses < SILENT || known.is_heard => Turn::From(from),
            false => Turn::Silent,
        }
    }

    /// How long its reply may take to begin.
    pub(super) fn timeout(&self, unit: u8) -> Micros {
        let known = self.units.get(&unit).copied().unwrap_or_default();
        let wait = match (known.lately, known.misses) {
            (None, 0) => REPLY_TIMEOUT,
            (None, _) => WAIT_MIN,
            (Some(lately), 0) => lately * 2,
            (Some(lately), _) => lately + Micros(lately.0 / 4),
        };
        wait.clamp(WAIT_MIN, WAIT_MAX)
    }

    /// It answered, in this time; perhaps later than it was waited for.
    pub(super) fn answered(&mut self, unit: u8, after: Micros) {
        let known = self.units.entry(unit).or_default();
        let before = known.lately.unwrap_or_default();
        known.lately = Some(after.max(Micros(before.0 - before.0 / 8)));
        (known.misses, known.is_lost) = (0, false);
    }

    /// It did not answer; waiting for it ended now.
    pub(super) fn missed(&mut self, now: Duration, unit: u8) {
        let cost = Duration::from_micros(self.timeout(unit).0);
        let known = self.units.entry(unit).or_default();
        known.misses = known.misses.saturating_add(1);
        (known.missed, known.from) = (now, now + LATE);
        if known.misses < SILENT {
            return;
        }
        let is_wanted = |known: &&Unit| now.saturating_sub(known.wanted) <= PAUSE_MAX;
        let silent = self.units.values().filter(|known| known.misses >= SILENT);
        let count = silent.filter(is_wanted).count().max(1) as u32;
        let pause = (cost * SHARE * count).min(PAUSE_MAX);
        if let Some(known) = self.units.get_mut(&unit) {
            known.from = now + if known.is_lost { LOST_PAUSE } else { pause };
        }
    }

    /// Whether it is not waited for any more.
    pub(super) fn is_silent(&self, unit: u8) -> bool {
        let known = self.units.get(&unit);
        known.is_some_and(|known| known.misses >= SILENT && !known.is_heard)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn at(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    #[test]
    fn a_unit_is_waited_for_as_long_as_it_takes() {
        let mut health = Health::default();
        assert_eq!(health.timeout(3), REPLY_TIMEOUT, "nothing is known of it");
        health.answered(3, Micros::from_millis(5));
        assert_eq!(health.timeout(3), WAIT_MIN);
        health.answered(3, Micros::from_millis(200));
        assert_eq!(health.timeout(3), Micros::from_millis(400));
        health.missed(at(0), 3);
        assert_eq!(health.timeout(3), Micros::from_millis(250));
        health.answered(3, Micros::from_secs(5));
        assert_eq!(health.timeout(3), WAIT_MAX);
        health.missed(at(0), 4);
        assert_eq!(health.timeout(4), WAIT_MIN);
    }

    #[test]
    fn a_silent_unit_has_a_fortieth_of_the_time() {
        let mut health = Health::default();
        health.answered(3, Micros::from_millis(5));
        health.missed(at(100), 3);
        assert_eq!(health.turn(at(100), 3, None), Turn::From(at(600)));
        assert_eq!(health.turn(at(600), 3, None), Turn::Now);
        // Asked as soon as it may be, for a minute.
        let (mut now, mut spent) = (600, 0);
        while now < 60_000 {
            match health.turn(at(now), 3, None) {
                Turn::Now => {
                    (now, spent) = (now + 98, spent + 98);
                    health.missed(at(now), 3);
                }
                Turn::Silent => now += 1,
                Turn::From(_) => panic!("{now}"),
            }
        }
        assert!((1_000..=1_700).contains(&spent), "{spent}");
        assert_eq!(health.turn(at(now), 4, None), Turn::Now, "another unit");
    }

    #[test]
    fn many_silent_units_have_more_but_each_is_asked() {
        for (count, most) in [(2, 2 * 98 * 10), (40, 40 * 98 * 8)] {
            let mut health = Health::default();
            let mut asked = vec![0; count];
            let (mut now, mut spent) = (0, 0);
            while now < 60_000 {
                for (unit, asked) in asked.iter_mut().enumerate() {
                    if health.turn(at(now), unit as u8, None) == Turn::Now {
                        (now, spent) = (now + 98, spent + 98);
                        health.missed(at(now), unit as u8);
                        *asked += 1;
                    }
                }
                now += 10;
            }
            assert!(asked.iter().all(|asked| *asked >= 5), "{asked:?}");
            assert!(spent <= most, "{spent} of {most}");
        }
    }

    #[test]
    fn what_the_site_does_not_hear_is_hardly_asked_until_it_is_back() {
        let mut health = Health::default();
        let lost = Some(false);
        assert_eq!(health.turn(at(0), 3, Some(true)), Turn::Now);
        assert_eq!(health.turn(at(100), 3, lost), Turn::Silent);
        assert_eq!(health.turn(at(60_000), 3, lost), Turn::Silent);
        assert_eq!(health.turn(at(60_100), 3, lost), Turn::Now);
        health.missed(at(60_200), 3);
        assert_eq!(health.turn(at(120_000), 3, lost), Turn::Silent);
        assert_eq!(health.turn(at(120_001), 3, Some(true)), Turn::Now);
        assert!(!health.is_silent(3));
        assert_eq!(health.turn(at(121_000), 3, lost), Turn::Silent);
        assert_eq!(
            health.turn(at(121_000), 3, None),
            Turn::Now,
            "nothing is known"
        );
    }

    /// It may not answer one request, and all others: these are not refused for it.
    #[test]
    fn a_unit_that_the_site_hears_is_asked_again() {
        let mut health = Health::default();
        let heard = Some(true);
        for nth in 0..10 {
            let now = 600 * nth;
            assert_eq!(health.turn(at(now), 3, heard), Turn::Now);
            health.missed(at(now), 3);
            assert!(!health.is_silent(3));
            assert_eq!(health.turn(at(now), 3, heard), Turn::From(at(now + 500)));
        }
        health.answered(3, Micros::from_millis(5));
        assert_eq!(health.turn(at(5_401), 3, heard), Turn::Now);
    }

    #[test]
    fn a_unit_that_answers_late_is_asked_at_once() {
        let mut health = Health::default();
        health.missed(at(0), 3);
        health.missed(at(600), 3);
        assert_eq!(health.turn(at(700), 3, None), Turn::Silent);
        health.answered(3, Micros::from_millis(120));
        assert_eq!(health.turn(at(700), 3, None), Turn::Now);
    }
}
