//! Reading the log: in pages from its end, or along its whole chain.

use super::chain::{AuditRecord, HASH_LEN, LINE_MAX, Numbered, decode, follows};
use super::files::{self, Mark};
use super::tail::{Reach, first_of, head_of, hold, read_at};
use std::collections::HashMap;
use std::fmt;
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Result};
use std::path::Path;
use std::str::FromStr;

/// Number of bytes read at a time.
const CHUNK: u64 = 64 << 10;
/// Number of bytes searched for one page.
const SCAN_MAX: u64 = 8 << 20;
/// The end of an entry is searched for within this many bytes after it.
const AHEAD: u64 = 512 << 10;

/// A filter for entries.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Filter {
    /// Those of this module.
    pub module: Option<String>,
    /// Those that refer to this point.
    pub label: Option<String>,
}

/// An entry, with its result if it has one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Logged {
    /// Its number.
    pub id: String,
    /// When it was written, in milliseconds since 1970.
    pub at_ms: u64,
    /// Who requested it.
    pub who: String,
    /// From where.
    pub via: String,
    /// The module.
    pub module: String,
    /// What was requested.
    pub what: String,
    /// The state known before.
    pub before: String,
    /// The state known after it.
    pub after: String,
    /// The result; `None` while it is in progress.
    pub end: Option<String>,
    /// The hash of its first record.
    pub hash: String,
}

/// A position between two records. It stays valid when the log continues in another file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LogPosition {
    /// The first record of its file.
    pub(super) first: u64,
    /// The offset in that file.
    pub(super) at: u64,
}

impl fmt::Display for LogPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.first, self.at)
    }
}

impl FromStr for LogPosition {
    type Err = std::num::ParseIntError;

    fn from_str(text: &str) -> std::result::Result<LogPosition, Self::Err> {
        let (first, at) = text.split_once('-').unwrap_or((text, ""));
        Ok(LogPosition {
            first: first.parse()?,
            at: at.parse()?,
        })
    }
}

/// A page of entries.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LogPage {
    /// The newest first.
    pub entries: Vec<Logged>,
    /// Where to continue; `None` at the beginning of the log.
    pub next: Option<LogPosition>,
}

/// The result of verifying the chain.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// The number of the oldest record kept.
    pub first: u64,
    /// The number of consecutive records.
    pub records: u64,
    /// The number of entries among them.
    pub entries: u64,
    /// The number of the first record that was changed or is missing.
    pub broken_at: Option<u64>,
}

/// Some records as they are stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// The oldest first, each with its hash.
    pub records: Vec<(String, Numbered)>,
    /// Where to continue.
    pub next: LogPosition,
}

/// Verifies the whole log. It must end where its writer says.
pub(super) fn verify(folder: &Path, known: &Reach) -> Result<Verified> {
    let anchor = files::anchor(folder);
    let files = to_verify(folder, Some(known), anchor.seq)?;
    along_all(anchor, Some(known.last.clone()), files)
}

/// Verifies the log of a folder that is not open for writing. It must end as the head file says.
///
/// # Errors
/// The system's error; [`ErrorKind::WouldBlock`] while it is open for writing: a partial write
/// would look like damage.
pub fn verify_folder(folder: &Path) -> Result<Verified> {
    // A writer need not wait longer than for this: what is written later is not read.
    let held = hold(folder)?;
    let (anchor, head) = (files::anchor(folder), head_of(folder));
    let files = to_verify(folder, None, anchor.seq)?;
    drop(held);
    along_all(anchor, head, files)
}

/// Verifies the files that follow the anchor, up to the head.
fn along_all(anchor: Mark, head: Option<Mark>, files: Vec<(File, u64)>) -> Result<Verified> {
    let mut found = Verified {
        first: anchor.seq + 1,
        ..Verified::default()
    };
    let Some(head) = head else {
        found.broken_at = Some(found.first);
        return Ok(found);
    };
    let mut walk = Walk {
        found,
        head_seen: head == anchor,
        head,
        last: anchor,
    };
    for (file, len) in files {
        if !walk.along(&mut BufReader::new(file.take(len)))? {
            return Ok(walk.found);
        }
    }
    if !walk.head_seen {
        walk.found.broken_at = Some(walk.last.seq + 1);
    }
    Ok(walk.found)
}

