//! `railbus config restore` and `config diff`: writes a backup back, or compares modules with it.

use super::backup::{Backup, KIND, ModuleKept, SCHEMA, kept};
use super::config_context::{ConfigContext, state_flag};
use super::drive::{Driver, must_ask};
use super::find::{Located, locate};
use super::set::{Changed, Terms, change_at, tell, write_flags};
use super::show::{read_all, words};
use super::texts::ConfigText;
use crate::args;
use crate::commands::Context;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use railbus_app::config_file::text_of;
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::settings::outcome;
use railbus_app::settings::target::Target;
use railbus_commission::settings::{Wanted, key};
use railbus_commission::{BusAddress, ChangeOrigin};
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::json;
use std::path::PathBuf;

/// The names of the commands.
pub(super) const NAME: &str = "restore";
pub(super) const DIFF: &str = "diff";

fn file_arguments(lang: Lang, command: Command) -> Command {
    command
        .arg(
            Arg::new("FILE")
                .help(lang.get(ConfigText::BackupFile))
                .required(true)
                .value_parser(value_parser!(PathBuf)),
        )
        .arg(args::flag(lang, "other-site", ConfigText::OtherSite).action(ArgAction::SetTrue))
}

pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus config restore FILE [--module X] [--map OLD=NEW] [-n]";
    let command = args::verb(lang, NAME, ConfigText::RestoreAbout, usage)
        .before_help(args::examples(lang, ConfigText::RestoreExamples));
    file_arguments(lang, command)
        .arg(
            args::flag(lang, "module", ConfigText::RestoreModule)
                .value_name("MODULE")
                .action(ArgAction::Append),
        )
        .arg(
            args::flag(lang, "map", ConfigText::RestoreMap)
                .value_name("OLD=NEW")
                .action(ArgAction::Append),
        )
        .args(write_flags(lang))
}

pub(super) fn define_diff(lang: Lang) -> Command {
    let usage = "railbus config diff FILE [MODULE…] [--exit-code]";
    let command = args::verb(lang, DIFF, ConfigText::DiffAbout, usage)
        .before_help(args::examples(lang, ConfigText::DiffExamples));
    file_arguments(lang, command)
        .arg(
            Arg::new("MODULE")
                .help(lang.get(ConfigText::Modules))
                .num_args(0..),
        )
        .arg(args::flag(lang, "exit-code", ConfigText::ExitCode).action(ArgAction::SetTrue))
        .arg(state_flag(lang))
}

/// Reads a backup, and refuses one of another version or site.
fn backup(context: &Context, cfg: &ConfigContext, matches: &ArgMatches) -> Result<Backup, Failure> {
    let lang = context.lang;
    let file: PathBuf = matches.get_one("FILE").cloned().unwrap_or_default();
    let wrong = |code: Code, why: String| {
        Failure::of(lang, code).because(format!("{}: {why}", file.display()))
    };
    let text = text_of(&file).map_err(|problem| wrong(Code::BackupFile, problem.text("reason")))?;
    let read: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| wrong(Code::BackupFile, error.to_string()))?;
    if read["kind"] != KIND {
        return Err(wrong(Code::BackupFile, format!("kind: {}", read["kind"])));
    }
    if read["schema"] != SCHEMA {
        return Err(wrong(
            Code::BackupSchema,
            format!("schema: {}", read["schema"]),
        ));
    }
    let backup: Backup =
        serde_json::from_value(read).map_err(|error| wrong(Code::BackupFile, error.to_string()))?;
    let site = cfg.site(context)?;
    if backup.site != site && !matches.get_flag("other-site") {
        return Err(wrong(Code::BackupSite, format!("{} ≠ {site}", backup.site)));
    }
    Ok(backup)
}

/// The settings from the backup that a target is to have.
fn wanted(context: &Context, target: &Target, kept: &ModuleKept) -> Result<Wanted, Failure> {
    let setup = &target.setup;
    if kept.model != setup.family.name() || kept.protocol != setup.protocol.name() {
        let told = format!(
            "{}: {} {} ≠ {} {}",
            target.name,
            kept.model,
            kept.protocol,
            setup.family.name(),
            setup.protocol
        );
        return Err(Failure::of(context.lang, Code::WrongModel).because(told));
    }
    let mut wanted = Wanted::default();
    for (name, value) in &kept.settings {
        // Read-only settings are in the backup for information.
        if key(setup, name).is_some_and(|(_, access)| !access.is_writable()) {
            continue;
        }
        wanted
            .set(setup, name, value)
            .map_err(|wrong| outcome::wrong(context.lang, target, &wrong))?;
    }
    Ok(wanted)
}

