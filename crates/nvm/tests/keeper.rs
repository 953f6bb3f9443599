//! When something is written, in virtual time.

mod support;

use core::cell::Cell;
use railbus_device::Family;
use railbus_nvm::{
    BURST, Bytes, Counters, Held, PERIOD, RETRY, Record, SettingsStore, Slots, Store,
};
use railbus_nvm::{SLOT, slot_image};
use railbus_wire::{Instant, Micros};
use std::rc::Rc;
use support::chip::{Chip, Dead};
use support::factory;

const HOUR: Micros = Micros::from_secs(3_600);

/// A store that only counts, and a clock that it shares with the test.
#[derive(Debug, Default)]
struct Tally {
    held: Option<Bytes>,
    writes: Vec<Instant>,
    reads: usize,
    clock: Rc<Cell<Instant>>,
}

impl Store for Tally {
    type Error = Dead;

    fn read<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, Dead> {
        self.reads += 1;
        Ok(self.held.map(|held| {
            *room = held;
            room.bytes()
        }))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), Dead> {
        self.held = Bytes::of(bytes);
        self.writes.push(self.clock.get());
        Ok(())
    }
}

fn at(address: u8) -> Record {
    factory(Family::Erc8, address)
}

/// A master that writes another address each time, for so long.
fn hammer(every: Micros, how_long: Micros) -> (Tally, Counters, Record) {
    let tally = Tally::default();
    let clock = tally.clock.clone();
    let mut keeper = SettingsStore::new(tally);
    let (mut now, mut record) = (Instant(0), at(1));
    while now < Instant(how_long.0) {
        clock.set(now);
        record = at(1 + (now.0 / every.0 % 31) as u8);
        keeper.save(now, &record);
        let next = now + every;
        while let Some(due) = keeper.poll(now).filter(|due| *due < next) {
            assert!(due > now, "it does not turn in circles");
            now = due;
            clock.set(now);
        }
        now = next;
    }
    let counters = keeper.counters();
    (keeper.into_inner(), counters, record)
}

#[test]
fn what_is_held_already_is_not_written() {
    let mut keeper = SettingsStore::new(Slots::new(Chip::blank()));
    keeper.save(Instant(0), &at(1));
    for second in 1..1_000 {
        keeper.save(Instant(second), &at(1));
        assert!(!keeper.is_waiting());
    }
    let counters = keeper.counters();
    let chip = keeper.into_inner().into_inner();
    assert_eq!(chip.worn.iter().sum::<u32>(), 2, "two pages, once");
    assert_eq!((counters.written, counters.unchanged), (1, 999));
}

#[test]
fn what_was_held_at_power_up_is_not_written() {
    let mut keeper = SettingsStore::new(Slots::new(Chip::blank()));
    keeper.save(Instant(0), &at(1));
    for loads in [false, true] {
        let chip = Chip {
            worn: vec![0; 16],
            ..keeper.into_inner().into_inner()
        };
        keeper = SettingsStore::new(Slots::new(chip));
        if loads {
            assert_eq!(keeper.load(), Ok(Held::Record(at(1))));
        }
        keeper.save(Instant(0), &at(1));
        assert_eq!(keeper.counters().unchanged, 1);
    }
    let chip = keeper.into_inner().into_inner();
    assert_eq!(chip.worn.iter().sum::<u32>(), 0);
}

#[test]
fn setting_up_a_module_waits_for_nothing() {
    let (tally, counters, _) = hammer(Micros::from_millis(50), Micros::from_millis(50 * BURST));
    assert_eq!(tally.writes.len() as u64, BURST);
    assert_eq!((u64::from(counters.written), counters.deferred), (BURST, 0));
}

#[test]
fn a_master_that_hammers_wears_out_nothing() {
    for every in [Micros::from_millis(700), Micros::from_secs(59)] {
        let day = HOUR * 24;
        let (tally, counters, _) = hammer(every, day);
        let most = BURST + day.0 / PERIOD.0 + 1;
        assert!(tally.writes.len() as u64 <= most, "{}", tally.writes.len());
        assert!(
            tally.writes.len() as u64 >= most - 2,
            "it is not slower, either"
        );
        let in_an_hour = |from: &Instant| {
            let until = *from + HOUR;
            tally
                .writes
                .iter()
                .filter(|at| *from <= **at && **at < until)
                .count()
        };
        assert!(tally.writes.iter().map(in_an_hour).max() <= Some(36));
        assert!(counters.deferred > 1_000);
        assert_eq!(usize::from(counters.written), tally.writes.len());
        // The comparison with what is stored is done in RAM.
        assert!(
            tally.reads <= tally.writes.len() + 1,
            "{} reads",
            tally.reads
        );
    }
}

