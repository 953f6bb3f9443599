//! The secrets of outlets: in a file of the state folder for each kind that has them, which only
//! its owner can read, since the configuration is read by others, too.

use super::NORTHBOUND;
use super::kind::OutletKind;
use crate::access::secret::Secret;
use railbus_api::problem::{Problem, codes};
use railbus_store::durable;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The most secrets of a kind, those of outlets that are gone included.
const KEPT_MAX: usize = 64;
/// The longest file.
const LEN_MAX: u64 = 1 << 20;

/// The secrets of a kind, by the outlet's name.
type All = BTreeMap<String, Arc<Secret>>;

/// The secrets, by kind and by the outlet's name.
pub(super) struct Secrets {
    folder: PathBuf,
    kept: Mutex<BTreeMap<&'static str, All>>,
    /// One at a time writes a file; nothing else waits for the disk.
    turn: Mutex<()>,
}

/// The file of a kind in the state folder.
fn file(folder: &Path, kind: &OutletKind) -> PathBuf {
    folder.join(format!("{}s.json", kind.name))
}

impl Secrets {
    /// Those of a state folder, and of which kinds they can't be read and why.
    pub(super) fn open(folder: &Path) -> (Secrets, Vec<(&'static OutletKind, Problem)>) {
        let (mut kept, mut lost) = (BTreeMap::new(), Vec::new());
        for kind in NORTHBOUND.iter().copied() {
            let path = file(folder, kind);
            match read(&path) {
                Ok(all) => {
                    kept.insert(kind.name, all);
                }
                Err(error) => lost.push((kind, problem(&path, &error))),
            }
        }
        let secrets = Secrets {
            folder: folder.to_owned(),
            kept: Mutex::new(kept),
            turn: Mutex::new(()),
        };
        (secrets, lost)
    }

    pub(super) fn of(&self, kind: &OutletKind, outlet: &str) -> Option<Arc<Secret>> {
        self.all().get(kind.name)?.get(outlet).cloned()
    }

    /// Keeps another secret, or none. If there would be too many, those of outlets that are gone
    /// are dropped: `is_there` says which exist. Waits for the disk.
    pub(super) fn set(
        &self,
        kind: &OutletKind,
        outlet: &str,
        secret: Option<Secret>,
        is_there: impl Fn(&str) -> bool,
    ) -> Result<(), Problem> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let path = file(&self.folder, kind);
        let known = self.all().get(kind.name).cloned();
        let mut next = match known.map_or_else(|| read(&path), Ok) {
            Ok(all) => all,
            // Nothing in it can be used.
            Err(error) if error.kind() == io::ErrorKind::InvalidData => All::new(),
            Err(error) => return Err(problem(&path, &error)),
        };
        match secret {
            Some(secret) => next.insert(outlet.to_owned(), Arc::new(secret)),
            None => next.remove(outlet),
        };
        if next.len() > KEPT_MAX {
            next.retain(|name, _| is_there(name));
        }
        let told = next.iter().map(|(name, secret)| {
            let secret = Value::from(secret.expose());
            (name.clone(), secret)
        });
        let text = Value::from(told.collect::<Map<_, _>>()).to_string();
        durable::replace(&path, text.as_bytes(), Some(0o600))
            .map_err(|error| problem(&path, &error))?;
        self.all().insert(kind.name, next);
        Ok(())
    }

    fn all(&self) -> MutexGuard<'_, BTreeMap<&'static str, All>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn read(path: &Path) -> io::Result<All> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(All::new()),
        Err(error) => return Err(error),
    };
    let mut text = String::new();
    file.take(LEN_MAX).read_to_string(&mut text)?;
    // A parser's message may quote what it read, so only the position is reported.
    let kept: BTreeMap<String, Secret> = serde_json::from_str(&text).map_err(|error| {
        let place = format!("line {} column {}", error.line(), error.column());
        io::Error::new(io::ErrorKind::InvalidData, place)
    })?;
    let each = kept.into_iter();
    Ok(each
        .map(|(name, secret)| (name, Arc::new(secret)))
        .collect())
}

fn problem(path: &Path, error: &io::Error) -> Problem {
    Problem::new(codes::HOOK_SECRET)
        .with("path", path.display().to_string())
        .with("reason", error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn they_outlive_the_program_and_are_for_its_owner_alone() {
        let kind = NORTHBOUND[0];
        let name = format!("railbus-outlet-secrets-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let open = || Secrets::open(&folder);
        let (secrets, lost) = open();
        assert!(lost.is_empty() && secrets.of(kind, "a").is_none());
        for at in 0..=KEPT_MAX {
            let secret = Some(Secret::new(format!("canary {at}")));
            let is_there = |name: &str| name != "h0";
            secrets
                .set(kind, &format!("h{at}"), secret, is_there)
                .unwrap();
        }
        let (again, lost) = open();
        assert!(lost.is_empty());
        assert!(again.of(kind, "h0").is_none(), "of no outlet, and too many");
        let last = again.of(kind, "h64").map(|kept| kept.expose().to_owned());
        assert_eq!(last.as_deref(), Some("canary 64"));
        again.set(kind, "h64", None, |_| true).unwrap();
        assert!(open().0.of(kind, "h64").is_none() && open().0.of(kind, "h1").is_some());
        let path = file(&folder, kind);
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        std::fs::write(&path, "{\"a\": canary").unwrap();
        let lost = format!("{:?}", open().1);
        assert!(lost.contains("E0879") && !lost.contains("canary"), "{lost}");
        // What can't be read for a while is not replaced by less.
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        let (later, lost) = open();
        assert_eq!(lost.len(), 1);
        std::fs::remove_dir(&path).unwrap();
        std::fs::write(&path, "{\"a\": \"canary\"}").unwrap();
        later
            .set(kind, "b", Some(Secret::new("b".to_owned())), |_| true)
            .unwrap();
        assert!(open().0.of(kind, "a").is_some() && open().0.of(kind, "b").is_some());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
