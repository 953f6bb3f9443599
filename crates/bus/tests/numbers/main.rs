//! The line rules' numbers, measured in virtual time and so exact on every machine.
//!
//! The reference line: five modules, Modbus RTU, 9600 baud, 5 ms turnaround, full polling.

#![allow(
    clippy::print_stdout,
    reason = "what was measured is shown with --nocapture"
)]

mod bench;
#[path = "../support/mod.rs"]
mod support;

use bench::{Bench, reference_setups};
use railbus_bus::{Input, Plan, Presence, Terms};
use railbus_device::{Bank, Family, Op, Setup};
use railbus_wire::{Address, Baud, Channel, Instant, Micros, Protocol, SerialSettings};
use std::collections::BTreeMap;
use support::millis;

/// "Command latency: reference line p99 <= 60 ms".
#[test]
fn commands_are_answered_within_60_ms() {
    let mut bench = Bench::reference();
    bench.run_for(Micros::from_secs(5));
    bench.forget();
    for _ in 0..2000 {
        let module = bench.random(5) as usize;
        bench.switch(module);
        let pause = bench.random(1000) + 100;
        bench.run_for(millis(pause));
    }
    let (p99, worst) = bench.p99();
    println!("command latency: p99 {p99:?}, worst {worst:?}");
    assert!(p99 <= millis(60), "p99 {p99:?}");
    assert!(worst <= millis(100), "worst {worst:?}");
    assert_eq!(bench.ends, BTreeMap::from([("readback".to_owned(), 2000)]));
}

/// "… <= 160 ms with one dead module", for one that had answered before and one that never had.
#[test]
fn commands_are_answered_within_160_ms_beside_a_dead_module() {
    for heard_before in [true, false] {
        let mut bench = Bench::reference();
        if heard_before {
            bench.run_for(Micros::from_secs(5));
        }
        bench.power(4, false);
        bench.run_for(Micros::from_secs(10));
        bench.forget();
        for _ in 0..2000 {
            let module = bench.random(4) as usize;
            bench.switch(module);
            let pause = bench.random(1000) + 100;
            bench.run_for(millis(pause));
        }
        let (p99, worst) = bench.p99();
        println!(
            "beside a dead module (heard before: {heard_before}): p99 {p99:?}, worst {worst:?}"
        );
        assert!(p99 <= millis(160), "p99 {p99:?}");
        assert_eq!(bench.ends, BTreeMap::from([("readback".to_owned(), 2000)]));
        assert!(bench.oldest(|module| module != 4) <= Micros::from_secs(2));
    }
}

/// "All dead modules of a line together cost <= 5 % of its time; probes take turns. One dead
/// module that has answered before is back <= 2 s after it answers again, n dead ones <= 2 s x n;
/// a module that never answered <= 6 s (x n)."
#[test]
fn dead_modules_cost_a_twentieth_and_come_back_in_time() {
    for (dead, heard_before) in [
        (1, true),
        (2, true),
        (4, true),
        (1, false),
        (2, false),
        (4, false),
    ] {
        let per_module = Micros::from_secs(if heard_before { 2 } else { 6 });
        let mut worst = Micros::ZERO;
        for phase in 0..20 {
            let mut bench = Bench::reference();
            if heard_before {
                bench.run_for(Micros::from_secs(5));
            }
            for module in 0..dead {
                bench.power(module, false);
            }
            // Three misses each make them silent.
            bench.run_for(Micros::from_secs(12));
            bench.forget();
            let span = Micros::from_secs(120);
            bench.run_for(span);
            let cost: Micros = bench.spent[..dead]
                .iter()
                .fold(Micros::ZERO, |sum, one| sum + *one);
            // One probe may begin in the span and be paid for after it.
            let share = Micros(span.0 / 20) + millis(290);
            assert!(
                cost <= share,
                "{dead} dead (heard before: {heard_before}) cost {cost:?} of {span:?}"
            );
            bench.run_for(millis(phase * 317));
            let woken = bench.now();
            bench.presence.clear();
            for module in 0..dead {
                bench.power(module, true);
            }
            bench.run_for(per_module * dead as u64);
            for module in 0..dead {
                let back = bench
                    .presence
                    .iter()
                    .find(|(_, who, is)| *who == module && *is == Presence::Online);
                let (at, ..) = back.unwrap_or_else(|| {
                    panic!("{dead} dead (heard before: {heard_before}): {module} not back in time")
                });
                worst = worst.max(at.since(woken));
            }
        }
        println!("{dead} dead (heard before: {heard_before}): back after at most {worst:?}");
    }
}

