//! `railbus plan` and `railbus apply`: compares the settings in the configuration with those stored
//! in the modules.

use super::config_context::{ConfigContext, state_flag};
use super::drive::Driver;
use super::find::{Located, locate};
use super::set::{self, Terms, change_at};
use super::texts::ConfigText;
use crate::args;
use crate::commands::Context;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out};
use railbus_app::settings::outcome::placed;
use railbus_app::settings::target::Target;
use railbus_commission::settings::{Key, Wanted, differences};
use railbus_commission::{BusAddress, ChangeOrigin, Found, Kept};
use railbus_device::Setup;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::{Value, json};
use std::path::PathBuf;

/// The names of the commands.
pub(crate) const NAME: &str = "plan";
pub(crate) const APPLY: &str = "apply";

pub(crate) fn define(lang: Lang) -> Command {
    args::verb(
        lang,
        NAME,
        ConfigText::PlanAbout,
        "railbus plan [MODULE…] [--exit-code]",
    )
    .before_help(args::examples(lang, ConfigText::PlanExamples))
    .arg(
        Arg::new("MODULE")
            .help(lang.get(ConfigText::Modules))
            .num_args(0..),
    )
    .arg(args::flag(lang, "exit-code", ConfigText::ExitCode).action(ArgAction::SetTrue))
    .arg(state_flag(lang))
}

pub(crate) fn define_apply(lang: Lang) -> Command {
    let usage = "railbus apply [--only MODULE] [--yes] [-O report.json]";
    args::verb(lang, APPLY, ConfigText::ApplyAbout, usage)
        .before_help(args::examples(lang, ConfigText::ApplyExamples))
        .arg(
            args::flag(lang, "only", ConfigText::ApplyOnly)
                .value_name("MODULE")
                .action(ArgAction::Append),
        )
        .arg(
            args::flag(lang, "report", ConfigText::ApplyReport)
                .short('O')
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf)),
        )
        .args(set::write_flags(lang))
}

/// The state of one module.
struct Entry {
    target: Target,
    wanted: Wanted,
    found: Result<Option<Found>, Failure>,
}

impl Entry {
    /// What differs: the setting, its present value, and the wanted one.
    fn differences(&self) -> Vec<(Key, String, String)> {
        let Ok(Some(found)) = &self.found else {
            return Vec::new();
        };
        let known = found.kept();
        let wanted = self.wanted.over(&known).unwrap_or(self.wanted.kept);
        differences(&self.target.setup, &known, &wanted)
    }

    fn word(&self) -> &'static str {
        match &self.found {
            Err(_) => "unclear",
            Ok(None) => "missing",
            Ok(Some(_)) if self.differences().is_empty() => "same",
            Ok(Some(_)) => "change",
        }
    }
}

/// The settings that the configuration wants a module to have: its place and its settings table.
fn desired(cfg: &ConfigContext, target: &Target) -> Wanted {
    let setup: &Setup = &target.setup;
    let place = Kept::at(BusAddress::of(setup));
    let settings = cfg
        .config
        .modules
        .get(&target.name)
        .map(|module| module.settings.clone());
    let mut wanted = settings.unwrap_or_default();
    let ascii = setup.protocol == railbus_wire::Protocol::Ascii;
    wanted.kept = Kept {
        checksum: place.checksum.filter(|_| ascii),
        voltage: wanted.kept.voltage,
        ..place
    };
    wanted
}

/// Reads every module.
async fn survey(
    context: &Context,
    cfg: &ConfigContext,
    targets: Vec<Target>,
) -> Result<Vec<Entry>, Failure> {
    let mut entries = Vec::new();
    for same_line in targets.chunk_by(|a, b| a.line == b.line) {
        let Some(first) = same_line.first() else {
            continue;
        };
        let mut driver = Driver::open(context, first, None).await?;
        for target in same_line {
            let found = match locate(context, &mut driver, target, &[]).await {
                Ok(Located::Here(found)) => Ok(Some(found)),
                Ok(Located::Missing) => Ok(None),
                Err(failure) => Err(failure),
            };
            let wanted = desired(cfg, target);
            entries.push(Entry {
                target: target.clone(),
                wanted,
                found,
            });
        }
    }
    Ok(entries)
}

/// Sorts modules by line.
fn by_line(mut targets: Vec<Target>) -> Vec<Target> {
    targets.sort_by(|a, b| (&a.line, &a.name).cmp(&(&b.line, &b.name)));
    targets
}

/// Shows what `apply` would do.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let targets = by_line(cfg.targets(&context, &super::show::words(matches, "MODULE"))?);
    let entries = context.block(survey(&context, &cfg, targets))?;
    show(&context, &entries)?;
    let differs = entries
        .iter()
        .filter(|entry| entry.word() != "same")
        .count();
    if differs > 0 && matches.get_flag("exit-code") {
        return Err(Failure::of(lang, Code::Differs)
            .with_fact("count", differs)
            .told());
    }
    Ok(())
}

