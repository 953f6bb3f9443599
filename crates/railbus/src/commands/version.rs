//! `railbus version`: the version of the program, and what it was built with.

use crate::args;
use crate::commands::Context;
use crate::texts::Text;
use clap::{ArgMatches, Command};
use railbus_api::types::SCHEMA;
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_device::Family;
use railbus_wire::Protocol;
use railbus_words::Lang;
use serde_json::json;
use std::env::consts::{ARCH, OS};

/// The name of the command.
pub(crate) const NAME: &str = "version";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, Text::VersionAbout, "railbus version")
}

/// Prints the version and the supported features.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let version = env!("CARGO_PKG_VERSION");
    let text = match context.format {
        Format::Json | Format::Ndjson => records::line(json!({
            "version": version, "os": OS, "arch": ARCH, "api": SCHEMA,
            "models": Family::ALL.map(Family::name), "protocols": Protocol::ALL.map(Protocol::name),
        })),
        Format::Value => format!("{version}\n"),
        Format::Csv => format!("version,os,arch\n{version},{OS},{ARCH}\n"),
        Format::Table => format!(
            "railbus {version}  {OS} {ARCH}\n{}\n{}\n",
            Family::ALL.map(Family::name).join(" "),
            Protocol::ALL.map(Protocol::name).join(" "),
        ),
    };
    out::result(lang, &text)
}
