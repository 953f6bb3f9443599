//! Commands with a key are carried out once, whoever brings them and over whatever: who comes with
//! the same key again gets the end of the first time, even after a restart. Keys are separate for
//! each caller.
//!
//! The file `keys.log` in the state folder records that a command began before it does, and how it
//! ended. A command that began without a recorded end may have acted: that is reported, and it is
//! not repeated. docs/decisions/0028, 0040

use super::{Service, lock};
use railbus_store::durable;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use sha2::{Digest, Sha256};
use std::cmp::Reverse;
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime};
use tokio::sync::OnceCell;

/// How many keys of all callers are remembered. The caller with the most loses keys first.
const KEYS_MAX: usize = 256;
/// How long they are remembered.
const AGE_MAX: Duration = Duration::from_secs(24 * 60 * 60);
/// The longest key, in bytes.
pub const KEY_LEN_MAX: usize = 128;
/// The file's name in the folder of the site's state.
const NAME: &str = "keys.log";
/// A larger file is not read: this is far more than that many answers need.
const LEN_MAX: u64 = 256 << 20;
/// The file is rewritten without forgotten keys when it has doubled in size, by at least this much.
const SLACK: u64 = 1 << 20;

/// A key that a command is given under.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandKey {
    /// The key, as its caller has it: 1 to [`KEY_LEN_MAX`] bytes.
    pub key: String,
    /// Whose it is. One caller learns nothing of the keys of another.
    pub caller: String,
    /// What it stands for: the same parts are the same command.
    pub command: Vec<Vec<u8>>,
}

/// Why it is not known here how a command with a key ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum KeyRefusal {
    /// The key is none: it is empty or too long. Nothing was sent.
    BadKey,
    /// The key stands for another command. Nothing was sent.
    OtherCommand,
    /// So many commands with keys are under way that none can be forgotten. Nothing was sent.
    TooMany,
    /// It can't be written down that the command begins, for this reason of the system. Nothing
    /// was sent.
    NotKept(String),
    /// It began, and its end is not known: the program was killed, or the command broke off. It may
    /// have acted.
    Begun,
}

/// What is known of a command with a key.
#[derive(Clone, Debug, PartialEq)]
pub enum KeyTold {
    /// How it ended, in the words of who gave it.
    Ended(Json),
    /// As [`KeyRefusal::Begun`].
    Begun,
    /// It is under way.
    UnderWay,
    /// It was not begun.
    Never,
    /// That is not known: keys were forgotten since, or the process was started since.
    Forgotten,
}

/// How a command ended, in the words of who gave it; none where it broke off.
type Ended = Option<Json>;

type Slot = Arc<OnceCell<Ended>>;

/// A caller's key, and the command it stands for.
#[derive(Debug)]
struct Known {
    key: String,
    who: String,
    command: String,
    /// When it was first used, or this process started; and how old it was then. Setting the system
    /// clock while the process runs changes nothing.
    since: Instant,
    aged: Duration,
    slot: Slot,
}

impl Known {
    /// Whether its command is in progress; without the key it would be carried out again.
    fn is_under_way(&self) -> bool {
        !self.slot.initialized() && Arc::strong_count(&self.slot) > 1
    }

    fn is_old(&self, now: Instant) -> bool {
        now.duration_since(self.since) + self.aged > AGE_MAX
    }
}

/// The newest keys.
#[derive(Debug)]
struct KnownKeys {
    keys: VecDeque<Known>,
    /// When the newest of the forgotten ones was first used.
    forgotten: Option<Instant>,
}

/// The newest keys, and the file that outlives the process.
#[derive(Debug)]
pub(super) struct Once {
    known: Mutex<KnownKeys>,
    /// The file; or why it can't be written.
    file: Result<Arc<Mutex<KeyFile>>, String>,
}

impl KnownKeys {
    fn find(&self, who: &str, key: &str) -> Option<&Known> {
        let mut keys = self.keys.iter();
        keys.find(|one| one.who == who && one.key == key)
    }
}

impl Service {
    /// Carries something out once under a key. Who comes with the same key again, also while it is
    /// under way and after a restart, gets what the first one got, and its `work` is dropped. That
    /// it begins is durable before it does; it goes on where nobody waits any more.
    ///
    /// What `work` does it does with a handle of its own, whose rights are asked as ever. Who was
    /// told of rights that are gone is not told of ends either: that is for the caller to ask
    /// before.
    ///
    /// # Errors
    /// [`KeyRefusal`].
    pub async fn once(
        &self,
        key: CommandKey,
        work: impl Future<Output = Json> + Send + 'static,
    ) -> Result<Json, KeyRefusal> {
        let once = Arc::clone(&self.inner.once);
        let task = self
            .inner
            .runtime
            .spawn(async move { once.carry_out(key, work).await });
        // It panics nowhere; the runtime may shut down.
        task.await.unwrap_or(Err(KeyRefusal::Begun))
    }

