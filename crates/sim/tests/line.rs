//! The line without faults: times, speeds, collisions, echo.

mod support;

use railbus_device::{Effect, Family, Options, Setup};
use railbus_sim::{Act, Chunks, Power, VirtualLineConfig};
use railbus_wire::{Address, Baud, Character, Instant, Micros, SerialSettings};
use support::{Bench, hex, show};

/// Relay 1 of module 1 on, as the manual prints it [ERC-8 §3.5]; answered by its echo.
const RELAY_ON: &str = "01 05 00 3C FF 00 4C 36";

fn slow() -> SerialSettings {
    SerialSettings {
        baud: Baud::B4800,
        ..SerialSettings::FACTORY
    }
}

#[test]
fn every_character_takes_its_time() {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig::default());
    bench.send(&hex(RELAY_ON));
    bench.wait(300);
    // The request ends after 8 characters of 10 bits; 3.5 characters of silence end the frame;
    // the reply takes 8 characters again.
    let acts = Instant(100_000) + Micros(8_334) + Micros(3_646);
    let on = Effect::Output {
        channel: 0,
        on: true,
    };
    assert_eq!(bench.effects, [(acts, oven, on)]);
    assert_eq!(bench.heard, [(acts + Micros(8_334), hex(RELAY_ON))]);
}

#[test]
fn the_turnaround_lies_between() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    let options = Options {
        turnaround: Micros::from_millis(5),
        ..Options::default()
    };
    bench.add_with("oven", Setup::new(Family::Erc8, Address(1)), options);
    bench.send(&hex(RELAY_ON));
    bench.wait(300);
    assert_eq!(bench.heard[0].0, Instant(8_334 + 3_646 + 5_000 + 8_334));
}

#[test]
fn single_characters_are_heard_as_each_ends() {
    let (mut bench, _) = Bench::with_oven(VirtualLineConfig {
        chunks: Chunks::Single,
        ..VirtualLineConfig::default()
    });
    bench.send(&hex(RELAY_ON));
    bench.wait(300);
    let begins = Instant(100_000 + 8_334 + 3_646);
    let one_by_one: Vec<(Instant, Vec<u8>)> = hex(RELAY_ON)
        .into_iter()
        .zip(1..)
        .map(|(byte, count)| {
            (
                begins + SerialSettings::FACTORY.frame_time(count),
                vec![byte],
            )
        })
        .collect();
    assert_eq!(bench.heard, one_by_one);
}

#[test]
fn random_pieces_are_never_heard_early() {
    for seed in 0..50 {
        let (mut bench, _) = Bench::with_oven(VirtualLineConfig {
            seed,
            chunks: Chunks::Random,
            ..VirtualLineConfig::default()
        });
        bench.send(&hex(RELAY_ON));
        bench.wait(300);
        assert_eq!(bench.heard_bytes(), hex(RELAY_ON));
        let mut count = 0;
        for (at, piece) in &bench.heard {
            count += piece.len();
            let begins = Instant(100_000 + 8_334 + 3_646);
            assert_eq!(*at, begins + SerialSettings::FACTORY.frame_time(count));
        }
    }
}

#[test]
fn the_host_hears_itself_only_with_echo() {
    let (mut bench, _) = Bench::with_oven(VirtualLineConfig::default());
    assert_eq!(bench.ask_hex(RELAY_ON), RELAY_ON);
    bench.line.set_echo(true);
    assert_eq!(bench.ask_hex(RELAY_ON), format!("{RELAY_ON} {RELAY_ON}"));
}

#[test]
fn what_is_sent_while_sending_follows_without_a_pause() {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig::default());
    let request = hex(RELAY_ON);
    bench.send(&request[..3]);
    bench.wait(1);
    bench.send(&request[3..]);
    let free_at = Instant(100_000) + SerialSettings::FACTORY.frame_time(3);
    assert_eq!(
        bench.line.host_free_at(),
        free_at + SerialSettings::FACTORY.frame_time(5)
    );
    bench.wait(300);
    assert_eq!(bench.heard_bytes(), request);
    assert_eq!(bench.line.engine(oven).outputs(), 1);
}

#[test]
fn two_requests_in_one_are_answered_while_the_second_is_sent() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    for address in [1, 2] {
        let setup = Setup::new(Family::Eda9060a, Address(address));
        bench.add(&format!("pump{address}"), setup);
    }
    // The first module answers at once, into the second request: neither is understood, and a host
    // that sends receives only the end of it.
    let heard = bench.ask(b"$016\r$026\r");
    assert!((1..=3).contains(&heard.len()), "{heard:?}");
    // With a pause both are.
    assert_eq!(bench.ask(b"$016\r"), b"!000F00\r");
    assert_eq!(bench.ask(b"$026\r"), b"!000F00\r");
}

#[test]
fn two_modules_of_one_address_collide() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    for name in ["oven", "twin"] {
        bench.add(name, Setup::new(Family::Erc8, Address(1)));
    }
    let heard = bench.ask(&hex(RELAY_ON));
    assert!(!heard.is_empty(), "something was on the line");
    assert!(
        !heard.windows(8).any(|reply| reply == hex(RELAY_ON)),
        "and it was no reply: {}",
        show(&heard)
    );
    assert_eq!(bench.effects.len(), 2, "yet both did it");
}

