//! Lines with faults: slow modules, two on one address, and modules that follow no datasheet.

use crate::bench::{Bench, module};
use railbus_commission::scan::{Detail, Known, LeftOut, ScanOptions, Scanner, Scope, Verdict};
use railbus_device::{Family, Setup};
use railbus_sim::{Chance, DurationRange, Faults};
use railbus_wire::{Address, Baud, Micros, Protocol, SerialSettings};

fn at_9600(family: Family, address: u8, protocol: Protocol) -> Setup {
    module(family, address, protocol, Baud::B9600)
}

fn quick() -> Scope {
    Scope::of(&ScanOptions::default(), Vec::new())
}

/// Slower than the reply timeout, and not dropping their replies: none is missed, and none is taken
/// for another.
#[test]
fn late_replies_are_found_and_no_other_in_their_place() {
    for slow in [20, 28, 33, 35, 38, 43, 50, 61, 74, 88, 110, 160, 250] {
        let mut bench = Bench::new();
        let modules = [
            (Family::Eda9060a, 7, Protocol::Ascii, true),
            (Family::Eda9050, 8, Protocol::Ascii, false),
            (Family::Eda9050, 12, Protocol::Lc02, true),
            (Family::Eda9060a, 13, Protocol::Lc02, false),
            (Family::R55, 32, Protocol::R55, true),
            (Family::Erc8, 20, Protocol::Rtu, true),
            (Family::Eda9060a, 21, Protocol::Rtu, false),
            (Family::Erc8, 22, Protocol::Rtu, false),
        ];
        for (family, address, protocol, late) in modules {
            let id = bench.add(&at_9600(family, address, protocol), 5);
            let faults = Faults {
                late: Chance::ALWAYS,
                late_by: DurationRange::millis(slow, slow),
                ..Faults::NONE
            };
            if late {
                bench.line.set_module_faults(id, faults);
            }
        }
        let ran = bench.scan(quick());
        let all = [
            "9600 8N1 007 ascii EDA9060A ok",
            "9600 8N1 008 ascii EDA9050 ok",
            "9600 8N1 012 lc02 EDA9050 ok",
            "9600 8N1 013 lc02 EDA9060A ok",
            "9600 8N1 020 rtu ERC-8 ok",
            "9600 8N1 021 rtu EDA9060A ok",
            "9600 8N1 022 rtu ERC-8 ok",
            "9600 8N1 032 r55 0x55 board ok",
        ];
        assert_eq!(ran.found, all, "{slow} ms");
    }
}

#[test]
fn two_modules_on_one_address_are_told_of() {
    for (first, second) in [(5, 5), (5, 7), (9, 5), (5, 12)] {
        for protocol in [Protocol::Rtu, Protocol::Lc02] {
            let mut bench = Bench::new();
            bench.add(&at_9600(Family::Eda9060a, 4, protocol), 5);
            bench.add(&at_9600(Family::Eda9060a, 7, protocol), first);
            bench.add(&at_9600(Family::Eda9050, 7, protocol), second);
            let ran = bench.scan(quick());
            let conflicts: Vec<u8> = ran
                .all
                .iter()
                .filter(|found| found.is_conflict())
                .map(|found| found.asked.address.0)
                .collect();
            assert_eq!(
                conflicts,
                [7],
                "{first} {second} {protocol} {:?}",
                ran.found
            );
            assert_eq!(ran.found.len(), 2, "{:?}", ran.found);
        }
    }
}

/// A module that drops its reply when anything else is sent is found where the scan waits for it.
#[test]
fn slow_modules_are_found_by_a_longer_wait() {
    let mut bench = Bench::new();
    bench.add(&at_9600(Family::Eda9060a, 7, Protocol::Ascii), 150);
    bench.add(&at_9600(Family::Eda9050, 9, Protocol::Lc02), 150);
    assert_eq!(bench.scan(quick()).found.len(), 0);
    let patient = ScanOptions {
        silence: Some(Micros::from_millis(200)),
        ..ScanOptions::default()
    };
    assert_eq!(bench.scan(Scope::of(&patient, Vec::new())).found.len(), 2);
}

