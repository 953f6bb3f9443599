//! Reading the database: through separate connections, a few at a time.

use super::chart::Plotter;
use super::file_of;
use super::{Ack, Chart, Counters, Event, EventKind, History, Sample, SampleQuality, Severity};
use super::{millis, prune};
use crate::database;
use rusqlite::types::Value;
use rusqlite::{Connection, OptionalExtension, Row, params, params_from_iter};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};
use tokio::sync::Semaphore;

/// Maximum number of concurrent readers; others wait.
const READERS_MAX: usize = 4;
/// A chart that takes longer is aborted.
const CHART_MAX: Duration = Duration::from_secs(5);
/// How often that is checked.
const LOOK_EVERY: u32 = 8_192;
/// How many samples an export reads at a time: no reader holds the write-ahead log for long.
pub const PIECE_MAX: usize = 4_096;
/// How many events one query searches.
const EVENTS_SEEN_MAX: i64 = 20_000;

/// Why there is no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HistoryError {
    /// No point with this name is known.
    NoSuchPoint,
    /// It takes too long: request less.
    TooLong,
    /// Too many requests are waiting.
    Busy,
    /// The history was closed, or can't be opened.
    Closed,
    /// The database's error.
    Database(String),
}

impl fmt::Display for HistoryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            HistoryError::NoSuchPoint => "nothing is known of this point",
            HistoryError::TooLong => "it takes too long",
            HistoryError::Busy => "too much is waiting",
            HistoryError::Closed => "the history is closed",
            HistoryError::Database(why) => why,
        })
    }
}

impl std::error::Error for HistoryError {}

impl From<rusqlite::Error> for HistoryError {
    fn from(error: rusqlite::Error) -> HistoryError {
        match error {
            rusqlite::Error::QueryReturnedNoRows => HistoryError::NoSuchPoint,
            error => HistoryError::Database(error.to_string()),
        }
    }
}

/// A filter for events.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EventQuery {
    /// Those before the one with this ID.
    pub before: Option<String>,
    /// At most this many.
    pub limit: usize,
    /// Those of this kind.
    pub kind: Option<EventKind>,
    /// Those of this module.
    pub module: Option<String>,
    /// Those of the point with this label.
    pub point: Option<String>,
}

/// A stored event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredEvent {
    /// The event.
    pub event: Event,
    /// Its acknowledgement.
    pub acked: Option<Ack>,
}

/// A page of events.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KeptEvents {
    /// The newest first.
    pub events: Vec<StoredEvent>,
    /// The ID before which to continue; `None` if there are no more.
    pub next: Option<String>,
}

/// Size and state of the history.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Storage {
    /// Bytes in use in the file.
    pub bytes: u64,
    /// Bytes of the write-ahead log.
    pub wal_bytes: u64,
    /// When the oldest event or sample was, in milliseconds since 1970.
    pub oldest_ms: Option<i64>,
    /// How many points it knows.
    pub points: u64,
    /// How many samples were written and not deleted since.
    pub samples: u64,
    /// Samples and events dropped since the program started.
    pub dropped: u64,
    /// The disk is full.
    pub disk_full: bool,
    /// The last transaction failed.
    pub failing: bool,
}

/// The connections for reading.
#[derive(Debug)]
pub(super) struct Readers {
    folder: PathBuf,
    counters: Arc<Counters>,
    /// Idle connections, each with the number of the file it reads.
    idle: Mutex<Vec<(u64, Connection)>>,
    turns: Semaphore,
}

impl Readers {
    pub(super) fn new(folder: &Path, counters: Arc<Counters>) -> Readers {
        Readers {
            folder: folder.to_owned(),
            counters,
            idle: Mutex::default(),
            turns: Semaphore::new(READERS_MAX),
        }
    }

    /// Reads through a connection that is not used otherwise meanwhile.
    async fn read<T, F>(self: &Arc<Readers>, question: F) -> Result<T, HistoryError>
    where
        T: Send + 'static,
        F: FnOnce(&Connection) -> Result<T, HistoryError> + Send + 'static,
    {
        let _turn = self.turns.acquire().await;
        let readers = Arc::clone(self);
        let task = tokio::task::spawn_blocking(move || {
            let (generation, db) = readers.connection()?;
            let answer = question(&db);
            readers.give_back(generation, db);
            answer
        });
        let broken = |error: tokio::task::JoinError| Err(HistoryError::Database(error.to_string()));
        task.await.unwrap_or_else(broken)
    }

    fn connection(&self) -> Result<(u64, Connection), HistoryError> {
        let generation = *self.counters.generation.borrow();
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        idle.retain(|(of, _)| *of == generation);
        if let Some(known) = idle.pop() {
            return Ok(known);
        }
        drop(idle);
        Ok((generation, database::open_to_read(&file_of(&self.folder))?))
    }

    fn give_back(&self, generation: u64, db: Connection) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        if idle.len() < READERS_MAX {
            idle.push((generation, db));
        }
    }
}

