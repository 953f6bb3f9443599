//! `railbus audit`: checks that the audit log is complete and was not changed. Asks the daemon, or
//! reads the files if none runs.

mod texts;

use super::Context;
use crate::args;
use crate::backend::DaemonClient;
use crate::texts::Text;
use clap::{ArgMatches, Command};
use railbus_api::past::VerifiedInfo;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::past::{AUDIT_COLUMNS, audit_text, unread, verified};
use railbus_app::failure::Failure;
use railbus_app::render::csv::csv;
use railbus_app::render::{Format, out, records};
use railbus_store::audit::{export_folder, verify_folder};
use railbus_words::Code;
use railbus_words::Lang;
use std::path::Path;
use texts::AuditText;

/// The name of the command.
pub(crate) const NAME: &str = "audit";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let verb = |name, about, usage| {
        let examples = args::examples(lang, AuditText::Examples);
        args::verb(lang, name, about, usage).before_help(examples)
    };
    args::verb(lang, NAME, AuditText::About, "railbus audit COMMAND")
        .before_help(args::examples(lang, AuditText::Examples))
        .subcommand_required(true)
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand(verb("verify", AuditText::Verify, "railbus audit verify"))
        .subcommand(verb(
            "export",
            AuditText::Export,
            "railbus audit export [-o csv]",
        ))
}

/// Runs a command of the group.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    // The parser accepts no arguments without a known command.
    let Some((verb, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let context = Context::of(lang, matches)?;
    match verb {
        "verify" => verify(&context),
        _ => export(&context),
    }
}

fn verify(context: &Context) -> Result<(), Failure> {
    let told = context.block(async {
        let files = context.files().await?;
        let told = match files.daemon {
            Some(daemon) => daemon.verified_audit().await,
            None => of_folder(&files.state),
        };
        told.map_err(|problem| context.failure(&problem))
    })?;
    if let Some(record) = told.broken_at {
        let lang = context.lang;
        let why = lang.fill(AuditText::BrokenAt, &[("record", &record)]);
        return Err(Failure::of(lang, Code::AuditBroken).because(why));
    }
    out::result(context.lang, &whole(context, &told))
}

fn of_folder(folder: &Path) -> Result<VerifiedInfo, Problem> {
    verify_folder(folder)
        .map(verified)
        .map_err(|error| missing(&error))
}

fn missing(error: &std::io::Error) -> Problem {
    match error.kind() {
        std::io::ErrorKind::NotFound => Problem::new(codes::NO_HISTORY).with_hint("railbus serve"),
        std::io::ErrorKind::WouldBlock => Problem::new(codes::AUDIT_HELD),
        _ => unread(error),
    }
}

fn whole(context: &Context, told: &VerifiedInfo) -> String {
    if context.format == Format::Table {
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("entries", &told.entries),
            ("records", &told.records),
            ("first", &told.first),
        ];
        return context.lang.fill(AuditText::Whole, values) + "\n";
    }
    // A struct of numbers is always valid JSON.
    records::line(serde_json::to_value(told).unwrap_or_default())
}

/// Prints every record with its hash: as CSV if that is asked for, otherwise as one JSON document
/// per line.
fn export(context: &Context) -> Result<(), Failure> {
    let is_csv = context.format == Format::Csv;
    context.block(async {
        let files = context.files().await?;
        match files.daemon {
            Some(daemon) => copy(context, &daemon, is_csv).await,
            None => print(context, &files.state, is_csv),
        }
    })
}

async fn copy(context: &Context, daemon: &DaemonClient, is_csv: bool) -> Result<(), Failure> {
    let failed = |problem: Problem| context.failure(&problem);
    let mut lines = daemon.audit(is_csv).await.map_err(failed)?;
    while let Some(line) = lines.next().await {
        out::result(context.lang, &format!("{}\n", line.map_err(failed)?))?;
    }
    Ok(())
}

fn print(context: &Context, folder: &Path, is_csv: bool) -> Result<(), Failure> {
    let failed = |problem: Problem| context.failure(&problem);
    let mut from = None;
    let mut text = match is_csv {
        true => csv(&AUDIT_COLUMNS),
        false => String::new(),
    };
    loop {
        let piece = export_folder(folder, from).map_err(|error| failed(missing(&error)))?;
        text += &audit_text(&piece.records, is_csv);
        out::result(context.lang, &text.replace("\r\n", "\n"))?;
        if piece.records.is_empty() {
            return Ok(());
        }
        text.clear();
        from = Some(piece.next);
    }
}