/// A module that takes long to answer gets the time that it needs, and waits for its next check in
/// proportion, on a line that can't keep its plan and beside more commands than it can carry.
#[test]
fn slow_modules_come_back_as_soon_as_their_share_allows() {
    for (turnaround, commands) in [
        (20, 0),
        (60, 0),
        (100, 0),
        (150, 0),
        (280, 0),
        (100, 1),
        (150, 1),
        (100, 8),
        (200, 8),
    ] {
        let check = millis((turnaround * 5 / 4 + 40).max(98));
        let mut worst = Micros::ZERO;
        for phase in 0..5 {
            let mut bench = Bench::new(&reference_setups(), Plan::default(), millis(turnaround));
            bench.run_for(Micros::from_secs(5));
            bench.power(0, false);
            bench.run_for(Micros::from_secs(12));
            bench.forget();
            let goes_on = |bench: &mut Bench, span: Micros| {
                let until = bench.now() + span;
                match commands {
                    0 => bench.run_until(until),
                    1 => bench.switch_now_and_then(1, until),
                    _ => bench.flood(1, until),
                }
            };
            let span = Micros::from_secs(60) + millis(phase * 317);
            goes_on(&mut bench, span);
            let share = Micros(span.0 / 20) + check;
            let cost = bench.spent[0];
            assert!(cost <= share, "{turnaround} ms: {cost:?} of {span:?}");
            bench.presence.clear();
            bench.power(0, true);
            let woken = bench.now();
            goes_on(&mut bench, check * 20 + millis(2_000));
            let mut presence = bench.presence.iter();
            let back = presence.find(|(_, who, is)| *who == 0 && *is == Presence::Online);
            let (at, ..) = back.unwrap_or_else(|| panic!("{turnaround} ms: not back"));
            worst = worst.max(at.since(woken));
        }
        println!("{turnaround} ms, {commands} commands: back after at most {worst:?}");
        assert!(worst <= check * 20 + millis(1_000), "{worst:?}");
    }
}

/// At 2400 baud the reply itself takes long: it is not cut off by a command either.
#[test]
fn a_slow_module_on_a_slow_line_comes_back_beside_commands() {
    for turnaround in [40, 60, 70, 90, 120, 180] {
        let slow = |setup: &Setup| Setup {
            serial: SerialSettings {
                baud: Baud::B2400,
                ..setup.serial
            },
            ..*setup
        };
        let setups: Vec<Setup> = reference_setups()[..2].iter().map(slow).collect();
        let mut bench = Bench::new(&setups, Plan::default(), millis(20));
        bench.takes(0, millis(turnaround));
        bench.run_for(Micros::from_secs(20));
        bench.power(0, false);
        bench.run_for(Micros::from_secs(30));
        bench.presence.clear();
        bench.power(0, true);
        let end = bench.now() + Micros::from_secs(10);
        while bench.now() < end && bench.presence.is_empty() {
            if bench.tickets.len() < 2 {
                bench.switch(1);
            }
            bench.run_for(millis(300));
        }
        assert!(!bench.presence.is_empty(), "{turnaround} ms: not back");
    }
}