impl History {
    /// The chart of a point over a half-open interval, in milliseconds since 1970.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub async fn chart(
        &self,
        path: &str,
        from: i64,
        to: i64,
        buckets: usize,
    ) -> Result<Chart, HistoryError> {
        self.written().await;
        let path = path.to_owned();
        let question = move |db: &Connection| {
            let plotter = Plotter::new(from, to, buckets);
            chart(db, &path, (from, to), plotter)
        };
        self.readers.read(question).await
    }

    /// The same in buckets of this many milliseconds each, never single samples.
    ///
    /// # Errors
    /// [`HistoryError`]; [`HistoryError::TooLong`] if there would be more than
    /// [`BUCKETS_MAX`](super::BUCKETS_MAX).
    pub async fn steps(
        &self,
        path: &str,
        from: i64,
        to: i64,
        step_ms: i64,
    ) -> Result<Chart, HistoryError> {
        self.written().await;
        let path = path.to_owned();
        let question = move |db: &Connection| {
            let plotter = Plotter::steps(from, to, step_ms).ok_or(HistoryError::TooLong)?;
            chart(db, &path, (from, to), plotter)
        };
        self.readers.read(question).await
    }

    /// The last samples of a point in a half-open interval, as many as requested but at most
    /// [`PIECE_MAX`]; if there are fewer, preceded by the one valid at the beginning.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub async fn last(
        &self,
        path: &str,
        from: i64,
        to: i64,
        count: usize,
    ) -> Result<Vec<Sample>, HistoryError> {
        self.written().await;
        let path = path.to_owned();
        let count = count.min(PIECE_MAX);
        let question = move |db: &Connection| {
            let point = number_of(db, &path)?;
            let mut statement = db.prepare_cached(
                "SELECT t, v, q FROM samples WHERE point = ?1 AND t >= ?2 AND t < ?3
                 ORDER BY t DESC LIMIT ?4",
            )?;
            let samples = statement.query_map(params![point, from, to, count as i64], sample)?;
            let mut samples = samples.collect::<Result<Vec<_>, _>>()?;
            if samples.len() < count {
                samples.extend(in_force(db, point, from)?);
            }
            samples.reverse();
            Ok(samples)
        };
        self.readers.read(question).await
    }

    /// Samples of a point in a half-open interval, at most [`PIECE_MAX`] of them.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub async fn samples(
        &self,
        path: &str,
        from: i64,
        to: i64,
    ) -> Result<Vec<Sample>, HistoryError> {
        self.written().await;
        let path = path.to_owned();
        let question = move |db: &Connection| {
            let point = number_of(db, &path)?;
            let mut statement = db.prepare_cached(
                "SELECT t, v, q FROM samples WHERE point = ?1 AND t >= ?2 AND t < ?3
                 ORDER BY t LIMIT ?4",
            )?;
            let samples =
                statement.query_map(params![point, from, to, PIECE_MAX as i64], sample)?;
            Ok(samples.collect::<Result<_, _>>()?)
        };
        self.readers.read(question).await
    }

    /// The value of a point at a moment, with the time since when; `None` if not known.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub async fn in_force(&self, path: &str, at: i64) -> Result<Option<Sample>, HistoryError> {
        self.written().await;
        let path = path.to_owned();
        let question = move |db: &Connection| Ok(in_force(db, number_of(db, &path)?, at)?);
        self.readers.read(question).await
    }

    /// Events, newest first.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub async fn events(&self, asked: EventQuery) -> Result<KeptEvents, HistoryError> {
        self.written().await;
        self.readers.read(move |db| events(db, &asked)).await
    }

    /// An event by its ID.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub async fn kept_event(&self, id: &str) -> Result<Option<StoredEvent>, HistoryError> {
        self.written().await;
        let id = id.to_owned();
        let question = move |db: &Connection| {
            let sql = format!("SELECT {COLUMNS} FROM events WHERE id = ?1");
            let found = db.prepare_cached(&sql)?.query_row([id], kept).optional();
            Ok(found?)
        };
        self.readers.read(question).await
    }

    /// Size and state of the history.
    pub async fn storage(&self) -> Storage {
        self.written().await;
        let wal = format!("{}-wal", file_of(&self.readers.folder).display());
        let mut storage = self.readers.read(storage).await.unwrap_or_default();
        storage.wal_bytes = std::fs::metadata(wal).map_or(0, |wal| wal.len());
        storage.dropped = self.dropped();
        storage.disk_full = self.counters.full.load(Ordering::Relaxed);
        storage.failing = self.counters.failing.load(Ordering::Relaxed);
        storage
    }
}

fn number_of(db: &Connection, path: &str) -> rusqlite::Result<i64> {
    db.prepare_cached("SELECT id FROM points WHERE path = ?1")?
        .query_row([path], |row| row.get(0))
}

fn sample(row: &Row<'_>) -> rusqlite::Result<Sample> {
    Ok(Sample {
        t: row.get(0)?,
        value: row.get(1)?,
        grade: SampleQuality::of_number(row.get(2)?),
    })
}

