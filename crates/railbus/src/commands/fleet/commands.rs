//! `railbus fleet commands`: the commands that were given to sites, and their results.

use super::FleetText;
use super::set::{self, texts::BulkText};
use crate::args;
use crate::commands::{Context, ls};
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use railbus_api::fleet::{FleetBulk, FleetBulkSite, FleetBulkState, FleetCommand, FleetCommandEnd};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{out, values};
use railbus_app::texts::AppText;
use railbus_words::{Code, Lang, reasons, time};
use serde_json::Value;

/// The name of the command.
pub(super) const NAME: &str = "commands";

/// How many are shown if nothing is said.
const LIMIT: usize = 20;
/// How much of an id is shown in a table.
const ID_SHOWN: usize = 8;

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet commands [SITE|ID] [--limit N] [--stop]";
    super::verb(lang, NAME, FleetText::CommandsAbout, usage)
        .arg(
            Arg::new("SITE")
                .help(lang.get(FleetText::SiteOrId))
                .value_name("SITE|ID"),
        )
        .arg(args::flag(lang, "stop", BulkText::StopIt).action(ArgAction::SetTrue))
        .arg(
            args::flag(lang, "limit", FleetText::Limit)
                .value_name("N")
                .value_parser(value_parser!(usize)),
        )
}

