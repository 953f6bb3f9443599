//! A database file: its schema, its settings, and what happens to a broken one.

use rusqlite::{Connection, ErrorCode, OpenFlags};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Timeout for another connection's lock.
const BUSY: Duration = Duration::from_millis(500);
/// What SQLite has beside a database.
const JOURNALS: [&str; 2] = ["-wal", "-shm"];
/// The write-ahead log is truncated to this size after a checkpoint.
const JOURNAL_MAX: i64 = 16 << 20;
/// How many broken files are kept.
const ASIDE_MAX: usize = 3;

/// What a database has, and how it is written.
#[derive(Debug)]
pub(crate) struct Schema {
    /// From each version of it to the next.
    pub(crate) migrations: &'static [&'static str],
    /// Its tables.
    pub(crate) tables: &'static [&'static str],
    /// Every transaction is on the disk when it ends; otherwise the last ones may be lost with the
    /// power.
    pub(crate) is_durable: bool,
}

/// Opens a database for writing, and creates it if necessary.
pub(crate) fn open(file: &Path, schema: &Schema) -> rusqlite::Result<Connection> {
    if let Some(folder) = file.parent() {
        // If the folder is unusable, opening the file will report it.
        let _ = std::fs::create_dir_all(folder);
    }
    let mut db = Connection::open(file)?;
    db.busy_timeout(BUSY)?;
    // Takes effect only before the first table.
    db.pragma_update(None, "auto_vacuum", "incremental")?;
    db.pragma_update(None, "journal_mode", "wal")?;
    let synchronous = if schema.is_durable { "full" } else { "normal" };
    db.pragma_update(None, "synchronous", synchronous)?;
    db.pragma_update(None, "journal_size_limit", JOURNAL_MAX)?;
    db.pragma_update(None, "cache_size", -4_096)?;
    migrate(&mut db, schema)?;
    Ok(db)
}

fn migrate(db: &mut Connection, schema: &Schema) -> rusqlite::Result<()> {
    let version: i64 = db.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let done = usize::try_from(version).unwrap_or_default();
    if done > schema.migrations.len() {
        return Err(other_schema("of a newer program"));
    }
    for (number, sql) in (1_i64..).zip(schema.migrations).skip(done) {
        let step = db.transaction()?;
        let other = |error: rusqlite::Error| match error.sqlite_error_code() {
            Some(ErrorCode::Unknown) => other_schema("of another program"),
            _ => error,
        };
        step.execute_batch(sql).map_err(other)?;
        step.pragma_update(None, "user_version", number)?;
        step.commit()?;
    }
    let mut find = db.prepare("SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = ?1")?;
    for table in schema.tables {
        if !find.exists([table])? {
            return Err(other_schema("tables are missing"));
        }
    }
    Ok(())
}

/// The application ID of another program's database.
fn other_schema(why: &str) -> rusqlite::Error {
    let error = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_NOTADB);
    rusqlite::Error::SqliteFailure(error, Some(why.to_owned()))
}

/// Opens a database for reading.
pub(crate) fn open_to_read(file: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let db = Connection::open_with_flags(file, flags)?;
    db.busy_timeout(BUSY)?;
    Ok(db)
}

/// Gives so many free pages back to the system.
pub(crate) fn shrink(db: &Connection, pages: i64) -> rusqlite::Result<()> {
    let mut vacuum = db.prepare(&format!("PRAGMA incremental_vacuum({pages})"))?;
    // Each step gives one page back.
    let mut steps = vacuum.query([])?;
    while steps.next()?.is_some() {}
    Ok(())
}

/// Makes a checkpoint and truncates the log; left for later if it is still being read.
pub(crate) fn checkpoint(db: &Connection) -> rusqlite::Result<()> {
    db.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))
}

/// What an error of the database amounts to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DbFault {
    /// The disk is full.
    Full,
    /// The file is not a database, or is broken, or written by a newer program.
    Broken,
    /// Something else; it may be transient.
    Passing,
}

pub(crate) fn trouble(error: &rusqlite::Error) -> DbFault {
    match error.sqlite_error_code() {
        Some(ErrorCode::DiskFull) => DbFault::Full,
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => DbFault::Broken,
        _ => DbFault::Passing,
    }
}

/// Renames a broken database; returns the new name. Only the newest ones are kept.
pub(crate) fn put_aside(file: &Path, now_ms: i64) -> std::io::Result<PathBuf> {
    let name = |suffix: &str| beside(file, &format!(".broken-{now_ms}.db{suffix}"));
    let aside = name("");
    std::fs::rename(file, &aside)?;
    for suffix in JOURNALS {
        // They may not exist.
        let _ = std::fs::rename(with_suffix(file, suffix), name(suffix));
    }
    forget_old(file);
    Ok(aside)
}

/// Removes a database. What can't be removed stays.
pub(crate) fn remove(file: &Path) {
    let _ = std::fs::remove_file(file);
    for suffix in JOURNALS {
        let _ = std::fs::remove_file(with_suffix(file, suffix));
    }
}

/// The path of a file beside a database: `history.db` to `history` and this.
fn beside(file: &Path, rest: &str) -> PathBuf {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    file.with_file_name(format!("{stem}{rest}"))
}

fn with_suffix(file: &Path, suffix: &str) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

fn forget_old(file: &Path) {
    let Some(Ok(entries)) = file.parent().map(std::fs::read_dir) else {
        return;
    };
    let first = beside(file, ".broken-");
    let first = first.file_name().unwrap_or_default().to_string_lossy();
    let mut broken: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.starts_with(&*first) && name.ends_with(".db"))
        .collect();
    broken.sort();
    let too_many = broken.len().saturating_sub(ASIDE_MAX);
    for name in broken.iter().take(too_many) {
        remove(&file.with_file_name(name));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_pages_are_given_back_as_it_is_asked_for() {
        let schema = Schema {
            migrations: &["CREATE TABLE big (bytes BLOB)"],
            tables: &["big"],
            is_durable: false,
        };
        let name = format!("railbus-shrink-{}.db", std::process::id());
        let file = std::env::temp_dir().join(name);
        let db = open(&file, &schema).unwrap();
        let pages = || -> i64 {
            db.pragma_query_value(None, "page_count", |row| row.get(0))
                .unwrap()
        };
        db.execute("INSERT INTO big VALUES (zeroblob(1000000))", [])
            .unwrap();
        db.execute("DELETE FROM big", []).unwrap();
        let before = pages();
        shrink(&db, 100).unwrap();
        assert_eq!(pages(), before - 100);
        shrink(&db, 100_000).unwrap();
        assert!(pages() < 10, "{}", pages());
        drop(db);
        remove(&file);
        assert!(!file.exists());
    }
}
