//! The database file: its schema, its settings, and what happens to a broken one.

use rusqlite::{Connection, ErrorCode, OpenFlags};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The name of the file in its folder.
const FILE: &str = "history.db";
/// The schema that this program writes.
const VERSION: i64 = 1;
/// How many tables it has.
const TABLES: i64 = 4;
/// Timeout for another connection's lock.
const BUSY: Duration = Duration::from_millis(500);
/// The write-ahead log is truncated to this size after a checkpoint.
const JOURNAL_MAX: i64 = 16 << 20;
/// How many broken files are kept.
const ASIDE_MAX: usize = 3;

/// Migrations from one schema version to the next.
const MIGRATIONS: [&str; VERSION as usize] = [
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

/// The path of a folder's database.
pub(super) fn file_of(folder: &Path) -> PathBuf {
    folder.join(FILE)
}

/// Opens the database for writing, and creates it if necessary.
pub(super) fn open(folder: &Path) -> rusqlite::Result<Connection> {
    // If the folder is unusable, opening the file will report it.
    let _ = std::fs::create_dir_all(folder);
    let mut db = Connection::open(file_of(folder))?;
    db.busy_timeout(BUSY)?;
    // Takes effect only before the first table.
    db.pragma_update(None, "auto_vacuum", "incremental")?;
    db.pragma_update(None, "journal_mode", "wal")?;
    db.pragma_update(None, "synchronous", "normal")?;
    db.pragma_update(None, "journal_size_limit", JOURNAL_MAX)?;
    db.pragma_update(None, "cache_size", -4_096)?;
    migrate(&mut db)?;
    Ok(db)
}

fn migrate(db: &mut Connection) -> rusqlite::Result<()> {
    let version: i64 = db.pragma_query_value(None, "user_version", |row| row.get(0))?;
    if version > VERSION {
        return Err(other_schema("of a newer program"));
    }
    let done = usize::try_from(version).unwrap_or_default();
    for (number, sql) in (1_i64..).zip(MIGRATIONS).skip(done) {
        let step = db.transaction()?;
        let other = |error: rusqlite::Error| match error.sqlite_error_code() {
            Some(ErrorCode::Unknown) => other_schema("of another program"),
            _ => error,
        };
        step.execute_batch(sql).map_err(other)?;
        step.pragma_update(None, "user_version", number)?;
        step.commit()?;
    }
    let tables: i64 = db.query_row(
        "SELECT count(*) FROM sqlite_schema
         WHERE name IN ('meta', 'points', 'samples', 'events')",
        [],
        |row| row.get(0),
    )?;
    if tables < TABLES {
        return Err(other_schema("tables are missing"));
    }
    Ok(())
}

/// The application ID of another program's database.
fn other_schema(why: &str) -> rusqlite::Error {
    let error = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_NOTADB);
    rusqlite::Error::SqliteFailure(error, Some(why.to_owned()))
}

/// Opens the database for reading.
pub(super) fn open_to_read(folder: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let db = Connection::open_with_flags(file_of(folder), flags)?;
    db.busy_timeout(BUSY)?;
    Ok(db)
}

/// What an error of the database amounts to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DbFault {
    /// The disk is full.
    Full,
    /// The file is not a database, or is broken, or written by a newer program.
    Broken,
    /// Something else; it may be transient.
    Passing,
}

pub(super) fn trouble(error: &rusqlite::Error) -> DbFault {
    match error.sqlite_error_code() {
        Some(ErrorCode::DiskFull) => DbFault::Full,
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => DbFault::Broken,
        _ => DbFault::Passing,
    }
}

/// Renames a broken database; returns the new name. Only the newest ones are kept.
pub(super) fn put_aside(folder: &Path, now_ms: i64) -> std::io::Result<PathBuf> {
    let file = file_of(folder);
    let name = |suffix: &str| folder.join(format!("history.broken-{now_ms}.db{suffix}"));
    let aside = name("");
    std::fs::rename(&file, &aside)?;
    for suffix in ["-wal", "-shm"] {
        // They may not exist.
        let _ = std::fs::rename(folder.join(format!("{FILE}{suffix}")), name(suffix));
    }
    forget_old(folder);
    Ok(aside)
}

fn forget_old(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    let mut stems: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.starts_with("history.broken-") && name.ends_with(".db"))
        .collect();
    stems.sort();
    let too_many = stems.len().saturating_sub(ASIDE_MAX);
    for stem in stems.iter().take(too_many) {
        for suffix in ["", "-wal", "-shm"] {
            let _ = std::fs::remove_file(folder.join(format!("{stem}{suffix}")));
        }
    }
}
