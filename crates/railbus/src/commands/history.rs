//! `railbus history`: what a point was.

mod texts;

use super::Context;
use crate::api::past::{BucketInfo, HistoryInfo, SampleInfo, moment};
use crate::api::problem::{Problem, codes};
use crate::api::types::{Kind, PointInfo, Value};
use crate::backend::Backend;
use crate::cli;
use crate::failure::Failure;
use crate::i18n::Lang;
use crate::render::records::Records;
use crate::render::table::Table;
use crate::render::{out, time, values};
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_site::config::parse_duration;
use serde_json::json;
use texts::HistoryText;

/// The name of the command.
pub(crate) const NAME: &str = "history";

/// How long ago, where it is not said: an hour, in milliseconds.
const SINCE: u64 = 3_600_000;
/// The longest time that can be asked for, in days.
const DAYS_MAX: u64 = 36_500;

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus history POINT [--since TIME]";
    cli::verb(lang, NAME, HistoryText::About, usage)
        .before_help(cli::examples(lang, HistoryText::Examples))
        .arg(
            Arg::new("POINT")
                .required(true)
                .help(lang.get(HistoryText::Point)),
        )
        .arg(
            cli::flag(lang, "since", HistoryText::Since)
                .value_name("TIME")
                .value_parser(since),
        )
}

/// `30m`, `12h`, `7d`, in milliseconds.
fn since(text: &str) -> Result<u64, String> {
    let day_ms = 86_400_000;
    let millis = match text.strip_suffix('d') {
        Some(days) => days.parse::<u64>().ok().filter(|days| *days <= DAYS_MAX),
        None => None,
    };
    let millis = millis.map(|days| days * day_ms);
    let millis = millis.or_else(|| Some(parse_duration(text)?.0 / 1_000));
    millis
        .filter(|millis| (1..=DAYS_MAX * day_ms).contains(millis))
        .ok_or_else(String::new)
}

/// Prints every sample, or where they are many, what lay between which bounds.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let named = matches.get_one::<String>("POINT");
    let path = named.map(String::as_str).unwrap_or_default();
    let since = matches.get_one("since").copied().unwrap_or(SINCE);
    let (history, point) = context.block(async {
        let told = ask(&context, path, since).await;
        told.map_err(|problem| context.failure(&problem))
    })?;
    out::result(
        lang,
        &records(lang, &history, &point).render(context.format),
    )
}

/// The history, and what is said of the point.
async fn ask(
    context: &Context,
    path: &str,
    since: u64,
) -> Result<(HistoryInfo, Option<PointInfo>), Problem> {
    let Some(daemon) = Backend::daemon(&context.wanted).await else {
        return Err(Problem::new(codes::NO_HISTORY).with_hint("railbus serve"));
    };
    let history = daemon.history(path, since).await?;
    // One that was taken out of the configuration has a history all the same.
    let points = daemon.points(&[path.to_owned()], false).await;
    let point = points.ok().and_then(|points| points.into_iter().next());
    Ok((history, point))
}

fn records(lang: Lang, history: &HistoryInfo, point: &Option<PointInfo>) -> Records {
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
            "time": moment(sample.t), "value": sample.v, "quality": sample.q,
        }));
        table.add(of_sample(lang, sample, point));
    }
    for bucket in buckets {
        rows.push(json!({
            "time": moment(bucket.t), "value": bucket.mean, "min": bucket.min,
            "max": bucket.max, "samples": bucket.n, "quality": bucket.q,
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

/// A value with its unit; what is digital, in words where it is no mean.
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
        "good" => Text::Good,
        "stale" => Text::Stale,
        _ => Text::Bad,
    })
    .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_as_long_as_they_say() {
        assert_eq!(since("1h"), Ok(SINCE));
        assert_eq!(since("7d"), Ok(7 * 86_400_000));
        for wrong in ["", "d", "0d", "-1d", "5", "99999999d", "0s"] {
            assert!(since(wrong).is_err(), "{wrong}");
        }
    }
}
