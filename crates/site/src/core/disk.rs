//! Which scheduled actions are on the disk. There is one write at a time, of all of them; a caller
//! that waits for a version gets the result of the first write that contains it.

use super::Now;
use super::context::{Context, TaskId};
use super::promises::Kept;
use super::schedule::{Action, Schedule};
use railbus_wire::Micros;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::time::{Duration, SystemTime};

/// A failed write is retried after this time: what is on the disk may be out of date.
const WRITE_AGAIN: Micros = Micros::from_secs(1);

/// A wall clock that is off by more than this was set.
const CLOCK_SET: Duration = Duration::from_millis(500);

/// Which changes are on the disk.
#[derive(Debug, Default)]
pub(super) struct Disk {
    /// Counts the changes: the file has all up to one of them.
    pub(super) version: u64,
    written: u64,
    /// The version that is being written.
    writing: Option<u64>,
    /// Nobody waits for it, but it has to be written.
    pub(super) soon: bool,
    /// The last write failed, and is retried then.
    again_at: Option<Micros>,
    /// When the site began by the wall clock, since 1970. It changes when that clock is set.
    began: Duration,
    newest: u64,
    waiting: BTreeMap<u64, Waiting>,
}

/// A caller that waits for a version.
#[derive(Debug)]
struct Waiting {
    version: u64,
    task: TaskId,
    end: Option<Result<(), ErrorKind>>,
}

impl Schedule {
    /// What is to be written now, where somebody waits for it and nothing is on its way.
    pub(super) fn next_write(&mut self, now: Now) -> Option<Vec<Kept>> {
        self.follow_clock(now);
        let disk = &self.disk;
        let again = disk.again_at.is_some_and(|at| at <= now.site);
        let is_wanted = (disk.soon || again) && disk.version > disk.written
            || disk.waiting.values().any(|waiting| waiting.end.is_none());
        if disk.writing.is_some() || !is_wanted {
            return None;
        }
        self.disk.again_at = None;
        self.disk.soon = false;
        self.disk.writing = Some(self.disk.version);
        Some(self.promises(now))
    }

    /// After the wall clock was set, the disk has wrong ends of the pulses that modules time.
    fn follow_clock(&mut self, now: Now) {
        let wall = now.wall.duration_since(SystemTime::UNIX_EPOCH);
        let running = Duration::from_micros(now.site.0);
        let began = wall.unwrap_or_default().saturating_sub(running);
        if began.abs_diff(self.disk.began) > CLOCK_SET {
            self.disk.began = began;
            if self.own_pulses.any(now.site) {
                self.disk.version += 1;
                self.disk.soon = true;
            }
        }
    }

    /// When the disk is tried again that has refused.
    pub(super) const fn writes_again_at(&self) -> Option<Micros> {
        self.disk.again_at
    }

    /// A write has ended.
    pub(super) fn written(&mut self, end: Result<(), ErrorKind>, now: Micros) {
        let Some(version) = self.disk.writing.take() else {
            return;
        };
        if end.is_err() {
            self.disk.again_at = Some(now + WRITE_AGAIN);
        } else {
            self.disk.written = version;
            let is_gone =
                |_: &u64, action: &mut Action| action.left_out.is_some_and(|at| at <= version);
            let gone = self.by_number.extract_if(.., is_gone);
            self.woken
                .extend(gone.filter_map(|(_, action)| action.task));
        }
        for waiting in self.disk.waiting.values_mut() {
            if waiting.end.is_none() && waiting.version <= version {
                waiting.end = Some(end);
                self.woken.push(waiting.task);
            }
        }
    }
}

impl Context {
    /// Writes all of it as it is now.
    ///
    /// # Errors
    /// Why the write failed.
    pub(crate) async fn keep(&self) -> Result<(), ErrorKind> {
        let number = self.with(|state| {
            let (task, disk) = (state.runs.current, &mut state.schedule.disk);
            let version = disk.version;
            let end = (disk.written >= version).then_some(Ok(()));
            disk.newest += 1;
            disk.waiting
                .insert(disk.newest, Waiting { version, task, end });
            disk.newest
        });
        let waits = Keeping(self.clone(), number);
        self.wait(|state| state.schedule.disk.waiting.get(&waits.1)?.end)
            .await
    }
}

/// Somebody waits for the disk until this is dropped.
struct Keeping(Context, u64);

impl Drop for Keeping {
    fn drop(&mut self) {
        self.0
            .with(|state| state.schedule.disk.waiting.remove(&self.1));
    }
}
