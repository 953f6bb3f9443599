//! The topics at which the broker may have something of an outlet: in a file of the state folder,
//! so that what has another name after a restart leaves nothing behind.

use super::discovery::MARK;
use railbus_store::durable;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, ErrorKind, Read as _};
use std::path::{Path, PathBuf};

/// The longest file that is read.
const LEN_MAX: u64 = 16 << 20;

/// The file.
#[derive(Debug)]
pub(super) struct Kept {
    path: PathBuf,
    /// What is in it.
    topics: BTreeSet<String>,
}

impl Kept {
    /// What an earlier run wrote. A file that can't be read is as good as none: then it is not
    /// known what is to be cleared.
    pub(super) fn open(path: PathBuf) -> Kept {
        let topics = read(&path).unwrap_or_default();
        Kept { path, topics }
    }

    pub(super) fn topics(&self) -> &BTreeSet<String> {
        &self.topics
    }

    /// Writes it down, if it is something else.
    ///
    /// # Errors
    /// It can't be written.
    pub(super) fn keep(&mut self, topics: Vec<String>) -> io::Result<()> {
        let topics: BTreeSet<String> = topics.into_iter().collect();
        if topics != self.topics {
            let text = serde_json::to_vec(&topics)?;
            durable::replace(&self.path, &text, Some(0o600))?;
            self.topics = topics;
        }
        Ok(())
    }

    /// Takes over the topics that are this outlet's own from the files of others, which are no
    /// more, and removes those. Whether there were any.
    pub(super) fn take_over(
        &mut self,
        files: &[PathBuf],
        is_own: impl Fn(&str) -> bool,
    ) -> io::Result<bool> {
        let (mut topics, mut taken) = (self.topics.clone(), Vec::new());
        for file in files {
            let theirs = read(file).unwrap_or_default();
            // What was told at a topic stands behind it.
            let topic = |line: &str| line.split_once(MARK).map(|(topic, _)| topic.to_owned());
            let is_ours = |line: &&String| is_own(&topic(line).unwrap_or_else(|| line.to_string()));
            let ours: Vec<&String> = theirs.iter().filter(is_ours).collect();
            if !ours.is_empty() {
                topics.extend(ours.into_iter().cloned());
                taken.push(file);
            }
        }
        self.keep(topics.into_iter().collect())?;
        for file in &taken {
            std::fs::remove_file(file)?;
        }
        Ok(!taken.is_empty())
    }

    /// There is nothing left at the broker.
    pub(super) fn forget(&mut self) {
        self.topics.clear();
        // What stays is cleared by the next outlet of this name.
        let _ = std::fs::remove_file(&self.path);
    }
}

fn read(path: &Path) -> io::Result<BTreeSet<String>> {
    let mut text = String::new();
    let file = File::open(path)?;
    file.take(LEN_MAX).read_to_string(&mut text)?;
    let topics = serde_json::from_str(&text);
    topics.map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_published_outlives_the_program() {
        let name = format!("railbus-outlet-topics-{}.json", std::process::id());
        let path = std::env::temp_dir().join(name);
        let mut kept = Kept::open(path.clone());
        assert!(kept.topics().is_empty());
        kept.keep(vec!["b".to_owned(), "a".to_owned()]).unwrap();
        let again = Kept::open(path.clone());
        assert!(again.topics().iter().eq(["a", "b"]));
        std::fs::write(&path, "[\"a\"").unwrap();
        assert!(Kept::open(path.clone()).topics().is_empty());
        kept.forget();
        assert!(!path.exists());
    }

    #[test]
    fn topics_of_an_earlier_name_are_taken_over() {
        let file = |name: &str| {
            let name = format!("railbus-taken-{name}-{}.json", std::process::id());
            std::env::temp_dir().join(name)
        };
        let (own, old, other) = (file("own"), file("old"), file("other"));
        let mut before = Kept::open(old.clone());
        let lines = [
            "x/oven/k1/state",
            "ha/oven/config#switch/k1",
            "y/oven/k1/state",
        ];
        before.keep(lines.map(str::to_owned).to_vec()).unwrap();
        let mut stranger = Kept::open(other.clone());
        stranger.keep(vec!["y/hall/k1/state".to_owned()]).unwrap();

        let mut kept = Kept::open(own.clone());
        kept.keep(vec!["x/bridge/state".to_owned()]).unwrap();
        let is_own = |topic: &str| topic.starts_with("x/") || topic == "ha/oven/config";
        let files = [old.clone(), other.clone(), file("none")];
        assert!(kept.take_over(&files, is_own).unwrap());
        let all = [
            "ha/oven/config#switch/k1",
            "x/bridge/state",
            "x/oven/k1/state",
        ];
        assert!(Kept::open(own).topics().iter().eq(all));
        assert!(!old.exists() && other.exists());
        assert!(!kept.take_over(&files, is_own).unwrap());
        kept.forget();
        stranger.forget();
    }
}
