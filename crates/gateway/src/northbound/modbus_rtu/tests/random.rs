//! Random requests, judged by the rules of the line.

use super::*;

/// Numbers from a seed.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % end
    }

    fn is(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }
}

/// 100,000 requests in random pieces and with noise, at all speeds, to adapters with and without
/// an echo: no answer comes earlier than a silence after what was heard last, and every request
/// that a master waits for is answered once.
#[test]
fn no_answer_is_early_in_a_hundred_thousand() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut answers = 0;
    for turn in 0..1_000 {
        let baud = Baud::ALL[random.below(8) as usize];
        let character = Character::ALL[random.below(4) as usize];
        let mut stage = Stage::at(SerialSettings { baud, character });
        stage.echoes = random.is(50);
        // Before these, what looks like its request may be an echo or not.
        for _ in 0..4 {
            assert!(stage.ask(OVEN, &READ).is_some());
        }
        for _ in 0..100 {
            answers += u32::from(play(&mut stage, &mut random, turn));
        }
        assert!(stage.sent.is_empty());
    }
    // Some are to nobody.
    assert!(answers > 70_000, "{answers}");
}

/// One request; whether it was answered.
fn play(stage: &mut Stage, random: &mut Random, turn: u32) -> bool {
    let silence = stage.serial.t3_5();
    if random.is(20) {
        let noise: Vec<u8> = (0..=random.below(9))
            .map(|_| random.below(256) as u8)
            .collect();
        stage.hear(&noise);
        stage.pass(silence + Micros(random.below(40_000)));
        // By chance it may be a frame, once in 65536 times.
        assert!(stage.sent.is_empty(), "{turn} {noise:02X?}");
    }
    let unit = [OVEN, BOARD, HALL, NOBODY][random.below(4) as usize];
    let first = if unit == OVEN { 60 } else { 0 };
    let (pdu, begins): (Vec<u8>, bool) = match random.below(4) {
        0 => (vec![1, 0, first, 0, 1 + random.below(4) as u8], false),
        1 => (vec![4, 0, 64, 0, 1 + random.below(8) as u8], false),
        2 => (
            vec![5, 0, first, [0, 0xFF][random.below(2) as usize], 0],
            true,
        ),
        _ => (vec![0x0F, 0, first, 0, 2, 1, random.below(4) as u8], true),
    };
    let request = frame(unit, &pdu);
    let mut rest = &request[..];
    while !rest.is_empty() {
        // Adapters keep bytes back for 16 ms at most.
        let most = (16_000 / stage.serial.frame_time(1).0).clamp(1, rest.len() as u64);
        let (piece, more) = rest.split_at(1 + random.below(most) as usize);
        stage.hear_at_once(piece);
        if !more.is_empty() && random.is(50) {
            stage.pass(Micros(random.below(3_000)));
        }
        rest = more;
    }
    let mut end = stage.now;
    stage.pass(silence - Micros(1));
    assert!(
        stage.sent.is_empty() && stage.begun.is_empty(),
        "{turn}: too early"
    );
    stage.pass(Micros(1));
    if unit == NOBODY {
        stage.pass(Micros::from_millis(random.below(50)));
        assert!(stage.sent.is_empty() && stage.begun.is_empty(), "{turn}");
        return false;
    }
    if begins {
        let write = stage.begun.pop_front().expect("a write");
        assert!(stage.sent.is_empty(), "{turn}: before its end");
        stage.pass(Micros(random.below(300_000)));
        end = stage.now;
        stage.end(&write, Ok(Confirmation::Reply));
    }
    // With its echo, and as long as a master needs to say more.
    let wait = stage.serial.frame_time(300) + Micros(random.below(20_000));
    stage.pass(wait);
    let (at, answer) = stage.sent.pop_front().expect("an answer");
    assert!(
        stage.sent.is_empty() && stage.begun.is_empty(),
        "{turn}: an echo was taken for one"
    );
    assert_eq!((answer[0], answer[1], crc16(&answer)), (unit, pdu[0], 0));
    assert!(
        at.since(end) <= silence,
        "{turn}: it came {:?} later",
        at.since(end)
    );
    true
}
