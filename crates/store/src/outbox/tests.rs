use super::*;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

/// A file of its own, removed at the end.
struct Place(PathBuf);

impl Place {
    fn new() -> Place {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder = std::env::temp_dir();
        let folder = folder.join(format!("railbus-outbox-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Place(folder)
    }

    fn file(&self) -> PathBuf {
        self.0.join("plant.outbox.db")
    }

    fn open(&self) -> Outbox {
        Outbox::open(&self.file()).unwrap()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn reading(at: i64, value: &str) -> OutboxEntry {
    OutboxEntry {
        at,
        what: EntryKind::Reading {
            path: format!("oven.k{}", at % 3),
            value: Some(value.to_owned()),
            quality: "good".to_owned(),
            reason: None,
            time: Some(at - 5),
        },
    }
}

fn readings(from: i64, count: i64) -> Vec<OutboxEntry> {
    (from..from + count).map(|at| reading(at, "true")).collect()
}

fn numbers(piece: &Piece) -> std::ops::Range<u64> {
    piece.first..piece.first + piece.entries.len() as u64
}

#[test]
fn what_goes_in_comes_out_in_its_order_and_stays_until_it_is_delivered() {
    let place = Place::new();
    let mut outbox = place.open();
    assert_eq!(outbox.read(0, 10), Ok(None));
    assert_eq!((outbox.newest(), outbox.known_until()), (Ok(0), Ok(None)));
    let gap = OutboxEntry {
        at: 3,
        what: EntryKind::Gap {
            from: Some(2),
            reason: "restart".to_owned(),
        },
    };
    let bad = OutboxEntry {
        at: 4,
        what: EntryKind::Reading {
            path: "oven.ai1".to_owned(),
            value: None,
            quality: "bad".to_owned(),
            reason: Some("offline".to_owned()),
            time: None,
        },
    };
    let all = vec![reading(1, "true"), reading(2, "21.5"), gap, bad];
    assert_eq!(outbox.append(&all), Ok(4));
    let first = outbox.read(0, 3).unwrap().unwrap();
    assert_eq!((numbers(&first), &first.entries[..]), (1..4, &all[..3]));
    let rest = outbox.read(3, 3).unwrap().unwrap();
    assert_eq!((numbers(&rest), &rest.entries[..]), (4..5, &all[3..]));
    assert_eq!(outbox.read(4, 3), Ok(None));

    outbox.delivered(2, false).unwrap();
    let left = outbox.read(0, 10).unwrap().unwrap();
    assert_eq!((numbers(&left), left.missing), (3..5, None));
    assert_eq!(outbox.known_until(), Ok(Some(4)));
}

#[test]
fn no_number_is_used_twice() {
    let place = Place::new();
    let mut outbox = place.open();
    let epoch = outbox.epoch().to_owned();
    outbox.append(&readings(1, 5)).unwrap();
    outbox.delivered(5, false).unwrap();
    drop(outbox);
    let mut outbox = place.open();
    assert_eq!((outbox.epoch(), outbox.newest()), (&*epoch, Ok(5)));
    assert_eq!(
        outbox.known_until(),
        Ok(Some(5)),
        "of what is no longer there"
    );
    assert_eq!(outbox.append(&readings(9, 1)), Ok(6));
    let piece = outbox.read(0, 10).unwrap().unwrap();
    assert_eq!((numbers(&piece), piece.missing), (6..7, None));
    assert_eq!(outbox.known_until(), Ok(Some(9)));
    outbox.known(30).unwrap();
    assert_eq!(outbox.known_until(), Ok(Some(30)));
    // What was told before does not take anything back.
    outbox.delivered(2, false).unwrap();
    assert_eq!(outbox.read(0, 10).unwrap(), Some(piece));
}

#[test]
fn it_has_one_owner() {
    let place = Place::new();
    let mut outbox = place.open();
    let second = Outbox::open(&place.file()).unwrap_err();
    assert!(!second.is_broken, "{second:?}");
    outbox.append(&readings(1, 1)).unwrap();
    drop(outbox);
    assert_eq!(place.open().newest(), Ok(1));
}

#[test]
fn what_is_dropped_is_told() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1_000, 10)).unwrap();
    outbox.delivered(3, false).unwrap();
    let keep = |age_ms| OutboxKeep {
        age_ms,
        bytes: u64::MAX,
        is_for_again: false,
    };
    assert_eq!(outbox.prune(keep(500), 1_500), Ok((0, false)));
    assert_eq!(outbox.prune(keep(500), 1_506), Ok((3, false)));
    let missing = |count, from, to| {
        Some(DroppedEntries {
            count,
            from: Some(from),
            to,
        })
    };
    let piece = outbox.read(0, 2).unwrap().unwrap();
    assert_eq!(
        (numbers(&piece), piece.missing),
        (7..9, missing(3, 1_002, 1_006))
    );
    // Also after what is on its way.
    assert_eq!(outbox.prune(keep(500), 1_509), Ok((3, false)));
    let piece = outbox.read(8, 2).unwrap().unwrap();
    assert_eq!(
        (numbers(&piece), piece.missing),
        (10..11, missing(1, 1_002, 1_009))
    );
    outbox.delivered(10, false).unwrap();
    assert_eq!(outbox.prune(keep(0), 9_999), Ok((0, false)));
    assert_eq!(outbox.append(&readings(2_000, 1)), Ok(11));
    assert_eq!(outbox.read(0, 2).unwrap().unwrap().missing, None);
}

#[test]
fn it_does_not_outgrow_its_bytes() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1, 50_000)).unwrap();
    let bytes = outbox.used().unwrap();
    let keep = OutboxKeep {
        age_ms: i64::MAX,
        bytes: bytes / 2,
        is_for_again: false,
    };
    assert_eq!(outbox.prune(keep, 60_000), Ok((20_000, true)));
    assert_eq!(outbox.prune(keep, 60_000), Ok((20_000, true)));
    assert_eq!(outbox.prune(keep, 60_000), Ok((0, false)));
    let piece = outbox.read(0, 1).unwrap().unwrap();
    assert_eq!(
        (piece.first, piece.missing.unwrap().count),
        (40_001, 40_000)
    );
    outbox.tidy().unwrap();
    let size = std::fs::metadata(place.file()).unwrap().len();
    assert!(size <= bytes / 2, "{size} of {bytes}");
}

