//! The secrets of webhooks: in a file of the state folder for its owner's eyes only, since the
//! configuration is for others' eyes, too.

use crate::access::secret::Secret;
use railbus_api::problem::{Problem, codes};
use railbus_site::config::WEBHOOKS_MAX;
use railbus_store::durable;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Its name in the state folder.
const NAME: &str = "webhooks.json";
/// The longest file.
const LEN_MAX: u64 = 1 << 20;

type All = BTreeMap<String, Arc<Secret>>;

/// The secrets, by the webhook's name.
pub(super) struct Secrets {
    folder: PathBuf,
    kept: Mutex<All>,
    /// One at a time writes the file; nobody else waits for the disk.
    turn: Mutex<()>,
}

impl Secrets {
    /// Those of a state folder, and why they can't be read.
    pub(super) fn open(folder: &Path) -> (Secrets, Option<Problem>) {
        let path = folder.join(NAME);
        let (kept, why) = match read(&path) {
            Ok(kept) => (kept, None),
            Err(error) => (All::new(), Some(problem(&path, &error))),
        };
        let secrets = Secrets {
            folder: folder.to_owned(),
            kept: Mutex::new(kept),
            turn: Mutex::new(()),
        };
        (secrets, why)
    }

    pub(super) fn of(&self, webhook: &str) -> Option<Arc<Secret>> {
        self.all().get(webhook).cloned()
    }

    /// Keeps another secret, or none. Where there would be more than webhooks, those go that are
    /// of no webhook: `is_one` says which are. Waits for the disk.
    pub(super) fn set(
        &self,
        webhook: &str,
        secret: Option<Secret>,
        is_one: impl Fn(&str) -> bool,
    ) -> Result<(), Problem> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let mut next = self.all().clone();
        match secret {
            Some(secret) => next.insert(webhook.to_owned(), Arc::new(secret)),
            None => next.remove(webhook),
        };
        if next.len() > WEBHOOKS_MAX {
            next.retain(|name, _| is_one(name));
        }
        let told = next.iter().map(|(name, secret)| {
            let secret = Value::from(secret.expose());
            (name.clone(), secret)
        });
        let text = Value::from(told.collect::<Map<_, _>>()).to_string();
        let path = self.folder.join(NAME);
        durable::replace(&path, text.as_bytes(), Some(0o600))
            .map_err(|error| problem(&path, &error))?;
        *self.all() = next;
        Ok(())
    }

    fn all(&self) -> MutexGuard<'_, All> {
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
    // A parser's words may repeat what it read, and so its place only is told.
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
        let name = format!("railbus-webhook-secrets-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let open = || Secrets::open(&folder);
        let (secrets, why) = open();
        assert_eq!((why, secrets.of("a").is_none()), (None, true));
        for at in 0..=WEBHOOKS_MAX {
            let secret = Some(Secret::new(format!("canary {at}")));
            secrets
                .set(&format!("h{at}"), secret, |name| name != "h0")
                .unwrap();
        }
        let (again, why) = open();
        assert_eq!(why, None);
        assert!(again.of("h0").is_none(), "of no webhook, and too many");
        let last = again.of("h16").map(|secret| secret.expose().to_owned());
        assert_eq!(last.as_deref(), Some("canary 16"));
        again.set("h16", None, |_| true).unwrap();
        assert!(open().0.of("h16").is_none() && open().0.of("h1").is_some());
        let mode = std::fs::metadata(folder.join(NAME))
            .unwrap()
            .permissions()
            .mode();
        assert_eq!(mode & 0o777, 0o600);
        std::fs::write(folder.join(NAME), "{\"a\": canary").unwrap();
        let why = open().1.unwrap();
        assert!(!format!("{why:?}").contains("canary"), "{why:?}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
