//! The file of accounts: written whole or not at all, readable by its owner only.

use super::accounts::Accounts;
use railbus_api::problem::{Problem, codes};
use railbus_store::durable;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Its name in the state folder.
const NAME: &str = "accounts.json";
/// The holder of this file's lock may change accounts.
const LOCK: &str = "accounts.lock";
/// The largest size of the file.
const LEN_MAX: u64 = 1 << 20;

/// The file, locked against other writers.
#[derive(Debug)]
pub(crate) struct Store {
    folder: PathBuf,
    /// Released when this is dropped, or the process ends.
    _lock: File,
}

impl Store {
    /// Opens the file of a state folder, which is created if needed.
    pub(crate) fn open(folder: &Path) -> Result<Store, Problem> {
        let failed = |error: io::Error| problem(&folder.join(NAME), &error);
        durable::folder(folder).map_err(failed)?;
        let lock = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(0o600)
            .open(folder.join(LOCK))
            .map_err(failed)?;
        match lock.try_lock() {
            Ok(()) => Ok(Store {
                folder: folder.to_owned(),
                _lock: lock,
            }),
            Err(TryLockError::WouldBlock) => {
                let path = folder.join(NAME).display().to_string();
                Err(Problem::new(codes::ACCOUNTS_HELD).with("path", path))
            }
            Err(TryLockError::Error(error)) => Err(failed(error)),
        }
    }

    /// The stored accounts; none at first.
    pub(crate) fn read(&self) -> Result<Accounts, Problem> {
        Store::look(&self.folder)
    }

    /// The accounts stored in a folder, without locking it.
    pub(crate) fn look(folder: &Path) -> Result<Accounts, Problem> {
        let path = folder.join(NAME);
        let failed = |error: io::Error| problem(&path, &error);
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Accounts::default()),
            Err(error) => return Err(failed(error)),
        };
        let mut text = String::new();
        file.take(LEN_MAX)
            .read_to_string(&mut text)
            .map_err(failed)?;
        // The parser's message may repeat what it read, so only the position is reported.
        serde_json::from_str(&text).map_err(|error| {
            let place = format!("line {} column {}", error.line(), error.column());
            problem(&path, &io::Error::new(io::ErrorKind::InvalidData, place))
        })
    }

    /// Stores these accounts: once this has returned they are durable.
    pub(crate) fn write(&self, accounts: &Accounts) -> Result<(), Problem> {
        let path = self.folder.join(NAME);
        let text = serde_json::to_vec_pretty(accounts).unwrap_or_default();
        durable::replace(&path, &text, Some(0o600)).map_err(|error| problem(&path, &error))
    }
}

fn problem(path: &Path, error: &io::Error) -> Problem {
    Problem::new(codes::ACCOUNTS_FILE)
        .with("path", path.display().to_string())
        .with("reason", error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn folder(name: &str) -> PathBuf {
        let unique = format!("railbus-store-{}-{name}", std::process::id());
        std::env::temp_dir().join(unique)
    }

    #[test]
    fn it_is_for_one_at_a_time_and_for_its_owner_alone() {
        let folder = folder("one");
        let store = Store::open(&folder).unwrap();
        assert_eq!(Store::open(&folder).unwrap_err().code, "E0917");
        assert!(store.read().is_ok_and(|accounts| accounts.is_empty()));
        std::fs::write(folder.join("accounts.json.new"), "left behind").unwrap();
        assert!(store.write(&Accounts::default()).is_ok());
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&folder.join(NAME)), 0o600);
        assert_eq!(mode(&folder), 0o700);
        drop(store);
        assert!(Store::open(&folder).is_ok());
        let _ = std::fs::remove_dir_all(&folder);
    }

    #[test]
    fn a_broken_file_is_told_without_its_text() {
        let folder = folder("broken");
        let store = Store::open(&folder).unwrap();
        std::fs::write(folder.join(NAME), "{\"users\": \"canary\"}").unwrap();
        let problem = store.read().err().unwrap();
        assert_eq!(problem.code, "E0916");
        assert!(!format!("{problem:?}").contains("canary"), "{problem:?}");
        let _ = std::fs::remove_dir_all(&folder);
    }
}
