//! The log on the disk. One thread writes it; whoever is about to switch something waits until
//! its record is durable, and those who wait at the same time wait for one commit together.

use super::chain::Record;
use super::read::{Filter, Page, Place, Verified};
use super::tail::{Found, Reach, Tail};
use super::{Exported, read};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// How many records wait to be written.
const QUEUE_MAX: usize = 1_024;
/// How many are written in one go.
const BATCH_MAX: usize = 256;
/// A disk that takes longer holds no command up any more.
const WAIT_MAX: Duration = Duration::from_secs(1);

/// The same once that has happened: until it is over, nobody waits long.
const WAIT_FAILING: Duration = Duration::from_millis(20);

/// A record could not be made durable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotWritten;

/// The log on the disk: append-only lines, each with the hash of the one before it.
#[derive(Clone, Debug)]
pub struct AuditLog {
    folder: Arc<Path>,
    jobs: mpsc::Sender<Job>,
    reach: Arc<Mutex<Reach>>,
    /// So many bytes are kept.
    kept: Arc<AtomicU64>,
    required: Arc<AtomicBool>,
    failing: Arc<AtomicBool>,
}

struct Job {
    record: Record,
    /// Who waits wants it durable, and not only written.
    durable: bool,
    done: oneshot::Sender<bool>,
}

impl AuditLog {
    /// Opens the log of a folder. What was under way when it was last closed gets `unknown` as
    /// its end, and a log that is broken is put aside.
    ///
    /// # Errors
    /// What the system says; `WouldBlock` where another program has it.
    pub fn open(folder: &Path) -> std::io::Result<(AuditLog, Found)> {
        let (tail, found) = Tail::open(folder)?;
        let reach = Arc::new(Mutex::new(tail.reach.clone()));
        let kept = Arc::new(AtomicU64::new(u64::MAX));
        let (jobs, waiting) = mpsc::channel(QUEUE_MAX);
        let shared = (Arc::clone(&reach), Arc::clone(&kept));
        std::thread::Builder::new()
            .name("audit".to_owned())
            .spawn(move || work(tail, waiting, &shared.0, &shared.1))?;
        let log = AuditLog {
            folder: Arc::from(folder),
            jobs,
            reach,
            kept,
            required: Arc::default(),
            failing: Arc::default(),
        };
        Ok((log, found))
    }

    /// Keeps so many bytes, or all there ever are. What is too old goes once the newest file is
    /// full.
    pub fn keep(&self, bytes: Option<u64>) {
        let bytes = bytes.unwrap_or(u64::MAX);
        self.kept.store(bytes, Ordering::Relaxed);
    }

    /// Whether nothing may be switched that can't be written down; else it is switched all the
    /// same.
    pub fn require(&self, required: bool) {
        self.required.store(required, Ordering::Relaxed);
    }

    /// Whether nothing may be switched that can't be written down.
    #[must_use]
    pub fn is_required(&self) -> bool {
        self.required.load(Ordering::Relaxed)
    }

    /// Remembers whether writing works; gives back whether that is news.
    pub fn works(&self, works: bool) -> bool {
        self.failing.swap(!works, Ordering::Relaxed) == works
    }

    /// Whether the last record could not be written.
    #[must_use]
    pub fn is_failing(&self) -> bool {
        self.failing.load(Ordering::Relaxed)
    }

    /// Writes a record; returns when it is durable, or at least written.
    pub(super) async fn write(&self, record: Record, durable: bool) -> Result<(), NotWritten> {
        let (done, written) = oneshot::channel();
        let job = Job {
            record,
            durable,
            done,
        };
        let patience = match self.is_failing() && !self.is_required() {
            true => WAIT_FAILING,
            false => WAIT_MAX,
        };
        let end = tokio::time::timeout(patience, async {
            self.jobs.send(job).await.map_err(|_| NotWritten)?;
            written.await.map_err(|_| NotWritten)
        });
        match end.await {
            Ok(Ok(true)) => Ok(()),
            _ => Err(NotWritten),
        }
    }

    /// Writes that the program ends as it should; all that was written before is durable when
    /// this returns.
    pub async fn close(&self) {
        // What can't be written now is missing: the next start says so.
        let _ = self.write(Record::Stop, true).await;
    }

    fn reach(&self) -> Reach {
        let reach = self.reach.lock().unwrap_or_else(PoisonError::into_inner);
        reach.clone()
    }

    /// Entries, the newest first, before a place that an earlier page told.
    ///
    /// # Errors
    /// What the system says.
    pub async fn page(
        &self,
        before: Option<Place>,
        limit: usize,
        filter: Filter,
    ) -> std::io::Result<Page> {
        let (folder, reach) = (Arc::clone(&self.folder), self.reach());
        aside(move || read::page(&folder, before, &reach, limit, &filter)).await
    }

    /// Goes along the whole chain.
    ///
    /// # Errors
    /// What the system says.
    pub async fn verify(&self) -> std::io::Result<Verified> {
        let (folder, reach) = (Arc::clone(&self.folder), self.reach());
        aside(move || read::verify(&folder, &reach)).await
    }

    /// The records from a place on, or from the oldest that is kept, as many as go into one
    /// piece; none at the end.
    ///
    /// # Errors
    /// What the system says; `NotFound` where the place is not kept any more.
    pub async fn export(&self, from: Option<Place>) -> std::io::Result<Exported> {
        let (folder, reach) = (Arc::clone(&self.folder), self.reach());
        aside(move || read::export(&folder, from, &reach)).await
    }
}

/// Does something that waits for the disk where it holds nothing up.
async fn aside<T: Send + 'static>(
    work: impl FnOnce() -> std::io::Result<T> + Send + 'static,
) -> std::io::Result<T> {
    let end = tokio::task::spawn_blocking(work).await;
    end.unwrap_or_else(|error| Err(std::io::Error::other(error)))
}

/// Writes what comes until nobody is left who could send something.
fn work(mut tail: Tail, mut waiting: mpsc::Receiver<Job>, reach: &Mutex<Reach>, kept: &AtomicU64) {
    while let Some(first) = waiting.blocking_recv() {
        let mut batch = vec![first];
        while batch.len() < BATCH_MAX
            && let Ok(next) = waiting.try_recv()
        {
            batch.push(next);
        }
        tail.turn(kept.load(Ordering::Relaxed));
        commit(&mut tail, batch, reach);
    }
}

fn commit(tail: &mut Tail, batch: Vec<Job>, reach: &Mutex<Reach>) {
    let publish = |tail: &Tail| {
        *reach.lock().unwrap_or_else(PoisonError::into_inner) = tail.reach.clone();
    };
    let before = tail.reach.clone();
    let records = batch.iter().map(|job| job.record.clone());
    let written = tail.append(records).is_ok();
    // Who is told that something is written can read it.
    publish(tail);
    // Fails where nobody waits any more.
    let tell = |job: Job, done| {
        let _ = job.done.send(done);
    };
    let mut durable = Vec::new();
    for job in batch {
        if job.durable {
            durable.push(job);
        } else {
            tell(job, written);
        }
    }
    let synced = written && tail.sync().is_ok();
    if written && !synced {
        tail.back_to(before);
        publish(tail);
    }
    for job in durable {
        tell(job, synced);
    }
}
