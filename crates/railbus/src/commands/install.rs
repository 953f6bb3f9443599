//! Where a user's own files go, so that shells and `man` find them.

use railbus_app::failure::Failure;
use railbus_words::Code;
use railbus_words::Lang;
use std::path::{Path, PathBuf};

/// The user's data folder; for root that of the whole machine, unless the environment names one.
pub(super) fn data_folder() -> PathBuf {
    let named = named("XDG_DATA_HOME");
    let usual = || match rustix::process::geteuid().is_root() {
        true => PathBuf::from("/usr/local/share"),
        false => at_home(".local/share"),
    };
    named.unwrap_or_else(usual)
}

/// The user's folder for settings.
pub(super) fn settings_folder() -> PathBuf {
    named("XDG_CONFIG_HOME").unwrap_or_else(|| at_home(".config"))
}

fn named(variable: &str) -> Option<PathBuf> {
    let folder = std::env::var_os(variable)?;
    (!folder.is_empty()).then(|| folder.into())
}

fn at_home(below: &str) -> PathBuf {
    std::env::home_dir().unwrap_or_default().join(below)
}

/// Writes a file whole or not at all, and creates its folder if needed.
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
