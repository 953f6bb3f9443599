//! Changes that could not be published as they happened, on their way to the broker. Without I/O.
//!
//! The outbox has every change, in order. What was told live need not come again: while there is
//! a connection on which the births were sent, changes are told as they happen, and of those that
//! are known to have arrived the outbox is told so. The others come after the births of the next
//! connection, as metrics of the past.

use super::device::{Device, MetricQuality, with_quality};
use super::payload::{DataType, Metric, MetricValue};
use crate::northbound::outbox::OutboxState;
use railbus_store::outbox::{EntryKind, OutboxEntry, Piece};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// How many entries are read at a time.
pub(super) const READ_MAX: usize = 256;
/// How many wait here before more are read.
const AHEAD_MAX: usize = 2_048;
/// How many of modules that do not answer wait here before the oldest are dropped: there is no
/// message in which they could be told before their module answers.
pub(super) const HELD_MAX: usize = 65_536;
/// How many are in a message.
const MESSAGE_MAX: usize = 100;
/// When it is tried again what could not be read.
const AGAIN: Duration = Duration::from_secs(10);
/// So many spans in which everything was told live are remembered.
const SPANS_MAX: usize = 16;

/// The devices by their names.
pub(super) type Devices = BTreeMap<String, Device>;

/// A change of one point.
#[derive(Debug)]
struct Change {
    module: String,
    label: String,
    /// When it happened, in milliseconds since 1970.
    at: u64,
    /// When it was read.
    read: Option<u64>,
    value: Option<serde_json::Value>,
    quality: MetricQuality,
    /// The message in which it went, on the present connection.
    sent: Option<u64>,
}

/// A time in which everything that happened was told live, and arrived.
#[derive(Clone, Copy, Debug)]
struct Span {
    from: u64,
    until: u64,
    /// Entries up to this one were there before.
    after: u64,
}

/// Changes may be missing between these times, in milliseconds since 1970.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MissingSpan {
    pub(super) from: Option<u64>,
    pub(super) until: u64,
}

/// The past of some metrics of a device.
#[derive(Debug, PartialEq)]
pub(super) struct Past {
    pub(super) device: String,
    pub(super) metrics: Vec<Metric>,
    /// The numbers of its entries.
    pub(super) entries: Vec<u64>,
}

/// What the outbox need not keep any more.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Settled {
    /// The first and the last time of what is only in memory now, and would be missing after a
    /// restart; to be saved before the outbox is told.
    pub(super) held: Option<Option<(u64, u64)>>,
    /// Up to which entry of which epoch everything is delivered.
    pub(super) delivered: Option<(Arc<str>, u64)>,
}

/// The changes that may have to be told.
#[derive(Debug, Default)]
pub(super) struct Backlog {
    epoch: Arc<str>,
    /// The newest entry on the disk.
    newest: u64,
    /// The outbox was told that everything up to this one is delivered.
    delivered: u64,
    /// Everything up to this one was read.
    read: u64,
    is_reading: bool,
    changes: BTreeMap<u64, Change>,
    /// How many of them wait for their modules, as was counted last.
    held: usize,
    /// What is written down of them.
    kept: Option<(u64, u64)>,
    /// What an earlier run held, and what was dropped since, until it was told.
    lost: Option<(u64, u64)>,
    /// Entries that say that changes are missing, and the message in which that went; the number 0
    /// stands for what is lost.
    gaps: BTreeMap<u64, Option<u64>>,
    missing: Option<MissingSpan>,
    /// Those before this one have been sent, or can't be.
    scan: u64,
    spans: VecDeque<Span>,
    /// Since when every change is published as it happens, while connected and born.
    live: Option<u64>,
    /// When it goes on.
    again: Option<Duration>,
    dropped: u64,
}