/// The same with more commands than the line can carry, for the modules that answer.
#[test]
fn dead_modules_come_back_in_time_under_a_flood_of_commands() {
    for (dead, heard_before) in [(1, true), (3, true), (1, false), (3, false)] {
        let per_module = Micros::from_secs(if heard_before { 2 } else { 6 });
        let (mut done, mut oldest, mut worst) = (0, Micros::ZERO, Micros::ZERO);
        for phase in 0..10 {
            let mut bench = Bench::reference();
            if heard_before {
                bench.run_for(Micros::from_secs(5));
            }
            for module in 0..dead {
                bench.power(module, false);
            }
            bench.run_for(Micros::from_secs(12));
            bench.forget();
            let span = Micros::from_secs(30) + millis(phase * 317);
            bench.flood(dead, bench.now() + span);
            let spent = bench.spent[..dead].iter();
            let cost = spent.fold(Micros::ZERO, |sum, one| sum + *one);
            let share = Micros(span.0 / 20) + millis(290);
            assert!(cost <= share, "{dead} dead cost {cost:?} of {span:?}");
            done += bench.latencies.len();
            oldest = oldest.max(bench.oldest(|module| module >= dead));
            bench.presence.clear();
            for module in 0..dead {
                bench.power(module, true);
            }
            let woken = bench.now();
            bench.flood(dead, woken + per_module * dead as u64);
            for module in 0..dead {
                let mut presence = bench.presence.iter();
                let back = presence.find(|(_, who, is)| *who == module && *is == Presence::Online);
                let (at, ..) = back.unwrap_or_else(|| panic!("{module} of {dead} is not back"));
                worst = worst.max(at.since(woken));
            }
        }
        println!(
            "{dead} dead (heard before: {heard_before}), flood: {done} commands, oldest reading \
             {oldest:?}, back after at most {worst:?}"
        );
        assert!(oldest <= Micros::from_secs(2), "{oldest:?}");
    }
}

/// How many reads seven clients get of their modules in two minutes, each as fast as it can, beside
/// a dead eighth module; `asked` if a client keeps asking that one, too. Then how the asking ended.
fn reads_beside_a_dead_module(heard_before: bool, asked: bool) -> (usize, Vec<&'static str>) {
    let setups: Vec<Setup> = (1..=8)
        .map(|address| Setup {
            protocol: Protocol::Rtu,
            serial: SerialSettings {
                baud: Baud::B19200,
                ..SerialSettings::FACTORY
            },
            ..Setup::new(Family::Eda9060a, Address(address))
        })
        .collect();
    let mut bench = Bench::new(&setups, Plan::default(), millis(5));
    if heard_before {
        bench.run_for(Micros::from_secs(5));
    }
    bench.power(7, false);
    bench.run_for(Micros::from_secs(12));
    let clients = if asked { 8 } else { 7 };
    let mut reads = 0;
    let mut ends = Vec::new();
    // Once what may be asked at once has been used up.
    let warm = bench.now() + Micros::from_secs(20);
    let until = warm + Micros::from_secs(120);
    while bench.now() < until {
        for client in 0..clients {
            if !bench.tickets.values().any(|module| *module == client) {
                bench.submit(client, Op::ReadOutputs, Terms::default());
            }
        }
        let (reads_before, end) = (bench.latencies.len(), bench.run_until_one_ends(until));
        let is_warm = bench.now() >= warm;
        match end {
            Some((7, end)) if is_warm => ends.push(end),
            Some((module, end)) if module < 7 => {
                assert_eq!(end, "reply", "of module {module}");
                reads += usize::from(is_warm && bench.latencies.len() > reads_before);
            }
            _ => {}
        }
    }
    (reads, ends)
}

