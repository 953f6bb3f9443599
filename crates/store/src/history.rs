//! What was: the samples of all points and the events of a site, in a database of its own. One
//! thread writes it, in a transaction a second; those who read have connections of their own.
//! Whatever becomes of the disk, nobody waits for it who has something to switch: what can't be
//! kept is dropped and counted.

mod chart;
mod db;
mod event;
mod prune;
mod read;
mod writer;

pub use chart::{BUCKETS_MAX, Bucket, Chart, Spread};
pub use event::{Ack, Event, EventKind, Severity};
pub use prune::Keep;
pub use read::{Asked, HistoryError, Kept, KeptEvents, PIECE_MAX, Storage};

use read::Readers;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};
use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;
use writer::{Job, Writer};

/// How many samples and events wait to be written.
const QUEUE_MAX: usize = 16_384;
/// Nobody waits longer for a disk that hangs.
const WAIT_MAX: Duration = Duration::from_secs(2);
/// How many notices of the writer wait to be told.
const NOTICES_MAX: usize = 32;

/// How good a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// It was read.
    Good,
    /// It was read too long ago.
    Stale,
    /// Nothing is known any more.
    Bad,
}

impl Grade {
    /// The name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Grade::Good => "good",
            Grade::Stale => "stale",
            Grade::Bad => "bad",
        }
    }

    const fn number(self) -> i64 {
        match self {
            Grade::Good => 0,
            Grade::Stale => 1,
            Grade::Bad => 2,
        }
    }

    const fn of_number(number: i64) -> Grade {
        match number {
            0 => Grade::Good,
            1 => Grade::Stale,
            _ => Grade::Bad,
        }
    }
}

/// From when on a point had which value, and how good that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Milliseconds since 1970.
    pub t: i64,
    /// The value; 0 and 1 for digital points. None where nothing is known.
    pub value: Option<f64>,
    /// How good it is.
    pub grade: Grade,
}

/// What the writer tells of itself.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    /// Samples and events that were not kept.
    dropped: AtomicU64,
    /// The disk is full.
    full: AtomicBool,
    /// The last transaction failed.
    failing: AtomicBool,
    /// How often the database was opened.
    generation: AtomicU64,
}

/// The history of a site. Clones are handles of the same one; it is closed by
/// [`History::close`], or when the last handle has gone.
#[derive(Clone, Debug)]
pub struct History {
    jobs: SyncSender<Job>,
    counters: Arc<Counters>,
    readers: Arc<Readers>,
    /// What the writer has to say, until somebody listens.
    notices: Arc<Mutex<Option<mpsc::Receiver<Event>>>>,
}

impl History {
    /// Opens the history of a folder, or begins one. What is wrong with it is told as events, and
    /// by [`History::storage`]; it is tried again with whatever comes.
    ///
    /// # Errors
    /// What the system says where it has no thread to spare.
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

    /// Keeps a sample of the point with this path; false where there is no room for it.
    pub fn sample(&self, path: Arc<str>, sample: Sample) -> bool {
        self.give(Job::Sample(path, sample))
    }

    /// Keeps an event, which has its number already.
    pub fn event(&self, event: Event) {
        self.give(Job::Event(Box::new(event)));
    }

    /// Keeps so much from now on.
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

    /// How often the database was opened: what was in force must be told to each anew.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.counters.generation.load(Ordering::Relaxed)
    }

    /// What the writer has to tell; for the first who asks.
    #[must_use]
    pub fn notices(&self) -> Option<mpsc::Receiver<Event>> {
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        notices.take()
    }

    /// Everything given so far is written when this returns, or could not be.
    async fn written(&self) {
        let (done, written) = oneshot::channel();
        if self.jobs.try_send(Job::Flush(done)).is_ok() {
            // Where the writer has ended or hangs, what is there is told.
            let _ = timeout(WAIT_MAX, written).await;
        }
    }

    /// Writes that somebody has seen an event; false where there is no such event.
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

    /// Writes what is left, and that nothing is known from now on.
    pub async fn close(&self) {
        let (done, closed) = oneshot::channel();
        if self.jobs.try_send(Job::Close(done)).is_ok() {
            // Where the writer has ended already or hangs, there is nothing to wait for.
            let _ = timeout(WAIT_MAX, closed).await;
        }
    }

    /// How many samples and events were not kept.
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
