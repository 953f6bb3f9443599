//! `railbus config show` and `get`: the settings that are stored in modules.

use super::config_context::{ConfigContext, state_flag};
use super::drive::Driver;
use super::texts::ConfigText;
use crate::args;
use crate::commands::Context;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::settings::outcome;
use railbus_app::settings::plan::{known, note, source};
use railbus_app::settings::target::Target;
use railbus_commission::settings::{Access, Key, range, settings, shown};
use railbus_commission::{Found, read};
use railbus_wire::Address;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::{Value, json};

/// The names of the commands.
pub(super) const NAME: &str = "show";
pub(super) const GET: &str = "get";

pub(super) fn define(lang: Lang) -> Command {
    args::verb(
        lang,
        NAME,
        ConfigText::ShowAbout,
        "railbus config show [MODULE…]",
    )
    .before_help(args::examples(lang, ConfigText::ShowExamples))
    .arg(
        Arg::new("MODULE")
            .help(lang.get(ConfigText::Modules))
            .num_args(0..),
    )
    .arg(state_flag(lang))
}

pub(super) fn define_get(lang: Lang) -> Command {
    args::verb(
        lang,
        GET,
        ConfigText::GetAbout,
        "railbus config get MODULE SETTING…",
    )
    .before_help(args::examples(lang, ConfigText::GetExamples))
    .arg(
        Arg::new("MODULE")
            .help(lang.get(ConfigText::Module))
            .required(true),
    )
    .arg(
        Arg::new("SETTING")
            .help(lang.get(ConfigText::Settings))
            .num_args(1..)
            .required(true),
    )
    .arg(state_flag(lang))
}

/// Reads each module and prints its settings.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let names = words(matches, "MODULE");
    print(lang, matches, &names, &|_| true)
}

/// The same for single settings.
pub(super) fn get(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let names = words(matches, "MODULE");
    let wanted = words(matches, "SETTING");
    for target in cfg.targets(&context, &names)? {
        let known: Vec<String> = settings(&target.setup)
            .iter()
            .map(|(key, _)| key.to_string())
            .collect();
        if let Some(name) = wanted.iter().find(|name| !known.contains(name)) {
            let wrong = railbus_commission::settings::Wrong::NoSetting(name.clone(), known);
            return Err(outcome::wrong(context.lang, &target, &wrong));
        }
    }
    print(lang, matches, &names, &|key| {
        wanted.contains(&key.to_string())
    })
}

/// The values of an argument.
pub(super) fn words(matches: &ArgMatches, name: &str) -> Vec<String> {
    matches
        .get_many::<String>(name)
        .into_iter()
        .flatten()
        .cloned()
        .collect()
}

fn print(
    lang: Lang,
    matches: &ArgMatches,
    names: &[String],
    wanted: &dyn Fn(Key) -> bool,
) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let targets = cfg.targets(&context, names)?;
    let several = targets.len() > 1;
    let mut head = vec![
        ConfigText::HeadSetting,
        ConfigText::HeadValue,
        ConfigText::HeadRange,
    ];
    head.push(ConfigText::HeadNote);
    let mut head: Vec<&str> = head.into_iter().map(|text| lang.get(text)).collect();
    if several {
        head.insert(0, lang.get(ConfigText::HeadModule));
    }
    let mut table = Table::new(head);
    let mut rows = Vec::new();
    let reading = async { Ok(read_all(&context, targets).await) };
    let (founds, failed) = context.block(reading)?;
    for (target, found) in &founds {
        for (key, access) in settings(&target.setup)
            .into_iter()
            .filter(|(key, _)| wanted(*key))
        {
            let mut cells = cells(lang, target, found, key, access);
            if several {
                cells.insert(0, target.name.clone());
            }
            table.add(cells);
            rows.push(row(target, found, key, access));
        }
    }
    let records = Records {
        key: "settings",
        rows,
        columns: &["module", "setting", "value", "range", "access", "source"],
        value: "value",
        table,
    };
    if !founds.is_empty() {
        out::result(lang, &records.render(context.format))?;
    }
    failed.map_or(Ok(()), Err)
}

/// Reads modules, those of one line one after the other. Those that can't be read are reported
/// together after the others.
pub(super) async fn read_all(
    context: &Context,
    targets: Vec<Target>,
) -> (Vec<(Target, Found)>, Option<Failure>) {
    let count = targets.len();
    let mut founds = Vec::new();
    let mut failures = Vec::new();
    let mut targets = targets.into_iter().peekable();
    while let Some(first) = targets.next() {
        let mut same_line = vec![first];
        while let Some(next) = targets.next_if(|next| next.line == same_line[0].line) {
            same_line.push(next);
        }
        match Driver::open(context, &same_line[0], None).await {
            Err(failure) => failures.push((same_line[0].line.clone(), failure)),
            Ok(mut driver) => {
                for target in same_line {
                    match driver.run(read(target.setup)).await {
                        Ok(found) => founds.push((target, found)),
                        Err(trouble) => {
                            let failure = outcome::trouble(context.lang, &target, &trouble);
                            failures.push((target.name, failure));
                        }
                    }
                }
            }
        }
    }
    let failed = together(context, count, founds.is_empty(), failures);
    (founds, failed)
}

/// Combines failures into one: the first of them if nothing was read at all.
fn together(
    context: &Context,
    count: usize,
    nothing: bool,
    failures: Vec<(String, Failure)>,
) -> Option<Failure> {
    let failed = failures.len();
    if nothing {
        return failures.into_iter().next().map(|(_, failure)| failure);
    }
    let values: &[(&str, &dyn std::fmt::Display)] = &[("failed", &failed), ("count", &count)];
    let message = context.lang.fill(Text::SomeFailed, values);
    let partial = Failure::new(Code::Partial, message).with_try("railbus config recover MODULE");
    let each = failures
        .into_iter()
        .map(|(name, failure)| format!("{name}: {} {}", failure.code().name(), failure.message()));
    (failed > 0).then(|| each.fold(partial, Failure::because))
}

fn row(target: &Target, found: &Found, key: Key, access: Access) -> Value {
    json!({
        "module": target.name,
        "setting": key.to_string(),
        "value": shown(&target.setup, &known(target, found), key),
        "range": range(&target.setup, key),
        "writable": access.is_writable(),
        "access": access.name(),
        "source": source(target, found, key),
    })
}

fn cells(lang: Lang, target: &Target, found: &Found, key: Key, access: Access) -> Vec<String> {
    let value = match (key, known(target, found).address) {
        (Key::Address, Some(address)) => Address(address.0).to_string(),
        _ => shown(&target.setup, &known(target, found), key).unwrap_or_else(|| "–".to_owned()),
    };
    vec![
        key.to_string(),
        value,
        range(&target.setup, key),
        note(lang, access).to_owned(),
    ]
}
