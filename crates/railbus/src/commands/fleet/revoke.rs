//! `railbus fleet revoke`: the keys of a site are let in no longer.

use super::{FleetText, site_keys};
use crate::args;
use crate::commands::Context;
use clap::{ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_fleet::is_site_name;
use railbus_fleet::revocation::RevokedKey;
use railbus_gateway::hub;
use railbus_words::{Code, Lang};
use serde_json::json;
use std::path::PathBuf;

/// The name of the command.
pub(super) const NAME: &str = "revoke";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet revoke DIR SITE [--offline DIR]";
    let offline = args::flag(lang, "offline", FleetText::OfflineFolder)
        .value_name("DIR")
        .value_parser(clap::value_parser!(PathBuf));
    super::verb(lang, NAME, FleetText::Revoke, usage)
        .arg(super::required(lang, "DIR", FleetText::Folder))
        .arg(super::required(lang, "SITE", FleetText::SiteName))
        .arg(offline)
}

/// Revokes all keys that the site was given until now.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let (folder, site) = (super::path(matches, "DIR"), super::text(matches, "SITE"));
    if !is_site_name(site) {
        let message = lang.get(FleetText::BadName).to_owned();
        return Err(Failure::new(Code::Usage, message));
    }
    let offline: Option<&PathBuf> = matches.get_one("offline");
    let offline = offline.map_or_else(|| folder.join("offline"), Clone::clone);
    let signing_file = offline.join("operator-signing.nk");
    let signing = std::fs::read_to_string(&signing_file);
    let signing = signing.map_err(|error| {
        let failure = super::unusable(lang, &signing_file, &error);
        failure.with_try(format!("railbus fleet revoke DIR {site} --offline DIR"))
    })?;
    let now = super::now();
    let given = site_keys::valid(lang, &site_keys::of_site(&folder, site), now)?;
    if given.is_empty() {
        let message = lang.fill(FleetText::NoKeys, &[("site", &site)]);
        return Err(Failure::new(Code::NoSite, message));
    }
    let revoked_file = offline.join("revoked");
    // All of them: a server that lost its claims has them again then.
    let mut keys = site_keys::revoked(lang, &revoked_file)?;
    // Later than the last time: of two of one second a server could keep the earlier one.
    let last = keys.iter().map(|each| each.at).max().unwrap_or_default();
    let now = now.max(last.saturating_add(1));
    let new: Vec<RevokedKey> = given
        .into_iter()
        .map(|key| RevokedKey { key, at: now })
        .collect();
    site_keys::add_revoked(lang, &revoked_file, site, &new)?;
    keys.extend(new.iter().cloned());
    let done = hub::revoke_keys(lang, &folder, signing.trim(), &keys, now)?;
    let servers = done.servers.join(" ");
    let names: Vec<&str> = new.iter().map(|each| each.key.as_str()).collect();
    let text = match context.format {
        Format::Table => {
            let values: &[(&str, &dyn std::fmt::Display)] = &[
                ("count", &names.len()),
                ("site", &site),
                ("servers", &servers),
            ];
            format!("{}\n", lang.fill(FleetText::Revoked, values))
        }
        Format::Value | Format::Csv => format!("{}\n", names.join("\n")),
        _ => records::line(json!({ "site": site, "keys": names, "servers": done.servers })),
    };
    out::result(lang, &text)?;
    if done.servers.len() < done.of {
        let (told, of) = (done.servers.len(), done.of);
        let values: &[(&str, &dyn std::fmt::Display)] = &[("told", &told), ("of", &of)];
        let failure = Failure::new(Code::Partial, lang.fill(FleetText::NotAllServers, values));
        return Err(failure.with_try(format!("railbus fleet revoke {} {site}", folder.display())));
    }
    context.note(&lang.fill(FleetText::NewKey, &[("site", &site)]));
    Ok(())
}
