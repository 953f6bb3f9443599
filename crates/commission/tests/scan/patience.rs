//! Slow modules that drop their reply when anything else is sent, on a line without other modules;
//! and the cost of waiting for them.

use crate::bench::{Bench, module};
use railbus_commission::scan::{Depth, SLOW_TIMEOUT, ScanOptions, ScanStep, Scanner, Scope};
use railbus_device::{Family, Setup};
use railbus_sim::{Chance, DurationRange, Faults};
use railbus_wire::{Baud, Micros, Protocol};

fn at_9600(family: Family, address: u8, protocol: Protocol) -> Setup {
    module(family, address, protocol, Baud::B9600)
}

fn quick() -> Scope {
    Scope::of(&ScanOptions::default(), Vec::new())
}

/// On an otherwise empty line such a module is waited for at its factory settings.
#[test]
fn a_slow_module_of_the_factory_is_found_where_nobody_else_is() {
    for depth in [Depth::Quick, Depth::Full, Depth::Deep] {
        let wish = ScanOptions {
            depth,
            ..ScanOptions::default()
        };
        for (family, protocol) in [
            (Family::Eda9060a, Protocol::Ascii),
            (Family::Eda9050, Protocol::Ascii),
            (Family::Eda9060a, Protocol::Lc02),
            (Family::Eda9060a, Protocol::Rtu),
            (Family::Erc8, Protocol::Rtu),
            (Family::Emd2a2q, Protocol::Rtu),
            (Family::R55, Protocol::R55),
        ] {
            let mut bench = Bench::new();
            let setup = at_9600(family, 1, protocol);
            match protocol {
                // Simulated ones drop their reply at any character anyway.
                Protocol::Rtu | Protocol::R55 => _ = bench.add(&setup, 160),
                Protocol::Ascii | Protocol::Lc02 => bench.add_shy(&setup, 160),
            }
            let ran = bench.scan(Scope::of(&wish, Vec::new()));
            let wanted = format!("9600 8N1 001 {protocol} {family} ok");
            assert_eq!(ran.found, [wanted], "{depth:?}");
            assert!(ran.scanner.is_slow(), "{protocol}: others may be there");
        }
    }
    // The second is waited for as well.
    let mut bench = Bench::new();
    bench.add_shy(&at_9600(Family::Eda9060a, 1, Protocol::Ascii), 160);
    bench.add_shy(&at_9600(Family::Eda9060a, 1, Protocol::Rtu), 160);
    assert_eq!(bench.scan(quick()).found.len(), 2);
    // A single board shows how slow the line is, whatever its address.
    let mut bench = Bench::new();
    bench.add(&at_9600(Family::Eda9060a, 1, Protocol::Rtu), 160);
    bench.add(&at_9600(Family::R55, 77, Protocol::R55), 160);
    assert_eq!(bench.scan(quick()).found.len(), 2);
}

/// A scan of few addresses waits for all of them if no other module is found.
#[test]
fn the_few_that_are_asked_are_waited_for_where_nobody_is_found() {
    let wish = ScanOptions {
        addresses: Some(vec![5, 6, 7]),
        bauds: Some(vec![Baud::B19200]),
        ..ScanOptions::default()
    };
    let checksum = Setup {
        checksum: true,
        ..module(Family::Eda9050, 6, Protocol::Ascii, Baud::B19200)
    };
    let rtu = module(Family::Eda9060a, 7, Protocol::Rtu, Baud::B19200);
    let mut bench = Bench::new();
    bench.add_shy(&checksum, 160);
    bench.add_shy(&rtu, 160);
    let ran = bench.scan(Scope::of(&wish, Vec::new()));
    let all = [
        "19200 8N1 006 ascii sum EDA9050 ok",
        "19200 8N1 007 rtu EDA9060A ok",
    ];
    assert_eq!(ran.found, all);
    assert!(!ran.scanner.is_slow());
}

