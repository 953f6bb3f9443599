//! The journal of changes, as text: one record per line, each a JSON object.
//!
//! Nothing here touches a file. A last line torn by a power loss is skipped: an incomplete intent
//! was not followed by a write, and an incomplete end leaves the intent open.

use super::{BusAddress, Found};
use railbus_device::Setup;
use railbus_wire::{Address, Baud, Character, SerialSettings};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How many records a journal keeps. Beyond that, the older half is deleted, except for changes
/// that are still open.
pub const RECORDS_MAX: usize = 4096;

/// The version of the record format.
const SCHEMA: u8 = 1;

/// What is known about a step of a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordState {
    /// It is about to be written: the module has the old values or the new ones.
    Intent,
    /// It has the new values: they were read back.
    Done,
    /// It acknowledged the new values and applies them at its next power-up.
    Pending,
    /// It has the old values.
    Unchanged,
    /// It has neither the old values nor all of the new ones.
    Elsewhere,
    /// It was not found.
    Lost,
    /// It is there, but no read shows whether this was done.
    Untold,
    /// The configuration file has been updated with the module's place.
    Filed,
}

impl RecordState {
    /// Whether it has the new values.
    #[must_use]
    pub const fn is_done(self) -> bool {
        matches!(self, RecordState::Done | RecordState::Filed)
    }
}

/// What requested the change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChangeOrigin {
    /// `config set`.
    Set,
    /// `config undo`.
    Undo,
    /// `config restore`.
    Restore,
    /// `apply`.
    Apply,
    /// Rollback of a change that could not be completed.
    Rollback,
    /// `config calibrate`.
    Calibrate,
    /// `config factory`.
    Factory,
    /// `config recover`: only looked.
    Recover,
}

/// A place, as recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Spot {
    /// The address.
    pub address: u8,
    /// The speed.
    pub baud: u32,
    /// The character format: `8N1`.
    pub format: String,
    /// ASCII frames carry a checksum.
    pub checksum: bool,
}

impl Spot {
    /// A place, to be recorded.
    #[must_use]
    pub fn of(place: BusAddress) -> Spot {
        Spot {
            address: place.address.0,
            baud: place.serial.baud.rate(),
            format: place.serial.character.to_string(),
            checksum: place.checksum,
        }
    }

    /// The recorded place; `None` if there is none.
    #[must_use]
    pub fn place(&self) -> Option<BusAddress> {
        Some(BusAddress {
            address: Address(self.address),
            serial: SerialSettings {
                baud: Baud::from_rate(self.baud)?,
                character: Character::from_name(&self.format)?,
            },
            checksum: self.checksum,
        })
    }
}

/// One record.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct JournalRecord {
    /// The version of the format.
    pub schema: u8,
    /// The number of its change, from 1.
    pub change: u64,
    /// When it was recorded, RFC 3339 in UTC; set by the writer.
    pub at: String,
    /// The number of the write within the change, from 1.
    pub step: u8,
    /// How many there are.
    pub steps: u8,
    /// What is known about it.
    pub state: RecordState,
    /// The line.
    pub line: String,
    /// The module.
    pub module: String,
    /// Its model, as in the configuration.
    pub model: String,
    /// Its protocol.
    pub protocol: String,
    /// Where it answered before.
    pub from: Spot,
    /// Where it answers after.
    pub to: Spot,
    /// Where it was found, if it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub found: Option<Spot>,
    /// What changes: old and new value of each setting.
    pub set: BTreeMap<String, [String; 2]>,
    /// The frame, in hexadecimal digits.
    pub frame: String,
    /// What requested it.
    pub by: ChangeOrigin,
    /// The change that this one undoes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undoes: Option<u64>,
}

impl JournalRecord {
    /// An empty record of this change.
    #[must_use]
    pub fn of(change: u64, line: &str, module: &str, setup: &Setup) -> JournalRecord {
        let here = Spot::of(BusAddress::of(setup));
        JournalRecord {
            schema: SCHEMA,
            change,
            at: String::new(),
            step: 1,
            steps: 1,
            state: RecordState::Intent,
            line: line.to_owned(),
            module: module.to_owned(),
            model: setup.family.name().to_owned(),
            protocol: setup.protocol.name().to_owned(),
            from: here.clone(),
            to: here,
            found: None,
            set: BTreeMap::new(),
            frame: String::new(),
            by: ChangeOrigin::Set,
            undoes: None,
        }
    }

    /// The same step, now that more is known.
    #[must_use]
    pub fn ended(&self, state: RecordState, found: Option<&Found>) -> JournalRecord {
        let found = found.map(|found| Spot::of(found.place));
        JournalRecord {
            state,
            found,
            ..self.clone()
        }
    }

    /// The line in the journal, newline included.
    #[must_use]
    pub fn line_of_text(&self) -> String {
        // A record can always be serialised.
        serde_json::to_string(self).unwrap_or_default() + "\n"
    }
}

/// A parsed journal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Log {
    /// Its records, the oldest first.
    pub records: Vec<JournalRecord>,
    /// How many lines are not records: torn, or of another version.
    pub unread: usize,
}

impl Log {
    /// Parses a journal.
    #[must_use]
    pub fn read(text: &str) -> Log {
        let mut log = Log::default();
        for line in text.lines().filter(|line| !line.is_empty()) {
            match serde_json::from_str::<JournalRecord>(line) {
                Ok(record) if record.schema == SCHEMA => log.records.push(record),
                _ => log.unread += 1,
            }
        }
        log
    }

