//! The configuration file of a running site: a change must be based on the current text, and
//! previous texts are kept with their author and time.

use super::edit::{self, WriteError};
use railbus_store::durable;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// How many generations are kept.
pub const KEPT_MAX: usize = 20;
/// The maximum size of a configuration.
pub const TEXT_MAX: usize = 1 << 20;
/// The maximum size of a generation's file: its text with every character escaped.
const GENERATION_MAX: u64 = 8 << 20;
/// The folder of the generations, inside the site's state folder.
const FOLDER: &str = "config";

/// A text that the file had, or has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Generation {
    /// Its number; newer ones have higher numbers.
    pub id: u64,
    /// When it was written, or found, in milliseconds since 1970.
    pub at_ms: u64,
    /// Who wrote it; `None` if another program did, and it was found so.
    pub who: Option<String>,
    /// The text.
    pub text: String,
}

impl Generation {
    /// When it was written, or found.
    #[must_use]
    pub fn at(&self) -> SystemTime {
        SystemTime::UNIX_EPOCH + Duration::from_millis(self.at_ms)
    }
}

/// Keeps a configuration file and its generations. All methods block on the disk.
#[derive(Clone, Debug)]
pub struct ConfigFile {
    file: PathBuf,
    folder: PathBuf,
}

impl ConfigFile {
    /// A keeper of this file, with the state folder of the site. Neither has to exist yet.
    #[must_use]
    pub fn new(file: PathBuf, state: &Path) -> ConfigFile {
        let folder = state.join(FOLDER);
        ConfigFile { file, folder }
    }

    /// The file.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The text of the file; empty if there is none.
    ///
    /// # Errors
    /// If the system refuses, or the file is not text or too long.
    pub fn read(&self) -> io::Result<String> {
        edit::text_of(&self.file)
    }

    /// Replaces the text if it is still the one that the writer has seen.
    ///
    /// # Errors
    /// [`WriteError::Changed`] if the file was changed meanwhile. After an error nothing has
    /// changed.
    pub fn write(&self, seen: &str, text: &str, who: &str) -> Result<(), WriteError> {
        if text.len() > TEXT_MAX {
            return Err(too_long().into());
        }
        let _held = edit::hold(&self.file)?;
        if self.read()? != seen {
            return Err(WriteError::Changed);
        }
        let mut kept = self.generations();
        let newest = kept.last();
        if newest.map_or(!seen.is_empty(), |newest| newest.text != seen) {
            let found = generation(newest, None, seen);
            self.keep(&found)?;
            kept.push(found);
        }
        let new = generation(kept.last(), Some(who.to_owned()), text);
        self.keep(&new)?;
        if let Err(error) = edit::put(&self.file, text) {
            let _ = std::fs::remove_file(self.place(new.id));
            return Err(error.into());
        }
        self.forget(&kept);
        Ok(())
    }

    /// All generations kept, oldest first. Those that can't be read are left out.
    #[must_use]
    pub fn generations(&self) -> Vec<Generation> {
        let entries = std::fs::read_dir(&self.folder)
            .into_iter()
            .flatten()
            .flatten();
        let paths = entries.map(|entry| entry.path());
        let mut found: Vec<Generation> = paths
            .filter(|path| path.extension().is_some_and(|ending| ending == "json"))
            .filter_map(|path| read_generation(&path))
            .collect();
        found.sort_by_key(|generation| generation.id);
        found
    }

    /// One of them.
    #[must_use]
    pub fn generation(&self, id: u64) -> Option<Generation> {
        read_generation(&self.place(id)).filter(|found| found.id == id)
    }

    /// The newest generation that differs from `now`: the text before the last change. Going back
    /// twice restores the first text.
    #[must_use]
    pub fn before(&self, now: &str) -> Option<Generation> {
        let kept = self.generations();
        kept.into_iter().rev().find(|kept| kept.text != now)
    }

    fn place(&self, id: u64) -> PathBuf {
        self.folder.join(format!("{id:08}.json"))
    }

    fn keep(&self, generation: &Generation) -> io::Result<()> {
        durable::folder(&self.folder)?;
        let text = serde_json::to_string(generation)?;
        durable::replace(&self.place(generation.id), text.as_bytes(), Some(0o600))
    }

    /// Deletes the oldest, after the newest was written.
    fn forget(&self, kept: &[Generation]) {
        let surplus = (kept.len() + 1).saturating_sub(KEPT_MAX);
        for old in kept.iter().take(surplus) {
            // If deleting fails, the next write tries again.
            let _ = std::fs::remove_file(self.place(old.id));
        }
    }
}

