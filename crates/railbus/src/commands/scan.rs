//! `railbus scan`: who is on the line. It only reads.

mod asked;
mod identify;
mod plan;
mod run;
mod show;

use super::place::{self, Access};
use super::{Context, stop};
use crate::cli;
use crate::failure::{Code, Failure};
use crate::i18n::Lang;
use crate::texts::Text;
use asked::Asked;
use clap::{ArgMatches, Command};
use plan::Scope;
use railbus_wire::Protocol;

/// The name of the command.
pub(crate) const NAME: &str = "scan";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus scan [-l LINE] [--addr 1-32] [--proto P,…] [--checksum auto|on|off]";
    cli::verb(lang, NAME, Text::ScanAbout, usage)
        .before_help(cli::examples(lang, Text::ScanExamples))
        .arg(
            cli::flag(lang, "addr", Text::ScanAddr)
                .value_name("RANGE")
                .value_parser(plan::addresses),
        )
        .arg(
            cli::flag(lang, "proto", Text::ScanProto)
                .value_name("P,…")
                .value_delimiter(',')
                .value_parser(Protocol::ALL.map(Protocol::name))
                .hide_possible_values(true),
        )
        .arg(
            cli::flag(lang, "checksum", Text::ScanChecksum)
                .value_name("WHEN")
                .value_parser(["auto", "on", "off"])
                .hide_possible_values(true),
        )
}

/// Scans and prints what was found, also after Ctrl-C.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let scope = scope(matches);
    let (place, report) = context.block(async {
        let mut stop = stop::Stop::new(&context)?;
        let (place, asked) = match place::find(&context).await? {
            Access::Here(place) => (place.clone(), Asked::open(&context, &place).await?),
            Access::Daemon(backend) => {
                let place = place::of(&context, &backend).await?;
                (place, Asked::Daemon(backend))
            }
        };
        let report = run::scan(&context, &place, asked, &scope, &mut stop).await?;
        Ok((place, report))
    })?;
    show::result(&context, &place, &report)?;
    if !report.complete {
        return Err(stop::interrupted(&context));
    }
    if report.found.is_empty() {
        let failure = Failure::of(lang, Code::NoReply).with_fact("line", place.line);
        return Err(failure.with_fact("probes", report.probes));
    }
    Ok(())
}

fn scope(matches: &ArgMatches) -> Scope {
    let names: Vec<&str> = matches
        .get_many::<String>("proto")
        .into_iter()
        .flatten()
        .map(String::as_str)
        .collect();
    let wanted = |protocol: &Protocol| names.is_empty() || names.contains(&protocol.name());
    let checksums = match matches.get_one::<String>("checksum").map(String::as_str) {
        Some("on") => vec![true],
        Some("off") => vec![false],
        _ => vec![false, true],
    };
    let addresses: Option<&plan::Addresses> = matches.get_one("addr");
    Scope {
        addresses: addresses.map_or_else(|| (1..=32).collect(), |chosen| chosen.0.clone()),
        protocols: Protocol::ALL.into_iter().filter(wanted).collect(),
        checksums,
    }
}
