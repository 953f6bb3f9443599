//! `railbus wait`: until points have the values that are wanted.

mod texts;
mod want;

use super::{Context, stop};
use crate::api::problem::{Problem, codes};
use crate::api::types::{PointInfo, Quality, WatchEvent};
use crate::backend::{Backend, Watch};
use crate::cli;
use crate::failure::{Code, Failure};
use crate::i18n::Lang;
use crate::render::records::Records;
use crate::render::table::Table;
use crate::render::{Format, out, time, values};
use clap::{Arg, ArgMatches, Command};
use railbus_wire::Micros;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::time::Duration;
use texts::WaitText;
use tokio::time::Instant;
use want::Want;

/// The name of the command.
pub(crate) const NAME: &str = "wait";

/// How long it is waited where nobody says.
const PATIENCE: Micros = Micros(10_000_000);

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus wait POINT=VALUE… [--timeout TIME]";
    cli::verb(lang, NAME, WaitText::About, usage)
        .before_help(cli::examples(lang, WaitText::Examples))
        .arg(
            Arg::new("POINT=VALUE")
                .help(lang.get(WaitText::Wants))
                .num_args(1..)
                .required(true),
        )
        // How long in all, and not how long one reply may take: RAILBUS_TIMEOUT is of these.
        .arg(
            cli::flag(lang, "timeout", WaitText::Timeout)
                .value_name("TIME")
                .value_parser(super::context::duration),
        )
}

/// Waits, and says what came.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let mut context = Context::of(lang, matches)?;
    context.wanted.polls = true;
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
        let backend = context.open().await?;
        let end = waited(&context, &backend, &wants, (begun, patience), &mut stop).await;
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
    (begun, patience): (Instant, Micros),
    stop: &mut stop::Stop,
) -> Result<Vec<PointInfo>, Failure> {
    let failed = |problem: Problem| context.failure(&problem);
    let paths: Vec<String> = wants.iter().map(|want| want.path.clone()).collect();
    let mut watch = backend.watch(&paths).await.map_err(failed)?;
    let until = begun + Duration::from_micros(patience.0);
    let come = tokio::time::timeout_at(until, come(context, backend, &mut watch, wants));
    match stop.or(come).await {
        None => Err(stop::interrupted(context)),
        Some(Ok(end)) => end,
        Some(Err(_)) => {
            let points = backend.known(&paths).await.map_err(failed)?;
            Err(in_vain(context, wants, &points, patience))
        }
    }
}

/// Follows what happens until the points are as wanted.
async fn come(
    context: &Context,
    backend: &Backend,
    watch: &mut Watch,
    wants: &[Want],
) -> Result<Vec<PointInfo>, Failure> {
    let paths: Vec<String> = wants.iter().map(|want| want.path.clone()).collect();
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
        if !wants
            .iter()
            .all(|want| want.is_met_by(told.get(&want.path)))
        {
            continue;
        }
        // What was told of the others may be out of date by now without a word having come.
        if told.len() > 1 {
            let known = backend.known(&paths).await;
            let known = known.map_err(|problem| context.failure(&problem))?;
            told.extend(
                known
                    .into_iter()
                    .filter(|point| point.path != path)
                    .map(|point| (point.path.clone(), point)),
            );
            if !wants
                .iter()
                .all(|want| want.is_met_by(told.get(&want.path)))
            {
                continue;
            }
        }
        let in_order = wants.iter().filter_map(|want| told.get(&want.path));
        return Ok(in_order.cloned().collect());
    }
    Err(context.failure(&Problem::new(codes::DAEMON)))
}

/// The failure of having waited in vain: what the points are instead, and how old that is.
fn in_vain(context: &Context, wants: &[Want], points: &[PointInfo], patience: Micros) -> Failure {
    let lang = context.lang;
    let time = time::duration(lang, patience.0 / 1_000);
    let message = lang.fill(WaitText::InVain, &[("time", &time)]);
    let mut failure = Failure::new(Code::WaitedInVain, message).diagnosed();
    let mut rows: Vec<Value> = Vec::new();
    for want in wants {
        let Some(point) = points.iter().find(|point| point.path == want.path) else {
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
        // One that has its value is told, too: it may have had it too early or too late.
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
