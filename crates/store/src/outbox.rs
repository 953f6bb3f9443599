//! What another program is still to get, in its order: changes of points, and the times in which
//! changes may be missing. It stays on the disk until the receiver has it.
//!
//! Every entry has a number, one more than the one before, and no number is used twice: whoever
//! gets an entry again knows it by that. [`Outbox::epoch`] is another one where numbers begin anew.

use crate::Ulids;
use crate::database::{self, DbFault, Schema};
use rusqlite::{Connection, OptionalExtension, Transaction, params};
use std::collections::HashMap;
use std::path::Path;
use std::time::SystemTime;

/// How many entries are deleted in one step because there are too many.
const ROWS_MAX: i64 = 20_000;
/// How many free pages are given back to the system in one step.
const PAGES_MAX: i64 = 2_000;
/// How many paths are remembered with their numbers.
const PATHS_MAX: usize = 65_536;

const SCHEMA: Schema = Schema {
    // `meta` has one row. All up to `taken` is delivered; that one was made at `taken_at`. Every
    // change until `known` is here.
    migrations: &["CREATE TABLE meta (
            epoch TEXT NOT NULL, taken INTEGER NOT NULL, taken_at INTEGER, known INTEGER
         );
         CREATE TABLE paths (id INTEGER PRIMARY KEY, path TEXT NOT NULL UNIQUE);
         CREATE TABLE entries (
            seq INTEGER PRIMARY KEY AUTOINCREMENT, at INTEGER NOT NULL, path INTEGER,
            value TEXT, quality TEXT, reason TEXT, time INTEGER
         );"],
    tables: &["meta", "paths", "entries"],
    // A number that was given to a receiver must not be given to something else.
    is_durable: true,
};

/// Something that the receiver is to get.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutboxEntry {
    /// When it became so, in milliseconds since 1970.
    pub at: i64,
    /// What it is.
    pub what: EntryKind,
}

/// What an entry is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EntryKind {
    /// A point is like this from then on.
    Reading {
        /// Its path, such as `oven.k1`.
        path: String,
        /// Its value in JSON; none if it is not known.
        value: Option<String>,
        /// How good it is: a word of the API.
        quality: String,
        /// Why it is not good.
        reason: Option<String>,
        /// When it was read, in milliseconds since 1970.
        time: Option<i64>,
    },
    /// Changes may be missing.
    Gap {
        /// Since when, in milliseconds since 1970; none if there was nothing before.
        from: Option<i64>,
        /// A word that says why.
        reason: String,
    },
}

/// What was delivered last, or dropped undelivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Taken {
    seq: u64,
    at: Option<i64>,
}

/// The oldest entries that are not delivered yet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Piece {
    /// The number of the first one.
    pub first: u64,
    /// They have consecutive numbers.
    pub entries: Vec<OutboxEntry>,
    /// What was before them and is there no longer.
    pub missing: Option<DroppedEntries>,
}

/// Entries that were dropped because there were too many, or they were too old.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DroppedEntries {
    /// How many.
    pub count: u64,
    /// When the last one that was delivered was made, in milliseconds since 1970, or a later one
    /// before them; none if there was none.
    pub from: Option<i64>,
    /// When the one after them was made.
    pub to: i64,
}

/// How much is kept for a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutboxKeep {
    /// For this long, in milliseconds.
    pub age_ms: i64,
    /// In this many bytes.
    pub bytes: u64,
    /// Also what is delivered, for a receiver that may ask for it again ([`Outbox::read_again`]).
    pub is_for_again: bool,
}

/// A file with entries. It has one owner.
#[derive(Debug)]
pub struct Outbox {
    db: Connection,
    epoch: String,
    paths: HashMap<String, i64>,
}

/// Why an outbox does not do what it should.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutboxError {
    /// The file is broken, and is to be put aside: [`Outbox::put_aside`].
    pub is_broken: bool,
    /// What the database says.
    pub reason: String,
}

impl std::fmt::Display for OutboxError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.reason)
    }
}

impl std::error::Error for OutboxError {}

