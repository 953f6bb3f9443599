//! The store in a byte EEPROM: cut off at every byte, full of noise, disturbed, and worn.

mod support;

use proptest::collection::vec;
use proptest::prelude::*;
use railbus_device::Family;
use railbus_nvm::{Bytes, Held, Record, SLOT, SettingsStore, Slots, Store, slot_image};
use railbus_wire::Instant;
use support::chip::{Chip, Spoils};
use support::{Rng, factory, history, record};

/// Garbage is tried so often at every byte.
const SEEDS: u64 = 30;

/// A slot of one record: sequence, number, record, CRC.
const SLOT_LEN: usize = Record::LEN + 9;

fn load(chip: &Chip) -> Held {
    let chip = chip.clone().restored();
    SettingsStore::new(Slots::new(chip))
        .load()
        .expect("the power is back")
}

/// Saves a record and gives the chip back, as a loss of power or the end left it.
fn save(chip: Chip, record: Record) -> Chip {
    let mut keeper = SettingsStore::new(Slots::new(chip));
    keeper.save(Instant(0), &record);
    keeper.into_inner().into_inner()
}

fn spoils(at: usize) -> impl Iterator<Item = Spoils> {
    let seed = move |n: u64| n << 32 | at as u64;
    let garbage = (0..SEEDS).flat_map(move |n| [Spoils::Byte(seed(n)), Spoils::Page(seed(n))]);
    [Spoils::Nothing, Spoils::Written]
        .into_iter()
        .chain(garbage)
}

#[test]
fn a_cut_at_any_byte_leaves_the_old_or_the_new() {
    let (mut chip, mut before) = (Chip::blank(), Held::Nothing);
    let (mut cuts, mut old, mut new) = (0, 0, 0);
    for (number, record) in history(10).into_iter().enumerate() {
        for at in 0..SLOT_LEN {
            for spoils in spoils(at + number * SLOT_LEN) {
                let mut chip = chip.clone();
                chip.cut = Some((at, spoils));
                let chip = save(chip, record);
                assert!(chip.dead, "the power failed while it was writing");
                let held = load(&chip);
                cuts += 1;
                old += usize::from(held == before);
                new += usize::from(held == Held::Record(record));
                let whole = held == before || held == Held::Record(record);
                assert!(whole, "byte {at}, {spoils:?}: {held:?}");
                // What comes after the power is back is kept as ever.
                let after = factory(Family::Erc8, 32);
                let chip = save(chip.restored(), after);
                assert_eq!(load(&chip), Held::Record(after), "byte {at}, {spoils:?}");
            }
        }
        chip = save(chip, record);
        before = Held::Record(record);
    }
    assert_eq!(cuts, 37_200, "cuts");
    assert!(old > 0 && new > 0, "{old} old, {new} new");
}

/// A second loss of power during recovery from the first.
#[test]
fn a_cut_after_a_cut_leaves_the_old_or_the_new() {
    let [first, second, third] = [1, 2, 3].map(|address| factory(Family::R55, address));
    let settled = save(Chip::blank(), first);
    let mut cuts = 0;
    for one in 0..SLOT_LEN {
        for two in 0..SLOT_LEN {
            for seed in 0..5 {
                let seed = seed << 32 | (one * SLOT_LEN + two) as u64;
                let mut chip = settled.clone();
                chip.cut = Some((one, Spoils::Page(seed)));
                let mut chip = save(chip, second).restored();
                let held = load(&chip);
                chip.cut = Some((two, Spoils::Page(!seed)));
                let chip = save(chip, third);
                let now = load(&chip);
                let whole = now == held || now == Held::Record(third);
                assert!(whole, "bytes {one} and {two}: {held:?}, {now:?}");
                cuts += 1;
            }
        }
    }
    assert_eq!(cuts, 18_000, "pairs of cuts");
}

/// The first sequence numbers of a chip that had many writes: also around the wrap of the numbers.
#[test]
fn the_higher_sequence_counts_round_the_end() {
    let [old, new, next] = [1, 2, 3].map(|address| factory(Family::Erc8, address));
    let sequences = [0, 1, 41, i32::MAX as u32, u32::MAX - 1, u32::MAX];
    for sequence in sequences {
        for swapped in [false, true] {
            let mut chip = Chip::blank();
            let places = if swapped {
                [SLOT as usize, 0]
            } else {
                [0, SLOT as usize]
            };
            let sequences = [sequence, sequence.wrapping_add(1)];
            for ((record, sequence), at) in [old, new].iter().zip(sequences).zip(places) {
                let image = slot_image(&record.encode(), sequence);
                chip.bytes[at..at + SLOT_LEN].copy_from_slice(image.bytes());
            }
            assert_eq!(load(&chip), Held::Record(new), "{sequence}");
            let chip = save(chip, next);
            assert_eq!(load(&chip), Held::Record(next), "after {sequence}");
            let kept = slot_image(&new.encode(), sequence.wrapping_add(1));
            let at = places[1];
            assert_eq!(&chip.bytes[at..at + SLOT_LEN], kept.bytes(), "untouched");
        }
    }
}

