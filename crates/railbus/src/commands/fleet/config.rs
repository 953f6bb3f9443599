//! `railbus fleet config`: the configuration of a far site.

mod sending;
pub(super) mod texts;

use super::enrol::OUTPUT;
use super::ls::ago;
use super::{FleetText, commands};
use crate::args;
use crate::commands::{Context, hex};
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_api::fleet::{FleetConfig, FleetConfigPhase, FleetConfigState, FleetPresence};
use railbus_app::failure::Failure;
use railbus_app::render::records::{self, Records};
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out};
use railbus_fleet::trial::{TRIAL, part_hash};
use railbus_words::width::is_shown;
use railbus_words::{Code, Lang, reasons};
use serde_json::{Map, Value, json};
use std::io::IsTerminal as _;
use texts::SiteConfigText;

/// The name of the command.
pub(super) const NAME: &str = "config";

/// How many digits of a hash are shown; at least so many are given.
const HASH_SHOWN: usize = 8;

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet config SITE [FILE [--replace HASH]|--text|--wanted]";
    let switch = |name, help| args::flag(lang, name, help).action(ArgAction::SetTrue);
    args::verb(lang, NAME, SiteConfigText::About, usage)
        .before_help(args::examples(lang, SiteConfigText::Examples))
        .arg(super::required(lang, "SITE", FleetText::SiteName))
        .arg(Arg::new("FILE").help(lang.get(SiteConfigText::File)))
        .arg(switch("text", SiteConfigText::Now).conflicts_with_all(["FILE", "wanted"]))
        .arg(switch("wanted", SiteConfigText::Newest).conflicts_with("FILE"))
        .arg(
            args::flag(lang, "replace", SiteConfigText::Replace)
                .value_name("HASH")
                .requires("FILE"),
        )
        .arg(switch("no-wait", SiteConfigText::NoWait).requires("FILE"))
}

/// Shows it, prints one of its texts, or gives the site another one.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let site = super::text(matches, "SITE");
    super::named(lang, site, FleetText::BadName)?;
    if matches.contains_id("FILE") {
        return sending::run(context, matches, site);
    }
    if matches.get_flag("text") {
        let told = super::ask(context, matches, async |hub| hub.config_text(site).await)?;
        let row = json!({ "site": told.site, "text": told.text, "hash": told.hash });
        print(context, &told.text, row)?;
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("site", &site), ("hash", &short(&told.hash))];
        context.note(&lang.fill(SiteConfigText::HashNote, values));
        return Ok(());
    }
    let told = super::ask(context, matches, async |hub| hub.config(site).await)?;
    if !matches.get_flag("wanted") {
        return out::result(lang, &shown(context, &told).render(context.format));
    }
    let Some(wanted) = told.wanted else {
        let message = lang.fill(SiteConfigText::NoneWanted, &[("site", &site)]);
        let failure = Failure::new(Code::NoGeneration, message);
        return Err(failure.with_try(format!("railbus fleet config {site} FILE")));
    };
    let row = json!({
        "site": told.site, "version": wanted.version, "user": wanted.user, "at": wanted.at,
        "text": wanted.text,
    });
    print(context, &wanted.text, row)
}

/// The beginning of a hash.
fn short(hash: &str) -> &str {
    hash.get(..HASH_SHOWN).unwrap_or(hash)
}

/// Prints a text, or this in JSON. A terminal is not controlled by it.
fn print(context: &Context, text: &str, row: Value) -> Result<(), Failure> {
    let text = match context.format {
        Format::Table | Format::Value | Format::Csv => text.to_owned(),
        _ => records::line(row),
    };
    let is_kept = |letter: &char| is_shown(*letter) || matches!(letter, '\n' | '\r' | '\t');
    match std::io::stdout().is_terminal() {
        true => out::result(
            context.lang,
            &text.chars().filter(is_kept).collect::<String>(),
        ),
        false => out::result(context.lang, &text),
    }
}

