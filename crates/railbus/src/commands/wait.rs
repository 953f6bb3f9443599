//! `railbus wait`: waits until points have the wanted values.

mod texts;
mod want;

use super::{Context, stop};
use crate::args;
use crate::backend::Backend;
use clap::{Arg, ArgMatches, Command};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::{PointInfo, Quality, WatchEvent};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, values};
use railbus_wire::Micros;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::time;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::time::Duration;
use texts::WaitText;
use tokio::time::{Instant, timeout, timeout_at};
use want::Want;

/// The name of the command.
pub(crate) const NAME: &str = "wait";

/// How long it waits by default.
const PATIENCE: Micros = Micros(10_000_000);

/// How long the last query of the points may take when the time is over.
const LAST_WORD: Duration = Duration::from_secs(1);

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus wait POINT=VALUE… [--timeout TIME]";
    args::verb(lang, NAME, WaitText::About, usage)
        .before_help(args::examples(lang, WaitText::Examples))
        .arg(
            Arg::new("POINT=VALUE")
                .help(lang.get(WaitText::Wants))
                .num_args(1..)
                .required(true),
        )
        // The time in all, not the timeout of one reply, which is what RAILBUS_TIMEOUT sets.
        .arg(
            args::flag(lang, "timeout", WaitText::Timeout)
                .value_name("TIME")
                .value_parser(super::context::duration),
        )
}

/// Waits, and prints the values.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let mut context = Context::of(lang, matches)?;
    context.options.polls = true;
    let words = matches.get_many::<String>("POINT=VALUE");
    let wants: Vec<Want> = words
        .into_iter()
        .flatten()
        .map(|word| Want::read(word).ok_or_else(|| bad_word(lang, word)))
        .collect::<Result<_, _>>()?;
    let patience = context.timeout.unwrap_or(PATIENCE);
    context.block(async {
        let mut stop = stop::Stop::new(&context)?;
        let begun = Instant::now();
        let until = begun + Duration::from_micros(patience.0);
        let opened = stop.or(timeout_at(until, context.open())).await;
        let backend = match opened.ok_or_else(|| stop::interrupted(&context))? {
            Ok(backend) => backend?,
            Err(_) => return Err(in_vain(&context, &wants, &[], patience)),
        };
        let end = waited(&context, &backend, &wants, (until, patience), &mut stop).await;
        backend.finish(true).await;
        let points = end?;
        let took = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        let quiet = context.quiet && context.format == Format::Table;
        match quiet {
            true => Ok(()),
            false => out::result(lang, &records(lang, &points, took).render(context.format)),
        }
    })
}

fn bad_word(lang: Lang, word: &str) -> Failure {
    let message = lang.fill(WaitText::BadWord, &[("word", &word)]);
    Failure::new(Code::Usage, message)
        .with_try("railbus wait pump.di0=on")
        .with_try("railbus wait tank.ai1=8.5..10")
}

/// The points once they are as wanted.
async fn waited(
    context: &Context,
    backend: &Backend,
    wants: &[Want],
    (until, patience): (Instant, Micros),
    stop: &mut stop::Stop,
) -> Result<Vec<PointInfo>, Failure> {
    let paths: Vec<String> = wants.iter().map(|want| want.path.clone()).collect();
    let last = async {
        if let Ok(end) = timeout_at(until, come(context, backend, &paths, wants)).await {
            return end;
        }
        // Not every change is an event: a value may become good again without having changed.
        let known = timeout(LAST_WORD, backend.known(&paths)).await;
        let known = known.unwrap_or_else(|_| Ok(Vec::new()));
        let known = known.map_err(|problem| context.failure(&problem))?;
        let told = known.into_iter().map(|point| (point.path.clone(), point));
        let told: BTreeMap<String, PointInfo> = told.collect();
        met(wants, &told).ok_or_else(|| {
            let known: Vec<PointInfo> = told.into_values().collect();
            in_vain(context, wants, &known, patience)
        })
    };
    let end = stop.or(last).await;
    end.unwrap_or_else(|| Err(stop::interrupted(context)))
}