impl Backlog {
    /// One after an earlier run, which lost what it held between these times.
    pub(super) fn new(lost: Option<(u64, u64)>) -> Backlog {
        let mut backlog = Backlog {
            kept: lost,
            lost,
            ..Backlog::default()
        };
        if let Some((from, until)) = lost {
            backlog.gaps.insert(0, None);
            backlog.miss(Some(from), until);
        }
        backlog
    }

    /// So much is on the disk.
    pub(super) fn stored(&mut self, state: &OutboxState) {
        if self.epoch != state.epoch {
            let gap = self.gaps.remove_entry(&0);
            *self = Backlog {
                epoch: Arc::clone(&state.epoch),
                delivered: state.delivered,
                read: state.delivered,
                is_reading: self.is_reading,
                kept: self.kept,
                lost: self.lost,
                gaps: gap.into_iter().collect(),
                missing: self.missing,
                spans: std::mem::take(&mut self.spans),
                live: self.live,
                ..Backlog::default()
            };
            for span in &mut self.spans {
                span.after = state.before;
            }
        }
        self.newest = state.newest;
    }

    /// After which entry is to be read now; none while there is nothing to read, or enough waits.
    pub(super) fn next_read(&mut self, now: Duration) -> Option<u64> {
        if self.is_reading || self.read >= self.newest || self.again.is_some_and(|at| at > now) {
            return None;
        }
        self.again = None;
        if self.open() >= AHEAD_MAX {
            return None;
        }
        self.is_reading = true;
        Some(self.read)
    }

    /// How many wait that do not wait for their module.
    fn open(&self) -> usize {
        self.changes.len().saturating_sub(self.held)
    }

    /// Whether it goes on faster once it is known what has arrived.
    pub(super) fn is_pressed(&self) -> bool {
        self.open() >= AHEAD_MAX / 2
    }

    /// What was read; none if it could not be.
    pub(super) fn read(
        &mut self,
        now: Duration,
        piece: Option<(Arc<str>, Piece)>,
        devices: &Devices,
    ) {
        self.is_reading = false;
        let Some((epoch, piece)) = piece else {
            self.again = Some(now + AGAIN);
            return;
        };
        // What another epoch has is read anew.
        if epoch != self.epoch || piece.first <= self.read {
            return;
        }
        if let Some(missing) = piece.missing {
            self.gaps.insert(piece.first - 1, None);
            self.miss(missing.from.map(unsigned), unsigned(missing.to));
        }
        for (number, entry) in (piece.first..).zip(piece.entries) {
            self.read = number;
            self.entry(number, entry, devices);
        }
    }

    fn entry(&mut self, number: u64, entry: OutboxEntry, devices: &Devices) {
        match entry.what {
            EntryKind::Gap { from, .. } => {
                self.gaps.insert(number, None);
                self.miss(from.map(unsigned), unsigned(entry.at));
            }
            EntryKind::Reading {
                path,
                value,
                quality,
                time,
                ..
            } => {
                let Some((module, label)) = path.split_once('.') else {
                    return;
                };
                // There is no metric any more that could be told.
                let device = devices.get(module);
                let is_known = device.is_some_and(|device| device.datatype(label).is_some());
                if !is_known || self.was_live(number, unsigned(entry.at)) {
                    return;
                }
                let value = value.and_then(|value| serde_json::from_str(&value).ok());
                let change = Change {
                    module: module.to_owned(),
                    label: label.to_owned(),
                    at: unsigned(entry.at),
                    read: time.map(unsigned),
                    value,
                    quality: match quality.as_str() {
                        "good" => MetricQuality::Good,
                        "stale" => MetricQuality::Stale,
                        _ => MetricQuality::Bad,
                    },
                    sent: None,
                };
                self.changes.insert(number, change);
            }
        }
    }

    /// Whether what happened at this time was told live, and arrived.
    fn was_live(&self, number: u64, at: u64) -> bool {
        let mut spans = self.spans.iter();
        spans.any(|span| number > span.after && (span.from..=span.until).contains(&at))
    }