/// How many frames of a scan of an empty line are sent only because nothing was found, and how long
/// they take: the first requests, one at the end of each speed and that for a single 0x55 board are
/// not among them.
#[test]
fn nobody_is_waited_for_a_few_times() {
    let wish = |depth, addresses: Option<Vec<u8>>| ScanOptions {
        depth,
        addresses,
        ..ScanOptions::default()
    };
    let rtu = |addresses| ScanOptions {
        protocols: Some(vec![Protocol::Rtu]),
        ..wish(Depth::Quick, Some(addresses))
    };
    let patient = ScanOptions {
        silence: Some(Micros::from_millis(400)),
        ..ScanOptions::default()
    };
    for (wish, speeds, boards, waits) in [
        (wish(Depth::Quick, None), 1, 1, 3),
        (wish(Depth::Full, None), 1, 0, 3),
        (wish(Depth::Deep, None), 5, 0, 3),
        (wish(Depth::Quick, Some(vec![1])), 1, 0, 4),
        (wish(Depth::Quick, Some(vec![1, 2, 3])), 1, 0, 14),
        (wish(Depth::Quick, Some(vec![1, 2, 3, 4])), 1, 0, 3),
        (wish(Depth::Quick, Some(vec![5, 6, 7, 8])), 1, 0, 0),
        (rtu(vec![9]), 1, 0, 0),
        (rtu((1..=16).collect()), 1, 0, 15),
        (patient, 1, 1, 0),
    ] {
        let scope = Scope::of(&wish, Vec::new());
        let first: usize = scope.runs.iter().map(|run| run.addresses.len()).sum();
        let ran = Bench::new().scan(scope);
        let before = first + speeds + boards;
        assert_eq!(ran.frames.len(), before + waits, "{wish:?}");
        let (until, _) = ran.estimates[before - 1];
        let waited = ran.took - until;
        assert!(waited <= Micros::from_secs(5), "{wish:?} {waited:?}");
    }
}

/// The broadcast of the 0x55 boards is the last request if anything was found, even late.
#[test]
fn nobody_is_waited_for_where_somebody_was_found() {
    for (address, late) in [(32, 0), (1, 0), (1, 160), (7, 160)] {
        let mut bench = Bench::new();
        let id = bench.add(&at_9600(Family::Eda9060a, address, Protocol::Ascii), 5);
        let faults = Faults {
            late: Chance::ALWAYS,
            late_by: DurationRange::millis(late, late),
            ..Faults::NONE
        };
        bench.line.set_module_faults(id, faults);
        let ran = bench.scan(quick());
        assert_eq!(ran.found.len(), 1);
        let last = ran.frames.last().and_then(|frame| frame.get(..2));
        assert_eq!(last, Some(&[0x55, 245][..]), "{address} {late}");
        assert!(!ran.scanner.is_slow());
    }
    let mut bench = Bench::new();
    bench.add(&at_9600(Family::R55, 77, Protocol::R55), 5);
    let ran = bench.scan(quick());
    // After the broadcast only its state is read, and then it listens once more.
    assert_eq!((ran.found.len(), ran.frames.len()), (1, 6 * 32 + 2 + 2));
}

/// Interrupted anywhere, with a request on the line or between two, it finds the same after
/// resuming, and reports the same about it.
#[test]
fn a_scan_that_was_broken_off_while_it_waited_goes_on() {
    let two_of_the_factory = || {
        let mut bench = Bench::new();
        bench.add_shy(&at_9600(Family::Eda9060a, 1, Protocol::Lc02), 160);
        bench.add_shy(&at_9600(Family::Eda9060a, 1, Protocol::Rtu), 160);
        bench
    };
    // As slow as a module that is still waited for.
    let one_very_slow = || {
        let mut bench = Bench::new();
        bench.add_shy(&at_9600(Family::Eda9060a, 1, Protocol::Ascii), 160);
        bench.add_shy(&at_9600(Family::Eda9060a, 1, Protocol::Rtu), 296);
        bench
    };
    let one_board_beyond = || {
        let mut bench = Bench::new();
        bench.add_shy(&at_9600(Family::Eda9060a, 1, Protocol::Rtu), 160);
        bench.add_shy(&at_9600(Family::R55, 77, Protocol::R55), 160);
        bench
    };
    let none_slow = || {
        let mut bench = Bench::new();
        bench.add(&at_9600(Family::Eda9060a, 5, Protocol::Rtu), 5);
        bench.add(&at_9600(Family::R55, 77, Protocol::R55), 5);
        bench
    };
    for (line, slow) in [
        (two_of_the_factory as fn() -> Bench, true),
        (one_very_slow, true),
        (one_board_beyond, true),
        (none_slow, false),
    ] {
        let whole = line().scan(quick());
        assert_eq!(whole.found.len(), 2, "{:?}", whole.found);
        assert_eq!(whole.scanner.is_slow(), slow);
        for questions in 0..whole.frames.len() {
            for asks_one_more in [false, true] {
                let mut bench = line();
                let mut scanner = bench.drive(Scanner::new(quick()), questions).scanner;
                while asks_one_more && matches!(scanner.next(bench.now), ScanStep::Found(_)) {}
                let (place, again) = scanner.place();
                bench.now = bench.now + Micros::from_secs(1);
                let scanner = Scanner::resume(quick(), place, &again, scanner.found().to_vec());
                let second = bench.drive(scanner, usize::MAX);
                let when = format!("broken off after {questions}, {asks_one_more}");
                assert_eq!(second.found, whole.found, "{when}");
                assert_eq!(second.scanner.is_slow(), slow, "{when}");
            }
        }
    }
}