/// The points in the order of the conditions, if all of these are met.
fn met(wants: &[Want], told: &BTreeMap<String, PointInfo>) -> Option<Vec<PointInfo>> {
    let each = wants.iter().map(|want| {
        let point = told.get(&want.path);
        point.filter(|_| want.is_met_by(point)).cloned()
    });
    each.collect()
}

/// Follows the events until the points are as wanted.
async fn come(
    context: &Context,
    backend: &Backend,
    paths: &[String],
    wants: &[Want],
) -> Result<Vec<PointInfo>, Failure> {
    let watch = backend.watch(paths).await;
    let mut watch = watch.map_err(|problem| context.failure(&problem))?;
    let mut told: BTreeMap<String, PointInfo> = BTreeMap::new();
    while let Some(event) = watch.next().await {
        let event = event.map_err(|problem| context.failure(&problem))?;
        let WatchEvent::Point { point, .. } = event else {
            continue;
        };
        for want in wants.iter().filter(|want| want.path == point.path) {
            if !want.can_be(&point) {
                return Err(bad_word(context.lang, &want.word));
            }
        }
        let path = point.path.clone();
        told.insert(path.clone(), point);
        if met(wants, &told).is_none() {
            continue;
        }
        // The values of the others may have become stale since, without an event.
        if told.len() > 1 {
            let known = backend.known(paths).await;
            let known = known.map_err(|problem| context.failure(&problem))?;
            told.extend(
                known
                    .into_iter()
                    .filter(|point| point.path != path)
                    .map(|point| (point.path.clone(), point)),
            );
        }
        if let Some(in_order) = met(wants, &told) {
            return Ok(in_order);
        }
    }
    Err(context.failure(&Problem::new(codes::DAEMON)))
}

/// The failure of a timeout: the values that the points have instead, and their age.
fn in_vain(context: &Context, wants: &[Want], points: &[PointInfo], patience: Micros) -> Failure {
    let lang = context.lang;
    let time = time::duration(lang, patience.0 / 1_000);
    let message = lang.fill(WaitText::InVain, &[("time", &time)]);
    let mut failure = Failure::new(Code::WaitedInVain, message).diagnosed();
    let mut rows: Vec<Value> = Vec::new();
    for want in wants {
        let Some(point) = points.iter().find(|point| point.path == want.path) else {
            let text = lang.fill(WaitText::Unread, &[("word", &want.word)]);
            failure = failure.because(text);
            continue;
        };
        let value = values::point(lang, point);
        let age = point.age_ms.map(|age| time::duration(lang, age));
        let quality = values::quality(lang, point);
        let named: &[(&str, &dyn Display)] = &[
            ("word", &want.word),
            ("value", &value),
            ("quality", &quality),
            ("age", &age.as_deref().unwrap_or("–")),
        ];
        let text = match (&age, point.quality) {
            (None, _) => WaitText::NeverRead,
            (Some(_), Quality::Good) => WaitText::Instead,
            (Some(_), Quality::Stale | Quality::Bad) => WaitText::InsteadDoubtful,
        };
        rows.push(row(point));
        // Points with the wanted value are listed, too: they may have had it too early or too late.
        failure = failure.because(lang.fill(text, named));
    }
    failure.with_fact("points", rows)
}

fn row(point: &PointInfo) -> Value {
    json!({
        "path": point.path, "value": point.value, "unit": point.unit,
        "quality": point.quality.name(), "age_ms": point.age_ms, "time": point.time,
    })
}

fn records(lang: Lang, points: &[PointInfo], took: u64) -> Records {
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for point in points {
        let after = lang.fill(WaitText::After, &[("time", &time::duration(lang, took))]);
        table.add([point.path.clone(), values::point(lang, point), after]);
        let mut row = row(point);
        if let Some(row) = row.as_object_mut() {
            row.insert("took_ms".to_owned(), took.into());
        }
        rows.push(row);
    }
    Records {
        key: "wait",
        rows,
        columns: &["time", "path", "value", "unit", "quality", "took_ms"],
        value: "value",
        table,
    }
}
