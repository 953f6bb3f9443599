//! The daemon's Unix socket.

use railbus_words::Lang;
use rustix::fs::{Mode, chmod};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use tokio::net::UnixListener;

/// Only the user who runs the daemon may open it.
const MODE: Mode = Mode::RUSR.union(Mode::WUSR);

/// The name of the daemon's socket.
pub const DAEMON: &str = "railbus.sock";
/// The name of the socket of a fleet's centre.
pub const HUB: &str = "railbus-hub.sock";

/// The possible paths of a socket, the user's own first. A user without a runtime
/// folder, who may not create the system's, gets a private folder among the temporary files.
/// `RAILBUS_RUN` replaces all of these folders.
pub fn places(name: &str) -> Vec<PathBuf> {
    let socket = |folder: PathBuf| folder.join(name);
    if let Some(named) = std::env::var_os("RAILBUS_RUN").filter(|folder| !folder.is_empty()) {
        return vec![socket(named.into())];
    }
    let of_user = std::env::var_os("XDG_RUNTIME_DIR").filter(|folder| !folder.is_empty());
    let folders = [
        of_user.map(PathBuf::from),
        Some(PathBuf::from("/run/railbus")),
        own_temporary_folder(),
    ];
    folders.into_iter().flatten().map(socket).collect()
}

/// The first of these places at which a daemon answers.
pub fn answers() -> Option<PathBuf> {
    let mut places = places(DAEMON).into_iter();
    places.find(|place| UnixStream::connect(place).is_ok())
}

/// The user's own runtime folder, created if missing.
pub fn own_folder() -> Option<PathBuf> {
    let of_user = std::env::var_os("XDG_RUNTIME_DIR").filter(|folder| !folder.is_empty());
    let folder = of_user.map(PathBuf::from).or_else(own_temporary_folder)?;
    make_folder(&folder.join("any"));
    Some(folder)
}

/// The user's own folder among the temporary files; `None` if another user owns a folder of that
/// name, and could put a socket there.
fn own_temporary_folder() -> Option<PathBuf> {
    let user = rustix::process::geteuid().as_raw();
    let folder = std::env::temp_dir().join(format!("railbus-{user}"));
    match std::fs::symlink_metadata(&folder) {
        Ok(found) => {
            let is_own = found.is_dir() && found.uid() == user && found.mode() & 0o077 == 0;
            is_own.then_some(folder)
        }
        Err(_) => Some(folder),
    }
}

/// Creates the folder of a socket if it is missing and may be created.
fn make_folder(path: &Path) {
    if let Some(folder) = path.parent().filter(|folder| !folder.exists()) {
        let shared = folder.starts_with("/run");
        let mode = if shared { 0o755 } else { 0o700 };
        // If this fails, listening fails, too, and reports why.
        let _ = std::fs::DirBuilder::new().mode(mode).create(folder);
    }
}

/// A listening socket, removed when this is dropped.
#[derive(Debug)]
pub struct Socket {
    /// Where clients are accepted.
    pub listener: UnixListener,
    path: PathBuf,
    inode: u64,
}

impl Socket {
    /// Listens. A socket left behind by a killed daemon is replaced; if a daemon answers there,
    /// this fails.
    pub fn listen(lang: Lang, path: &Path) -> io::Result<Socket> {
        make_folder(path);
        if UnixStream::connect(path).is_ok() {
            let taken = ["something answers there already", "已有程序在此应答"];
            return Err(io::Error::new(io::ErrorKind::AddrInUse, lang.of(taken)));
        }
        if let Ok(found) = std::fs::symlink_metadata(path)
            && !std::os::unix::fs::FileTypeExt::is_socket(&found.file_type())
        {
            let foreign = ["it exists and is no socket", "已存在且不是套接字"];
            return Err(io::Error::new(
                io::ErrorKind::AlreadyExists,
                lang.of(foreign),
            ));
        }
        // It gets its name once its mode is right: other users can't open it in between.
        let draft = path.with_extension(format!("{}.new", std::process::id()));
        let _ = std::fs::remove_file(&draft);
        let listener = UnixListener::bind(&draft)?;
        let finish = || {
            chmod(&draft, MODE)?;
            let inode = std::fs::metadata(&draft)?.ino();
            std::fs::rename(&draft, path)?;
            Ok(inode)
        };
        let inode = finish().inspect_err(|_: &io::Error| {
            let _ = std::fs::remove_file(&draft);
        })?;
        Ok(Socket {
            listener,
            path: path.to_owned(),
            inode,
        })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Socket {
    /// Another daemon may have put its own socket here meanwhile.
    fn drop(&mut self) {
        if std::fs::symlink_metadata(&self.path).is_ok_and(|now| now.ino() == self.inode) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}