impl From<rusqlite::Error> for OutboxError {
    fn from(error: rusqlite::Error) -> OutboxError {
        OutboxError {
            is_broken: database::trouble(&error) == DbFault::Broken,
            reason: error.to_string(),
        }
    }
}

impl Outbox {
    /// Opens an outbox, or creates one. One that is broken is put aside, and its entries are lost:
    /// the new one has another epoch.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn open(file: &Path) -> Result<Outbox, OutboxError> {
        let opened = match Outbox::try_open(file) {
            Err(why) if database::trouble(&why) == DbFault::Broken => {
                Outbox::put_aside(file).map_err(|error| OutboxError {
                    is_broken: true,
                    reason: format!("{why}: {error}"),
                })?;
                Outbox::try_open(file)
            }
            opened => opened,
        };
        Ok(opened?)
    }

    fn try_open(file: &Path) -> rusqlite::Result<Outbox> {
        let mut db = database::open(file, &SCHEMA)?;
        // Of two owners the second one is refused.
        db.pragma_update(None, "locking_mode", "exclusive")?;
        let known = db
            .query_row("SELECT epoch FROM meta", [], |row| row.get(0))
            .optional()?;
        let epoch = match known {
            Some(epoch) => epoch,
            None => {
                let epoch = Ulids::default().next(SystemTime::now());
                let step = db.transaction()?;
                step.execute("INSERT INTO meta VALUES (?1, 0, NULL, NULL)", [&epoch])?;
                step.commit()?;
                epoch
            }
        };
        // Names that nothing has any more. What is delivered may be kept, so that there is always
        // an entry: then they are looked up once they are many.
        db.execute(
            "DELETE FROM paths WHERE NOT EXISTS (SELECT 1 FROM entries)
             OR ((SELECT count(*) FROM paths) > ?1
                 AND id NOT IN (SELECT path FROM entries WHERE path IS NOT NULL))",
            [PATHS_MAX as i64],
        )?;
        Ok(Outbox {
            db,
            epoch,
            paths: HashMap::new(),
        })
    }

    /// Puts aside the file of an outbox that is broken and not open. Not all of it is looked at
    /// when it is opened: one with a broken page would be met again and again.
    ///
    /// # Errors
    /// The system's error.
    pub fn put_aside(file: &Path) -> std::io::Result<()> {
        let now = crate::history::millis(SystemTime::now());
        database::put_aside(file, now).map(drop)
    }

    /// Removes the file of an outbox that is not open. What can't be removed stays.
    pub fn remove(file: &Path) {
        database::remove(file);
    }

    /// Whose numbers these are.
    #[must_use]
    pub fn epoch(&self) -> &str {
        &self.epoch
    }

    /// Appends entries: all of them or none, and they are on the disk then. Gives back the number
    /// of the newest.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn append(&mut self, entries: &[OutboxEntry]) -> Result<u64, OutboxError> {
        if self.paths.len() > PATHS_MAX {
            self.paths.clear();
        }
        let step = self.db.transaction()?;
        let end = insert(&step, &mut self.paths, entries).and_then(|()| step.commit());
        if end.is_err() {
            // Numbers given in it are void.
            self.paths.clear();
        }
        end?;
        self.newest()
    }

    /// The number of the newest entry; 0 if there never was one.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn newest(&self) -> Result<u64, OutboxError> {
        let newest = self
            .db
            .prepare_cached("SELECT seq FROM sqlite_sequence WHERE name = 'entries'")?
            .query_row([], |row| row.get(0))
            .optional()?;
        Ok(number(newest.unwrap_or(0)))
    }

    /// Every change until this time is here, in milliseconds since 1970; none if it is new.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn known_until(&self) -> Result<Option<i64>, OutboxError> {
        let newest: Option<i64> = self
            .db
            .query_row(
                "SELECT at FROM entries ORDER BY seq DESC LIMIT 1",
                [],
                |row| row.get(0),
            )
            .optional()?;
        let known: Option<i64> = self
            .db
            .query_row("SELECT known FROM meta", [], |row| row.get(0))?;
        Ok(newest.max(known).max(self.last_taken()?.at))
    }

    /// Writes down that every change until this time is here.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn known(&self, at: i64) -> Result<(), OutboxError> {
        self.db.execute("UPDATE meta SET known = ?1", [at])?;
        Ok(())
    }

    /// Up to which number everything is delivered.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn taken(&self) -> Result<u64, OutboxError> {
        Ok(self.last_taken()?.seq)
    }

    fn last_taken(&self) -> rusqlite::Result<Taken> {
        self.db
            .prepare_cached("SELECT taken, taken_at FROM meta")?
            .query_row([], |row| {
                Ok(Taken {
                    seq: number(row.get(0)?),
                    at: row.get(1)?,
                })
            })
    }

    /// The oldest entries after this number, so many of them at most; none if there are none.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn read(&self, after: u64, count: usize) -> Result<Option<Piece>, OutboxError> {
        let taken = self.last_taken()?;
        let after = after.max(taken.seq);
        let mut piece = self.row(after, u64::MAX, count)?;
        let Some(oldest) = piece.entries.first() else {
            return Ok(None);
        };
        if piece.first > after + 1 {
            let before = self
                .db
                .prepare_cached("SELECT at FROM entries WHERE seq = ?1")?
                .query_row([signed(after)], |row| row.get(0))
                .optional()?;
            piece.missing = Some(DroppedEntries {
                count: piece.first - after - 1,
                from: before.or(taken.at),
                to: oldest.at,
            });
        }
        Ok(Some(piece))
    }

    /// The oldest entries of those from one number to another, delivered or not, so many of them at
    /// most; none if there are none. They are those that are there in a row: [`Piece::first`] is
    /// higher where the first ones are there no longer.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn read_again(
        &self,
        (first, last): (u64, u64),
        count: usize,
    ) -> Result<Option<Piece>, OutboxError> {
        let piece = self.row(first.saturating_sub(1), last, count)?;
        Ok((!piece.entries.is_empty()).then_some(piece))
    }

    /// Entries in a row after one number and up to another, so many at most.
    fn row(&self, after: u64, last: u64, count: usize) -> Result<Piece, OutboxError> {
        let mut find = self.db.prepare_cached(
            "SELECT seq, at, path, value, quality, reason, time,
                (SELECT path FROM paths WHERE id = entries.path)
             FROM entries WHERE seq > ?1 AND seq <= ?2 ORDER BY seq LIMIT ?3",
        )?;
        let limits = params![signed(after), signed(last), signed(count as u64)];
        let mut rows = find.query(limits)?;
        let mut piece = Piece::default();
        while let Some(row) = rows.next()? {
            let seq = number(row.get(0)?);
            if piece.entries.is_empty() {
                piece.first = seq;
            } else if seq != piece.first + piece.entries.len() as u64 {
                break;
            }
            piece.entries.push(entry(row)?);
        }
        Ok(piece)
    }

    /// The receiver has everything up to this number. It is deleted, unless it is kept for a
    /// receiver that may ask for it again.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn delivered(&mut self, to: u64, is_kept: bool) -> Result<(), OutboxError> {
        let to = signed(to);
        let step = self.db.transaction()?;
        step.prepare_cached(
            "UPDATE meta SET taken_at = coalesce(
                (SELECT at FROM entries WHERE seq <= ?1 ORDER BY seq DESC LIMIT 1), taken_at),
             taken = max(taken, ?1)",
        )?
        .execute([to])?;
        if !is_kept {
            step.prepare_cached("DELETE FROM entries WHERE seq <= ?1")?
                .execute([to])?;
        }
        Ok(step.commit()?)
    }

    /// Drops the oldest of what is too old or too much: [`Piece::missing`] tells of what was not
    /// delivered. The newest entry stays, as there would be nothing to tell it with.
    /// How many were dropped undelivered, and whether there is more to drop.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn prune(&mut self, keep: OutboxKeep, now: i64) -> Result<(u64, bool), OutboxError> {
        let cutoff = now.saturating_sub(keep.age_ms);
        // Only those before the first one that is not too old: what a wrong clock has written does
        // not count for others.
        let old: i64 = self.db.query_row(
            "WITH oldest AS (SELECT seq, at FROM entries ORDER BY seq LIMIT ?1)
             SELECT count(*) FROM oldest
             WHERE seq < coalesce((SELECT min(seq) FROM oldest WHERE at >= ?2), seq + 1)",
            [ROWS_MAX, cutoff],
            |row| row.get(0),
        )?;
        let is_much = self.used()? > keep.bytes;
        let much = match is_much {
            true => ROWS_MAX,
            false => 0,
        };
        let drop = old.max(much);
        if drop == 0 {
            return Ok((0, false));
        }
        let taken = signed(self.last_taken()?.seq);
        let step = self.db.transaction()?;
        let lost: i64 = step.query_row(
            "SELECT count(*) FROM (SELECT seq FROM entries ORDER BY seq LIMIT ?1)
             WHERE seq > ?2 AND seq < (SELECT max(seq) FROM entries)",
            [drop, taken],
            |row| row.get(0),
        )?;
        let dropped = step.execute(
            "DELETE FROM entries WHERE seq IN (SELECT seq FROM entries ORDER BY seq LIMIT ?1)
             AND seq < (SELECT max(seq) FROM entries)",
            [drop],
        )?;
        step.commit()?;
        Ok((number(lost), drop == ROWS_MAX && dropped > 0))
    }

    /// Gives free pages back to the system, and begins the log of the database anew.
    ///
    /// # Errors
    /// [`OutboxError`].
    pub fn tidy(&self) -> Result<(), OutboxError> {
        database::shrink(&self.db, PAGES_MAX)?;
        Ok(database::checkpoint(&self.db)?)
    }

    /// How many bytes its entries take.
    fn used(&self) -> rusqlite::Result<u64> {
        let of = |name: &str| -> rusqlite::Result<u64> {
            let value = self.db.pragma_query_value(None, name, |row| row.get(0))?;
            Ok(number(value))
        };
        let pages = of("page_count")?.saturating_sub(of("freelist_count")?);
        Ok(pages * of("page_size")?)
    }
}

