//! `railbus fleet revoke`: the keys of a site are let in no longer.

use super::FleetText;
use super::site_keys::{self, NotedKey};
use crate::args;
use crate::commands::Context;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_fleet::SITE_VALID_S;
use railbus_fleet::revocation::{RevokedKey, is_site_key};
use railbus_gateway::hub;
use railbus_words::{Code, Lang};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The name of the command.
pub(super) const NAME: &str = "revoke";

/// A key that is not noted is valid for so long at most, in seconds.
const UNNOTED_S: u64 = SITE_VALID_S;

/// Servers and centre distinguish no times within it: what is made in the second of the revocation
/// is refused.
const DAY_S: u64 = 86_400;
const SECOND: Duration = Duration::from_secs(1);

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet revoke DIR [SITE] [--key KEY] [--offline DIR]";
    let offline = args::flag(lang, "offline", FleetText::OfflineFolder)
        .value_name("DIR")
        .value_parser(clap::value_parser!(PathBuf));
    let key = args::flag(lang, "key", FleetText::UnnotedKey)
        .value_name("KEY")
        .action(ArgAction::Append)
        .requires("SITE");
    let site = Arg::new("SITE").help(lang.get(FleetText::RevokedSite));
    super::verb(lang, NAME, FleetText::Revoke, usage)
        .arg(super::required(lang, "DIR", FleetText::Folder))
        .arg(site)
        .arg(key)
        .arg(offline)
}

/// Revokes all keys that the site was given until now, and hands over all that was revoked.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let folder = super::path(matches, "DIR");
    let offline: Option<&PathBuf> = matches.get_one("offline");
    let offline = offline.map_or_else(|| folder.join("offline"), Clone::clone);
    let signing_file = offline.join("operator-signing.nk");
    let signing = std::fs::read_to_string(&signing_file);
    let signing = signing.map_err(|error| super::unusable(lang, &signing_file, &error))?;
    let revoked_file = offline.join("revoked");
    let _alone = site_keys::alone(lang, &revoked_file)?;
    let mut keys = site_keys::revoked(lang, &revoked_file)?;
    let site = matches.get_one::<String>("SITE");
    let (new, not_noted) = match site {
        Some(site) => new_keys(context, matches, (&folder, site), &keys)?,
        // A server that was away, or that lost its claims, gets all of them.
        None => (Vec::new(), None),
    };
    if let Some(site) = site {
        // Revoked once more, a key is not noted again.
        let is_noted = |each: &RevokedKey| {
            let as_long = |known: &RevokedKey| known.at.saturating_add(DAY_S) >= each.at;
            keys.iter()
                .any(|known| known.key == each.key && as_long(known))
        };
        let added = new.iter().filter(|each| !is_noted(each));
        let lines = added.map(|each| format!("{} {} {site}\n", each.key, each.at));
        site_keys::add(lang, &revoked_file, &lines.collect::<String>())?;
    }
    keys.extend(new.iter().cloned());
    let done = hub::revoke_keys(lang, &folder, signing.trim(), &keys, super::now())?;
    // Without a site: all of them.
    let told = if site.is_some() { &new } else { &keys };
    let names: Vec<&str> = told.iter().map(|each| each.key.as_str()).collect();
    let servers = match done.servers.is_empty() {
        true => "–".to_owned(),
        false => done.servers.join(" "),
    };
    let text = match context.format {
        Format::Table => {
            let of = text_of(site);
            let values: &[(&str, &dyn std::fmt::Display)] = &[
                ("count", &names.len()),
                ("site", &of),
                ("servers", &servers),
            ];
            let text = match site {
                Some(_) => FleetText::Revoked,
                None => FleetText::AllRevoked,
            };
            format!("{}\n", lang.fill(text, values))
        }
        Format::Value | Format::Csv => names.iter().map(|key| format!("{key}\n")).collect(),
        _ => records::line(json!({ "site": site, "keys": names, "servers": done.servers })),
    };
    out::result(lang, &text)?;
    let mut again = format!("railbus fleet revoke {}", folder.display());
    if not_noted.is_some() {
        again += &format!(" {}", text_of(site));
        for key in matches.get_many::<String>("key").into_iter().flatten() {
            again += &format!(" --key {key}");
        }
    }
    if let Some(offline) = matches.get_one::<PathBuf>("offline") {
        again += &format!(" --offline {}", offline.display());
    }
    if done.servers.len() < done.of {
        let (told, of) = (done.servers.len(), done.of);
        let values: &[(&str, &dyn std::fmt::Display)] = &[("told", &told), ("of", &of)];
        let failure = Failure::new(Code::Partial, lang.fill(FleetText::NotAllServers, values));
        let failure = done.refused.into_iter().fold(failure, Failure::because);
        let failure = not_noted.iter().fold(failure, |failure, why| {
            let failure = failure.because(lang.get(FleetText::NotNoted));
            failure.because(why.message())
        });
        return Err(failure.with_try(again));
    }
    if let Some(failure) = not_noted {
        let message = lang.get(FleetText::NotNoted).to_owned();
        return Err(Failure::new(Code::Partial, message)
            .because(failure.message())
            .with_try(again));
    }
    if let Some(site) = site {
        context.note(&lang.fill(FleetText::NewKey, &[("site", site)]));
        std::thread::sleep(SECOND);
    }
    Ok(())
}

