//! Frames, noise between them, and chains of them.

use super::*;

/// [R55 §1.4, §2.1, §2.4] bit 0 of D4 is channel 1 and bit 7 of D1 channel 32; channel numbers
/// count from 1.
#[test]
fn every_channel_has_its_bit() {
    let mut board = relays(32);
    for channel in 1..=32u32 {
        let state = 1u32 << (channel - 1);
        let close = board.ask_r55(&format!("01 12 0000 00{channel:02X}"));
        let closed = [&hex("01 12")[..], &state.to_be_bytes()[..]].concat();
        assert_eq!(close, Some(closed));
        let open = board.ask_r55(&format!("01 11 0000 00{channel:02X}"));
        assert_eq!(open, Some(hex("01 11 0000 0000")));
        let index = channel as u8 - 1;
        let told: Vec<_> = outputs_told(&mut board)
            .into_iter()
            .map(|(_, channel, on)| (channel, on))
            .collect();
        assert_eq!(told, [(index, true), (index, false)]);
    }
}

/// [R55 §1.7] wrong start, wrong sum, unknown function, and channels that there are not.
#[test]
fn what_gets_no_reply() {
    let mut board = relays(4);
    board.ask_r55("01 33 00000005");
    for start in [0x00, 0x22, 0x54, 0xFF] {
        let mut wrong = frame("01 12 00000002");
        wrong[0] = start;
        wrong[7] = sum8(&wrong[..7]);
        board.ignores(&wrong);
    }
    for off_by in 1..=255 {
        let mut wrong = frame("01 12 00000002");
        wrong[7] = wrong[7].wrapping_add(off_by);
        board.ignores(&wrong);
    }
    let known = [
        0x10, 0x11, 0x12, 0x13, 0x14, 0x15, 0x16, 0x20, 0x21, 0x22, 0x30, 0x31, 0x32, 0x33, 0x34,
        0x35, 0x36, 0x37, 0x38, 0x40, 0x41, 0x70, 0x71,
    ];
    for code in (0..=255).filter(|code| !known.contains(code)) {
        board.ignores(&frame(&format!("01 {code:02X} 00000002")));
    }
    for code in [0x11, 0x12, 0x20, 0x21, 0x22, 0x30, 0x31, 0x32, 0x37, 0x38] {
        for channel in [0, 5, 6, 32, 33, 0xFF] {
            board.ignores(&frame(&format!("01 {code:02X} 0003E8 {channel:02X}")));
        }
    }
    assert_eq!(board.ask_r55("01 10 00000000"), Some(hex("01 10 00000005")));
}

/// [R55 §1.8] much noise is discarded; the frame after it is found.
#[test]
fn much_noise() {
    for noise in [vec![0x55; 1000], vec![0x00; 1000]] {
        let mut board = relays(32);
        board.send(&noise);
        board.input(Input::Bytes(&noise));
        assert_eq!(board.ask(&frame("01 12 00000002")), Some(reply(0x12, 2)));
    }
}

/// A character with a framing error ends a partial frame.
#[test]
fn a_bad_character_spoils_the_frame() {
    let mut board = relays(32);
    let close = frame("01 12 00000002");
    for at in 0..8 {
        board.wait(50);
        board.send(&close[..at]);
        board.input(Input::BadByte);
        board.send(&close[at..][1..]);
        board.wait(100);
        assert_eq!(board.engine.outputs(), 0);
    }
    assert_eq!(board.ask(&close), Some(reply(0x12, 2)));
}

/// How the bytes of a burst reach the board.
const DELIVERIES: [usize; 5] = [1, 3, 8, 13, usize::MAX];

/// Feeds bytes in pieces of this size, each when its last one has ended.
fn deliver(board: &mut Bench, bytes: &[u8], at_a_time: usize) -> Option<Vec<u8>> {
    board.wait(50);
    for lot in bytes.chunks(at_a_time.min(bytes.len())) {
        board.now = board.now + SerialSettings::FACTORY.frame_time(lot.len());
        board.engine.handle(board.now, Input::Bytes(lot));
        if at_a_time == 1 {
            assert_eq!(board.run_until(board.now), None, "it talks into a chain");
        }
    }
    board.run_until(board.now + Micros::from_millis(300))
}

/// [R55 §1.6] frames of a burst need no gap; [R55 §3.12] all are carried out, and the last one
/// that is answered at all gets the reply.
#[test]
fn chains() {
    let one_by_one: Vec<String> = (1..=32)
        .map(|channel| format!("01 32 000000{channel:02X}"))
        .collect();
    let all: Vec<&str> = one_by_one.iter().map(String::as_str).collect();
    /// Requests, the code and state of the reply, and the outputs afterwards.
    type Row<'a> = (&'a [&'a str], Option<(u8, u32)>, u32);
    let table: [Row<'_>; 8] = [
        (
            &["01 32 00000001", "01 32 00000002", "01 31 00000001"],
            None,
            2,
        ),
        (&["01 12 00000001", "01 10 00000000"], Some((0x10, 1)), 1),
        (&["01 12 00000001", "01 12 00000002"], Some((0x12, 3)), 3),
        // A no-reply request after it changes the state, not the reply.
        (&["01 12 00000001", "01 32 00000002"], Some((0x12, 1)), 3),
        (&["01 32 00000002", "01 12 00000001"], Some((0x12, 3)), 3),
        (&["01 12 00000001", "02 10 00000000"], Some((0x12, 1)), 1),
        (
            &["F5 12 00000001", "01 99 00000000", "F5 30 00000002"],
            None,
            3,
        ),
        (&all, None, u32::MAX),
    ];
    for at_a_time in DELIVERIES {
        for (requests, answered, outputs) in &table {
            let mut board = relays(32);
            let answer = deliver(&mut board, &chain(requests), at_a_time);
            let expected = answered.map(|(code, word)| reply(code, word));
            assert_eq!(answer, expected, "{requests:?} by {at_a_time}");
            assert_eq!(
                board.engine.outputs(),
                *outputs,
                "{requests:?} by {at_a_time}"
            );
        }
    }
}

/// A reply begins 1.5 characters and the turnaround after the request.
#[test]
fn turnaround() {
    for turnaround in [Micros::ZERO, Micros::from_millis(7)] {
        let setup = setup(Layout::Outputs, 32, 0);
        let options = Options {
            turnaround,
            ..Options::default()
        };
        let mut board = Bench::with(setup, Eeprom::of(&setup), options);
        board.send(&frame("01 10 00000000"));
        let begins = board.now + SerialSettings::FACTORY.t1_5() + turnaround;
        assert_eq!(board.run_until(Instant(begins.0 - 1)), None);
        assert!(board.run_until(begins).is_some());
    }
}

/// [R55 §1.6] "insist on the gap" has no effect on a board: it has no gap.
#[test]
fn a_board_never_insists_on_a_gap() {
    let setup = setup(Layout::Outputs, 32, 0);
    let options = Options {
        insist_on_gap: true,
        ..Options::default()
    };
    let mut board = Bench::with(setup, Eeprom::of(&setup), options);
    board.ask(&chain(&["02 10 00000000", "01 32 00000001"]));
    assert_eq!(board.engine.outputs(), 1);
}