#[test]
fn a_request_into_a_reply_spoils_both() {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig::default());
    bench.send(&hex(RELAY_ON));
    // The reply begins at 111.980 ms. A second request begins 2 ms into it.
    bench.run_until(Instant(114_000));
    bench.send(&hex("01 05 00 3D FF 00 1D F6"));
    bench.wait(300);
    let (first_at, first) = &bench.heard[0];
    assert_eq!(show(first), "01", "one character was over by then");
    assert_eq!(*first_at, Instant(111_980 + 1_042));
    assert_eq!(
        bench.heard.len(),
        1,
        "the host does not hear while it sends"
    );
    assert_eq!(bench.line.engine(oven).outputs(), 1, "nothing for relay 2");
}

#[test]
fn a_module_of_another_speed_hears_garbage() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    let setup = Setup {
        serial: slow(),
        ..Setup::new(Family::Erc8, Address(1))
    };
    let oven = bench.add("oven", setup);
    assert_eq!(bench.ask_hex(RELAY_ON), "");
    assert_eq!(bench.line.engine(oven).outputs(), 0);

    bench.send_at(&hex(RELAY_ON), slow());
    bench.wait(300);
    assert_eq!(show(&bench.heard_bytes()), RELAY_ON);
    assert_eq!(bench.line.engine(oven).outputs(), 1);
}

#[test]
fn a_host_of_another_speed_hears_garbage_of_the_same_length() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    let setup = Setup {
        serial: slow(),
        ..Setup::new(Family::Erc8, Address(1))
    };
    bench.add("oven", setup);
    bench.send_at(&hex(RELAY_ON), slow());
    bench.run_until(bench.line.host_free_at());
    // The host changes its speed before the reply comes, by sending one character.
    bench.send(&[0]);
    bench.wait(300);
    let heard = bench.heard_bytes();
    assert_ne!(show(&heard), RELAY_ON);
}

#[test]
fn parity_must_agree_but_a_second_stop_bit_does_not_matter() {
    let host = |character| SerialSettings {
        character,
        ..SerialSettings::FACTORY
    };
    let answers = |module, asked| {
        let mut bench = Bench::new(VirtualLineConfig::default());
        let setup = Setup {
            serial: host(module),
            ..Setup::new(Family::Erc8, Address(1))
        };
        bench.add("oven", setup);
        bench.send_at(&hex(RELAY_ON), host(asked));
        bench.wait(300);
        show(&bench.heard_bytes()) == RELAY_ON
    };
    use Character::{E1, N1, N2, O1};
    assert!(answers(N1, N1) && answers(E1, E1) && answers(O1, O1));
    assert!(answers(N1, N2));
    assert!(!answers(N1, E1) && !answers(E1, O1) && !answers(O1, N1));
}

#[test]
fn a_change_of_speed_acts_after_the_reply() {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig::default());
    // Register 1, code 2: 19200 [ERC-8 §2]. Answered by its echo at 9600.
    let change = "01 06 00 01 00 02 59 CB";
    assert_eq!(bench.ask_hex(change), change);
    assert_eq!(bench.line.engine(oven).active().serial.baud, Baud::B19200);
    assert_eq!(bench.ask_hex(RELAY_ON), "");
    bench.heard.clear();
    let fast = SerialSettings {
        baud: Baud::B19200,
        ..SerialSettings::FACTORY
    };
    bench.send_at(&hex(RELAY_ON), fast);
    bench.wait(300);
    assert_eq!(show(&bench.heard_bytes()), RELAY_ON);
}

#[test]
fn more_than_a_minute_of_backlog_is_dropped() {
    let mut bench = Bench::new(VirtualLineConfig::default());
    for _ in 0..200 {
        bench.send(&[0x55; 1000]);
    }
    let seconds = bench.line.host_free_at().0 / 1_000_000;
    assert!((60..63).contains(&seconds), "{seconds} s");
}

#[test]
fn what_a_module_did_is_counted() {
    let (mut bench, oven) = Bench::with_oven(VirtualLineConfig::default());
    let counts = |bench: &Bench| {
        let counts = bench.line.counts(oven);
        [counts.replies, counts.saves, counts.restarts]
    };
    assert_eq!(counts(&bench), [0, 0, 0]);
    bench.ask(&hex(RELAY_ON));
    assert_eq!(counts(&bench), [1, 0, 0]);
    assert!(bench.line.is_lit(oven));
    bench.act(oven, Act::Power(Power::Off));
    assert!(!bench.line.is_lit(oven));
    assert_eq!(
        bench.line.addressed(&hex(RELAY_ON)).count(),
        0,
        "without power"
    );
    bench.act(oven, Act::Power(Power::On));
    assert_eq!(counts(&bench), [1, 0, 1]);
    let twin = bench.add("twin", Setup::new(Family::Erc8, Address(2)));
    let meant: Vec<_> = bench.line.addressed(&hex(RELAY_ON)).collect();
    assert_eq!(meant, [oven]);
    assert_eq!(bench.line.addressed(&[0]).collect::<Vec<_>>(), [oven, twin]);
}