/// Which module of the backup is restored to which target.
fn pairs(
    context: &Context,
    cfg: &ConfigContext,
    matches: &ArgMatches,
    backup: &Backup,
) -> Result<Vec<(Target, Wanted)>, Failure> {
    let named = words(matches, "module");
    let mut map = Vec::new();
    for word in words(matches, "map") {
        let Some((old, new)) = word.split_once('=') else {
            return Err(Failure::of(context.lang, Code::Usage).because(word));
        };
        map.push((old.to_owned(), new.to_owned()));
    }
    if let Some(missing) = named
        .iter()
        .chain(map.iter().map(|(old, _)| old))
        .find(|name| !backup.modules.contains_key(*name))
    {
        return Err(Failure::of(context.lang, Code::NoModule).because(missing));
    }
    let only = |name: &String| {
        let mapped = map.iter().any(|(old, _)| old == name);
        named.is_empty() && map.is_empty() || named.contains(name) || mapped
    };
    let mut pairs = Vec::new();
    for (old, kept) in backup.modules.iter().filter(|(name, _)| only(name)) {
        let new = map
            .iter()
            .find(|(from, _)| from == old)
            .map_or(old, |(_, to)| to);
        let target = cfg.target(context, new)?;
        let wanted = wanted(context, &target, kept)?;
        pairs.push((target, wanted));
    }
    Ok(pairs)
}

/// Restores a backup, one module after the other; a new module is found by its factory settings.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let backup = backup(&context, &cfg, matches)?;
    let pairs = pairs(&context, &cfg, matches, &backup)?;
    let terms = Terms::of(matches, ChangeOrigin::Restore);
    if !terms.dry && !terms.yes {
        must_ask(&context)?;
    }
    let (changed, failed) = context.block(restore_all(&context, &cfg, &pairs, &terms))?;
    tell(&context, changed)?;
    failed.map_or(Ok(()), Err)
}

/// Restores each module in turn. Stops at the first failure, and reports what was done before.
async fn restore_all(
    context: &Context,
    cfg: &ConfigContext,
    pairs: &[(Target, Wanted)],
    terms: &Terms,
) -> Result<(Vec<Changed>, Option<Failure>), Failure> {
    let mut changed = Vec::new();
    for (target, wanted) in pairs {
        match restore_one(context, cfg, target, wanted, terms).await {
            Ok(done) => changed.extend(done),
            Err(failure) => return Ok((changed, Some(failure))),
        }
    }
    Ok((changed, None))
}

async fn restore_one(
    context: &Context,
    cfg: &ConfigContext,
    target: &Target,
    wanted: &Wanted,
    terms: &Terms,
) -> Result<Option<Changed>, Failure> {
    let store = if terms.dry {
        None
    } else {
        Some(cfg.store(context)?)
    };
    let mut driver = Driver::open(context, target, store).await?;
    let likely = [wanted.kept.place(BusAddress::of(&target.setup))];
    match locate(context, &mut driver, target, &likely).await? {
        Located::Here(found) => {
            change_at(
                context,
                cfg,
                &mut driver,
                target,
                found,
                wanted.clone(),
                terms,
            )
            .await
        }
        Located::Missing => Err(Failure::of(context.lang, Code::NotFound).because(&target.name)),
    }
}

/// Compares modules with their backup.
pub(super) fn diff(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let backup = backup(&context, &cfg, matches)?;
    let names = words(matches, "MODULE");
    let only = |name: &String| names.is_empty() || names.contains(name);
    if let Some(missing) = names
        .iter()
        .find(|name| !backup.modules.contains_key(*name))
    {
        return Err(Failure::of(lang, Code::NoModule).because(missing));
    }
    let mut targets = Vec::new();
    for name in backup.modules.keys().filter(|name| only(name)) {
        targets.push(cfg.target(&context, name)?);
    }
    let (founds, failed) = context.block(async { Ok(read_all(&context, targets).await) })?;
    let head = [
        ConfigText::HeadModule,
        ConfigText::HeadSetting,
        ConfigText::HeadBackup,
        ConfigText::HeadNow,
    ];
    let mut table = Table::new(head.map(|text| lang.get(text)));
    let mut rows = Vec::new();
    for (target, found) in &founds {
        let Some(then) = backup.modules.get(&target.name) else {
            continue;
        };
        let now = kept(target, found);
        let names: std::collections::BTreeSet<&String> =
            then.settings.keys().chain(now.settings.keys()).collect();
        for name in names {
            let (then, now) = (then.settings.get(name), now.settings.get(name));
            if then != now {
                let cell = |value: Option<&String>| value.map_or("–", String::as_str).to_owned();
                table.add([target.name.clone(), name.clone(), cell(then), cell(now)]);
                rows.push(json!({
                    "module": target.name, "setting": name, "backup": then, "now": now,
                }));
            }
        }
    }
    let count = rows.len();
    if count == 0 && failed.is_none() {
        context.note(lang.get(ConfigText::NoDifference));
    }
    let columns = &["module", "setting", "backup", "now"];
    let records = Records {
        key: "differences",
        rows,
        columns,
        value: "setting",
        table,
    };
    if count > 0 || context.format != railbus_app::render::Format::Table {
        out::result(lang, &records.render(context.format))?;
    }
    if let Some(failure) = failed {
        return Err(failure);
    }
    if count > 0 && matches.get_flag("exit-code") {
        return Err(Failure::of(lang, Code::Differs)
            .with_fact("count", count)
            .told());
    }
    Ok(())
}
