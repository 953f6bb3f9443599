//! What was done, lately. Kept in memory and bounded: an answer can name its entry, and the
//! newest can be looked at. A log that outlives the process, with who did it and with a chain
//! of hashes, comes with accounts.

use std::collections::VecDeque;
use std::hash::{BuildHasher, RandomState};
use std::time::{Duration, SystemTime};

/// How many entries are kept.
pub const AUDIT_MAX: usize = 1_024;

/// Crockford's digits, which leave out what looks like another one.
const DIGITS: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";

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
pub(crate) struct Note {
    pub(crate) origin: Origin,
    /// `do0=on do1=off`, `pulse k1 500ms`.
    pub(crate) what: String,
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

/// The newest entries.
#[derive(Debug)]
pub(crate) struct Audit {
    entries: VecDeque<Entry>,
    random: RandomState,
    count: u16,
}

impl Audit {
    pub(crate) fn new() -> Audit {
        Audit {
            entries: VecDeque::with_capacity(AUDIT_MAX),
            random: RandomState::new(),
            count: 0,
        }
    }

    /// Writes down what is about to be done; gives back its number.
    pub(crate) fn begin(&mut self, module: &str, note: Note) -> String {
        let at = SystemTime::now();
        let id = self.number(at);
        if self.entries.len() >= AUDIT_MAX {
            self.entries.pop_front();
        }
        self.entries.push_back(Entry {
            id: id.clone(),
            at,
            origin: note.origin,
            module: module.to_owned(),
            what: note.what,
            end: None,
        });
        id
    }

    /// Writes down how it ended.
    pub(crate) fn end(&mut self, id: &str, end: &'static str) {
        if let Some(entry) = self.entries.iter_mut().rev().find(|entry| entry.id == id) {
            entry.end = Some(end);
        }
    }

    /// The entries, oldest first.
    pub(crate) fn entries(&self) -> Vec<Entry> {
        self.entries.iter().cloned().collect()
    }

    /// 48 bits of milliseconds, 16 bits that count up, 64 bits of chance.
    fn number(&mut self, at: SystemTime) -> String {
        let since = at.duration_since(SystemTime::UNIX_EPOCH);
        let since = since.unwrap_or(Duration::ZERO);
        self.count = self.count.wrapping_add(1);
        let chance = self.random.hash_one((since, self.count));
        let number = (since.as_millis() & 0xFFFF_FFFF_FFFF) << 80
            | u128::from(self.count) << 64
            | u128::from(chance);
        let digit = |place: u32| DIGITS[(number >> (place * 5) & 31) as usize] as char;
        (0..26).rev().map(digit).collect()
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

    #[test]
    fn numbers_differ_and_sort() {
        let mut audit = Audit::new();
        let ids: Vec<String> = (0..2_000).map(|_| audit.begin("pump", note(""))).collect();
        assert!(ids.iter().all(|id| id.len() == 26));
        assert!(ids.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(audit.entries().len(), AUDIT_MAX);
    }

    #[test]
    fn an_end_is_written_to_its_own_entry() {
        let mut audit = Audit::new();
        let first = audit.begin("pump", note("do0=on"));
        audit.begin("oven", note("k1=on"));
        audit.end(&first, "readback");
        let ends: Vec<_> = audit.entries().iter().map(|entry| entry.end).collect();
        assert_eq!(ends, [Some("readback"), None]);
    }
}