fn insert(
    step: &Transaction<'_>,
    paths: &mut HashMap<String, i64>,
    entries: &[OutboxEntry],
) -> rusqlite::Result<()> {
    let mut insert = step.prepare_cached(
        "INSERT INTO entries (at, path, value, quality, reason, time)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    )?;
    for entry in entries {
        match &entry.what {
            EntryKind::Reading {
                path,
                value,
                quality,
                reason,
                time,
            } => {
                let path = path_number(step, paths, path)?;
                insert.execute(params![entry.at, path, value, quality, reason, time])?;
            }
            EntryKind::Gap { from, reason } => {
                let nothing: Option<String> = None;
                insert.execute(params![entry.at, nothing, nothing, nothing, reason, from])?;
            }
        }
    }
    Ok(())
}

fn path_number(
    step: &Transaction<'_>,
    known: &mut HashMap<String, i64>,
    path: &str,
) -> rusqlite::Result<i64> {
    if let Some(number) = known.get(path) {
        return Ok(*number);
    }
    step.prepare_cached("INSERT OR IGNORE INTO paths (path) VALUES (?1)")?
        .execute([path])?;
    let number = step
        .prepare_cached("SELECT id FROM paths WHERE path = ?1")?
        .query_row([path], |row| row.get(0))?;
    known.insert(path.to_owned(), number);
    Ok(number)
}

fn entry(row: &rusqlite::Row<'_>) -> rusqlite::Result<OutboxEntry> {
    let path: Option<String> = row.get(7)?;
    let what = match path {
        Some(path) => EntryKind::Reading {
            path,
            value: row.get(3)?,
            quality: row.get(4)?,
            reason: row.get(5)?,
            time: row.get(6)?,
        },
        None => EntryKind::Gap {
            reason: row.get(5)?,
            from: row.get(6)?,
        },
    };
    Ok(OutboxEntry {
        at: row.get(1)?,
        what,
    })
}

/// SQLite has signed numbers only.
fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

fn number(signed: i64) -> u64 {
    u64::try_from(signed).unwrap_or(0)
}

#[cfg(test)]
mod tests;
