//! The watchdog itself, in every family and protocol.

use super::support::{Bench, request, with_crc};
use super::{HALF_SECOND, dice, module, setup, setups};
use railbus_device::{Bank, Effect, Extensions, Family, Input, Op, Setup};
use railbus_wire::{Address, Channel, Instant, Micros, Protocol, PulseWidth};

/// As a frame of another module's, and as one for this one.
fn poll(module: &Bench, address: u8) -> Vec<u8> {
    let host = railbus_device::Module::new(Setup {
        address: Address(address),
        ..module.setup
    });
    request(&host.expect("possible"), &Op::ReadOutputs).expect("a frame")
}

fn switch(module: &Bench, channel: u8, on: bool) -> Vec<u8> {
    let channel = Channel::new(channel).expect("it exists");
    request(&module.host(), &Op::Write(Bank::one(channel, on))).expect("a frame")
}

fn is_safe(module: &Bench) -> bool {
    module.engine.outputs() == HALF_SECOND.safe && module.engine.eeprom().extensions.tripped
}

#[test]
fn a_thousand_hosts_that_die_leave_the_outputs_safe_in_time() {
    // [BEYOND §1.1, §1.2]: watchdog + 100 ms is promised; the engine needs none of them.
    let seed = 0x0A11_0C8E;
    let mut state = seed;
    for setup in setups() {
        for round in 0..1_000 {
            let watchdog = 1 + dice(&mut state, 255) as u8;
            let extensions = Extensions {
                watchdog,
                power_on: 0,
                safe: 0b01,
                tripped: false,
            };
            let mut module = module(setup, extensions);
            let time = Micros::from_millis(100) * u64::from(watchdog);
            // It polls and switches at any pace that feeds the watchdog, and then dies at any
            // moment: often in the middle of a frame.
            let mut fed = module.now;
            for turn in 0..dice(&mut state, 3) {
                let pause = dice(&mut state, time.0.saturating_sub(100_000).max(1));
                module.run_until(Instant(module.now.0 + pause));
                module.wait(50);
                module.send(&switch(&module, 1, turn == 0));
                module.run_until(module.now + module.setup.serial.t3_5());
                fed = module.now;
                module.run_until(module.now + Micros::from_millis(20));
            }
            let broken = poll(&module, 1);
            module.wait(dice(&mut state, 40));
            module.send(&broken[..dice(&mut state, broken.len() as u64) as usize]);
            let _ = module.did();
            module.run_until(fed + time + Micros::from_millis(100));
            let place = format!("{setup:?}, round {round} of seed {seed:X}");
            assert!(module.engine.outputs() == 0b01, "{place}");
            assert!(module.engine.eeprom().extensions.tripped, "{place}");
            let moved = module.did();
            let at = |wanted| {
                moved
                    .iter()
                    .find(|(_, did)| *did == wanted)
                    .map(|(at, _)| *at)
            };
            let on = at(Effect::Output {
                channel: 0,
                on: true,
            });
            let late = on.expect("it moved").0.saturating_sub((fed + time).0);
            assert!(late <= 100_000, "{place}: {late} us late");
        }
    }
}

#[test]
fn a_host_that_lives_is_never_taken_for_dead() {
    // [BEYOND §1.1]
    for setup in setups() {
        let mut module = module(setup, HALF_SECOND);
        let own = poll(&module, 1);
        let on = switch(&module, 1, true);
        let off = switch(&module, 1, false);
        for frame in [&own, &on, &off].into_iter().cycle().take(30) {
            module.wait(100);
            assert!(module.ask(frame).is_some(), "{setup:?}");
            assert!(!module.engine.eeprom().extensions.tripped, "{setup:?}");
        }
        assert_eq!(module.engine.outputs(), 0);
    }
}

#[test]
fn frames_for_others_and_broken_ones_feed_nobody() {
    // [BEYOND §1.1]
    for setup in setups() {
        let mut module = module(setup, HALF_SECOND);
        let other = poll(&module, 2);
        let mut broken = poll(&module, 1);
        *broken.last_mut().expect("bytes") ^= 0x01;
        for frame in [other, broken].into_iter().cycle().take(8) {
            assert_eq!(module.ask(&frame), None, "{setup:?}");
        }
        assert!(is_safe(&module), "{setup:?}");
    }
}

#[test]
fn unknown_commands_and_broadcasts_feed_it() {
    // [BEYOND §1.1, §2.2]
    let erc8 = setup(Family::Erc8, Protocol::Rtu);
    let eda = setup(Family::Eda9050, Protocol::Ascii);
    let r55 = setup(Family::R55, Protocol::R55);
    let to_all_boards = [0x55, 0xF5, 0x31, 0, 0, 0, 1, 0x7C];
    let cases: [(Setup, Vec<u8>); 4] = [
        (erc8, with_crc(&[1, 0x41, 9])),
        (erc8, with_crc(&[0, 5, 0, 60, 0, 0])),
        (eda, b"~**\r".to_vec()),
        (r55, to_all_boards.to_vec()),
    ];
    for (setup, frame) in cases {
        let mut module = module(setup, HALF_SECOND);
        for _ in 0..6 {
            let _ = module.ask(&frame);
        }
        assert!(
            !module.engine.eeprom().extensions.tripped,
            "{setup:?} {frame:02X?}"
        );
    }
}