#[test]
fn a_broken_file_is_put_aside_and_another_epoch_begins() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1, 3)).unwrap();
    let epoch = outbox.epoch().to_owned();
    drop(outbox);
    std::fs::write(place.file(), "This is no database, but text.").unwrap();
    let mut outbox = place.open();
    assert_ne!(outbox.epoch(), epoch);
    assert_eq!(outbox.append(&readings(1, 1)), Ok(1));
    let names = std::fs::read_dir(&place.0).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let aside = names.filter(|name| name.starts_with("plant.outbox.broken-"));
    assert_eq!(aside.count(), 1);

    drop(outbox);
    Outbox::remove(&place.file());
    assert!(!place.file().exists());
}

#[test]
fn what_fails_leaves_nothing_half_done() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1, 2)).unwrap();
    outbox
        .db
        .execute_batch(
            "CREATE TRIGGER refuse BEFORE INSERT ON entries WHEN new.at = 13
             BEGIN SELECT raise(ABORT, 'no'); END",
        )
        .unwrap();
    let failed = outbox.append(&readings(11, 5)).unwrap_err();
    assert_eq!((failed.is_broken, &*failed.reason), (false, "no"));
    assert_eq!(
        (outbox.newest(), outbox.append(&readings(21, 1))),
        (Ok(2), Ok(3))
    );
    let piece = outbox.read(0, 10).unwrap().unwrap();
    let path = |entry: &OutboxEntry| match &entry.what {
        EntryKind::Reading { path, .. } => path.clone(),
        EntryKind::Gap { .. } => String::new(),
    };
    let paths: Vec<String> = piece.entries.iter().map(path).collect();
    assert_eq!(paths, ["oven.k1", "oven.k2", "oven.k0"]);
}

