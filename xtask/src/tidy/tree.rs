//! The files that the checks look at.

use std::path::Path;

use super::rust::Source;
use crate::run::{self, Error, Result};

/// Fixtures break the rules on purpose.
const FIXTURES: &str = "xtask/fixtures/";

/// One file with its content.
#[derive(Debug)]
pub(crate) struct File {
    /// From the root, with `/`.
    pub(crate) path: String,
    /// In bytes.
    pub(crate) size: usize,
    /// None if the file is not UTF-8 text.
    pub(crate) text: Option<String>,
}

/// A set of files, sorted by path.
#[derive(Debug)]
pub(crate) struct Tree {
    files: Vec<File>,
}

impl Tree {
    /// The files that git tracks or would track. Ignored files are not checked.
    pub(crate) fn of_checkout(root: &Path) -> Result<Self> {
        let mut git = run::program(root, "git");
        git.args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ]);
        let listed = run::read(&mut git)?;
        let paths = listed.split('\0').filter(|path| !path.is_empty());
        // A file deleted but not yet committed is still listed.
        let there = paths.filter(|path| root.join(path).is_file());
        Self::read(
            root,
            there
                .filter(|path| !path.starts_with(FIXTURES))
                .map(str::to_owned),
        )
    }

    /// Every file below a folder; for fixtures.
    #[cfg(test)]
    pub(crate) fn of_folder(root: &Path) -> Result<Self> {
        let mut paths = Vec::new();
        let mut folders = vec![root.to_owned()];
        while let Some(folder) = folders.pop() {
            let entries = std::fs::read_dir(&folder).map_err(|e| unreadable(&folder, &e))?;
            for path in entries.flatten().map(|entry| entry.path()) {
                if path.is_dir() {
                    folders.push(path);
                } else if let Ok(inner) = path.strip_prefix(root) {
                    paths.push(inner.to_string_lossy().into_owned());
                }
            }
        }
        Self::read(root, paths.into_iter())
    }

    fn read(root: &Path, paths: impl Iterator<Item = String>) -> Result<Self> {
        let mut files = Vec::new();
        for path in paths {
            let full = root.join(&path);
            let bytes = std::fs::read(&full).map_err(|error| unreadable(&full, &error))?;
            let size = bytes.len();
            let text = String::from_utf8(bytes)
                .ok()
                .filter(|text| !text.contains('\0'));
            files.push(File { path, size, text });
        }
        files.sort_by(|a, b| a.path.cmp(&b.path));
        files.dedup_by(|a, b| a.path == b.path);
        Ok(Self { files })
    }

    /// How many files there are.
    pub(crate) fn len(&self) -> usize {
        self.files.len()
    }

    /// All files, binary ones too.
    pub(crate) fn files(&self) -> &[File] {
        &self.files
    }

    /// Path and text of every text file whose path matches one of the patterns, see [`matches`].
    pub(crate) fn texts(&self, patterns: &[&str]) -> impl Iterator<Item = (&str, &str)> {
        let wanted = move |path: &str| patterns.iter().any(|pattern| matches(pattern, path));
        self.files
            .iter()
            .filter(move |file| wanted(&file.path))
            .filter_map(|file| Some((file.path.as_str(), file.text.as_deref()?)))
    }

    /// Path and source of every Rust file that matches.
    pub(crate) fn rust(&self, patterns: &[&str]) -> impl Iterator<Item = (&str, Source<'_>)> {
        self.texts(patterns)
            .filter(|(path, _)| path.ends_with(".rs"))
            .map(|(path, text)| (path, Source::parse(text)))
    }

    /// The text of one file, if it is there.
    pub(crate) fn text(&self, path: &str) -> Option<&str> {
        self.files
            .iter()
            .find(|file| file.path == path)?
            .text
            .as_deref()
    }

    /// Whether there is anything below the folder.
    pub(crate) fn has_folder(&self, folder: &str) -> bool {
        self.files.iter().any(|file| {
            file.path
                .strip_prefix(folder)
                .is_some_and(|inner| inner.starts_with('/'))
        })
    }
}

fn unreadable(path: &Path, error: &std::io::Error) -> Error {
    Error::new(
        format!("{} could not be read: {error}", path.display()),
        "check the file and its permissions",
    )
}

/// Whether a path matches a pattern: `*` is any run of characters without `/`, `**` any run at all;
/// a pattern that ends with `/` matches everything below that folder.
pub(crate) fn matches(pattern: &str, path: &str) -> bool {
    if let Some(folder) = pattern.strip_suffix('/') {
        return matches(&format!("{folder}/**"), path);
    }
    let Some((start, rest)) = pattern.split_once('*') else {
        return pattern == path;
    };
    let Some(tail) = path.strip_prefix(start) else {
        return false;
    };
    let (rest, crosses) = match rest.strip_prefix('*') {
        Some(rest) => (rest, true),
        None => (rest, false),
    };
    let stop = if crosses {
        tail.len()
    } else {
        tail.find('/').unwrap_or(tail.len())
    };
    (0..=stop)
        .filter(|&at| tail.is_char_boundary(at))
        .any(|at| matches(rest, &tail[at..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        assert!(matches("firmware/", "firmware/board/src/main.rs"));
        assert!(matches(
            "crates/*/tests/*alloc*.rs",
            "crates/wire/tests/no_alloc.rs"
        ));
        assert!(!matches(
            "crates/*/tests/*.rs",
            "crates/wire/tests/deep/a.rs"
        ));
        assert!(matches(
            "crates/*/tests/**.rs",
            "crates/wire/tests/deep/a.rs"
        ));
        assert!(!matches("crates/*/src/", "crates/wire/deep/src/lib.rs"));
        assert!(matches("**", "any/thing"));
    }
}