/// A module whose first reply was lost is found by the second pass. It is not slow, and yet the
/// others are waited for: their replies may have been lost as well.
#[test]
fn who_is_found_by_asking_again_is_not_called_slow() {
    for families in [
        [
            (Family::Eda9060a, Protocol::Lc02),
            (Family::Eda9060a, Protocol::Rtu),
        ],
        // The very first address, asked again at the end of the speed.
        [
            (Family::R55, Protocol::R55),
            (Family::Eda9060a, Protocol::Rtu),
        ],
    ] {
        let mut bench = Bench::new();
        let ids = families.map(|(family, protocol)| bench.add(&at_9600(family, 1, protocol), 5));
        for id in ids {
            bench.line.set_module_faults(id, Faults::MUTE);
        }
        let ran = bench.drive(Scanner::new(quick()), 6 * 32);
        for id in ids {
            bench.line.set_module_faults(id, Faults::NONE);
        }
        let ran = bench.drive(ran.scanner, usize::MAX);
        assert_eq!(ran.found.len(), 2, "{:?}", ran.found);
        assert!(!ran.scanner.is_slow());
    }
    // The same if it resumes after an interruption while waiting for the first of two.
    let mut bench = Bench::new();
    let mut scanner = bench.drive(Scanner::new(quick()), 6 * 32 + 2).scanner;
    assert!(matches!(scanner.next(bench.now), ScanStep::Ask(_)));
    let (place, again) = scanner.place();
    bench.add(&at_9600(Family::Eda9060a, 1, Protocol::Lc02), 5);
    bench.add(&at_9600(Family::Eda9060a, 1, Protocol::Rtu), 5);
    let resumed = Scanner::resume(quick(), place, &again, Vec::new());
    let ran = bench.drive(resumed, usize::MAX);
    assert_eq!(ran.found.len(), 2, "{:?}", ran.found);
}

/// A module slower than the first pass waits, but faster than the timeout of the second, counts as
/// fast.
#[test]
fn who_answers_within_the_silence_is_not_called_slow() {
    for (family, protocol) in [
        (Family::Eda9060a, Protocol::Ascii),
        (Family::Eda9060a, Protocol::Lc02),
        (Family::Eda9060a, Protocol::Rtu),
        (Family::R55, Protocol::R55),
    ] {
        for delay in [5, 13, 16, 20, 25] {
            let mut bench = Bench::new();
            bench.add(&at_9600(family, 1, protocol), delay);
            let ran = bench.drive(Scanner::new(quick()), usize::MAX);
            assert_eq!(ran.found.len(), 1, "{protocol} {delay} ms");
            assert!(!ran.scanner.is_slow(), "{protocol} {delay} ms");
        }
    }
}

/// A module found by the second pass is also found by a scan with the suggested wait, even if it is
/// as slow as can be waited for, and the speed low.
#[test]
fn who_is_found_by_waiting_is_found_with_the_wait_that_is_suggested() {
    let few = ScanOptions {
        addresses: Some(vec![5, 6]),
        bauds: Some(vec![Baud::B2400]),
        ..ScanOptions::default()
    };
    for (wish, address, baud) in [
        (ScanOptions::default(), 1, Baud::B9600),
        (few, 6, Baud::B2400),
    ] {
        let protocols = [Protocol::Ascii, Protocol::Lc02, Protocol::Rtu];
        let found = |silence, protocol| {
            let mut bench = Bench::new();
            // As long as it is waited for, less what the line takes to detect it.
            bench.add_shy(&module(Family::Eda9060a, address, protocol, baud), 297);
            let wish = ScanOptions {
                silence,
                ..wish.clone()
            };
            bench.scan(Scope::of(&wish, Vec::new())).found
        };
        for protocol in protocols {
            let by_waiting = found(None, protocol);
            assert_eq!(by_waiting.len(), 1, "{baud} {protocol}");
            assert_eq!(found(Some(SLOW_TIMEOUT), protocol), by_waiting);
        }
    }
}

/// The reported cost of the suggested wait.
#[test]
fn the_wait_that_is_suggested_costs_minutes() {
    for (depth, seconds) in [(Depth::Quick, 79), (Depth::Full, 630), (Depth::Deep, 2_459)] {
        let wish = ScanOptions {
            depth,
            silence: Some(SLOW_TIMEOUT),
            ..ScanOptions::default()
        };
        let left = Scanner::new(Scope::of(&wish, Vec::new())).progress().left;
        assert_eq!(left.0 / 1_000_000, seconds, "{depth:?}");
    }
}
