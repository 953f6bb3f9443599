//! The store in NOR flash: cut off at every step, full of noise, and worn.

mod support;

use proptest::collection::vec;
use proptest::prelude::*;
use railbus_device::Family;
use railbus_nvm::{BadRange, Flash, Held, Record, SettingsStore};
use railbus_wire::Instant;
use support::nor::{Cut, Erasing, Nor, SECTOR};
use support::{Rng, factory, history, record};

const SECTORS: usize = 2;

fn keeper(nor: Nor) -> SettingsStore<Flash<Nor>> {
    let range = 0..nor.bytes.len() as u32;
    SettingsStore::new(Flash::new(nor, range).expect("two sectors"))
}

/// What is held, and the flash, which reading may have repaired.
fn load(nor: Nor) -> (Held, Nor) {
    let mut keeper = keeper(nor.restored());
    let held = keeper.load().expect("the power is back");
    (held, keeper.into_inner().into_inner())
}

fn save(nor: Nor, record: Record) -> Nor {
    let mut keeper = keeper(nor);
    keeper.save(Instant(0), &record);
    keeper.into_inner().into_inner()
}

/// How many steps it takes to save this.
fn steps(nor: &Nor, record: Record) -> usize {
    save(nor.clone().restored(), record).steps
}

fn cuts(steps: usize, seeds: u64, salt: u64) -> impl Iterator<Item = Cut> {
    (0..steps).flat_map(move |after| {
        Erasing::ALL.into_iter().flat_map(move |erasing| {
            (0..seeds).map(move |n| Cut {
                after,
                erasing,
                seed: Rng(salt << 40 | n << 32 | after as u64).next(),
            })
        })
    })
}

#[test]
fn a_cut_at_any_step_leaves_the_old_or_the_new() {
    let (mut nor, mut before) = (Nor::blank(SECTORS), Held::Nothing);
    let (mut count, mut old, mut new) = (0, 0, 0);
    for (number, record) in history(12).into_iter().enumerate() {
        for cut in cuts(steps(&nor, record), 4, number as u64) {
            let mut nor = nor.clone().restored();
            nor.cut = Some(cut);
            let nor = save(nor, record);
            assert!(nor.dead, "the power failed while it was writing");
            let (held, nor) = load(nor);
            count += 1;
            old += usize::from(held == before);
            new += usize::from(held == Held::Record(record));
            let whole = held == before || held == Held::Record(record);
            assert!(whole, "write {number}, {cut:?}: {held:?}");
            let mut nor = nor;
            for after in 30..32 {
                let after = factory(Family::Erc8, after);
                let (held, left) = load(save(nor, after));
                assert_eq!(held, Held::Record(after), "write {number}, {cut:?}");
                nor = left;
            }
        }
        nor = save(nor.restored(), record);
        before = Held::Record(record);
    }
    assert_eq!(count, 31_680, "cuts");
    assert!(old > 0 && new > 0, "{old} old, {new} new");
    assert!(
        nor.erased.iter().all(|count| *count > 0),
        "all were gone through"
    );
    assert_eq!(nor.twice, 0);
}

/// The second loss of power comes during recovery from the first, at every step of it.
#[test]
fn a_cut_after_a_cut_leaves_the_old_or_the_new() {
    let mut nor = Nor::blank(SECTORS);
    let mut count = 0;
    for (number, records) in history(14).windows(2).enumerate() {
        let [first, second] = records else { continue };
        let salt = number as u64;
        for one in cuts(steps(&nor, *first), 1, salt).step_by(13) {
            let mut nor = nor.clone().restored();
            nor.cut = Some(one);
            let once = save(nor, *first).restored();
            let (held, _) = load(once.clone());
            for two in cuts(steps(&once, *second), 1, !salt).step_by(17) {
                let mut nor = once.clone();
                nor.cut = Some(two);
                let (now, nor) = load(save(nor, *second));
                let whole = now == held || now == Held::Record(*second);
                assert!(whole, "write {number}, {one:?}, {two:?}: {held:?}, {now:?}");
                let after = factory(Family::Erc8, 32);
                assert_eq!(
                    load(save(nor, after)).0,
                    Held::Record(after),
                    "{one:?}, {two:?}"
                );
                count += 1;
            }
        }
        nor = save(nor.restored(), *first);
    }
    assert!(count > 15_000, "{count} pairs of cuts");
}

