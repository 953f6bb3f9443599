//! `railbus config log`, `undo` and `recover`: the journal of changes, undoing a change, and
//! finding a module whose change was interrupted.

use super::config_context::{ConfigContext, state_flag};
use super::drive::Driver;
use super::file;
use super::set::{self, Terms, tell, write_flags};
use super::texts::ConfigText;
use crate::args;
use crate::commands::Context;
use clap::{Arg, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::settings::SettingsText;
use railbus_app::settings::log::{not_found, state, taking_back};
use railbus_app::settings::outcome::{self, placed};
use railbus_app::settings::target::Target;
use railbus_commission::{
    BusAddress, ChangeOrigin, Found, JournalRecord, Log, RecordState, Recovered, Search, look_up,
    recover as recovery,
};
use railbus_wire::Address;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The names of the commands.
pub(super) const NAME: &str = "log";
pub(super) const UNDO: &str = "undo";
pub(super) const RECOVER: &str = "recover";

pub(super) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, ConfigText::LogAbout, "railbus config log")
        .before_help(args::examples(lang, ConfigText::LogExamples))
        .arg(state_flag(lang))
}

pub(super) fn define_undo(lang: Lang) -> Command {
    args::verb(
        lang,
        UNDO,
        ConfigText::UndoAbout,
        "railbus config undo [NUMBER]",
    )
    .before_help(args::examples(lang, ConfigText::UndoExamples))
    .arg(
        Arg::new("NUMBER")
            .help(lang.get(ConfigText::Number))
            .value_parser(value_parser!(u64)),
    )
    .args(write_flags(lang))
}

pub(super) fn define_recover(lang: Lang) -> Command {
    args::verb(
        lang,
        RECOVER,
        ConfigText::RecoverAbout,
        "railbus config recover [MODULE…] [--addr N]",
    )
    .before_help(args::examples(lang, ConfigText::RecoverExamples))
    .arg(
        Arg::new("MODULE")
            .help(lang.get(ConfigText::Modules))
            .num_args(0..),
    )
    .arg(
        args::flag(lang, "addr", ConfigText::RecoverAddr)
            .value_name("N")
            .value_parser(railbus_app::address),
    )
    .arg(state_flag(lang))
}

/// Prints the journal.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let log = cfg.log(&context)?;
    let head = [
        ConfigText::HeadChange,
        ConfigText::HeadTime,
        ConfigText::HeadModule,
        ConfigText::HeadWhat,
        ConfigText::HeadState,
    ];
    let mut table = Table::new(head.map(|text| lang.get(text)));
    let mut rows = Vec::new();
    for (number, last) in log.last_words() {
        let set = log.net(number);
        let what: Vec<String> = set
            .iter()
            .map(|(key, [old, new])| format!("{key} {old} → {new}"))
            .collect();
        table.add([
            format!("#{number}"),
            last.at.clone(),
            last.module.clone(),
            what.join(", "),
            lang.get(state(&log, last)).to_owned(),
        ]);
        rows.push(row(&log, last, &set));
    }
    if log.unread > 0 {
        context.note(&lang.fill(ConfigText::Unread, &[("count", &log.unread)]));
    }
    let columns = &["change", "at", "line", "module", "state"];
    let records = Records {
        key: "changes",
        rows,
        columns,
        value: "change",
        table,
    };
    out::result(lang, &records.render(context.format))
}

fn row(log: &Log, last: &JournalRecord, set: &BTreeMap<String, [String; 2]>) -> Value {
    let steps: Vec<Value> = log
        .change(last.change)
        .map(|record| serde_json::to_value(record).unwrap_or_default())
        .collect();
    json!({
        "change": last.change,
        "at": last.at,
        "line": last.line,
        "module": last.module,
        "model": last.model,
        "state": serde_json::to_value(last.state).unwrap_or_default(),
        "by": serde_json::to_value(last.by).unwrap_or_default(),
        "undoes": last.undoes,
        "set": set,
        "records": steps,
    })
}

