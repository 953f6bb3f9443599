//! The log on disk. One thread writes it, makes all records that wait at the same time durable with
//! one sync, and calls those who wait for one of them. Nobody else ever waits for this thread: a
//! record that finds no room is lost, and counted.

use super::chain::AuditRecord;
use super::read::{Filter, LogPage, LogPosition, Verified};
use super::tail::{OpenReport, Reach, Tail};
use super::waiting::{Then, Waiting};
use super::{End, Entry, Exported, read};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// How many records may be queued. A command has two of them, and an output one command at a time
/// whose first record is not durable: a disk that works never lets it come to that many.
const QUEUE_MAX: usize = 4_096;
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
    /// Records that found no room in the queue, and are not counted in the log yet.
    lost: Arc<AtomicU64>,
}

struct Job {
    record: AuditRecord,
    /// It is waited for until it is durable, not only written.
    durable: bool,
    waiting: Waiting,
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
        let lost = Arc::new(AtomicU64::new(0));
        let shared = (Arc::clone(&reach), Arc::clone(&kept), Arc::clone(&lost));
        std::thread::Builder::new()
            .name("audit".to_owned())
            .spawn(move || work(tail, waiting, &shared.0, (&shared.1, &shared.2)))?;
        let log = AuditLog {
            folder: Arc::from(folder),
            jobs,
            reach,
            kept,
            required: Arc::default(),
            failing: Arc::default(),
            lost,
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

    /// How long a record may be waited for that is handed in now. Whoever hands one in sees to
    /// that, and calls [`Waiting::give_up`] then.
    #[must_use]
    pub fn patience(&self) -> Duration {
        match self.is_failing() && !self.is_required() {
            true => WAIT_FAILING,
            false => WAIT_MAX,
        }
    }

    /// Hands in the record of something that is about to be done, with the last known state; never
    /// waits. `then` is called by the log's thread when the record is durable, or could not be made
    /// so.
    #[must_use]
    pub fn begin(&self, entry: Entry, before: String, then: Then) -> Waiting {
        let record = AuditRecord::Begin {
            id: entry.id,
            who: entry.origin.who,
            via: entry.origin.via,
            module: entry.module,
            what: entry.what,
            before,
        };
        self.write(record, true, then)
    }

    /// The same for a result, and the state known after it. It is called when the log has the
    /// record, which survives the process then; it may not be synced yet.
    #[must_use]
    pub fn end(&self, id: &str, end: End, after: String, then: Then) -> Waiting {
        let record = AuditRecord::End {
            id: id.to_owned(),
            end: end.name().to_owned(),
            after,
        };
        self.write(record, false, then)
    }

    fn write(&self, record: AuditRecord, durable: bool, then: Then) -> Waiting {
        let waiting = Waiting::new(then);
        let job = Job {
            record,
            durable,
            waiting: waiting.clone(),
        };
        if self.jobs.try_send(job).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        waiting
    }

    /// Records a proper shutdown; everything written before is durable when this returns.
    pub async fn close(&self) {
        let (done, written) = oneshot::channel();
        let then = Box::new(|_| _ = done.send(()));
        let _waiting = self.write(AuditRecord::Stop, true, then);
        // If this can't be written it is missing: the next start reports that.
        let _ = tokio::time::timeout(WAIT_MAX, written).await;
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
fn work(
    mut tail: Tail,
    mut waiting: mpsc::Receiver<Job>,
    reach: &Mutex<Reach>,
    (kept, lost): (&AtomicU64, &AtomicU64),
) {
    while let Some(first) = waiting.blocking_recv() {
        let mut batch = vec![first];
        while batch.len() < BATCH_MAX
            && let Ok(next) = waiting.try_recv()
        {
            batch.push(next);
        }
        tail.turn(kept.load(Ordering::Relaxed));
        tail.has_lost(lost.swap(0, Ordering::Relaxed));
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
    // A record that was acknowledged must be readable.
    publish(tail);
    let tell = |job: Job, is_done: bool| job.waiting.end(is_done.then_some(()).ok_or(NotWritten));
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

#[cfg(test)]
mod tests {
    use super::super::Origin;
    use super::*;
    use std::path::PathBuf;
    use std::sync::mpsc;
    use std::time::SystemTime;

    fn opened(name: &str) -> (AuditLog, PathBuf) {
        let unique = format!("railbus-log-{name}-{}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        let _ = std::fs::remove_dir_all(&folder);
        (AuditLog::open(&folder).unwrap().0, folder)
    }

    fn entry(id: &str) -> Entry {
        Entry {
            id: id.to_owned(),
            at: SystemTime::now(),
            origin: Origin::program("test"),
            module: "oven".to_owned(),
            what: "k1=on".to_owned(),
            end: None,
        }
    }

    /// The head is written after the sync, and names the last record that is durable.
    #[test]
    fn a_beginning_is_durable_when_it_is_told() {
        let (log, folder) = opened("durable");
        let (told, ends) = mpsc::channel();
        let path = folder.clone();
        let then = move |written| {
            let read = |name: &str| std::fs::read_to_string(path.join(name)).unwrap();
            told.send((written, read("audit.log"), read("audit.head")))
                .unwrap();
        };
        let waiting = log.begin(entry("1"), String::new(), Box::new(then));
        let (written, lines, head) = ends.recv().unwrap();
        assert_eq!(written, Ok(()));
        let last = lines.lines().last().unwrap();
        assert!(last.contains("\"begin\""), "{last}");
        assert!(head.contains(last.split(' ').next().unwrap()), "{head}");
        while !waiting.is_over() {
            std::thread::yield_now();
        }
        let _ = std::fs::remove_dir_all(folder);
    }

    /// One that takes what is written and can't make it durable, and one that takes nothing.
    #[test]
    fn what_the_disk_refuses_is_not_told_as_done() {
        let folder = std::env::temp_dir().join(format!("railbus-log-no-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let (mut tail, _) = Tail::open(&folder).unwrap();
        let reach = Mutex::new(tail.reach.clone());
        let nowhere = Path::new("/dev/null");
        let unsynced = std::fs::File::options().write(true).open(nowhere);
        let read_only = std::fs::File::open(nowhere);
        for (file, ends_are_written) in [(unsynced, true), (read_only, false)] {
            tail.writes_to(file.unwrap());
            let (told, ends) = mpsc::channel();
            let job = |durable| {
                let told = told.clone();
                let then = move |end: Result<(), NotWritten>| told.send((durable, end)).unwrap();
                let (record, waiting) = (AuditRecord::Stop, Waiting::new(Box::new(then)));
                Job {
                    record,
                    durable,
                    waiting,
                }
            };
            commit(&mut tail, vec![job(true), job(false)], &reach);
            let written = ends_are_written.then_some(()).ok_or(NotWritten);
            let all: Vec<_> = ends.try_iter().collect();
            assert_eq!(all, [(false, written), (true, Err(NotWritten))]);
        }
        let _ = std::fs::remove_dir_all(folder);
    }

    #[test]
    fn what_finds_no_room_is_counted_and_nobody_waits_for_it() {
        let (log, folder) = opened("lost");
        let ((began, begins), (goes_on, waits)) = (mpsc::channel(), mpsc::channel::<()>());
        let then = move |_| {
            began.send(()).unwrap();
            let _ = waits.recv();
        };
        let _ = log.begin(entry("1"), String::new(), Box::new(then));
        begins.recv().unwrap();
        let (told, ends) = mpsc::channel();
        for _ in 0..QUEUE_MAX + 5 {
            let told = told.clone();
            let then = Box::new(move |_| told.send(()).unwrap());
            let _ = log.end("1", End::Reply, String::new(), then);
        }
        drop(goes_on);
        assert_eq!(ends.iter().take(QUEUE_MAX).count(), QUEUE_MAX);
        let lines = std::fs::read_to_string(folder.join("audit.log")).unwrap();
        let lost = lines
            .lines()
            .find(|line| line.contains("\"lost\""))
            .unwrap();
        assert!(lost.ends_with("\"records\":5}"), "{lost}");
        let _ = std::fs::remove_dir_all(folder);
    }
}