/// "A client that keeps asking a dead module for fresh values costs the others <= 5 %": what it
/// asks waits for the module's next check, and ends with what came of that.
#[test]
fn asking_a_dead_module_again_and_again_costs_the_others_a_twentieth() {
    for heard_before in [true, false] {
        let (alone, _) = reads_beside_a_dead_module(heard_before, false);
        let (beside, ends) = reads_beside_a_dead_module(heard_before, true);
        println!(
            "beside a dead module (heard before: {heard_before}): {alone} reads, {beside} while it \
             is asked, which ended {} times",
            ends.len()
        );
        assert!(beside * 100 >= alone * 95, "{beside} instead of {alone}");
        // A read that was not sent says so; one that was begun after it was asked for.
        let count = |name: &str| ends.iter().filter(|end| **end == name).count();
        let (unanswered, unsent) = (count("no_reply"), count("expired"));
        assert_eq!(unanswered + unsent, ends.len(), "{ends:?}");
        assert!(unanswered >= 120 / 15, "{ends:?}");
        assert!(!heard_before || unsent == 0, "{ends:?}");
    }
}

/// "8 unrelated commands/s: every module still polled within its max age (default 2 s at 9600)".
#[test]
fn polls_keep_their_age_under_8_commands_a_second() {
    let mut bench = Bench::reference();
    bench.run_for(Micros::from_secs(5));
    bench.forget();
    for turn in 0..8 * 120 {
        bench.switch(turn % 5);
        bench.run_for(millis(125));
    }
    let oldest = bench.oldest(|_| true);
    let (p99, _) = bench.p99();
    println!("8 commands/s: oldest reading {oldest:?}, command p99 {p99:?}");
    assert!(oldest <= Micros::from_secs(2), "{oldest:?}");
    bench.run_for(Micros::from_secs(1));
    assert_eq!(bench.ends, BTreeMap::from([("readback".to_owned(), 960)]));
}

/// "… or 20/s that coalesce into group frames".
#[test]
fn polls_keep_their_age_under_20_commands_a_second_that_coalesce() {
    let mut bench = Bench::reference();
    bench.run_for(Micros::from_secs(5));
    bench.forget();
    for turn in 0..5 * 120u32 {
        // Four neighbouring outputs of one module at once, five times a second.
        for channel in 0..4 {
            let channel = Channel::new(channel).expect("a channel");
            let op = Op::Write(Bank::one(channel, turn % 2 == 0));
            bench.submit(turn as usize % 5, op, Terms::default());
        }
        bench.run_for(millis(200));
    }
    let oldest = bench.oldest(|_| true);
    let (p99, _) = bench.p99();
    println!("20 commands/s: oldest reading {oldest:?}, command p99 {p99:?}");
    assert!(oldest <= Micros::from_secs(2), "{oldest:?}");
    bench.run_for(Micros::from_secs(1));
    assert_eq!(bench.ends, BTreeMap::from([("readback".to_owned(), 2400)]));
}

/// More commands than the line can carry: they wait, but no reading becomes too old.
#[test]
fn polls_keep_their_age_under_a_flood_of_commands() {
    let mut bench = Bench::reference();
    bench.run_for(Micros::from_secs(5));
    bench.forget();
    for turn in 0..20 * 60 {
        if bench.tickets.len() < 60 {
            bench.switch(turn % 5);
        }
        bench.run_for(millis(50));
    }
    let oldest = bench.oldest(|_| true);
    println!("flood: oldest reading {oldest:?}, ends {:?}", bench.ends);
    assert!(oldest <= Micros::from_secs(2), "{oldest:?}");
}

