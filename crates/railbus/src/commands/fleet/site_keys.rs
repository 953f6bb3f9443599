//! Which keys a site was given, and which of all were revoked: text files in the folder of a fleet.

use super::unusable;
use railbus_app::failure::Failure;
#[cfg(feature = "fleet")]
use railbus_fleet::revocation::RevokedKey;
use railbus_store::durable;
use railbus_words::Lang;
use std::fs::OpenOptions;
#[cfg(feature = "fleet")]
use std::io::ErrorKind;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The keys that a site was given, a line each: the public key, and until when it is valid in
/// seconds since 1970.
pub(super) fn of_site(folder: &Path, site: &str) -> PathBuf {
    folder.join("hub/sites").join(format!("{site}.keys"))
}

/// Notes a key. Called before the key is handed out: one that is not noted can't be revoked.
pub(super) fn note(lang: Lang, path: &Path, key: &str, until: u64) -> Result<(), Failure> {
    let written = || {
        if let Some(parent) = path.parent() {
            durable::folder(parent)?;
        }
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        file.write_all(format!("{key} {until}\n").as_bytes())?;
        file.sync_all()
    };
    written().map_err(|error| unusable(lang, path, &error))
}

/// The keys of a site that are still valid at this time.
#[cfg(feature = "fleet")]
pub(super) fn valid(lang: Lang, path: &Path, now: u64) -> Result<Vec<String>, Failure> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(unusable(lang, path, &error)),
    };
    let lines = text.lines().map(|line| line.split_once(' '));
    let keys = lines.map(|line| line.and_then(|(key, until)| Some((key, until.parse().ok()?))));
    let keys: Option<Vec<(&str, u64)>> = keys.collect();
    let keys = keys.ok_or_else(|| unusable(lang, path, &"a line is not KEY TIME"))?;
    let valid = keys.into_iter().filter(|(_, until)| *until >= now);
    Ok(valid.map(|(key, _)| key.to_owned()).collect())
}

/// All keys that were revoked, a line each: the public key, since when, and the site.
#[cfg(feature = "fleet")]
pub(super) fn revoked(lang: Lang, path: &Path) -> Result<Vec<RevokedKey>, Failure> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(unusable(lang, path, &error)),
    };
    let read = |line: &str| {
        let mut words = line.split(' ');
        let (key, at) = (words.next()?.to_owned(), words.next()?.parse().ok()?);
        Some(RevokedKey { key, at })
    };
    let keys: Option<Vec<RevokedKey>> = text.lines().map(read).collect();
    keys.ok_or_else(|| unusable(lang, path, &"a line is not KEY TIME SITE"))
}

/// Adds revoked keys of a site. Called before servers are told: whoever is interrupted repeats it.
#[cfg(feature = "fleet")]
pub(super) fn add_revoked(
    lang: Lang,
    path: &Path,
    site: &str,
    keys: &[RevokedKey],
) -> Result<(), Failure> {
    let lines = keys
        .iter()
        .map(|each| format!("{} {} {site}\n", each.key, each.at));
    let lines: String = lines.collect();
    let written = || {
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        file.write_all(lines.as_bytes())?;
        file.sync_all()
    };
    written().map_err(|error| unusable(lang, path, &error))
}