    /// What is known of a command, without carrying it out. It was given at this time or later;
    /// none if that may have been before this process was started.
    ///
    /// # Errors
    /// [`KeyRefusal::OtherCommand`].
    pub fn told(&self, key: &CommandKey, given: Option<Instant>) -> Result<KeyTold, KeyRefusal> {
        self.inner.once.told(key, given)
    }

    /// Why no command with a key is carried out, where its beginning can't be written down.
    #[must_use]
    pub fn keys_failed(&self) -> Option<String> {
        self.inner.once.file.as_ref().err().cloned()
    }
}

impl Once {
    /// The keys of a state folder. If they can't be written, nothing is carried out under a key.
    pub(super) fn open(folder: Option<&Path>) -> Once {
        let opened = match folder {
            Some(folder) => KeyFile::open(folder).map_err(|why| why.to_string()),
            None => Err("the site has no folder".to_owned()),
        };
        let (file, rows) = match opened {
            Ok((file, rows)) => (Ok(Arc::new(Mutex::new(file))), rows),
            Err(why) => (Err(why), Vec::new()),
        };
        let (since, today) = (Instant::now(), SystemTime::now());
        let known = rows.into_iter().map(|row| Known {
            since,
            aged: row.begin.age(today),
            slot: Arc::new(OnceCell::new_with(Some(row.answer))),
            key: row.begin.key,
            who: row.begin.who,
            command: row.begin.command,
        });
        Once {
            known: Mutex::new(KnownKeys {
                keys: known.collect(),
                forgotten: None,
            }),
            file,
        }
    }

    /// Carries this out once per key. A command is identified by its caller and its content.
    async fn carry_out(
        &self,
        key: CommandKey,
        work: impl Future<Output = Json> + Send + 'static,
    ) -> Result<Json, KeyRefusal> {
        let CommandKey {
            key,
            caller: who,
            command,
        } = key;
        if !(1..=KEY_LEN_MAX).contains(&key.len()) {
            return Err(KeyRefusal::BadKey);
        }
        let command = digest(&who, &command);
        let slot = self.slot(&key, &who, &command, Instant::now())?;
        let begin = || async {
            let row = Row::Begin(Begin {
                key: key.clone(),
                who: who.clone(),
                command,
                at_ms: millis(SystemTime::now()),
            });
            self.write(row).await.map_err(KeyRefusal::NotKept)?;
            // On a task of its own: if it panics, it has ended all the same.
            let answer = tokio::spawn(work).await.ok();
            if let Some(answer) = answer.clone() {
                let who = Some(who.clone());
                let key = key.clone();
                // If the disk fails, a restart forgets the answer, but not that it began.
                let _ = self.write(Row::End { key, who, answer }).await;
            }
            Ok(answer)
        };
        let ended = slot.get_or_try_init(begin).await.cloned();
        let ended = ended.inspect_err(|_| self.forget(&slot))?;
        ended.ok_or(KeyRefusal::Begun)
    }

    fn told(&self, key: &CommandKey, given: Option<Instant>) -> Result<KeyTold, KeyRefusal> {
        let known = lock(&self.known);
        if let Some(one) = known.find(&key.caller, &key.key) {
            if one.command != digest(&key.caller, &key.command) {
                return Err(KeyRefusal::OtherCommand);
            }
            return Ok(match one.slot.get() {
                Some(Some(answer)) => KeyTold::Ended(answer.clone()),
                Some(None) => KeyTold::Begun,
                None => KeyTold::UnderWay,
            });
        }
        let is_later = |given| known.forgotten.is_none_or(|newest| newest < given);
        let is_known = given.is_some_and(is_later);
        Ok(match is_known {
            true => KeyTold::Never,
            false => KeyTold::Forgotten,
        })
    }

    /// A command that could not begin needs no key any more, unless another caller waits for it:
    /// it must not push out those that began.
    fn forget(&self, slot: &Slot) {
        let mut known = lock(&self.known);
        // Others come by the table only, which is locked: its own and this.
        let is_needed = slot.initialized() || Arc::strong_count(slot) > 2;
        known
            .keys
            .retain(|one| is_needed || !Arc::ptr_eq(&one.slot, slot));
    }

