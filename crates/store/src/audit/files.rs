//! The files of the log. The newest is `audit.log`. A full one is renamed after its first record,
//! and the chain continues in the next. If the size is limited, the oldest are deleted, and
//! `audit.anchor` stores the record that the first of the others follows.

use super::chain::{LINE_MAX, NOTHING, decode};
use super::read::LogPosition;
use super::tail::{Reach, read_at};
use crate::durable;
use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Read, Result};
use std::path::{Path, PathBuf};

/// The name of the newest file in the log's folder.
const LOG: &str = "audit.log";
/// The name of the file that stores what came before the first remaining record.
const ANCHOR: &str = "audit.anchor";
/// Maximum size of a file.
const FILE_MAX: u64 = 64 << 20;
/// Minimum number of files into which the log is split.
const PARTS: u64 = 4;

/// A record by which the next one can be checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Mark {
    /// Its number.
    pub(super) seq: u64,
    /// Its hash.
    pub(super) hash: String,
}

impl Default for Mark {
    /// The position before the very first record.
    fn default() -> Mark {
        Mark {
            seq: 0,
            hash: NOTHING.to_owned(),
        }
    }
}

impl Mark {
    /// Its line in a separate file.
    pub(super) fn line(&self) -> String {
        format!("{:020} {}\n", self.seq, self.hash)
    }

    /// The mark stored in a file.
    pub(super) fn read(from: &mut File) -> Option<Mark> {
        let mut text = String::new();
        from.take(LINE_MAX as u64).read_to_string(&mut text).ok()?;
        let (seq, hash) = text.strip_suffix('\n')?.split_once(' ')?;
        Some(Mark {
            seq: seq.parse().ok()?,
            hash: hash.to_owned(),
        })
    }
}

/// Maximum size of a file if the log is limited to this many bytes.
pub(super) fn file_max(keep: u64) -> u64 {
    FILE_MAX.min(keep / PARTS)
}

/// The path of the newest file.
pub(super) fn newest(folder: &Path) -> PathBuf {
    folder.join(LOG)
}

/// The path of the full file that begins with this record.
pub(super) fn full(folder: &Path, first: u64) -> PathBuf {
    folder.join(format!("audit-{first:020}.log"))
}

/// The first records of the full files, oldest first.
pub(super) fn all_full(folder: &Path) -> Result<Vec<u64>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let name = entry?.file_name();
        let number = name.to_str().and_then(|name| {
            let digits = name.strip_prefix("audit-")?.strip_suffix(".log")?;
            digits.parse::<u64>().ok()
        });
        found.extend(number);
    }
    found.sort_unstable();
    Ok(found)
}

/// The same for all files, including the newest up to the given position.
pub(super) fn all(folder: &Path, reach: &Reach) -> Result<Vec<u64>> {
    let mut found = all_full(folder)?;
    found.retain(|first| *first < reach.first);
    found.push(reach.first);
    Ok(found)
}

/// The file at a position, and its length.
pub(super) fn open(folder: &Path, first: u64, reach: &Reach) -> Result<(File, u64)> {
    let path = full(folder, first);
    if first != reach.first {
        let file = File::open(path)?;
        let len = file.metadata()?.len();
        return Ok((file, len));
    }
    let newest = File::open(newest(folder));
    // It may have been renamed by now.
    let file = File::open(path).or(newest)?;
    Ok((file, reach.len))
}

/// The end of a file, as a position.
pub(super) fn end(folder: &Path, first: u64, reach: &Reach) -> Result<LogPosition> {
    let at = open(folder, first, reach)?.1;
    Ok(LogPosition { first, at })
}

/// What precedes the first remaining record.
pub(super) fn anchor(folder: &Path) -> Mark {
    let read = File::open(folder.join(ANCHOR)).ok();
    read.and_then(|mut file| Mark::read(&mut file))
        .unwrap_or_default()
}

/// Starts another file after the one that begins with this record. On an error the newest is
/// unchanged. Everything written before is durable.
pub(super) fn turn(folder: &Path, first: u64) -> Result<File> {
    let (newest, full) = (newest(folder), full(folder, first));
    if full.exists() {
        return Err(ErrorKind::AlreadyExists.into());
    }
    std::fs::rename(&newest, &full)?;
    let begun = open_or_make(&newest).and_then(|file| {
        durable::sync_folder(folder)?;
        Ok(file)
    });
    if begun.is_err() {
        std::fs::rename(&full, &newest)?;
    }
    begun
}

/// Opens a file for writing, and creates it if necessary.
pub(super) fn open_or_make(path: &Path) -> Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path)
}

/// Deletes the oldest files, until the rest and one full file are within the limit.
pub(super) fn forget(folder: &Path, keep: u64) -> Result<()> {
    let known = anchor(folder);
    let files = all_full(folder)?.into_iter().map(|first| {
        let path = full(folder, first);
        let len = path.metadata().map_or(0, |file| file.len());
        (first, path, len)
    });
    let files: Vec<_> = files.collect();
    let mut sum = file_max(keep) + files.iter().map(|(.., len)| len).sum::<u64>();
    for (first, path, len) in files {
        // One before the anchor was about to be deleted already.
        if known.seq < first {
            if sum <= keep {
                break;
            }
            let last = last(&path)?.ok_or_else(|| Error::from(ErrorKind::InvalidData))?;
            remember(folder, &last)?;
        }
        std::fs::remove_file(path)?;
        sum -= len;
    }
    Ok(())
}

/// The last record of a full file; `None` if its end is not a record.
fn last(path: &Path) -> Result<Option<Mark>> {
    let mut file = File::open(path)?;
    let len = file.metadata()?.len();
    let bytes = read_at(&mut file, len.saturating_sub(LINE_MAX as u64), len)?;
    let line = bytes
        .strip_suffix(b"\n")
        .and_then(|lines| lines.rsplit(|byte| *byte == b'\n').next());
    Ok(line.and_then(decode).map(|(hash, numbered)| Mark {
        seq: numbered.seq,
        hash: hash.to_owned(),
    }))
}

/// Stores the last record of the files that will be deleted, before they are.
fn remember(folder: &Path, mark: &Mark) -> Result<()> {
    durable::replace(&folder.join(ANCHOR), mark.line().as_bytes(), Some(0o600))
}
