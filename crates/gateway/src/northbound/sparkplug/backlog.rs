//! What changed while nobody was told, on its way to the broker. Without I/O.
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
const HELD_MAX: usize = 65_536;
/// How many are in a message.
const MESSAGE_MAX: usize = 100;
/// When it is tried again what could not be read.
const AGAIN: Duration = Duration::from_secs(10);
/// So many spans in which everything was told live are remembered.
const SPANS_MAX: usize = 16;

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
    /// Those before this one have been sent, or can't be.
    scan: u64,
    spans: VecDeque<Span>,
    /// Since when everything is told live, while that is so.
    live: Option<u64>,
    /// When it goes on.
    again: Option<Duration>,
    missing: Option<MissingSpan>,
    dropped: u64,
}

impl Backlog {
    /// So much is on the disk.
    pub(super) fn stored(&mut self, state: &OutboxState) {
        if self.epoch != state.epoch {
            *self = Backlog {
                epoch: Arc::clone(&state.epoch),
                delivered: state.delivered,
                read: state.delivered,
                is_reading: self.is_reading,
                spans: std::mem::take(&mut self.spans),
                live: self.live,
                ..Backlog::default()
            };
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
    pub(super) fn read(&mut self, now: Duration, piece: Option<(Arc<str>, Piece)>) {
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
            self.miss(missing.from, missing.to);
        }
        for (number, entry) in (piece.first..).zip(piece.entries) {
            self.read = number;
            self.entry(number, entry);
        }
    }

    fn entry(&mut self, number: u64, entry: OutboxEntry) {
        match entry.what {
            EntryKind::Gap { from, .. } => self.miss(from, entry.at),
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
                if self.was_live(unsigned(entry.at)) {
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
    fn was_live(&self, at: u64) -> bool {
        let mut spans = self.spans.iter();
        spans.any(|span| (span.from..=span.until).contains(&at))
    }

    fn miss(&mut self, from: Option<i64>, until: i64) {
        self.missing = Some(MissingSpan {
            from: from.map(unsigned),
            until: unsigned(until),
        });
    }

    /// Changes may be missing, as was read since this was last called.
    pub(super) fn missing(&mut self) -> Option<MissingSpan> {
        self.missing.take()
    }

    /// How many were dropped since this was last called.
    pub(super) fn dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }

    /// From this time on everything is told live.
    pub(super) fn live_from(&mut self, from: u64) {
        self.live = Some(from);
        self.spans.push_back(Span { from, until: 0 });
        if self.spans.len() > SPANS_MAX {
            self.spans.pop_front();
        }
        self.scan = 0;
    }

    /// The clock was set back: times that are known come once more. What is told live from now on
    /// comes as the past as well, until the clock is where it was.
    pub(super) fn set_back(&mut self, seen: u64) {
        self.spans.clear();
        if self.live.is_some() {
            self.live_from(seen + 1);
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

    /// The connection is lost: what was not known to have arrived is told again.
    pub(super) fn lost(&mut self) {
        for change in self.changes.values_mut() {
            change.sent = None;
        }
        (self.scan, self.live) = (0, None);
    }

    /// The broker has every message up to this number.
    pub(super) fn arrived(&mut self, number: u64) {
        let mut changes = std::mem::take(&mut self.changes);
        changes.retain(|_, change| {
            let has_arrived = change.sent.is_some_and(|sent| sent <= number);
            !has_arrived && !self.was_live(change.at)
        });
        self.changes = changes;
    }

    /// Up to which entry everything is delivered now, if that is further than before.
    pub(super) fn delivered(&mut self, devices: &Devices) -> Option<(Arc<str>, u64)> {
        let (mut first, mut held) = (None, Vec::new());
        for (number, change) in &self.changes {
            match is_held(change, devices) {
                true => held.push(*number),
                false => first = first.or(Some(*number)),
            }
        }
        let over = held.len().saturating_sub(HELD_MAX);
        for number in &held[..over] {
            self.changes.remove(number);
        }
        self.dropped += over as u64;
        self.held = held.len() - over;
        let delivered = first.map_or(self.read, |number| number.saturating_sub(1));
        (delivered > self.delivered).then(|| {
            self.delivered = delivered;
            (Arc::clone(&self.epoch), delivered)
        })
    }

    /// What is to be told next of the past, oldest first.
    pub(super) fn next(&mut self, devices: &Devices) -> Option<Past> {
        let live_from = self.live.unwrap_or(u64::MAX);
        let mut past: Option<Past> = None;
        let mut unknown = Vec::new();
        for (number, change) in self.changes.range(self.scan..) {
            let is_past = change.at < live_from && change.sent.is_none();
            let device = devices.get(&change.module);
            let is_gone = device.is_none_or(|device| device.datatype(&change.label).is_none());
            if is_gone {
                unknown.push(*number);
                continue;
            }
            let born = device.filter(|device| device.born.is_some() && is_past);
            let datatype = born.and_then(|device| device.datatype(&change.label));
            let Some(datatype) = datatype else {
                continue;
            };
            let past = past.get_or_insert_with(|| Past {
                device: change.module.clone(),
                metrics: Vec::new(),
                entries: Vec::new(),
            });
            if past.device != change.module || past.entries.len() >= MESSAGE_MAX {
                break;
            }
            past.metrics.push(metric(change, datatype));
            past.entries.push(*number);
        }
        self.scan = match &past {
            Some(past) => past.entries.last().map_or(self.scan, |last| last + 1),
            None => self.read + 1,
        };
        // There is no metric any more that could be told.
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

/// The devices by their names.
pub(super) type Devices = BTreeMap<String, Device>;

/// Whether a change waits for its module.
fn is_held(change: &Change, devices: &Devices) -> bool {
    let device = devices.get(&change.module);
    device.is_some_and(|device| device.born.is_none() && !device.is_online)
}

fn unsigned(millis: i64) -> u64 {
    u64::try_from(millis).unwrap_or(0)
}

/// A change as a metric of the past.
fn metric(change: &Change, datatype: DataType) -> Metric {
    let value = change.value.as_ref();
    let value = value.and_then(|value| match datatype {
        DataType::Boolean => value.as_bool().map(MetricValue::Boolean),
        DataType::Double => value.as_f64().map(MetricValue::Double),
        _ => value.as_u64().map(MetricValue::Long),
    });
    let time = match change.quality {
        MetricQuality::Good => change.read.unwrap_or(change.at),
        MetricQuality::Stale | MetricQuality::Bad => change.at,
    };
    let metric = Metric {
        is_historical: Some(true),
        ..Metric::new(&change.label, time, value)
    };
    with_quality(metric, change.quality, false)
}
