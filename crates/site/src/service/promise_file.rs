//! The scheduled actions of the site as a file: a pulse ends even if the process does not live
//! until then.

use crate::config::Place;
use crate::core::{Board, Kept, Promise, Why};
use railbus_device::{Point, PointKind};
use railbus_store::durable;
use serde::{Deserialize, Serialize};
use std::io::{self, Read};
use std::path::Path;
use std::time::{Duration, SystemTime};

/// The file's name in the folder of the site's state.
const NAME: &str = "promises.json";
/// The longest file that is read or written: a promise has some 100 bytes.
const LEN_MAX: u64 = 4 << 20;

/// A promise as the file has it.
#[derive(Serialize, Deserialize)]
struct Row {
    module: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    board: Option<Board>,
    output: u8,
    why: Why,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    end: Option<bool>,
    at_ms: u64,
    length_ms: u64,
}

#[derive(Serialize, Deserialize)]
struct Document {
    schema: u8,
    promises: Vec<Row>,
}

/// What the file of a folder says, which is made when the first promise is. One that can't be
/// understood is put aside.
pub(super) fn open(folder: &Path) -> io::Result<Vec<Kept>> {
    let path = folder.join(NAME);
    match read(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) if error.kind() == io::ErrorKind::InvalidData => {
            std::fs::rename(&path, folder.join(format!("{NAME}.unreadable")))?;
            Ok(Vec::new())
        }
        known => known,
    }
}

/// Writes the file of a folder anew; it is durable when this returns.
pub(super) fn write(folder: &Path, promises: &[Kept]) -> io::Result<()> {
    put(folder, text(promises)?.as_bytes())
}

fn text(promises: &[Kept]) -> io::Result<String> {
    let millis = |time: Duration| u64::try_from(time.as_millis()).unwrap_or(u64::MAX);
    let promises = promises.iter().map(|((place, why), promise, board)| Row {
        module: place.module.clone(),
        board: board.clone(),
        output: place.point.index,
        why: *why,
        end: promise.end,
        at_ms: millis(
            promise
                .at
                .duration_since(SystemTime::UNIX_EPOCH)
                .unwrap_or_default(),
        ),
        length_ms: millis(promise.length),
    });
    let document = Document {
        schema: 1,
        promises: promises.collect(),
    };
    Ok(serde_json::to_string(&document)?)
}

fn read(path: &Path) -> io::Result<Vec<Kept>> {
    let mut text = String::new();
    std::fs::File::open(path)?
        .take(LEN_MAX)
        .read_to_string(&mut text)?;
    let document: Document = serde_json::from_str(&text)
        .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
    let known = document.promises.into_iter().filter_map(|row| {
        let point = Point {
            kind: PointKind::Output,
            index: row.output,
        };
        let since = Duration::from_millis(row.at_ms);
        let promise = Promise {
            end: row.end,
            at: SystemTime::UNIX_EPOCH.checked_add(since)?,
            length: Duration::from_millis(row.length_ms),
        };
        let key = (Place::new(&row.module, point), row.why);
        Some((key, promise, row.board))
    });
    Ok(known.collect())
}

fn put(folder: &Path, bytes: &[u8]) -> io::Result<()> {
    if u64::try_from(bytes.len()).is_ok_and(|len| len > LEN_MAX) {
        // It would not be read, and nothing of what it promises done.
        return Err(io::ErrorKind::FileTooLarge.into());
    }
    durable::folder(folder)?;
    durable::replace(&folder.join(NAME), bytes, Some(0o600))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Place;

    fn folder(name: &str) -> std::path::PathBuf {
        let unique = format!("railbus-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        let _ = std::fs::remove_dir_all(&folder);
        folder
    }

    /// What is longer is not read back, and then all of it would be lost.
    #[test]
    fn a_file_is_never_longer_than_one_that_is_read() {
        let folder = folder("long-promises");
        let kind = PointKind::Output;
        let place = Place::new(&"m".repeat(1 << 10), Point { kind, index: 0 });
        let promise = Promise::after(SystemTime::now(), Duration::from_secs(60), Some(false));
        let one: Kept = ((place, Why::Pulse), promise, None);
        write(&folder, &vec![one.clone(); 3]).unwrap();
        let refused = write(&folder, &vec![one; 5_000]).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(open(&folder).unwrap().len(), 3);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_file_that_can_not_be_understood_is_put_aside() {
        let folder = folder("unreadable-promises");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(NAME), "{").unwrap();
        assert!(open(&folder).unwrap().is_empty());
        assert!(folder.join("promises.json.unreadable").exists());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
