//! `railbus fleet commands`: the commands that were given to sites, and their results.

use super::FleetText;
use crate::args;
use crate::commands::{Context, ls};
use clap::{Arg, ArgMatches, Command, value_parser};
use railbus_api::fleet::{FleetCommand, FleetCommandEnd};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{out, values};
use railbus_words::{Code, Lang, time};
use serde_json::Value;

/// The name of the command.
pub(super) const NAME: &str = "commands";

/// How many are shown if nothing is said.
const LIMIT: usize = 20;

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet commands [SITE] [--limit N]";
    super::verb(lang, NAME, FleetText::CommandsAbout, usage)
        .arg(Arg::new("SITE").help(lang.get(FleetText::SiteName)))
        .arg(
            args::flag(lang, "limit", FleetText::Limit)
                .value_name("N")
                .value_parser(value_parser!(usize)),
        )
}

/// Prints the newest commands, the newest last.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let told = super::ask(context, matches, async |hub| hub.commands().await)?;
    let site = super::text(matches, "SITE");
    let limit = matches.get_one("limit").copied().unwrap_or(LIMIT);
    let of_site = |one: &FleetCommand| site.is_empty() || one.site == site;
    let all: Vec<FleetCommand> = told.commands.into_iter().filter(of_site).collect();
    let newest = all
        .get(all.len().saturating_sub(limit)..)
        .unwrap_or_default();
    let table = Table::new(lang.get(FleetText::CommandsHead).split('|'));
    let mut table = table.spare(&[3, 0]);
    for one in newest {
        table.add([
            when(&one.at),
            one.site.clone(),
            what(lang, one),
            one.user.clone(),
            result(lang, &one.end),
        ]);
    }
    let shown = Records {
        key: "commands",
        rows: ls::json_of(newest),
        columns: &[
            "at",
            "site",
            "id",
            "user",
            "method",
            "path",
            "body",
            "how",
            "code",
            "confirmed",
            "end_at",
        ],
        value: "id",
        table,
    };
    out::result(lang, &shown.render(context.format))
}

/// A time by the clock of this machine.
fn when(at: &str) -> String {
    match at.parse::<jiff::Timestamp>() {
        Ok(at) => time::date_and_clock(at.as_millisecond()),
        Err(_) => at.to_owned(),
    }
}

/// A command, as it is written at the terminal.
fn what(lang: Lang, command: &FleetCommand) -> String {
    let path = command
        .path
        .strip_prefix("/api/v1/")
        .unwrap_or(&command.path);
    let body: Value = serde_json::from_str(&command.body).unwrap_or_default();
    let state = |value: Option<&Value>| {
        let on = value.and_then(Value::as_bool);
        on.map(|on| values::state(lang, on).to_owned())
    };
    let parts: Vec<&str> = path.split('/').collect();
    let known = match parts[..] {
        ["points", module, label] => {
            state(body.get("value")).map(|state| format!("{module}.{label} {state}"))
        }
        ["points", module, label, verb] => Some(format!("{module}.{label} {verb}")),
        ["modules", module, "outputs"] => body.get("set").and_then(Value::as_object).map(|set| {
            let each = set.iter();
            let each = each.map(|(label, on)| {
                let on = state(Some(on)).unwrap_or_default();
                format!("{label}={on}")
            });
            format!("{module} {}", each.collect::<Vec<_>>().join(" "))
        }),
        ["groups", group, "set"] => {
            let word = body.get("value").and_then(Value::as_str).map(str::to_owned);
            let state = state(body.get("value")).or(word);
            state.map(|state| format!("@{group} {state}"))
        }
        ["scenes", scene, "run"] => Some(format!("scene {scene}")),
        ["batch"] => body.get("set").and_then(Value::as_array).map(|set| {
            let paths = set.iter().filter_map(|one| one.get("path")?.as_str());
            paths.collect::<Vec<_>>().join(" ")
        }),
        _ => None,
    };
    known.unwrap_or_else(|| format!("{} {path} {}", command.method, command.body))
}

/// Its result.
fn result(lang: Lang, end: &FleetCommandEnd) -> String {
    let Some(how) = &end.how else {
        return lang.get(FleetText::NoEndYet).to_owned();
    };
    let code = end.code.as_deref().unwrap_or_default();
    let title = Code::from_name(code)
        .map(|code| code.page().title(lang))
        .unwrap_or_default();
    let why = format!("{code} {title}");
    match (how.as_str(), code) {
        ("answered", "") => match end.confirmed.as_deref() {
            Some("sent") => lang.get(FleetText::SentOnly).to_owned(),
            _ => lang.get(FleetText::Done).to_owned(),
        },
        ("answered", _) => why.trim().to_owned(),
        ("never", _) => lang.fill(FleetText::NotDone, &[("why", &why.trim())]),
        _ => lang.get(FleetText::NeverKnown).to_owned(),
    }
}
