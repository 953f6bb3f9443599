//! Each fault does what it says, when it says so, and is counted.

mod support;

use railbus_device::{Eeprom, Effect, Family, Setup};
use railbus_sim::{Act, Chance, DurationRange, Faults, Injected, Power, SlotId, VirtualLineConfig};
use railbus_wire::{Address, Instant, Micros, PulseWidth, SerialSettings};
use support::{Bench, hex, show};

const RELAY_ON: &str = "01 05 00 3C FF 00 4C 36";
const RELAY_2_ON: &str = "01 05 00 3D FF 00 1D F6";

/// When the reply to a request sent at 100 ms begins without faults.
const REPLY_BEGINS: Instant = Instant(100_000 + 8_334 + 3_646);

fn oven_with(faults: Faults) -> (Bench, SlotId) {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig {
        trace: 100,
        ..VirtualLineConfig::default()
    });
    bench.line.set_module_faults(oven, faults);
    (bench, oven)
}

/// Sends one request with these faults: when the host received what, and what was counted.
fn asked(faults: Faults) -> (Vec<(Instant, String)>, Injected) {
    let (mut bench, _) = oven_with(faults);
    bench.send(&hex(RELAY_ON));
    bench.wait(900);
    let heard = bench.heard.iter();
    let heard = heard.map(|(at, bytes)| (*at, show(bytes))).collect();
    (heard, *bench.line.injected())
}

fn after(characters: usize) -> Instant {
    REPLY_BEGINS + SerialSettings::FACTORY.frame_time(characters)
}

#[test]
fn glitches_come_before_and_after_a_reply() {
    let (heard, injected) = asked(Faults {
        glitch_before: Chance::ALWAYS,
        glitch_after: Chance::ALWAYS,
        ..Faults::NONE
    });
    assert_eq!(heard, [(after(10), format!("00 {RELAY_ON} FF"))]);
    assert_eq!(injected.glitches, 2);
}

#[test]
fn a_late_reply_is_as_late_as_it_says() {
    let (heard, injected) = asked(Faults {
        late: Chance::ALWAYS,
        late_by: DurationRange::millis(250, 250),
        ..Faults::NONE
    });
    let at = after(8) + Micros::from_millis(250);
    assert_eq!(heard, [(at, RELAY_ON.to_owned())]);
    assert_eq!(injected.late, 1);
}

#[test]
fn a_reply_comes_again() {
    let (heard, injected) = asked(Faults {
        again: Chance::ALWAYS,
        again_after: DurationRange::millis(50, 50),
        ..Faults::NONE
    });
    let second = after(16) + Micros::from_millis(50);
    let reply = || RELAY_ON.to_owned();
    // Two frame times of 8 characters, each rounded up.
    assert_eq!(heard, [(after(8), reply()), (second + Micros(1), reply())]);
    assert_eq!(injected.again, 1);
}

#[test]
fn a_reply_comes_in_pieces() {
    let (heard, injected) = asked(Faults {
        pieces: Chance::ALWAYS,
        pause: DurationRange::millis(20, 20),
        ..Faults::NONE
    });
    assert!((2..=4).contains(&heard.len()), "{heard:?}");
    let pieces: Vec<&str> = heard.iter().map(|(_, bytes)| bytes.as_str()).collect();
    assert_eq!(pieces.join(" "), RELAY_ON);
    let last = heard[heard.len() - 1].0;
    let pauses = Micros::from_millis(20) * (heard.len() as u64 - 1);
    let late = last.since(after(8) + pauses);
    assert!(late < Micros(4), "rounding only: {late:?}");
    assert_eq!(injected.pieces, 1);
}

#[test]
fn a_lost_reply_was_yet_obeyed() {
    let (mut bench, oven) = oven_with(Faults::MUTE);
    assert_eq!(bench.ask_hex(RELAY_ON), "");
    assert_eq!(bench.line.engine(oven).outputs(), 1);
    assert_eq!(bench.line.injected().lost_replies, 1);
}

#[test]
fn a_lost_request_is_lost_for_the_one_it_is_for() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    let deaf = bench.add("deaf", Setup::new(Family::Erc8, Address(1)));
    let good = bench.add("good", Setup::new(Family::Erc8, Address(2)));
    bench.line.set_module_faults(deaf, Faults::DEAF);
    assert_eq!(bench.ask_hex(RELAY_ON), "");
    let other = "02 05 00 3C FF 00 4C 05";
    assert_eq!(bench.ask_hex(other), other);
    let outputs = [deaf, good].map(|id| bench.line.engine(id).outputs());
    assert_eq!(outputs, [0, 1]);
    assert_eq!(bench.line.injected().lost_requests, 1);
}

