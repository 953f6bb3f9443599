//! The one who decides whether anything is written at all.

use crate::budget::Budget;
use crate::{Bytes, Record, Unreadable};
use railbus_wire::{Instant, Micros};

/// Something that holds a few bytes over a loss of power: what was written last, or, where the
/// power failed meanwhile, what was before it.
pub trait Store {
    /// What the chip or its bus can fail with.
    type Error;

    /// The bytes that are held, where there are any.
    ///
    /// # Errors
    /// Where the chip can't be read.
    fn read(&mut self) -> Result<Option<Bytes>, Self::Error>;

    /// Holds these bytes, 1 to 119, instead.
    ///
    /// # Errors
    /// Where the chip can't be read or written; it then holds the old or the new bytes.
    fn write(&mut self, bytes: &[u8]) -> Result<(), Self::Error>;
}

/// How long to wait after a write that failed.
pub const RETRY: Micros = Micros::from_secs(1);

/// What a store holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// Nothing, or nothing that any firmware wrote: the module is as it left the factory.
    Nothing,
    /// This.
    Record(Record),
    /// What a newer firmware wrote, in a layout of this version. It is neither used nor
    /// overwritten; who wants the older firmware to keep anything erases the chip.
    Newer(u8),
}

/// What became of what was to be kept. Each stays at its highest number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Written, and read back as written.
    pub written: u16,
    /// Was held already; nothing was written.
    pub unchanged: u16,
    /// Could not be written at once: there were too many before it, or the chip failed.
    pub deferred: u16,
    /// The chip failed, or did not hold what was written. It is tried again.
    pub failed: u16,
    /// Not written, as a newer firmware's settings lie there.
    pub refused: u16,
}

/// Keeps the settings of one module.
#[derive(Clone, Debug)]
pub struct Keeper<S> {
    store: S,
    budget: Budget,
    /// What the store is known to hold.
    held: Option<Held>,
    /// What it does not hold yet.
    wanted: Option<Record>,
    /// Not before then.
    due: Instant,
    counters: Counters,
}

impl<S> Keeper<S> {
    /// A keeper of a module that is powered up now.
    pub const fn new(store: S) -> Keeper<S> {
        Keeper {
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

    /// What became of everything that was to be kept.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Whether a loss of power now would bring back settings that are not in force any more.
    pub const fn is_waiting(&self) -> bool {
        self.wanted.is_some()
    }

    /// The store.
    pub fn into_inner(self) -> S {
        self.store
    }
}

impl<S: Store> Keeper<S> {
    /// What is held.
    ///
    /// # Errors
    /// Where the chip can't be read: what it holds is not known then.
    pub fn load(&mut self) -> Result<Held, S::Error> {
        let bytes = self.store.read()?;
        let held = match bytes.map(|bytes| Record::decode(bytes.bytes())) {
            Some(Ok(record)) => Held::Record(record),
            Some(Err(Unreadable::Newer(version))) => Held::Newer(version),
            Some(Err(Unreadable::Malformed)) | None => Held::Nothing,
        };
        self.held = Some(held);
        Ok(held)
    }

    /// Keeps this: at once where that may be, else as soon as [`Keeper::poll`] is asked when it
    /// may. What was still waiting is forgotten.
    pub fn save(&mut self, now: Instant, record: Record) {
        self.wanted = Some(record);
        if self.poll(now).is_some() {
            count(&mut self.counters.deferred);
        }
    }

    /// Writes what is waiting, where its time has come; when to ask again.
    pub fn poll(&mut self, now: Instant) -> Option<Instant> {
        let record = self.wanted?;
        if self.held == Some(Held::Record(record)) {
            self.end(|counters| &mut counters.unchanged);
        } else if self.due <= now {
            self.attempt(now, record);
        }
        self.wanted.map(|_| self.due)
    }

    fn attempt(&mut self, now: Instant, record: Record) {
        let held = match self.held {
            Some(held) => Ok(held),
            None => self.load(),
        };
        match held {
            Ok(Held::Record(held)) if held == record => {
                self.end(|counters| &mut counters.unchanged);
            }
            Ok(Held::Newer(_)) => self.end(|counters| &mut counters.refused),
            Ok(_) => self.write(now, record),
            Err(_) => self.fail(now),
        }
    }

    fn write(&mut self, now: Instant, record: Record) {
        if let Err(later) = self.budget.take(now) {
            self.due = later;
            return;
        }
        // Until it is read back, nobody knows what is held.
        self.held = None;
        let written = self.store.write(record.encode().bytes());
        let held = written.and_then(|()| self.load());
        if held.is_ok_and(|held| held == Held::Record(record)) {
            self.end(|counters| &mut counters.written);
        } else {
            self.fail(now);
        }
    }

    /// Nothing waits any more, and this is how it ended.
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
