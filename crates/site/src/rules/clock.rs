//! Times of day.

use crate::config::Clock;
use jiff::civil::Time;
use jiff::tz::TimeZone;
use jiff::{Timestamp, ToSpan};

/// A time of day that was missed by more than this, in milliseconds, is skipped: the clock was set,
/// or the machine was suspended.
pub const LATE_MAX_MS: i64 = 60_000;

/// The first time after a moment that it is this time of day, both in milliseconds since 1970. A
/// time that a clock change skips comes later by as much; one that comes twice counts once.
pub(super) fn next(clock: Clock, zone: &TimeZone, after: i64) -> Option<i64> {
    let now = Timestamp::from_millisecond(after).ok()?;
    let today = now.to_zoned(zone.clone()).date();
    let time = Time::new(
        i8::try_from(clock.hour).ok()?,
        i8::try_from(clock.minute).ok()?,
        0,
        0,
    );
    let time = time.ok()?;
    // After a week it is the same weekday; one day more if today's time has passed.
    (0..=8).find_map(|ahead: i64| {
        let day = today.checked_add(ahead.days()).ok()?;
        let bit = day.weekday().to_monday_zero_offset();
        if clock.days >> bit & 1 == 0 {
            return None;
        }
        let at = day.to_datetime(time).to_zoned(zone.clone()).ok()?;
        let at = at.timestamp().as_millisecond();
        (at > after).then_some(at)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(clock: Clock, zone: &str, from: &str, count: usize) -> Vec<String> {
        let zone = TimeZone::get(zone).unwrap();
        let mut at = from.parse::<Timestamp>().unwrap().as_millisecond();
        let each = (0..count).map(|_| {
            at = next(clock, &zone, at).unwrap();
            Timestamp::from_millisecond(at).unwrap().to_string()
        });
        each.collect()
    }

    const fn at(hour: u8, minute: u8, days: u8) -> Clock {
        Clock { hour, minute, days }
    }

    #[test]
    fn it_comes_on_its_days_in_the_time_of_the_place() {
        // 2026-11-20 is a Friday; in Shanghai it is eight hours later than in UTC.
        let weekend = at(6, 30, 0b110_0000);
        let found = times(weekend, "Asia/Shanghai", "2026-11-20T00:00:00Z", 3);
        let wanted = [
            "2026-11-20T22:30:00Z",
            "2026-11-21T22:30:00Z",
            "2026-11-27T22:30:00Z",
        ];
        assert_eq!(found, wanted);
        let monday = at(0, 0, 1);
        let found = times(monday, "UTC", "2026-11-23T00:00:00Z", 1);
        assert_eq!(found, ["2026-11-30T00:00:00Z"], "after a moment, not at it");
    }

    #[test]
    fn it_comes_once_where_the_clock_is_changed() {
        // In Berlin 02:30 is left out on 2026-03-29, and comes twice on 2026-10-25.
        let night = at(2, 30, Clock::DAILY);
        let found = times(night, "Europe/Berlin", "2026-03-28T12:00:00Z", 2);
        assert_eq!(found, ["2026-03-29T01:30:00Z", "2026-03-30T00:30:00Z"]);
        let found = times(night, "Europe/Berlin", "2026-10-24T12:00:00Z", 2);
        assert_eq!(found, ["2026-10-25T00:30:00Z", "2026-10-26T01:30:00Z"]);
    }
}
