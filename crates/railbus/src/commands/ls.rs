//! `railbus ls`: modules, points, lines, models, ports.

mod groups;
mod models;
mod ports;

use super::context::far_flag;
use super::{Context, stop};
use crate::args;
use crate::backend::Backend;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_api::problem::Problem;
use railbus_api::types::{LineInfo, ModuleInfo, PortState};
use railbus_app::failure::Failure;
use railbus_app::machine::Machine;
use railbus_app::render::colour::Paint;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{out, values};
use railbus_wire::Address;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::{time, width};

/// The name of the command.
pub(crate) const NAME: &str = "ls";

const WHAT: [&str; 6] = ["modules", "points", "lines", "groups", "models", "ports"];

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus ls [modules|lines|groups|models|ports] | ls points [MODULE…]";
    args::verb(lang, NAME, Text::LsAbout, usage)
        .alias("list")
        .before_help(args::examples(lang, Text::LsExamples))
        .arg(
            Arg::new("WHAT")
                .help(lang.get(Text::LsWhat))
                .value_parser(WHAT)
                .hide_possible_values(true),
        )
        .arg(
            Arg::new("MODULE")
                .help(lang.get(Text::LsModule))
                .num_args(0..),
        )
        .arg(far_flag(lang))
}

/// Prints the list.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let what = matches.get_one::<String>("WHAT").map(String::as_str);
    let of: Vec<String> = matches
        .get_many("MODULE")
        .into_iter()
        .flatten()
        .cloned()
        .collect();
    if let (Some(name), false) = (of.first(), what == Some("points")) {
        let message = lang.fill(Text::NoSuchArgument, &[("name", name)]);
        return Err(Failure::new(Code::Usage, message).with_try("railbus ls points MODULE"));
    }
    // These are of this program, and of this machine.
    if let (Some(what @ ("models" | "ports")), Some(_)) = (what, &context.options.far) {
        let message = lang.fill(Text::NotFar, &[("what", &what)]);
        return Err(Failure::new(Code::Usage, message).with_try(format!("railbus ls {what}")));
    }
    let records = match what {
        Some("models") => models::records(lang),
        Some("ports") => ports::records(lang, &Machine::this()),
        Some("points") => {
            let points = ask(&context, async |backend| backend.points(&of, false).await)?;
            super::get::records(lang, &points, false)
        }
        Some("groups") => {
            let groups = ask(&context, async |backend| backend.groups().await)?;
            groups::records(lang, &groups)
        }
        Some("lines") => lines(lang, &ask(&context, async |backend| backend.lines().await)?),
        _ => {
            let (mut all, mut down) = ask(&context, async |backend| {
                let all = backend.modules().await?;
                // A daemon retries its ports by itself; here they were tried and could not be
                // opened.
                let down = match backend.is_daemon() {
                    true => Vec::new(),
                    false => backend.lines_down().await?,
                };
                Ok((all, down))
            })?;
            let wanted = |name: &String| context.line.as_ref().is_none_or(|line| line == name);
            all.retain(|module| wanted(&module.line));
            down.retain(|(line, _)| wanted(&line.line));
            out::result(lang, &modules(lang, &all).render(context.format))?;
            return shut(&context, &down);
        }
    };
    out::result(lang, &records.render(context.format))
}

/// The failure for lines that could not be opened; reports each of them.
fn shut(context: &Context, down: &[(LineInfo, Problem)]) -> Result<(), Failure> {
    let Some(((_, last), others)) = down.split_last() else {
        return Ok(());
    };
    for (_, why) in others {
        let paint = Paint::of(context.colour, &std::io::stderr());
        let failure = context.failure(why);
        out::note(&failure.tell(context.lang, context.format, paint, width::of_errors()));
    }
    Err(context.failure(last))
}