/// The files after the anchor, oldest first, and how much of each to read.
fn to_verify(folder: &Path, known: Option<&Reach>, anchor: u64) -> Result<Vec<(File, u64)>> {
    let mut found = Vec::new();
    for first in files::all_full(folder)? {
        let is_newer = known.is_some_and(|reach| first >= reach.first);
        if first > anchor && !is_newer {
            found.push((File::open(files::full(folder, first))?, u64::MAX));
        }
    }
    let newest = match known {
        Some(reach) => files::open(folder, reach.first, reach),
        None => File::open(files::newest(folder)).and_then(|file| {
            let len = file.metadata()?.len();
            Ok((file, len))
        }),
    };
    match newest {
        Ok(newest) => found.push(newest),
        // The previous one was full, and this one was not started yet.
        Err(error) if error.kind() == ErrorKind::NotFound && !found.is_empty() => {}
        Err(error) => return Err(error),
    }
    Ok(found)
}

/// A walk along the chain.
struct Walk {
    found: Verified,
    /// The last record read.
    last: Mark,
    /// The record that must be reached.
    head: Mark,
    head_seen: bool,
}

impl Walk {
    /// Verifies one file; returns whether all of it continues the chain.
    fn along(&mut self, file: &mut impl BufRead) -> Result<bool> {
        let mut line = Vec::new();
        loop {
            line.clear();
            let read = file
                .by_ref()
                .take(LINE_MAX as u64)
                .read_until(b'\n', &mut line)?;
            if read == 0 {
                return Ok(true);
            }
            if !self.takes(&line) {
                self.found.broken_at = Some(self.last.seq + 1);
                return Ok(false);
            }
        }
    }

    /// Whether a line is the next one.
    fn takes(&mut self, line: &[u8]) -> bool {
        let text = line.strip_suffix(b"\n");
        let Some((hash, numbered)) = text.and_then(|text| follows(&self.last.hash, text)) else {
            return false;
        };
        let is_cut = matches!(numbered.record, AuditRecord::Cut { .. });
        if numbered.seq != self.last.seq + 1 || is_cut {
            return false;
        }
        self.found.records += 1;
        self.found.entries += u64::from(matches!(numbered.record, AuditRecord::Begin { .. }));
        self.last = Mark {
            seq: numbered.seq,
            hash: hash.to_owned(),
        };
        self.head_seen |= self.last == self.head;
        true
    }
}

/// Records from a position on.
pub(super) fn export(folder: &Path, from: Option<LogPosition>, reach: &Reach) -> Result<Exported> {
    let all = files::all(folder, reach)?;
    let first = all.first().copied().unwrap_or(reach.first);
    let mut from = from.unwrap_or(LogPosition { first, at: 0 });
    let (mut file, mut len) = files::open(folder, from.first, reach)?;
    if from.at >= len
        && let Some(first) = all.into_iter().find(|first| *first > from.first)
    {
        from = LogPosition { first, at: 0 };
        (file, len) = files::open(folder, first, reach)?;
    }
    let mut exported = Exported {
        records: Vec::new(),
        next: from,
    };
    let bytes = read_at(&mut file, from.at, len.min(from.at.saturating_add(CHUNK)))?;
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        let Some(text) = line.strip_suffix(b"\n") else {
            break;
        };
        exported.next.at += line.len() as u64;
        // Verification reports what can't be read.
        if let Some((hash, numbered)) = decode(text) {
            exported.records.push((hash.to_owned(), numbered));
        }
    }
    Ok(exported)
}

/// Records of a folder's log from a position on, even while it is being written.
///
/// # Errors
/// The system's error.
pub fn export_folder(folder: &Path, from: Option<LogPosition>) -> Result<Exported> {
    let mut newest = File::open(files::newest(folder))?;
    let reach = Reach {
        // Nothing can be newer than the end.
        first: first_of(&mut newest)?.unwrap_or(u64::MAX),
        len: newest.metadata()?.len(),
        last: Mark::default(),
    };
    export(folder, from, &reach)
}

/// Entries before a position, newest first.
pub(super) fn page(
    folder: &Path,
    before: Option<LogPosition>,
    reach: &Reach,
    limit: usize,
    filter: &Filter,
) -> Result<LogPage> {
    let all = files::all(folder, reach)?;
    let end = files::end(folder, reach.first, reach)?;
    let mut place = before.map_or(end, |before| before.min(end));
    let mut back = Back {
        ends: Ends::default(),
        entries: Vec::new(),
        limit,
        left: SCAN_MAX,
        filter,
    };
    back.look_ahead(folder, place, reach, &all)?;
    // If the position is no longer kept, neither is anything before it.
    let mut older = all.iter().rposition(|first| *first == place.first);
    while let Some(index) = older {
        let (mut file, len) = files::open(folder, place.first, reach)?;
        place.at = back.go(&mut file, place.at.min(len))?;
        older = index.checked_sub(1);
        if place.at == 0 {
            let Some(first) = older.and_then(|older| all.get(older)) else {
                break;
            };
            place = files::end(folder, *first, reach)?;
        }
        if back.is_enough() {
            return Ok(LogPage {
                entries: back.entries,
                next: Some(place),
            });
        }
    }
    Ok(LogPage {
        entries: back.entries,
        next: None,
    })
}

