//! What the functions do to outputs, and what they answer.

use super::*;

/// [R55 §2.2] what each function and its twin do to relays 1, 3 and 32 being on:
/// [R55 §2.3, §2.4, §2.5, §2.6, §2.7, §2.8, §2.9, §2.10, §2.11]. [R55 §3.1, §3.2, §3.6] the answer
/// is the state after execution, under the function's own code. [R55 §3.7] twins say nothing.
#[test]
fn functions_and_their_twins() {
    const BEFORE: u32 = 0x8000_0005;
    let table = [
        (0x10, None, 0x0000_0000_u32, BEFORE),
        (0x11, Some(0x31), 0x0000_0003, 0x8000_0001),
        (0x11, Some(0x31), 0x0000_0002, BEFORE),
        (0x12, Some(0x32), 0x0000_0002, 0x8000_0007),
        (0x12, Some(0x32), 0x0000_0001, BEFORE),
        (0x13, Some(0x33), 0x1234_5678, 0x1234_5678),
        (0x14, Some(0x34), 0x8000_0003, 0x0000_0004),
        (0x15, Some(0x35), 0x4000_0003, 0xC000_0007),
        (0x16, Some(0x36), 0xC000_0003, 0x4000_0006),
        (0x20, Some(0x30), 0x0000_0020, 0x0000_0005),
        (0x20, Some(0x30), 0x0000_0002, 0x8000_0007),
        (0x21, Some(0x37), 0x0003_E802, 0x8000_0007),
        (0x22, Some(0x38), 0x0003_E801, 0x8000_0004),
    ];
    for (code, twin, data, after) in table {
        let mut board = with_on(BEFORE);
        let answer = board.ask(&frame(&format!("01 {code:02X} {data:08X}")));
        assert_eq!(answer, Some(reply(code, after)), "{code:02X}");
        assert_eq!(board.engine.outputs(), after, "{code:02X}");
        if let Some(twin) = twin {
            let mut board = with_on(BEFORE);
            let answer = board.ask_r55(&format!("01 {twin:02X} {data:08X}"));
            assert_eq!(answer, None, "{twin:02X}");
            assert_eq!(board.engine.outputs(), after, "{twin:02X}");
            let changes = outputs_told(&mut board).len();
            assert_eq!(changes as u32, (BEFORE ^ after).count_ones());
        }
    }
}

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

/// [R55 §2.13] a jog time of 0 is the end state at once.
#[test]
fn jogs_of_no_time() {
    for (request, before, after) in [
        ("01 21 000000 01", 0, 0),
        ("01 21 000000 01", 1, 0),
        ("01 22 000000 01", 0, 1),
        ("01 22 000000 01", 1, 1),
    ] {
        let mut board = with_on(before);
        let answer = board.ask(&frame(request));
        let code = hex(request)[1];
        assert_eq!(answer, Some(reply(code, after)), "{request}");
        board.wait(1000);
        assert_eq!(board.engine.outputs(), after);
    }
}

/// [R55 §2.14] a later command for the channel ends its jog, and one for others does not.
#[test]
fn commands_cancel_jogs() {
    // Relay 2 closes for a second; what it is after two.
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

/// [R55 §2.16, §3.5] bits above the count have no effect and read 0.
#[test]
fn bits_above_the_count() {
    let mut board = relays(5);
    let table = [
        ("01 13 FFFFFFFF", 0x1F),
        ("01 14 FFFFFFF0", 0x0F),
        ("01 16 FFFFFFE1", 0x0E),
        ("01 15 80000020", 0x0E),
        ("01 15 FFFFFFFF", 0x1F),
    ];
    for (request, state) in table {
        let code = hex(request)[1];
        assert_eq!(board.ask(&frame(request)), Some(reply(code, state)));
        assert_eq!(board.engine.outputs(), state);
    }
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
        let expected = Seen::Channels {
            outputs: Bank::new(setup.output_mask(), outputs),
            inputs: Bank::new(inputs, 0x89AB_CDEF & inputs),
        };
        assert_eq!(seen, expected);
    }
}

/// [R55 §4.1, §4.2] everything from 10 to 38 is carried out for address 245, in silence;
/// [R55 §4.12] the printed frames for all off and all on.
#[test]
fn broadcasts() {
    for address in [1, 7, 255] {
        let setup = Setup {
            address: Address(address),
            ..setup(Layout::Outputs, 32, 0)
        };
        let mut board = Bench::new(setup);
        let table = [
            ("F5 10 00000000", 0),
            ("F5 12 00000020", 0x8000_0000),
            ("F5 11 00000020", 0),
            ("F5 13 00000007", 7),
            ("F5 14 00000001", 6),
            ("F5 15 00000008", 0xE),
            ("F5 16 0000000A", 4),
            ("F5 20 00000003", 0),
            ("F5 21 0FFFFF 01", 1),
            ("F5 22 0FFFFF 01", 0),
            ("F5 30 00000001", 1),
            ("F5 31 00000001", 0),
            ("F5 32 00000002", 2),
            ("F5 34 00000002", 0),
            ("F5 35 00000003", 3),
            ("F5 36 00000001", 2),
            ("F5 37 0FFFFF 01", 3),
            ("F5 38 0FFFFF 01", 2),
        ];
        for (request, outputs) in table {
            assert_eq!(board.ask(&frame(request)), None, "{request}");
            assert_eq!(board.engine.outputs(), outputs, "{request}");
        }
        assert_eq!(board.ask_hex("55 F5 33 FF FF FF FF 79"), None);
        assert_eq!(board.engine.outputs(), u32::MAX);
        assert_eq!(board.ask_hex("55 F5 33 00 00 00 00 7D"), None);
        assert_eq!(board.engine.outputs(), 0);
    }
}
