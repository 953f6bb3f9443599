//! A run is determined by its seed, and its trace shows it.

mod support;

use railbus_sim::demo;
use railbus_sim::{Act, Chance, Chunks, DurationRange, Faults, Power, VirtualLineConfig};
use railbus_wire::Micros;
use support::{Bench, hex};

const RELAY_ON: &str = "01 05 00 3C FF 00 4C 36";

/// Every fault occurs now and then.
fn all_faults() -> Faults {
    let now_and_then = Chance::percent(5);
    Faults {
        flip: Chance::percent(1),
        lose_character: Chance::percent(1),
        lose_request: now_and_then,
        lose_reply: now_and_then,
        spoil: now_and_then,
        glitch_before: now_and_then,
        glitch_after: now_and_then,
        late: now_and_then,
        late_by: DurationRange::millis(1, 400),
        again: now_and_then,
        again_after: DurationRange::millis(0, 200),
        pieces: now_and_then,
        pause: DurationRange::millis(0, 30),
        babble: now_and_then,
        babble_for: DurationRange::millis(10, 100),
        cut_every: Some(Micros::from_secs(10)),
        cut_for: DurationRange::millis(1, 1_000),
        noise_every: Some(Micros::from_secs(1)),
    }
}

fn run(seed: u64, chunks: Chunks) -> Bench {
    let (mut bench, _) = Bench::with_oven(VirtualLineConfig {
        seed,
        faults: all_faults(),
        chunks,
        trace: 100_000,
        ..VirtualLineConfig::default()
    });
    for pause in 0..500 {
        bench.send(&hex(RELAY_ON));
        bench.wait(20 + pause % 50);
    }
    bench
}

fn trace(bench: &Bench) -> String {
    bench
        .line
        .trace()
        .map(ToString::to_string)
        .unwrap_or_default()
}

#[test]
fn the_same_seed_gives_the_same_run() {
    for chunks in [Chunks::Whole, Chunks::Single, Chunks::Random] {
        let (first, second) = (run(7, chunks), run(7, chunks));
        assert_eq!(trace(&first), trace(&second));
        assert_eq!(first.heard, second.heard);
        assert_eq!(first.effects, second.effects);
    }
}

#[test]
fn another_seed_gives_another_run() {
    assert_ne!(trace(&run(7, Chunks::Whole)), trace(&run(8, Chunks::Whole)));
}

/// The pieces in which characters are delivered do not affect what modules do, nor when.
#[test]
fn pieces_change_nothing() {
    let run = |chunks| {
        let mut bench = Bench::new(VirtualLineConfig {
            chunks,
            ..VirtualLineConfig::default()
        });
        for (name, setup) in demo::modules() {
            bench.add(name, setup);
        }
        let requests = [
            b"#01000F\r".to_vec(),
            b"LW\x02\x04\xFF\x55\x5A\r".to_vec(),
            hex("03 05 00 3C FF 00 4D D4"),
            hex("55 04 12 00 00 00 01 6C"),
            b"#010000\r".to_vec(),
            hex("03 05 00 3C 00 00 0C 24"),
        ];
        for (request, pause) in requests.iter().cycle().zip(0..400) {
            bench.send(request);
            bench.wait(26 + pause % 40);
        }
        let heard = bench.heard_bytes();
        (bench.effects, heard)
    };
    let whole = run(Chunks::Whole);
    assert!(whole.0.len() > 500, "{}", whole.0.len());
    assert_eq!(run(Chunks::Single), whole);
    assert_eq!(run(Chunks::Random), whole);
}

#[test]
fn every_fault_is_counted() {
    let bench = run(7, Chunks::Whole);
    let injected = bench.line.injected();
    let counts = [
        injected.flips,
        injected.lost_characters,
        injected.lost_requests,
        injected.lost_replies,
        injected.spoilt,
        injected.glitches,
        injected.late,
        injected.again,
        injected.pieces,
        injected.babble,
        injected.cuts,
        injected.noise,
    ];
    assert!(counts.iter().all(|count| *count > 0), "{injected:?}");
    assert_eq!(injected.total(), counts.iter().sum());
}

#[test]
fn a_trace_reads_well() {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig {
        trace: 100,
        ..VirtualLineConfig::default()
    });
    bench.ask_hex(RELAY_ON);
    bench.line.set_module_faults(oven, Faults::MUTE);
    bench.ask_hex(RELAY_ON);
    bench.act(oven, Act::Power(Power::Cycle));
    let expected = "     \
     TIME us       +us  WHO           EVENT          BYTES
      100000    100000  host       -> sends          01 05 00 3C FF 00 4C 36
      111980     11980  oven       .. output on 0
      111980         0  oven       <- sends          01 05 00 3C FF 00 4C 36
      120314      8334  host       => hears          01 05 00 3C FF 00 4C 36
      400000    279686  host       -> sends          01 05 00 3C FF 00 4C 36
      411980     11980  oven       !! lost reply     01 05 00 3C FF 00 4C 36
      700000    288020  oven       .. power off
      700000         0  oven       .. output off 0
      700000         0  oven       .. power on
";
    assert_eq!(trace(&bench), expected);
}

#[test]
fn a_trace_keeps_the_last_entries() {
    let (mut bench, _) = Bench::with_oven(VirtualLineConfig {
        trace: 2,
        ..VirtualLineConfig::default()
    });
    bench.ask_hex(RELAY_ON);
    let expected = "     \
     TIME us       +us  WHO           EVENT          BYTES
           2 earlier entries were dropped
      111980         0  oven       <- sends          01 05 00 3C FF 00 4C 36
      120314      8334  host       => hears          01 05 00 3C FF 00 4C 36
";
    assert_eq!(trace(&bench), expected);
}
