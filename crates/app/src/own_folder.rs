//! A temporary folder of one process, for demos.

use std::fs::DirBuilder;
use std::io::{self, ErrorKind};
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

/// How many names are tried.
const NAMES_MAX: u32 = 16;

/// A folder that only this user can open. It is removed with this value.
#[derive(Debug)]
pub struct OwnFolder(PathBuf);

impl OwnFolder {
    /// Makes a new one, whose name begins so. An existing folder may be another user's: it is never
    /// used.
    ///
    /// # Errors
    /// The system refuses, or all names are taken.
    pub fn make(name: &str) -> io::Result<OwnFolder> {
        let mut refused = ErrorKind::AlreadyExists.into();
        for number in 0..NAMES_MAX {
            let name = format!("{name}-{}-{number}", std::process::id());
            let folder = std::env::temp_dir().join(name);
            match DirBuilder::new().mode(0o700).create(&folder) {
                Ok(()) => return Ok(OwnFolder(folder)),
                Err(error) => refused = error,
            }
        }
        Err(refused)
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for OwnFolder {
    fn drop(&mut self) {
        // What can't be removed stays in the folder for temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
