//! `railbus fleet`: many sites behind one centre.

mod commands;
mod config;
mod config_key;
mod creds;
#[cfg(feature = "fleet")]
mod demo;
mod enrol;
mod get;
mod group;
mod init;
mod join;
mod ls;
mod remove;
#[cfg(feature = "fleet")]
mod revoke;
#[cfg(feature = "fleet")]
mod serve;
mod set;
mod site_keys;
mod texts;

use super::Context;
use super::context::hub_socket;
use crate::args;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use jiff::Timestamp;
use railbus_api::problem::Problem;
use railbus_app::failure::Failure;
use railbus_client::HubClient;
use railbus_fleet::is_site_name;
use railbus_words::{Code, Lang, Phrase};
use std::path::{Path, PathBuf};
use texts::FleetText;

/// The name of the command.
pub(crate) const NAME: &str = "fleet";

pub(super) use ls::{ago, key_end};

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let group = verb(lang, NAME, FleetText::About, "railbus fleet COMMAND")
        .subcommand_required(true)
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand(init::define(lang))
        .subcommand(enrol::define(lang))
        .subcommand(join::define(lang))
        .subcommand(creds::define(lang))
        .subcommand(config_key::define(lang));
    #[cfg(feature = "fleet")]
    let group = group
        .subcommand(demo::define(lang))
        .subcommand(revoke::define(lang))
        .subcommand(serve::define(lang));
    group
        .subcommand(ls::define(lang))
        .subcommand(get::define(lang))
        .subcommand(set::define(lang))
        .subcommand(config::define(lang))
        .subcommand(group::define(lang))
        .subcommand(remove::define(lang))
        .subcommand(commands::define(lang))
}

fn verb(lang: Lang, name: &'static str, about: impl Phrase, usage: &'static str) -> Command {
    let examples = args::examples(lang, FleetText::Examples);
    args::verb(lang, name, about, usage).before_help(examples)
}

fn required(lang: Lang, name: &'static str, help: impl Phrase) -> Arg {
    Arg::new(name).required(true).help(lang.get(help))
}

/// Runs a command of the group.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    // The parser accepts no arguments without a known command.
    let Some((verb, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let context = Context::of(lang, matches)?;
    match verb {
        init::NAME => init::run(&context, matches),
        enrol::NAME => enrol::run(&context, matches),
        join::NAME => join::run(&context, matches),
        creds::NAME => creds::run(&context, matches),
        config_key::NAME => config_key::run(&context, matches),
        #[cfg(feature = "fleet")]
        demo::NAME => demo::run(&context, matches),
        #[cfg(feature = "fleet")]
        revoke::NAME => revoke::run(&context, matches),
        #[cfg(feature = "fleet")]
        serve::NAME => serve::run(lang, matches),
        ls::NAME => ls::run(&context, matches),
        config::NAME => config::run(&context, matches),
        group::NAME => group::run(&context, matches),
        remove::NAME => remove::run(&context, matches),
        set::NAME => set::run(&context, matches),
        commands::NAME => commands::run(&context, matches),
        _ => get::run(&context, matches),
    }
}

fn text<'m>(matches: &'m ArgMatches, name: &str) -> &'m str {
    let text = matches.get_one::<String>(name);
    text.map(String::as_str).unwrap_or_default()
}

/// Refuses what can't be the name of a site or a group, with this text.
fn named(lang: Lang, name: &str, wrong: FleetText) -> Result<(), Failure> {
    match is_site_name(name) {
        true => Ok(()),
        false => Err(Failure::new(Code::Usage, lang.get(wrong).to_owned())),
    }
}

fn path(matches: &ArgMatches, name: &str) -> PathBuf {
    text(matches, name).into()
}

/// Asks the centre.
fn ask<T>(
    context: &Context,
    matches: &ArgMatches,
    question: impl AsyncFnOnce(&HubClient) -> Result<T, Problem>,
) -> Result<T, Failure> {
    let named = hub_socket(matches);
    context.block(async {
        let answer = async { question(&HubClient::find(named.as_deref()).await?).await };
        answer.await.map_err(|problem| context.failure(&problem))
    })
}

/// Seconds since 1970.
pub(super) fn now() -> u64 {
    u64::try_from(Timestamp::now().as_second()).unwrap_or_default()
}

/// A file of the fleet can't be used, for this reason.
pub(super) fn unusable(lang: Lang, file: &Path, reason: &dyn std::fmt::Display) -> Failure {
    Failure::of(lang, Code::FleetFile).because(format!("{}: {reason}", file.display()))
}