/// A search through the log, backwards.
struct Back<'f> {
    ends: Ends,
    entries: Vec<Logged>,
    /// Number of entries wanted.
    limit: usize,
    /// Number of bytes that may still be searched.
    left: u64,
    filter: &'f Filter,
}

impl Back<'_> {
    fn is_enough(&self) -> bool {
        self.entries.len() >= self.limit || self.left == 0
    }

    /// Collects the results that follow the entries still to be read.
    fn look_ahead(
        &mut self,
        folder: &Path,
        from: LogPosition,
        reach: &Reach,
        all: &[u64],
    ) -> Result<()> {
        let mut left = AHEAD;
        for first in all.iter().copied().filter(|first| *first >= from.first) {
            let start = if first == from.first { from.at } else { 0 };
            let (mut file, len) = files::open(folder, first, reach)?;
            let ahead = read_at(&mut file, start, len.min(start.saturating_add(left)))?;
            for line in ahead.split(|byte| *byte == b'\n') {
                if let Some((_, numbered)) = decode(line) {
                    self.ends.take(&numbered.record);
                }
            }
            left = left.saturating_sub(ahead.len() as u64);
            if left == 0 {
                break;
            }
        }
        Ok(())
    }

    /// Searches a file backwards from a position; returns where it stopped.
    fn go(&mut self, file: &mut File, before: u64) -> Result<u64> {
        let mut at = before;
        // The beginning of a line whose end is in the chunk read before.
        let mut rest: Vec<u8> = Vec::new();
        while at > 0 && !self.is_enough() {
            let start = at.saturating_sub(CHUNK);
            self.left = self.left.saturating_sub(at - start);
            let mut bytes = read_at(file, start, at)?;
            bytes.append(&mut rest);
            let mut end = bytes.len();
            while let Some(line_start) = last_line(&bytes, end, start == 0) {
                let line = bytes.get(line_start..end).unwrap_or_default();
                end = line_start;
                let line = line.strip_suffix(b"\n").unwrap_or(line);
                self.entries.extend(self.ends.entry(line, self.filter));
                if self.entries.len() >= self.limit {
                    return Ok(start + line_start as u64);
                }
            }
            bytes.truncate(end);
            rest = bytes;
            at = start;
        }
        Ok(at + rest.len() as u64)
    }
}

/// Where the last complete line before a position begins; `None` if that is not known yet.
fn last_line(bytes: &[u8], end: usize, from_first: bool) -> Option<usize> {
    let without_end = bytes.get(..end.checked_sub(1)?)?;
    match without_end.iter().rposition(|byte| *byte == b'\n') {
        Some(at) => Some(at + 1),
        None => from_first.then_some(0),
    }
}

/// Results found before their entries, since the search goes backwards.
#[derive(Default)]
struct Ends(HashMap<String, (String, String)>);

impl Ends {
    fn take(&mut self, record: &AuditRecord) {
        if let AuditRecord::End { id, end, after } = record {
            self.0.insert(id.clone(), (end.clone(), after.clone()));
        }
    }

    /// The entry of a line, if it matches the filter.
    fn entry(&mut self, line: &[u8], filter: &Filter) -> Option<Logged> {
        let (hash, numbered) = decode(line)?;
        self.take(&numbered.record);
        let AuditRecord::Begin {
            id,
            who,
            via,
            module,
            what,
            before,
        } = numbered.record
        else {
            return None;
        };
        let ended = self.0.remove(&id);
        let wanted = filter
            .module
            .as_ref()
            .is_none_or(|wanted| *wanted == module)
            && filter
                .label
                .as_ref()
                .is_none_or(|label| names(&what, label));
        wanted.then(|| {
            let (end, after) = ended.unzip();
            Logged {
                id,
                at_ms: numbered.at_ms,
                who,
                via,
                module,
                what,
                before,
                after: after.unwrap_or_default(),
                end,
                hash: hash.get(..HASH_LEN).unwrap_or_default().to_owned(),
            }
        })
    }
}

/// Whether the description of a command refers to a point: `do0=on do1=off`, `pulse k1 500ms`.
fn names(what: &str, label: &str) -> bool {
    what.split([' ', '=']).any(|word| word == label)
}
