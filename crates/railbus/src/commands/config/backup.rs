//! `railbus config backup`: everything readable of every module, in one file.

use super::config_context::{ConfigContext, state_flag};
use super::show::{read_all, words};
use super::texts::ConfigText;
use crate::args;
use crate::commands::Context;
use clap::{Arg, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::settings::target::Target;
use railbus_commission::Found;
use railbus_commission::settings::{Access, settings, shown};
use railbus_site::config::edit;
use railbus_words::Code;
use railbus_words::Lang;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The name of the command.
pub(super) const NAME: &str = "backup";
/// The version of the file format.
pub(super) const SCHEMA: u64 = 1;
/// The `kind` in the file, which identifies it.
pub(super) const KIND: &str = "railbus backup";

/// A backup, as it is stored in the file.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Backup {
    pub(super) kind: String,
    pub(super) schema: u64,
    /// The site's identifier.
    pub(super) site: String,
    pub(super) lines: BTreeMap<String, LineKept>,
    pub(super) modules: BTreeMap<String, ModuleKept>,
}

/// A line of a backup.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct LineKept {
    pub(super) port: String,
    pub(super) baud: u32,
    pub(super) format: String,
}

/// A module of a backup.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct ModuleKept {
    pub(super) line: String,
    pub(super) model: String,
    pub(super) protocol: String,
    /// The product version, if the module reports one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) version: Option<u16>,
    /// Each known setting, as `config set` names it.
    pub(super) settings: BTreeMap<String, String>,
}

pub(super) fn define(lang: Lang) -> Command {
    args::verb(
        lang,
        NAME,
        ConfigText::BackupAbout,
        "railbus config backup [MODULE…] [-O FILE]",
    )
    .before_help(args::examples(lang, ConfigText::BackupExamples))
    .arg(
        Arg::new("MODULE")
            .help(lang.get(ConfigText::Modules))
            .num_args(0..),
    )
    .arg(
        args::flag(lang, "file", ConfigText::BackupTo)
            .short('O')
            .value_name("FILE")
            .value_parser(value_parser!(PathBuf)),
    )
    .arg(state_flag(lang))
}

/// Reads every module and writes the file, or stdout if none is named.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let targets = cfg.targets(&context, &words(matches, "MODULE"))?;
    let (founds, failed) = context.block(async { Ok(read_all(&context, targets).await) })?;
    if founds.is_empty() {
        return failed.map_or(Ok(()), Err);
    }
    let of_line = |name: &String| founds.iter().any(|(target, _)| target.line == *name);
    let lines = cfg.config.lines.iter().filter(|(name, _)| of_line(name));
    let backup = Backup {
        kind: KIND.to_owned(),
        schema: SCHEMA,
        site: cfg.site(&context)?,
        lines: lines
            .map(|(name, line)| {
                let kept = LineKept {
                    port: line.port.clone(),
                    baud: line.serial.baud.rate(),
                    format: line.serial.character.to_string(),
                };
                (name.clone(), kept)
            })
            .collect(),
        modules: founds
            .iter()
            .map(|(target, found)| (target.name.clone(), kept(target, found)))
            .collect(),
    };
    // A struct of texts and numbers is always valid JSON.
    let text = serde_json::to_string_pretty(&backup).unwrap_or_default() + "\n";
    match matches.get_one::<PathBuf>("file") {
        None => out::result(lang, &text)?,
        Some(file) => {
            edit::replace(file, None, &text).map_err(|error| {
                Failure::of(lang, Code::Output).because(format!("{}: {error}", file.display()))
            })?;
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("count", &founds.len()), ("file", &file.display())];
            context.note(&lang.fill(ConfigText::BackedUp, values));
        }
    }
    // Modules that could not be read are missing in the file.
    failed.map_or(Ok(()), Err)
}

/// The entry of a module in the backup.
pub(super) fn kept(target: &Target, found: &Found) -> ModuleKept {
    let known = railbus_app::settings::plan::known(target, found);
    let all = settings(&target.setup).into_iter();
    let kept = all
        .filter(|(_, access)| *access != Access::Fixed)
        .filter_map(|(key, _)| Some((key.to_string(), shown(&target.setup, &known, key)?)));
    ModuleKept {
        line: target.line.clone(),
        model: target.setup.family.name().to_owned(),
        protocol: target.setup.protocol.name().to_owned(),
        version: found.version,
        settings: kept.collect(),
    }
}
