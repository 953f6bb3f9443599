//! `railbus export`: the configuration in forms for other tools, a file of the folder each.
//!
//! Forms for people and scripts are tables like those of any command: `csv`, `mbpoll`. Those for a
//! program are a file for it ([`File`]): `ha`, `nodered`, `telegraf`, `prometheus`, `grafana`.
//! What they share: `asked`, the flags and the outlet that they are about; `quote`, texts within
//! texts; `yaml`.

mod asked;
mod csv;
mod grafana;
mod ha;
mod mbpoll;
mod nodered;
mod prometheus;
mod quote;
mod telegraf;
#[cfg(test)]
mod tests;
mod texts;
mod yaml;

use super::Context;
use crate::args;
use asked::Asked;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_words::Lang;
use serde_json::json;
use texts::ExportText;

/// The name of the command.
pub(crate) const NAME: &str = "export";

/// The forms.
const FORMS: [&str; 7] = [
    "csv",
    "grafana",
    "ha",
    "mbpoll",
    "nodered",
    "prometheus",
    "telegraf",
];

/// A file for another program.
#[derive(Debug, PartialEq)]
struct File {
    text: String,
    /// What its user has to do besides putting it in its place.
    notes: Vec<String>,
}

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, ExportText::About, "railbus export FORM [FLAGS]")
        .before_help(args::examples(lang, ExportText::Examples))
        .arg(
            Arg::new("FORM")
                .help(lang.get(ExportText::Form))
                .value_parser(FORMS)
                .hide_possible_values(true)
                .required(true),
        )
        .arg(
            args::flag(lang, "url", ExportText::Url)
                .value_name("URL")
                .value_parser(asked::url)
                .default_value(asked::URL)
                .hide_default_value(true),
        )
        .arg(args::flag(lang, "outlet", ExportText::Outlet).value_name("NAME"))
        .arg(args::flag(lang, "site", ExportText::Site).value_name("NAME"))
        .arg(args::flag(lang, "http", ExportText::Http).action(ArgAction::SetTrue))
        .arg(args::flag(lang, "rules", ExportText::Rules).action(ArgAction::SetTrue))
}

/// Prints it.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let (path, _) = context.config()?;
    let found = config_file::read(lang, Some(&path));
    let found = found.map_err(|problem| context.failure(&problem))?;
    let form = matches.get_one::<String>("FORM").map(String::as_str);
    let asked = Asked::of(&context, matches, &found);
    let file = match form {
        Some("ha") => ha::file(&asked)?,
        Some("nodered") => nodered::file(&asked)?,
        Some("telegraf") => telegraf::file(&asked),
        Some("prometheus") if matches.get_flag("rules") => prometheus::rules(&asked),
        Some("prometheus") => prometheus::file(&asked),
        Some("grafana") => grafana::file(&asked),
        Some("csv") => {
            // The name of the export says its format; only JSON can be chosen instead.
            let format = match context.format {
                format if format.is_json() => format,
                _ => Format::Csv,
            };
            return out::result(lang, &csv::points(&found.config).render(format));
        }
        _ => return mbpoll::print(&context, &found.config),
    };
    out::result(
        lang,
        &match context.format.is_json() {
            true => records::line(json!({ "form": form, "text": file.text })),
            false => file.text,
        },
    )?;
    for note in &file.notes {
        context.note(note);
    }
    Ok(())
}
