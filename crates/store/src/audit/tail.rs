//! The end of the log, where records are appended.

use super::chain::{AuditRecord, LINE_MAX, Numbered, decode, encode, follows};
use super::files::{self, Mark};
use crate::durable;
use crate::history::millis;
use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// The name of the file that stores how far the log reaches.
const HEAD: &str = "audit.head";
/// Number of bytes checked when the log is opened.
const WINDOW: u64 = 4 << 20;
/// A verification locks the log for a moment, a writer for good: this many attempts are made.
const LOCK_TRIES: u32 = 10;
/// Pause between two attempts.
const LOCK_PAUSE: Duration = Duration::from_millis(10);

/// How far the log reaches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reach {
    /// The first record of the newest file, or the one with which it will begin.
    pub(super) first: u64,
    /// How long the newest file is, in bytes.
    pub(super) len: u64,
    /// The last record.
    pub(super) last: Mark,
}

impl Reach {
    /// With an empty file after this record.
    fn after(last: Mark) -> Reach {
        Reach {
            first: last.seq + 1,
            len: 0,
            last,
        }
    }
}

/// What was found when the log was opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenReport {
    /// A partially written last record of this many bytes was removed.
    pub torn: u64,
    /// The entries that were in progress when the program ended: their results are unknown.
    pub unfinished: Vec<String>,
    /// Its end was removed.
    pub cut: bool,
    /// It was broken, and is kept here now.
    pub put_aside: Option<PathBuf>,
}

/// The log, open for writing.
pub(super) struct Tail {
    folder: PathBuf,
    file: File,
    head: File,
    pub(super) reach: Reach,
    /// Number of records that could not be written.
    lost: u64,
    opened: Instant,
}

impl Tail {
    /// Opens the log of a folder and finds its end.
    pub(super) fn open(folder: &Path) -> Result<(Tail, OpenReport)> {
        std::fs::create_dir_all(folder)?;
        let head = files::open_or_make(&folder.join(HEAD))?;
        lock(&head)?;
        let path = files::newest(folder);
        let mut found = OpenReport::default();
        let before = before_newest(folder, &mut found)?;
        let mut file = files::open_or_make(&path)?;
        let reach = match find_end(&mut file, before.as_ref(), &mut found)? {
            Some(reach) => reach,
            None => {
                file = put_aside(&path, &mut found)?;
                Reach::after(before.unwrap_or_default())
            }
        };
        // Make the names of new files durable, too.
        durable::sync_folder(folder)?;
        let mut tail = Tail {
            folder: folder.to_owned(),
            file,
            head,
            reach,
            lost: 0,
            opened: Instant::now(),
        };
        tail.begin(&mut found)?;
        Ok((tail, found))
    }

    /// Records that the log was opened, and what was found.
    fn begin(&mut self, found: &mut OpenReport) -> Result<()> {
        let mut records = Vec::new();
        if let Some(head) = self.head()
            && !self.reaches(&head)
        {
            found.cut = true;
            let Mark { seq, hash } = head;
            records.push(AuditRecord::Cut { seq, hash });
        }
        records.push(AuditRecord::Start {
            version: env!("CARGO_PKG_VERSION").to_owned(),
        });
        for id in &found.unfinished {
            records.push(AuditRecord::End {
                id: id.clone(),
                end: "unknown".to_owned(),
                after: String::new(),
            });
        }
        // A disk that is full now may have room later; until then, losses are counted.
        if self.append(records.into_iter()).is_ok() {
            self.sync()?;
        }
        Ok(())
    }

    /// How far the log has reached, according to its head.
    fn head(&mut self) -> Option<Mark> {
        self.head.seek(SeekFrom::Start(0)).ok()?;
        Mark::read(&mut self.head)
    }

