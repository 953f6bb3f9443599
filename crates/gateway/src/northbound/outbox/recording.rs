//! What is written to an outbox: changes, gaps, and after a gap everything.

use railbus_app::api::convert;
use railbus_site::{Batch, Picture, PointQuality, PointStatus};
use railbus_store::history::millis;
use railbus_store::outbox::{EntryKind, OutboxEntry};
use std::collections::{BTreeMap, BTreeSet};
use std::time::SystemTime;

/// With so many entries it is written at once.
const WRITE_MAX: usize = 8_192;
/// So many wait while the disk fails, besides one of each point.
const WAITING_MAX: usize = 16_384;

/// Why changes may be missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum GapReason {
    /// The outlet did not run.
    Stopped,
    /// The site was faster than the disk.
    Overrun,
    /// The disk could not be written.
    Disk,
}

impl GapReason {
    const fn name(self) -> &'static str {
        match self {
            GapReason::Stopped => "stopped",
            GapReason::Overrun => "overrun",
            GapReason::Disk => "disk",
        }
    }
}

/// What is to be written.
pub(super) struct Recording {
    /// Whether the outlet tells of a module.
    has: Box<dyn Fn(&str) -> bool + Send>,
    /// How every point is, by its path.
    now: BTreeMap<String, OutboxEntry>,
    waiting: Vec<OutboxEntry>,
    /// Changes are missing before what waits.
    gap: Option<GapReason>,
    /// Until when everything is on the disk, in milliseconds since 1970.
    written: Option<i64>,
    /// Nothing is known yet of what the file has.
    is_new: bool,
    /// There was a picture of all points.
    is_known: bool,
}

impl Recording {
    pub(super) fn new(has: Box<dyn Fn(&str) -> bool + Send>) -> Recording {
        Recording {
            has,
            now: BTreeMap::new(),
            waiting: Vec::new(),
            gap: Some(GapReason::Stopped),
            written: None,
            is_new: true,
            is_known: false,
        }
    }

    /// Whether it is known how every point is.
    pub(super) const fn is_known(&self) -> bool {
        self.is_known
    }

    /// How every point is, as far as it is known.
    pub(super) fn now(&self) -> Vec<OutboxEntry> {
        self.now.values().cloned().collect()
    }

    /// Whether something is to be written.
    pub(super) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty() || self.gap.is_some()
    }

    /// Whether it should be written at once.
    pub(super) fn is_full(&self) -> bool {
        self.waiting.len() >= WRITE_MAX
    }

    /// A file was opened that has everything until this time; none if it is a new one.
    pub(super) fn opened(&mut self, known_until: Option<i64>) {
        if !self.is_new {
            // It is another one than before: what is in it is not what was written.
            self.anew(GapReason::Disk);
        }
        self.is_new = false;
        self.written = known_until;
    }

    /// How everything is, after so many changes that are not known.
    pub(super) fn picture(&mut self, picture: &Picture, missed: u64) {
        self.is_known = true;
        if missed > 0 {
            self.anew(GapReason::Overrun);
        }
        let mut before: BTreeSet<String> = self.now.keys().cloned().collect();
        for status in &picture.points {
            self.point(status, picture.at);
            before.remove(&path_of(status));
        }
        for path in before {
            self.now.remove(&path);
            self.push(OutboxEntry {
                at: millis(picture.at),
                what: EntryKind::Reading {
                    path,
                    value: None,
                    quality: "bad".to_owned(),
                    reason: Some("removed".to_owned()),
                    time: None,
                },
            });
        }
    }

    /// What changed.
    pub(super) fn batch(&mut self, batch: &Batch) {
        for reading in &batch.points {
            self.point(&reading.status, reading.at);
        }
    }

    fn point(&mut self, status: &PointStatus, at: SystemTime) {
        if !(self.has)(&status.module) {
            return;
        }
        let entry = reading(status, at);
        let is_same = self
            .now
            .get(&path_of(status))
            .is_some_and(|known| is_same(&known.what, &entry.what));
        if !is_same {
            self.now.insert(path_of(status), entry.clone());
            self.push(entry);
        }
    }

    fn push(&mut self, entry: OutboxEntry) {
        // After a gap everything is told anyway.
        if self.gap.is_none() {
            self.waiting.push(entry);
            if self.waiting.len() > WAITING_MAX + self.now.len() {
                self.anew(GapReason::Disk);
            }
        }
    }

    /// Every point is told as it is, though nothing is new.
    pub(super) fn tell_all(&mut self) {
        if self.gap.is_none() {
            self.waiting.extend(self.now.values().cloned());
        }
    }

    /// Changes are missing from here on, until everything is told anew.
    fn anew(&mut self, why: GapReason) {
        self.waiting.clear();
        self.gap.get_or_insert(why);
    }

    /// What is to be written now.
    pub(super) fn waiting(&mut self, now: SystemTime) -> &[OutboxEntry] {
        if let Some(why) = self.gap.take() {
            let now = millis(now);
            self.waiting.clear();
            if self.written.is_some() || why != GapReason::Stopped {
                self.waiting.push(OutboxEntry {
                    at: now,
                    what: EntryKind::Gap {
                        // The clock may have been ahead then.
                        from: self.written.map(|from| from.min(now)),
                        reason: why.name().to_owned(),
                    },
                });
            }
            self.waiting.extend(self.now.values().cloned());
        }
        &self.waiting
    }

    /// That is on the disk.
    pub(super) fn written(&mut self) {
        // After a gap they do not stand in the order of their times.
        let newest = self.waiting.iter().map(|entry| entry.at).max();
        self.written = newest.or(self.written);
        self.waiting.clear();
    }
}

fn path_of(status: &PointStatus) -> String {
    format!("{}.{}", status.module, status.label)
}

/// Whether nothing is new but the time at which it was read.
fn is_same(a: &EntryKind, b: &EntryKind) -> bool {
    let of = |kind: &EntryKind| match kind {
        EntryKind::Reading {
            value,
            quality,
            reason,
            ..
        } => Some((value.clone(), quality.clone(), reason.clone())),
        EntryKind::Gap { .. } => None,
    };
    of(a) == of(b)
}

fn reading(status: &PointStatus, at: SystemTime) -> OutboxEntry {
    // What is bad is not known, whatever it was before.
    let value = match status.quality {
        PointQuality::Good | PointQuality::Stale => status.value,
        PointQuality::Bad(_) => None,
    };
    let value = value.and_then(|value| serde_json::to_string(&convert::value(value)).ok());
    let (quality, reason) = convert::quality(status.quality);
    OutboxEntry {
        at: millis(at),
        what: EntryKind::Reading {
            path: path_of(status),
            value,
            quality: word(&quality),
            reason: reason.map(|reason| word(&reason)),
            time: status.time.map(millis),
        },
    }
}

/// The word that the API has for it.
fn word(what: &impl serde::Serialize) -> String {
    match serde_json::to_value(what) {
        Ok(serde_json::Value::String(word)) => word,
        // Quality and reason are words.
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests;
