//! Decides whether and when anything is written.

use crate::budget::Budget;
use crate::{Bytes, Record, Unreadable};
use railbus_wire::{Instant, Micros};

/// Stores a few bytes over a loss of power: those written last, or, if the power failed during the
/// write, those from before it.
pub trait Store {
    /// The error of the chip or its bus.
    type Error;

    /// Reads the stored bytes, if there are any, into `room` and returns that part of it.
    ///
    /// # Errors
    /// If the chip can't be read.
    fn read<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, Self::Error>;

    /// Replaces the stored bytes by these, 1 to 119.
    ///
    /// # Errors
    /// If the chip can't be read or written; it then holds the old or the new bytes.
    fn write(&mut self, bytes: &[u8]) -> Result<(), Self::Error>;
}

/// How long to wait after a failed write.
pub const RETRY: Micros = Micros::from_secs(1);

/// The content of a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// Nothing, or nothing written by any firmware: the module is in its factory state.
    Nothing,
    /// This record.
    Record(Record),
    /// A module of a family whose device side is not built here. It is overwritten.
    OtherFamily,
    /// A record of a newer firmware, with this version of the layout. It is neither used nor
    /// overwritten; to use the older firmware, erase the chip.
    Newer(u8),
}

/// Counts of what happened to records to be saved. They saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Written, and verified by reading back.
    pub written: u16,
    /// Already stored; nothing was written.
    pub unchanged: u16,
    /// Could not be written at once: there were too many writes before it, or the chip failed.
    pub deferred: u16,
    /// The chip failed, or did not hold what was written. It is retried.
    pub failed: u16,
    /// Not written, because the settings of a newer firmware are stored.
    pub refused: u16,
}

/// A record as bytes: half the size of a [`Record`], and compared as quickly.
type Packed = [u8; Record::LEN];

/// What is known of the content of the store.
#[derive(Clone, Copy, Debug)]
enum Known {
    /// Anything else than what is to be saved.
    Other,
    /// These bytes.
    Packed(Packed),
    /// A record of a newer firmware.
    Newer,
}

impl Known {
    fn of(bytes: Option<&[u8]>) -> Known {
        let Some(bytes) = bytes else {
            return Known::Other;
        };
        match bytes.try_into() {
            _ if Record::is_newer(bytes) => Known::Newer,
            Ok(packed) => Known::Packed(packed),
            Err(_) => Known::Other,
        }
    }
}

/// Saves the settings of one module.
#[derive(Clone, Debug)]
pub struct SettingsStore<S> {
    store: S,
    budget: Budget,
    /// The known content of the store.
    held: Option<Known>,
    /// What is still to be written.
    wanted: Option<Packed>,
    /// Not to be written before this moment.
    due: Instant,
    counters: Counters,
}

impl<S> SettingsStore<S> {
    /// A keeper for a module that is powered up now.
    pub const fn new(store: S) -> SettingsStore<S> {
        SettingsStore {
            store,
            budget: Budget::new(),
            held: None,
            wanted: None,
            due: Instant(0),
            counters: Counters {
                written: 0,
                unchanged: 0,
                deferred: 0,
                failed: 0,
                refused: 0,
            },
        }
    }

    /// What happened to everything that was to be saved.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Whether a loss of power now would bring back settings that are no longer active.
    pub const fn is_waiting(&self) -> bool {
        self.wanted.is_some()
    }

    /// The store.
    pub fn into_inner(self) -> S {
        self.store
    }
}

impl<S: Store> SettingsStore<S> {
    /// Reads the store.
    ///
    /// # Errors
    /// If the chip can't be read: its content is then unknown.
    pub fn load(&mut self) -> Result<Held, S::Error> {
        let mut room = Bytes::new();
        Ok(match self.look(&mut room)?.map(Record::decode) {
            Some(Ok(record)) => Held::Record(record),
            Some(Err(Unreadable::Newer(version))) => Held::Newer(version),
            Some(Err(Unreadable::OtherFamily)) => Held::OtherFamily,
            Some(Err(Unreadable::Malformed)) | None => Held::Nothing,
        })
    }

    /// Saves this record: at once if that is allowed, otherwise as soon as [`SettingsStore::poll`]
    /// is called when it is. Replaces a record that was still waiting.
    pub fn save(&mut self, now: Instant, record: &Record) {
        self.wanted = Some(record.encode());
        if self.poll(now).is_some() {
            count(&mut self.counters.deferred);
        }
    }

    /// Writes the waiting record if its time has come; returns when to call again.
    pub fn poll(&mut self, now: Instant) -> Option<Instant> {
        if self.is_held() {
            self.end(|counters| &mut counters.unchanged);
        } else if self.is_waiting() && self.due <= now {
            self.attempt(now);
        }
        self.is_waiting().then_some(self.due)
    }

    /// Reads the stored bytes into `room`, and remembers them.
    fn look<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, S::Error> {
        let bytes = self.store.read(room)?;
        self.held = Some(Known::of(bytes));
        Ok(bytes)
    }

    /// Whether the record to be saved is known to be stored already.
    fn is_held(&self) -> bool {
        matches!(
            (&self.held, &self.wanted),
            (Some(Known::Packed(held)), Some(wanted)) if held == wanted
        )
    }

    fn attempt(&mut self, now: Instant) {
        if self.held.is_none() && self.look(&mut Bytes::new()).is_err() {
            self.fail(now);
        } else if self.is_held() {
            self.end(|counters| &mut counters.unchanged);
        } else if matches!(self.held, Some(Known::Newer)) {
            self.end(|counters| &mut counters.refused);
        } else {
            self.write(now);
        }
    }

    fn write(&mut self, now: Instant) {
        if let Err(later) = self.budget.take(now) {
            self.due = later;
            return;
        }
        // Until it is read back, the content is unknown.
        self.held = None;
        let bytes = self.wanted.as_ref().map_or(&[][..], |wanted| wanted);
        let written = self.store.write(bytes);
        let read = written.and_then(|()| self.look(&mut Bytes::new()).map(drop));
        if read.is_ok() && self.is_held() {
            self.end(|counters| &mut counters.written);
        } else {
            self.fail(now);
        }
    }

    /// Nothing is waiting any more; counts how it ended.
    fn end(&mut self, how: fn(&mut Counters) -> &mut u16) {
        self.wanted = None;
        count(how(&mut self.counters));
    }

    fn fail(&mut self, now: Instant) {
        self.due = now + RETRY;
        count(&mut self.counters.failed);
    }
}

const fn count(counter: &mut u16) {
    *counter = counter.saturating_add(1);
}
