//! `railbus history`: past values of a point.

mod texts;

use super::Context;
use super::context::far_flag;
use crate::args;
use crate::backend::{DaemonClient, Resolution};
use clap::{Arg, ArgMatches, Command, value_parser};
use jiff::civil::{DateTime, Time};
use jiff::tz::TimeZone;
use jiff::{Timestamp, Zoned};
use railbus_api::past::{BucketInfo, HistoryInfo, SampleInfo};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::{Kind, PointInfo, Value};
use railbus_app::api::past::moment;
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, values};
use railbus_app::texts::AppText;
use railbus_wire::Micros;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::time;
use serde_json::json;
use std::fmt::Display;
use texts::HistoryText;

/// The name of the command.
pub(crate) const NAME: &str = "history";

/// The default start: an hour ago, in milliseconds.
const SINCE: i64 = 3_600_000;
/// The longest time that can be asked for, in days.
const DAYS_MAX: i64 = 36_500;
const DAY_MS: i64 = 86_400_000;
/// The default number of lines.
const LINES: usize = 100;
/// The most lines that can be asked for.
const LINES_MAX: i64 = 4_000;

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus history POINT [--since WHEN] [--until WHEN] [--step TIME]";
    args::verb(lang, NAME, HistoryText::About, usage)
        .before_help(args::examples(lang, HistoryText::Examples))
        .arg(
            Arg::new("POINT")
                .required(true)
                .help(lang.get(HistoryText::Point)),
        )
        .arg(
            args::flag(lang, "since", HistoryText::Since)
                .value_name("WHEN")
                .value_parser(When::read),
        )
        .arg(
            args::flag(lang, "until", HistoryText::Until)
                .value_name("WHEN")
                .value_parser(When::read),
        )
        .arg(
            args::flag(lang, "step", HistoryText::Step)
                .value_name("TIME")
                .value_parser(length),
        )
        .arg(
            args::flag(lang, "limit", HistoryText::Limit)
                .value_name("N")
                .value_parser(value_parser!(u16).range(1..=LINES_MAX)),
        )
        .arg(far_flag(lang))
}

/// A moment as the user gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum When {
    /// So many milliseconds ago.
    Ago(i64),
    /// In milliseconds since 1970.
    At(i64),
}

impl When {
    /// `30m`, `7d`; `2026-11-22T14:00:00Z`; `2026-11-22 14:00` and `14:00` in local time.
    fn read(text: &str) -> Result<When, String> {
        if let Ok(millis) = length(text) {
            return Ok(When::Ago(millis));
        }
        let here = |time: DateTime| {
            let there = time.to_zoned(TimeZone::system()).ok()?;
            Some(there.timestamp())
        };
        let today = || Zoned::now().date();
        let moment = text
            .parse::<Timestamp>()
            .ok()
            .or_else(|| here(text.parse::<DateTime>().ok()?))
            .or_else(|| here(today().to_datetime(text.parse::<Time>().ok()?)));
        let moment = moment.ok_or_else(String::new)?;
        Ok(When::At(moment.as_millisecond()))
    }

    const fn millis(self, now: i64) -> i64 {
        match self {
            When::Ago(ago) => now.saturating_sub(ago),
            When::At(moment) => moment,
        }
    }
}

/// `30m`, `12h`, `7d`, in milliseconds.
fn length(text: &str) -> Result<i64, String> {
    let days = text.strip_suffix('d').and_then(|days| days.parse().ok());
    let millis = match days {
        Some(days) => Some(i64::saturating_mul(days, DAY_MS)),
        None => Micros::parse(text).and_then(|time| i64::try_from(time.0 / 1_000).ok()),
    };
    millis
        .filter(|millis| (1..=DAYS_MAX * DAY_MS).contains(millis))
        .ok_or_else(String::new)
}

/// The period and the number of values that are asked for.
#[derive(Clone, Copy, Debug)]
struct Options {
    span: (i64, i64),
    step: Option<i64>,
    limit: Option<usize>,
}

