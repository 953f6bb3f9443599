//! The reference line: 32 modules in four protocols. All are found, no output moves, and the time
//! is within the budgets, exact in virtual time.

use crate::bench::{Bench, Ran, module};
use railbus_commission::scan::{Depth, ScanOptions, Scope};
use railbus_device::{Family, Setup};
use railbus_wire::{Baud, Exchange, Micros, Protocol, ascii, rtu};

/// Which families speak which protocols, and how slow they are in milliseconds.
const KINDS: [(Family, Protocol, u64); 8] = [
    (Family::Eda9060a, Protocol::Ascii, 12),
    (Family::Eda9050, Protocol::Lc02, 8),
    (Family::Erc8, Protocol::Rtu, 5),
    (Family::R55, Protocol::R55, 3),
    (Family::Emd2a2q, Protocol::Rtu, 10),
    (Family::Eda9050, Protocol::Ascii, 20),
    (Family::Eda9060a, Protocol::Rtu, 15),
    (Family::Eda9050, Protocol::Rtu, 7),
];

/// The 32 modules, at the addresses that `place` gives them. 0x55 boards stay at 9600.
fn reference(
    place: impl Fn(usize, Family) -> u8,
    baud: impl Fn(usize) -> Baud,
) -> Vec<(Setup, u64)> {
    let kinds = KINDS.iter().cycle().take(32).enumerate();
    let setup = |(nth, (family, protocol, slow)): (usize, &(Family, Protocol, u64))| {
        let baud = match family {
            Family::R55 => Baud::B9600,
            _ => baud(nth),
        };
        let setup = Setup {
            checksum: *protocol == Protocol::Ascii && nth % 16 == 0,
            ..module(*family, place(nth, *family), *protocol, baud)
        };
        (setup, *slow)
    };
    kinds.map(setup).collect()
}

fn near(nth: usize, _: Family) -> u8 {
    u8::try_from(nth + 1).unwrap()
}

/// Spread over all addresses that the family can have.
fn far(nth: usize, family: Family) -> u8 {
    match family {
        Family::Erc8 | Family::Emd2a2q => near(nth, family),
        _ => u8::try_from(nth * 7 + 20).unwrap(),
    }
}

fn bench(modules: &[(Setup, u64)]) -> Bench {
    let mut bench = Bench::new();
    for (setup, slow) in modules {
        bench.add(setup, *slow);
    }
    bench
}

fn scope(depth: Depth) -> Scope {
    let wish = ScanOptions {
        depth,
        ..ScanOptions::default()
    };
    Scope::of(&wish, Vec::new())
}

fn expected(modules: &[(Setup, u64)]) -> Vec<String> {
    let told = |(setup, _): &(Setup, u64)| {
        let checksum = if setup.checksum { " sum" } else { "" };
        let (settings, address) = (setup.serial, setup.address.0);
        let (protocol, family) = (setup.protocol, setup.family);
        let model = match (family, protocol) {
            // None of its replies proves the model.
            (Family::Eda9050, Protocol::Rtu) => "? could_be".to_owned(),
            _ => format!("{family} ok"),
        };
        format!("{settings} {address:03} {protocol}{checksum} {model}")
    };
    let mut all: Vec<String> = modules.iter().map(told).collect();
    all.sort();
    all
}

#[track_caller]
fn within(ran: &Ran, modules: &[(Setup, u64)], budget: Micros) {
    assert_eq!(ran.found, expected(modules));
    let (took, estimate) = (ran.took.0 as f64 / 1e6, ran.estimate.0 as f64 / 1e6);
    assert!(ran.took <= budget, "{took} s");
    assert!(
        (took / estimate - 1.0).abs() < 0.1,
        "{took} s, {estimate} s"
    );
    for (elapsed, left) in &ran.estimates {
        let end = (elapsed.0 + left.0) as f64 / 1e6;
        if elapsed.0 as f64 / 1e6 > took / 2.0 {
            // The requests to a module after it was found are not in the estimate: here half of the
            // addresses have a module whose model only several Modbus replies show.
            assert!((end / took - 1.0).abs() < 0.16, "{end} s of {took} s");
        }
    }
}

#[test]
fn quick() {
    let modules = reference(near, |_| Baud::B9600);
    let mut bench = bench(&modules);
    let ran = bench.scan(scope(Depth::Quick));
    within(&ran, &modules, Micros::from_secs(10));
}

#[test]
fn full() {
    let modules = reference(far, |_| Baud::B9600);
    let mut bench = bench(&modules);
    let ran = bench.scan(scope(Depth::Full));
    within(&ran, &modules, Micros::from_secs(80));
}

#[test]
fn deep() {
    let bauds = [Baud::B9600, Baud::B19200];
    let modules = reference(far, |nth| bauds[nth % 3 % 2]);
    let mut bench = bench(&modules);
    let ran = bench.scan(scope(Depth::Deep));
    within(&ran, &modules, Micros::from_secs(8 * 60));
}

/// Two speeds, and relays that are on stay on.
#[test]
fn all_of_two_speeds_are_found_and_no_output_moves() {
    let bauds = [Baud::B9600, Baud::B19200];
    let modules = reference(near, |nth| bauds[nth % 3 % 2]);
    let mut bench = bench(&modules);
    for (setup, _) in &modules {
        let address = setup.address;
        let on = match (setup.family, setup.protocol) {
            (Family::Erc8, _) => {
                let coil = rtu::Request::WriteCoil {
                    at: 60,
                    value: rtu::CoilValue::ON,
                };
                Exchange::rtu(address, coil)
            }
            (_, Protocol::Ascii) => {
                let one = ascii::Request::WriteOutputs { order: 0, data: 1 };
                Exchange::ascii(address, setup.checksum, one)
            }
            _ => continue,
        };
        bench.switch_on(&on, setup.serial);
    }
    let wish = ScanOptions {
        bauds: Some(bauds.to_vec()),
        ..ScanOptions::default()
    };
    let ran = bench.scan(Scope::of(&wish, Vec::new()));
    assert_eq!(ran.found, expected(&modules));
    assert_eq!(bench.moved, 0);
}

/// An empty line: the longest that a scan within the budgets can take.
#[test]
fn silence_everywhere_is_within_the_budgets_too() {
    for (depth, seconds) in [(Depth::Quick, 10), (Depth::Full, 80), (Depth::Deep, 480)] {
        let mut bench = Bench::new();
        let ran = bench.scan(scope(depth));
        within(&ran, &[], Micros::from_secs(seconds));
    }
}
