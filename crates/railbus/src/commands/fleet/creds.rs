//! `railbus fleet creds`: a key for a site, made beside the centre and carried to the site by hand.

use super::{FleetText, site_keys};
use crate::commands::Context;
use clap::{ArgMatches, Command};
use jiff::Timestamp;
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_fleet::{CredsError, SITE_VALID_S, SiteClaims, SiteSigner, read_site_creds};
use railbus_words::time::rfc3339;
use railbus_words::{Code, Lang};
use serde_json::json;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

/// The name of the command.
pub(super) const NAME: &str = "creds";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    super::verb(
        lang,
        NAME,
        FleetText::Creds,
        "railbus fleet creds DIR SITE FILE",
    )
    .arg(super::required(lang, "DIR", FleetText::Folder))
    .arg(super::required(lang, "SITE", FleetText::Site))
    .arg(super::required(lang, "FILE", FleetText::File))
}

/// Writes the file of a site.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let folder = super::path(matches, "DIR");
    let (site, file) = (super::text(matches, "SITE"), super::path(matches, "FILE"));
    let (creds, claims) = signed(lang, &folder, "site-signing.nk", (site, SITE_VALID_S))?;
    create(lang, &file, &creds)?;
    let until = until(&claims);
    let path = file.display().to_string();
    let text = match context.format {
        Format::Table | Format::Value | Format::Csv => format!("{path}\n"),
        _ => records::line(json!({ "site": site, "file": path, "until": until })),
    };
    out::result(lang, &text)?;
    let day = until.split('T').next().unwrap_or_default();
    context.note(&lang.fill(FleetText::CredsMade, &[("site", &site), ("day", &day)]));
    Ok(())
}

/// Until when these are valid, as RFC 3339.
pub(super) fn until(claims: &SiteClaims) -> String {
    let until = claims.expires.and_then(|at| i64::try_from(at).ok());
    let until = until.and_then(|at| Timestamp::from_second(at).ok());
    until.map(rfc3339).unwrap_or_default()
}

/// Credentials of a site with a new key, signed by this key of the folder `hub` and valid for so
/// many seconds, and what they say. They are noted, so that they can be revoked.
pub(super) fn signed(
    lang: Lang,
    folder: &Path,
    signing: &str,
    (site, valid): (&str, u64),
) -> Result<(String, SiteClaims), Failure> {
    let read = |name: &str| {
        let path = folder.join("hub").join(name);
        let text = std::fs::read_to_string(&path);
        let text = text.map_err(|error| super::unusable(lang, &path, &error))?;
        Ok((path, text.trim().to_owned()))
    };
    let (signing_file, signing) = read(signing)?;
    let (account_file, account) = read("sites-account.pub")?;
    let unusable = |error: CredsError| match error {
        CredsError::Name => Failure::new(Code::Usage, lang.get(FleetText::BadName).to_owned()),
        CredsError::Account => super::unusable(lang, &account_file, &error),
        CredsError::Signing | CredsError::Key | CredsError::Claims => {
            super::unusable(lang, &signing_file, &error)
        }
    };
    let signer = SiteSigner::new(&signing, &account).map_err(unusable)?;
    let creds = signer.creds(site, super::now(), valid).map_err(unusable)?;
    let claims = read_site_creds(&creds).map_err(unusable)?;
    let keys = site_keys::of_site(folder, site);
    // Before it is handed out: a key that is not noted can't be revoked.
    let alone = site_keys::alone(lang, &keys)?;
    let until = claims.expires.unwrap_or(u64::MAX);
    site_keys::add(lang, &keys, &format!("{} {until}\n", claims.key))?;
    drop(alone);
    Ok((creds, claims))
}

/// Writes a new file that only its owner can read.
pub(super) fn create(lang: Lang, path: &Path, text: &str) -> Result<(), Failure> {
    let made = OpenOptions::new()
        .create_new(true)
        .write(true)
        .mode(0o600)
        .open(path);
    let written = made.and_then(|mut file| {
        let written = file
            .write_all(text.as_bytes())
            .and_then(|()| file.sync_all());
        written.inspect_err(|_| {
            // Half of it is of no use.
            let _ = std::fs::remove_file(path);
        })
    });
    written.map_err(|error| super::unusable(lang, path, &error))
}
