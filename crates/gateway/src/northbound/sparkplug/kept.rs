//! What outlives the program: the number of the will of a connection, `bdSeq`, by which a host
//! knows which death belongs to which birth, and which changes are only in memory.

use railbus_store::durable;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What is in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Content {
    /// The last number that went out, or may have; none before the first.
    bd_seq: Option<u8>,
    /// The first and the last time of changes that wait for a silent module, in milliseconds since
    /// 1970.
    #[serde(default)]
    held: Option<(u64, u64)>,
}

/// A file of the state folder.
#[derive(Debug)]
pub(super) struct NodeFile {
    path: PathBuf,
    content: Content,
    /// Nothing was sent with the last number.
    is_free: bool,
    /// The disk has something else.
    is_unwritten: bool,
}

impl NodeFile {
    /// With what an earlier run has left.
    pub(super) fn open(path: PathBuf) -> NodeFile {
        let text = std::fs::read(&path).ok();
        let content = text.and_then(|text| serde_json::from_slice(&text).ok());
        NodeFile {
            path,
            content: content.unwrap_or_default(),
            is_free: false,
            is_unwritten: false,
        }
    }

    /// The number of the next connection. It is on the disk before it goes out: a broker may
    /// have taken the connection although nobody here knows.
    pub(super) fn next(&mut self) -> u8 {
        let next = match self.content.bd_seq {
            Some(last) if self.is_free => last,
            Some(last) => last.wrapping_add(1),
            None => 0,
        };
        self.is_free = false;
        self.keep(Content {
            bd_seq: Some(next),
            ..self.content
        });
        next
    }

    /// Nothing was sent with the last number: it is that of the next connection.
    pub(super) fn unused(&mut self) {
        self.is_free = true;
    }

    /// The times of changes that were only in memory.
    pub(super) const fn held(&self) -> Option<(u64, u64)> {
        self.content.held
    }

    /// These are the times of changes that are only in memory.
    pub(super) fn hold(&mut self, held: Option<(u64, u64)>) {
        self.keep(Content {
            held,
            ..self.content
        });
    }

    fn keep(&mut self, content: Content) {
        self.is_unwritten |= self.content != content;
        self.content = content;
        self.is_written();
    }

    /// Whether all of it is on the disk, at the latest now.
    pub(super) fn is_written(&mut self) -> bool {
        if self.is_unwritten {
            let text = serde_json::to_vec(&self.content);
            let end = text.map(|text| durable::replace(&self.path, &text, Some(0o600)));
            self.is_unwritten = !matches!(end, Ok(Ok(_)));
        }
        !self.is_unwritten
    }

    /// The outlet is gone for good.
    pub(super) fn forget(&self) {
        // What stays is taken up by the next outlet of this name.
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_connection_has_the_next_number_also_after_a_restart() {
        let name = format!("railbus-bd-seq-{}.json", std::process::id());
        let path = std::env::temp_dir().join(name);
        let _ = std::fs::remove_file(&path);
        let mut file = NodeFile::open(path.clone());
        assert_eq!((file.next(), file.next()), (0, 1));
        file.unused();
        assert_eq!(file.next(), 1, "no broker was reached");
        file.hold(Some((5, 9)));
        let mut file = NodeFile::open(path.clone());
        assert_eq!((file.next(), file.held()), (2, Some((5, 9))));
        let all: Vec<u8> = (0..256).map(|_| file.next()).collect();
        assert!(all.ends_with(&[255, 0, 1, 2]));
        std::fs::write(&path, "{\"bd_seq\":7}").unwrap();
        let mut file = NodeFile::open(path.clone());
        assert_eq!((file.next(), file.held()), (8, None));
        std::fs::write(&path, "{").unwrap();
        assert_eq!(NodeFile::open(path.clone()).next(), 0);
        file.forget();
        assert!(!path.exists());
        let mut file = NodeFile::open(path.join("no/such/folder"));
        file.hold(Some((5, 9)));
        assert!(!file.is_written());
    }
}
