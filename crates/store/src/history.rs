//! The past: the samples of all points and the events of a site, in a database. One thread writes
//! it, in one transaction per second; readers have their own connections. Whatever happens to the
//! disk, no command waits for it: what can't be stored is dropped and counted.

mod chart;
mod event;
mod prune;
mod read;
mod writer;

pub use chart::{BUCKETS_MAX, Bucket, Chart, Spread};
pub use event::{Ack, Event, EventKind, Severity};
pub use prune::Keep;
pub use read::{EventQuery, HistoryError, KeptEvents, PIECE_MAX, Storage, StoredEvent};

use crate::database::Schema;
use read::Readers;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::timeout;
use writer::{Job, Writer};

/// How many samples and events may be queued.
const QUEUE_MAX: usize = 16_384;
/// Timeout for a disk that hangs.
const WAIT_MAX: Duration = Duration::from_secs(2);
/// How many notices of the writer may be pending.
const NOTICES_MAX: usize = 32;

/// Migrations from one schema version to the next.
const MIGRATIONS: &[&str] = &[
    "CREATE TABLE meta (key TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;
     CREATE TABLE points (id INTEGER PRIMARY KEY, path TEXT NOT NULL UNIQUE);
     CREATE TABLE samples (
        point INTEGER NOT NULL,
        t INTEGER NOT NULL,
        v REAL,
        q INTEGER NOT NULL,
        PRIMARY KEY (point, t)
     ) WITHOUT ROWID;
     CREATE TABLE events (
        id TEXT PRIMARY KEY, t INTEGER NOT NULL, kind TEXT NOT NULL, severity TEXT NOT NULL,
        module TEXT, point TEXT, line TEXT, who TEXT, via TEXT, what TEXT, before TEXT,
        after TEXT, \"end\" TEXT, code TEXT, text TEXT,
        ack_who TEXT, ack_t INTEGER, ack_comment TEXT
     ) WITHOUT ROWID;
     CREATE INDEX events_of_module ON events (module, id);
     CREATE INDEX events_of_kind ON events (kind, id);",
];

const SCHEMA: Schema = Schema {
    migrations: MIGRATIONS,
    tables: &["meta", "points", "samples", "events"],
    is_durable: false,
};

/// The path of a folder's history.
fn file_of(folder: &Path) -> PathBuf {
    folder.join("history.db")
}

/// The quality of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SampleQuality {
    /// It was read.
    Good,
    /// It was read too long ago.
    Stale,
    /// No value is known.
    Bad,
}

impl SampleQuality {
    /// The name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            SampleQuality::Good => "good",
            SampleQuality::Stale => "stale",
            SampleQuality::Bad => "bad",
        }
    }

    const fn number(self) -> i64 {
        match self {
            SampleQuality::Good => 0,
            SampleQuality::Stale => 1,
            SampleQuality::Bad => 2,
        }
    }

    const fn of_number(number: i64) -> SampleQuality {
        match number {
            0 => SampleQuality::Good,
            1 => SampleQuality::Stale,
            _ => SampleQuality::Bad,
        }
    }
}

/// The value of a point from a time on, and its quality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Milliseconds since 1970.
    pub t: i64,
    /// The value; 0 and 1 for digital points. `None` if unknown.
    pub value: Option<f64>,
    /// Its quality.
    pub grade: SampleQuality,
}

/// A notice from the writer.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    /// Samples and events were dropped.
    dropped: AtomicU64,
    /// The disk is full.
    full: AtomicBool,
    /// The last transaction failed.
    failing: AtomicBool,
    /// How often the database was opened.
    generation: watch::Sender<u64>,
}

/// The history of a site. Clones are handles to the same one; it is closed by [`History::close`],
/// or when the last handle is dropped.
#[derive(Clone, Debug)]
pub struct History {
    jobs: SyncSender<Job>,
    counters: Arc<Counters>,
    readers: Arc<Readers>,
    /// The writer's notices, until they are taken.
    notices: Arc<Mutex<Option<mpsc::Receiver<Event>>>>,
}

impl History {
    /// Opens the history of a folder, or creates one. Problems are reported as events, and by
    /// [`History::storage`]; it is retried with every write.
    ///
    /// # Errors
    /// The system's error if it can't start a thread.
    pub fn open(folder: &Path, keep: Keep) -> std::io::Result<History> {
        let (jobs, waiting) = sync_channel(QUEUE_MAX);
        let (notify, notices) = mpsc::channel(NOTICES_MAX);
        let counters = Arc::new(Counters::default());
        let writer = Writer::new(folder, keep, Arc::clone(&counters), notify);
        std::thread::Builder::new()
            .name("history".to_owned())
            .spawn(move || writer.run(&waiting))?;
        Ok(History {
            jobs,
            readers: Arc::new(Readers::new(folder, Arc::clone(&counters))),
            counters,
            notices: Arc::new(Mutex::new(Some(notices))),
        })
    }

    /// Queues a sample of the point with this path; false if the queue is full.
    pub fn sample(&self, path: Arc<str>, sample: Sample) -> bool {
        self.give(Job::Sample(path, sample))
    }

    /// Queues an event, which already has its ID.
    pub fn event(&self, event: Event) {
        self.give(Job::Event(Box::new(event)));
    }

    /// Sets how much is kept from now on.
    pub fn keep(&self, keep: Keep) {
        self.give(Job::Keep(keep));
    }

    fn give(&self, job: Job) -> bool {
        let given = self.jobs.try_send(job).is_ok();
        if !given {
            self.counters.dropped.fetch_add(1, Ordering::Relaxed);
        }
        given
    }

    /// How often the database was opened: each new one needs the current values again.
    #[must_use]
    pub fn opened(&self) -> watch::Receiver<u64> {
        self.counters.generation.subscribe()
    }

    /// The writer's notices; for the first caller.
    #[must_use]
    pub fn notices(&self) -> Option<mpsc::Receiver<Event>> {
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        notices.take()
    }

    /// When this returns, everything queued so far is written, or has failed.
    async fn written(&self) {
        let (done, written) = oneshot::channel();
        if self.jobs.try_send(Job::Flush(done)).is_ok() {
            // If the writer has ended or hangs, only what is already stored is found.
            let _ = timeout(WAIT_MAX, written).await;
        }
    }

    /// Stores the acknowledgement of an event; false if there is no such event.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub async fn acknowledge(&self, id: &str, ack: Ack) -> Result<bool, HistoryError> {
        let (done, end) = oneshot::channel();
        let job = Job::Ack {
            id: id.to_owned(),
            ack,
            done,
        };
        self.jobs.try_send(job).map_err(|_| HistoryError::Busy)?;
        let end = timeout(WAIT_MAX, end)
            .await
            .map_err(|_| HistoryError::Busy)?;
        end.map_err(|_| HistoryError::Closed)?
    }

    /// Writes what is queued, and that nothing is known from now on.
    pub async fn close(&self) {
        let (done, closed) = oneshot::channel();
        if self.jobs.try_send(Job::Close(done)).is_ok() {
            // If the writer has ended already or hangs, there is nothing to wait for.
            let _ = timeout(WAIT_MAX, closed).await;
        }
    }

    /// How many samples and events were dropped.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.counters.dropped.load(Ordering::Relaxed)
    }
}

/// Milliseconds since 1970.
#[must_use]
pub fn millis(at: SystemTime) -> i64 {
    let since = at
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}
