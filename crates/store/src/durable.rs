//! Files that survive a power loss: there is a complete one at every moment, the old or the new.

use std::ffi::OsString;
use std::fs::{DirBuilder, File, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// Replaces the content of a file, or creates it. Its permissions are `mode`, regardless of the
/// previous ones, or the process default. Returns when it is durable.
///
/// # Errors
/// If the system refuses; the file is then unchanged.
pub fn replace(file: &Path, bytes: &[u8], mode: Option<u32>) -> io::Result<()> {
    let draft = beside(file, "new");
    // A leftover one may have other permissions.
    match std::fs::remove_file(&draft) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut written = OpenOptions::new()
        .create_new(true)
        .write(true)
        .mode(mode.unwrap_or(0o666))
        .open(&draft)?;
    if let Some(mode) = mode {
        written.set_permissions(Permissions::from_mode(mode))?;
    }
    written.write_all(bytes)?;
    written.sync_all()?;
    std::fs::rename(&draft, file)?;
    sync_folder(file.parent().unwrap_or(Path::new("")))
}

/// Creates a folder for its owner only, and its parents, if missing.
///
/// # Errors
/// If the system refuses.
pub fn folder(folder: &Path) -> io::Result<()> {
    if folder.is_dir() {
        return Ok(());
    }
    DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(folder)?;
    folder.parent().map_or(Ok(()), sync_folder)
}

/// A file name is durable once its folder is synced.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    let folder = match folder.as_os_str().is_empty() {
        true => Path::new("."),
        false => folder,
    };
    File::open(folder)?.sync_all()
}

/// The file with this name and extension.
pub fn beside(file: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(file);
    name.push(".");
    name.push(ending);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_takes_the_place_of_another() {
        let place = std::env::temp_dir().join(format!("railbus-durable-{}", std::process::id()));
        folder(&place.join("in")).unwrap();
        let file = place.join("in/kept.json");
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&place.join("in")), 0o700);
        replace(&file, b"one", None).unwrap();
        std::fs::write(beside(&file, "new"), "left behind").unwrap();
        replace(&file, b"two", Some(0o664)).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"two");
        assert_eq!(mode(&file), 0o664);
        assert!(!beside(&file, "new").exists());
        std::fs::remove_dir_all(place).unwrap();
    }
}