/// Its reply comes twice: the line duplicates it, or there are two modules.
#[test]
fn a_module_that_answers_twice_is_told_of() {
    for (protocol, pause) in [
        (Protocol::Rtu, 2),
        (Protocol::Rtu, 30),
        (Protocol::Lc02, 20),
    ] {
        let mut bench = Bench::new();
        bench.add(&at_9600(Family::Eda9060a, 4, Protocol::Lc02), 5);
        let twice = bench.add(&at_9600(Family::Eda9060a, 7, protocol), 5);
        let again = Faults {
            again: Chance::ALWAYS,
            again_after: DurationRange::millis(pause, pause),
            ..Faults::NONE
        };
        bench.line.set_module_faults(twice, again);
        let ran = bench.scan(quick());
        let told = [
            "9600 8N1 004 lc02 EDA9060A ok".to_owned(),
            format!("9600 8N1 007 {protocol} EDA9060A garbled"),
        ];
        assert_eq!(ran.found, told, "{pause} ms");
        assert_eq!(ran.all[1].detail(), Detail::Twice);
    }
}

#[test]
fn replies_that_differ_are_told_of_as_such() {
    let mut bench = Bench::new();
    bench.add(&at_9600(Family::Eda9060a, 7, Protocol::Lc02), 5);
    bench.add(&at_9600(Family::Eda9050, 7, Protocol::Lc02), 6);
    let ran = bench.scan(quick());
    let found = &ran.all[0];
    assert_eq!(found.verdict(), Verdict::Garbled);
    let spoilt = Detail::Spoilt {
        tries: 3,
        differ: true,
    };
    assert_eq!(found.detail(), spoilt);
}

/// A single board answers wherever its address is; two of them collide.
#[test]
fn a_lone_board_is_found_beyond_the_addresses() {
    let mut bench = Bench::new();
    bench.add(&at_9600(Family::R55, 77, Protocol::R55), 5);
    let ran = bench.scan(quick());
    assert_eq!(ran.found, ["9600 8N1 077 r55 0x55 board ok"]);
    assert!(!ran.scanner.is_crowded());
    let mut bench = Bench::new();
    bench.add(&at_9600(Family::R55, 77, Protocol::R55), 5);
    bench.add(&at_9600(Family::R55, 78, Protocol::R55), 5);
    let ran = bench.scan(quick());
    assert_eq!((ran.found.len(), ran.scanner.is_crowded()), (0, true));
    // If two are known, the broadcast is not sent.
    let mut bench = Bench::new();
    bench.add(&at_9600(Family::R55, 1, Protocol::R55), 5);
    bench.add(&at_9600(Family::R55, 2, Protocol::R55), 5);
    let ran = bench.scan(quick());
    assert_eq!((ran.found.len(), ran.scanner.is_crowded()), (2, false));
    assert!(ran.frames.iter().all(|frame| frame.get(1) != Some(&245)));
}

/// An adapter that echoes changes nothing.
#[test]
fn an_echo_is_nobody() {
    let mut bench = Bench::new();
    bench.line.set_echo(true);
    bench.add(&at_9600(Family::Eda9060a, 7, Protocol::Ascii), 5);
    bench.add(&at_9600(Family::Erc8, 3, Protocol::Rtu), 5);
    let ran = bench.scan(quick());
    let all = [
        "9600 8N1 003 rtu ERC-8 ok",
        "9600 8N1 007 ascii EDA9060A ok",
    ];
    assert_eq!(ran.found, all);
}

#[test]
fn known_modules_come_first_and_are_compared() {
    let mut bench = Bench::new();
    bench.add(&module(Family::Erc8, 9, Protocol::Rtu, Baud::B19200), 45);
    bench.add(&at_9600(Family::Emd2a2q, 3, Protocol::Rtu), 5);
    let known = |name: &str, family, address, baud| Known {
        name: name.to_owned(),
        family,
        settings: SerialSettings {
            baud,
            ..SerialSettings::FACTORY
        },
        protocol: Protocol::Rtu,
        address: Address(address),
        checksum: false,
    };
    let known = vec![
        known("oven", Family::Erc8, 9, Baud::B19200),
        known("tank", Family::Erc8, 3, Baud::B9600),
        known("gone", Family::Erc8, 4, Baud::B9600),
    ];
    let ran = bench.scan(Scope::of(&ScanOptions::default(), known));
    let told: Vec<(Option<&str>, bool)> = ran
        .all
        .iter()
        .map(|found| (found.known.as_deref(), found.differs))
        .collect();
    let right = [(Some("oven"), false), (Some("tank"), true)];
    assert_eq!(told, right, "{:?}", ran.all);
    assert_eq!(ran.scanner.missing().collect::<Vec<_>>(), ["gone"]);
    assert_eq!(ran.frames[0][..2], [9, 1]);
}