#[test]
fn it_runs_from_power_up_and_stays_tripped_without_power() {
    // [BEYOND §1.3, §1.5, §1.10]
    for setup in setups() {
        let mut module = module(setup, HALF_SECOND);
        assert_eq!(module.engine.outputs(), HALF_SECOND.power_on);
        module.wait(499);
        assert_eq!(module.engine.outputs(), HALF_SECOND.power_on, "{setup:?}");
        module.wait(1);
        assert!(is_safe(&module), "{setup:?}");
        let saves_trip =
            |effect: &Effect| matches!(effect, Effect::Save(kept) if kept.extensions.tripped);
        let did = module.did();
        let saved = did.iter().filter(|(_, effect)| saves_trip(effect));
        assert_eq!(saved.count(), 1);
        for _ in 0..2 {
            module.power_cycle();
            assert!(is_safe(&module), "{setup:?}");
            module.wait(700);
            let again = |(_, did): &(Instant, Effect)| matches!(did, Effect::Save(_));
            assert!(
                !module.did().iter().any(again),
                "it is worn by every loss of power"
            );
        }
    }
}

#[test]
fn tripped_outputs_do_not_move_and_nobody_is_told_that_they_did() {
    // [BEYOND §1.4]
    for setup in setups() {
        let tripped = Extensions {
            tripped: true,
            ..HALF_SECOND
        };
        let mut module = module(setup, tripped);
        let _ = module.did();
        let frame = switch(&module, 1, true);
        let reply = module.ask(&frame);
        let wanted = match setup.protocol {
            Protocol::Ascii => Some(b"!\r".to_vec()),
            Protocol::Rtu => Some(with_crc(&[1, 0x85, 4])),
            Protocol::Lc02 => None,
            Protocol::R55 => Some(vec![0x22, 1, 0x12, 0, 0, 0, 1, 0x36]),
        };
        assert_eq!(reply, wanted, "{setup:?}");
        let own = poll(&module, 1);
        assert!(module.ask(&own).is_some());
        assert_eq!(
            (module.did(), module.engine.outputs()),
            (vec![], 0b01),
            "{setup:?}"
        );
    }
    // Several coils at once, and by broadcast.
    let tripped = Extensions {
        tripped: true,
        ..HALF_SECOND
    };
    let mut erc8 = module(setup(Family::Erc8, Protocol::Rtu), tripped);
    erc8.refuses("010F 003C 0008 01 FF", 4);
    let mut emd = module(setup(Family::Emd2a2q, Protocol::Rtu), tripped);
    emd.ignores(&with_crc(&[0, 5, 0, 8, 0, 0]));
    let mut board = module(setup(Family::R55, Protocol::R55), tripped);
    for frame in ["F5 33 000000FF", "01 21 00 03E8 02"] {
        let _ = board.ask_r55(frame).unwrap_or_default();
        assert_eq!(board.engine.outputs(), 0b01, "{frame}");
    }
}

#[test]
fn pulses_and_jogs_end() {
    // [BEYOND §1.6]
    let eda = setup(Family::Eda9060a, Protocol::Ascii);
    let mut pulsing = module(
        eda,
        Extensions {
            power_on: 0,
            ..HALF_SECOND
        },
    );
    pulsing.engine = {
        let mut eeprom = *pulsing.engine.eeprom();
        eeprom.pulse_mask = 0b1111;
        eeprom.pulse_width = PulseWidth::from_tenths(20).expect("2 s");
        railbus_device::Engine::new(&eda, eeprom, super::ON, pulsing.now).expect("possible")
    };
    assert_eq!(pulsing.ask_text("#010006").as_deref(), Some(">"));
    assert_eq!(pulsing.engine.outputs(), 0b110);
    pulsing.wait(600);
    assert!(is_safe(&pulsing));
    pulsing.wait(5_000);
    assert!(is_safe(&pulsing), "a safe output of pulses stays on");

    let mut board = module(setup(Family::R55, Protocol::R55), HALF_SECOND);
    assert!(board.ask_r55("01 21 000BB8 02").is_some(), "3 s");
    board.wait(5_000);
    assert!(is_safe(&board));
}

#[test]
fn a_stuck_output_is_not_told_to_be_safe() {
    // [BEYOND §1.12]
    for setup in setups() {
        let mut module = module(setup, HALF_SECOND);
        module.input(Input::Stuck(0b01));
        module.wait(600);
        assert!(module.engine.eeprom().extensions.tripped);
        assert_eq!(module.engine.outputs(), 0, "{setup:?}");
        let told = module.did();
        let moved = |(_, did): &(Instant, Effect)| matches!(did, Effect::Output { channel: 0, .. });
        assert!(!told.iter().any(moved), "{setup:?}");
    }
}

#[test]
fn what_a_late_driver_hands_in_comes_too_late() {
    for setup in setups() {
        let mut module = module(setup, HALF_SECOND);
        let own = poll(&module, 1);
        module.now = Instant(module.now.0 + 700_000);
        module.send(&own);
        assert!(module.engine.eeprom().extensions.tripped, "{setup:?}");
    }
}