/// The last sample before a moment.
fn in_force(db: &Connection, point: i64, at: i64) -> rusqlite::Result<Option<Sample>> {
    db.prepare_cached(
        "SELECT t, v, q FROM samples WHERE point = ?1 AND t < ?2 ORDER BY t DESC LIMIT 1",
    )?
    .query_row([point, at], sample)
    .optional()
}

fn chart(
    db: &Connection,
    path: &str,
    (from, to): (i64, i64),
    mut plotter: Plotter,
) -> Result<Chart, HistoryError> {
    let begun = Instant::now();
    let point = number_of(db, path)?;
    if let Some(in_force) = in_force(db, point, from)? {
        plotter.take(in_force);
    }
    let mut statement = db.prepare_cached(
        "SELECT t, v, q FROM samples WHERE point = ?1 AND t >= ?2 AND t < ?3 ORDER BY t",
    )?;
    let mut rows = statement.query([point, from, to])?;
    let mut count: u32 = 0;
    while let Some(row) = rows.next()? {
        plotter.take(sample(row)?);
        count = count.wrapping_add(1);
        if count.is_multiple_of(LOOK_EVERY) && begun.elapsed() > CHART_MAX {
            return Err(HistoryError::TooLong);
        }
    }
    Ok(plotter.end(millis(SystemTime::now())))
}

const COLUMNS: &str = "id, t, kind, severity, module, point, line, who, via, what, before, after, \
                       \"end\", code, text, ack_who, ack_t, ack_comment";

fn events(db: &Connection, asked: &EventQuery) -> Result<KeptEvents, HistoryError> {
    let mut sql = format!("SELECT {COLUMNS} FROM events WHERE id < ?1");
    let newest = asked.before.clone().unwrap_or_else(|| "~".to_owned());
    let mut values = vec![Value::Text(newest)];
    let kind = asked.kind.map(|kind| kind.name().to_owned());
    let wanted = [
        ("kind", kind.as_ref()),
        ("module", asked.module.as_ref()),
        ("point", asked.point.as_ref()),
    ];
    for (column, value) in wanted {
        if let Some(value) = value {
            values.push(Value::Text(value.clone()));
            // Writing into a String does not fail.
            let _ =
                fmt::Write::write_fmt(&mut sql, format_args!(" AND {column} = ?{}", values.len()));
        }
    }
    // One more than requested shows whether there are more.
    let limit = i64::try_from(asked.limit)
        .unwrap_or(EVENTS_SEEN_MAX)
        .min(EVENTS_SEEN_MAX);
    values.push(Value::Integer(limit + 1));
    let _ = fmt::Write::write_fmt(
        &mut sql,
        format_args!(" ORDER BY id DESC LIMIT ?{}", values.len()),
    );
    let mut statement = db.prepare_cached(&sql)?;
    let rows = statement.query_map(params_from_iter(values), kept)?;
    let mut events: Vec<StoredEvent> = rows.collect::<Result<_, _>>()?;
    let more = events.len() as i64 > limit;
    events.truncate(usize::try_from(limit).unwrap_or_default());
    let last = events.last().map(|kept| kept.event.id.clone());
    let next = last.filter(|_| more);
    Ok(KeptEvents { events, next })
}

fn kept(row: &Row<'_>) -> rusqlite::Result<StoredEvent> {
    let kind: String = row.get(2)?;
    let severity: String = row.get(3)?;
    let at: i64 = row.get(1)?;
    let event = Event {
        id: row.get(0)?,
        at: SystemTime::UNIX_EPOCH + Duration::from_millis(at.unsigned_abs()),
        kind: EventKind::from_name(&kind).unwrap_or(EventKind::System),
        severity: Severity::from_name(&severity).unwrap_or(Severity::Info),
        module: row.get(4)?,
        point: row.get(5)?,
        line: row.get(6)?,
        who: row.get(7)?,
        via: row.get(8)?,
        what: row.get(9)?,
        before: row.get(10)?,
        after: row.get(11)?,
        end: row.get(12)?,
        code: row.get(13)?,
        text: row.get(14)?,
    };
    let acked = match (row.get(15)?, row.get(16)?) {
        (Some(who), Some(at_ms)) => Some(Ack {
            who,
            at_ms,
            comment: row.get::<_, Option<String>>(17)?.unwrap_or_default(),
        }),
        _ => None,
    };
    Ok(StoredEvent { event, acked })
}

fn storage(db: &Connection) -> Result<Storage, HistoryError> {
    let points: i64 = db.query_row("SELECT count(*) FROM points", [], |row| row.get(0))?;
    let samples: i64 = db.query_row(
        "SELECT coalesce((SELECT value FROM meta WHERE key = 'samples'), 0)",
        [],
        |row| row.get(0),
    )?;
    let oldest_ms = db.query_row(
        "SELECT min((SELECT t FROM samples WHERE point = id ORDER BY t LIMIT 1)) FROM points",
        [],
        |row| row.get(0),
    )?;
    Ok(Storage {
        bytes: prune::used_bytes(db)?,
        oldest_ms,
        points: u64::try_from(points).unwrap_or_default(),
        samples: u64::try_from(samples).unwrap_or_default(),
        ..Storage::default()
    })
}
