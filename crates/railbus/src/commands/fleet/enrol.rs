//! `railbus fleet enrol`: an invitation, by which a site gets its key from the centre.

use super::{FleetText, creds};
use crate::args;
use crate::commands::Context;
use clap::{ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_fleet::invitation::Invitation;
use railbus_fleet::{NodeAddress, SiteClaims};
use railbus_words::Lang;
use serde_json::json;
use std::path::Path;

/// The name of the command.
pub(super) const NAME: &str = "enrol";
/// The file that is the output.
pub(super) const OUTPUT: &str = "-";

/// For how many hours an invitation is valid, where nothing is said.
const HOURS: u64 = 24;
/// The most: 30 days.
const HOURS_MAX: u64 = 720;

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet enrol DIR SITE FILE [--hours HOURS]";
    let hours = args::flag(lang, "hours", FleetText::Hours)
        .value_name("HOURS")
        .value_parser(value_parser!(u64).range(1..=HOURS_MAX));
    super::verb(lang, NAME, FleetText::Enrol, usage)
        .arg(super::required(lang, "DIR", FleetText::Folder))
        .arg(super::required(lang, "SITE", FleetText::Site))
        .arg(super::required(lang, "FILE", FleetText::InvitationFile))
        .arg(hours)
}

/// Writes the invitation of a site.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let folder = super::path(matches, "DIR");
    let (site, file) = (super::text(matches, "SITE"), super::path(matches, "FILE"));
    let hours = matches.get_one::<u64>("hours").copied().unwrap_or(HOURS);
    let (invitation, claims) = invitation(lang, &folder, site, hours)?;
    let until = creds::until(&claims);
    match file.as_os_str() == OUTPUT {
        true => out::result(lang, &invitation.text())?,
        false => {
            creds::create(lang, &file, &invitation.text())?;
            let path = file.display().to_string();
            let text = match context.format {
                Format::Table | Format::Value | Format::Csv => format!("{path}\n"),
                _ => records::line(json!({ "site": site, "file": path, "until": until })),
            };
            out::result(lang, &text)?;
        }
    }
    let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &site), ("hours", &hours)];
    context.note(&lang.fill(FleetText::Enrolled, values));
    Ok(())
}

/// An invitation of this site, valid for so many hours, and what its claims say.
pub(super) fn invitation(
    lang: Lang,
    folder: &Path,
    site: &str,
    hours: u64,
) -> Result<(Invitation, SiteClaims), Failure> {
    let (servers, ca) = fleet(lang, folder)?;
    let (creds, claims) = creds::signed(lang, folder, "join-signing.nk", (site, hours * 3_600))?;
    let invitation = Invitation {
        site: site.to_owned(),
        servers,
        ca,
        creds,
    };
    Ok((invitation, claims))
}

/// The servers of the fleet, and the certificate of its authority.
fn fleet(lang: Lang, folder: &Path) -> Result<(Vec<NodeAddress>, String), Failure> {
    let read = |name: &str| {
        let path = folder.join("hub").join(name);
        let text = std::fs::read_to_string(&path);
        let text = text.map_err(|error| super::unusable(lang, &path, &error))?;
        Ok((path, text))
    };
    let (path, text) = read("servers")?;
    let servers: Option<Vec<NodeAddress>> =
        text.split_whitespace().map(NodeAddress::parse).collect();
    let servers = servers.filter(|servers| !servers.is_empty());
    let none = || super::unusable(lang, &path, &lang.get(FleetText::NoServers));
    Ok((servers.ok_or_else(none)?, read("ca.pem")?.1))
}