/// "0 requests too early in 10^6": not one begins before its module's silence is over, and every
/// one is answered by modules that insist on it. All four protocols, three speeds, commands.
#[test]
fn of_a_million_requests_none_is_too_early() {
    let setup = |family, address, protocol, rate| {
        let mut setup = Setup::new(family, Address(address));
        setup.protocol = protocol;
        setup.serial.baud = Baud::from_rate(rate).expect("a speed");
        setup
    };
    let lines: [&[Setup]; 3] = [
        &reference_setups(),
        &[
            setup(Family::Eda9060a, 1, Protocol::Rtu, 9600),
            setup(Family::Erc8, 2, Protocol::Rtu, 9600),
            setup(Family::Emd2a2q, 3, Protocol::Rtu, 9600),
            setup(Family::R55, 4, Protocol::R55, 9600),
            setup(Family::Eda9050, 0x55, Protocol::Ascii, 9600),
            setup(Family::Eda9050, 6, Protocol::Lc02, 9600),
        ],
        &[
            setup(Family::Eda9060a, 1, Protocol::Rtu, 19200),
            setup(Family::Erc8, 2, Protocol::Rtu, 38400),
            setup(Family::Emd2a2q, 3, Protocol::Rtu, 38400),
        ],
    ];
    let mut requests = 0;
    for (index, setups) in lines.iter().enumerate() {
        let plan = Plan {
            interval: millis(1),
            ..Plan::default()
        };
        let mut bench = Bench::new(setups, plan, millis(5));
        while bench.requests < 340_000 {
            bench.run_for(Micros::from_secs(3));
            let module = bench.random(setups.len() as u64) as usize;
            bench.switch(module);
        }
        bench.run_for(Micros::from_secs(1));
        assert_eq!(bench.too_early, 0, "line {index}");
        let all_confirmed = bench.ends.keys().all(|end| end == "readback");
        assert!(all_confirmed, "line {index}: {:?}", bench.ends);
        let ever_silent = bench
            .presence
            .iter()
            .any(|(.., is)| *is != Presence::Online);
        assert!(
            !ever_silent,
            "line {index}: a module took a request for too early"
        );
        requests += bench.requests;
    }
    assert!(requests >= 1_000_000, "only {requests} requests");
}

/// The reply timeout is "learned: p99.9 of its own turnaround x 2, at least 20 ms, at most 300 ms";
/// the time that a lost reply costs shows it.
#[test]
fn the_reply_timeout_is_learned_within_its_bounds() {
    for (turnaround, waits) in [(5, 20), (30, 60), (100, 200), (140, 280), (200, 300)] {
        let setups = &reference_setups()[..1];
        let mut bench = Bench::new(setups, Plan::NEVER, millis(turnaround));
        bench.run_for(Micros::from_secs(1));
        for _ in 0..5 {
            bench.submit(0, Op::ReadOutputs, Terms::default());
            bench.run_for(Micros::from_secs(1));
        }
        bench.power(0, false);
        let asked = bench.now();
        bench.submit(
            0,
            Op::Configure(railbus_device::SettingWrite::Pulse {
                mask: 0,
                width: railbus_wire::PulseWidth::DEFAULT,
            }),
            Terms::default(),
        );
        let mut given_up = asked;
        while !bench.tickets.is_empty() {
            bench.run_for(Micros(100));
            given_up = bench.now();
        }
        // 11 characters out, 8 back.
        let wire = setups[0].serial.frame_time(11) + setups[0].serial.frame_time(8);
        let waited = given_up.since(asked) - wire;
        let want = millis(waits);
        assert!(
            want <= waited && waited <= want + Micros(1000),
            "turnaround {turnaround} ms: waits {waited:?}, not {want:?}"
        );
    }
}

/// "Command time to live: 5 s, then `expired`, never sent"; a caller's own deadline applies too.
#[test]
fn a_command_lives_five_seconds() {
    let mut bench = Bench::reference();
    let input = Input::Closed;
    bench.drive.input(input);
    bench.drive.input(Input::Opened);
    // A line that is never silent lets no command through.
    let babbles_until = bench.now() + Micros::from_secs(8);
    bench.switch(0);
    let mut expired = None;
    while bench.now() < babbles_until {
        bench.drive.input(Input::Bytes(&[0x5A]));
        bench.run_for(millis(2));
        if bench.tickets.is_empty() && expired.is_none() {
            expired = Some(bench.now());
        }
    }
    assert_eq!(bench.ends, BTreeMap::from([("expired".to_owned(), 1)]));
    assert_eq!(bench.requests, 0, "never sent");
    let lived = expired.expect("expired").since(Instant(0));
    assert!(
        Micros::from_secs(5) <= lived && lived <= Micros::from_secs(5) + millis(2),
        "{lived:?}"
    );
}