/// Asks the daemon or the site opened here.
fn ask<T>(
    context: &Context,
    question: impl AsyncFnOnce(&Backend) -> Result<T, Problem>,
) -> Result<T, Failure> {
    context.block(async {
        let mut stop = stop::Stop::new(context)?;
        let backend = context.open().await?;
        let answer = stop.or(question(&backend)).await;
        backend.finish(true).await;
        answer
            .ok_or_else(|| stop::interrupted(context))?
            .map_err(|problem| context.failure(&problem))
    })
}

fn modules(lang: Lang, modules: &[ModuleInfo]) -> Records {
    let head = lang.get(Text::LsModulesHead).split('|');
    // The order in which columns are dropped: line, protocol, errors, round trip, model, inputs,
    // name, address, outputs.
    let mut table = Table::new(head)
        .spare(&[2, 4, 8, 7, 5, 10, 1, 3, 9])
        .names(1);
    for module in modules {
        let rtt = module
            .rtt_ms
            .map(|rtt| time::duration(lang, rtt.round() as u64));
        let late = lang.fill(Text::Late, &[("late", &module.late_1h)]);
        let errors = match module.late_1h {
            0 => module.errors_1h.to_string(),
            _ => format!("{} {late}", module.errors_1h),
        };
        table.add([
            module.module.clone(),
            values::called(lang, &module.name),
            module.line.clone(),
            Address(module.address).to_string(),
            module.protocol.clone(),
            module.title.clone(),
            state(lang, module),
            rtt.unwrap_or_else(dash),
            errors,
            bits(&module.outputs),
            bits(&module.inputs),
        ]);
    }
    Records {
        key: "modules",
        rows: json_of(modules),
        columns: &[
            "module",
            "line",
            "address",
            "protocol",
            "model",
            "state",
            "rtt_ms",
            "errors_1h",
            "outputs",
            "inputs",
            "last_good",
        ],
        value: "module",
        table,
    }
}

/// Whether the module answers, and if not, when it last did.
fn state(lang: Lang, module: &ModuleInfo) -> String {
    let state = values::presence(lang, module.state);
    if let Some(found) = &module.answers_as {
        return format!("{state} ({found})");
    }
    match &module.last_good {
        Some(moment) => {
            let time = time::clock_of(Some(moment));
            lang.fill(Text::LastGood, &[("state", &state), ("time", &time)])
        }
        None => state.to_owned(),
    }
}

fn lines(lang: Lang, lines: &[LineInfo]) -> Records {
    let head = lang.get(Text::LsLinesHead).split('|');
    // Columns that may be dropped: modules, settings, port, name.
    let mut table = Table::new(head).spare(&[5, 3, 2, 1]).names(1);
    for line in lines {
        let state = lang.get(match line.state {
            PortState::Opening => Text::PortOpening,
            PortState::Up => Text::PortUp,
            PortState::Absent => Text::PortAbsent,
            PortState::Busy => Text::PortBusy,
            PortState::Closed => Text::PortClosed,
        });
        let why = line.holder.as_ref().or(line.reason.as_ref());
        let state = match why {
            Some(why) => format!("{state} ({why})"),
            None => state.to_owned(),
        };
        table.add([
            line.line.clone(),
            values::called(lang, &line.name),
            line.port.clone(),
            format!("{} {}", line.baud, line.format),
            state,
            line.modules.join(" "),
        ]);
    }
    Records {
        key: "lines",
        rows: json_of(lines),
        columns: &["line", "port", "baud", "format", "state", "reason"],
        value: "line",
        table,
    }
}

pub(super) fn json_of<T: serde::Serialize>(rows: &[T]) -> Vec<serde_json::Value> {
    let json = |row| serde_json::to_value(row).unwrap_or_default();
    rows.iter().map(json).collect()
}

fn dash() -> String {
    "–".to_owned()
}

fn bits(bits: &str) -> String {
    if bits.is_empty() {
        dash()
    } else {
        bits.to_owned()
    }
}
