//! The journal's file: every record is on disk before the procedure continues.

use crate::durable;
use railbus_commission::{JournalRecord, Log};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// The file's name in its folder.
const NAME: &str = "journal.jsonl";
/// The longest journal that is read; a properly shortened one never comes near it.
const LEN_MAX: u64 = 16 << 20;

/// An open journal. It is locked against other writers.
#[derive(Debug)]
pub struct JournalFile {
    folder: PathBuf,
    file: File,
    log: Log,
    /// The last line was torn: the next record must start a new line.
    torn: bool,
}

impl JournalFile {
    /// Opens the journal in a folder, which is created if necessary.
    ///
    /// # Errors
    /// If the system refuses; [`io::ErrorKind::WouldBlock`] while another process has it open.
    pub fn open(folder: &Path) -> io::Result<JournalFile> {
        durable::folder(folder)?;
        let path = folder.join(NAME);
        let is_new = !path.exists();
        let file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .mode(0o600)
            .open(&path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(io::ErrorKind::WouldBlock.into()),
            Err(TryLockError::Error(error)) => return Err(error),
        }
        if is_new {
            durable::sync_folder(folder)?;
        }
        let mut store = JournalFile {
            folder: folder.to_owned(),
            file,
            log: Log::default(),
            torn: false,
        };
        store.read()?;
        store.shorten()?;
        Ok(store)
    }

    /// Reads the journal in a folder without locking it; an empty one if there is none.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn peek(folder: &Path) -> io::Result<Log> {
        match File::open(folder.join(NAME)) {
            Ok(file) => text(&file).map(|text| Log::read(&text)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Log::default()),
            Err(error) => Err(error),
        }
    }

    /// Its content.
    #[must_use]
    pub const fn log(&self) -> &Log {
        &self.log
    }

    /// Appends a record, and returns when it is durable.
    ///
    /// # Errors
    /// If the system refuses: the record may then be missing.
    pub fn append(&mut self, record: JournalRecord) -> io::Result<()> {
        let begin = if self.torn { "\n" } else { "" };
        // A partial failure leaves a torn line.
        self.torn = true;
        let line = format!("{begin}{}", record.line_of_text());
        self.file.write_all(line.as_bytes())?;
        self.file.sync_all()?;
        self.torn = false;
        self.log.records.push(record);
        Ok(())
    }

    fn read(&mut self) -> io::Result<()> {
        let text = text(&self.file)?;
        self.torn = !text.is_empty() && !text.ends_with('\n');
        self.log = Log::read(&text);
        Ok(())
    }

    /// Replaces it with a shorter one, so that there is a complete one at every moment.
    fn shorten(&mut self) -> io::Result<()> {
        let Some(short) = self.log.shortened() else {
            return Ok(());
        };
        let new = self.folder.join("journal.new");
        let mut file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(&new)?;
        file.set_len(0)?;
        file.try_lock()
            .map_err(|_| io::Error::from(io::ErrorKind::WouldBlock))?;
        file.write_all(short.as_bytes())?;
        file.sync_all()?;
        std::fs::rename(&new, self.folder.join(NAME))?;
        durable::sync_folder(&self.folder)?;
        self.file = file;
        self.read()
    }
}

fn text(mut file: &File) -> io::Result<String> {
    file.seek(SeekFrom::Start(0))?;
    let mut bytes = Vec::new();
    file.take(LEN_MAX).read_to_end(&mut bytes)?;
    // A torn character is a torn line.
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_commission::RecordState;
    use railbus_device::{Family, Setup};
    use railbus_wire::Address;
    use std::os::unix::fs::PermissionsExt;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("railbus-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        folder
    }

    fn record(change: u64) -> JournalRecord {
        JournalRecord::of(
            change,
            "main",
            "oven",
            &Setup::new(Family::Erc8, Address(3)),
        )
    }

    #[test]
    fn records_are_kept_beside_a_torn_one() {
        let folder = folder("store");
        let mut store = JournalFile::open(&folder).unwrap();
        store.append(record(1)).unwrap();
        assert_eq!(
            JournalFile::open(&folder).unwrap_err().kind(),
            io::ErrorKind::WouldBlock
        );
        drop(store);
        let path = folder.join(NAME);
        assert_eq!(
            std::fs::metadata(&path).unwrap().permissions().mode() & 0o777,
            0o600
        );
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(&record(2).line_of_text().as_bytes()[..40])
            .unwrap();
        let mut store = JournalFile::open(&folder).unwrap();
        assert_eq!(
            (store.log().records.len(), store.log().next_change()),
            (1, 2)
        );
        store
            .append(record(2).ended(RecordState::Done, None))
            .unwrap();
        drop(store);
        let log = JournalFile::peek(&folder).unwrap();
        assert_eq!((log.records.len(), log.unread), (2, 1));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_journal_never_grows_without_end() {
        let folder = folder("short");
        let mut store = JournalFile::open(&folder).unwrap();
        let many: String = (1..=railbus_commission::RECORDS_MAX as u64 + 1)
            .map(|number| record(number).ended(RecordState::Done, None).line_of_text())
            .collect();
        store.file.write_all(many.as_bytes()).unwrap();
        drop(store);
        let mut store = JournalFile::open(&folder).unwrap();
        assert_eq!(
            store.log().records.len(),
            railbus_commission::RECORDS_MAX / 2
        );
        store.append(record(9000)).unwrap();
        drop(store);
        assert_eq!(JournalFile::peek(&folder).unwrap().next_change(), 9001);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
