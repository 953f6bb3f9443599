//! The files of a configuration on trial, in the state folder, and what a start makes of them.

use super::files::PREFIX;
use crate::nats::unusable;
use prost::Message;
use railbus_api::problem::Problem;
use railbus_fleet::trial::{ConfigText, ManagedRecord, Recovery, TrialRecord, part_hash, recover};
use railbus_site::config::edit::WriteError;
use railbus_site::config::keeper::ConfigFile;
use railbus_site::config::part::{part_of, taken_back};
use railbus_store::durable;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// How often a file that somebody changes is read again.
const TRIES: usize = 3;
const TRIAL: &str = ".trial";
pub(super) const MANAGED: &str = ".managed";

/// The files of the outlet of a name. Everything here blocks on the disk.
#[derive(Clone, Debug)]
pub(super) struct TrialFiles {
    trial: PathBuf,
    managed: PathBuf,
}

impl TrialFiles {
    pub(super) fn new(state: &Path, outlet: &str) -> TrialFiles {
        let path = |end: &str| state.join(format!("{PREFIX}{outlet}{end}"));
        TrialFiles {
            trial: path(TRIAL),
            managed: path(MANAGED),
        }
    }

    /// A trial that is not over.
    pub(super) fn trial(&self) -> Result<Option<TrialRecord>, Problem> {
        read(&self.trial)
    }

    /// What became of the configurations so far.
    pub(super) fn managed(&self) -> Result<ManagedRecord, Problem> {
        Ok(read(&self.managed)?.unwrap_or_default())
    }

    pub(super) fn store_trial(&self, record: &TrialRecord) -> Result<(), Problem> {
        write(&self.trial, record)
    }

    pub(super) fn store_managed(&self, record: &ManagedRecord) -> Result<(), Problem> {
        write(&self.managed, record)
    }

    /// Deletes the record of a trial.
    pub(super) fn remove_trial(&self) -> Result<(), Problem> {
        let removed = match std::fs::remove_file(&self.trial) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            removed => removed,
        };
        let folder = self.trial.parent().unwrap_or(Path::new("."));
        let removed = removed.and_then(|()| durable::sync_folder(folder));
        removed.map_err(|error| unusable(&self.trial, &error))
    }

    /// Removes what is recorded with its outlet. What stays does no harm, and a trial that could
    /// not be taken back is for the next start.
    pub(super) fn remove_managed(&self) {
        let _ = std::fs::remove_file(&self.managed);
    }
}

