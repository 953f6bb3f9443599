//! `railbus fleet join`: this site takes up an invitation.

use super::FleetText;
use super::enrol::OUTPUT;
use crate::args;
use crate::commands::Context;
use clap::{ArgAction, ArgMatches, Command};
use hyper::Method;
use railbus_api::outlets::OutletJoined;
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_fleet::invitation::INVITATION_MAX;
use railbus_words::Lang;
use serde_json::json;
use std::fs::File;
use std::io::{Read, stdin};
use std::path::Path;

/// The name of the command.
pub(super) const NAME: &str = "join";

/// What the integration is called where nothing is said.
const INTEGRATION: &str = "fleet";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet join FILE [--name NAME] [--managed]";
    let name = args::flag(lang, "name", FleetText::IntegrationName).value_name("NAME");
    super::verb(lang, NAME, FleetText::Join, usage)
        .arg(super::required(lang, "FILE", FleetText::Invitation))
        .arg(name)
        .arg(args::flag(lang, "managed", FleetText::Managed).action(ArgAction::SetTrue))
}

/// Hands the invitation over to the daemon, which makes its key.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let invitation = read(lang, &super::path(matches, "FILE"))?;
    let name = matches.get_one::<String>("name");
    let name = name.map_or(INTEGRATION, String::as_str);
    let managed = matches.get_flag("managed");
    let joined: OutletJoined = context.block(async {
        let daemon = context.daemon().await?;
        let none = || Problem::new(codes::DAEMON).with_hint("railbus serve");
        let daemon = daemon.ok_or_else(|| context.failure(&none()))?;
        let path = ["outlets", "fleet", name, "join"];
        let body = json!({ "invitation": invitation, "managed": managed });
        let told = daemon.request(Method::POST, &path, &body).await;
        let told = told.map_err(|problem| context.failure(&problem))?;
        serde_json::from_value(told).map_err(|error| {
            let problem = Problem::new(codes::DAEMON).with("reason", error.to_string());
            context.failure(&problem)
        })
    })?;
    let until = joined.until.as_deref().unwrap_or_default();
    let text = match context.format {
        Format::Table => {
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("site", &joined.called), ("name", &joined.outlet)];
            lang.fill(FleetText::Joined, values) + "\n"
        }
        Format::Value | Format::Csv => format!("{}\n", joined.called),
        _ => records::line(json!({
            "site": joined.called, "outlet": joined.outlet, "until": until,
        })),
    };
    out::result(lang, &text)?;
    context.note(&lang.fill(FleetText::JoinedNote, &[("name", &joined.outlet)]));
    if managed {
        context.note(&lang.fill(FleetText::ManagedNote, &[("name", &joined.outlet)]));
    }
    Ok(())
}

/// The text of the file, or of the input.
fn read(lang: Lang, path: &Path) -> Result<String, Failure> {
    let mut text = String::new();
    // What is longer is none.
    let most = u64::try_from(INVITATION_MAX).unwrap_or(u64::MAX) + 1;
    let read = match path.as_os_str() == OUTPUT {
        true => stdin().take(most).read_to_string(&mut text),
        false => File::open(path).and_then(|file| file.take(most).read_to_string(&mut text)),
    };
    read.map_err(|error| super::unusable(lang, path, &error))?;
    Ok(text)
}