#[test]
fn a_year_of_it_stays_below_the_promised_writes() {
    let (tally, ..) = hammer(PERIOD, HOUR * 24 * 365);
    assert!(tally.writes.len() <= 52_590, "{}", tally.writes.len());
    let (tally, ..) = hammer(Micros::from_secs(299), HOUR * 24 * 365);
    assert!(tally.writes.len() <= 52_590, "{}", tally.writes.len());
    assert!(tally.writes.len() >= 52_580, "{}", tally.writes.len());
}

#[test]
fn what_had_to_wait_is_written_when_it_may() {
    let mut keeper = SettingsStore::new(Slots::new(Chip::blank()));
    let now = Instant(5_000);
    for number in 0..BURST {
        keeper.save(now, &at(1 + number as u8));
    }
    keeper.save(now, &at(31));
    keeper.save(now, &at(32));
    assert!(keeper.is_waiting());
    assert_eq!(keeper.counters().deferred, 2);
    assert_eq!(keeper.load(), Ok(Held::Record(at(BURST as u8))));
    let due = keeper.poll(now).expect("it waits");
    assert_eq!(due, now + PERIOD);
    assert_eq!(
        keeper.poll(Instant(due.0 - 1)),
        Some(due),
        "not a moment earlier"
    );
    assert_eq!(keeper.load(), Ok(Held::Record(at(BURST as u8))));
    assert_eq!(keeper.poll(due), None);
    assert_eq!(
        keeper.load(),
        Ok(Held::Record(at(32))),
        "the last one, and only it"
    );
    assert_eq!(u64::from(keeper.counters().written), BURST + 1);
    assert!(!keeper.is_waiting());
}

#[test]
fn a_change_that_is_taken_back_is_not_written() {
    let mut keeper = SettingsStore::new(Slots::new(Chip::blank()));
    for number in 0..BURST {
        keeper.save(Instant(0), &at(1 + number as u8));
    }
    keeper.save(Instant(0), &at(32));
    keeper.save(Instant(1), &at(BURST as u8));
    assert!(!keeper.is_waiting());
    assert_eq!(keeper.poll(Instant(0) + PERIOD), None);
    assert_eq!(u64::from(keeper.counters().written), BURST);
}

#[test]
fn a_newer_firmwares_settings_are_left_alone() {
    let mut chip = Chip::blank();
    let older = slot_image(&at(3).encode(), 7);
    let mut bytes = [0; 80];
    bytes[0] = 2;
    let newer = slot_image(&bytes, 8);
    for (image, at) in [(older, 0), (newer, SLOT as usize)] {
        chip.bytes[at..at + image.bytes().len()].copy_from_slice(image.bytes());
    }
    let before = chip.bytes.clone();
    for loads in [false, true] {
        let mut keeper = SettingsStore::new(Slots::new(chip.clone()));
        if loads {
            assert_eq!(keeper.load(), Ok(Held::Newer(2)), "not what was before it");
        }
        keeper.save(Instant(0), &at(1));
        assert_eq!(keeper.counters().refused, 1);
        assert!(!keeper.is_waiting());
        assert_eq!(keeper.into_inner().into_inner().bytes, before);
    }
}

#[test]
fn a_chip_that_does_not_answer_is_tried_again() {
    let mut chip = Chip::blank();
    chip.dead = true;
    let mut keeper = SettingsStore::new(Slots::new(chip));
    assert_eq!(keeper.load(), Err(Dead));
    keeper.save(Instant(0), &at(1));
    assert!(keeper.is_waiting());
    assert_eq!(keeper.poll(Instant(1)), Some(Instant(0) + RETRY));
    assert_eq!(keeper.counters().failed, 1);
    assert_eq!(
        keeper.poll(Instant(0) + RETRY),
        Some(Instant(0) + RETRY * 2)
    );
    assert_eq!(
        (keeper.counters().failed, keeper.counters().written),
        (2, 0)
    );
}

/// A chip that is worn out, or write-protected: it acknowledges and keeps its old contents.
#[test]
fn what_does_not_read_back_is_not_called_written() {
    let chip = Chip {
        stuck: true,
        ..Chip::blank()
    };
    let mut keeper = SettingsStore::new(Slots::new(chip));
    keeper.save(Instant(0), &at(1));
    let mut now = Instant(0);
    while let Some(due) = keeper.poll(now).filter(|due| *due < Instant(0) + HOUR * 24) {
        assert!(due > now, "it does not turn in circles");
        now = due;
    }
    let Counters {
        written, failed, ..
    } = keeper.counters();
    assert_eq!(written, 0);
    assert!(
        (170..=175).contains(&failed),
        "{failed}: as many as may be written"
    );
    assert!(keeper.is_waiting());
}
