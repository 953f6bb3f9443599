//! What the functions do to outputs, and what they answer.

use super::*;

/// [R55 §2.10, §2.11, §2.12] a jog comes at once and goes after its time, to the microsecond, from
/// 1 ms to 4.66 h.
#[test]
fn jogs() {
    for millis in [1u64, 2, 1000, 0x01_0203, 0xFF_FFFF] {
        for (code, close) in [(0x37, true), (0x38, false)] {
            let mut board = with_on(if close { 0 } else { 0b100 });
            board.wait(50);
            board.send(&frame(&format!("01 {code:02X} {millis:06X} 03")));
            let begun = board.now;
            let ends = begun + Micros::from_millis(millis);
            let end = board.run_until(Instant(ends.0 - 1));
            assert_eq!((end, board.engine.outputs() != 0), (None, close));
            board.wait(1);
            assert_eq!(board.engine.outputs() != 0, !close);
            let told = outputs_told(&mut board);
            assert_eq!(told, [(begun, 2, close), (ends, 2, !close)]);
        }
    }
}

/// [R55 §2.10, §2.11] and so on boards with few relays, the last of them too.
#[test]
fn jogs_on_small_boards() {
    for count in [1, 2, 16] {
        let mut board = relays(count);
        let close = format!("01 37 0003E8 {count:02X}");
        board.wait(50);
        board.send(&frame(&close));
        let begun = board.now;
        board.wait(2000);
        let last = count - 1;
        let moves = [(begun, last, true), (begun + SECOND, last, false)];
        assert_eq!(outputs_told(&mut board), moves, "{count} relays");
    }
}

/// [R55 §2.14] a later command for the channel ends its jog, and one for others does not.
#[test]
fn commands_cancel_jogs() {
    // Relay 2 closes for a second; its state after two.
    let cancels = [
        ("01 11 00000002", false),
        ("01 31 00000002", false),
        ("01 12 00000002", true),
        ("01 32 00000002", true),
        ("01 13 00000002", true),
        ("01 33 00000003", true),
        ("01 14 00000002", false),
        ("01 34 00000003", false),
        ("01 15 00000002", true),
        ("01 35 00000002", true),
        ("01 16 00000002", false),
        ("01 36 00000002", false),
        ("01 20 00000002", false),
        ("01 30 00000002", false),
        ("01 22 0001F4 02", true),
        ("01 38 0001F4 02", true),
        ("01 21 0FFFFF 02", true),
        ("01 37 0FFFFF 02", true),
    ];
    let keeps = [
        "01 10 00000000",
        "01 11 00000001",
        "01 12 00000003",
        "01 14 00000001",
        "01 15 FFFFFFFD",
        "01 16 00000001",
        "01 20 00000001",
        "01 21 0FFFFF 01",
        "01 40 00000000",
        "02 12 00000002",
        "01 12 00000021",
    ];
    let keeps = keeps.map(|request| (request, false));
    for (expected_cancel, table) in [(true, &cancels[..]), (false, &keeps[..])] {
        for (request, closed) in table {
            let mut board = relays(32);
            board.ask_r55("01 37 0003E8 02");
            let begun = board.did()[0].0;
            board.ask_r55(request);
            board.did();
            board.run_until(begun + SECOND);
            let ended = board.did().iter().any(|(at, _)| *at == begun + SECOND);
            assert_eq!(ended, !expected_cancel, "{request}");
            board.wait(1000);
            let is_closed = board.engine.outputs() & 2 != 0;
            assert_eq!(is_closed, *closed, "{request}");
        }
    }
}

/// [R55 §2.14] a jog may run on every channel at the same time.
#[test]
fn jogs_side_by_side() {
    let mut board = relays(32);
    board.wait(50);
    let requests: Vec<Vec<u8>> = (1..=32u32)
        .map(|channel| frame(&format!("01 37 {:06X} {channel:02X}", 1000 * channel)))
        .collect();
    board.send(&requests.concat());
    board.wait(40_000);
    let told = outputs_told(&mut board);
    for channel in 0..32u8 {
        let mine: Vec<_> = told
            .iter()
            .filter(|(_, other, _)| *other == channel)
            .collect();
        let [(begun, _, true), (ended, _, false)] = mine[..] else {
            panic!("channel {channel}: {mine:?}");
        };
        assert_eq!(
            ended.since(*begun),
            Micros::from_secs(u64::from(channel) + 1)
        );
    }
}

/// [R55 §2.15, §3.11] at power-up all is off, no jog is running, and the LED is on.
#[test]
fn at_power_up() {
    let mut board = relays(32);
    assert_eq!(board.effects, [(Instant(1_000_000), Effect::Led(true))]);
    board.ask_r55("01 33 FFFFFFFF");
    board.ask_r55("01 38 0003E8 01");
    board.power_cycle();
    board.did();
    assert_eq!(board.ask_r55("01 10 00000000"), Some(hex("01 10 00000000")));
    board.wait(2000);
    assert_eq!((board.engine.outputs(), board.did()), (0, vec![]));
}

/// [R55 §3.2, §3.3] the state of each layout; outputs of an input board do not exist.
#[test]
fn layouts() {
    use Layout::{Inputs, Mixed, Outputs};
    let table = [
        (setup(Outputs, 32, 0), 0xF123_4567, 0xF123_4567),
        (setup(Inputs, 0, 32), 0x0000_0000, 0x89AB_CDEF),
        (setup(Inputs, 0, 4), 0x0000_0000, 0x0000_000F),
        (setup(Mixed, 16, 16), 0x0000_4567, 0xCDEF_4567),
        (setup(Mixed, 8, 4), 0x0000_0067, 0x000F_0067),
    ];
    for (setup, outputs, word) in table {
        let mut board = Bench::new(setup);
        board.input(Input::Levels(0x89AB_CDEF));
        let set = board.ask(&frame("01 13 F1234567"));
        assert_eq!(set, Some(reply(0x13, word)));
        assert_eq!(board.ask(&frame("01 10 00000000")), Some(reply(0x10, word)));
        assert_eq!(board.engine.outputs(), outputs);

        let asked = Op::ReadInputs;
        let seen = seen(&host(setup), &asked, &reply(0x10, word));
        let inputs = setup.input_mask();
        let expected = Observation::Channels {
            outputs: Bank::new(setup.output_mask(), outputs),
            inputs: Bank::new(inputs, 0x89AB_CDEF & inputs),
        };
        assert_eq!(seen, expected);
    }
}
