//! The one thread that writes the database.

use super::{Ack, Counters, Event, EventKind, HistoryError, Keep, Sample, SampleQuality, Severity};
use super::{SCHEMA, file_of, millis, prune};
use crate::database::{self, DbFault, checkpoint, trouble};
use rusqlite::{Connection, Transaction, params};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime};
use tokio::sync::{mpsc, oneshot};

/// Maximum time that a sample waits for its transaction.
const FLUSH: Duration = Duration::from_secs(1);
/// Maximum number written in one transaction.
const BATCH_MAX: usize = 8_192;
/// Interval of checkpoints, of enforcing the limits, and of recording that all is well.
const TIDY: Duration = Duration::from_secs(60);
/// The same if there is more to delete than was deleted in one go.
const TIDY_MORE: Duration = Duration::from_secs(2);
/// How many point IDs are cached.
const POINTS_MAX: usize = 65_536;

pub(super) enum Job {
    Sample(Arc<str>, Sample),
    Event(Box<Event>),
    Ack {
        id: String,
        ack: Ack,
        done: oneshot::Sender<Result<bool, HistoryError>>,
    },
    Flush(oneshot::Sender<()>),
    Keep(Keep),
    Close(oneshot::Sender<()>),
}

/// Queued for the next transaction.
#[derive(Default)]
struct Batch {
    samples: Vec<(Arc<str>, Sample)>,
    events: Vec<Event>,
    /// When it must be written.
    due: Option<Instant>,
}

impl Batch {
    fn len(&self) -> usize {
        self.samples.len() + self.events.len()
    }

    fn clear(&mut self) {
        self.samples.clear();
        self.events.clear();
        self.due = None;
    }
}

pub(super) struct Writer {
    folder: PathBuf,
    db: Option<Connection>,
    keep: Keep,
    points: HashMap<Arc<str>, i64>,
    batch: Batch,
    tidy_at: Instant,
    counters: Arc<Counters>,
    notify: mpsc::Sender<Event>,
}

impl Writer {
    pub(super) fn new(
        folder: &Path,
        keep: Keep,
        counters: Arc<Counters>,
        notify: mpsc::Sender<Event>,
    ) -> Writer {
        Writer {
            folder: folder.to_owned(),
            db: None,
            keep,
            points: HashMap::new(),
            batch: Batch::default(),
            tidy_at: Instant::now() + TIDY,
            counters,
            notify,
        }
    }

    /// Runs until all senders are gone, or it is closed.
    pub(super) fn run(mut self, jobs: &Receiver<Job>) {
        self.commit();
        loop {
            let deadline = self.batch.due.unwrap_or(self.tidy_at).min(self.tidy_at);
            let wait = deadline.saturating_duration_since(Instant::now());
            match jobs.recv_timeout(wait) {
                Ok(Job::Close(done)) => {
                    self.end();
                    // Fails if the caller has stopped waiting.
                    let _ = done.send(());
                    return;
                }
                Ok(job) => self.take(job),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.end(),
            }
            let now = Instant::now();
            if self.batch.len() >= BATCH_MAX || self.batch.due.is_some_and(|due| due <= now) {
                self.commit();
            }
            if self.tidy_at <= now {
                self.commit();
                let more = self.tidy();
                self.tidy_at = Instant::now() + if more { TIDY_MORE } else { TIDY };
            }
        }
    }

    fn take(&mut self, job: Job) {
        match job {
            Job::Sample(path, sample) => self.batch.samples.push((path, sample)),
            Job::Event(event) => self.batch.events.push(*event),
            Job::Ack { id, ack, done } => {
                self.commit();
                let _ = done.send(self.acknowledge(&id, &ack));
                return;
            }
            Job::Flush(done) => {
                if self.batch.len() > 0 {
                    self.commit();
                }
                let _ = done.send(());
                return;
            }
            // The follower of the site sends them again after each gap.
            Job::Keep(keep) if keep == self.keep => return,
            Job::Keep(keep) => {
                self.keep = keep;
                self.tidy_at = Instant::now();
                return;
            }
            Job::Close(_) => return,
        }
        let due = Instant::now() + FLUSH;
        self.batch.due.get_or_insert(due);
    }

    /// Writes what is queued. What can't be written is dropped: more will come.
    fn commit(&mut self) {
        let written = match self.try_commit() {
            Err(why) if trouble(&why) == DbFault::Broken => {
                self.begin_anew(&why);
                self.try_commit()
            }
            end => end,
        };
        let count = self.batch.len() as u64;
        self.batch.clear();
        self.counters.full.store(
            matches!(&written, Err(why) if trouble(why) == DbFault::Full),
            Ordering::Relaxed,
        );
        let failed_before = self
            .counters
            .failing
            .swap(written.is_err(), Ordering::Relaxed);
        match written {
            Ok(()) if failed_before => {
                let dropped = self.counters.dropped.load(Ordering::Relaxed);
                self.tell(
                    Severity::Info,
                    "history_works",
                    format!("dropped {dropped}"),
                );
            }
            Ok(()) => {}
            Err(why) => {
                self.counters.dropped.fetch_add(count, Ordering::Relaxed);
                // The next write reopens it.
                self.db = None;
                self.points.clear();
                if !failed_before {
                    self.tell(Severity::Error, "history_fails", why.to_string());
                }
            }
        }
    }

