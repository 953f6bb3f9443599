//! Addresses and variables.

use super::*;

/// [R55 §4.3] 40 to 245, and to the board itself, is answered with the address in both places.
/// [R55 §4.4] the host takes it from D4, or else from the address byte.
#[test]
fn the_address_is_read() {
    for address in [1, 7, 244, 246, 255] {
        let setup = Setup {
            address: Address(address),
            ..setup(Layout::Outputs, 32, 0)
        };
        let mut board = Bench::new(setup);
        for asked in [0xF5, address] {
            let answer = board.ask_r55(&format!("{asked:02X} 40 00000000"));
            assert_eq!(answer, Some(vec![address, 0x40, 0, 0, 0, address]));
        }
    }
    let table = [
        ("22 07 40 00 00 00 07", Some(7)),
        ("22 F5 40 00 00 00 07", Some(7)),
        ("22 07 40 00 00 00 00", Some(7)),
        ("22 F5 40 00 00 00 00", None),
    ];
    let asked = r55::Exchange::new(r55::BROADCAST, r55::Request::ReadAddress);
    for (answer, address) in table {
        let mut bytes = hex(answer);
        bytes.push(sum8(&bytes));
        let reply = asked.decode_response(&bytes).whole().expect("a reply");
        assert_eq!(board_address(&reply), address.map(Address), "{answer}");
    }
    let anonymous = Reply {
        from: None,
        response: r55::Response::word(0),
    };
    assert_eq!(board_address(&anonymous), None);
}

/// [R55 §4.6, §4.7] 41 is heard until 10 s after power-up, to the microsecond.
#[test]
fn the_window_for_an_address() {
    for (late, accepted) in [(0, true), (1, false), (1_000_000, false)] {
        let mut board = relays(32);
        board.power_cycle();
        let powered = board.now;
        let write = frame("01 41 00000007");
        let end = powered + Micros::from_secs(10) + Micros(late);
        let took = SerialSettings::FACTORY.frame_time(1).0 * 8;
        assert_eq!(board.run_until(Instant(end.0 - took)), None);
        board.send(&write);
        assert_eq!(board.now, end);
        let answer = board.run_until(end + SECOND);
        assert_eq!(answer, accepted.then(|| reply(0x41, 7)), "{late} µs late");
        let address = Address(if accepted { 7 } else { 1 });
        assert_eq!(board.engine.eeprom().address, address);
        assert_eq!(board.engine.active().address, address);
        assert_eq!(board.did().len(), usize::from(accepted));
    }
}

/// [R55 §4.10] 41 is answered from the old address with the new one in D4, which then acts, is
/// saved once, and survives power-off.
#[test]
fn an_address_is_written() {
    let mut board = relays(32);
    board.did();
    assert_eq!(board.ask(&frame("01 41 00000007")), Some(reply(0x41, 7)));
    let saved = Eeprom {
        address: Address(7),
        ..Eeprom::of(&board.setup)
    };
    let did: Vec<Effect> = board.did().into_iter().map(|(_, what)| what).collect();
    assert_eq!(did, [Effect::Save(saved)]);
    board.ignores(&frame("01 10 00000000"));
    assert_eq!(board.ask_r55("07 10 00000000"), Some(hex("07 10 00000000")));
    board.power_cycle();
    assert_eq!(board.ask_r55("07 10 00000000"), Some(hex("07 10 00000000")));
}

/// [R55 §4.10] until the reply has left, the old address holds.
#[test]
fn the_old_address_holds_until_the_reply_has_left() {
    let mut board = relays(32);
    board.send(&frame("01 41 00000007"));
    assert_eq!(board.engine.active().address, Address(1));
    let left = board.now + SerialSettings::FACTORY.t1_5() + SerialSettings::FACTORY.frame_time(8);
    assert!(board.run_until(left).is_some());
    assert_eq!(
        (board.now, board.engine.active().address),
        (left, Address(7))
    );

    // With config_applies = after restart, it holds until then.
    let setup = setup(Layout::Outputs, 32, 0);
    let options = Options {
        applies: Applies::AfterRestart,
        ..Options::default()
    };
    let mut board = Bench::with(setup, Eeprom::of(&setup), options);
    assert_eq!(board.ask(&frame("01 41 00000007")), Some(reply(0x41, 7)));
    assert!(board.ask_r55("01 10 00000000").is_some());
    board.power_cycle();
    assert!(board.ask_r55("07 10 00000000").is_some());
}

/// [R55 §4.9] 0 and 245 are refused, and all others taken.
#[test]
fn new_addresses() {
    for new in 0..=255u8 {
        let mut board = relays(32);
        let write = frame(&format!("01 41 000000{new:02X}"));
        if [0, 245].contains(&new) {
            board.ignores(&write);
        } else {
            assert_eq!(board.ask(&write), Some(reply(0x41, new.into())));
            assert_eq!(board.engine.active().address, Address(new));
        }
    }
}

fn programmable() -> Bench {
    Bench::new(Setup {
        variables: 2,
        ..setup(Layout::Outputs, 32, 0)
    })
}

/// [R55 §5.1] 71 writes and 70 reads, both answered with value and index. [R55 §5.3] there are
/// 32, which are 0 after power-up.
#[test]
fn variables() {
    let mut board = programmable();
    let word = |index: u8| 0xF001_0200 | u32::from(index);
    for index in 0..32u8 {
        let read = frame(&format!("01 70 000000 {index:02X}"));
        assert_eq!(board.ask(&read), Some(reply(0x70, index.into())));
        let write = frame(&format!("01 71 F00102 {index:02X}"));
        assert_eq!(board.ask(&write), Some(reply(0x71, word(index))));
        assert_eq!(board.ask(&read), Some(reply(0x70, word(index))));
    }
    for index in [32, 33, 255] {
        board.ignores(&frame(&format!("01 70 000000 {index:02X}")));
        board.ignores(&frame(&format!("01 71 000001 {index:02X}")));
    }
    assert_eq!(board.did(), [], "variables are nothing that is kept");
    board.power_cycle();
    for index in 0..32u8 {
        let read = frame(&format!("01 70 000000 {index:02X}"));
        assert_eq!(board.ask(&read), Some(reply(0x70, index.into())));
    }
}
