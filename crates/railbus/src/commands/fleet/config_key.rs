//! `railbus fleet config-key`: the key by which sites know a configuration of their centre.

use super::config::texts::SiteConfigText;
use super::{FleetText, site_keys, unusable};
use crate::commands::Context;
use clap::{ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_fleet::desired::ConfigSigner;
use railbus_fleet::founding::CONFIG_SIGNING;
use railbus_store::durable;
use railbus_words::Lang;
use serde_json::json;
use std::io::ErrorKind;
use std::path::Path;

/// The name of the command.
pub(super) const NAME: &str = "config-key";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    super::verb(
        lang,
        NAME,
        SiteConfigText::Key,
        "railbus fleet config-key DIR",
    )
    .arg(super::required(lang, "DIR", FleetText::Folder))
}

/// Prints the public key of a fleet. One that has none gets one.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let folder = super::path(matches, "DIR");
    let path = folder.join(CONFIG_SIGNING);
    let (signer, is_new) = match read(lang, &path)? {
        Some(signer) => (signer, false),
        None => make(lang, &folder, &path)?,
    };
    let key = signer.public_key();
    let text = match context.format {
        Format::Table | Format::Value | Format::Csv => format!("{key}\n"),
        _ => records::line(json!({ "config_key": key, "made": is_new })),
    };
    out::result(lang, &text)?;
    if is_new {
        context.note(lang.get(SiteConfigText::KeyMade));
    }
    Ok(())
}

/// The key in this file; none if there is no file.
fn read(lang: Lang, path: &Path) -> Result<Option<ConfigSigner>, Failure> {
    let seed = match std::fs::read_to_string(path) {
        Ok(seed) => seed,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(unusable(lang, path, &error)),
    };
    let signer = ConfigSigner::from_seed(&seed);
    signer
        .map(Some)
        .map_err(|error| unusable(lang, path, &error))
}

/// Makes the key, unless another command has just made it; and whether it is new.
fn make(lang: Lang, folder: &Path, path: &Path) -> Result<(ConfigSigner, bool), Failure> {
    // Only in the folder of a fleet.
    let servers = folder.join("hub/servers");
    std::fs::metadata(&servers).map_err(|error| unusable(lang, &servers, &error))?;
    let alone = site_keys::alone(lang, path)?;
    if let Some(signer) = read(lang, path)? {
        return Ok((signer, false));
    }
    let signer = ConfigSigner::generate();
    let seed = signer
        .seed()
        .map_err(|error| unusable(lang, path, &error))?;
    let written = durable::replace(path, format!("{seed}\n").as_bytes(), Some(0o600));
    written.map_err(|error| unusable(lang, path, &error))?;
    drop(alone);
    Ok((signer, true))
}
