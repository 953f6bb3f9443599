//! Times and durations.

use crate::Lang;
use jiff::{Timestamp, Zoned};

/// For programs: RFC 3339 in UTC with milliseconds.
pub fn rfc3339(moment: Timestamp) -> String {
    moment.strftime("%Y-%m-%dT%H:%M:%S.%3fZ").to_string()
}

/// For people: the local time of day with milliseconds.
pub fn clock(moment: &Zoned) -> String {
    moment.strftime("%H:%M:%S.%3f").to_string()
}

/// For people: the local date and time of day, from milliseconds since 1970.
pub fn date_and_clock(millis: i64) -> String {
    let moment = Timestamp::from_millisecond(millis).unwrap_or(Timestamp::UNIX_EPOCH);
    let moment = moment.to_zoned(jiff::tz::TimeZone::system());
    moment.strftime("%Y-%m-%d %H:%M:%S.%3f").to_string()
}

/// The time written by a program, or the current time.
pub fn clock_of(text: Option<&str>) -> String {
    let read = text.and_then(|text| text.parse::<Timestamp>().ok());
    let moment = read.unwrap_or_else(Timestamp::now);
    clock(&moment.to_zoned(jiff::tz::TimeZone::system()))
}

/// `34 ms`, `1.5 s`.
pub fn duration(lang: Lang, millis: u64) -> String {
    if millis < 1_000 {
        format!("{millis} {}", lang.of(["ms", "毫秒"]))
    } else {
        let tenths = (millis + 50) / 100;
        let (whole, tenth) = (tenths / 10, tenths % 10);
        format!("{whole}.{tenth} {}", lang.of(["s", "秒"]))
    }
}

/// How long a state has lasted: `34 s`, `12 min`, `5 h`, `3 d`.
pub fn span(lang: Lang, seconds: u64) -> String {
    let (count, unit) = match seconds {
        0..60 => (seconds, ["s", "秒"]),
        60..3_600 => (seconds / 60, ["min", "分钟"]),
        3_600..86_400 => (seconds / 3_600, ["h", "小时"]),
        _ => (seconds / 86_400, ["d", "天"]),
    };
    format!("{count} {}", lang.of(unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_have_milliseconds() {
        let moment: Timestamp = "2026-11-21T14:03:07.4125Z".parse().unwrap();
        assert_eq!(rfc3339(moment), "2026-11-21T14:03:07.412Z");
        let there = moment.to_zoned(jiff::tz::TimeZone::fixed(jiff::tz::offset(8)));
        assert_eq!(clock(&there), "22:03:07.412");
        assert_eq!(clock_of(None).len(), 12);
    }

    #[test]
    fn durations_carry_their_unit() {
        assert_eq!(duration(Lang::En, 34), "34 ms");
        assert_eq!(duration(Lang::Zh, 1_000), "1.0 秒");
        assert_eq!(duration(Lang::En, 14_649), "14.6 s");
        let spans = [59, 60, 3_599, 3_600, 172_800].map(|seconds| span(Lang::En, seconds));
        assert_eq!(spans, ["59 s", "1 min", "59 min", "1 h", "2 d"]);
    }
}
