//! `railbus pulse`: switches an output on for a time.

use super::context::far_flag;
use super::{Context, set, stop};
use crate::args;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_api::types::{PulseRequest, Pulsed, Timekeeper};
use railbus_app::failure::Failure;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, values};
use railbus_wire::Micros;
use railbus_words::Lang;
use railbus_words::time;

/// The name of the command.
pub(crate) const NAME: &str = "pulse";

/// The columns in CSV.
const PULSED: [&str; 7] = [
    "path",
    "value",
    "before",
    "by",
    "ms",
    "confirmed",
    "took_ms",
];
/// Longer pulses that are timed here cause a warning.
const LONG_MS: u64 = 5_000;

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus pulse POINT [DURATION] [--by auto|device|host] [--off]";
    args::verb(lang, NAME, Text::PulseAbout, usage)
        .before_help(args::examples(lang, Text::PulseExamples))
        .arg(far_flag(lang))
        .arg(
            Arg::new("POINT")
                .help(lang.get(Text::PulsePoint))
                .required(true),
        )
        .arg(
            Arg::new("DURATION")
                .help(lang.get(Text::PulseDuration))
                .value_parser(super::context::duration),
        )
        .arg(
            args::flag(lang, "by", Text::PulseBy)
                .value_name("WHO")
                .value_parser(["auto", "device", "host"])
                .hide_possible_values(true),
        )
        .arg(args::flag(lang, "off", Text::PulseOff).action(ArgAction::SetTrue))
        .arg(args::flag(lang, "yes", Text::MeantYes).action(ArgAction::SetTrue))
}

/// Starts the pulse, and waits for its end if it is timed here.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let path = matches
        .get_one::<String>("POINT")
        .cloned()
        .unwrap_or_default();
    let by = match matches.get_one::<String>("by").map(String::as_str) {
        Some("device") => Timekeeper::Device,
        Some("host") => Timekeeper::Host,
        _ => Timekeeper::Auto,
    };
    let duration: Option<Micros> = matches.get_one("DURATION").copied();
    let wanted = PulseRequest {
        ms: duration.map(|duration| duration.0.div_ceil(1_000)),
        by,
        off: matches.get_flag("off"),
        confirm: matches.get_flag("yes"),
        within_ms: None,
    };
    context.block(give(&context, &path, wanted))
}

async fn give(context: &Context, path: &str, wanted: PulseRequest) -> Result<(), Failure> {
    let mut stop = stop::Stop::new(context)?;
    let backend = context.open().await?;
    let pulsed = match backend.pulse(path, wanted).await {
        Ok(pulsed) => pulsed,
        Err(problem) => {
            backend.finish(true).await;
            return Err(context.failure(&problem));
        }
    };
    let timed_here = pulsed.by == Timekeeper::Host && !backend.is_daemon();
    if timed_here && pulsed.ms.is_some_and(|millis| millis > LONG_MS) {
        context.note(context.lang.get(Text::PulseHere));
    }
    let shown = show(context, path, &pulsed);
    // A program that waits for this line may act on it, so it is printed as soon as the pulse has
    // begun.
    let told = out::result(context.lang, &shown);
    if !timed_here {
        backend.finish(true).await;
        return told;
    }
    // Waiting is safe: at a signal the output is released at once.
    let released = stop.or(wait(pulsed.ms)).await;
    backend.finish(released.is_none()).await;
    match released {
        Some(()) => told,
        None => {
            let values: &[(&str, &dyn std::fmt::Display)] = &[("path", &path)];
            let note = context.lang.fill(Text::PulseReleased, values);
            Err(stop::interrupted(context).because(note))
        }
    }
}

/// Waits until a pulse timed here has ended.
async fn wait(millis: Option<u64>) {
    let end = std::time::Duration::from_millis(millis.unwrap_or_default());
    tokio::time::sleep_until(tokio::time::Instant::now() + end).await;
}

fn show(context: &Context, path: &str, pulsed: &Pulsed) -> String {
    let lang = context.lang;
    if context.format != Format::Table {
        return match context.format {
            Format::Value => format!("{}\n", pulsed.ms.unwrap_or_default()),
            Format::Csv => set::rows(&PULSED, path, pulsed),
            _ => set::document(path, pulsed),
        };
    }
    if context.quiet {
        return String::new();
    }
    let by = lang.get(match pulsed.by {
        Timekeeper::Host => Text::TimedByHost,
        Timekeeper::Device | Timekeeper::Auto => Text::TimedByDevice,
    });
    let width = pulsed.ms.map(|millis| time::duration(lang, millis));
    let mut table = Table::bare();
    table.add([
        path.to_owned(),
        format!("→ {}", values::state(lang, pulsed.value)),
        width.unwrap_or_default(),
        by.to_owned(),
        values::confirmed(lang, pulsed.confirmed).to_owned(),
        time::duration(lang, pulsed.took_ms),
    ]);
    table.render()
}