fn show(context: &Context, entries: &[Entry]) -> Result<(), Failure> {
    let lang = context.lang;
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for entry in entries {
        let name = entry.target.name.clone();
        let missing = placed(context.lang, BusAddress::of(&entry.target.setup));
        match &entry.found {
            Err(failure) => table.add([
                "!".to_owned(),
                name,
                format!("{} {}", failure.code().name(), failure.message()),
            ]),
            Ok(None) => {
                let values: &[(&str, &dyn std::fmt::Display)] =
                    &[("line", &entry.target.line), ("place", &missing)];
                table.add([
                    "+".to_owned(),
                    name,
                    lang.fill(ConfigText::PlanMissing, values),
                ]);
            }
            Ok(Some(_)) if entry.differences().is_empty() => table.add(["=".to_owned(), name]),
            Ok(Some(_)) => {
                for (key, now, wanted) in entry.differences() {
                    let change = format!("{now} → {wanted}");
                    table.add(["~".to_owned(), name.clone(), key.to_string(), change]);
                }
            }
        }
        rows.push(row(lang, entry));
    }
    let count = |word: &str| entries.iter().filter(|entry| entry.word() == word).count();
    let (change, missing, same, unclear) = (
        count("change"),
        count("missing"),
        count("same"),
        count("unclear"),
    );
    let values: &[(&str, &dyn std::fmt::Display)] = &[
        ("change", &change),
        ("missing", &missing),
        ("same", &same),
        ("unclear", &unclear),
    ];
    table.add([String::new()]);
    let mut text = Records {
        key: "plan",
        rows,
        columns: &["module", "state"],
        value: "state",
        table,
    }
    .render(context.format);
    if context.format == Format::Table {
        text = text.trim_end().to_owned() + "\n" + &lang.fill(ConfigText::PlanSum, values) + "\n";
    }
    out::result(lang, &text)
}

fn row(lang: Lang, entry: &Entry) -> Value {
    let set: serde_json::Map<String, Value> = entry
        .differences()
        .into_iter()
        .map(|(key, now, wanted)| (key.to_string(), json!({ "now": now, "wanted": wanted })))
        .collect();
    let at = match &entry.found {
        Ok(Some(found)) => Some(found.place.address.0),
        _ => None,
    };
    let error = entry
        .found
        .as_ref()
        .err()
        .map(|failure| failure.to_json(lang));
    json!({
        "module": entry.target.name,
        "line": entry.target.line,
        "state": entry.word(),
        "address": at,
        "set": set,
        "error": error,
    })
}

/// The order in which modules are changed: new addresses first, then settings that don't change how
/// the module communicates, and finally speed, parity and checksum.
fn order(entry: &Entry) -> u8 {
    let keys: Vec<Key> = entry
        .differences()
        .into_iter()
        .map(|(key, ..)| key)
        .collect();
    let moves = |key: &Key| matches!(key, Key::Baud | Key::Parity | Key::Checksum);
    match keys.iter().any(moves) {
        true => 2,
        false => u8::from(!keys.contains(&Key::Address)),
    }
}

/// Writes the differences, one module at a time, until one fails.
pub(crate) fn apply(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let targets = by_line(cfg.targets(&context, &super::show::words(matches, "only"))?);
    let terms = Terms::of(matches, ChangeOrigin::Apply);
    let (report, failed) = context.block(async {
        let mut entries = survey(&context, &cfg, targets).await?;
        show(&context, &entries)?;
        entries.sort_by_key(order);
        Ok(apply_all(&context, &cfg, &entries, &terms).await)
    })?;
    if let Some(file) = matches.get_one::<PathBuf>("report") {
        let text = json!({ "schema": 1, "applied": report }).to_string() + "\n";
        std::fs::write(file, text).map_err(|error| {
            Failure::of(lang, Code::Output).because(format!("{}: {error}", file.display()))
        })?;
    }
    failed.map_or(Ok(()), Err)
}

async fn apply_all(
    context: &Context,
    cfg: &ConfigContext,
    entries: &[Entry],
    terms: &Terms,
) -> (Vec<Value>, Option<Failure>) {
    let mut report = Vec::new();
    for entry in entries {
        let name = entry.target.name.as_str();
        let end = match &entry.found {
            Ok(Some(_)) if entry.differences().is_empty() => continue,
            Ok(Some(found)) => apply_one(context, cfg, entry, *found, terms).await,
            Ok(None) => Err(Failure::of(context.lang, Code::NotFound).because(name)),
            Err(failure) => Err(Failure::of(context.lang, failure.code()).because(name)),
        };
        match end {
            Ok(number) => report.push(json!({ "module": name, "change": number, "done": true })),
            Err(failure) => {
                let error = failure.to_json(context.lang);
                report.push(json!({ "module": name, "done": false, "error": error }));
                return (report, Some(failure));
            }
        }
    }
    (report, None)
}

async fn apply_one(
    context: &Context,
    cfg: &ConfigContext,
    entry: &Entry,
    found: Found,
    terms: &Terms,
) -> Result<Option<u64>, Failure> {
    let target = &entry.target;
    let store = if terms.dry {
        None
    } else {
        Some(cfg.store(context)?)
    };
    let mut driver = Driver::open(context, target, store).await?;
    let wanted = entry.wanted.clone();
    let done = change_at(context, cfg, &mut driver, target, found, wanted, terms).await?;
    if let Some(done) = &done {
        let place = placed(context.lang, done.found.place);
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("module", &target.name),
            ("place", &place),
            ("number", &done.number),
        ];
        context.note(&context.lang.fill(ConfigText::Written, values));
    }
    Ok(done.map(|done| done.number))
}
