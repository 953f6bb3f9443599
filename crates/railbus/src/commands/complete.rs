//! `railbus complete`: the names that fit at the end of a command line. The completion scripts
//! ask this; it reads the configuration and nothing else, gives up after 100 ms, and is silent
//! where something is wrong.

use crate::cli;
use crate::commands::help::TOPICS;
use crate::commands::schema::SCHEMAS;
use crate::config_file;
use crate::failure::{Code, Failure, findings};
use crate::i18n::Lang;
use crate::render::out;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_site::Config;
use std::path::PathBuf;
use std::sync::mpsc;
use std::time::Duration;

/// The name of the command.
pub(crate) const NAME: &str = "complete";

/// Nobody waits longer for a name.
const PATIENCE: Duration = Duration::from_millis(100);

/// Its parser; it is not for people.
pub(crate) fn define(lang: Lang) -> Command {
    cli::verb(lang, NAME, Text::CompleteAbout, "railbus complete -- WORD…")
        .hide(true)
        .arg(
            Arg::new("WORD")
                .help(lang.get(Text::CompleteWords))
                .num_args(0..)
                .allow_hyphen_values(true)
                .trailing_var_arg(true),
        )
}

/// Prints the names, one to a line.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let words = matches.get_many::<String>("WORD").into_iter().flatten();
    let words: Vec<String> = words.cloned().collect();
    let (sender, names) = mpsc::channel();
    // A file on a network that hangs must not hang the shell.
    std::thread::spawn(move || sender.send(candidates(lang, &words)));
    let names = names.recv_timeout(PATIENCE).unwrap_or_default();
    let lines = names.into_iter().map(|name| name + "\n");
    out::result(lang, &lines.collect::<String>())
}

/// What fits for the last of the words, which may be empty or begun.
fn candidates(lang: Lang, words: &[String]) -> Vec<String> {
    let Some((current, before)) = words.split_last() else {
        return Vec::new();
    };
    let before: Vec<&str> = before.iter().map(String::as_str).collect();
    let verb = before
        .iter()
        .copied()
        .find(|word| cli::names().any(|name| name == *word));
    let config = || configuration(lang, &before);
    let all: Vec<String> = match (before.last().copied(), verb) {
        (Some("-l" | "--line"), _) => config().lines.into_keys().collect(),
        (_, Some("get" | "watch" | "wait" | "history" | "read")) => {
            points(&config(), current, |_| true)
        }
        (_, Some("set" | "pulse" | "write")) => points(&config(), current, |point| {
            point.kind == railbus_device::PointKind::Output
        }),
        (Some("run"), Some("scene")) => config().scenes.into_keys().collect(),
        (_, Some("config" | "plan" | "apply")) if !current.starts_with('-') => {
            config().modules.into_keys().collect()
        }
        (_, Some("doctor")) => codes_of_findings().collect(),
        (_, Some("explain")) => {
            let codes = Code::all().map(|code| code.name().to_owned());
            codes.chain(codes_of_findings()).collect()
        }
        (_, Some("schema")) => SCHEMAS.iter().map(|(name, _)| (*name).to_owned()).collect(),
        (_, Some("help")) => cli::names().chain(TOPICS).map(str::to_owned).collect(),
        _ => Vec::new(),
    };
    all.into_iter()
        .filter(|name| name.starts_with(current.as_str()))
        .collect()
}

fn codes_of_findings() -> impl Iterator<Item = String> {
    findings::ALL.iter().map(|finding| finding.code.to_owned())
}

/// Modules, and the points of a module that is named so far.
fn points(
    config: &Config,
    current: &str,
    wanted: impl Fn(&railbus_device::Point) -> bool,
) -> Vec<String> {
    let labels = |(name, module): (&String, &railbus_site::config::ModuleConfig)| {
        let setup = module.setup;
        let points = setup.points().filter(|point| wanted(point));
        let paths = points.map(|point| {
            let (prefix, number) = setup.label(point);
            format!("{name}.{prefix}{number}")
        });
        paths.collect::<Vec<_>>()
    };
    match current.split_once('.') {
        Some((module, _)) => {
            let named = config.modules.get_key_value(module);
            named.map(labels).unwrap_or_default()
        }
        None => config
            .modules
            .keys()
            .cloned()
            .chain(config.modules.iter().flat_map(labels))
            .collect(),
    }
}

/// The configuration that the words so far mean; an empty one where there is none to be read.
fn configuration(lang: Lang, before: &[&str]) -> Config {
    let at = before.iter().position(|word| *word == "--config");
    let named = at.and_then(|at| before.get(at + 1)).map(PathBuf::from);
    let found = config_file::read(lang, named.as_deref());
    found.map(|found| found.config).unwrap_or_default()
}