#[test]
fn a_flipped_bit_spoils_a_character() {
    let faults = Faults {
        flip: Chance::ALWAYS,
        ..Faults::NONE
    };
    let (heard, injected) = asked(faults);
    let heard: Vec<u8> = heard.iter().flat_map(|(_, text)| hex(text)).collect();
    let sent = hex(RELAY_ON);
    assert_eq!(heard.len(), sent.len());
    assert_ne!(heard, sent);
    assert_eq!(injected.flips, 8);
}

#[test]
fn a_lost_character_is_heard_by_nobody() {
    let (heard, injected) = asked(Faults {
        lose_character: Chance::ALWAYS,
        ..Faults::NONE
    });
    assert_eq!(heard, []);
    assert_eq!(injected.lost_characters, 8);
}

#[test]
fn garbage_comes_in_place_of_a_reply() {
    let (heard, injected) = asked(Faults {
        babble: Chance::ALWAYS,
        babble_for: DurationRange::millis(200, 200),
        ..Faults::NONE
    });
    let count: usize = heard.iter().map(|(_, text)| hex(text).len()).sum();
    assert!((192..=195).contains(&count), "200 ms at 9600: {count}");
    assert_eq!(injected.babble, 1);
}

#[test]
fn a_babbling_module_blocks_the_line() {
    let (mut bench, oven) = oven_with(Faults::NONE);
    let twin = bench.add("twin", Setup::new(Family::Erc8, Address(2)));
    bench.act(twin, Act::Babble(Micros::from_secs(1)));
    bench.wait(100);
    bench.ask_hex(RELAY_ON);
    assert_eq!(bench.line.engine(oven).outputs(), 0);
    bench.wait(1_000);
    assert_eq!(bench.ask_hex(RELAY_ON), RELAY_ON);
}

#[test]
fn the_line_itself_may_babble() {
    let (mut bench, oven) = oven_with(Faults::NONE);
    bench.line.babble(Micros::from_millis(400));
    bench.wait(50);
    bench.ask_hex(RELAY_ON);
    assert_eq!(bench.line.engine(oven).outputs(), 0);
    bench.wait(400);
    assert_eq!(bench.ask_hex(RELAY_ON), RELAY_ON);
}

#[test]
fn who_babbles_is_hushed_within_a_character() {
    let (mut bench, oven) = oven_with(Faults::NONE);
    let twin = bench.add("twin", Setup::new(Family::Erc8, Address(2)));
    bench.act(twin, Act::Babble(Micros(u64::MAX)));
    bench.line.babble(Micros(u64::MAX));
    bench.wait(1_000);
    bench.line.hush(Some(oven));
    bench.heard.clear();
    bench.wait(100);
    assert!(!bench.heard.is_empty(), "oven said nothing");
    bench.line.hush(Some(twin));
    bench.line.hush(None);
    let hushed = bench.now;
    bench.wait(100);
    let last = bench.heard.last().map(|(at, _)| *at);
    assert!(last.is_some_and(|at| at <= hushed + SerialSettings::FACTORY.frame_time(1)));
    assert_eq!(bench.ask_hex(RELAY_ON), RELAY_ON);
}

#[test]
fn noise_comes_into_an_idle_line() {
    let (mut bench, _) = Bench::with_oven(VirtualLineConfig {
        faults: Faults {
            noise_every: Some(Micros::from_millis(500)),
            ..Faults::NONE
        },
        ..VirtualLineConfig::default()
    });
    bench.heard.clear();
    bench.wait(100_000);
    let noise = bench.line.injected().noise;
    assert!((160..240).contains(&noise), "{noise} in 100 s");
    assert!(bench.heard.len() as u64 >= noise - 1);
    assert!(bench.heard.iter().all(|(_, bytes)| bytes.len() <= 3));
}

#[test]
fn power_comes_back_with_what_the_eeprom_kept() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    let setup = Setup::new(Family::Eda9060a, Address(1));
    let pump = bench.add("pump", setup);
    // Relays 0 and 2 give pulses of 20 s [EDA9060A §4.3].
    assert_eq!(bench.ask(b"#01405C8\r"), b"!01\r");
    assert_eq!(bench.ask(b"#0110F\r"), b"", "no such form");
    assert_eq!(bench.ask(b"#01000F\r"), b">\r");
    assert_eq!(bench.line.engine(pump).outputs(), 0xF);
    bench.effects.clear();

    bench.act(pump, Act::Power(Power::Off));
    assert!(!bench.line.is_powered(pump));
    assert_eq!(bench.effects.len(), 4, "all relays drop at once");
    assert_eq!(bench.ask(b"$013\r"), b"");

    bench.act(pump, Act::Power(Power::On));
    assert_eq!(bench.line.engine(pump).outputs(), 0);
    assert_eq!(bench.ask(b"$013\r"), b"!0105C8\r");
}

