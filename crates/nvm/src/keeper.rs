//! The one who decides whether anything is written at all.

use crate::budget::Budget;
use crate::{Bytes, Record, Unreadable};
use railbus_wire::{Instant, Micros};

/// Something that holds a few bytes over a loss of power: what was written last, or, where the
/// power failed meanwhile, what was before it.
pub trait Store {
    /// What the chip or its bus can fail with.
    type Error;

    /// The bytes that are held, where there are any. The store reads them into `room`, and hands
    /// out that part of it.
    ///
    /// # Errors
    /// Where the chip can't be read.
    fn read<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, Self::Error>;

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
    /// A module of a family whose own half is not built here. It is overwritten.
    OtherFamily,
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

/// A record as bytes: half of what it takes as a [`Record`], and compared as quickly.
type Packed = [u8; Record::LEN];

/// What a keeper knows of what its store holds.
#[derive(Clone, Copy, Debug)]
enum Known {
    /// Nothing that could be what is to be kept.
    Other,
    /// These bytes.
    Packed(Packed),
    /// What a newer firmware wrote.
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

/// Keeps the settings of one module.
#[derive(Clone, Debug)]
pub struct Keeper<S> {
    store: S,
    budget: Budget,
    /// What the store is known to hold.
    held: Option<Known>,
    /// What it does not hold yet.
    wanted: Option<Packed>,
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
        let mut room = Bytes::new();
        Ok(match self.look(&mut room)?.map(Record::decode) {
            Some(Ok(record)) => Held::Record(record),
            Some(Err(Unreadable::Newer(version))) => Held::Newer(version),
            Some(Err(Unreadable::OtherFamily)) => Held::OtherFamily,
            Some(Err(Unreadable::Malformed)) | None => Held::Nothing,
        })
    }

    /// Keeps this: at once where that may be, else as soon as [`Keeper::poll`] is asked when it
    /// may. What was still waiting is forgotten.
    pub fn save(&mut self, now: Instant, record: &Record) {
        self.wanted = Some(record.encode());
        if self.poll(now).is_some() {
            count(&mut self.counters.deferred);
        }
    }

    /// Writes what is waiting, where its time has come; when to ask again.
    pub fn poll(&mut self, now: Instant) -> Option<Instant> {
        if self.is_held() {
            self.end(|counters| &mut counters.unchanged);
        } else if self.is_waiting() && self.due <= now {
            self.attempt(now);
        }
        self.is_waiting().then_some(self.due)
    }

    /// The bytes that are held, in their room; they are known from now on.
    fn look<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, S::Error> {
        let bytes = self.store.read(room)?;
        self.held = Some(Known::of(bytes));
        Ok(bytes)
    }

    /// Whether what is to be kept is known to be held already.
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
        // Until it is read back, nobody knows what is held.
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
