//! What was done, by whom, and with which result. The newest entries are kept in memory; if there
//! is a log on disk, all entries are in it, and nothing is sent before it is logged.

mod chain;
mod files;
mod log;
mod read;
mod tail;

pub use chain::{AuditRecord, Numbered};
pub use log::{AuditLog, NotWritten};
pub use read::{
    Exported, Filter, LogPage, LogPosition, Logged, Verified, export_folder, verify_folder,
};
pub use tail::OpenReport;

use crate::ulid::Ulids;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::SystemTime;

/// How many entries are kept in memory.
pub const AUDIT_MAX: usize = 1_024;

/// Who requested something, and from where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The name of a user or of a part of the program: `li`, `pulse`, `rule:night`.
    pub who: String,
    /// How the request came in: `cli`, `http 192.168.1.7`, `socket`, `program`.
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

/// How something that was logged ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Done, and read back from the module.
    Readback,
    /// Done, by the module's reply.
    Reply,
    /// Sent in a form that gets no reply.
    Sent,
    /// Not done, or not known to be.
    Failed {
        /// The failure's name: `no_reply`, `refused`, `not_tried`.
        name: &'static str,
        /// The module may have acted.
        may_have_acted: bool,
    },
}

impl End {
    /// A failure after which the module may have acted.
    #[must_use]
    pub const fn unsure(name: &'static str) -> End {
        End::Failed {
            name,
            may_have_acted: true,
        }
    }

    /// A failure after which everything is as before.
    #[must_use]
    pub const fn not_done(name: &'static str) -> End {
        End::Failed {
            name,
            may_have_acted: false,
        }
    }

    /// Its name in the log, in events and in answers.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            End::Readback => "readback",
            End::Reply => "reply",
            End::Sent => "sent",
            End::Failed { name, .. } => name,
        }
    }

    /// Whether it was done, as far as can be known.
    #[must_use]
    pub const fn is_done(self) -> bool {
        match self {
            End::Readback | End::Reply | End::Sent => true,
            End::Failed { .. } => false,
        }
    }

    /// Whether the module may have acted.
    #[must_use]
    pub const fn may_have_acted(self) -> bool {
        match self {
            End::Readback | End::Reply | End::Sent => true,
            End::Failed { may_have_acted, .. } => may_have_acted,
        }
    }
}

/// What is logged before something is done.
#[derive(Clone, Debug)]
pub struct Note {
    /// Who requests it.
    pub origin: Origin,
    /// `do0=on do1=off`, `pulse k1 500ms`.
    pub what: String,
}

/// Something that was done, or tried.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its ID, a ULID: IDs sort by time.
    pub id: String,
    /// When it was requested.
    pub at: SystemTime,
    /// Who requested it.
    pub origin: Origin,
    /// The module.
    pub module: String,
    /// What was requested: `do0=on do1=off`, `pulse k1 500ms`.
    pub what: String,
    /// How it ended; `None` while it is in progress.
    pub end: Option<End>,
}

/// The newest entries, and the complete log.
#[derive(Debug, Default)]
pub struct Audit {
    entries: Mutex<VecDeque<Entry>>,
    ulids: Ulids,
    log: OnceLock<AuditLog>,
    /// A log is required, and there is none.
    missing: AtomicBool,
}

impl Audit {
    /// Writes everything to this log, too, from now on.
    pub fn keep(&self, log: AuditLog) {
        // A site has one log; the first one stays.
        let _ = self.log.set(log);
    }

    /// Refuses everything from now on, unless there is a log.
    pub fn miss(&self) {
        self.missing.store(true, Ordering::Relaxed);
    }

    /// The complete log, if there is one.
    pub fn log(&self) -> Option<&AuditLog> {
        self.log.get()
    }

    /// Records what is about to be done, with the last known state; returns the entry's ID. If
    /// there is a log, the record is durable when this returns.
    ///
    /// # Errors
    /// If it could not be made durable, or a log is required and there is none.
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
                let record = AuditRecord::Begin {
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

    /// Records the result, and the state known after it. The log has accepted it when this returns,
    /// though it may not be synced yet.
    pub async fn end(&self, id: &str, end: End, after: String) {
        if let Some(entry) = self.entries().iter_mut().rev().find(|entry| entry.id == id) {
            entry.end = Some(end);
        }
        if let Some(log) = self.log.get() {
            let record = AuditRecord::End {
                id: id.to_owned(),
                end: end.name().to_owned(),
                after,
            };
            // Losses are counted in the log itself.
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
        audit.end(&first, End::Readback, String::new()).await;
        let ends: Vec<_> = audit.newest().iter().map(|entry| entry.end).collect();
        assert_eq!(ends, [Some(End::Readback), None]);
    }
}