/// A lone CR is sent before every ASCII frame, and before no other.
#[test]
fn a_lone_cr_stands_before_ascii() {
    let ran = Bench::new().scan(quick());
    let (mut ascii, mut others) = (0, 0);
    for frame in &ran.frames {
        match frame.as_slice() {
            [b'\r', b'$', ..] => ascii += 1,
            [first, second, ..] => {
                assert!(*first != b'$' && *second != b'$');
                others += 1;
            }
            short => panic!("{short:?}"),
        }
    }
    assert!(ascii >= 64 && others >= 96, "{ascii} {others}");
}

/// Interrupted anywhere and resumed, it finds the same as in one go.
#[test]
fn a_scan_that_was_broken_off_goes_on() {
    let line = || {
        let mut bench = Bench::new();
        bench.add(&at_9600(Family::Eda9060a, 7, Protocol::Ascii), 12);
        bench.add(&at_9600(Family::Eda9050, 12, Protocol::Lc02), 20);
        bench.add(&at_9600(Family::R55, 1, Protocol::R55), 3);
        bench.add(&at_9600(Family::Eda9050, 20, Protocol::Rtu), 5);
        bench.add(&at_9600(Family::Erc8, 31, Protocol::Rtu), 5);
        bench
    };
    let whole = line().scan(quick()).found;
    assert_eq!(whole.len(), 5, "{whole:?}");
    for questions in (0..190).step_by(3) {
        let mut bench = line();
        let first = bench.drive(Scanner::new(quick()), questions);
        let (place, again) = first.scanner.place();
        let left: Vec<LeftOut> = first.scanner.left_out();
        assert!(questions > 0 || left.len() == 6, "{questions} {left:?}");
        // The user takes some time to resume it.
        bench.now = bench.now + Micros::from_secs(1);
        let scanner = Scanner::resume(quick(), place, &again, first.all);
        let second = bench.drive(scanner, usize::MAX);
        assert_eq!(second.found, whole, "broken off after {questions}");
    }
}

/// Modules that can identify themselves do; the others are found as before, and no output moves.
#[test]
fn modules_say_what_they_are_where_they_can() {
    let kinds = [
        (Family::Erc8, Protocol::Rtu),
        (Family::Emd2a2q, Protocol::Rtu),
        (Family::Eda9060a, Protocol::Rtu),
        (Family::Eda9050, Protocol::Rtu),
        (Family::Eda9050, Protocol::Ascii),
        (Family::Eda9050, Protocol::Lc02),
        (Family::R55, Protocol::R55),
    ];
    let version = env!("CARGO_PKG_VERSION");
    let describing = ScanOptions {
        describes: true,
        ..ScanOptions::default()
    };
    for describes in [false, true] {
        let mut bench = Bench::new();
        let mut wanted = Vec::new();
        for (nth, us) in (0..14).map(|nth| (nth, nth % 2 == 1)) {
            let (family, protocol) = kinds[nth / 2];
            let address = u8::try_from(nth + 3).unwrap();
            bench.add_made_by(&at_9600(family, address, protocol), 15, us);
            let says = match protocol {
                Protocol::Rtu => Some(format!("railbus {} {version}", family.name())),
                Protocol::Ascii => Some(format!("railbus {version}")),
                Protocol::Lc02 | Protocol::R55 => None,
            };
            wanted.push((address, says.filter(|_| us && describes)));
        }
        let wish = match describes {
            true => &describing,
            false => &ScanOptions::default(),
        };
        let ran = bench.scan(Scope::of(wish, Vec::new()));
        let says = ran
            .all
            .iter()
            .map(|found| (found.asked.address.0, found.description()));
        let mut says: Vec<_> = says.collect();
        says.sort();
        assert_eq!(says, wanted);
        assert!(
            ran.all.iter().all(|found| match found.verdict() {
                Verdict::Ok => true,
                // Over Modbus nothing proves an EDA9050.
                verdict => verdict == Verdict::CouldBe && [9, 10].contains(&found.asked.address.0),
            }),
            "{:?}",
            ran.found
        );
        assert_eq!(bench.moved, 0);
        let asks = |code: u8| ran.frames.iter().any(|frame| frame.get(1) == Some(&code));
        assert_eq!(asks(0x2B), describes, "nobody is asked unasked");
    }
}
