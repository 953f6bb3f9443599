//! What a listener reports of good and bad lines.

use railbus_sniff::{
    Flaw, FrameRole, FrameVerdict, Input, Listener, Output, SniffEvent, SniffedFrame,
};
use railbus_wire::{Instant, Micros, Protocol, SerialSettings, crc16};

/// A line being listened to, and its time.
struct Ear {
    listener: Listener,
    now: Instant,
    told: Vec<SniffEvent>,
}

impl Ear {
    fn new() -> Ear {
        Ear {
            listener: Listener::new(SerialSettings::FACTORY),
            now: Instant(1_000_000),
            told: Vec::new(),
        }
    }

    fn drain(&mut self) -> Option<Instant> {
        loop {
            match self.listener.poll() {
                Output::Heard(heard) => self.told.push(heard),
                Output::Wait(due) => return due,
            }
        }
    }

    /// Time passes, with every timeout that falls due.
    fn pass(&mut self, span: Micros) {
        let end = self.now + span;
        while let Some(due) = self.drain().filter(|due| *due <= end) {
            self.now = due;
            self.listener.handle(due, Input::Timeout);
        }
        self.now = end;
    }

    /// Bytes come one by one at the line's pace.
    fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.pass(SerialSettings::FACTORY.frame_time(1));
            self.listener.handle(self.now, Input::Bytes(&[*byte]));
        }
        self.drain();
    }

    /// A frame, and the silence behind it.
    fn frame(&mut self, bytes: &[u8]) {
        self.hear(bytes);
        self.pass(Micros::from_millis(12));
    }

    fn frames(&self) -> Vec<&SniffedFrame> {
        let frames = self.told.iter().filter_map(|heard| match heard {
            SniffEvent::Frame(frame) => Some(frame),
            SniffEvent::Missing(_) => None,
        });
        frames.collect()
    }

    /// `protocol role address verdict`, one line a frame.
    fn words(&self) -> Vec<String> {
        self.told.iter().map(words).collect()
    }
}

fn words(heard: &SniffEvent) -> String {
    match heard {
        SniffEvent::Missing(missing) => format!("{} missing", missing.asked.protocol()),
        SniffEvent::Frame(frame) => {
            let readings = frame.readings.iter().map(|reading| {
                let role = match reading.role {
                    Some(FrameRole::Request) => "→",
                    Some(FrameRole::Reply) => "←",
                    None => "?",
                };
                let address = reading.address.map_or("–".to_owned(), |a| a.0.to_string());
                format!("{} {role} {address}", reading.protocol)
            });
            let readings: Vec<String> = readings.collect();
            format!("{} {}", readings.join(" | "), frame.verdict.name())
        }
    }
}

fn rtu(head: &[u8]) -> Vec<u8> {
    let mut frame = head.to_vec();
    frame.extend(crc16(head).to_le_bytes());
    frame
}

/// The exchanges of UX's drawing.
fn mixed() -> Vec<Vec<u8>> {
    vec![
        b"$016\r".to_vec(),
        b"!030200\r".to_vec(),
        vec![0x03, 0x01, 0x00, 0x3C, 0x00, 0x08, 0xFC, 0x22],
        vec![0x03, 0x01, 0x01, 0x05, 0x90, 0x33],
        vec![0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69],
        vec![0x22, 0x04, 0x10, 0, 0, 0, 5, 0x3B],
        vec![0x4C, 0x57, 0x02, 0x03, 0x05, 0x0D],
        vec![0x6C, 0x63, 0x02, 0x03, 0x02, 0x07, 0x0D],
    ]
}

const MIXED: [&str; 8] = [
    "ascii → 1 ok",
    "ascii ← 1 ok",
    "rtu → 3 ok",
    "rtu ← 3 ok",
    "r55 → 4 ok",
    "r55 ← 4 ok",
    "lc02 → 2 ok",
    "lc02 ← 2 ok",
];

#[test]
fn four_protocols_on_one_wire_are_told_apart_and_paired() {
    let mut ear = Ear::new();
    for frame in mixed() {
        ear.frame(&frame);
    }
    assert_eq!(ear.words(), MIXED);
    for pair in ear.frames().chunks(2) {
        let (request, reply) = (pair[0], pair[1]);
        assert_eq!(reply.after, Some(Micros(12_000)), "{reply:?}");
        let asked = reply.asked.as_ref().map(|asked| asked.bytes());
        assert_eq!(asked, Some(request.bytes.as_slice()));
    }
    assert_eq!(ear.frames()[1].gap, Some(Micros(12_000)));
}

#[test]
fn pieces_of_any_length_say_the_same() {
    let all = mixed().concat();
    for size in 1..=all.len() {
        let mut ear = Ear::new();
        for piece in all.chunks(size) {
            ear.now = ear.now + SerialSettings::FACTORY.frame_time(piece.len());
            ear.listener.handle(ear.now, Input::Bytes(piece));
        }
        ear.pass(Micros::from_millis(100));
        assert_eq!(ear.words(), MIXED, "in pieces of {size}");
    }
}