/// The fingerprint of a text by which readers name the version they have seen.
#[must_use]
pub fn etag(text: &str) -> String {
    let hash = Sha256::digest(text.as_bytes());
    let mut tag = String::with_capacity(32);
    for byte in hash.iter().take(16) {
        // Writing to a string never fails.
        let _ = write!(tag, "{byte:02x}");
    }
    tag
}

pub(super) fn too_long() -> io::Error {
    let words = format!("longer than {TEXT_MAX} bytes");
    io::Error::new(io::ErrorKind::FileTooLarge, words)
}

fn generation(newest: Option<&Generation>, who: Option<String>, text: &str) -> Generation {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let millis = now.unwrap_or_default().as_millis();
    Generation {
        id: newest.map_or(1, |newest| newest.id.saturating_add(1)),
        at_ms: u64::try_from(millis).unwrap_or(u64::MAX),
        who,
        text: text.to_owned(),
    }
}

fn read_generation(path: &Path) -> Option<Generation> {
    let mut text = String::new();
    let file = File::open(path).ok()?;
    file.take(GENERATION_MAX).read_to_string(&mut text).ok()?;
    serde_json::from_str(&text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Folder {
            let unique = format!("railbus-keeper-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(unique);
            std::fs::create_dir_all(&folder).unwrap();
            Folder(folder)
        }

        fn keeper(&self) -> ConfigFile {
            ConfigFile::new(self.0.join("railbus.toml"), &self.0.join("state"))
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    fn told(keeper: &ConfigFile) -> Vec<(u64, Option<String>, String)> {
        let kept = keeper.generations().into_iter();
        kept.map(|kept| (kept.id, kept.who, kept.text)).collect()
    }

    #[test]
    fn what_it_said_before_stays_at_hand() {
        let folder = Folder::new("generations");
        let keeper = folder.keeper();
        assert_eq!(keeper.read().unwrap(), "");
        keeper.write("", "a", "li").unwrap();
        keeper.write("a", "b", "mo").unwrap();
        let by = |who: &str| Some(who.to_owned());
        let (first, second) = ((1, by("li"), "a".to_owned()), (2, by("mo"), "b".to_owned()));
        assert_eq!(told(&keeper), [first, second]);
        assert_eq!(keeper.before("b").unwrap().text, "a");
        keeper.write("b", "a", "mo").unwrap();
        assert_eq!(keeper.before("a").unwrap().text, "b");
        assert_eq!(keeper.generation(2).unwrap().text, "b");
        assert_eq!(keeper.generation(9), None);
    }

    #[test]
    fn a_change_by_another_program_is_seen_and_kept() {
        let folder = Folder::new("outside");
        let keeper = folder.keeper();
        keeper.write("", "a", "li").unwrap();
        std::fs::write(keeper.file(), "by hand").unwrap();
        let refused = keeper.write("a", "b", "li");
        assert!(matches!(refused, Err(WriteError::Changed)), "{refused:?}");
        assert_eq!(keeper.read().unwrap(), "by hand");
        keeper.write("by hand", "b", "li").unwrap();
        let found = &told(&keeper)[1];
        assert_eq!(*found, (2, None, "by hand".to_owned()));
    }

    #[test]
    fn only_the_last_are_kept() {
        let folder = Folder::new("last");
        let keeper = folder.keeper();
        let mut before = String::new();
        for number in 0..KEPT_MAX + 5 {
            let text = format!("# {number}");
            keeper.write(&before, &text, "li").unwrap();
            before = text;
        }
        let kept = keeper.generations();
        assert_eq!(kept.len(), KEPT_MAX);
        assert_eq!(kept.last().unwrap().text, before);
        let long = " ".repeat(TEXT_MAX + 1);
        assert!(keeper.write(&before, &long, "li").is_err());
        assert_eq!(keeper.read().unwrap(), before);
    }

    #[test]
    fn what_can_not_be_written_changes_nothing() {
        let folder = Folder::new("refused");
        let keeper = folder.keeper();
        keeper.write("", "a", "li").unwrap();
        // A folder is in the way of the new file.
        std::fs::create_dir(folder.0.join("railbus.toml.new")).unwrap();
        assert!(matches!(
            keeper.write("a", "b", "li"),
            Err(WriteError::Io(_))
        ));
        assert_eq!(keeper.read().unwrap(), "a");
        assert_eq!(told(&keeper).len(), 1);
    }

    #[test]
    fn each_text_has_a_mark_of_its_own() {
        assert_eq!(etag("a"), etag("a"));
        assert_ne!(etag("a"), etag("b"));
        assert_eq!(etag("").len(), 32);
    }
}
