//! The files of a configuration on trial, in the state folder, and what a start makes of them.

use super::files::PREFIX;
use crate::nats::unusable;
use prost::Message;
use railbus_api::problem::Problem;
use railbus_fleet::trial::{ManagedRecord, TrialRecord, recover};
use railbus_site::config::edit::WriteError;
use railbus_site::config::keeper::ConfigFile;
use railbus_store::durable;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const TRIAL: &str = ".trial";
const MANAGED: &str = ".managed";

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

    /// Removes them with their outlet. What stays does no harm.
    pub(super) fn remove(&self) {
        let _ = std::fs::remove_file(&self.trial);
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
    let all = std::fs::read_dir(state).into_iter().flatten().flatten();
    for name in all.map(|entry| entry.file_name()) {
        let name = name.to_str().and_then(|name| name.strip_prefix(PREFIX));
        if let Some(outlet) = name.and_then(|name| name.strip_suffix(TRIAL)) {
            recover_one(config, state, outlet)?;
        }
    }
    Ok(())
}

fn recover_one(config: &Path, state: &Path, outlet: &str) -> Result<(), Problem> {
    let files = TrialFiles::new(state, outlet);
    let (trial, managed) = (files.trial()?, files.managed()?);
    let keeper = ConfigFile::new(config.to_owned(), state);
    let text = keeper.read().map_err(|error| unusable(config, &error))?;
    let Some(recovery) = recover(&text, trial.as_ref(), &managed) else {
        return Ok(());
    };
    if let Some(before) = recovery.file {
        match keeper.write(&text, &before, &format!("outlet:{outlet}")) {
            // Somebody changes it just now: that is what counts.
            Ok(()) | Err(WriteError::Changed) => {}
            Err(WriteError::Io(error)) => return Err(unusable(config, &error)),
        }
    }
    files.store_managed(&recovery.managed)?;
    files.remove_trial()
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_fleet::trial::{TrialEndKind, part_hash};

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

    fn trial() -> TrialRecord {
        TrialRecord {
            version: 3,
            before: "# old\n".to_owned(),
            after: "# new\n".to_owned(),
            before_hash: part_hash("old"),
            after_hash: part_hash("new"),
        }
    }

    #[test]
    fn a_start_takes_back_what_was_on_trial() {
        let folder = Folder::new("back");
        let files = folder.files();
        let starts = || recover_all(&folder.config(), &folder.state()).unwrap();
        starts();
        std::fs::write(folder.config(), "# new\n").unwrap();
        files.store_trial(&trial()).unwrap();
        starts();
        assert_eq!(folder.text(), "# old\n");
        assert_eq!(files.trial(), Ok(None));
        let verdict = files.managed().unwrap().verdict.unwrap();
        assert_eq!(
            (verdict.version, verdict.kind()),
            (3, TrialEndKind::RolledBack)
        );
        // Once.
        std::fs::write(folder.config(), "# new\n").unwrap();
        starts();
        assert_eq!(folder.text(), "# new\n");
        // What somebody wrote by hand stays.
        std::fs::write(folder.config(), "# by hand\n").unwrap();
        files
            .store_trial(&TrialRecord {
                version: 4,
                ..trial()
            })
            .unwrap();
        starts();
        assert_eq!(
            (folder.text().as_str(), files.trial()),
            ("# by hand\n", Ok(None))
        );
    }

    #[test]
    fn what_cant_be_read_is_said_and_stays() {
        let folder = Folder::new("broken");
        std::fs::write(folder.config(), "# new\n").unwrap();
        let path = folder.state().join("fleet-hq.trial");
        std::fs::write(&path, [255]).unwrap();
        let end = recover_all(&folder.config(), &folder.state()).unwrap_err();
        assert_eq!(end.code, "E0160");
        assert_eq!(end.text("path"), path.display().to_string());
        assert!(path.exists() && folder.text() == "# new\n");
    }
}