#[test]
fn what_is_wrong_is_told_with_the_reason() {
    let mut ear = Ear::new();
    ear.frame(&[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08, 0xFC, 0x22]);
    ear.frame(&[0x03, 0x01, 0x01, 0x05, 0x90, 0x34]);
    ear.pass(Micros::from_millis(50));
    ear.frame(&[0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69]);
    ear.pass(Micros::from_millis(400));
    ear.frame(&[0x22, 0x04, 0x10, 0, 0]);
    ear.pass(Micros::from_millis(50));
    ear.frame(&[0x4C, 0x57, 0x02, 0x03, 0x06, 0x0D]);
    ear.pass(Micros::from_millis(50));
    ear.frame(&[0xFE, 0x00, 0xF8, 0x80]);
    ear.pass(Micros::from_millis(50));
    ear.frame(b"$01");
    ear.pass(Micros::from_millis(50));
    ear.frame(b"#01\r");
    ear.frame(&rtu(&[0x01, 0x42, 0x0E, 0x01, 0x00]));
    ear.pass(Micros::from_millis(500));
    let expected = [
        "rtu → 3 ok",
        "rtu ← 3 bad checksum",
        "r55 → 4 ok",
        "r55 missing",
        "r55 ← 4 bad short",
        "lc02 → 2 bad checksum",
        " bad foreign",
        "ascii → – bad short",
        "ascii → 1 unknown",
        "rtu ? 1 unknown",
    ];
    assert_eq!(ear.words(), expected);
}

#[test]
fn a_refusal_is_told_even_without_its_crc() {
    let mut ear = Ear::new();
    let ask = rtu(&[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08]);
    ear.frame(&ask);
    ear.frame(&rtu(&[0x03, 0x81, 0x02]));
    ear.pass(Micros::from_millis(30));
    ear.frame(&ask);
    ear.frame(&[0x03, 0x81, 0x02]); // [ERC-8 §5.2]
    ear.pass(Micros::from_millis(30));
    // Once, not twice.
    ear.frame(&[0x03, 0x81, 0x02]);
    ear.pass(Micros::from_millis(30));
    ear.frame(b"$016\r");
    ear.frame(b"?01\r");
    let expected = [
        "rtu → 3 ok",
        "rtu ← 3 refused",
        "rtu → 3 ok",
        "rtu ← 3 refused",
        " bad foreign",
        "ascii → 1 ok",
        "ascii ← 1 refused",
    ];
    assert_eq!(ear.words(), expected);
}

#[test]
fn a_write_and_its_repeating_reply_are_a_pair_and_later_a_request_again() {
    let mut ear = Ear::new();
    let on = rtu(&[0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00]);
    ear.frame(&on);
    ear.frame(&on);
    ear.frame(&on);
    ear.pass(Micros::from_millis(400));
    ear.frame(&on);
    let expected = [
        "rtu → 3 ok",
        "rtu ← 3 ok",
        "rtu → 3 ok",
        "rtu missing",
        "rtu → 3 ok",
    ];
    assert_eq!(ear.words(), expected);
}

#[test]
fn bytes_that_are_two_things_are_told_as_both() {
    let mut ear = Ear::new();
    ear.frame(&[0x55, 0x01, 0x00, 0x03, 0x00, 0x04, 0xC0, 0x1D]);
    ear.pass(Micros::from_millis(50));
    assert_eq!(ear.frames().len(), 1);
    let protocols: Vec<Protocol> = ear.frames()[0]
        .readings
        .iter()
        .map(|r| r.protocol)
        .collect();
    assert_eq!(protocols, [Protocol::Rtu, Protocol::R55]);
}

#[test]
fn an_ascii_reply_without_its_checksum_is_bad_where_the_request_had_one() {
    let mut ear = Ear::new();
    ear.frame(b"$016BB\r");
    ear.frame(b"!030200\r");
    ear.pass(Micros::from_millis(30));
    assert_eq!(ear.words(), ["ascii → 1 ok", "ascii ← 1 bad checksum"]);
}

#[test]
fn noise_around_a_frame_does_not_hide_it() {
    let mut ear = Ear::new();
    let ask = rtu(&[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08]);
    let mut bytes = vec![0x00, 0xFF, 0x01, 0x03];
    bytes.extend(&ask);
    ear.frame(&bytes);
    ear.pass(Micros::from_millis(50));
    assert_eq!(ear.words()[..2], [" bad foreign", "rtu → 3 ok"]);
    let verdict = ear.frames()[0].verdict;
    assert_eq!(verdict, FrameVerdict::Bad(Flaw::Foreign));
}

#[test]
fn a_frame_is_told_at_once_where_silence_shows_that_noise_before_it_had_ended() {
    let mut ear = Ear::new();
    // Looks like the beginning of a reply of 69 bytes.
    ear.hear(&[0x01, 0x03, 0x40]);
    ear.pass(Micros::from_millis(6));
    ear.hear(&rtu(&[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08]));
    assert_eq!(ear.words(), [" bad foreign", "rtu → 3 ok"]);
}