    /// Whether the log contains the record named by the head. It may be longer: the head is written
    /// after the record and not synced.
    fn reaches(&mut self, head: &Mark) -> bool {
        if head.seq >= self.reach.last.seq {
            return *head == self.reach.last;
        }
        let start = self.reach.len.saturating_sub(WINDOW);
        let Ok(window) = read_at(&mut self.file, start, self.reach.len) else {
            return true;
        };
        let named = |line: &[u8]| line.starts_with(head.hash.as_bytes());
        // A fault further back than this can't be proved here.
        let is_farther = start > 0 || head.seq < self.reach.first;
        is_farther || window.split(|byte| *byte == b'\n').any(named)
    }

    /// Continues in another file if this one is full, and deletes what is beyond the limit. If that
    /// fails, this file grows longer.
    pub(super) fn turn(&mut self, keep: u64) {
        if self.reach.len < files::file_max(keep) {
            return;
        }
        if let Ok(file) = files::turn(&self.folder, self.reach.first) {
            self.file = file;
            self.reach = Reach::after(self.reach.last.clone());
            // What remains is deleted the next time.
            let _ = files::forget(&self.folder, keep);
        }
    }

    /// Counts records that never came here.
    pub(super) const fn has_lost(&mut self, records: u64) {
        self.lost += records;
    }

