//! What was done, by whom, and with which result. The newest entries are kept in memory; if there
//! is a log on disk, all entries are in it, and nothing is sent before it is logged.

mod chain;
mod files;
mod log;
mod read;
mod tail;
mod waiting;

pub use chain::{AuditRecord, Numbered};
pub use log::{AuditLog, NotWritten};
pub use read::{
    Exported, Filter, LogPage, LogPosition, Logged, Verified, export_folder, verify_folder,
};
pub use tail::OpenReport;
pub use waiting::{Then, Waiting};

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

    /// The ID of an entry of this moment.
    pub fn next_id(&self, at: SystemTime) -> String {
        self.ulids.next(at)
    }

    /// Whether something may be done without a log.
    ///
    /// # Errors
    /// A log is required.
    pub fn without_log(&self) -> Result<(), NotWritten> {
        match self.missing.load(Ordering::Relaxed) {
            true => Err(NotWritten),
            false => Ok(()),
        }
    }

    /// Keeps in memory what is about to be done.
    pub fn begin(&self, entry: Entry) {
        let mut entries = self.entries();
        if entries.len() >= AUDIT_MAX {
            entries.pop_front();
        }
        entries.push_back(entry);
    }

    /// Keeps its result in memory.
    pub fn end(&self, id: &str, end: End) {
        if let Some(entry) = self.entries().iter_mut().rev().find(|entry| entry.id == id) {
            entry.end = Some(end);
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

    fn entry(audit: &Audit, module: &str) -> Entry {
        let at = SystemTime::now();
        Entry {
            id: audit.next_id(at),
            at,
            origin: Origin::program("test"),
            module: module.to_owned(),
            what: "do0=on".to_owned(),
            end: None,
        }
    }

    #[test]
    fn the_newest_are_kept() {
        let audit = Audit::default();
        for _ in 0..AUDIT_MAX + 5 {
            audit.begin(entry(&audit, "pump"));
        }
        assert_eq!(audit.newest().len(), AUDIT_MAX);
    }

    #[test]
    fn an_end_is_written_to_its_own_entry() {
        let audit = Audit::default();
        let first = entry(&audit, "pump");
        audit.begin(first.clone());
        audit.begin(entry(&audit, "oven"));
        audit.end(&first.id, End::Readback);
        let ends: Vec<_> = audit.newest().iter().map(|entry| entry.end).collect();
        assert_eq!(ends, [Some(End::Readback), None]);
    }
}
