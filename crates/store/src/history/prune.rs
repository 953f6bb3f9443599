//! Deletes what is too old, and then the oldest while there is too much.

use crate::database;
use rusqlite::{Connection, params};

/// A day, in milliseconds.
const DAY_MS: i64 = 86_400_000;
/// How many rows are deleted in one transaction.
const ROWS_MAX: i64 = 20_000;
/// How many such transactions are made in one go; the rest waits for the next.
const STEPS_MAX: usize = 20;
/// Maximum number of events.
const EVENTS_MAX: i64 = 200_000;
/// How many free pages are returned to the system in one go.
const PAGES_MAX: i64 = 2_000;

/// How much is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keep {
    /// For this long, in milliseconds.
    pub age_ms: i64,
    /// This many bytes.
    pub bytes: u64,
}

impl Default for Keep {
    /// 90 days and 2 GB, whichever is less.
    fn default() -> Keep {
        Keep {
            age_ms: 90 * DAY_MS,
            bytes: 2_000_000_000,
        }
    }
}

/// Deletes what is too old or too much; returns whether there may be more.
pub(super) fn prune(db: &Connection, keep: Keep, now: i64) -> rusqlite::Result<bool> {
    let mut steps = STEPS_MAX;
    forget_before(db, now.saturating_sub(keep.age_ms), &mut steps)?;
    forget_events(db, now.saturating_sub(keep.age_ms))?;
    while used_bytes(db)? > keep.bytes && steps > 0 {
        let Some(oldest) = oldest(db)? else {
            break;
        };
        // A twentieth of the remaining time span.
        let cutoff = oldest + (now - oldest).max(20) / 20;
        steps -= 1;
        forget_before(db, cutoff, &mut steps)?;
        forget_events(db, cutoff)?;
    }
    if free_pages(db)? > PAGES_MAX {
        database::shrink(db, PAGES_MAX)?;
    }
    Ok(steps == 0)
}

/// Deletes the samples before a time, except the one of each point that was valid then.
fn forget_before(db: &Connection, cutoff: i64, steps: &mut usize) -> rusqlite::Result<()> {
    let mut points = db.prepare("SELECT id FROM points")?;
    let points: Vec<i64> = points
        .query_map([], |row| row.get(0))?
        .collect::<Result<_, _>>()?;
    for point in points {
        let in_force: Option<i64> = db
            .prepare_cached("SELECT max(t) FROM samples WHERE point = ?1 AND t <= ?2")?
            .query_row([point, cutoff], |row| row.get(0))?;
        let Some(in_force) = in_force else {
            continue;
        };
        while *steps > 0 && forget_some(db, point, in_force)? {
            *steps -= 1;
        }
    }
    Ok(())
}

/// Deletes some samples of a point before a time; returns whether there may be more.
fn forget_some(db: &Connection, point: i64, before: i64) -> rusqlite::Result<bool> {
    let until: Option<i64> = db
        .prepare_cached(
            "SELECT max(t) FROM (SELECT t FROM samples WHERE point = ?1 AND t < ?2
             ORDER BY t LIMIT ?3)",
        )?
        .query_row([point, before, ROWS_MAX], |row| row.get(0))?;
    let Some(until) = until else {
        return Ok(false);
    };
    let gone = db
        .prepare_cached("DELETE FROM samples WHERE point = ?1 AND t <= ?2")?
        .execute([point, until])?;
    count(db, -(gone as i64))?;
    Ok(gone as i64 >= ROWS_MAX)
}

/// Number of samples added or deleted.
pub(super) fn count(db: &Connection, samples: i64) -> rusqlite::Result<()> {
    db.prepare_cached(
        "INSERT INTO meta VALUES ('samples', ?1)
         ON CONFLICT (key) DO UPDATE SET value = max(value + ?1, 0)",
    )?
    .execute([samples])?;
    Ok(())
}

/// Deletes events before a time, and the oldest if there are too many.
fn forget_events(db: &Connection, cutoff: i64) -> rusqlite::Result<()> {
    db.execute(
        "DELETE FROM events WHERE id IN
         (SELECT id FROM events WHERE t < ?1 ORDER BY id LIMIT ?2)",
        [cutoff, ROWS_MAX],
    )?;
    db.execute(
        "DELETE FROM events WHERE id <= coalesce(
         (SELECT id FROM events ORDER BY id DESC LIMIT 1 OFFSET ?1), '')",
        params![EVENTS_MAX],
    )?;
    Ok(())
}

/// The time of the oldest sample that is no longer valid; `None` if there is none.
fn oldest(db: &Connection) -> rusqlite::Result<Option<i64>> {
    db.query_row(
        "SELECT min((SELECT t FROM samples WHERE point = id AND t <
            (SELECT max(t) FROM samples WHERE point = id) ORDER BY t LIMIT 1)) FROM points",
        [],
        |row| row.get(0),
    )
}

/// Number of bytes in use in the file.
pub(super) fn used_bytes(db: &Connection) -> rusqlite::Result<u64> {
    let number = |name: &str| -> rusqlite::Result<i64> {
        db.pragma_query_value(None, name, |row| row.get(0))
    };
    let used = (number("page_count")? - number("freelist_count")?) * number("page_size")?;
    Ok(u64::try_from(used).unwrap_or_default())
}

fn free_pages(db: &Connection) -> rusqlite::Result<i64> {
    db.pragma_query_value(None, "freelist_count", |row| row.get(0))
}
