//! The topics at which the broker may have something of an outlet: in a file of the state folder,
//! so that what has another name after a restart leaves nothing behind.

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
}
