//! `railbus replay`: plays a capture back, as host or as modules.

mod host;
mod module;
mod script;
mod texts;

use super::{Context, place};
use crate::args;
use clap::{Arg, ArgAction, ArgGroup, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::Format;
use railbus_commission::Risk;
use railbus_wire::Exchange;
use railbus_words::Code;
use railbus_words::Lang;
use script::Script;
use std::path::PathBuf;
use texts::ReplayText;

/// The name of the command.
pub(crate) const NAME: &str = "replay";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let set = |name, help| args::flag(lang, name, help).action(ArgAction::SetTrue);
    let usage = "railbus replay FILE --as-module|--as-host [-l LINE] [--speed N] [--loop]";
    args::verb(lang, NAME, ReplayText::ReplayAbout, usage)
        .before_help(args::examples(lang, ReplayText::ReplayExamples))
        .arg(
            Arg::new("FILE")
                .help(lang.get(ReplayText::File))
                .required(true)
                .value_parser(value_parser!(PathBuf)),
        )
        .arg(set("as-module", ReplayText::AsModule))
        .arg(set("as-host", ReplayText::AsHost))
        .group(
            ArgGroup::new("as")
                .args(["as-module", "as-host"])
                .required(true),
        )
        .arg(
            args::flag(lang, "speed", ReplayText::Speed)
                .value_name("N")
                .value_parser(speed),
        )
        .arg(set("loop", ReplayText::Loop))
        .arg(
            args::flag(lang, "count", ReplayText::Count)
                .value_name("N")
                .value_parser(value_parser!(u64).range(1..))
                .requires("as-module"),
        )
        .arg(set("writes", ReplayText::Writes).requires("as-host"))
        .arg(set("yes", ReplayText::Yes).requires("writes"))
        .arg(
            args::flag(lang, "confirm", ReplayText::Confirm)
                .value_name("WORD")
                .value_parser(["broadcast", "config"])
                .hide_possible_values(true)
                .action(ArgAction::Append)
                .requires("writes"),
        )
        .arg(set("exit-code", ReplayText::ExitCode).requires("as-host"))
}

/// From a thousandth to a thousand times the recorded pace.
fn speed(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| String::new())?;
    let sensible = (0.001..=1_000.0).contains(&number);
    sensible.then_some(number).ok_or_else(String::new)
}

/// A time in microseconds, scaled by the speed.
fn faster(micros: u64, speed: f64) -> u64 {
    (micros as f64 / speed) as u64
}

/// What the host may send.
#[derive(Clone, Copy, Debug)]
struct Allowed {
    writes: bool,
    kept: bool,
    all: bool,
}

impl Allowed {
    fn covers(self, asked: &Exchange<'_>) -> bool {
        match Risk::of(asked) {
            Risk::Read => true,
            Risk::Output => self.writes,
            Risk::Kept => self.writes && self.kept,
            Risk::All => self.writes && self.all,
        }
    }
}

/// Plays it back.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let confirmed: Vec<&str> = matches
        .get_many::<String>("confirm")
        .into_iter()
        .flatten()
        .map(String::as_str)
        .collect();
    let allowed = Allowed {
        writes: matches.get_flag("writes"),
        kept: confirmed.contains(&"config"),
        all: confirmed.contains(&"broadcast"),
    };
    if allowed.writes && !matches.get_flag("yes") {
        let message = lang.get(ReplayText::NeedsYesWrites).to_owned();
        return Err(
            Failure::new(Code::NeedsYes, message).with_try("railbus replay … --writes --yes")
        );
    }
    let path: Option<&PathBuf> = matches.get_one("FILE");
    let script = Script::read(&context, path.map_or("".as_ref(), PathBuf::as_path))?;
    let mut place = place::without_opening(&context)?;
    if context
        .options
        .ad_hoc
        .as_ref()
        .is_some_and(|flags| flags.baud.is_none())
    {
        place.settings = script.settings;
    }
    let speed = matches.get_one::<f64>("speed").copied().unwrap_or(1.0);
    let round = matches.get_flag("loop");
    if matches.get_flag("as-module") {
        let count = matches.get_one::<u64>("count").copied();
        return context.block(module::play(
            &context,
            &place,
            &script,
            (speed, round, count),
        ));
    }
    let played = host::play(&context, &place, &script, (speed, round), allowed);
    let ends = context.block(played)?;
    let values: &[(&str, &dyn std::fmt::Display)] = &[
        ("same", &ends.same),
        ("differ", &ends.differ),
        ("skipped", &ends.skipped),
    ];
    let summary = lang.fill(ReplayText::Summary, values);
    if ends.differ > 0 && matches.get_flag("exit-code") {
        return Err(Failure::of(lang, Code::RepliesDiffer).because(summary));
    }
    if context.format == Format::Table {
        context.note(&summary);
    }
    Ok(())
}
