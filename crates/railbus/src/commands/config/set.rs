//! `railbus config set`: changes settings of a module, after asking.

use super::config_context::{ConfigContext, state_flag};
use super::drive::{Driver, must_ask};
use super::file;
use super::show::words;
use super::texts::ConfigText;
use crate::args;
use crate::commands::Context;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::settings::SettingsText;
use railbus_app::settings::outcome::{self, placed};
use railbus_app::settings::plan::{frame, warnings};
use railbus_app::settings::target::Target;
use railbus_commission::settings::{Key, Wanted, differences, key};
use railbus_commission::{
    ChangeOrigin, Ended, Found, Job, Kept, ProcedureError, WriteStep, change, read,
};
use railbus_wire::SerialSettings;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::{Value, json};

/// The name of the command.
pub(super) const NAME: &str = "set";

pub(super) fn define(lang: Lang) -> Command {
    args::verb(
        lang,
        NAME,
        ConfigText::SetAbout,
        "railbus config set MODULE SETTING=VALUE… | set -l LINE SETTING=VALUE",
    )
    .before_help(args::examples(lang, ConfigText::SetExamples))
    .arg(
        Arg::new("SETTING")
            .help(lang.get(ConfigText::Pairs))
            .num_args(1..)
            .required(true),
    )
    .args(write_flags(lang))
}

/// The flags of every command that writes settings.
pub(super) fn write_flags(lang: Lang) -> Vec<Arg> {
    vec![
        args::flag(lang, "dry-run", ConfigText::DryRun)
            .short('n')
            .action(ArgAction::SetTrue),
        args::flag(lang, "yes", ConfigText::Yes)
            .short('y')
            .action(ArgAction::SetTrue),
        state_flag(lang),
    ]
}

/// Shows what would be written, asks, and writes it.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let given = words(matches, "SETTING");
    let terms = Terms::of(matches, ChangeOrigin::Set);
    let (targets, pairs) = match given.split_first() {
        Some((name, pairs)) if !name.contains('=') => (vec![cfg.target(&context, name)?], pairs),
        // Flags describe a single module.
        _ if cfg.file.is_none() => (cfg.targets(&context, &[])?, given.as_slice()),
        _ => (whole_line(&context, &cfg, &given)?, given.as_slice()),
    };
    let mut jobs = Vec::new();
    for target in targets {
        let wanted = Wanted::parse(&target.setup, pairs.iter().map(String::as_str))
            .map_err(|wrong| outcome::wrong(context.lang, &target, &wrong))?;
        if wanted.is_empty() {
            return Err(Failure::of(lang, Code::Usage)
                .with_try(format!("railbus config set {} address=9", target.name)));
        }
        jobs.push((target, wanted));
    }
    let (changed, failed) = context.block(async {
        let mut changed = Vec::new();
        for (target, wanted) in &jobs {
            match carry_out(&context, &cfg, target, wanted.clone(), &terms).await {
                Ok(done) => changed.extend(done),
                Err(failure) => return Ok((changed, Some(failure))),
            }
        }
        Ok((changed, None))
    })?;
    tell(&context, changed)?;
    failed.map_or(Ok(()), Err)
}

/// The modules of a whole line that have these settings, one after the other. Only for settings
/// that may be the same for all of them.
fn whole_line(
    context: &Context,
    cfg: &ConfigContext,
    pairs: &[String],
) -> Result<Vec<Target>, Failure> {
    let of = |pair: &String| pair.split('=').next().unwrap_or_default().to_owned();
    let names: Vec<String> = pairs.iter().map(of).collect();
    let shared = [Key::Checksum, Key::Baud, Key::Parity].map(|key| key.to_string());
    if let Some(name) = names.iter().find(|name| !shared.contains(name)) {
        let failure = Failure::of(context.lang, Code::Usage).because(name);
        return Err(failure.with_try("railbus config set pump address=9"));
    }
    if context.line.is_none() && cfg.config.lines.len() > 1 {
        let lines = cfg.config.lines.keys().map(|line| format!("-l {line}"));
        let failure = Failure::of(context.lang, Code::NoLine);
        return Err(lines.fold(failure, Failure::with_try));
    }
    let has_all = |target: &Target| {
        names
            .iter()
            .all(|name| key(&target.setup, name).is_some_and(|(_, access)| access.is_writable()))
    };
    let mut targets = cfg.targets(context, &[])?;
    targets.retain(has_all);
    if targets.is_empty() {
        return Err(Failure::of(context.lang, Code::NothingToDo).because(names.join(" ")));
    }
    Ok(targets)
}

