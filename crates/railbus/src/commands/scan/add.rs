//! Adds the modules found to the configuration, if the user wants that.

use super::options::Options;
use super::texts::ScanText;
use crate::backend::DaemonClient;
use crate::commands::Context;
use crate::commands::place::Place;
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::scan::setup;
use railbus_commission::scan::FoundModule;
use railbus_device::Setup;
use railbus_site::Config;
use railbus_site::config::add::{NewLine, free_name, with_modules};
use railbus_site::config::edit;
use railbus_words::Code;
use std::io::{self, BufRead, IsTerminal, Write};
use std::path::{Path, PathBuf};

/// The name of a line of which only the port is known.
const LINE: &str = "main";

/// Adds the modules that are new and whose model is known.
pub(super) fn add(
    context: &Context,
    place: &Place,
    found: &[FoundModule],
    options: &Options,
) -> Result<(), Failure> {
    let lang = context.lang;
    let failed = |file: &Path, why: &dyn std::fmt::Display| {
        Failure::of(lang, Code::ScanNotWritten).because(format!("{}: {why}", file.display()))
    };
    let (file, before, daemon) = file(context)?;
    let config = Config::parse(&before).unwrap_or_default();
    let by_port = config.lines.iter();
    let port = place.port.to_string();
    let by_port = by_port
        .filter(|(_, line)| line.port == port)
        .map(|(name, _)| name.clone());
    let named = config
        .lines
        .contains_key(&place.line)
        .then(|| place.line.clone());
    let name = named.or_else(|| by_port.into_iter().next());
    let name = name.unwrap_or_else(|| line_name(&config, &place.line));
    let modules = new_modules(&config, &name, found, options);
    if modules.is_empty() {
        context.note(lang.get(ScanText::NothingNew));
        return Ok(());
    }
    let line = NewLine {
        name: &name,
        port: &port,
        serial: place.settings,
    };
    let after = with_modules(&before, line, &modules);
    let after = after.ok_or_else(|| failed(&file, &lang.get(ScanText::NotRightText)))?;
    if !options.yes && !confirmed(context, &file, &before, &after)? {
        context.note(lang.get(ScanText::NotWritten));
        return Ok(());
    }
    match daemon {
        // The daemon also applies the new modules.
        Some(daemon) => context.block(async {
            let written = daemon.replace_config(&before, &after).await;
            written.map_err(|problem| context.failure(&problem))
        })?,
        None => {
            let written = edit::replace(&file, Some(&before), &after);
            written.map_err(|error| failed(&file, &error))?;
        }
    }
    let names: Vec<&str> = modules.iter().map(|(name, _)| name.as_str()).collect();
    let (names, file) = (names.join(", "), file.display());
    context.note(&lang.fill(ScanText::Written, &[("names", &names), ("file", &file)]));
    let boards = modules.iter();
    let boards = boards.filter(|(_, setup)| setup.family.datasheet().channels_vary);
    if let (None, Some((_, first))) = (options.outputs, boards.clone().next()) {
        let names: Vec<&str> = boards.map(|(name, _)| name.as_str()).collect();
        let names = names.join(", ");
        let told: [(&str, &dyn std::fmt::Display); 2] =
            [("names", &names), ("count", &first.outputs)];
        context.note(&lang.fill(ScanText::OutputsGuessed, &told));
    }
    Ok(())
}

/// The configuration, its text, and the daemon that uses it; a new configuration if there is none.
fn file(context: &Context) -> Result<(PathBuf, String, Option<DaemonClient>), Failure> {
    let (path, daemon) = match context.block(context.files()) {
        Ok(files) => (files.config, files.daemon),
        Err(failure) if failure.code() == Code::NoConfig => (config_file::NAME.into(), None),
        Err(failure) => return Err(failure),
    };
    if !path.is_file() {
        return Ok((path, String::new(), daemon));
    }
    let text = config_file::text_of(&path).map_err(|problem| context.failure(&problem))?;
    // A file with problems is reported, and left alone.
    let read = config_file::read(context.lang, Some(&path));
    read.map_err(|problem| context.failure(&problem))?;
    Ok((path, text, daemon))
}

/// A name for a line that is not in the file yet.
fn line_name(config: &Config, line: &str) -> String {
    let is_slug = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let fits = !line.is_empty() && line.len() <= 32 && line.chars().all(is_slug);
    if fits {
        return line.to_owned();
    }
    let numbered = (2..).map(|number: u32| format!("{LINE}_{number}"));
    let mut names = std::iter::once(LINE.to_owned()).chain(numbered);
    let free = names.find(|name| !config.lines.contains_key(name));
    free.unwrap_or_else(|| LINE.to_owned())
}

/// Modules of a known family, at addresses that nothing in the file has.
fn new_modules(
    config: &Config,
    line: &str,
    found: &[FoundModule],
    options: &Options,
) -> Vec<(String, Setup)> {
    let mut modules: Vec<(String, Setup)> = Vec::new();
    let mut sorted: Vec<&FoundModule> = found.iter().collect();
    sorted.sort_by_key(|found| found.asked.address);
    for found in sorted {
        let Some(mut setup) = setup(found, options.model) else {
            continue;
        };
        if setup.family.datasheet().channels_vary {
            setup.outputs = options.outputs.unwrap_or(setup.outputs);
        }
        let same =
            |other: &Setup| other.address == setup.address && other.protocol == setup.protocol;
        let is_known = config
            .modules_of(line)
            .any(|(_, module)| same(&module.setup));
        if !is_known && !modules.iter().any(|(_, other)| same(other)) {
            modules.push((free_name(config, &modules, &setup), setup));
        }
    }
    modules
}

/// Shows what would be written, and asks.
fn confirmed(context: &Context, file: &Path, before: &str, after: &str) -> Result<bool, Failure> {
    let lang = context.lang;
    out::note(&lang.fill(ScanText::WillWrite, &[("file", &file.display())]));
    let new = after.strip_prefix(before).unwrap_or(after);
    for line in new.trim().lines() {
        out::note(&format!("  {line}"));
    }
    if !io::stdin().is_terminal() {
        return Err(Failure::of(lang, Code::NeedsAnswer).with_try("railbus scan --add --yes"));
    }
    let _ = write!(io::stderr(), "{}", lang.get(ScanText::AskWrite));
    let mut answer = String::new();
    let _ = io::stdin().lock().read_line(&mut answer);
    Ok(matches!(answer.trim(), "y" | "yes" | "是" | "好"))
}