fn read<M: Message + Default>(path: &Path) -> Result<Option<M>, Problem> {
    match std::fs::read(path) {
        Ok(bytes) => M::decode(&*bytes)
            .map(Some)
            .map_err(|error| unusable(path, &error)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(unusable(path, &error)),
    }
}

fn write(path: &Path, record: &impl Message) -> Result<(), Problem> {
    let written = durable::replace(path, &record.encode_to_vec(), Some(0o600));
    written.map_err(|error| unusable(path, &error))
}

/// Takes back what was on trial when the site ended, in this configuration file, before it is read.
///
/// # Errors
/// The disk refuses. The integration goes on with it.
pub(super) fn recover_all(config: &Path, state: &Path) -> Result<(), Problem> {
    let mut end = Ok(());
    let all = std::fs::read_dir(state).into_iter().flatten().flatten();
    for name in all.map(|entry| entry.file_name()) {
        let name = name.to_str().and_then(|name| name.strip_prefix(PREFIX));
        if let Some(outlet) = name.and_then(|name| name.strip_suffix(TRIAL)) {
            // One that can't be read does not keep the others.
            end = end.and(recover_one(config, state, outlet));
        }
    }
    end
}

fn recover_one(config: &Path, state: &Path, outlet: &str) -> Result<(), Problem> {
    let files = TrialFiles::new(state, outlet);
    let (Some(trial), managed) = (files.trial()?, files.managed()?) else {
        return Ok(());
    };
    let keeper = ConfigFile::new(config.to_owned(), state);
    let failed = |reason: &dyn ToString| unusable(config, reason);
    for _ in 0..TRIES {
        let text = keeper.read().map_err(|error| failed(&error))?;
        let hash = part_of(&text).map(|part| part_hash(&part));
        let file = ConfigText {
            hash: hash.unwrap_or_default(),
            text,
        };
        let Some(Recovery { is_back, managed }) = recover(&file, Some(&trial), &managed) else {
            return Ok(());
        };
        if is_back {
            let text = taken_back(&file.text, &trial.after, &trial.before);
            match keeper.write(&file.text, &text, &format!("outlet:{outlet}")) {
                Ok(()) => {}
                // Somebody changes it just now.
                Err(WriteError::Changed) => continue,
                Err(WriteError::Io(error)) => return Err(failed(&error)),
            }
        }
        files.store_managed(&managed)?;
        return files.remove_trial();
    }
    Err(failed(&WriteError::Changed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_fleet::trial::TrialEndKind;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Folder {
            let unique = format!("railbus-trial-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(unique);
            std::fs::create_dir_all(folder.join("state")).unwrap();
            Folder(folder)
        }

        fn config(&self) -> PathBuf {
            self.0.join("railbus.toml")
        }

        fn state(&self) -> PathBuf {
            self.0.join("state")
        }

        fn files(&self) -> TrialFiles {
            TrialFiles::new(&self.state(), "hq")
        }

        fn text(&self) -> String {
            std::fs::read_to_string(self.config()).unwrap()
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    const OLD: &str = "[line.a]\nport = \"/dev/ttyS1\"\n[ports]\nallow = []\n";
    const NEW: &str = "[line.b]\nport = \"/dev/ttyS2\"\n[ports]\nallow = []\n";

    fn hash(text: &str) -> Vec<u8> {
        part_hash(&part_of(text).unwrap())
    }

    fn trial(version: u64) -> TrialRecord {
        TrialRecord {
            version,
            before: OLD.to_owned(),
            after: NEW.to_owned(),
            before_hash: hash(OLD),
            after_hash: hash(NEW),
        }
    }

    #[test]
    fn a_start_takes_back_what_was_on_trial() {
        let folder = Folder::new("back");
        let files = folder.files();
        let starts = |text: &str| {
            std::fs::write(folder.config(), text).unwrap();
            recover_all(&folder.config(), &folder.state()).unwrap();
            assert_eq!(files.trial(), Ok(None));
            (folder.text(), files.managed().unwrap().verdict)
        };
        let unwritten = starts("# x\n");
        assert_eq!(unwritten, ("# x\n".to_owned(), None));
        files.store_trial(&trial(3)).unwrap();
        let (text, verdict) = starts(NEW);
        let verdict = verdict.unwrap();
        assert_eq!((text.as_str(), verdict.version), (OLD, 3));
        assert_eq!(verdict.kind(), TrialEndKind::RolledBack);
        // Once.
        assert_eq!(starts(NEW).0, NEW);
        // With what only the site says, as it is now.
        files.store_trial(&trial(4)).unwrap();
        let (text, _) = starts(&NEW.replace("[]", "[\"/x\"]"));
        assert_eq!(text, OLD.replace("[]", "[\"/x\"]"));
        // What somebody wrote by hand stays.
        files.store_trial(&trial(5)).unwrap();
        let (text, verdict) = starts("# by hand\n");
        assert_eq!(text, "# by hand\n");
        assert_eq!(verdict.unwrap().kind(), TrialEndKind::Interrupted);
    }

    #[test]
    fn what_cant_be_read_is_said_and_stays() {
        let folder = Folder::new("broken");
        std::fs::write(folder.config(), "# new\n").unwrap();
        let path = folder.state().join("fleet-hq.trial");
        std::fs::write(&path, [255]).unwrap();
        let other = TrialFiles::new(&folder.state(), "other");
        other.store_trial(&trial(3)).unwrap();
        let end = recover_all(&folder.config(), &folder.state()).unwrap_err();
        assert_eq!(end.code, "E0160");
        assert_eq!(end.text("path"), path.display().to_string());
        assert!(path.exists() && folder.text() == "# new\n");
        assert_eq!(other.trial(), Ok(None), "it does not keep the others");
    }
}