/// Prints the newest commands, the newest last; or one to many sites, with its sites.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let told = super::ask(context, matches, async |hub| hub.commands().await)?;
    let site = super::text(matches, "SITE");
    // A shorter one may be the name of a site.
    let is_id = site.len() >= ID_SHOWN;
    let of_id = |bulk: &&FleetBulk| is_id && bulk.id.starts_with(site);
    let mut found = told.bulk.iter().filter(of_id);
    if let (Some(FleetBulk { id, .. }), None) = (found.next(), found.next()) {
        let stops = matches.get_flag("stop");
        let told = super::ask(context, matches, async |hub| {
            if stops {
                hub.stop_bulk(id).await?;
            }
            hub.bulk(id, true).await
        })?;
        context.note(&one_bulk(lang, &told.bulk));
        if !told.connected {
            context.note(lang.get(BulkText::NotAll));
        }
        return set::tell(context, &told);
    }
    if matches.get_flag("stop") {
        let message = lang.fill(BulkText::NoSuch, &[("id", &site)]);
        return Err(Failure::new(Code::NoBulk, message).with_try("railbus fleet commands"));
    }
    let limit = matches.get_one("limit").copied().unwrap_or(LIMIT);
    let of_site = |one: &&FleetCommand| site.is_empty() || one.site == site;
    let single = told.commands.iter().filter(of_site);
    let single = single.map(|one| {
        let row = ls::json_of(std::slice::from_ref(one));
        let target = what(lang, (&one.method, &one.path, &one.body));
        (
            &one.at,
            row,
            [
                one.site.clone(),
                target,
                one.user.clone(),
                result(lang, &one.end),
            ],
        )
    });
    let many = told.bulk.iter().filter(|_| site.is_empty()).map(|bulk| {
        let mut row = ls::json_of(std::slice::from_ref(bulk));
        for row in &mut row {
            row["sites"] = bulk.counts.all.into();
        }
        let target = what(lang, (&bulk.method, &bulk.path, &bulk.body));
        let cells = [
            some_sites(lang, bulk),
            target,
            bulk.user.clone(),
            counted(lang, bulk),
        ];
        (&bulk.at, row, cells)
    });
    let mut all: Vec<_> = single.chain(many).collect();
    all.sort_by_key(|(at, ..)| *at);
    let newest = all.split_off(all.len().saturating_sub(limit));
    let table = Table::new(lang.get(FleetText::CommandsHead).split('|'));
    let mut table = table.spare(&[3, 0]);
    let mut rows = Vec::new();
    for (at, row, [site, target, user, result]) in newest {
        rows.extend(row);
        table.add([when(at), site, target, user, result]);
    }
    let shown = Records {
        key: "commands",
        rows,
        columns: &[
            "at",
            "site",
            "sites",
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

/// How many sites it goes to, and the beginning of its id.
fn some_sites(lang: Lang, bulk: &FleetBulk) -> String {
    let sites = match bulk.counts.all {
        1 => lang.get(BulkText::OneSite).to_owned(),
        count => lang.fill(BulkText::ManySites, &[("count", &count)]),
    };
    let id: String = bulk.id.chars().take(ID_SHOWN).collect();
    let values: &[(&str, &dyn std::fmt::Display)] = &[("sites", &sites), ("id", &id)];
    lang.fill(BulkText::Many, values)
}

/// What a command to many sites was, and who gave it.
fn one_bulk(lang: Lang, bulk: &FleetBulk) -> String {
    let target = what(lang, (&bulk.method, &bulk.path, &bulk.body));
    let parts = [
        when(&bulk.at),
        target,
        bulk.user.clone(),
        counted(lang, bulk),
    ];
    parts.join("  ")
}

/// How many sites are how, those that are at all.
fn counted(lang: Lang, bulk: &FleetBulk) -> String {
    let counts = &bulk.counts;
    let all = [
        (counts.done, BulkText::DoneAt),
        (counts.unconfirmed, BulkText::UnconfirmedAt),
        (counts.failed, BulkText::FailedAt),
        (counts.never, BulkText::NeverAt),
        (counts.unknown, BulkText::UnknownAt),
        (counts.sent, BulkText::OpenAt),
        (counts.waiting, BulkText::WaitingAt),
    ];
    let some = all.into_iter().filter(|(count, _)| *count > 0);
    let some = some.map(|(count, text)| lang.fill(text, &[("count", &count)]));
    let stopped = bulk.stopped_by.as_ref();
    let stopped = stopped.map(|who| lang.fill(BulkText::StoppedBy, &[("who", who)]));
    let parts: Vec<String> = some.chain(stopped).collect();
    parts.join(lang.get(AppText::Comma))
}

/// A time by the clock of this machine.
pub(super) fn when(at: &str) -> String {
    match at.parse::<jiff::Timestamp>() {
        Ok(at) => time::date_and_clock(at.as_millisecond()),
        Err(_) => at.to_owned(),
    }
}

/// A command, as it is written at the terminal.
fn what(lang: Lang, (method, path, text): (&str, &str, &str)) -> String {
    let path = path.strip_prefix("/api/v1/").unwrap_or(path);
    let body: Value = serde_json::from_str(text).unwrap_or_default();
    let state = |value: Option<&Value>| {
        let on = value.and_then(Value::as_bool);
        on.map(|on| values::state(lang, on).to_owned())
    };
    let parts: Vec<&str> = path.split('/').collect();
    let known = match parts[..] {
        ["points", module, label] => {
            state(body.get("value")).map(|state| format!("{module}.{label} {state}"))
        }
        ["points", module, label, verb] => Some(format!("{module}.{label} {}", said(lang, verb))),
        ["modules", module, "outputs"] => body.get("set").and_then(Value::as_object).map(|set| {
            let each = set.iter();
            let each = each.map(|(label, on)| {
                let on = state(Some(on)).unwrap_or_default();
                format!("{label}={on}")
            });
            format!("{module} {}", each.collect::<Vec<_>>().join(" "))
        }),
        ["groups", group, "set"] => {
            let word = body.get("value").and_then(Value::as_str);
            let word = word.map(|word| said(lang, word).to_owned());
            let state = state(body.get("value")).or(word);
            state.map(|state| format!("@{group} {state}"))
        }
        ["scenes", scene, "run"] => Some(lang.fill(FleetText::Scene, &[("name", &scene)])),
        ["batch"] => body.get("set").and_then(Value::as_array).map(|set| {
            let paths = set.iter().filter_map(|one| one.get("path")?.as_str());
            paths.collect::<Vec<_>>().join(" ")
        }),
        _ => None,
    };
    known.unwrap_or_else(|| format!("{method} {path} {text}"))
}

/// The word of a command for people.
fn said(lang: Lang, verb: &str) -> &str {
    match verb {
        "toggle" => lang.get(FleetText::Toggle),
        "pulse" => lang.get(FleetText::Pulse),
        other => other,
    }
}

/// What became of a site of a command to many.
pub(super) fn bulk_result(lang: Lang, site: &FleetBulkSite) -> String {
    match site.state {
        FleetBulkState::Waiting => lang.get(BulkText::NotSentYet).to_owned(),
        _ => result(lang, &site.end),
    }
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
    // The site, or the centre, says it more exactly.
    let said = end.reason.as_deref().filter(|_| how == "never");
    let said = said.map(|reason| reasons::told(lang, reason));
    let why = format!("{code} {}", said.as_deref().unwrap_or(title));
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
