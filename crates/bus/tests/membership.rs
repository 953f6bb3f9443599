//! Modules join and leave a running line, and the others are not affected.

mod support;

use railbus_bus::{Bus, Config, EchoMode, Event, Fault, Input, ModuleId, Plan, Presence, Terms};
use railbus_device::{Bank, Eeprom, Engine, Family, Module, Op, Options, Setup};
use railbus_wire::{Address, Instant, Micros, Protocol};
use support::{Drive, Happening, millis};

/// How often each module is read.
const INTERVAL: Micros = millis(100);

fn plan() -> Plan {
    Plan {
        interval: INTERVAL,
        ..Plan::default()
    }
}

fn relays(address: u8) -> Module {
    Module::new(Setup::new(Family::Erc8, Address(address))).expect("a possible module")
}

/// A line of relay boards at these addresses, of which the line knows the first `known`.
fn line(addresses: &[u8], known: usize) -> Drive {
    let mut bus = Bus::new(Config {
        echo: EchoMode::Off,
        ..Config::default()
    });
    for address in &addresses[..known] {
        bus.add(relays(*address), plan());
    }
    let mut drive = Drive::new(bus);
    for address in addresses {
        let setup = Setup::new(Family::Erc8, Address(*address));
        let options = Options {
            turnaround: millis(5),
            ..Options::default()
        };
        let engine = Engine::new(&setup, Eeprom::of(&setup), options, Instant(0));
        drive.play(engine.expect("a possible module"));
    }
    drive.input(Input::Opened);
    drive
}

/// What happened within a time: the addresses that were polled, and the events.
fn run(drive: &mut Drive, span: Micros) -> (Vec<(Instant, u8)>, Vec<Event>) {
    let until = drive.now + span;
    let (mut asked, mut told) = (Vec::new(), Vec::new());
    while let Some(happening) = drive.step(until) {
        match happening {
            Happening::Frame { bytes, end, .. } => {
                asked.push((drive.now, bytes[0]));
                drive.ask_players(end, &bytes);
            }
            Happening::Told(event) => told.push(event),
            Happening::Heard(_) => {}
        }
    }
    (asked, told)
}

fn is_seen(event: &Event, id: usize) -> bool {
    matches!(event, Event::Seen { module, .. } if *module == ModuleId(id))
}

#[test]
fn a_module_that_is_polled_every_hour_is_read_at_the_start_too() {
    let seldom = Plan {
        interval: Micros::from_secs(3600),
        ..Plan::default()
    };
    let mut drive = line(&[3, 4], 1);
    let id = drive.bus.add(relays(4), seldom);
    drive.touched();
    let (asked, told) = run(&mut drive, Micros::from_secs(10));
    assert!(told.iter().any(|event| is_seen(event, id.0)));
    let polls = |address| asked.iter().filter(|(_, asked)| *asked == address).count();
    assert!(
        polls(3) > 10 * polls(4),
        "the other one is read as often as it was"
    );
}

#[test]
fn those_that_stay_are_asked_on_as_if_nothing_had_been() {
    let mut drive = line(&[3, 4, 5], 2);
    let (before, _) = run(&mut drive, Micros::from_secs(2));
    assert!(before.iter().any(|(_, address)| *address == 4));

    let now = drive.now;
    drive.bus.leave(now, ModuleId(1));
    assert_eq!(drive.bus.join(now, relays(5), plan()), ModuleId(2));
    drive.touched();
    let (after, told) = run(&mut drive, Micros::from_secs(2));
    assert!(
        after.iter().all(|(_, address)| [3, 5].contains(address)),
        "{after:?}"
    );
    assert!(told.iter().any(|event| is_seen(event, 2)));
    assert_eq!(drive.bus.presence(ModuleId(2)), Presence::Online);
    assert!(!told.iter().any(|event| is_seen(event, 1)));
    let goes = |event: &&Event| matches!(event, Event::Presence { .. });
    assert_eq!(
        told.iter().filter(goes).count(),
        1,
        "only the new one is news: {told:?}"
    );

    let polls = before.into_iter().chain(after);
    let of_first: Vec<Instant> = polls.filter(|(_, at)| *at == 3).map(|(at, _)| at).collect();
    let settled = of_first.windows(2).skip(5);
    let longest = settled.map(|pair| pair[1].since(pair[0])).max();
    // The new module is also asked for its fence.
    let most = INTERVAL + millis(100);
    assert!(
        longest.is_some_and(|longest| longest <= most),
        "{longest:?}"
    );
}

