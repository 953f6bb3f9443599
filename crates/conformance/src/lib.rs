//! The datasheets as conformance cases: what is sent to a module, what it replies, and the state of
//! its outputs afterwards. The simulated module and the firmware pass the same list,
//! `vectors/cases`, so that neither can deviate from the datasheets, or from the other, unnoticed.
//!
//! A case needs a [`Bench`]: a module whose inputs can be set, whose outputs can be observed and
//! whose power can be switched. [`Simulated`] is one in virtual time. The format of the cases is
//! described in `vectors/cases/README.md`.

mod bench;
mod bytes;
mod read;
mod simulated;

pub use bench::{Bench, CaseFailure, Outside, run};
pub use bytes::bytes;
pub use read::{Case, CaseError, CaseStep, Subject, read};
pub use simulated::Simulated;

use std::path::{Path, PathBuf};

/// The folder of the cases in a checkout.
#[must_use]
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../vectors/cases")
}

/// Every case of every list, in the order of file names.
///
/// # Errors
/// What can't be parsed, as text with file and line.
pub fn all() -> Result<Vec<Case>, String> {
    let folder = folder();
    let listed = std::fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = listed.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    let mut cases = Vec::new();
    for path in paths
        .iter()
        .filter(|path| path.extension() == Some("txt".as_ref()))
    {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let text = std::fs::read_to_string(path).map_err(|e| format!("{file}: {e}"))?;
        cases.extend(read(&file, &text).map_err(|error| error.to_string())?);
    }
    Ok(cases)
}
