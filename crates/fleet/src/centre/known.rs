//! The last known values of a site's points.

use crate::message::{Beat, DataBatch, DataEntry, DataKind, SiteState, UplinkReading, UplinkValue};
use std::collections::BTreeMap;

/// The maximum number of points of a site.
pub(super) const POINTS_MAX: usize = 20_000;
/// The maximum length of a path, text value or reason, in bytes.
const TEXT_MAX: usize = 256;
/// The maximum number of spans received ahead of a gap.
const SPANS_MAX: usize = 64;

/// The last known value of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownPoint {
    /// The sequence number of its entry; 0 if it is from an earlier session.
    seq: u64,
    /// Since when it is so, in milliseconds since 1970.
    pub at_ms: i64,
    /// Its value, and how good it is.
    pub reading: UplinkReading,
}

/// The last known values of a site's points. The entry with the highest sequence number gives a
/// point's value. Values are complete up to a number once every entry up to it has arrived, or a
/// state taken after it.
#[derive(Clone, Debug, Default)]
pub(super) struct KnownSite {
    /// Which outbox the sequence numbers belong to.
    epoch: String,
    /// Everything up to this number has arrived; none before the first state of this session.
    whole: Option<u64>,
    /// Spans received ahead of a gap: first number to last.
    spans: BTreeMap<u64, u64>,
    points: BTreeMap<String, KnownPoint>,
    /// Their paths in lower case, a line each: thousands of sites are searched, and to visit every
    /// point of them would take too long.
    paths: String,
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

    pub(super) fn paths(&self) -> &str {
        &self.paths
    }

    /// Whether everything has arrived that a heartbeat vouches for.
    pub(super) fn has_all(&self, beat: &Beat) -> bool {
        self.epoch == beat.epoch && self.whole.is_some_and(|whole| whole >= beat.newest)
    }

    /// A state arrived: all points as of a sequence number.
    pub(super) fn state(&mut self, state: SiteState) {
        if state.epoch != self.epoch {
            self.begin();
            self.epoch = state.epoch;
        }
        if self.whole.is_some_and(|whole| whole > state.seq) {
            // Newer entries are already known.
            return;
        }
        // Points that are not in it no longer exist, unless a later entry has them.
        let before = self.points.len();
        self.points.retain(|_, point| point.seq > state.seq);
        if self.points.len() != before {
            self.paths.clear();
            for path in self.points.keys() {
                add_line(&mut self.paths, path);
            }
        }
        self.whole = Some(state.seq);
        for entry in state.points {
            if !self.tell(state.seq, entry) {
                self.whole = None;
                return;
            }
        }
        self.join();
    }

    /// Entries arrived.
    pub(super) fn batch(&mut self, batch: DataBatch) {
        // Before the first state there is nothing to apply them to; it will contain them.
        let Some(whole) = self.whole.filter(|_| batch.epoch == self.epoch) else {
            return;
        };
        if batch.entries.is_empty() {
            return;
        }
        let last = batch.seq.saturating_add(batch.entries.len() as u64 - 1);
        let numbered = (batch.seq..=last).zip(batch.entries);
        // Older ones are already included, and their point may no longer exist.
        for (seq, entry) in numbered.filter(|(seq, _)| *seq > whole) {
            if !self.tell(seq, entry) {
                // Too many points, or too long: only a state can make it complete again.
                self.whole = None;
                return;
            }
        }
        let span = self.spans.entry(batch.seq).or_insert(last);
        *span = last.max(*span);
        self.join();
        if self.spans.len() > SPANS_MAX {
            // A state will cover it.
            self.spans.pop_last();
        }
    }

    /// Extends the complete range by the spans adjoining it.
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

    /// Applies an entry; false if it is too long or there are too many points.
    fn tell(&mut self, seq: u64, entry: DataEntry) -> bool {
        if !is_fit(&entry) {
            return false;
        }
        // Other entries do not concern a point.
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
            add_line(&mut self.paths, &path);
            self.points.insert(path, point);
        }
        has_place
    }
}

fn add_line(paths: &mut String, path: &str) {
    paths.extend(path.chars().flat_map(char::to_lowercase));
    paths.push('\n');
}

/// Whether its texts are no longer than those of real modules.
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
