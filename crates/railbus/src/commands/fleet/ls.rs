//! `railbus fleet ls`: the sites.

use super::FleetText;
use crate::args;
use crate::commands::{Context, ls};
use clap::{ArgMatches, Command};
use jiff::Timestamp;
use railbus_api::fleet::{FleetPresence, FleetSite};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::texts::AppText;
use railbus_fleet::{CLOCK_OFF_MS, KEY_ENDS_SOON_S};
use railbus_words::{Lang, time};

/// The name of the command.
pub(super) const NAME: &str = "ls";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet ls [--group NAME]";
    super::verb(lang, NAME, FleetText::Ls, usage)
        .arg(args::flag(lang, "group", FleetText::OneGroup).value_name("NAME"))
}

/// Prints all sites.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let wanted = matches.get_one::<String>("group");
    if let Some(name) = wanted {
        super::named(lang, name, FleetText::BadGroup)?;
    }
    let told = super::ask(context, matches, async |hub| match wanted {
        Some(group) => hub.sites_in(group).await,
        None => hub.sites().await,
    })?;
    let has_groups = told.sites.iter().any(|site| !site.groups.is_empty());
    let head = lang.get(FleetText::SitesHead).split('|');
    let groups_head = has_groups.then(|| lang.get(FleetText::GroupsHead));
    let mut table = Table::new(head.chain(groups_head));
    for site in &told.sites {
        let groups = has_groups.then(|| site.groups.join(" "));
        let cells = [
            site.site.clone(),
            lang.get(state(site)).to_owned(),
            lang.get(values(site)).to_owned(),
            site.heard_ms.map_or_else(dash, |ms| ago(lang, ms)),
            site.behind.map_or_else(dash, |behind| behind.to_string()),
            notes(lang, site),
        ];
        table.add(cells.into_iter().chain(groups));
    }
    let shown = Records {
        key: "sites",
        rows: ls::json_of(&told.sites),
        columns: &[
            "site", "presence", "current", "heard_ms", "known_ms", "behind", "points", "version",
            "groups",
        ],
        value: "site",
        table,
    };
    out::result(lang, &shown.render(context.format))?;
    match told.connection.error {
        // What is shown is what was known; or no site gets a session.
        Some(problem) => Err(context.failure(&problem)),
        None => Ok(()),
    }
}

fn dash() -> String {
    "–".to_owned()
}

const fn state(site: &FleetSite) -> FleetText {
    match site.presence {
        FleetPresence::Online => FleetText::Online,
        FleetPresence::Offline => FleetText::Away,
        FleetPresence::Unknown => FleetText::Unknown,
    }
}

const fn values(site: &FleetSite) -> FleetText {
    match (site.current, site.points) {
        (true, _) => FleetText::Current,
        (false, 0) => FleetText::None,
        (false, _) => FleetText::Old,
    }
}

/// How long ago something was.
pub(in crate::commands) fn ago(lang: Lang, millis: u64) -> String {
    let time = time::span(lang, millis / 1_000);
    lang.fill(FleetText::Ago, &[("time", &time)])
}

fn notes(lang: Lang, site: &FleetSite) -> String {
    let copied = site.duplicate_ms.map(|ms| {
        let ago = ago(lang, ms);
        lang.fill(FleetText::Copied, &[("ago", &ago)])
    });
    let off = site.clock_ahead_ms.map(i64::unsigned_abs);
    let clock = off.filter(|off| *off > CLOCK_OFF_MS).map(|off| {
        let time = time::span(lang, off / 1_000);
        lang.fill(FleetText::ClockOff, &[("time", &time)])
    });
    let key = key_end(site, super::now());
    let key = key.map(|day| lang.fill(FleetText::KeyEnds, &[("day", &day)]));
    let notes: Vec<String> = copied.into_iter().chain(clock).chain(key).collect();
    notes.join(lang.get(AppText::Comma))
}

/// The day on which the key of a site expires, if that is so soon that it should have been renewed.
pub(in crate::commands) fn key_end(site: &FleetSite, now_s: u64) -> Option<String> {
    let until: Timestamp = site.key_until.as_deref()?.parse().ok()?;
    let soon = now_s.saturating_add(KEY_ENDS_SOON_S);
    let is_soon = u64::try_from(until.as_second()).is_ok_and(|at| at < soon);
    is_soon.then(|| until.strftime("%Y-%m-%d").to_string())
}
