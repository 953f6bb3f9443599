//! Where files of one's own go, so that shells and `man` find them.

use crate::failure::{Code, Failure};
use crate::i18n::Lang;
use std::path::{Path, PathBuf};

/// The user's folder for data; that of the whole machine for root.
pub(super) fn data_folder() -> PathBuf {
    if rustix::process::geteuid().is_root() {
        return PathBuf::from("/usr/local/share");
    }
    of_home("XDG_DATA_HOME", ".local/share")
}

/// The user's folder for settings.
pub(super) fn settings_folder() -> PathBuf {
    of_home("XDG_CONFIG_HOME", ".config")
}

fn of_home(variable: &str, below: &str) -> PathBuf {
    let named = std::env::var_os(variable).filter(|folder| !folder.is_empty());
    let home = || std::env::home_dir().unwrap_or_default().join(below);
    named.map_or_else(home, PathBuf::from)
}

/// Writes a file whole or not at all, and makes its folder where it is missing.
pub(super) fn write(lang: Lang, path: &Path, text: &[u8]) -> Result<(), Failure> {
    let failed = |error: std::io::Error| {
        Failure::of(lang, Code::Install).because(format!("{}: {error}", path.display()))
    };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let draft = path.with_extension(format!("{}.new", std::process::id()));
    let done = std::fs::write(&draft, text).and_then(|()| std::fs::rename(&draft, path));
    done.inspect_err(|_| {
        let _ = std::fs::remove_file(&draft);
    })
    .map_err(failed)
}
