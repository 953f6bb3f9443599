//! What was done, by whom, and how it ended. The newest entries are kept in memory; all of them
//! in a log on the disk where there is one, and then nothing is sent before it was written down.

mod chain;
mod files;
mod log;
mod read;
mod tail;

pub use chain::{Numbered, Record};
pub use log::{AuditLog, NotWritten};
pub use read::{Exported, Filter, Logged, Page, Place, Verified, export_folder, verify_folder};
pub use tail::Found;

use crate::ulid::Ulids;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::SystemTime;

/// How many entries are kept in memory.
pub const AUDIT_MAX: usize = 1_024;

/// Who asked for something, and from where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The name of a user or of a part of the program: `li`, `pulse`, `rule:night`.
    pub who: String,
    /// The way it came: `cli`, `http 192.168.1.7`, `socket`, `program`.
    pub via: String,
}

impl Origin {
    /// A part of this program.
    #[must_use]
    pub fn program(part: &str) -> Origin {
        Origin {
            who: part.to_owned(),
            via: "program".to_owned(),
        }
    }
}

/// What is written down of something before it is done.
#[derive(Clone, Debug)]
pub struct Note {
    /// Who asks for it.
    pub origin: Origin,
    /// `do0=on do1=off`, `pulse k1 500ms`.
    pub what: String,
}

/// Something that was done, or tried.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its number, a ULID: numbers sort by time.
    pub id: String,
    /// When it was asked for.
    pub at: SystemTime,
    /// Who asked for it.
    pub origin: Origin,
    /// The module.
    pub module: String,
    /// What was asked of it: `do0=on do1=off`, `pulse k1 500ms`.
    pub what: String,
    /// How it ended: `readback`, `reply`, `sent`, or the name of what went wrong; none while it
    /// is under way.
    pub end: Option<&'static str>,
}

/// The newest entries, and the log of all.
#[derive(Debug, Default)]
pub struct Audit {
    entries: Mutex<VecDeque<Entry>>,
    ulids: Ulids,
    log: OnceLock<AuditLog>,
    /// There should be a log, and is none.
    missing: AtomicBool,
}

impl Audit {
    /// From now on everything is written into this log, too.
    pub fn keep(&self, log: AuditLog) {
        // A site has one log; the first stays.
        let _ = self.log.set(log);
    }

    /// Nothing may be done from now on, unless there is a log.
    pub fn miss(&self) {
        self.missing.store(true, Ordering::Relaxed);
    }

    /// The log of all entries, where there is one.
    pub fn log(&self) -> Option<&AuditLog> {
        self.log.get()
    }

    /// Writes down what is about to be done, with what is known to be before it; gives back its
    /// number. Where there is a log, it is durable when this returns.
    ///
    /// # Errors
    /// Where it could not be made durable, or there should be a log and is none.
    pub async fn begin(
        &self,
        module: &str,
        note: Note,
        before: String,
    ) -> (String, Result<(), NotWritten>) {
        let at = SystemTime::now();
        let id = self.ulids.next(at);
        let written = match self.log.get() {
            None if self.missing.load(Ordering::Relaxed) => Err(NotWritten),
            None => Ok(()),
            Some(log) => {
                let record = Record::Begin {
                    id: id.clone(),
                    who: note.origin.who.clone(),
                    via: note.origin.via.clone(),
                    module: module.to_owned(),
                    what: note.what.clone(),
                    before,
                };
                log.write(record, true).await
            }
        };
        let mut entries = self.entries();
        if entries.len() >= AUDIT_MAX {
            entries.pop_front();
        }
        entries.push_back(Entry {
            id: id.clone(),
            at,
            origin: note.origin,
            module: module.to_owned(),
            what: note.what,
            end: None,
        });
        (id, written)
    }

    /// Writes down how it ended, and what is known to be after it. The log has it when this
    /// returns, though it may still be on its way to the disk.
    pub async fn end(&self, id: &str, end: &'static str, after: String) {
        if let Some(entry) = self.entries().iter_mut().rev().find(|entry| entry.id == id) {
            entry.end = Some(end);
        }
        if let Some(log) = self.log.get() {
            let record = Record::End {
                id: id.to_owned(),
                end: end.to_owned(),
                after,
            };
            // What is lost is counted in the log itself.
            let _ = log.write(record, false).await;
        }
    }

    /// The entries in memory, oldest first.
    #[must_use]
    pub fn newest(&self) -> Vec<Entry> {
        self.entries().iter().cloned().collect()
    }

    fn entries(&self) -> MutexGuard<'_, VecDeque<Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(what: &str) -> Note {
        Note {
            origin: Origin::program("test"),
            what: what.to_owned(),
        }
    }

    #[tokio::test]
    async fn the_newest_are_kept() {
        let audit = Audit::default();
        for _ in 0..AUDIT_MAX + 5 {
            let (_, written) = audit.begin("pump", note(""), String::new()).await;
            assert!(written.is_ok());
        }
        assert_eq!(audit.newest().len(), AUDIT_MAX);
    }

    #[tokio::test]
    async fn an_end_is_written_to_its_own_entry() {
        let audit = Audit::default();
        let (first, _) = audit.begin("pump", note("do0=on"), String::new()).await;
        let _ = audit.begin("oven", note("k1=on"), String::new()).await;
        audit.end(&first, "readback", String::new()).await;
        let ends: Vec<_> = audit.newest().iter().map(|entry| entry.end).collect();
        assert_eq!(ends, [Some("readback"), None]);
    }
}
