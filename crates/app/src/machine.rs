//! The machine, as its files describe it: ports, programs, users. Nothing here opens a port.

pub mod fixture;
pub mod ports;
pub mod users;

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Maximum size of a file that is read; those of the kernel are short.
const LEN_MAX: u64 = 1 << 20;

/// A machine's file tree; in tests, that of another one.
#[derive(Clone, Debug)]
pub struct Machine {
    root: PathBuf,
}

impl Machine {
    /// This machine.
    pub fn this() -> Machine {
        Machine::at("/")
    }

    /// The machine whose files are below this folder.
    pub fn at(root: impl Into<PathBuf>) -> Machine {
        Machine { root: root.into() }
    }

    /// The path of one of the machine's files.
    pub fn path(&self, absolute: impl AsRef<Path>) -> PathBuf {
        let absolute = absolute.as_ref();
        self.root
            .join(absolute.strip_prefix("/").unwrap_or(absolute))
    }

    /// The text of a file; `None` if it can't be read.
    pub fn text(&self, absolute: impl AsRef<Path>) -> Option<String> {
        let file = fs::File::open(self.path(absolute)).ok()?;
        let mut bytes = Vec::new();
        file.take(LEN_MAX).read_to_end(&mut bytes).ok()?;
        Some(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// The sorted names in a folder; empty if it can't be read.
    pub fn names(&self, folder: impl AsRef<Path>) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder))
            .into_iter()
            .flatten()
            .flatten();
        let mut names: Vec<String> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    /// The target of a link, as written.
    pub fn link(&self, absolute: impl AsRef<Path>) -> Option<PathBuf> {
        fs::read_link(self.path(absolute)).ok()
    }

    /// The running programs, by process ID and name.
    pub fn programs(&self) -> impl Iterator<Item = (u32, String)> {
        let numbers = self.names("/proc").into_iter();
        numbers.filter_map(|name| {
            let pid = name.parse().ok()?;
            let name = self.text(format!("/proc/{pid}/comm"))?;
            Some((pid, name.trim_end().to_owned()))
        })
    }
}