fn text_of(site: Option<&String>) -> &str {
    site.map_or("", String::as_str)
}

/// The keys of this site that are noted in the folder and by the centre, and those that are named;
/// and why those of the centre are not known, where they are not.
fn new_keys(
    context: &Context,
    matches: &ArgMatches,
    (folder, site): (&Path, &str),
    revoked: &[RevokedKey],
) -> Result<(Vec<RevokedKey>, Option<Failure>), Failure> {
    let lang = context.lang;
    super::named(lang, site, FleetText::BadName)?;
    let noted_file = site_keys::of_site(folder, site);
    let mut keys = site_keys::noted(lang, &noted_file)?;
    let named = matches.get_many::<String>("key").into_iter().flatten();
    for key in named {
        if !is_site_key(key) {
            let values: &[(&str, &dyn std::fmt::Display)] = &[("name", &"--key"), ("value", key)];
            return Err(Failure::new(Code::Usage, lang.fill(Text::BadValue, values)));
        }
        keys.push((key.clone(), super::now().saturating_add(UNNOTED_S)));
    }
    let is_named = !keys.is_empty();
    // The centre renews none of them from now on.
    let issued = hub::revoke_issued(lang, folder, site, &keys);
    let not_noted = match issued {
        Ok(issued) => {
            let issued = issued
                .into_iter()
                .map(|issued| (issued.key, issued.until_s));
            keys = merged(keys, issued);
            None
        }
        Err(failure) if keys.is_empty() => return Err(failure),
        Err(failure) => Some(failure),
    };
    let is_revoked = |(key, _): &NotedKey| revoked.iter().any(|each| each.key == *key);
    if !is_named && keys.iter().all(is_revoked) {
        std::thread::sleep(SECOND);
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("site", &site), ("file", &noted_file.display())];
        return Err(Failure::new(
            Code::NoSite,
            lang.fill(FleetText::NoKeys, values),
        ));
    }
    // Until they have expired: no key is made twice, and clocks differ. What is noted may be from
    // before a renewal.
    let least = super::now().saturating_add(SITE_VALID_S);
    let revoked = keys.into_iter().map(|(key, until)| RevokedKey {
        key,
        at: until.max(least),
    });
    Ok((revoked.collect(), not_noted))
}

/// Keys, each once, with the latest time until which it is valid.
fn merged(keys: Vec<NotedKey>, others: impl Iterator<Item = NotedKey>) -> Vec<NotedKey> {
    let mut all = std::collections::BTreeMap::new();
    for (key, until) in keys.into_iter().chain(others) {
        let latest = all.entry(key).or_insert(until);
        *latest = until.max(*latest);
    }
    all.into_iter().collect()
}