#[test]
fn commands_for_a_module_that_leaves_end() {
    let mut drive = line(&[3, 4], 2);
    run(&mut drive, Micros::from_secs(2));
    let now = drive.now;
    for _ in 0..2 {
        let taken = drive
            .bus
            .submit(now, ModuleId(1), Op::ReadOutputs, Terms::default());
        taken.expect("taken");
    }
    drive.bus.leave(now, ModuleId(1));
    drive.touched();
    let refused = drive
        .bus
        .submit(now, ModuleId(1), Op::ReadOutputs, Terms::default());
    assert_eq!(refused, Err(Fault::Unsupported));
    let (asked, told) = run(&mut drive, Micros::from_secs(3));
    let ends = told.iter().filter(|event| match event {
        Event::Done { end, .. } => *end == Err(Fault::Closed),
        _ => false,
    });
    assert_eq!(ends.count(), 2, "{told:?}");
    assert!(asked.iter().all(|(_, address)| *address == 3));
}

#[test]
fn a_command_on_the_wire_ends_with_its_exchange_and_is_not_repeated() {
    let mut drive = line(&[3, 4], 2);
    run(&mut drive, Micros::from_secs(2));
    drive.players[1].alive = false;
    let now = drive.now;
    let taken = drive.bus.submit(
        now,
        ModuleId(1),
        Op::Write(Bank::new(1, 1)),
        Terms::default(),
    );
    taken.expect("taken");
    drive.touched();
    let (mut asked, mut told) = (0, Vec::new());
    let until = now + Micros::from_secs(4);
    while let Some(happening) = drive.step(until) {
        match happening {
            Happening::Frame { bytes, end, .. } => {
                drive.ask_players(end, &bytes);
                if bytes[..2] == [4, 5] {
                    asked += 1;
                    let now = drive.now;
                    drive.bus.leave(now, ModuleId(1));
                    drive.touched();
                } else if asked > 0 {
                    assert_eq!(bytes[0], 3, "somebody else may have that address by now");
                }
            }
            Happening::Told(event) => told.push(event),
            Happening::Heard(_) => {}
        }
    }
    assert_eq!(asked, 1);
    let lost = |event: &&Event| {
        matches!(
            event,
            Event::Done {
                end: Err(Fault::NoReply(_)),
                ..
            }
        )
    };
    assert_eq!(told.iter().filter(lost).count(), 1, "{told:?}");
}

#[test]
fn a_module_that_left_is_gone_when_the_port_comes_back() {
    let mut drive = line(&[3, 4], 2);
    run(&mut drive, Micros::from_secs(1));
    let now = drive.now;
    drive.bus.leave(now, ModuleId(0));
    drive.input(Input::Closed);
    run(&mut drive, Micros::from_secs(1));
    drive.input(Input::Opened);
    let (asked, _) = run(&mut drive, Micros::from_secs(2));
    assert!(!asked.is_empty() && asked.iter().all(|(_, address)| *address == 4));
}

#[test]
fn who_joins_at_the_address_of_one_that_left_is_not_kept_waiting_by_its_ghosts() {
    for (family, protocol) in [
        (Family::Erc8, Protocol::Rtu),
        (Family::Emd2a2q, Protocol::Rtu),
        (Family::Eda9050, Protocol::Ascii),
        (Family::Eda9050, Protocol::Lc02),
        (Family::R55, Protocol::R55),
    ] {
        let setup = Setup {
            protocol,
            ..Setup::new(family, Address(1))
        };
        let module = || Module::new(setup).expect("a possible module");
        let mut bus = Bus::new(Config {
            echo: EchoMode::Off,
            ..Config::default()
        });
        let gone = bus.add(module(), plan());
        let mut drive = Drive::new(bus);
        let engine = Engine::new(&setup, Eeprom::of(&setup), Options::default(), Instant(0));
        drive.play(engine.expect("a possible module"));
        drive.input(Input::Opened);
        run(&mut drive, Micros::from_secs(1));
        drive.players[0].alive = false;
        while !matches!(
            drive.step(Instant(3_000_000)),
            Some(Happening::Told(Event::Missed { .. }))
        ) {}
        drive.players[0].alive = true;

        let now = drive.now;
        drive.bus.leave(now, gone);
        let new = drive.bus.join(now, module(), plan());
        drive.touched();
        let (asked, told) = run(&mut drive, Micros::from_secs(1));
        let seen = told.iter().filter(|event| is_seen(event, new.0)).count();
        assert!(seen >= 5, "{family:?} {protocol:?}: read {seen} times");
        assert!(
            asked.len() <= seen + 4,
            "{family:?} {protocol:?}: asked {} times to be read {seen} times",
            asked.len()
        );
    }
}