#[test]
fn what_lies_at_a_module_stays_when_its_power_goes() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    let pump = bench.add("pump", Setup::new(Family::Eda9060a, Address(1)));
    bench.act(pump, Act::Levels(0b0010));
    bench.act(pump, Act::Power(Power::Cycle));
    assert_eq!(bench.ask(b"$016\r"), b"!000200\r");
}

#[test]
fn a_loss_of_power_cuts_a_reply_short() {
    let (mut bench, oven) = oven_with(Faults::NONE);
    bench.send(&hex(RELAY_ON));
    // Two characters and a half.
    bench.run_until(REPLY_BEGINS + Micros(2_600));
    bench.act(oven, Act::Power(Power::Off));
    bench.wait(300);
    let heard = bench.heard_bytes();
    assert_eq!(show(&heard[..2]), "01 05");
    assert_eq!(heard.len(), 3, "the third one is spoilt");
    assert_eq!(
        bench.effects.last(),
        Some(&(
            REPLY_BEGINS + Micros(2_600),
            oven,
            Effect::Output {
                channel: 0,
                on: false
            }
        ))
    );
}

#[test]
fn chance_cuts_the_power_and_brings_it_back() {
    let (mut bench, oven) = oven_with(Faults {
        cut_every: Some(Micros::from_secs(1)),
        cut_for: DurationRange::millis(10, 20),
        ..Faults::NONE
    });
    let change_address = "01 06 00 00 00 07 C8 08";
    while bench.ask_hex(change_address) != change_address {}
    bench.wait(100_000);
    let cuts = bench.line.injected().cuts;
    assert!((75..130).contains(&cuts), "{cuts} in 100 s");
    bench.line.set_module_faults(oven, Faults::NONE);
    bench.wait(100);
    assert!(bench.line.is_powered(oven));
    assert_eq!(bench.line.engine(oven).eeprom().address, Address(7));
}

#[test]
fn the_makers_software_rewrites_what_no_frame_can() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    let setup = Setup::new(Family::Eda9060a, Address(1));
    let pump = bench.add("pump", setup);
    let eeprom = Eeprom {
        protocol: railbus_wire::Protocol::Rtu,
        pulse_width: PulseWidth::DEFAULT,
        ..Eeprom::of(&setup)
    };
    bench.act(pump, Act::Rewrite(eeprom));
    assert_eq!(
        bench.ask_hex("01 01 00 00 00 10 3D C6"),
        "01 01 02 00 00 B9 FC"
    );
    bench.act(pump, Act::FactoryReset);
    assert_eq!(bench.ask(b"$012\r"), b"!01400600\r");
}

#[test]
fn faults_of_the_line_are_those_of_every_module() {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig {
        faults: Faults::MUTE,
        ..VirtualLineConfig::default()
    });
    assert_eq!(bench.ask_hex(RELAY_ON), "");
    bench.line.set_faults(Faults::NONE);
    assert_eq!(bench.ask_hex(RELAY_2_ON), RELAY_2_ON);
    assert_eq!(bench.line.engine(oven).outputs(), 0b11);
}

#[test]
fn a_spoilt_reply_is_no_good_one_and_the_next_one_is() {
    let (mut bench, oven) = oven_with(Faults {
        spoil: Chance::ALWAYS,
        ..Faults::NONE
    });
    assert_eq!(bench.ask_hex(RELAY_ON), "01 05 00 3C FF 00 4C 26");
    assert_eq!(
        bench.line.engine(oven).outputs(),
        1,
        "it did what it was told"
    );
    assert_eq!(bench.line.injected().spoilt, 1);
    bench.line.set_module_faults(oven, Faults::NONE);
    assert_eq!(bench.ask_hex(RELAY_2_ON), RELAY_2_ON);
}

#[test]
fn a_stuck_output_stays_as_it_is_though_the_module_says_yes() {
    let (mut bench, oven) = oven_with(Faults::NONE);
    bench.act(oven, Act::Stuck(0b01));
    assert_eq!(bench.ask_hex(RELAY_ON), RELAY_ON);
    assert_eq!(bench.ask_hex(RELAY_2_ON), RELAY_2_ON);
    assert_eq!(bench.line.engine(oven).outputs(), 0b10);
    // The relay itself is stuck, and a restart of the module does not free it.
    bench.act(oven, Act::Power(Power::Cycle));
    assert_eq!(bench.ask_hex(RELAY_ON), RELAY_ON);
    assert_eq!(bench.line.engine(oven).outputs(), 0);
    bench.act(oven, Act::Stuck(0));
    assert_eq!(bench.ask_hex(RELAY_ON), RELAY_ON);
    assert_eq!(bench.line.engine(oven).outputs(), 0b01);
}