/// How far it is.
fn shown(context: &Context, told: &FleetConfig) -> Records {
    let lang = context.lang;
    let mut table = Table::bare();
    let mut add = |label: SiteConfigText, text: String| {
        table.add([lang.get(label).to_owned(), text]);
    };
    let given = told.wanted.as_ref().map(|wanted| {
        let at = commands::when(&wanted.at);
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("version", &wanted.version),
            ("user", &wanted.user),
            ("at", &at),
        ];
        lang.fill(SiteConfigText::Given, values)
    });
    let none = || lang.get(SiteConfigText::NoneGiven).to_owned();
    add(SiteConfigText::RowGiven, given.unwrap_or_else(none));
    let is_online = told.presence == FleetPresence::Online;
    let state = match (&told.state, is_online) {
        (Some(state), _) => phase(lang, state),
        (None, true) => lang.get(SiteConfigText::TakesNone).to_owned(),
        (None, false) => lang.get(SiteConfigText::NotHeard).to_owned(),
    };
    add(SiteConfigText::RowState, state);
    if let Some(state) = &told.state {
        if let Some(kept) = state.kept.filter(|kept| state.version != Some(*kept)) {
            let kept = lang.fill(SiteConfigText::Version, &[("version", &kept)]);
            add(SiteConfigText::RowKept, kept);
        }
        for why in why(context, state) {
            add(SiteConfigText::RowWhy, why);
        }
        if state.changed_at_site {
            add(SiteConfigText::RowHash, short(&state.hash).to_owned());
        }
        if !is_online {
            add(SiteConfigText::RowHeard, ago(lang, state.heard_ms));
        }
    }
    Records {
        key: "sites",
        rows: vec![row(told)],
        columns: &[
            "site",
            "presence",
            "given",
            "user",
            "at",
            "phase",
            "version",
            "kept",
            "hash",
            "changed_at_site",
            "code",
            "reason",
            "heard_ms",
        ],
        value: "phase",
        table,
    }
}

/// How far it is, in a few words.
fn phase(lang: Lang, state: &FleetConfigState) -> String {
    let text = match state.phase {
        FleetConfigPhase::Unmanaged => SiteConfigText::Unmanaged,
        FleetConfigPhase::Current => SiteConfigText::Current,
        FleetConfigPhase::Pending => SiteConfigText::Pending,
        FleetConfigPhase::Trying => SiteConfigText::Trying,
        FleetConfigPhase::Refused => SiteConfigText::Refused,
        FleetConfigPhase::RolledBack => SiteConfigText::RolledBack,
        FleetConfigPhase::LocalChange => SiteConfigText::LocalChange,
        FleetConfigPhase::Interrupted => SiteConfigText::Interrupted,
        FleetConfigPhase::Other => SiteConfigText::OtherPhase,
    };
    let (version, seconds) = (state.version.unwrap_or_default(), TRIAL.as_secs());
    let values: &[(&str, &dyn std::fmt::Display)] = &[("version", &version), ("seconds", &seconds)];
    lang.fill(text, values)
}

/// Why it is so, as far as there is something to say.
fn why(context: &Context, state: &FleetConfigState) -> Vec<String> {
    let lang = context.lang;
    let mut all = Vec::new();
    if let Some(problem) = &state.problem {
        let failure = context.failure(problem);
        all.push(format!("{} {}", failure.code().name(), failure.message()));
        all.extend(failure.why().iter().cloned());
    }
    all.extend(state.reason.as_deref().map(|why| reasons::told(lang, why)));
    // Of these it is said, or is not so.
    let is_told = matches!(
        state.phase,
        FleetConfigPhase::LocalChange | FleetConfigPhase::Interrupted | FleetConfigPhase::Trying
    );
    // An empty text was made by nobody.
    let none = hex(&part_hash(""));
    if state.changed_at_site && state.hash != none && !is_told {
        all.push(lang.get(SiteConfigText::NotTheCentres).to_owned());
    }
    all
}

/// The same for programs.
fn row(told: &FleetConfig) -> Value {
    let mut row = Map::new();
    let mut add = |key: &str, value: Value| {
        if !value.is_null() {
            row.insert(key.to_owned(), value);
        }
    };
    add("site", told.site.as_str().into());
    add(
        "presence",
        serde_json::to_value(told.presence).unwrap_or_default(),
    );
    if let Some(wanted) = &told.wanted {
        add("given", wanted.version.into());
        add("user", wanted.user.as_str().into());
        add("at", wanted.at.as_str().into());
    }
    if let Some(state) = &told.state {
        let problem = state.problem.as_ref();
        let reason = problem.map(|problem| problem.text("reason"));
        let reason = reason.filter(|reason| !reason.is_empty());
        add(
            "phase",
            serde_json::to_value(state.phase).unwrap_or_default(),
        );
        add("version", state.version.into());
        add("kept", state.kept.into());
        add("hash", state.hash.as_str().into());
        add("changed_at_site", state.changed_at_site.into());
        add("code", problem.map(|problem| problem.code.clone()).into());
        add("reason", reason.or_else(|| state.reason.clone()).into());
        add("heard_ms", state.heard_ms.into());
    }
    row.into()
}
