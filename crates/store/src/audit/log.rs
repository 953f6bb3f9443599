//! The log on disk. One thread writes it; a command waits until its record is durable, and all that
//! wait at the same time share one commit.

use super::chain::AuditRecord;
use super::read::{Filter, LogPage, LogPosition, Verified};
use super::tail::{OpenReport, Reach, Tail};
use super::{Exported, read};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// How many records may be queued.
const QUEUE_MAX: usize = 1_024;
/// How many are written at once.
const BATCH_MAX: usize = 256;
/// Timeout after which a slow disk no longer delays a command.
const WAIT_MAX: Duration = Duration::from_secs(1);

/// The timeout once that has happened, until the disk has recovered.
const WAIT_FAILING: Duration = Duration::from_millis(20);

/// A record could not be made durable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotWritten;

/// The log on disk: append-only lines, each with the hash of the one before it.
#[derive(Clone, Debug)]
pub struct AuditLog {
    folder: Arc<Path>,
    jobs: mpsc::Sender<Job>,
    reach: Arc<Mutex<Reach>>,
    /// Number of bytes to keep.
    kept: Arc<AtomicU64>,
    required: Arc<AtomicBool>,
    failing: Arc<AtomicBool>,
}

struct Job {
    record: AuditRecord,
    /// The caller waits until it is durable, not only written.
    durable: bool,
    done: oneshot::Sender<bool>,
}

impl AuditLog {
    /// Opens the log of a folder. Entries that were open when it was last closed get the result
    /// `unknown`, and a broken log is moved aside.
    ///
    /// # Errors
    /// The system's error; `WouldBlock` if another program has it open.
    pub fn open(folder: &Path) -> std::io::Result<(AuditLog, OpenReport)> {
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

    /// Keeps this many bytes, or everything. What is too old is deleted once the newest file is
    /// full.
    pub fn keep(&self, bytes: Option<u64>) {
        let bytes = bytes.unwrap_or(u64::MAX);
        self.kept.store(bytes, Ordering::Relaxed);
    }

    /// Whether commands that can't be logged are refused; otherwise they are carried out
    /// nevertheless.
    pub fn require(&self, required: bool) {
        self.required.store(required, Ordering::Relaxed);
    }

    /// Whether commands that can't be logged are refused.
    #[must_use]
    pub fn is_required(&self) -> bool {
        self.required.load(Ordering::Relaxed)
    }

    /// Stores whether writing works; returns whether that has changed.
    pub fn works(&self, works: bool) -> bool {
        self.failing.swap(!works, Ordering::Relaxed) == works
    }

    /// Whether the last record could not be written.
    #[must_use]
    pub fn is_failing(&self) -> bool {
        self.failing.load(Ordering::Relaxed)
    }

    /// Writes a record; returns when it is durable, or at least written.
    pub(super) async fn write(&self, record: AuditRecord, durable: bool) -> Result<(), NotWritten> {
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

    /// Records a proper shutdown; everything written before is durable when this returns.
    pub async fn close(&self) {
        // If this can't be written it is missing: the next start reports that.
        let _ = self.write(AuditRecord::Stop, true).await;
    }

    fn reach(&self) -> Reach {
        let reach = self.reach.lock().unwrap_or_else(PoisonError::into_inner);
        reach.clone()
    }

    /// Entries, newest first, before a position returned with an earlier page.
    ///
    /// # Errors
    /// The system's error.
    pub async fn page(
        &self,
        before: Option<LogPosition>,
        limit: usize,
        filter: Filter,
    ) -> std::io::Result<LogPage> {
        let (folder, reach) = (Arc::clone(&self.folder), self.reach());
        aside(move || read::page(&folder, before, &reach, limit, &filter)).await
    }

    /// Verifies the whole chain.
    ///
    /// # Errors
    /// The system's error.
    pub async fn verify(&self) -> std::io::Result<Verified> {
        let (folder, reach) = (Arc::clone(&self.folder), self.reach());
        aside(move || read::verify(&folder, &reach)).await
    }

    /// The records from a position on, or from the oldest one kept, as many as fit into one piece;
    /// none at the end.
    ///
    /// # Errors
    /// The system's error; `NotFound` if the position is no longer kept.
    pub async fn export(&self, from: Option<LogPosition>) -> std::io::Result<Exported> {
        let (folder, reach) = (Arc::clone(&self.folder), self.reach());
        aside(move || read::export(&folder, from, &reach)).await
    }
}

/// Runs something that waits for the disk on a thread where it blocks nothing.
async fn aside<T: Send + 'static>(
    work: impl FnOnce() -> std::io::Result<T> + Send + 'static,
) -> std::io::Result<T> {
    let end = tokio::task::spawn_blocking(work).await;
    end.unwrap_or_else(|error| Err(std::io::Error::other(error)))
}

/// Writes incoming records until all senders are gone.
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
    // A caller that is told about a record must be able to read it.
    publish(tail);
    // Fails if the caller has stopped waiting.
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