    /// Appends records. They are either complete or absent, and not durable yet.
    pub(super) fn append(&mut self, records: impl Iterator<Item = AuditRecord>) -> Result<()> {
        let mut text = String::new();
        let mut next = self.reach.clone();
        let up_us = u64::try_from(self.opened.elapsed().as_micros()).unwrap_or(u64::MAX);
        let lost = (self.lost > 0).then_some(AuditRecord::Lost { records: self.lost });
        let mut count = 0;
        for record in lost.into_iter().chain(records) {
            next.last.seq += 1;
            count += 1;
            let numbered = Numbered {
                seq: next.last.seq,
                at_ms: millis(SystemTime::now()).unsigned_abs(),
                up_us,
                record: record.cut(),
            };
            next.last.hash = encode(&mut text, &next.last.hash, &numbered);
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

    /// Removes a partial write. If even that fails, the next write overwrites it.
    fn forget_after(&mut self, len: u64) {
        let _ = self.file.set_len(len);
    }

    /// Syncs the appended records, and stores how far they reach.
    pub(super) fn sync(&mut self) -> Result<()> {
        self.file.sync_data()?;
        let head = self.reach.last.line();
        // The head only refers to durable records; it need not be durable itself.
        let _ = self
            .head
            .seek(SeekFrom::Start(0))
            .and_then(|_| self.head.write_all(head.as_bytes()));
        Ok(())
    }

    /// Drops what could not be made durable: it is not known which part of it is.
    pub(super) fn back_to(&mut self, reach: Reach) {
        self.lost += self.reach.last.seq.saturating_sub(reach.last.seq);
        self.forget_after(reach.len);
        self.reach = reach;
    }

    /// It is written there from now on.
    #[cfg(test)]
    pub(super) fn writes_to(&mut self, file: File) {
        self.file = file;
    }
}

/// How far the log of a folder reaches, according to its head.
pub(super) fn head_of(folder: &Path) -> Option<Mark> {
    Mark::read(&mut File::open(folder.join(HEAD)).ok()?)
}

/// Locks the log: two writers would break the chain.
fn lock(head: &File) -> Result<()> {
    for _ in 0..LOCK_TRIES {
        if head.try_lock().is_ok() {
            return Ok(());
        }
        std::thread::sleep(LOCK_PAUSE);
    }
    Err(ErrorKind::WouldBlock.into())
}

/// Locks out writers of a folder's log until this is dropped; `None` if there is no log yet.
pub(super) fn hold(folder: &Path) -> Result<Option<File>> {
    let head = match File::open(folder.join(HEAD)) {
        Ok(head) => head,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    head.try_lock_shared()
        .map_err(|_| Error::from(ErrorKind::WouldBlock))?;
    Ok(Some(head))
}

/// The last record before the newest file, and the entries open then; `None` if not known.
fn before_newest(folder: &Path, found: &mut OpenReport) -> Result<Option<Mark>> {
    let Some(first) = files::all_full(folder)?.pop() else {
        return Ok(Some(files::anchor(folder)));
    };
    let mut file = File::open(files::full(folder, first))?;
    let len = file.metadata()?.len();
    let start = len.saturating_sub(WINDOW);
    let window = read_at(&mut file, start, len)?;
    let lines = window.strip_suffix(b"\n");
    Ok(lines.and_then(|lines| walk(lines, None, start == 0, &mut found.unfinished)))
}

/// Keeps a broken log under another name, and starts a new one.
fn put_aside(path: &Path, found: &mut OpenReport) -> Result<File> {
    let now = millis(SystemTime::now()).unsigned_abs();
    let aside = path.with_file_name(format!("audit.broken-{now}.log"));
    std::fs::rename(path, &aside)?;
    found.put_aside = Some(aside);
    found.torn = 0;
    found.unfinished.clear();
    files::open_or_make(path)
}

/// The end of the log; `None` if its last part is not a chain. A partial write is removed.
fn find_end(
    file: &mut File,
    before: Option<&Mark>,
    found: &mut OpenReport,
) -> Result<Option<Reach>> {
    let len = file.metadata()?.len();
    let start = len.saturating_sub(WINDOW);
    let window = read_at(file, start, len)?;
    let Some(end) = window.iter().rposition(|byte| *byte == b'\n') else {
        // A torn first record alone is no loss; a log without a newline is.
        if start > 0 {
            return Ok(None);
        }
        found.torn = len;
        if len > 0 {
            file.set_len(0)?;
        }
        return Ok(Some(Reach::after(before.cloned().unwrap_or_default())));
    };
    let whole = start + end as u64 + 1;
    found.torn = len - whole;
    let lines = window.get(..end).unwrap_or_default();
    let last = walk(lines, before, start == 0, &mut found.unfinished);
    let (Some(last), Some(first)) = (last, first_of(file)?) else {
        return Ok(None);
    };
    if found.torn > 0 {
        file.set_len(whole)?;
    }
    Ok(Some(Reach {
        first,
        len: whole,
        last,
    }))
}

/// The number of the first record of a file.
pub(super) fn first_of(file: &mut File) -> Result<Option<u64>> {
    let bytes = read_at(file, 0, LINE_MAX as u64)?;
    let line = bytes.split(|byte| *byte == b'\n').next();
    Ok(line.and_then(decode).map(|(_, numbered)| numbered.seq))
}

/// Checks the last lines of a file, which may be all of it and then follow a given record; returns
/// the last one.
fn walk(
    lines: &[u8],
    before: Option<&Mark>,
    from_first: bool,
    unfinished: &mut Vec<String>,
) -> Option<Mark> {
    let mut last = before.filter(|_| from_first).cloned();
    for (index, line) in lines.split(|byte| *byte == b'\n').enumerate() {
        if index == 0 && !from_first {
            // The window begins in the middle of this line.
            continue;
        }
        let (hash, numbered) = match &last {
            Some(last) => follows(&last.hash, line).filter(|(_, n)| n.seq == last.seq + 1)?,
            None => decode(line)?,
        };
        last = Some(Mark {
            seq: numbered.seq,
            hash: hash.to_owned(),
        });
        match numbered.record {
            AuditRecord::Begin { id, .. } => unfinished.push(id),
            AuditRecord::End { id, .. } => unfinished.retain(|open| *open != id),
            _ => {}
        }
    }
    last
}

/// A part of a file.
pub(super) fn read_at(file: &mut File, start: u64, end: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(start))?;
    file.take(end.saturating_sub(start))
        .read_to_end(&mut bytes)?;
    Ok(bytes)
}