impl Options {
    fn of(lang: Lang, matches: &ArgMatches) -> Result<Options, Failure> {
        let now = Timestamp::now().as_millisecond().saturating_add(1);
        let when = |name: &str| matches.get_one::<When>(name).map(|when| when.millis(now));
        let until = when("until").unwrap_or(now);
        let since = when("since").unwrap_or_else(|| until.saturating_sub(SINCE));
        if since >= until {
            let message = lang.get(HistoryText::NothingBetween).to_owned();
            return Err(Failure::new(Code::Usage, message).with_try("railbus help history"));
        }
        let limit = matches.get_one::<u16>("limit");
        Ok(Options {
            span: (since, until),
            step: matches.get_one("step").copied(),
            limit: limit.copied().map(usize::from),
        })
    }

    /// Condensed over the whole period, unless only the last values are wanted. One more than the
    /// limit shows whether there are others.
    fn detail(self) -> Resolution {
        match (self.step, self.limit) {
            (Some(step), _) => Resolution::Step(step.unsigned_abs()),
            (None, Some(limit)) => Resolution::Last(limit + 1),
            (None, None) => Resolution::Stretches(LINES / 2),
        }
    }
}

/// Prints every sample or, if there are too many, minimum and maximum of each interval.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let options = Options::of(lang, matches)?;
    let named = matches.get_one::<String>("POINT");
    let path = named.map(String::as_str).unwrap_or_default();
    let (mut history, point) = context.block(async {
        let daemon = context.daemon().await?;
        let told = ask(daemon, path, options).await;
        told.map_err(|problem| context.failure(&problem))
    })?;
    let more = options
        .limit
        .is_some_and(|limit| keep_last(&mut history, limit));
    let records = records(&context, &history, &point);
    out::result(lang, &records.render(context.format))?;
    if more {
        context.note(lang.get(HistoryText::Older));
    } else if let (None, Some(stretches)) = (options.step, &history.buckets) {
        let samples: u64 = stretches.iter().map(|stretch| u64::from(stretch.n)).sum();
        let values: &[(&str, &dyn Display)] = &[("samples", &samples), ("lines", &stretches.len())];
        context.note(&lang.fill(HistoryText::Means, values));
    }
    Ok(())
}

/// Keeps the last `limit` samples, and returns whether there were more.
fn keep_last(history: &mut HistoryInfo, limit: usize) -> bool {
    fn cut<T>(list: &mut Option<Vec<T>>, limit: usize) -> bool {
        let Some(list) = list else { return false };
        let older = list.len().saturating_sub(limit);
        list.drain(..older);
        older > 0
    }
    let samples = cut(&mut history.samples, limit);
    cut(&mut history.buckets, limit) || samples
}

/// The history, and what is known about the point.
async fn ask(
    daemon: Option<DaemonClient>,
    path: &str,
    options: Options,
) -> Result<(HistoryInfo, Option<PointInfo>), Problem> {
    let Some(daemon) = daemon else {
        return Err(Problem::new(codes::NO_HISTORY).with_hint("railbus serve"));
    };
    let history = daemon.history(path, options.span, options.detail()).await?;
    // A point that was removed from the configuration still has a history.
    let points = match daemon.points(&[path.to_owned()], false).await {
        Ok(points) => points,
        Err(problem) if problem.status == 404 => Vec::new(),
        // Without it values would be shown as if they were of no kind.
        Err(problem) => return Err(problem),
    };
    let point = points.into_iter().next();
    Ok((history, point))
}

fn records(context: &Context, history: &HistoryInfo, point: &Option<PointInfo>) -> Records {
    let lang = context.lang;
    let samples = history.samples.iter().flatten();
    let buckets = history.buckets.iter().flatten();
    let head = if history.raw {
        HistoryText::Head
    } else {
        HistoryText::StretchHead
    };
    let mut table = Table::new(lang.get(head).split('|'));
    let mut rows = Vec::new();
    for sample in samples {
        rows.push(json!({
            "time": moment(sample.t), "value": bare(context.format, sample.v, point),
            "quality": sample.q,
        }));
        table.add(of_sample(lang, sample, point));
    }
    for bucket in buckets {
        rows.push(json!({
            "time": moment(bucket.t), "value": rounded(bucket.mean, point),
            "min": bucket.min, "max": bucket.max, "samples": bucket.n, "quality": bucket.q,
        }));
        table.add(of_bucket(lang, bucket, point));
    }
    Records {
        key: "history",
        rows,
        columns: &["time", "value", "min", "max", "samples", "quality"],
        value: "value",
        table,
    }
}

