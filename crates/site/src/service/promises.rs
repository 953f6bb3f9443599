//! What the site has promised to do to outputs later, as a file: whoever ends the process does
//! not end a pulse in the middle of it.

use crate::Config;
use crate::config::Place;
use railbus_device::{Point, PointKind};
use railbus_store::durable;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// The file's name in the folder of the site's state.
const NAME: &str = "promises.json";
/// The longest file that is read or written: a promise has some 100 bytes.
const LEN_MAX: u64 = 4 << 20;

/// What a promise is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Why {
    /// A pulse that is timed here ends.
    Pulse,
    /// Who holds an output does not say so any more.
    Lease,
    /// An output has been on for as long as it may.
    MaxOn,
    /// A module is heard again.
    OnReturn,
    /// An output has been off for as long as it must. Nothing is done then.
    MinOff,
}

impl Why {
    /// Whether it is the policy of an output.
    pub(super) const fn is_policy(self) -> bool {
        matches!(self, Why::OnReturn)
    }
}

/// What a promise is about, and of which output.
pub(super) type Key = (Place, Why);

/// What will be done, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Promise {
    /// The state to bring the output into, if any.
    pub(super) end: Option<bool>,
    /// When, by the clock on the wall: no other one goes on while the process is not there.
    pub(super) at: SystemTime,
    /// How long that was from the beginning.
    pub(super) length: Duration,
}

impl Promise {
    pub(super) fn after(length: Duration, end: Option<bool>) -> Promise {
        let at = SystemTime::now() + length;
        Promise { end, at, length }
    }

    /// How long it is until then. A clock on the wall may have been set: it is never longer than
    /// at the beginning.
    pub(super) fn left(&self) -> Duration {
        let left = self.at.duration_since(SystemTime::now());
        left.unwrap_or_default().min(self.length)
    }

    /// The same where it does not end later than it can by the clock on the wall as it is now.
    pub(super) fn at_most_its_length(self) -> Promise {
        let latest = SystemTime::now() + self.length;
        let at = self.at.min(latest);
        Promise { at, ..self }
    }
}

/// Where a module hangs. Its name alone may stand for another board after a restart.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Board {
    pub(super) line: String,
    pub(super) address: u8,
}

/// The board of each name.
pub(super) type Boards = BTreeMap<String, Board>;

/// What the names of a configuration stand for.
pub(super) fn boards(config: &Config) -> Boards {
    let each = config.modules.iter().map(|(name, module)| {
        let (line, address) = (module.line.clone(), module.setup.address.0);
        (name.clone(), Board { line, address })
    });
    each.collect()
}

/// A promise, and the board that it was made of; none where an earlier version wrote it down.
pub(super) type Kept = (Key, Promise, Option<Board>);

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

/// The file; none where nothing outlives the process.
#[derive(Debug, Default)]
pub(super) struct File {
    folder: Option<PathBuf>,
    /// The version that it has; who writes holds it.
    written: tokio::sync::Mutex<u64>,
}

impl File {
    /// That of a folder, which is made when the first promise is, and what it says. A file that
    /// can't be understood is put aside.
    pub(super) fn open(folder: &Path) -> io::Result<(File, Vec<Kept>)> {
        let path = folder.join(NAME);
        let known = match read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                std::fs::rename(&path, folder.join(format!("{NAME}.unreadable")))?;
                Vec::new()
            }
            known => known?,
        };
        let file = File {
            folder: Some(folder.to_owned()),
            written: tokio::sync::Mutex::default(),
        };
        Ok((file, known))
    }

    /// Which version it has; it stays so while this is held.
    pub(super) async fn written(&self) -> tokio::sync::MutexGuard<'_, u64> {
        self.written.lock().await
    }

    /// Returns when it has this version, or a newer one: `newest` says what is to be written
    /// when it can be. Those that wait meanwhile are served by one write. Gives back which
    /// version it has.
    pub(super) async fn write(
        &self,
        version: u64,
        newest: impl FnOnce() -> (u64, Vec<Kept>),
    ) -> io::Result<u64> {
        let mut written = self.written.lock().await;
        if *written >= version {
            return Ok(*written);
        }
        let (newest, promises) = newest();
        if let Some(folder) = self.folder.clone() {
            let put = move || put(&folder, text(&promises)?.as_bytes());
            let end = tokio::task::spawn_blocking(put).await;
            end.map_err(io::Error::other)??;
        }
        *written = newest;
        Ok(newest)
    }
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

    /// What is longer is not read back, and then all of it would be lost.
    #[tokio::test]
    async fn a_file_is_never_longer_than_one_that_is_read() {
        let unique = format!("railbus-{}-long-promises", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        let _ = std::fs::remove_dir_all(&folder);
        let (file, _) = File::open(&folder).unwrap();
        let kind = PointKind::Output;
        let place = Place::new(&"m".repeat(1 << 10), Point { kind, index: 0 });
        let promise = Promise::after(Duration::from_secs(60), Some(false));
        let one: Kept = ((place, Why::Pulse), promise, None);
        let few = || (1, vec![one.clone(); 3]);
        assert_eq!(file.write(1, few).await.unwrap(), 1);
        let many = || (2, vec![one.clone(); 5_000]);
        let refused = file.write(2, many).await.unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(File::open(&folder).unwrap().1.len(), 3);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_clock_that_was_set_back_makes_nothing_longer() {
        let hour = Duration::from_secs(3_600);
        let promise = Promise {
            end: Some(false),
            at: SystemTime::now() + 100 * hour,
            length: hour,
        };
        assert_eq!(promise.left(), hour);
        // Nor does the next start: it is written down anew.
        let anew = promise.at_most_its_length();
        assert!(anew.at <= SystemTime::now() + hour);
        let over = Promise {
            at: SystemTime::UNIX_EPOCH,
            ..promise
        };
        assert_eq!(over.left(), Duration::ZERO);
    }
}
