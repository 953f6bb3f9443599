//! `railbus watch`: shows changes, one per line.

use super::{Context, get, stop};
use crate::args;
use crate::backend::Watch;
use crate::texts::Text;
use clap::{ArgAction, ArgMatches, Command};
use railbus_api::types::{LineInfo, ModuleInfo, PointInfo, PortState, Quality, WatchEvent};
use railbus_app::failure::Failure;
use railbus_app::render::records::{self, Records};
use railbus_app::render::{Format, out, values};
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::time;
use std::ops::ControlFlow;

/// The name of the command.
pub(crate) const NAME: &str = "watch";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus watch [TARGET…] [--plain]";
    args::verb(lang, NAME, Text::WatchAbout, usage)
        .before_help(args::examples(lang, Text::WatchExamples))
        .arg(get::targets(lang).help(lang.get(Text::AllTargets)))
        .arg(args::flag(lang, "plain", Text::WatchPlain).action(ArgAction::SetTrue))
}

/// Prints changes until it is stopped or its output is closed.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let mut context = Context::of(lang, matches)?;
    context.options.polls = true;
    let targets = get::selected(matches);
    context.block(async {
        let mut stop = stop::Stop::new(&context)?;
        let backend = context.open().await?;
        let watch = backend.watch(&targets).await;
        let end = match watch {
            Ok(mut watch) => follow(&context, &mut watch, &mut stop).await,
            Err(problem) => Err(context.failure(&problem)),
        };
        backend.finish(true).await;
        end
    })
}

async fn follow(
    context: &Context,
    watch: &mut Watch,
    stop: &mut stop::Stop,
) -> Result<(), Failure> {
    if context.format == Format::Csv {
        let head = records(context.lang, &[]).render(Format::Csv);
        out::result(context.lang, &head)?;
    }
    while let Some(event) = stop
        .or(watch.next())
        .await
        // Being stopped is its normal end.
        .ok_or_else(|| stop::interrupted(context).told())?
    {
        let event = event.map_err(|problem| context.failure(&problem))?;
        if let ControlFlow::Break(()) = out::put(context.lang, &show(context, &event))? {
            return Ok(());
        }
    }
    // No more events can come, which is not the same as nothing happening.
    Err(Failure::of(context.lang, Code::NoDaemon))
}

fn show(context: &Context, event: &WatchEvent) -> String {
    let lang = context.lang;
    match context.format {
        Format::Table => {
            let (moment, text) = told(lang, event);
            format!("{}  {text}\n", time::clock_of(moment))
        }
        Format::Json | Format::Ndjson => {
            records::line(serde_json::to_value(event).unwrap_or_default())
        }
        Format::Csv | Format::Value => match event {
            WatchEvent::Point { point, .. } => {
                records(lang, std::slice::from_ref(point)).rows_in(context.format)
            }
            _ => String::new(),
        },
    }
}

/// Points in CSV and bare format, as `railbus get` prints them.
fn records(lang: Lang, points: &[PointInfo]) -> Records {
    let mut records = get::records(lang, points, false);
    let now = time::rfc3339(jiff::Timestamp::now());
    for row in records
        .rows
        .iter_mut()
        .filter_map(serde_json::Value::as_object_mut)
    {
        row.entry("time").or_insert_with(|| now.as_str().into());
    }
    Records {
        columns: &["time", "path", "value", "quality", "unit"],
        ..records
    }
}

/// The time and the text of an event.
fn told(lang: Lang, event: &WatchEvent) -> (Option<&str>, String) {
    match event {
        WatchEvent::Point { point, before } => {
            let before = before.map(|before| values::bare(lang, point, before));
            let moment = before.as_ref().and(point.time.as_deref());
            (moment, changed(lang, point, before))
        }
        WatchEvent::Module { module } => (None, heard(lang, module)),
        WatchEvent::Line { line } => (None, plugged(lang, line)),
        WatchEvent::Gap { dropped } => (None, lang.fill(Text::WatchGap, &[("count", dropped)])),
    }
}

fn changed(lang: Lang, point: &PointInfo, before: Option<String>) -> String {
    let value = values::point(lang, point);
    let value = match before.filter(|before| Some(before.as_str()) != value.split(' ').next()) {
        Some(before) => format!("{before} → {value}"),
        None => value,
    };
    match point.quality {
        Quality::Good => format!("{}  {value}", point.path),
        Quality::Stale | Quality::Bad => {
            format!("{}  {value}  {}", point.path, values::quality(lang, point))
        }
    }
}

fn heard(lang: Lang, module: &ModuleInfo) -> String {
    format!(
        "{}  {}",
        module.module,
        values::presence(lang, module.state)
    )
}

fn plugged(lang: Lang, line: &LineInfo) -> String {
    let state = lang.get(match line.state {
        PortState::Opening => Text::PortOpening,
        PortState::Up => Text::PortUp,
        PortState::Absent => Text::PortAbsent,
        PortState::Busy => Text::PortBusy,
        PortState::Closed => Text::PortClosed,
    });
    format!("{}  {state}", line.line)
}
