//! The end of the log, where records are added.

use super::chain::{LINE_MAX, NOTHING, Numbered, Record, encode, follows};
use crate::durable;
use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

/// The name of the log in its folder.
const LOG: &str = "audit.log";
/// The name of the file that remembers how far the log reached.
const HEAD: &str = "audit.head";
/// So much of the log is looked through when it is opened.
const WINDOW: u64 = 4 << 20;

/// How far the log reaches.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Reach {
    /// In bytes.
    pub(super) len: u64,
    /// The number of its last record.
    pub(super) seq: u64,
    /// The hash of that.
    pub(super) hash: String,
}

/// What was found when the log was opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// A last record of so many bytes was written in part, and was taken away.
    pub torn: u64,
    /// The entries that were under way when the program ended: nobody knows how they ended.
    pub unfinished: Vec<String>,
    /// Its end was taken away.
    pub cut: bool,
    /// It was broken, and lies here now.
    pub put_aside: Option<PathBuf>,
}

/// The log, open for writing.
pub(super) struct Tail {
    file: File,
    head: File,
    pub(super) reach: Reach,
    /// So many records could not be written.
    lost: u64,
    opened: Instant,
}

impl Tail {
    /// Opens the log of a folder and finds its end.
    pub(super) fn open(folder: &Path) -> Result<(Tail, Found)> {
        std::fs::create_dir_all(folder)?;
        let head = open(&folder.join(HEAD))?;
        // Two who add to one chain break it.
        head.try_lock()
            .map_err(|_| Error::from(ErrorKind::WouldBlock))?;
        let path = log_of(folder);
        let mut found = Found::default();
        let mut file = open(&path)?;
        let reach = match find_end(&mut file, &mut found)? {
            Some(reach) => reach,
            None => {
                file = put_aside(&path, &mut found)?;
                Reach::default()
            }
        };
        // The names of new files are kept, too.
        durable::sync_folder(folder)?;
        let mut tail = Tail {
            file,
            head,
            reach,
            lost: 0,
            opened: Instant::now(),
        };
        tail.begin(&mut found)?;
        Ok((tail, found))
    }

    /// Writes down that the log was opened, and what was found.
    fn begin(&mut self, found: &mut Found) -> Result<()> {
        let mut records = Vec::new();
        if let Some((seq, hash)) = self.head()
            && !self.reaches(seq, &hash)
        {
            found.cut = true;
            records.push(Record::Cut { seq, hash });
        }
        records.push(Record::Start {
            version: env!("CARGO_PKG_VERSION").to_owned(),
        });
        for id in &found.unfinished {
            records.push(Record::End {
                id: id.clone(),
                end: "unknown".to_owned(),
                after: String::new(),
            });
        }
        // A disk that is full now may not be later; until then, what is lost is counted.
        if self.append(records.into_iter()).is_ok() {
            self.sync()?;
        }
        Ok(())
    }

    /// How far the log is said to have reached: number and hash.
    fn head(&mut self) -> Option<(u64, String)> {
        self.head.seek(SeekFrom::Start(0)).ok()?;
        read_head(&mut self.head)
    }

    /// Whether the log has the record that the head names. It may be longer: a head is written
    /// after the record and not made durable.
    fn reaches(&mut self, seq: u64, hash: &str) -> bool {
        if seq >= self.reach.seq {
            return seq == self.reach.seq && hash == self.reach.hash;
        }
        let start = self.reach.len.saturating_sub(WINDOW);
        let Ok(window) = read_at(&mut self.file, start, self.reach.len) else {
            return true;
        };
        let named = |line: &[u8]| line.starts_with(hash.as_bytes());
        // Farther back than is looked is no fault that could be proved here.
        start > 0 || window.split(|byte| *byte == b'\n').any(named)
    }

    /// Adds records. They are whole or not there at all, and not durable yet.
    pub(super) fn append(&mut self, records: impl Iterator<Item = Record>) -> Result<()> {
        let mut text = String::new();
        let mut next = self.reach.clone();
        let up_us = u64::try_from(self.opened.elapsed().as_micros()).unwrap_or(u64::MAX);
        let lost = (self.lost > 0).then_some(Record::Lost { records: self.lost });
        let mut count = 0;
        for record in lost.into_iter().chain(records) {
            next.seq += 1;
            count += 1;
            let numbered = Numbered {
                seq: next.seq,
                at_ms: millis(SystemTime::now()),
                up_us,
                record: record.cut(),
            };
            next.hash = encode(&mut text, &next.hash, &numbered);
        }
        next.len += text.len() as u64;
        if let Err(why) = self.write(&text) {
            self.lost += count - u64::from(self.lost > 0);
            self.forget_after(self.reach.len);
            return Err(why);
        }
        self.reach = next;
        self.lost = 0;
        Ok(())
    }