/// Writes the old values of a change back, as a new change.
pub(super) fn undo(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let log = cfg.log(&context)?;
    let asked: Option<u64> = matches.get_one("NUMBER").copied();
    let number = asked.or_else(|| log.records.last().map(|record| record.change));
    let no_change = || Failure::of(lang, Code::NoChange).because(asked.unwrap_or_default());
    let number = number.ok_or_else(no_change)?;
    let last = log.change(number).last().ok_or_else(no_change)?;
    let target = target_of(&context, &cfg, last)?;
    let wanted = taking_back(lang, &log, last, &target)?;
    let terms = Terms {
        undoes: Some(number),
        ..Terms::of(matches, ChangeOrigin::Undo)
    };
    let end = context.block(set::carry_out(&context, &cfg, &target, wanted, &terms))?;
    tell(&context, end.into_iter().collect())
}

/// The module of a record, as the configuration has it; if flags describe it, where the record has
/// it.
fn target_of(
    context: &Context,
    cfg: &ConfigContext,
    record: &JournalRecord,
) -> Result<Target, Failure> {
    let mut target = cfg.target(context, &record.module)?;
    if cfg.file.is_none()
        && let Some(place) = record.found.as_ref().unwrap_or(&record.to).place()
    {
        target.setup = place.setup(&target.setup);
    }
    Ok(target)
}

/// Finds modules: those with an unfinished change, those named, or the one at an address.
pub(super) fn recover(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let names = super::show::words(matches, "MODULE");
    let address: Option<u8> = matches.get_one("addr").copied();
    let results = context.block(async {
        let mut results = Vec::new();
        let store = cfg.store(&context)?;
        let open: Vec<JournalRecord> = store.log().open().into_iter().cloned().collect();
        let behind = behind(&cfg, store.log());
        drop(store);
        let mut wanted: Vec<String> = names.clone();
        if let Some(address) = address {
            let at = |(_, module): &(&String, &railbus_site::config::ModuleConfig)| {
                module.setup.address == Address(address)
            };
            wanted.extend(
                cfg.config
                    .modules
                    .iter()
                    .filter(at)
                    .map(|(name, _)| name.clone()),
            );
        }
        if wanted.is_empty() {
            wanted = behind;
        }
        let all = names.is_empty() && address.is_none();
        for record in &open {
            if all || wanted.contains(&record.module) {
                results.push(one_open(&context, &cfg, record).await?);
            }
        }
        for name in &wanted {
            if open.iter().all(|record| record.module != *name) {
                results.push(one_named(&context, &cfg, name).await?);
            }
        }
        Ok(results)
    })?;
    if results.is_empty() {
        context.note(&match address {
            Some(addr) => lang.fill(ConfigText::NobodyAt, &[("addr", &addr)]),
            None => lang.get(ConfigText::NothingOpen).to_owned(),
        });
        if context.format.is_json() {
            let table = Table::bare();
            let records = Records {
                key: "recovered",
                rows: Vec::new(),
                columns: &[],
                value: "module",
                table,
            };
            return out::result(lang, &records.render(context.format));
        }
        return Ok(());
    }
    show_recovered(&context, results)
}

/// The modules that moved without the configuration file having been updated.
fn behind(cfg: &ConfigContext, log: &Log) -> Vec<String> {
    if cfg.file.is_none() {
        return Vec::new();
    }
    let modules = cfg.config.modules.iter();
    let moved = modules.filter(|(name, module)| {
        let known = log.unfiled(name);
        known.is_some_and(|place| place != BusAddress::of(&module.setup))
    });
    moved.map(|(name, _)| name.clone()).collect()
}

/// The outcome for one module.
struct Traced {
    target: Target,
    change: Option<u64>,
    found: Option<Found>,
    garbled: bool,
    told: &'static str,
}