#[test]
fn a_chip_as_it_leaves_its_factory_holds_nothing() {
    for byte in [0x00, 0xFF] {
        for len in [256, 512, 4096] {
            let chip = Chip::of(vec![byte; len]);
            assert_eq!(load(&chip), Held::Nothing);
            let record = factory(Family::Emd2a2q, 5);
            assert_eq!(load(&save(chip, record)), Held::Record(record));
        }
    }
}

#[test]
fn an_image_made_elsewhere_is_read() {
    let record = factory(Family::Eda9050, 17);
    let mut chip = Chip::blank();
    let image = slot_image(&record.encode(), 1);
    chip.bytes[..SLOT_LEN].copy_from_slice(image.bytes());
    assert_eq!(load(&chip), Held::Record(record));
    assert!(
        slot_image(&[0; 120], 1).bytes().is_empty(),
        "that does not fit"
    );
    assert_eq!(slot_image(&[0; 119], 1).bytes().len(), 128);
}

#[test]
fn a_disturbed_read_does_not_bring_back_what_was_before() {
    let [oldest, old, new] = [1, 2, 3].map(|address| factory(Family::Erc8, address));
    let chip = save(save(save(Chip::blank(), oldest), old), new);
    // It lies in the first slot, and a slot is read in two parts.
    for disturbed in 1..=4 {
        let chip = Chip {
            disturbed,
            ..chip.clone()
        };
        assert_eq!(load(&chip), Held::Record(new));
    }
}

#[test]
fn both_slots_share_the_wear() {
    let mut chip = Chip::blank();
    for number in 0..1_000_u32 {
        chip = save(chip, factory(Family::Erc8, 1 + (number % 31) as u8));
    }
    let pages: Vec<u32> = chip
        .worn
        .iter()
        .copied()
        .filter(|count| *count > 0)
        .collect();
    assert_eq!(pages, [500; 4], "two pages of each slot, and no other");
}

/// Flips some bits of a chip with good settings in both slots.
fn rotten(seed: u64) -> Chip {
    let mut rng = Rng(seed);
    let mut chip = Chip::blank();
    for address in 1..=2 {
        chip = save(chip, factory(Family::Eda9060a, address));
    }
    for _ in 0..rng.below(6) {
        let at = rng.below(2 * SLOT as usize);
        chip.bytes[at] ^= 1 << rng.below(8);
    }
    chip
}

#[test]
fn rotten_bits_leave_one_of_the_two_or_nothing() {
    let mut found = [0; 3];
    for seed in 0..50_000 {
        let kind = match load(&rotten(seed)) {
            Held::Record(record) if record == factory(Family::Eda9060a, 2) => 0,
            Held::Record(record) if record == factory(Family::Eda9060a, 1) => 1,
            Held::Nothing => 2,
            held => panic!("seed {seed}: {held:?}"),
        };
        found[kind] += 1;
    }
    assert!(found.iter().all(|count| *count > 0), "{found:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Noise, behind a frame that is right now and then, so that the CRC does not hide it all.
    #[test]
    fn any_image_is_nothing_or_a_possible_module(
        noise in vec(any::<u8>(), 256..300), framed in any::<[bool; 2]>(), sequences: [u32; 2],
        version in 0..4_u8,
    ) {
        let mut chip = Chip::of(noise);
        for (slot, at) in [0, SLOT as usize].into_iter().enumerate() {
            if framed[slot] {
                let mut bytes = chip.bytes[at..at + Record::LEN].to_vec();
                bytes[0] = version;
                let image = slot_image(&bytes, sequences[slot]);
                chip.bytes[at..at + SLOT_LEN].copy_from_slice(image.bytes());
            }
        }
        if let Held::Record(record) = load(&chip) {
            prop_assert_eq!(record.setup().check(), Ok(()));
        }
        let newer = framed != [false; 2] && version > 1;
        prop_assert_eq!(matches!(load(&chip), Held::Newer(_)), newer);
        let record = factory(Family::Erc8, 9);
        let after = load(&save(chip.clone(), record));
        let expected = if newer { load(&chip) } else { Held::Record(record) };
        prop_assert_eq!(after, expected);
    }

    #[test]
    fn whatever_is_kept_comes_back(record in record(), len in 256..300_usize) {
        let chip = save(Chip::of(vec![0xFF; len]), record);
        prop_assert_eq!(load(&chip), Held::Record(record));
        let mut room = Bytes::new();
        let bytes = Slots::new(chip).read(&mut room);
        prop_assert_eq!(bytes, Ok(Some(&record.encode()[..])));
    }
}
