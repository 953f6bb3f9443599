//! What the site has promised to do to outputs later, kept in a file: whoever ends the process
//! does not end a pulse in the middle of it.

use super::lock;
use crate::config::Place;
use crate::durable;
use railbus_device::{Point, PointKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, SystemTime};

/// The file's name in the folder of the site's state.
const NAME: &str = "promises.json";
/// The longest file that is read: a promise has some 100 bytes.
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
    /// An output has been off for as long as it must. Nothing is done then.
    MinOff,
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
}

/// A promise as the file has it.
#[derive(Serialize, Deserialize)]
struct Row {
    module: String,
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

/// All promises: at most one of each kind for an output.
#[derive(Debug, Default)]
pub(super) struct Promises {
    folder: Option<PathBuf>,
    made: Mutex<Made>,
    /// The version that the file has; who writes holds it.
    written: tokio::sync::Mutex<u64>,
}

#[derive(Debug, Default)]
struct Made {
    /// Each with the number of whoever made it: a newer one counts, whoever comes first.
    by_key: BTreeMap<Key, (u64, Promise)>,
    version: u64,
}

impl Promises {
    /// Those of a folder, which is made when the first promise is. A file that can't be
    /// understood is put aside.
    pub(super) fn open(folder: &Path) -> io::Result<Promises> {
        let path = folder.join(NAME);
        let by_key = match read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => BTreeMap::new(),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                std::fs::rename(&path, folder.join(format!("{NAME}.unreadable")))?;
                BTreeMap::new()
            }
            known => known?,
        };
        Ok(Promises {
            folder: Some(folder.to_owned()),
            made: Mutex::new(Made { by_key, version: 0 }),
            written: tokio::sync::Mutex::default(),
        })
    }

    /// All of them.
    pub(super) fn all(&self) -> Vec<(Key, Promise)> {
        let made = lock(&self.made);
        let each = made.by_key.iter();
        each.map(|(key, (_, promise))| (key.clone(), *promise))
            .collect()
    }

    /// What becomes of an output at the end of what was promised, where anything was.
    pub(super) fn end_of(&self, key: &Key) -> Option<Option<bool>> {
        let made = lock(&self.made);
        made.by_key.get(key).map(|(_, promise)| promise.end)
    }

    /// How long it was from the beginning until what was promised, where anything was.
    pub(super) fn length_of(&self, key: &Key) -> Option<Duration> {
        let made = lock(&self.made);
        made.by_key.get(key).map(|(_, promise)| promise.length)
    }

    /// Makes a promise, unless there is a newer one; it is on the disk when this returns.
    pub(super) async fn make(&self, key: &Key, number: u64, promise: Promise) -> io::Result<()> {
        let made = self.change(|made| {
            if made.get(key).is_none_or(|(there, _)| *there <= number) {
                made.insert(key.clone(), (number, promise));
            }
        });
        let end = self.write(made).await;
        if end.is_err() {
            self.change(|made| take_out(made, key, number));
        }
        end
    }

    /// A promise was kept, or does not hold any more; a newer one still does. Where the disk
    /// refuses, it is done once more after a restart, which an output that was released already
    /// does not mind.
    pub(super) async fn drop(&self, key: &Key, number: u64) {
        let changed = self.change(|made| take_out(made, key, number));
        let _ = self.write(changed).await;
    }

    /// Says how long outputs must stay off yet, in place of what was said before.
    pub(super) async fn must_stay_off(&self, outputs: Vec<(Place, Duration)>) {
        let changed = self.change(|made| {
            made.retain(|(_, why), _| *why != Why::MinOff);
            let each = outputs.into_iter();
            made.extend(
                each.map(|(place, left)| ((place, Why::MinOff), (0, Promise::after(left, None)))),
            );
        });
        let _ = self.write(changed).await;
    }

    fn change<T>(&self, how: impl FnOnce(&mut BTreeMap<Key, (u64, Promise)>) -> T) -> u64 {
        let mut made = lock(&self.made);
        how(&mut made.by_key);
        made.version += 1;
        made.version
    }

    /// Returns when the file has this version, or a newer one.
    async fn write(&self, version: u64) -> io::Result<()> {
        let Some(folder) = &self.folder else {
            return Ok(());
        };
        let mut written = self.written.lock().await;
        if *written >= version {
            return Ok(());
        }
        let (text, newest) = {
            let made = lock(&self.made);
            (text(&made.by_key)?, made.version)
        };
        let folder = folder.clone();
        let end = tokio::task::spawn_blocking(move || put(&folder, text.as_bytes())).await;
        end.map_err(io::Error::other)??;
        *written = newest;
        Ok(())
    }
}

