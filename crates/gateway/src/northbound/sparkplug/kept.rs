//! The number of the will of a connection, `bdSeq`, in a file of the state folder: a host knows by
//! it which death belongs to which birth, also over restarts.

use railbus_store::durable;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What is in the file.
#[derive(Debug, Serialize, Deserialize)]
struct File {
    bd_seq: u8,
}

/// The numbers of connections, one after the other.
#[derive(Debug)]
pub(super) struct BirthNumbers {
    path: PathBuf,
    /// The last one that went out, or may have; none before the first.
    last: Option<u8>,
    /// The last one did not go out.
    is_free: bool,
}

impl BirthNumbers {
    /// After those of an earlier run.
    pub(super) fn open(path: PathBuf) -> BirthNumbers {
        let text = std::fs::read(&path).ok();
        let file = text.and_then(|text| serde_json::from_slice::<File>(&text).ok());
        BirthNumbers {
            path,
            last: file.map(|file| file.bd_seq),
            is_free: false,
        }
    }

    /// The number of the next connection. It is on the disk before it goes out: a broker may
    /// have taken the connection although nobody here knows.
    pub(super) fn next(&mut self) -> u8 {
        let next = match self.last {
            Some(last) if self.is_free => last,
            Some(last) => last.wrapping_add(1),
            None => 0,
        };
        self.is_free = false;
        if self.last != Some(next)
            && let Ok(text) = serde_json::to_vec(&File { bd_seq: next })
        {
            // Where the disk fails, the numbers go on from an older one after a restart.
            let _ = durable::replace(&self.path, &text, Some(0o600));
        }
        self.last = Some(next);
        next
    }

    /// Nothing was sent with the last number: it is that of the next connection.
    pub(super) fn unused(&mut self) {
        self.is_free = true;
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
        let mut numbers = BirthNumbers::open(path.clone());
        assert_eq!((numbers.next(), numbers.next()), (0, 1));
        numbers.unused();
        assert_eq!(numbers.next(), 1, "no broker was reached");
        let mut numbers = BirthNumbers::open(path.clone());
        assert_eq!(numbers.next(), 2);
        let all: Vec<u8> = (0..256).map(|_| numbers.next()).collect();
        assert!(all.ends_with(&[255, 0, 1, 2]));
        std::fs::write(&path, "{").unwrap();
        assert_eq!(BirthNumbers::open(path.clone()).next(), 0);
        numbers.forget();
        assert!(!path.exists());
    }
}