    fn try_commit(&mut self) -> rusqlite::Result<()> {
        if self.db.is_none() {
            self.db = Some(self.open()?);
        }
        let Some(db) = &mut self.db else {
            return Ok(());
        };
        if self.points.len() > POINTS_MAX {
            self.points.clear();
        }
        let step = db.transaction()?;
        for (path, sample) in &self.batch.samples {
            let point = point_number(&step, &mut self.points, path)?;
            step.prepare_cached("INSERT OR REPLACE INTO samples VALUES (?1, ?2, ?3, ?4)")?
                .execute(params![
                    point,
                    sample.t,
                    sample.value,
                    sample.grade.number()
                ])?;
        }
        for event in &self.batch.events {
            insert_event(&step, event)?;
        }
        alive(&step)?;
        if !self.batch.samples.is_empty() {
            prune::count(&step, self.batch.samples.len() as i64)?;
        }
        let end = step.commit();
        if end.is_err() {
            // IDs assigned in it are void.
            self.points.clear();
        }
        end
    }

    /// Opens the database; nothing is known about the time since the last program ended.
    fn open(&mut self) -> rusqlite::Result<Connection> {
        let mut db = database::open(&file_of(&self.folder), &SCHEMA)?;
        let step = db.transaction()?;
        step.execute(
            "INSERT OR IGNORE INTO samples
             SELECT id, max(
                 coalesce((SELECT value FROM meta WHERE key = 'alive'), 0),
                 (SELECT t FROM samples WHERE point = id ORDER BY t DESC LIMIT 1) + 1
             ), NULL, ?1 FROM points
             WHERE (SELECT q FROM samples WHERE point = id ORDER BY t DESC LIMIT 1) < ?1",
            [SampleQuality::Bad.number()],
        )?;
        step.commit()?;
        // Readers reopen it, and the recorder starts anew.
        self.counters.generation.send_modify(|number| *number += 1);
        // There are many inserts, with few different statements.
        db.set_prepared_statement_cache_capacity(16);
        Ok(db)
    }

    /// The file is not a usable database: it is kept under another name.
    fn begin_anew(&mut self, why: &rusqlite::Error) {
        self.db = None;
        self.points.clear();
        let aside = database::put_aside(&file_of(&self.folder), millis(SystemTime::now()));
        let told = match aside {
            Ok(path) => format!("{why}: {}", path.display()),
            Err(failed) => format!("{why}; {failed}"),
        };
        self.tell(Severity::Error, "history_put_aside", told);
    }

    fn acknowledge(&mut self, id: &str, ack: &Ack) -> Result<bool, HistoryError> {
        let db = self.db.as_ref().ok_or(HistoryError::Closed)?;
        let changed = db.execute(
            "UPDATE events SET ack_who = ?2, ack_t = ?3, ack_comment = ?4 WHERE id = ?1",
            params![id, ack.who, ack.at_ms, ack.comment],
        );
        Ok(changed.map_err(HistoryError::from)? > 0)
    }

    /// Enforces the limits, and checkpoints the write-ahead log; returns whether there is more to
    /// delete.
    fn tidy(&mut self) -> bool {
        let Some(db) = &self.db else {
            return false;
        };
        let now = millis(SystemTime::now());
        let pruned = prune::prune(db, self.keep, now);
        // A problem shows at the next commit, too, and is handled there.
        let _ = checkpoint(db);
        pruned.unwrap_or(false)
    }

    fn end(&mut self) {
        self.commit();
        if let Some(db) = &self.db {
            // If this fails, the next one to open it makes the checkpoint.
            let _ = checkpoint(db);
        }
        self.db = None;
    }

    /// A listener that is too slow has enough notices already.
    fn tell(&self, severity: Severity, code: &str, text: String) {
        let event = Event::new(EventKind::System, severity, code).text(text);
        let _ = self.notify.try_send(event);
    }
}

/// Records that all is well so far: current values are valid until now.
fn alive(step: &Transaction<'_>) -> rusqlite::Result<()> {
    step.prepare_cached("INSERT OR REPLACE INTO meta VALUES ('alive', ?1)")?
        .execute([millis(SystemTime::now())])?;
    Ok(())
}

fn point_number(
    step: &Transaction<'_>,
    known: &mut HashMap<Arc<str>, i64>,
    path: &Arc<str>,
) -> rusqlite::Result<i64> {
    if let Some(number) = known.get(path) {
        return Ok(*number);
    }
    step.prepare_cached("INSERT OR IGNORE INTO points (path) VALUES (?1)")?
        .execute([path])?;
    let number = step
        .prepare_cached("SELECT id FROM points WHERE path = ?1")?
        .query_row([path], |row| row.get(0))?;
    known.insert(Arc::clone(path), number);
    Ok(number)
}

fn insert_event(step: &Transaction<'_>, event: &Event) -> rusqlite::Result<()> {
    step.prepare_cached(
        "INSERT OR REPLACE INTO events (id, t, kind, severity, module, point, line, who, via,
         what, before, after, \"end\", code, text)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15)",
    )?
    .execute(params![
        event.id,
        millis(event.at),
        event.kind.name(),
        event.severity.name(),
        event.module,
        event.point,
        event.line,
        event.who,
        event.via,
        event.what,
        event.before,
        event.after,
        event.end,
        event.code,
        event.text,
    ])?;
    Ok(())
}
