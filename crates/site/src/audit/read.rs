//! The log as it is read: from its end in pages, or along its whole chain.

use super::chain::{HASH_LEN, LINE_MAX, NOTHING, Numbered, Record, decode, follows};
use super::tail::{Reach, head_of, log_of, read_at};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Result};
use std::path::Path;

/// So much is read at a time.
const CHUNK: u64 = 64 << 10;
/// So much is looked through for one page.
const SCAN_MAX: u64 = 8 << 20;
/// The end of an entry is looked for within so much after it.
const AHEAD: u64 = 512 << 10;

/// Which entries are wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Filter {
    /// Those of this module.
    pub module: Option<String>,
    /// Those that name this point.
    pub label: Option<String>,
}

/// An entry, with its end where it has one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Logged {
    /// Its number.
    pub id: String,
    /// When it was written down, in milliseconds since 1970.
    pub at_ms: u64,
    /// Who asked for it.
    pub who: String,
    /// From where.
    pub via: String,
    /// The module.
    pub module: String,
    /// What was asked of it.
    pub what: String,
    /// What was known to be before.
    pub before: String,
    /// What is known to be after it.
    pub after: String,
    /// How it ended; none while it is under way.
    pub end: Option<String>,
    /// The hash of its first record.
    pub hash: String,
}

/// Some entries.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Page {
    /// The newest first.
    pub entries: Vec<Logged>,
    /// From where to go on; none at the beginning of the log.
    pub next: Option<u64>,
}

/// What was found along the chain.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// How many records follow upon each other.
    pub records: u64,
    /// Of them, how many entries.
    pub entries: u64,
    /// The number of the first record that is not as it was written, or that is missing.
    pub broken_at: Option<u64>,
}

/// Some records as they are in the log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// The oldest first, each with its hash.
    pub records: Vec<(String, Numbered)>,
    /// From where to go on.
    pub next: u64,
}

/// Goes along the whole log. It must end as was remembered: by the one who writes it, or else by
/// the file beside it.
pub(super) fn verify(folder: &Path, known: Option<&Reach>) -> Result<Verified> {
    let mut file = BufReader::new(File::open(log_of(folder))?);
    let mut found = Verified::default();
    let (mut hash, mut line) = (NOTHING.to_owned(), Vec::new());
    let mut at = 0;
    let head = known
        .map(|reach| (reach.seq, reach.hash.clone()))
        .or_else(|| head_of(folder));
    let Some((head_seq, head_hash)) = head else {
        found.broken_at = Some(1);
        return Ok(found);
    };
    let mut head_seen = false;
    while known.is_none_or(|reach| at < reach.len) {
        line.clear();
        let read = file
            .by_ref()
            .take(LINE_MAX as u64)
            .read_until(b'\n', &mut line)?;
        if read == 0 {
            break;
        }
        at += read as u64;
        let broken = Some(found.records + 1);
        let Some(text) = line.strip_suffix(b"\n") else {
            found.broken_at = broken;
            return Ok(found);
        };
        let Some((own, numbered)) = follows(&hash, text) else {
            found.broken_at = broken;
            return Ok(found);
        };
        let is_cut = matches!(numbered.record, Record::Cut { .. });
        if numbered.seq != found.records + 1 || is_cut {
            found.broken_at = broken;
            return Ok(found);
        }
        found.records += 1;
        found.entries += u64::from(matches!(numbered.record, Record::Begin { .. }));
        hash = own.to_owned();
        head_seen |= numbered.seq == head_seq && hash == head_hash;
    }
    if !head_seen {
        found.broken_at = Some(found.records + 1);
    }
    Ok(found)
}

/// Goes along the log of a folder that nobody writes.
///
/// # Errors
/// What the system says.
pub fn verify_folder(folder: &Path) -> Result<Verified> {
    verify(folder, None)
}

/// Records from a place on.
pub(super) fn export(folder: &Path, from: u64, len: u64) -> Result<Exported> {
    let mut file = File::open(log_of(folder))?;
    let mut exported = Exported {
        records: Vec::new(),
        next: from.min(len),
    };
    let bytes = read_at(&mut file, from, len.min(from.saturating_add(CHUNK)))?;
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        let Some(text) = line.strip_suffix(b"\n") else {
            break;
        };
        exported.next += line.len() as u64;
        // What can't be read is told by a verification.
        if let Some((hash, numbered)) = decode(text) {
            exported.records.push((hash.to_owned(), numbered));
        }
    }
    Ok(exported)
}

/// Entries before a place, the newest first.
pub(super) fn page(
    folder: &Path,
    before: u64,
    len: u64,
    limit: usize,
    filter: &Filter,
) -> Result<Page> {
    let mut file = File::open(log_of(folder))?;
    let mut ends = Ends::default();
    let ahead = read_at(&mut file, before, len.min(before.saturating_add(AHEAD)))?;
    for line in ahead.split(|byte| *byte == b'\n') {
        if let Some((_, numbered)) = decode(line) {
            ends.take(&numbered.record);
        }
    }
    let mut page = Page::default();
    let mut at = before;
    // The beginning of a line whose end lies in the chunk that was read before.
    let mut rest: Vec<u8> = Vec::new();
    while at > 0 && before - at < SCAN_MAX {
        let start = at.saturating_sub(CHUNK);
        let mut bytes = read_at(&mut file, start, at)?;
        bytes.append(&mut rest);
        let mut end = bytes.len();
        while let Some(line_start) = last_line(&bytes, end, start == 0) {
            let line = bytes.get(line_start..end).unwrap_or_default();
            end = line_start;
            if let Some(entry) = ends.entry(line.strip_suffix(b"\n").unwrap_or(line), filter) {
                page.entries.push(entry);
            }
            if page.entries.len() >= limit {
                let place = start + line_start as u64;
                page.next = (place > 0).then_some(place);
                return Ok(page);
            }
        }
        bytes.truncate(end);
        rest = bytes;
        at = start;
    }
    let place = at + rest.len() as u64;
    page.next = (at > 0).then_some(place);
    Ok(page)
}

/// Where the last whole line before a place begins; none where that is not known yet.
fn last_line(bytes: &[u8], end: usize, from_first: bool) -> Option<usize> {
    let without_end = bytes.get(..end.checked_sub(1)?)?;
    match without_end.iter().rposition(|byte| *byte == b'\n') {
        Some(at) => Some(at + 1),
        None => from_first.then_some(0),
    }
}

/// The ends that were met before their entries, as one meets them from the end.
#[derive(Default)]
struct Ends(HashMap<String, (String, String)>);

impl Ends {
    fn take(&mut self, record: &Record) {
        if let Record::End { id, end, after } = record {
            self.0.insert(id.clone(), (end.clone(), after.clone()));
        }
    }

    /// The entry of a line, where it is one that is wanted.
    fn entry(&mut self, line: &[u8], filter: &Filter) -> Option<Logged> {
        let (hash, numbered) = decode(line)?;
        self.take(&numbered.record);
        let Record::Begin {
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

/// Whether the description of a command names a point: `do0=on do1=off`, `pulse k1 500ms`.
fn names(what: &str, label: &str) -> bool {
    what.split([' ', '=']).any(|word| word == label)
}
