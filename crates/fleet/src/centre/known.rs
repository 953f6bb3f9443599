//! What is known of the points of a site.

use crate::message::{Beat, DataBatch, DataEntry, DataKind, SiteState, UplinkReading, UplinkValue};
use std::collections::BTreeMap;

/// The most points of a site.
pub(super) const POINTS_MAX: usize = 20_000;
/// The longest path, and the longest value and reason, in bytes.
const TEXT_MAX: usize = 256;
/// The most spans of numbers that came before what is in front of them.
const SPANS_MAX: usize = 64;

/// A point, as its site said.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownPoint {
    /// The number of the entry that says so; 0 if that was in an earlier session.
    seq: u64,
    /// Since when it is so, in milliseconds since 1970.
    pub at_ms: i64,
    /// Its value, and how good it is.
    pub reading: UplinkReading,
}

/// What is known of the points of a site. What is true of a point is what its entry with the
/// highest number says. They are known to be so where all is there up to a number: as entries, or
/// as the state after that number or a later one.
#[derive(Clone, Debug, Default)]
pub(super) struct KnownSite {
    /// What the numbers of this session belong to.
    epoch: String,
    /// Up to which number everything is there; none before the state of this session.
    whole: Option<u64>,
    /// Spans of numbers behind that, first to last.
    spans: BTreeMap<u64, u64>,
    points: BTreeMap<String, KnownPoint>,
}

impl KnownSite {
    /// A new session, or new numbering: the last values stay, but none is confirmed any more.
    pub(super) fn begin(&mut self) {
        self.whole = None;
        self.spans.clear();
        for point in self.points.values_mut() {
            point.seq = 0;
        }
    }

    pub(super) const fn points(&self) -> &BTreeMap<String, KnownPoint> {
        &self.points
    }

    /// Whether all is there that a heartbeat vouches for.
    pub(super) fn has_all(&self, beat: &Beat) -> bool {
        self.epoch == beat.epoch && self.whole.is_some_and(|whole| whole >= beat.newest)
    }

    /// How every point is after an entry.
    pub(super) fn state(&mut self, state: SiteState) {
        if state.points.len() > POINTS_MAX || !state.points.iter().all(is_fit) {
            return;
        }
        if state.epoch != self.epoch {
            self.begin();
            self.epoch = state.epoch;
        }
        if self.whole.is_some_and(|whole| whole > state.seq) {
            // What came since says more.
            return;
        }
        // What is not in it is there no longer, unless it was said later.
        self.points.retain(|_, point| point.seq > state.seq);
        self.whole = Some(state.seq);
        for entry in state.points {
            if !self.tell(state.seq, entry) {
                self.whole = None;
                return;
            }
        }
        self.join();
    }

    /// Entries came.
    pub(super) fn batch(&mut self, batch: DataBatch) {
        // Without the state there is nothing to add them to: it comes, and has them.
        let Some(whole) = self.whole.filter(|_| batch.epoch == self.epoch) else {
            return;
        };
        if batch.entries.is_empty() {
            return;
        }
        let last = batch.seq.saturating_add(batch.entries.len() as u64 - 1);
        let numbered = (batch.seq..=last).zip(batch.entries);
        // What is whole has the others, and may have a point no longer.
        for (seq, entry) in numbered.filter(|(seq, _)| *seq > whole) {
            if !self.tell(seq, entry) {
                // More points than a site can have: it must say how all are.
                self.whole = None;
                return;
            }
        }
        let span = self.spans.entry(batch.seq).or_insert(last);
        *span = last.max(*span);
        self.join();
        if self.spans.len() > SPANS_MAX {
            // The state will have it.
            self.spans.pop_last();
        }
    }

    /// Spans that join on to what is whole belong to it.
    fn join(&mut self) {
        let Some(whole) = &mut self.whole else {
            return;
        };
        while let Some(span) = self.spans.first_entry() {
            if *span.key() > whole.saturating_add(1) {
                break;
            }
            *whole = span.remove().max(*whole);
        }
    }

    /// Returns whether there is a place for it.
    fn tell(&mut self, seq: u64, entry: DataEntry) -> bool {
        if !is_fit(&entry) {
            return false;
        }
        // Others say nothing of a point.
        let Some(DataKind::Reading(reading)) = entry.what else {
            return true;
        };
        let at_ms = entry.at_ms;
        if let Some(point) = self.points.get_mut(&reading.path) {
            if point.seq <= seq {
                *point = KnownPoint {
                    seq,
                    at_ms,
                    reading,
                };
            }
            return true;
        }
        let has_place = self.points.len() < POINTS_MAX;
        if has_place {
            let path = reading.path.clone();
            let point = KnownPoint {
                seq,
                at_ms,
                reading,
            };
            self.points.insert(path, point);
        }
        has_place
    }
}

/// Whether it is as short as what modules say.
fn is_fit(entry: &DataEntry) -> bool {
    let Some(DataKind::Reading(reading)) = &entry.what else {
        return true;
    };
    let value = match &reading.value {
        Some(UplinkValue::Text(text)) => text.len(),
        _ => 0,
    };
    let longest = value.max(reading.path.len()).max(reading.reason.len());
    longest <= TEXT_MAX
}