/// The options of a change.
pub(super) struct Terms {
    pub(super) yes: bool,
    pub(super) dry: bool,
    pub(super) by: ChangeOrigin,
    pub(super) undoes: Option<u64>,
}

impl Terms {
    pub(super) fn of(matches: &ArgMatches, by: ChangeOrigin) -> Terms {
        Terms {
            yes: matches.get_flag("yes"),
            dry: matches.get_flag("dry-run"),
            by,
            undoes: None,
        }
    }
}

/// A change that was made.
pub(super) struct Changed {
    pub(super) target: Target,
    pub(super) number: u64,
    pub(super) found: Found,
    pub(super) before: Kept,
    pub(super) same: bool,
}

/// Changes one module and the configuration file. None if the change was only shown.
pub(super) async fn carry_out(
    context: &Context,
    cfg: &ConfigContext,
    target: &Target,
    wanted: Wanted,
    terms: &Terms,
) -> Result<Option<Changed>, Failure> {
    let store = if terms.dry {
        None
    } else {
        Some(cfg.store(context)?)
    };
    let mut driver = Driver::open(context, target, store).await?;
    change_one(context, cfg, &mut driver, target, wanted, terms).await
}

/// The same on a line that is already open.
pub(super) async fn change_one(
    context: &Context,
    cfg: &ConfigContext,
    driver: &mut Driver<'_>,
    target: &Target,
    wanted: Wanted,
    terms: &Terms,
) -> Result<Option<Changed>, Failure> {
    let failed = |trouble: &ProcedureError| outcome::trouble(context.lang, target, trouble);
    let found = driver
        .run(read(target.setup))
        .await
        .map_err(|trouble| failed(&trouble))?;
    change_at(context, cfg, driver, target, found, wanted, terms).await
}

/// The same for a module that was found, possibly at another place.
pub(super) async fn change_at(
    context: &Context,
    cfg: &ConfigContext,
    driver: &mut Driver<'_>,
    target: &Target,
    found: Found,
    wanted: Wanted,
    terms: &Terms,
) -> Result<Option<Changed>, Failure> {
    let target = &target.found(&found);
    let failed = |trouble: &ProcedureError| outcome::trouble(context.lang, target, trouble);
    let planned = target.writes(&found, &wanted);
    let planned = planned.map_err(|trouble| failed(&trouble))?;
    for stage in &planned {
        follows_port(context, target, driver, stage.to.serial)?;
    }
    let before = found.kept();
    let number = driver.journal.next_change();
    if planned.is_empty() {
        return Ok(Some(Changed {
            target: target.clone(),
            number: 0,
            found,
            before,
            same: true,
        }));
    }
    show(context, target, &found, &planned, terms.dry)?;
    if let Some(open) = open_before(driver, &target.name) {
        context.note(
            &context
                .lang
                .fill(ConfigText::OpenBefore, &[("number", &open)]),
        );
    }
    if terms.dry {
        return Ok(None);
    }
    if !terms.yes {
        must_ask(context)?;
        if !driver.agreed(context.lang.get(ConfigText::GoOn)).await {
            return Err(Failure::of(context.lang, Code::NotConfirmed));
        }
    }
    let job = Job {
        change: number,
        line: target.line.clone(),
        module: target.name.clone(),
        setup: target.setup,
        wanted,
        neighbours: target.neighbours.clone(),
        by: terms.by,
        undoes: terms.undoes,
    };
    let end = driver
        .run(change(job))
        .await
        .map_err(|trouble| failed(&trouble))?;
    finish(context, cfg, driver, target, number, &end).await?;
    match end {
        Ended::Same(found) | Ended::Done(found) => Ok(Some(Changed {
            target: target.clone(),
            number,
            found,
            before,
            same: false,
        })),
        // All other results were reported as failures.
        _ => Ok(None),
    }
}

/// An unfinished change of the same module.
fn open_before(driver: &Driver<'_>, module: &str) -> Option<u64> {
    let open = driver.journal.log()?.open();
    let of_module = open.iter().find(|record| record.module == module);
    of_module.map(|record| record.change)
}