    /// The number of the next change.
    #[must_use]
    pub fn next_change(&self) -> u64 {
        self.records
            .iter()
            .map(|record| record.change)
            .max()
            .unwrap_or(0)
            + 1
    }

    /// The records of a change, the oldest first.
    pub fn change(&self, number: u64) -> impl Iterator<Item = &JournalRecord> {
        self.records
            .iter()
            .filter(move |record| record.change == number)
    }

    /// Every place named in the records of a change.
    #[must_use]
    pub fn places(&self, number: u64) -> Vec<BusAddress> {
        let records = self.change(number);
        let spots = records
            .flat_map(|record| [Some(&record.to), Some(&record.from), record.found.as_ref()]);
        spots.flatten().filter_map(Spot::place).collect()
    }

    /// The last record of each change, by its number.
    #[must_use]
    pub fn last_words(&self) -> BTreeMap<u64, &JournalRecord> {
        self.records
            .iter()
            .map(|record| (record.change, record))
            .collect()
    }

    /// The sum of a change: the first old and the last new value of each setting, including writes
    /// that were rolled back.
    #[must_use]
    pub fn net(&self, number: u64) -> BTreeMap<String, [String; 2]> {
        let mut set: BTreeMap<String, [String; 2]> = BTreeMap::new();
        let intents = self.change(number);
        for record in intents.filter(|record| record.state == RecordState::Intent) {
            for (key, [old, new]) in &record.set {
                set.entry(key.clone())
                    .and_modify(|both| both[1].clone_from(new))
                    .or_insert_with(|| [old.clone(), new.clone()]);
            }
        }
        set
    }

    /// Whether a part of a change was rolled back because the rest failed.
    #[must_use]
    pub fn is_rolled_back(&self, number: u64) -> bool {
        self.change(number)
            .any(|record| record.by == ChangeOrigin::Rollback)
    }

    /// The changes after which it is not certain where the module is and what it has stored.
    #[must_use]
    pub fn open(&self) -> Vec<&JournalRecord> {
        let is_open = |record: &&JournalRecord| {
            matches!(
                record.state,
                RecordState::Intent
                    | RecordState::Pending
                    | RecordState::Elsewhere
                    | RecordState::Lost
            )
        };
        self.last_words().into_values().filter(is_open).collect()
    }

    /// Where a module was last known to be, if its last change has not reached the configuration
    /// file: the host died between the two.
    #[must_use]
    pub fn unfiled(&self, module: &str) -> Option<BusAddress> {
        let mut of_module = self.records.iter().filter(|record| record.module == module);
        let last = of_module.next_back()?;
        let place = last.found.as_ref().and_then(Spot::place);
        place.filter(|_| last.state == RecordState::Done)
    }

    /// What remains of a journal that is too long: its newer half, and all open changes. `None` if
    /// it is not too long.
    #[must_use]
    pub fn shortened(&self) -> Option<String> {
        if self.records.len() <= RECORDS_MAX {
            return None;
        }
        let open: Vec<u64> = self.open().iter().map(|record| record.change).collect();
        let newest = self.records.len() - RECORDS_MAX / 2;
        let kept = self
            .records
            .iter()
            .enumerate()
            .filter(|(at, record)| *at >= newest || open.contains(&record.change));
        Some(kept.map(|(_, record)| record.line_of_text()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Family;

    fn record(change: u64, state: RecordState) -> JournalRecord {
        let setup = Setup::new(Family::Erc8, Address(3));
        JournalRecord {
            state,
            ..JournalRecord::of(change, "main", "oven", &setup)
        }
    }

    fn text(records: &[JournalRecord]) -> String {
        records.iter().map(JournalRecord::line_of_text).collect()
    }

    #[test]
    fn what_was_written_is_read_and_a_torn_end_is_passed_over() {
        let both = [record(1, RecordState::Intent), record(1, RecordState::Done)];
        let whole = text(&both);
        assert_eq!(Log::read(&whole).records, both);
        let first = both[0].line_of_text().len();
        for cut in first..whole.len() - 1 {
            let log = Log::read(&whole[..cut]);
            assert_eq!(log.records, both[..1], "cut at {cut}");
            assert_eq!(log.open().len(), 1);
        }
        // After a torn line, start a new one.
        let healed = format!("{}\n{}", &whole[..first + 7], both[1].line_of_text());
        let log = Log::read(&healed);
        assert_eq!((log.records.len(), log.unread), (2, 1));
    }

    #[test]
    fn a_change_is_open_until_its_end_is_known() {
        let open = |records: &[JournalRecord]| Log::read(&text(records)).open().len();
        assert_eq!(open(&[record(1, RecordState::Intent)]), 1);
        assert_eq!(
            open(&[record(1, RecordState::Intent), record(1, RecordState::Lost)]),
            1
        );
        assert_eq!(
            open(&[
                record(1, RecordState::Intent),
                record(1, RecordState::Unchanged)
            ]),
            0
        );
        assert_eq!(
            open(&[record(1, RecordState::Lost), record(2, RecordState::Done)]),
            1
        );
    }

    #[test]
    fn a_long_journal_is_shortened_and_forgets_nothing_that_is_open() {
        let mut records = vec![record(1, RecordState::Intent)];
        records
            .extend((2..=RECORDS_MAX as u64 + 1).map(|number| record(number, RecordState::Done)));
        let log = Log { records, unread: 0 };
        let short = Log::read(&log.shortened().unwrap());
        assert_eq!(short.records.len(), RECORDS_MAX / 2 + 1);
        assert_eq!(short.open().len(), 1);
        assert_eq!(short.next_change(), log.next_change());
        assert_eq!(short.shortened(), None);
    }
}