#[test]
fn noise_is_cut_where_it_was_silent_and_an_envelope_alone_is_not_believed_in_it() {
    let mut ear = Ear::new();
    ear.hear(&[0xFE, 0x00]);
    ear.pass(Micros::from_millis(6));
    ear.hear(&[0xF8, 0x80, 0x11]);
    ear.pass(Micros::from_millis(50));
    let lens: Vec<usize> = ear.frames().iter().map(|frame| frame.bytes.len()).collect();
    assert_eq!(lens, [2, 3]);
    // The sum is right, the function does not exist: that happens by chance once in 256 times.
    let mut ear = Ear::new();
    ear.frame(&[0x87, 0x55, 0x21, 0x99, 0, 0, 0, 0, 0x0F]);
    ear.pass(Micros::from_millis(50));
    assert_eq!(ear.words(), [" bad foreign"]);
    ear.frame(&[0x55, 0x21, 0x99, 0, 0, 0, 0, 0x0F]);
    ear.pass(Micros::from_millis(50));
    assert_eq!(ear.words()[1..], ["r55 → 33 unknown"]);
}

#[test]
fn a_board_is_not_waited_for_as_long_as_for_a_frame_cut_short() {
    let mut ear = Ear::new();
    // Address 4 can be read as a Modbus function as well.
    ear.hear(&[0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69]);
    assert!(ear.words().is_empty());
    ear.pass(Micros::from_millis(6));
    assert_eq!(ear.words(), ["r55 → 4 ok"]);
    let mut ear = Ear::new();
    ear.hear(&[0x55, 0x04, 0x10, 0, 0]);
    ear.pass(Micros::from_millis(18));
    assert!(ear.words().is_empty());
    ear.pass(Micros::from_millis(4));
    assert_eq!(ear.words(), ["r55 → 4 bad short"]);
}

#[test]
fn a_request_that_is_not_known_ends_the_waiting_for_the_one_before() {
    let mut ear = Ear::new();
    ear.frame(b"$016\r");
    ear.frame(&[0x4C, 0x57, 0x02, 0x09, 0x0B, 0x0D]);
    ear.pass(Micros::from_millis(30));
    ear.frame(b"!");
    ear.pass(Micros::from_millis(30));
    let expected = [
        "ascii → 1 ok",
        "ascii missing",
        "lc02 → 2 unknown",
        " bad foreign",
    ];
    assert_eq!(ear.words(), expected);
}

#[test]
fn a_late_reply_is_a_reply_and_told_to_be_late() {
    let mut ear = Ear::new();
    ear.frame(b"$016\r");
    ear.pass(Micros::from_millis(600));
    ear.frame(b"!030200\r");
    assert_eq!(
        ear.words(),
        ["ascii → 1 ok", "ascii missing", "ascii ← 1 ok"]
    );
    assert!(ear.frames()[1].late);
    // Noise alone does not make a reply late.
    let mut ear = Ear::new();
    ear.frame(b"$016\r");
    ear.frame(&[0x87]);
    ear.pass(Micros::from_millis(30));
    ear.frame(b"!030200\r");
    assert_eq!(
        ear.words(),
        ["ascii → 1 ok", " bad foreign", "ascii ← 1 ok"]
    );
    assert!(!ear.frames()[2].late);
}

#[test]
fn a_daemons_own_frames_are_requests_whatever_was_open() {
    let mut ear = Ear::new();
    let on = rtu(&[0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00]);
    for _ in 0..2 {
        ear.now = ear.now + Micros::from_millis(40);
        ear.listener.handle(ear.now, Input::Sent(&on));
    }
    ear.drain();
    assert_eq!(ear.words(), ["rtu → 3 ok", "rtu missing", "rtu → 3 ok"]);
}

#[test]
fn no_byte_is_lost_or_told_twice_however_it_comes() {
    let mut seed = 7_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 16) as usize
    };
    let good = mixed();
    for _ in 0..400 {
        let mut ear = Ear::new();
        let mut sent = Vec::new();
        for _ in 0..random() % 40 {
            let mut piece = match random() % 3 {
                0 => good[random() % good.len()].clone(),
                1 => (0..random() % 30).map(|_| random() as u8).collect(),
                _ => {
                    let starts = [0x55, 0x22, 0x4C, 0x6C, 0x01, 0x03, b'$', b'!'];
                    (0..random() % 9).map(|_| starts[random() % 8]).collect()
                }
            };
            if random() % 4 == 0 && !piece.is_empty() {
                let at = random() % piece.len();
                piece[at] ^= 1 << (random() % 8);
            }
            ear.listener.handle(ear.now, Input::Bytes(&piece));
            sent.extend(piece);
            ear.pass(Micros(random() as u64 % 30_000));
        }
        ear.pass(Micros::from_secs(1));
        let told: Vec<u8> = ear.frames().iter().flat_map(|f| f.bytes.clone()).collect();
        assert_eq!(told, sent);
        let mut last = Instant(0);
        for frame in ear.frames() {
            assert!(frame.at >= last && frame.end >= frame.at, "{frame:?}");
            assert!(!frame.bytes.is_empty() && frame.bytes.len() <= SniffedFrame::LEN_MAX);
            last = frame.at;
        }
    }
}