fn take_out(made: &mut BTreeMap<Key, (u64, Promise)>, key: &Key, number: u64) {
    if made.get(key).is_some_and(|(there, _)| *there <= number) {
        made.remove(key);
    }
}

fn text(made: &BTreeMap<Key, (u64, Promise)>) -> io::Result<String> {
    let millis = |time: Duration| u64::try_from(time.as_millis()).unwrap_or(u64::MAX);
    let promises = made.iter().map(|((place, why), (_, promise))| Row {
        module: place.module.clone(),
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

fn read(path: &Path) -> io::Result<BTreeMap<Key, (u64, Promise)>> {
    let mut text = String::new();
    File::open(path)?.take(LEN_MAX).read_to_string(&mut text)?;
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
        Some(((Place::new(&row.module, point), row.why), (0, promise)))
    });
    Ok(known.collect())
}

fn put(folder: &Path, bytes: &[u8]) -> io::Result<()> {
    durable::folder(folder)?;
    durable::replace(&folder.join(NAME), bytes, Some(0o600))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(index: u8, why: Why) -> Key {
        let kind = PointKind::Output;
        (Place::new("oven", Point { kind, index }), why)
    }

    #[tokio::test]
    async fn promises_outlive_who_made_them() {
        let folder = std::env::temp_dir().join(format!("railbus-promises-{}", std::process::id()));
        let promises = Promises::open(&folder).unwrap();
        let pulse = Promise::after(Duration::from_secs(60), Some(false));
        promises.make(&key(0, Why::Pulse), 1, pulse).await.unwrap();
        promises.make(&key(1, Why::Lease), 2, pulse).await.unwrap();
        promises
            .must_stay_off(vec![(key(2, Why::MinOff).0, Duration::from_secs(9))])
            .await;
        promises.drop(&key(1, Why::Lease), 2).await;

        let again = Promises::open(&folder).unwrap().all();
        let keys: Vec<&Key> = again.iter().map(|(key, _)| key).collect();
        assert_eq!(keys, [&key(0, Why::Pulse), &key(2, Why::MinOff)]);
        let left = again[0].1.left();
        assert!(left <= Duration::from_secs(60) && left > Duration::ZERO);
        assert_eq!(again[0].1.end, Some(false));

        std::fs::write(folder.join(NAME), "{").unwrap();
        assert_eq!(Promises::open(&folder).unwrap().all(), []);
        assert!(folder.join(format!("{NAME}.unreadable")).exists());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// Tasks come in any order: the end of an older pulse is not the end of a newer one.
    #[tokio::test]
    async fn a_newer_promise_stands_whoever_comes_late() {
        let promises = Promises::default();
        let pulse = |seconds| Promise::after(Duration::from_secs(seconds), Some(false));
        let key = key(0, Why::Pulse);
        promises.make(&key, 2, pulse(9)).await.unwrap();
        promises.make(&key, 1, pulse(60)).await.unwrap();
        promises.drop(&key, 1).await;
        let all = promises.all();
        assert_eq!(all.len(), 1);
        assert_eq!(all[0].1.length, Duration::from_secs(9));
        promises.drop(&key, 2).await;
        assert_eq!(promises.all(), []);
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
        let over = Promise {
            at: SystemTime::UNIX_EPOCH,
            ..promise
        };
        assert_eq!(over.left(), Duration::ZERO);
    }
}
