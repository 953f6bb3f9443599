//! `railbus sim`: simulated lines in real time, for any master: the demo line, or the plant of a
//! configuration.

mod ctl;
mod texts;

use crate::args;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgGroup, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::Format;
use railbus_plant::{DemoOptions, plant};
use railbus_words::Lang;
use std::path::{Path, PathBuf};
use texts::SimFlagText;

/// The name of the command.
pub(crate) const NAME: &str = "sim";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus sim PLANT.toml | --demo | ctl SOCKET ORDER";
    let many = |name, help| args::flag(lang, name, help).action(ArgAction::Append);
    let of_plant = |arg: Arg| arg.conflicts_with("demo");
    args::verb(lang, NAME, SimFlagText::About, usage)
        .before_help(args::examples(lang, SimFlagText::Examples))
        .after_help(lang.get(SimFlagText::Guide))
        .subcommand(ctl::define(lang))
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand_negates_reqs(true)
        .args_conflicts_with_subcommands(true)
        .arg(
            Arg::new("FILE")
                .help(lang.get(SimFlagText::File))
                .value_parser(value_parser!(PathBuf)),
        )
        .arg(args::flag(lang, "demo", SimFlagText::Demo).action(ArgAction::SetTrue))
        .group(ArgGroup::new("what").args(["FILE", "demo"]).required(true))
        .arg(many("pty", SimFlagText::Pty).value_name("[LINE=]PATH"))
        .arg(many("tcp", SimFlagText::Tcp).value_name("[LINE=]ADDR"))
        .arg(
            args::flag(lang, "seed", SimFlagText::Seed)
                .value_name("N")
                .value_parser(value_parser!(u64)),
        )
        .arg(of_plant(
            args::flag(lang, "speed", SimFlagText::Speed)
                .value_name("F")
                .value_parser(speed),
        ))
        .arg(of_plant(
            many("fault", SimFlagText::FaultFlag).value_name("WHO: WHAT"),
        ))
        .arg(of_plant(
            args::flag(lang, "control", SimFlagText::Control)
                .value_name("PATH")
                .value_parser(value_parser!(PathBuf)),
        ))
        .arg(of_plant(
            args::flag(lang, "state", SimFlagText::State)
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf)),
        ))
}

/// How many times faster than real time.
fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok();
    speed
        .filter(|speed| (0.01..=1_000.0).contains(speed))
        .ok_or_else(String::new)
}

/// Serves the lines until it is stopped.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    if let Some((ctl::NAME, matches)) = matches.subcommand() {
        return ctl::run(lang, matches);
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| railbus_plant::system(lang, error))?;
    match matches.get_one::<PathBuf>("FILE") {
        Some(file) => runtime.block_on(plant::run(lang, &plant_wanted(file, matches))),
        None => runtime.block_on(railbus_plant::serve_demo(lang, &demo_wanted(matches))),
    }
}

fn texts_of(matches: &ArgMatches, name: &str) -> Vec<String> {
    let all = matches.get_many::<String>(name);
    all.into_iter().flatten().cloned().collect()
}

fn plant_wanted(file: &Path, matches: &ArgMatches) -> plant::PlantOptions {
    plant::PlantOptions {
        file: file.to_owned(),
        ptys: texts_of(matches, "pty"),
        tcps: texts_of(matches, "tcp"),
        seed: matches.get_one("seed").copied(),
        speed: matches.get_one("speed").copied(),
        faults: texts_of(matches, "fault"),
        control: matches.get_one("control").cloned(),
        state: matches.get_one("state").cloned(),
        verbose: matches.get_count("verbose") > 0,
        json: for_programs(matches),
    }
}

fn for_programs(matches: &ArgMatches) -> bool {
    let format = matches.get_one::<String>("output");
    let format = format.and_then(|name| Format::from_name(name));
    format.is_some_and(Format::is_json)
}

fn demo_wanted(matches: &ArgMatches) -> DemoOptions {
    DemoOptions {
        pty: texts_of(matches, "pty").pop().map(PathBuf::from),
        tcp: texts_of(matches, "tcp").pop(),
        seed: matches.get_one("seed").copied().unwrap_or_default(),
        verbose: matches.get_count("verbose") > 0,
        json: for_programs(matches),
    }
}