#[test]
fn the_sectors_wear_alike() {
    let mut nor = Nor::blank(4);
    for number in 0..2_000_u32 {
        nor = save(
            nor.restored(),
            factory(Family::Erc8, 1 + (number % 31) as u8),
        );
    }
    let (most, least) = (nor.erased.iter().max(), nor.erased.iter().min());
    assert!(
        most.zip(least)
            .is_some_and(|(most, least)| most - least <= 1),
        "{:?}",
        nor.erased
    );
    // A sector of this model has room for four.
    assert_eq!(most, Some(&125));
}

#[test]
fn a_range_that_can_not_be_used_is_refused() {
    let sector = SECTOR as u32;
    let ranges = [
        (0, sector),
        (0, sector * 3 + 4),
        (4, sector * 4),
        (sector, sector * 9),
        (sector * 4, sector),
        (0, 0),
    ];
    for (start, end) in ranges {
        let made = Flash::new(Nor::blank(8), start..end).map(|_| ());
        assert_eq!(made, Err(BadRange), "{start}..{end}");
    }
    assert!(Flash::new(Nor::blank(8), sector * 6..sector * 8).is_ok());
}

/// Noise of all kinds: anything, mostly ones, mostly zeros, and pieces of a flash that was used.
fn noise(seed: u64) -> Nor {
    let mut rng = Rng(seed);
    let mut nor = Nor::blank(SECTORS);
    if rng.below(2) == 0 {
        for record in history(1 + rng.below(12) as u8) {
            nor = save(nor.restored(), record);
        }
    }
    let kind = rng.below(4);
    let dense = [1, 30, 1_000, SECTORS * SECTOR][rng.below(4)];
    for _ in 0..rng.below(dense) {
        let at = rng.below(SECTORS * SECTOR);
        nor.bytes[at] = match kind {
            0 => rng.next() as u8,
            1 => nor.bytes[at] | rng.next() as u8,
            2 => nor.bytes[at] & rng.next() as u8,
            _ => nor.bytes[at] ^ 1 << rng.below(8),
        };
    }
    Nor::of(nor.bytes)
}

#[test]
fn noise_is_nothing_or_a_record_and_is_got_over() {
    let mut found = [0; 2];
    for seed in 0..30_000 {
        let (held, nor) = load(noise(seed));
        if let Held::Record(record) = held {
            assert!(history(12).contains(&record), "seed {seed}: {record:?}");
        }
        found[usize::from(held == Held::Nothing)] += 1;
        let record = factory(Family::Emd2a2q, 9);
        assert_eq!(
            load(save(nor, record)).0,
            Held::Record(record),
            "seed {seed}"
        );
    }
    assert!(found.iter().all(|count| *count > 100), "{found:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]

    #[test]
    fn any_image_is_nothing_or_a_possible_module(bytes in vec(any::<u8>(), SECTORS * SECTOR)) {
        let (held, nor) = load(Nor::of(bytes));
        if let Held::Record(record) = held {
            prop_assert_eq!(record.setup().check(), Ok(()));
        }
        let record = factory(Family::Erc8, 9);
        prop_assert_eq!(load(save(nor, record)).0, Held::Record(record));
    }

    #[test]
    fn whatever_is_kept_comes_back(records in vec(record(), 1..9)) {
        let mut nor = Nor::blank(SECTORS);
        for record in records {
            let (held, left) = load(save(nor, record));
            prop_assert_eq!(held, Held::Record(record));
            nor = left;
        }
    }
}
