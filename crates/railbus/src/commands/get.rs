//! `railbus get`: the values of points.

use super::context::far_flag;
use super::{Context, stop};
use crate::args;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::{LineInfo, PointInfo, Quality};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, values};
use railbus_app::texts::AppText;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::time;
use serde_json::Value;

/// The name of the command.
pub(crate) const NAME: &str = "get";

/// Values younger than this are shown without their age.
const YOUNG_MS: u64 = 1_000;

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus get TARGET… [--fresh] [--raw] [--last-known]";
    args::verb(lang, NAME, Text::GetAbout, usage)
        .alias("read")
        .before_help(args::examples(lang, Text::GetExamples))
        .arg(targets(lang).required(true))
        .arg(args::flag(lang, "fresh", Text::GetFresh).action(ArgAction::SetTrue))
        .arg(args::flag(lang, "raw", Text::GetRaw).action(ArgAction::SetTrue))
        .arg(args::flag(lang, "last-known", Text::LastKnown).action(ArgAction::SetTrue))
        .arg(far_flag(lang))
}

/// Modules, points and patterns.
pub(super) fn targets(lang: Lang) -> Arg {
    Arg::new("TARGET")
        .help(lang.get(Text::Targets))
        .num_args(1..)
}

/// Prints the values.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let targets: Vec<String> = selected(matches);
    let fresh = matches.get_flag("fresh");
    let (points, down) = context.block(async {
        let mut stop = stop::Stop::new(&context)?;
        let backend = context.open().await?;
        let mut points = stop.or(backend.points(&targets, fresh)).await;
        // A daemon may have no value yet: such modules are read before they are reported as faulty.
        let is_new = |point: &PointInfo| point.time.is_none() && point.quality == Quality::Bad;
        if let Some(Ok(known)) = &points
            && backend.is_daemon()
            && !fresh
            && known.iter().any(is_new)
        {
            points = stop.or(backend.points(&targets, true)).await;
        }
        let down = match &points {
            Some(Ok(points)) if points.iter().any(|point| point.quality == Quality::Bad) => {
                let down = backend.lines_down().await;
                down.map_err(|problem| context.failure(&problem))?
            }
            _ => Vec::new(),
        };
        backend.finish(true).await;
        let points = points.ok_or_else(|| stop::interrupted(&context))?;
        Ok((points.map_err(|problem| context.failure(&problem))?, down))
    })?;
    if points.is_empty() && !targets.is_empty() {
        let nothing = Problem::new(codes::NO_SUCH_MODULE).with("name", targets.join(" "));
        return Err(context.failure(&nothing));
    }
    let mut shown = records(lang, &points, matches.get_flag("raw"));
    if context.format == Format::Value && matches.get_flag("last-known") {
        // The quality is only left out when it is good.
        let rows = shown.rows.iter_mut().filter_map(Value::as_object_mut);
        rows.for_each(|row| drop(row.remove("quality")));
    }
    out::result(lang, &shown.render(context.format))?;
    verdict(&context, &points, &down)
}

pub(super) fn selected(matches: &ArgMatches) -> Vec<String> {
    let given = matches.get_many::<String>("TARGET");
    given.into_iter().flatten().cloned().collect()
}

/// Points in any format.
pub(super) fn records(lang: Lang, points: &[PointInfo], raw: bool) -> Records {
    // The description may be dropped on a narrow terminal; the quality may not.
    let mut table = Table::bare().spare(&[2]).names(2);
    for point in points {
        let mut notes = notes(lang, point);
        if let (true, Some(register)) = (raw, point.raw) {
            notes.insert(0, format!("(raw {register})"));
        }
        let name = values::called(lang, &point.name);
        table.add([
            point.path.clone(),
            values::point(lang, point),
            name,
            notes.join(lang.get(AppText::Comma)),
        ]);
    }
    let rows = points.iter().map(|point| {
        let mut row = serde_json::to_value(point).unwrap_or_default();
        if raw && let (Some(row), Some(register)) = (row.as_object_mut(), point.raw) {
            row.insert("value".to_owned(), register.into());
        }
        row
    });
    Records {
        key: "points",
        rows: rows.collect(),
        columns: &["time", "module", "label", "value", "unit", "quality"],
        value: "value",
        table,
    }
}

/// Remarks on a value.
fn notes(lang: Lang, point: &PointInfo) -> Vec<String> {
    let mut notes = Vec::new();
    if point.quality != Quality::Good {
        notes.push(values::quality(lang, point).to_owned());
    }
    if let Some(age) = point.age_ms.filter(|age| *age > YOUNG_MS) {
        let age = time::duration(lang, age);
        notes.push(lang.fill(Text::Old, &[("age", &age)]));
    }
    if let Some(width) = point.pulse_ms {
        let width = time::duration(lang, width);
        notes.push(lang.fill(Text::PulseMode, &[("width", &width)]));
    }
    if point.locked {
        notes.push(lang.get(Text::LockedWord).to_owned());
    }
    notes
}

/// The failure for values that could not be read. A module is only blamed for its own silence, and
/// a line for its port.
fn verdict(
    context: &Context,
    points: &[PointInfo],
    down: &[(LineInfo, Problem)],
) -> Result<(), Failure> {
    let lang = context.lang;
    let of = |quality: Quality| {
        let points = points.iter().filter(move |point| point.quality == quality);
        let mut modules: Vec<&str> = points.map(|point| point.module.as_str()).collect();
        modules.dedup();
        modules
    };
    let hangs_on = |line: &LineInfo, module: &str| line.modules.iter().any(|name| name == module);
    let mut silent = of(Quality::Bad);
    let lines = down
        .iter()
        .filter(|(line, _)| silent.iter().any(|module| hangs_on(line, module)));
    let lines: Vec<Failure> = lines.map(|(_, why)| context.failure(why)).collect();
    silent.retain(|module| !down.iter().any(|(line, _)| hangs_on(line, module)));
    let stale = of(Quality::Stale);
    let of_modules = |text: Text, modules: &[&str]| {
        let names = modules.join(" ");
        let message = lang.fill(text, &[("modules", &names)]);
        let failure = Failure::new(Code::NoReply, message);
        // What usually helps is done at the line, and that is elsewhere.
        let failure = match &context.options.far {
            None => failure.diagnosed(),
            Some(far) => failure.with_try(format!("railbus ls -s {}", far.name)),
        };
        failure.with_fact("modules", modules.to_vec())
    };
    let silent = (!silent.is_empty()).then(|| of_modules(Text::SilentModules, &silent));
    // A stale value does not count as read, either.
    let stale = (!stale.is_empty()).then(|| of_modules(Text::StaleModules, &stale));
    let mut failures = silent.into_iter().chain(lines).chain(stale);
    let Some(first) = failures.next() else {
        return Ok(());
    };
    Err(failures.fold(first, |first, also| {
        first.because(also.message().to_owned())
    }))
}