/// The page with the newest entry is overwritten.
fn break_last_leaf(file: &Path) {
    let db = Connection::open(file).unwrap();
    db.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))
        .unwrap();
    drop(db);
    let mut bytes = std::fs::read(file).unwrap();
    let pages = bytes.len() / 4096;
    // A leaf of a table begins with 13; that of `entries` that was filled last.
    let last = (1..pages)
        .rev()
        .find(|page| bytes[page * 4096] == 13)
        .unwrap();
    bytes[last * 4096..][..4096].fill(0xFF);
    std::fs::write(file, bytes).unwrap();
}

#[test]
fn a_page_that_is_broken_is_not_met_again_and_again() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1, 5_000)).unwrap();
    let epoch = outbox.epoch().to_owned();
    drop(outbox);
    break_last_leaf(&place.file());
    let mut outbox = place.open();
    let failed = outbox.append(&readings(6_000, 1)).unwrap_err();
    assert!(failed.is_broken, "{failed:?}");
    drop(outbox);
    Outbox::put_aside(&place.file()).unwrap();
    let mut outbox = place.open();
    assert_eq!(outbox.append(&readings(6_000, 1)), Ok(1));
    assert_ne!(outbox.epoch(), epoch);
}

#[test]
fn what_was_dropped_is_told_although_nothing_came_after_it() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1_000, 10)).unwrap();
    let keep = OutboxKeep {
        age_ms: 500,
        bytes: u64::MAX,
        is_for_again: false,
    };
    assert_eq!(outbox.prune(keep, 1_000_000), Ok((9, false)));
    assert_eq!(outbox.prune(keep, 1_000_000), Ok((0, false)));
    let piece = outbox.read(0, 20).unwrap().unwrap();
    assert_eq!((numbers(&piece), piece.missing.unwrap().count), (10..11, 9));
}

#[test]
fn entries_of_a_clock_that_was_wrong_drop_no_good_ones() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1_000_000, 100)).unwrap();
    // A start without a clock.
    outbox.append(&readings(0, 10)).unwrap();
    let keep = OutboxKeep {
        age_ms: 500,
        bytes: u64::MAX,
        is_for_again: false,
    };
    assert_eq!(outbox.prune(keep, 1_000_200), Ok((0, false)));
}

#[test]
fn what_is_delivered_can_be_read_again_while_it_is_kept() {
    let place = Place::new();
    let mut outbox = place.open();
    outbox.append(&readings(1, 10)).unwrap();
    outbox.delivered(8, true).unwrap();
    // Whoever reads on gets what is new.
    let piece = outbox.read(0, 10).unwrap().unwrap();
    assert_eq!((numbers(&piece), piece.missing), (9..11, None));
    let again = |outbox: &Outbox, span, count| {
        let piece = outbox.read_again(span, count).unwrap();
        piece.map(|piece| (numbers(&piece), piece.entries[0].at))
    };
    assert_eq!(again(&outbox, (3, 9), 4), Some((3..7, 3)));
    assert_eq!(again(&outbox, (3, 5), 100), Some((3..6, 3)));
    assert_eq!(again(&outbox, (11, 20), 100), None);
    assert_eq!(again(&outbox, (5, 4), 100), None);
    // The oldest are too old; of those nothing was lost that was not delivered.
    let keep = OutboxKeep {
        age_ms: 10,
        bytes: u64::MAX,
        is_for_again: true,
    };
    assert_eq!(outbox.prune(keep, 15), Ok((0, false)));
    assert_eq!(again(&outbox, (1, 10), 100), Some((5..11, 5)));
    assert_eq!(
        outbox.prune(keep, 20),
        Ok((1, false)),
        "9 was not delivered"
    );
    let piece = outbox.read(8, 10).unwrap().unwrap();
    assert_eq!(numbers(&piece), 10..11);
    assert_eq!(piece.missing.map(|missing| missing.count), Some(1));
    drop(outbox);
    let outbox = place.open();
    assert_eq!(again(&outbox, (1, 10), 100), Some((10..11, 10)));
}