async fn one_open(
    context: &Context,
    cfg: &ConfigContext,
    record: &JournalRecord,
) -> Result<Traced, Failure> {
    let target = target_of(context, cfg, record)?;
    let mut driver = Driver::open(context, &target, Some(cfg.store(context)?)).await?;
    let others = target
        .neighbours
        .iter()
        .filter(|other| other.protocol == target.setup.protocol);
    let others: Vec<BusAddress> = others.map(|other| other.place).collect();
    let log = driver.journal.log();
    let earlier = log.map(|log| log.places(record.change)).unwrap_or_default();
    let work = recovery(record.clone(), earlier, target.setup, true, others);
    let end = driver.run(work).await;
    let end = end.map_err(|trouble| outcome::trouble(context.lang, &target, &trouble))?;
    let lang = context.lang;
    let (told, found, garbled) = match end {
        Recovered::New(found) => (lang.get(ConfigText::RecoveredNew), Some(found), false),
        Recovered::Old(found) => (lang.get(ConfigText::RecoveredOld), Some(found), false),
        Recovered::Pending(found) => (lang.get(SettingsText::StatePending), Some(found), false),
        Recovered::Else(found) => (lang.get(SettingsText::StateElsewhere), Some(found), false),
        Recovered::Untold(found) => (lang.get(SettingsText::StateUntold), Some(found), false),
        Recovered::Nowhere(garbled) => (lang.get(SettingsText::StateLost), None, garbled),
    };
    if let Some(found) = &found {
        let last = driver.journal.last(record.change);
        let last = last.filter(|last| last.state == RecordState::Done);
        file::follow(context, cfg, &mut driver, last, &target.name, found.place).await?;
    }
    Ok(Traced {
        target,
        change: Some(record.change),
        found,
        garbled,
        told,
    })
}

async fn one_named(context: &Context, cfg: &ConfigContext, name: &str) -> Result<Traced, Failure> {
    let target = cfg.target(context, name)?;
    let mut driver = Driver::open(context, &target, Some(cfg.store(context)?)).await?;
    let others = target
        .neighbours
        .iter()
        .filter(|other| other.protocol == target.setup.protocol);
    let known = driver.journal.log().and_then(|log| log.unfiled(name));
    let here = BusAddress::of(&target.setup);
    let search = Search {
        setup: target.setup,
        first: [here].into_iter().chain(known).collect(),
        outwards: true,
        others: others.map(|other| other.place).collect(),
    };
    let end = driver.run(look_up(search)).await;
    let (found, garbled) =
        end.map_err(|trouble| outcome::trouble(context.lang, &target, &trouble))?;
    if let Some(found) = &found {
        file::follow(context, cfg, &mut driver, None, &target.name, found.place).await?;
    }
    let lang = context.lang;
    let told = match found {
        Some(found) if found.place == BusAddress::of(&target.setup) => {
            lang.get(ConfigText::InPlace)
        }
        Some(_) => lang.get(ConfigText::FoundElsewhere),
        None => lang.get(SettingsText::StateLost),
    };
    Ok(Traced {
        target,
        change: None,
        found,
        garbled,
        told,
    })
}

fn show_recovered(context: &Context, results: Vec<Traced>) -> Result<(), Failure> {
    let lang = context.lang;
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for result in &results {
        let place = result.found.map(|found| placed(context.lang, found.place));
        table.add([
            result.target.name.clone(),
            place.unwrap_or_else(|| "–".to_owned()),
            result.told.to_owned(),
            result
                .change
                .map(|number| format!("#{number}"))
                .unwrap_or_default(),
        ]);
        rows.push(json!({
            "module": result.target.name,
            "change": result.change,
            "found": result.found.is_some(),
            "address": result.found.map(|found| found.place.address.0),
            "baud": result.found.map(|found| found.place.serial.baud.rate()),
            "format": result.found.map(|found| found.place.serial.character.to_string()),
            "checksum": result.found.map(|found| found.place.checksum),
            "garbled": result.garbled,
        }));
    }
    let columns = &[
        "module", "change", "found", "address", "baud", "format", "checksum",
    ];
    let records = Records {
        key: "recovered",
        rows,
        columns,
        value: "address",
        table,
    };
    out::result(lang, &records.render(context.format))?;
    match results.iter().find(|result| result.found.is_none()) {
        None => Ok(()),
        Some(missing) => Err(not_found(lang, &missing.target, missing.garbled)),
    }
}