    /// The slot for the result of the command under this key.
    fn slot(&self, key: &str, who: &str, command: &str, now: Instant) -> Result<Slot, KeyRefusal> {
        let mut known = lock(&self.known);
        let KnownKeys { keys, forgotten } = &mut *known;
        keys.retain(|one| {
            let is_kept = one.is_under_way() || !one.is_old(now);
            if !is_kept {
                *forgotten = (*forgotten).max(Some(one.since));
            }
            is_kept
        });
        if let Some(one) = known.find(who, key) {
            if one.command == command {
                return Ok(Arc::clone(&one.slot));
            }
            return Err(KeyRefusal::OtherCommand);
        }
        if known.keys.len() >= KEYS_MAX {
            let each = known.keys.iter();
            let each = each.map(|one| (&*one.who, !one.is_under_way()));
            let over = gives_way(each, who).ok_or(KeyRefusal::TooMany)?;
            let gone = known.keys.remove(over).map(|gone| gone.since);
            known.forgotten = known.forgotten.max(gone);
        }
        let slot = Slot::default();
        known.keys.push_back(Known {
            key: key.to_owned(),
            who: who.to_owned(),
            command: command.to_owned(),
            since: now,
            aged: Duration::ZERO,
            slot: Arc::clone(&slot),
        });
        Ok(slot)
    }

    /// Writes a row without blocking. When this returns, the beginning of a command is durable, and
    /// an answer survives the process.
    async fn write(&self, row: Row) -> Result<(), String> {
        let file = Arc::clone(self.file.as_ref().map_err(String::clone)?);
        let write = move || lock(&file).add(&row);
        let end = tokio::task::spawn_blocking(write).await;
        let end = end.unwrap_or_else(|error| Err(io::Error::other(error)));
        end.map_err(|error| error.to_string())
    }
}

/// Which key is dropped for a new one of this caller, given the owner of each and whether it may be
/// dropped: the oldest of the caller that has the most. Callers with fewer keys than this one would
/// then have lose none.
fn gives_way<'a>(
    keys: impl Iterator<Item = (&'a str, bool)> + Clone,
    asker: &str,
) -> Option<usize> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::from([(asker, 1)]);
    for (who, _) in keys.clone() {
        *counts.entry(who).or_default() += 1;
    }
    let own = counts.get(asker).copied().unwrap_or_default();
    let count = |who: &str| counts.get(who).copied().unwrap_or_default();
    let may_go = keys.enumerate().filter(|(_, (_, may_go))| *may_go);
    let may_go = may_go.map(|(at, (who, _))| (at, count(who)));
    let may_go = may_go.filter(|(_, count)| *count >= own);
    // Of equal ones the first, which is the oldest.
    let most = may_go.min_by_key(|(_, count)| Reverse(*count));
    most.map(|(at, _)| at)
}

fn millis(at: SystemTime) -> u64 {
    let since = at.duration_since(SystemTime::UNIX_EPOCH);
    u64::try_from(since.unwrap_or_default().as_millis()).unwrap_or(u64::MAX)
}