/// A value for programs: in CSV and bare format a state is a word, as everywhere in these formats.
fn bare(format: Format, value: Option<f64>, point: &Option<PointInfo>) -> serde_json::Value {
    let kind = point.as_ref().map(|point| point.kind);
    match (format, kind, value) {
        (Format::Csv | Format::Value, Some(Kind::Output | Kind::Input), Some(value)) => {
            (value != 0.0).into()
        }
        _ => json!(value),
    }
}

/// A mean with no more decimals than its point has.
fn rounded(mean: Option<f64>, point: &Option<PointInfo>) -> Option<f64> {
    let decimals = point.as_ref().and_then(|point| point.decimals);
    let scale = 10_f64.powi(decimals.map_or(2, i32::from));
    mean.map(|mean| (mean * scale).round() / scale)
}

fn of_sample(lang: Lang, sample: &SampleInfo, point: &Option<PointInfo>) -> [String; 3] {
    [
        time::date_and_clock(sample.t),
        shown(lang, sample.v, point, true),
        quality(lang, &sample.q),
    ]
}

fn of_bucket(lang: Lang, bucket: &BucketInfo, point: &Option<PointInfo>) -> [String; 6] {
    [
        time::date_and_clock(bucket.t),
        shown(lang, bucket.mean, point, false),
        shown(lang, bucket.min, point, true),
        shown(lang, bucket.max, point, true),
        bucket.n.to_string(),
        quality(lang, &bucket.q),
    ]
}

/// A value with its unit; a digital one as a word, unless it is a mean.
fn shown(lang: Lang, value: Option<f64>, point: &Option<PointInfo>, whole: bool) -> String {
    let (Some(number), Some(point)) = (value, point) else {
        return value.map_or_else(|| "–".to_owned(), |number| number.to_string());
    };
    let value = match point.kind {
        Kind::Output | Kind::Input if whole => Value::Bool(number != 0.0),
        Kind::Variable if whole => Value::Number(number as u32),
        _ => Value::Analog(number),
    };
    let text = values::bare(lang, point, value);
    match &point.unit {
        Some(unit) => format!("{text} {unit}"),
        None => text,
    }
}

fn quality(lang: Lang, name: &str) -> String {
    lang.get(match name {
        "good" => AppText::Good,
        "stale" => AppText::Stale,
        _ => AppText::Bad,
    })
    .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_as_long_as_they_say() {
        assert_eq!(length("1h"), Ok(SINCE));
        assert_eq!(length("7d"), Ok(7 * DAY_MS));
        for wrong in ["", "d", "0d", "-1d", "5", "99999999d", "0s"] {
            assert!(length(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn moments_are_read_as_people_name_them() {
        assert_eq!(When::read("30m"), Ok(When::Ago(1_800_000)));
        let moment = When::At(1_795_356_000_000);
        assert_eq!(When::read("2026-11-22T14:00:00Z"), Ok(moment));
        assert_eq!(When::read("2026-11-22T22:00:00+08:00"), Ok(moment));
        for local in ["2026-11-22 14:00", "2026-11-22T14:00:30", "14:00"] {
            assert!(matches!(When::read(local), Ok(When::At(_))), "{local}");
        }
        for wrong in ["", "yesterday", "25:00", "2026-13-01T00:00:00Z", "-5m"] {
            assert!(When::read(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_is_older_than_the_last_is_left_out() {
        let sample = |t| SampleInfo {
            t,
            v: None,
            q: "good".to_owned(),
        };
        let mut history = HistoryInfo {
            schema: 1,
            point: String::new(),
            from: String::new(),
            to: String::new(),
            unit: None,
            raw: true,
            samples: Some((0..3).map(sample).collect()),
            buckets: None,
        };
        assert!(!keep_last(&mut history, 3));
        assert!(keep_last(&mut history, 2));
        let kept = history.samples.iter().flatten().map(|sample| sample.t);
        assert_eq!(kept.collect::<Vec<_>>(), [1, 2]);
    }
}