    /// Others of this time come.
    pub(super) fn cap(&mut self, before: u64) {
        if let Some(span) = self.spans.back_mut() {
            span.until = span.until.min(before);
        }
    }

    /// One span for all that may be missing: a host reads the newest of a metric only.
    fn miss(&mut self, from: Option<u64>, until: u64) {
        self.missing = Some(match self.missing {
            None => MissingSpan { from, until },
            Some(known) => MissingSpan {
                from: known.from.zip(from).map(|(known, from)| known.min(from)),
                until: known.until.max(until),
            },
        });
    }

    /// Between which times changes may be missing.
    pub(super) const fn missing(&self) -> Option<MissingSpan> {
        self.missing
    }

    /// Whether something is missing that no message tells yet.
    pub(super) fn is_untold(&self) -> bool {
        self.gaps.values().any(Option::is_none)
    }

    /// That went in the message of this number.
    pub(super) fn missing_sent(&mut self, message: u64) {
        for sent in self.gaps.values_mut() {
            sent.get_or_insert(message);
        }
    }

    /// How many were dropped since this was last called.
    pub(super) fn dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }

    /// From this time on every change is published as it happens.
    pub(super) fn live_from(&mut self, from: u64) {
        self.live = Some(from);
        let after = self.newest;
        self.spans.push_back(Span {
            from,
            until: 0,
            after,
        });
        if self.spans.len() > SPANS_MAX {
            self.spans.pop_front();
        }
        self.scan = 0;
    }

    /// The clock was set back to this time: times that are known come once more, and are not those
    /// that were told.
    pub(super) fn set_back(&mut self, to: u64) {
        self.spans.clear();
        if self.live.is_some() {
            self.live_from(to);
        }
    }

    /// What happened until this time and was told live has arrived.
    pub(super) fn live_until(&mut self, until: u64) {
        if self.live.is_some()
            && let Some(span) = self.spans.back_mut()
        {
            span.until = span.until.max(until);
        }
    }

    /// A device was born: what was held of it can be told.
    pub(super) fn born(&mut self) {
        self.scan = 0;
    }

    /// A module was removed: its changes are dropped, for another one may get its name.
    pub(super) fn forget(&mut self, module: &str) {
        self.changes.retain(|_, change| change.module != module);
    }

    /// The connection is lost: what is not known to have arrived is published again.
    pub(super) fn lost(&mut self) {
        for change in self.changes.values_mut() {
            change.sent = None;
        }
        self.gaps.values_mut().for_each(|sent| *sent = None);
        (self.scan, self.live) = (0, None);
    }

    /// The broker has every message up to this number.
    pub(super) fn arrived(&mut self, number: u64) {
        let has_arrived = |sent: Option<u64>| sent.is_some_and(|sent| sent <= number);
        let mut changes = std::mem::take(&mut self.changes);
        changes.retain(|number, change| {
            !has_arrived(change.sent) && !self.was_live(*number, change.at)
        });
        self.changes = changes;
        self.gaps.retain(|_, sent| !has_arrived(*sent));
        if !self.gaps.contains_key(&0) {
            self.lost = None;
        }
    }

    /// What the outbox need not keep any more, if that is new.
    pub(super) fn settled(&mut self, devices: &Devices) -> Settled {
        let (mut first, mut held) = (None, Vec::new());
        for (number, change) in &self.changes {
            match is_held(change, devices) {
                true => held.push((*number, change.at)),
                false => first = first.or(Some(*number)),
            }
        }
        let over = held.len().saturating_sub(HELD_MAX);
        for (number, at) in held.drain(..over) {
            self.changes.remove(&number);
            self.dropped += 1;
            self.miss(Some(at), at);
            self.gaps.insert(0, None);
            let lost = self.lost.get_or_insert((at, at));
            *lost = (lost.0.min(at), lost.1.max(at));
        }
        self.held = held.len();
        let first = first.into_iter().chain(self.gaps.keys().copied()).min();
        let delivered = first.map_or(self.read, |number| number.saturating_sub(1));
        let is_further = delivered > self.delivered;
        self.delivered = self.delivered.max(delivered);
        // Only what the outbox no longer has.
        let times = self.changes.range(..=self.delivered);
        let times = times
            .map(|(_, change)| (change.at, change.at))
            .chain(self.lost);
        let kept = times.reduce(|one, two| (one.0.min(two.0), one.1.max(two.1)));
        let is_other = self.kept != kept;
        self.kept = kept;
        Settled {
            held: is_other.then_some(kept),
            delivered: is_further.then(|| (Arc::clone(&self.epoch), self.delivered)),
        }
    }

    /// What is to be told next of the past at this time, oldest first.
    pub(super) fn next(&mut self, now: u64, devices: &Devices) -> Option<Past> {
        let live_from = self.live.unwrap_or(u64::MAX);
        let after = self.spans.back().map_or(0, |span| span.after);
        let mut past: Option<Past> = None;
        let (mut left, mut unknown) = (None, Vec::new());
        for (number, change) in self.changes.range(self.scan..) {
            // What is ahead of now happened before the clock was set back.
            let is_past = change.sent.is_none()
                && (change.at < live_from || change.at > now || *number <= after);
            let device = devices.get(&change.module);
            let born = device.filter(|device| device.born.is_some() && is_past);
            let Some(device) = born else {
                continue;
            };
            let datatype = device.datatype(&change.label);
            let Some(metric) = datatype.and_then(|datatype| metric(change, datatype)) else {
                unknown.push(*number);
                continue;
            };
            let past = past.get_or_insert_with(|| Past {
                device: change.module.clone(),
                metrics: Vec::new(),
                entries: Vec::new(),
            });
            if past.device != change.module {
                left = left.or(Some(*number));
                continue;
            }
            past.metrics.push(metric);
            past.entries.push(*number);
            if past.entries.len() >= MESSAGE_MAX {
                left = left.or(Some(number + 1));
                break;
            }
        }
        self.scan = left.unwrap_or(self.read + 1);
        // The metric was removed, or has another type.
        self.dropped += unknown.len() as u64;
        for number in unknown {
            self.changes.remove(&number);
        }
        past
    }

    /// These entries went in the message of this number.
    pub(super) fn sent(&mut self, entries: &[u64], message: u64) {
        for number in entries {
            if let Some(change) = self.changes.get_mut(number) {
                change.sent = Some(message);
            }
        }
    }

    /// When it goes on by itself.
    pub(super) const fn deadline(&self) -> Option<Duration> {
        self.again
    }

    /// How many entries the broker does not have, as far as is known.
    pub(super) const fn behind(&self) -> u64 {
        self.newest.saturating_sub(self.delivered)
    }
}

/// Whether a change waits for its module.
fn is_held(change: &Change, devices: &Devices) -> bool {
    let device = devices.get(&change.module);
    device.is_some_and(|device| device.born.is_none() && !device.is_online)
}

fn unsigned(millis: i64) -> u64 {
    u64::try_from(millis).unwrap_or(0)
}

/// A change as a metric of the past; none where its value is not of this type.
fn metric(change: &Change, datatype: DataType) -> Option<Metric> {
    let value = match (&change.value, datatype) {
        (None, _) => None,
        (Some(value), DataType::Boolean) => Some(MetricValue::Boolean(value.as_bool()?)),
        (Some(value), DataType::Double) => Some(MetricValue::Double(value.as_f64()?)),
        (Some(value), _) => Some(MetricValue::Long(value.as_u64()?)),
    };
    let time = match change.quality {
        MetricQuality::Good => change.read.unwrap_or(change.at),
        MetricQuality::Stale | MetricQuality::Bad => change.at,
    };
    let metric = Metric {
        is_historical: Some(true),
        ..Metric::new(&change.label, time, value)
    };
    // What a host shows of now says nothing about then.
    Some(with_quality(metric, change.quality, true))
}