/// A hash of caller and content: each part with its length, so that they can't run into each other.
fn digest(who: &str, command: &[Vec<u8>]) -> String {
    let mut hash = Sha256::new();
    let parts = command.iter().map(Vec::as_slice);
    for part in [who.as_bytes()].into_iter().chain(parts) {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    let mut text = String::new();
    for byte in hash.finalize() {
        // Writing into a String does not fail.
        let _ = write!(text, "{byte:02x}");
    }
    text
}

/// A line of the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Row {
    /// A command is about to begin.
    Begin(Begin),
    /// The answer.
    End {
        key: String,
        /// None in files of a version in which keys had no owner.
        #[serde(default)]
        who: Option<String>,
        answer: Json,
    },
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Begin {
    key: String,
    who: String,
    command: String,
    at_ms: u64,
}

impl Begin {
    /// How long ago that was, by the system clock: no other clock runs while the process does not.
    fn age(&self, today: SystemTime) -> Duration {
        self.age_at(millis(today))
    }

    /// How long before this time it was, in milliseconds since 1970.
    const fn age_at(&self, at_ms: u64) -> Duration {
        Duration::from_millis(at_ms.saturating_sub(self.at_ms))
    }
}

/// A key as found in the file.
struct Kept {
    begin: Begin,
    answer: Ended,
}

impl Kept {
    fn is_of(&self, key: &str, who: Option<&str>) -> bool {
        self.begin.key == key && who.is_none_or(|who| self.begin.who == who)
    }
}

/// The file, open for writing. The daemon that has locked the accounts of the folder has it, too.
#[derive(Debug)]
struct KeyFile {
    path: PathBuf,
    file: File,
    len: u64,
    /// Its size when it was last rewritten.
    new: u64,
    /// A failed write could not be removed completely: the next line starts with a newline.
    is_torn: bool,
}

impl KeyFile {
    fn open(folder: &Path) -> io::Result<(KeyFile, Vec<Kept>)> {
        durable::folder(folder)?;
        let path = folder.join(NAME);
        let kept = rewrite(&path, |kept| {
            let today = SystemTime::now();
            kept.retain(|one| one.begin.age(today) <= AGE_MAX);
            for one in kept {
                // If the clock was set back, no key lasts longer, not even after the next start.
                one.begin.at_ms = one.begin.at_ms.min(millis(today));
            }
        })?;
        let file = append_to(&path)?;
        let len = file.metadata()?.len();
        let file = KeyFile {
            path,
            file,
            len,
            new: len,
            is_torn: false,
        };
        Ok((file, kept))
    }

    fn add(&mut self, row: &Row) -> io::Result<()> {
        if self.len > 2 * self.new + SLACK {
            rewrite(&self.path, |_| {})?;
            self.file = append_to(&self.path)?;
            self.len = self.file.metadata()?.len();
            self.new = self.len;
            self.is_torn = false;
        }
        let mut line = Vec::new();
        if self.is_torn {
            self.len = self.file.metadata()?.len();
            line.push(b'\n');
        }
        serde_json::to_writer(&mut line, row)?;
        line.push(b'\n');
        let written = self.file.write_all(&line).and_then(|()| match row {
            Row::Begin(_) => self.file.sync_data(),
            Row::End { .. } => Ok(()),
        });
        match written {
            Ok(()) => (self.len, self.is_torn) = (self.len + line.len() as u64, false),
            // A partial line would damage the one after it.
            Err(_) => self.is_torn |= self.file.set_len(self.len).is_err(),
        }
        written
    }
}

fn append_to(path: &Path) -> io::Result<File> {
    OpenOptions::new().append(true).mode(0o600).open(path)
}

/// Reads the keys, drops those that are forgotten, and rewrites the file. A last line that was
/// truncated by a loss of power began nothing.
fn rewrite(path: &Path, change: impl FnOnce(&mut Vec<Kept>)) -> io::Result<Vec<Kept>> {
    let bytes = match std::fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
        Err(error) => return Err(error),
        Ok(file) if file.len() > LEN_MAX => return Err(io::ErrorKind::FileTooLarge.into()),
        Ok(_) => std::fs::read(path)?,
    };
    let mut kept = fold(&bytes);
    change(&mut kept);
    let mut text = Vec::new();
    for one in &kept {
        let begin = Row::Begin(one.begin.clone());
        let end = one.answer.clone().map(|answer| Row::End {
            key: one.begin.key.clone(),
            who: Some(one.begin.who.clone()),
            answer,
        });
        for row in [Some(begin), end].into_iter().flatten() {
            serde_json::to_writer(&mut text, &row)?;
            text.push(b'\n');
        }
    }
    durable::replace(path, &text, Some(0o600))?;
    Ok(kept)
}

/// The newest keys in the lines of the file.
fn fold(bytes: &[u8]) -> Vec<Kept> {
    let mut kept: Vec<Kept> = Vec::new();
    for line in bytes.split(|byte| *byte == b'\n') {
        match serde_json::from_slice(line) {
            Ok(Row::Begin(begin)) => {
                kept.retain(|one| !one.is_of(&begin.key, Some(&begin.who)));
                if kept.len() >= KEYS_MAX {
                    // Keys that were forgotten by then displace none that were not.
                    let old = kept
                        .iter()
                        .position(|one| one.begin.age_at(begin.at_ms) > AGE_MAX);
                    let ended = kept.iter();
                    let ended = ended.map(|one| (&*one.begin.who, one.answer.is_some()));
                    // While none has ended, the result of none is known.
                    let all = kept.iter().map(|one| (&*one.begin.who, true));
                    let over = old.or_else(|| gives_way(ended, &begin.who));
                    let over = over.or_else(|| gives_way(all, &begin.who));
                    kept.remove(over.unwrap_or_default());
                }
                let answer = None;
                kept.push(Kept { begin, answer });
            }
            Ok(Row::End { key, who, answer }) => {
                let mut newest = kept.iter_mut().rev();
                if let Some(one) = newest.find(|one| one.is_of(&key, who.as_deref())) {
                    one.answer = Some(answer);
                }
            }
            Err(_) => {}
        }
    }
    kept
}

#[cfg(test)]
mod tests;