/// Updates the configuration file wherever the module was found, then reports how the change ended.
pub(super) async fn finish(
    context: &Context,
    cfg: &ConfigContext,
    driver: &mut Driver<'_>,
    target: &Target,
    number: u64,
    end: &Ended,
) -> Result<(), Failure> {
    let found = match end {
        Ended::Done(found) | Ended::Halfway(found, _) => Some(found),
        _ => None,
    };
    if let Some(found) = found {
        let last = driver.journal.last(number);
        file::follow(context, cfg, driver, last, &target.name, found.place).await?;
    }
    outcome::ended(context.lang, target, number, end)
}

/// Refuses a change that the port can't follow: a serial server has its own speed, and a
/// pseudo-terminal no parity. The module would be lost.
pub(super) fn follows_port(
    context: &Context,
    target: &Target,
    driver: &Driver<'_>,
    to: SerialSettings,
) -> Result<(), Failure> {
    if driver.follows(target.setup.serial, to) {
        return Ok(());
    }
    let failure = Failure::of(context.lang, Code::PortSpeed);
    Err(failure.because(&target.port))
}

/// The changes and their frames.
fn show(
    context: &Context,
    target: &Target,
    found: &Found,
    stages: &[WriteStep],
    dry: bool,
) -> Result<(), Failure> {
    let lang = context.lang;
    let line = lang.fill(
        railbus_app::texts::AppText::OnLine,
        &[("line", &target.line)],
    );
    let mut text = format!("{}  {}  {line}\n", target.name, target.setup.family);
    let mut table = Table::bare();
    let last = stages.last().map_or(found.kept(), |stage| stage.after);
    for (key, old, new) in differences(&target.setup, &found.kept(), &last) {
        table.add([format!("  {key}"), old, "→".to_owned(), new]);
    }
    text += &table.render();
    let mut rows = Vec::new();
    for stage in stages {
        let frame = frame(target, stage);
        text += &format!("  {}\n", lang.fill(ConfigText::Frame, &[("frame", &frame)]));
        rows.push(json!({ "module": target.name, "frame": frame }));
    }
    text += &format!(
        "  {}\n",
        lang.fill(ConfigText::Writes, &[("count", &stages.len())])
    );
    for warning in warnings(lang, target, stages) {
        text += &format!("  {warning}\n");
    }
    if !dry {
        context.note(text.trim_end());
        return Ok(());
    }
    let mut table = Table::bare();
    table.add([text.trim_end().to_owned()]);
    table.add([lang.get(SettingsText::NothingWritten).to_owned()]);
    let records = Records {
        key: "frames",
        rows,
        columns: &["module", "frame"],
        value: "frame",
        table,
    };
    out::result(lang, &records.render(context.format))
}

/// Reports the changes, for people and programs.
pub(super) fn tell(context: &Context, all: Vec<Changed>) -> Result<(), Failure> {
    let lang = context.lang;
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for changed in &all {
        table.add([told(context, changed)]);
        rows.push(row(changed));
    }
    if all.is_empty() || context.quiet && context.format == railbus_app::render::Format::Table {
        return Ok(());
    }
    let columns = &["module", "change", "address", "baud", "format", "checksum"];
    let records = Records {
        key: "changed",
        rows,
        columns,
        value: "change",
        table,
    };
    out::result(lang, &records.render(context.format))
}

fn told(context: &Context, changed: &Changed) -> String {
    let lang = context.lang;
    let place = placed(context.lang, changed.found.place);
    let values: &[(&str, &dyn std::fmt::Display)] = &[
        ("module", &changed.target.name),
        ("place", &place),
        ("number", &changed.number),
    ];
    lang.fill(
        if changed.same {
            ConfigText::Same
        } else {
            ConfigText::Written
        },
        values,
    )
}

fn row(changed: &Changed) -> Value {
    let setup = &changed.target.setup;
    let place = changed.found.place;
    let differences = differences(setup, &changed.before, &changed.found.kept());
    let set: serde_json::Map<String, Value> = differences
        .into_iter()
        .map(|(key, old, new)| (key.to_string(), json!({ "before": old, "value": new })))
        .collect();
    json!({
        "module": changed.target.name,
        "change": (!changed.same).then_some(changed.number),
        "written": !changed.same,
        "set": set,
        "address": place.address.0,
        "baud": place.serial.baud.rate(),
        "format": place.serial.character.to_string(),
        "checksum": place.checksum,
    })
}