    fn write(&mut self, text: &str) -> Result<()> {
        self.file.seek(SeekFrom::Start(self.reach.len))?;
        self.file.write_all(text.as_bytes())
    }

    /// Takes away what was written in part. Where even that fails, the next write goes over it.
    fn forget_after(&mut self, len: u64) {
        let _ = self.file.set_len(len);
    }

    /// Makes durable what was added, and remembers how far that is.
    pub(super) fn sync(&mut self) -> Result<()> {
        self.file.sync_data()?;
        let head = format!("{:020} {}\n", self.reach.seq, self.reach.hash);
        // The head only tells of records that are durable; itself it need not be.
        let _ = self
            .head
            .seek(SeekFrom::Start(0))
            .and_then(|_| self.head.write_all(head.as_bytes()));
        Ok(())
    }

    /// What could not be made durable is not there: nobody knows which part of it is.
    pub(super) fn back_to(&mut self, reach: Reach) {
        self.lost += self.reach.seq.saturating_sub(reach.seq);
        self.forget_after(reach.len);
        self.reach = reach;
    }
}

/// Where the log of a folder lies.
pub(super) fn log_of(folder: &Path) -> PathBuf {
    folder.join(LOG)
}

/// How far the log of a folder is said to reach.
pub(super) fn head_of(folder: &Path) -> Option<(u64, String)> {
    read_head(&mut File::open(folder.join(HEAD)).ok()?)
}

fn read_head(head: &mut File) -> Option<(u64, String)> {
    let mut text = String::new();
    head.take(LINE_MAX as u64).read_to_string(&mut text).ok()?;
    let (seq, hash) = text.strip_suffix('\n')?.split_once(' ')?;
    Some((seq.parse().ok()?, hash.to_owned()))
}

fn open(path: &Path) -> Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path)
}

/// Keeps a broken log under another name, and begins a new one.
fn put_aside(path: &Path, found: &mut Found) -> Result<File> {
    let now = millis(SystemTime::now());
    let aside = path.with_file_name(format!("audit.broken-{now}.log"));
    std::fs::rename(path, &aside)?;
    found.put_aside = Some(aside);
    found.torn = 0;
    found.unfinished.clear();
    open(path)
}

/// The end of the log; none where its last part is no chain. What was written in part is taken
/// away.
fn find_end(file: &mut File, found: &mut Found) -> Result<Option<Reach>> {
    let len = file.metadata()?.len();
    let start = len.saturating_sub(WINDOW);
    let window = read_at(file, start, len)?;
    let Some(end) = window.iter().rposition(|byte| *byte == b'\n') else {
        // Nothing but a first record that was torn is no loss; a log without an end of line is.
        if start > 0 {
            return Ok(None);
        }
        found.torn = len;
        if len > 0 {
            file.set_len(0)?;
        }
        return Ok(Some(Reach::default()));
    };
    let whole = start + end as u64 + 1;
    found.torn = len - whole;
    let lines = window.get(..end).unwrap_or_default();
    let Some(last) = walk(lines, start == 0, &mut found.unfinished) else {
        return Ok(None);
    };
    if found.torn > 0 {
        file.set_len(whole)?;
    }
    Ok(Some(Reach { len: whole, ..last }))
}

/// Walks along the last lines; gives back the last one's number and hash.
fn walk(lines: &[u8], from_first: bool, unfinished: &mut Vec<String>) -> Option<Reach> {
    let mut reach = Reach::default();
    let mut known = from_first;
    for (index, line) in lines.split(|byte| *byte == b'\n').enumerate() {
        if index == 0 && !from_first {
            // The window begins in the middle of this one.
            continue;
        }
        let (hash, numbered) = if known {
            let before = if reach.seq == 0 { NOTHING } else { &reach.hash };
            follows(before, line)?
        } else {
            super::chain::decode(line)?
        };
        if known && numbered.seq != reach.seq + 1 {
            return None;
        }
        known = true;
        reach.hash = hash.to_owned();
        reach.seq = numbered.seq;
        match numbered.record {
            Record::Begin { id, .. } => unfinished.push(id),
            Record::End { id, .. } => unfinished.retain(|open| *open != id),
            _ => {}
        }
    }
    Some(reach)
}

/// A part of a file.
pub(super) fn read_at(file: &mut File, start: u64, end: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(start))?;
    file.take(end.saturating_sub(start))
        .read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Milliseconds since 1970.
pub(super) fn millis(at: SystemTime) -> u64 {
    let since = at
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}
