//! Which keys a site was given, and which of all were revoked: text files in the folder of a fleet,
//! a line each. A last line without an end was never finished, and does not count.

use super::unusable;
use railbus_app::failure::Failure;
#[cfg(feature = "fleet")]
use railbus_fleet::revocation::{RevokedKey, is_site_key};
use railbus_store::durable;
use railbus_words::Lang;
use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A public key, and until when it is valid in seconds since 1970.
#[cfg(feature = "fleet")]
pub(super) type NotedKey = (String, u64);

/// Where the keys that a site was given are noted.
pub(super) fn of_site(folder: &Path, site: &str) -> PathBuf {
    folder.join("hub/sites").join(format!("{site}.keys"))
}

/// Waits until no other command changes what is noted; until the file is dropped none does.
pub(super) fn alone(lang: Lang, path: &Path) -> Result<File, Failure> {
    let lock = path.with_file_name("lock");
    let locked = || {
        if let Some(parent) = path.parent() {
            durable::folder(parent)?;
        }
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&lock)?;
        file.lock()?;
        Ok(file)
    };
    locked().map_err(|error: std::io::Error| unusable(lang, &lock, &error))
}

/// Adds lines to a file; all of them or none.
pub(super) fn add(lang: Lang, path: &Path, lines: &str) -> Result<(), Failure> {
    let text = whole(lang, path)? + lines;
    let written = durable::replace(path, text.as_bytes(), Some(0o600));
    written.map_err(|error| unusable(lang, path, &error))
}

/// The finished lines of a file; none if there is no file.
fn whole(lang: Lang, path: &Path) -> Result<String, Failure> {
    match std::fs::read_to_string(path) {
        Ok(text) => {
            let end = text.rfind('\n').map_or(0, |at| at + 1);
            Ok(text[..end].to_owned())
        }
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(String::new()),
        Err(error) => Err(unusable(lang, path, &error)),
    }
}

/// The keys that a site was given.
#[cfg(feature = "fleet")]
pub(super) fn noted(lang: Lang, path: &Path) -> Result<Vec<NotedKey>, Failure> {
    read(lang, path, |words| match words[..] {
        [key, until] => Some((key.to_owned(), until.parse().ok()?)),
        _ => None,
    })
}

/// All keys that were revoked: the third word is their site.
#[cfg(feature = "fleet")]
pub(super) fn revoked(lang: Lang, path: &Path) -> Result<Vec<RevokedKey>, Failure> {
    read(lang, path, |words| match words[..] {
        [key, at, _] => Some(RevokedKey {
            key: key.to_owned(),
            at: at.parse().ok()?,
        }),
        _ => None,
    })
}

/// Reads each line, whose first word is a key.
#[cfg(feature = "fleet")]
fn read<T>(
    lang: Lang,
    path: &Path,
    line: impl Fn(Vec<&str>) -> Option<T>,
) -> Result<Vec<T>, Failure> {
    let text = whole(lang, path)?;
    let lines = text.lines().enumerate();
    let read = lines.map(|(at, text)| {
        let words: Vec<&str> = text.split(' ').collect();
        let is_key = words.first().is_some_and(|key| is_site_key(key));
        let read = is_key.then(|| line(words)).flatten();
        read.ok_or_else(|| unusable(lang, path, &format!("line {}: {text}", at + 1)))
    });
    read.collect()
}
