//! `railbus config check` and `config path`: errors and warnings of the configuration, and which
//! file it is.

mod texts;

pub(super) use texts::ConfigCheckText;

use super::Context;
use crate::args;
use clap::{ArgMatches, Command};
use railbus_app::config_check::{Shown, lints, loads};
use railbus_app::config_file::{self, ConfigOrigin, FoundConfig};
use railbus_app::failure::Failure;
use railbus_app::machine::Machine;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, records};
use railbus_site::Config;
use railbus_site::config::load_percent;
use railbus_words::Lang;
use serde_json::{Value, json};
use std::fmt::Display;

/// The names of the commands.
pub(super) const CHECK: &str = "check";
pub(super) const PATH: &str = "path";

pub(super) fn define_check(lang: Lang) -> Command {
    args::verb(
        lang,
        CHECK,
        ConfigCheckText::CheckAbout,
        "railbus config check [--config FILE]",
    )
    .before_help(args::examples(lang, ConfigCheckText::CheckExamples))
}

pub(super) fn define_path(lang: Lang) -> Command {
    args::verb(
        lang,
        PATH,
        ConfigCheckText::PathAbout,
        "railbus config path",
    )
}

/// Prints the warnings; errors make the command fail.
pub(super) fn run_check(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let found = read(&context)?;
    let text = config_file::text_of(&found.path).map_err(|problem| context.failure(&problem))?;
    let warnings = lints(&Machine::this(), &found.config);
    let shown: Vec<Shown> = warnings.iter().map(|w| Shown::of(lang, &text, w)).collect();
    let file = found.path.display().to_string();
    match context.format {
        Format::Json | Format::Ndjson => out::result(
            lang,
            &records::line(json!({
                "file": file, "lines": load_rows(&found.config),
                "warnings": shown.iter().map(|warning| warning.json(&file)).collect::<Vec<_>>(),
            })),
        ),
        Format::Table => {
            let rows = page(lang, &file, &shown);
            out::result(
                lang,
                &format!(
                    "{rows}{}\n",
                    summary(lang, &file, &found.config, shown.len())
                ),
            )
        }
        format => out::result(lang, &listed(&file, &shown).render(format)),
    }
}

/// Prints where the configuration is, and which places take precedence.
pub(super) fn run_path(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let (path, why) = context.config()?;
    let told = lang.get(match why {
        ConfigOrigin::Flag => ConfigCheckText::ByFlag,
        ConfigOrigin::Environment => ConfigCheckText::ByEnvironment,
        ConfigOrigin::Place => ConfigCheckText::ByPlace,
        ConfigOrigin::Daemon => ConfigCheckText::ByDaemon,
    });
    let path = path.display().to_string();
    let mut table = Table::bare();
    table.add([path.clone(), told.to_owned()]);
    let records = Records {
        key: "paths",
        rows: vec![json!({ "path": path, "why": why.name() })],
        columns: &["path", "why"],
        value: "path",
        table,
    };
    out::result(lang, &records.render(context.format))
}

fn read(context: &Context) -> Result<FoundConfig, Failure> {
    let (path, _) = context.config()?;
    let found = railbus_gateway::read_config(context.lang, Some(&path));
    found.map_err(|problem| context.failure(&problem))
}

/// The load of each line, for programs.
fn load_rows(config: &Config) -> Vec<Value> {
    let names = config.lines.keys();
    names
        .map(|name| {
            let modules = config.modules_of(name).map(|(_, module)| module);
            json!({ "line": name, "load_percent": load_percent(modules) })
        })
        .collect()
}

/// Each warning and what to do about it, for people.
fn page(lang: Lang, file: &str, shown: &[Shown]) -> String {
    let label = lang.get(railbus_app::texts::AppText::Try);
    let block = |warning: &Shown| {
        let (code, at, path) = (warning.code, warning.at(file), &warning.path);
        let (message, next) = (&warning.message, &warning.next);
        format!("! {code} {at}: {path}\n       {message}\n       {label} {next}\n")
    };
    shown.iter().map(block).collect()
}

fn listed(file: &str, shown: &[Shown]) -> Records {
    Records {
        key: "warnings",
        rows: shown.iter().map(|warning| warning.json(file)).collect(),
        columns: &["code", "file", "line", "column", "path", "message"],
        value: "code",
        table: Table::bare(),
    }
}

/// One line: the size of the site, the load of its lines, and the number of warnings.
fn summary(lang: Lang, file: &str, config: &Config, warnings: usize) -> String {
    let (modules, loads) = (config.modules.len(), loads(lang, config));
    let values: &[(&str, &dyn Display)] = &[
        ("file", &file),
        ("modules", &modules),
        ("loads", &loads),
        ("warnings", &warnings),
    ];
    lang.fill(ConfigCheckText::Summary, values)
}
