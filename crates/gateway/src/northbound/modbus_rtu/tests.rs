//! The slave and its units in virtual time, without a port.

mod random;

use super::slave::{Heard, Output, Slave};
use crate::northbound::modbus::image::UnitImage;
use crate::northbound::modbus::request::{UnitWrite, Units, WriteEnd, note_end};
use railbus_device::{Point, PointKind};
use railbus_host::{Confirmation, Evidence, Fault};
use railbus_site::{CommandError, Config, PointQuality, PointStatus, PointValue};
use railbus_wire::{Baud, Character, Instant, Micros, SerialSettings, crc16};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

const SITE: &str = r#"
[line.main]
port = "/dev/ttyS9"
[module]
oven = { line = "main", model = "erc8", address = 3 }
board = { line = "main", model = "r55", address = 4, outputs = 20 }
hall = { line = "main", model = "eda9060a", address = 6, protocol = "ascii" }
"#;

const OVEN: u8 = 3;
const BOARD: u8 = 4;
const HALL: u8 = 6;
const NOBODY: u8 = 9;

const REPLY_WITHIN: Micros = Micros::from_millis(400);
/// Switches the first relay of the oven.
const ON: [u8; 5] = [5, 0, 60, 0xFF, 0];
const OFF: [u8; 5] = [5, 0, 60, 0, 0];
/// Reads all of them.
const READ: [u8; 5] = [1, 0, 60, 0, 8];

/// A slave whose units are an ERC-8, a 0x55 board with 20 outputs and an EDA9060A; all outputs are
/// off.
struct Stage {
    config: Arc<Config>,
    images: BTreeMap<u8, UnitImage>,
    serial: SerialSettings,
    slave: Slave,
    now: Instant,
    /// What was sent, and when.
    sent: VecDeque<(Instant, Vec<u8>)>,
    /// Writes that were begun.
    begun: VecDeque<UnitWrite>,
    /// The adapter hears what it sends.
    echoes: bool,
}

fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = [&[unit][..], pdu].concat();
    let crc = crc16(&frame).to_le_bytes();
    frame.extend(crc);
    frame
}

impl Stage {
    fn new() -> Stage {
        Stage::at(SerialSettings::FACTORY)
    }

    fn at(serial: SerialSettings) -> Stage {
        let config = Arc::new(Config::parse(SITE).unwrap());
        let units = [(OVEN, "oven"), (BOARD, "board"), (HALL, "hall")];
        let images = units.map(|(unit, name)| {
            let setup = config.modules[name].setup;
            (unit, UnitImage::new(name, "main", setup, false))
        });
        let mut slave = Slave::new(serial, REPLY_WITHIN);
        slave.opened(true);
        let mut stage = Stage {
            config: Arc::clone(&config),
            images: images.into(),
            serial,
            slave,
            now: Instant(1_000_000),
            sent: VecDeque::new(),
            begun: VecDeque::new(),
            echoes: false,
        };
        for (unit, name) in units {
            for point in config.modules[name].setup.points() {
                stage.tell(unit, point, false, PointQuality::Good);
            }
        }
        stage
    }

    fn tell(&mut self, unit: u8, point: Point, is_on: bool, quality: PointQuality) {
        let image = self.images.get_mut(&unit).unwrap();
        image.apply(&PointStatus {
            module: image.module.to_string(),
            point,
            label: String::new(),
            config: Default::default(),
            value: Some(PointValue::Bool(is_on)),
            quality,
            age: None,
            time: None,
            max_age: None,
            interlock: Vec::new(),
            left: Default::default(),
            range: None,
            pulse: None,
            is_pulse_known: true,
        });
    }

    fn with<T>(&mut self, work: impl FnOnce(&mut Slave, &mut Units<'_>) -> T) -> T {
        let look = |_: &str| [7, 1, 12];
        let mut units = Units {
            images: &mut self.images,
            look: &look,
            site: "my plant",
            config: &self.config,
        };
        work(&mut self.slave, &mut units)
    }

    /// Does what is to be done now; until when there is nothing more.
    fn drive(&mut self) -> Option<Instant> {
        let now = self.now;
        loop {
            match self.with(|slave, units| slave.poll(now, units)) {
                Output::Begin(write) => self.begun.push_back(write),
                Output::Send(frame) => self.sent.push_back((now, frame)),
                Output::TakeIn => self.slave.is_up_to_date(),
                Output::Wait(deadline) => return deadline,
            }
        }
    }

    /// Lets time pass.
    fn pass(&mut self, time: Micros) {
        let end = self.now + time;
        loop {
            let sent = self.sent.len();
            let deadline = self.drive();
            if self.sent.len() > sent && self.echoes {
                let (at, frame) = self.sent[self.sent.len() - 1].clone();
                let heard = at + self.serial.frame_time(frame.len());
                assert!(deadline.is_none_or(|at| at > heard));
                self.now = heard;
                self.slave.handle(heard, &frame);
                continue;
            }
            match deadline {
                Some(at) if at <= end => self.now = self.now.max(at),
                _ => break,
            }
        }
        self.now = self.now.max(end);
    }

    /// These bytes are heard, at the speed of the line.
    fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes.chunks(1) {
            self.hear_at_once(byte);
        }
    }

    /// The same from an adapter that gives them in one piece.
    fn hear_at_once(&mut self, bytes: &[u8]) {
        self.pass(self.serial.frame_time(bytes.len()));
        let now = self.now;
        self.slave.handle(now, bytes);
    }

    /// The master asks; what it is answered soon.
    fn ask(&mut self, unit: u8, pdu: &[u8]) -> Option<Vec<u8>> {
        self.hear(&frame(unit, pdu));
        let end = self.now;
        self.pass(Micros::from_millis(50));
        self.answer(unit, end)
    }

    /// The only answer, by the rules of the line: after a silence, and not much later.
    fn answer(&mut self, unit: u8, end: Instant) -> Option<Vec<u8>> {
        let (at, answer) = self.sent.pop_front()?;
        assert!(self.sent.is_empty(), "{:02X?}", self.sent);
        assert_eq!(at.since(end), self.serial.t3_5());
        Some(pdu_of(unit, &answer))
    }

    /// What was sent since, whenever it was.
    fn said(&mut self, unit: u8) -> Vec<Vec<u8>> {
        let sent = std::mem::take(&mut self.sent);
        sent.iter().map(|(_, frame)| pdu_of(unit, frame)).collect()
    }

    fn end(&mut self, write: &UnitWrite, end: WriteEnd) {
        note_end(&mut self.images, write, &end);
        self.with(|slave, units| slave.ended(write, &end, units));
        self.pass(Micros(0));
    }

    /// Registers 68 to 71 of the oven.
    fn last(&mut self) -> Vec<u8> {
        self.ask(OVEN, &[4, 0, 68, 0, 4]).unwrap()[2..].to_vec()
    }

    fn heard(&mut self) -> Heard {
        std::mem::take(&mut self.slave.heard)
    }
}

fn pdu_of(unit: u8, frame: &[u8]) -> Vec<u8> {
    assert_eq!((frame[0], crc16(frame)), (unit, 0), "{frame:02X?}");
    frame[1..frame.len() - 2].to_vec()
}

fn output(index: u8) -> Point {
    Point {
        kind: PointKind::Output,
        index,
    }
}

fn no_reply() -> WriteEnd {
    Err((CommandError::Line(Fault::NoReply(Evidence::default())), 301))
}

const MILLISECOND: Micros = Micros::from_millis(1);

#[test]
fn reads_are_answered_after_a_silence() {
    let mut stage = Stage::new();
    stage.tell(OVEN, output(0), true, PointQuality::Good);
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 1]));
    assert_eq!(stage.ask(HALL, &[2, 0, 0, 0, 4]), Some(vec![2, 1, 0]));
    assert_eq!(stage.ask(OVEN, &[1, 0, 0, 0, 1]), Some(vec![0x81, 2]));
    assert_eq!(stage.ask(OVEN, &[1, 0, 60, 0, 0]), Some(vec![0x81, 3]));
    assert_eq!(stage.ask(OVEN, &[0x41, 1, 2]), Some(vec![0xC1, 1]));
    stage.tell(OVEN, output(0), true, PointQuality::Stale);
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![0x81, 0x0B]));
    let counts = Heard {
        good: 2,
        refused: 4,
        ..Heard::default()
    };
    assert_eq!(stage.heard(), counts);
}

#[test]
fn who_is_not_asked_is_silent() {
    let mut stage = Stage::new();
    for unit in [0, NOBODY, 247, 248, 255] {
        for pdu in [&READ[..], &ON, &[0x2B, 0x0E, 1, 0], &[0x41]] {
            assert_eq!(stage.ask(unit, pdu), None, "{unit} {pdu:02X?}");
        }
    }
    // All slaves were asked four times.
    assert_eq!(stage.heard().refused, 4);
    let mut damaged = frame(OVEN, &ON);
    damaged[4] ^= 1;
    stage.hear(&damaged);
    stage.pass(REPLY_WITHIN);
    assert_eq!(stage.said(OVEN), Vec::<Vec<u8>>::new());
    // No request of this function, though the CRC is right; and a reply.
    for pdu in [&[5, 0, 60, 0xFF][..], &[1, 1, 0], &[0x81, 2], &[0x85, 2]] {
        assert_eq!(stage.ask(OVEN, pdu), None, "{pdu:02X?}");
    }
    assert!(stage.begun.is_empty());
    assert_eq!(stage.heard().damaged, 1);
}

#[test]
fn other_slaves_on_the_line_are_not_disturbed() {
    let mut stage = Stage::new();
    let (asks, replies) = (frame(NOBODY, &READ), frame(NOBODY, &[1, 1, 0]));
    stage.hear(&asks);
    stage.pass(Micros::from_millis(4));
    stage.hear(&replies);
    stage.pass(REPLY_WITHIN);
    assert!(stage.sent.is_empty());
    // An adapter that keeps bytes back gives all of it in one piece.
    let ours = frame(OVEN, &READ);
    stage.hear_at_once(&[&asks[..], &replies, &ours].concat());
    stage.pass(REPLY_WITHIN);
    assert_eq!(stage.said(OVEN), [[1, 1, 0]]);
    stage.hear_at_once(&[&ours[..], &asks].concat());
    stage.pass(REPLY_WITHIN);
    assert!(stage.sent.is_empty(), "the master has gone on");
}

#[test]
fn requests_may_come_in_any_pieces() {
    let mut stage = Stage::new();
    let request = frame(OVEN, &READ);
    for pause in [0, 1_000, 3_640, 3_700, 12_000, 19_000].map(Micros) {
        for cut in 1..request.len() {
            stage.pass(Micros::from_millis(100));
            stage.hear(&request[..cut]);
            stage.pass(pause);
            stage.now = stage.now + Micros(1);
            let now = stage.now;
            stage.slave.handle(now, &request[cut..]);
            stage.pass(Micros::from_millis(50));
            assert_eq!(
                stage.answer(OVEN, now),
                Some(vec![1, 1, 0]),
                "{cut} {pause:?}"
            );
        }
    }
    // A master that was cut short, and begins anew.
    stage.hear(&request[..5]);
    stage.pass(Micros::from_millis(6));
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    stage.hear(&request[..5]);
    stage.pass(Micros::from_millis(21));
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    // A line that turns round.
    stage.hear(&[&[0, 0xFF], &request[..]].concat());
    stage.pass(Micros::from_millis(50));
    assert_eq!(stage.said(OVEN), [[1, 1, 0]]);
    stage.hear(&[&[1, 2], &request[..]].concat());
    stage.pass(Micros::from_millis(50));
    assert!(stage.sent.is_empty());
}

#[test]
fn a_write_is_answered_with_its_end() {
    let mut stage = Stage::new();
    assert_eq!(stage.ask(OVEN, &ON), None, "not yet");
    let write = stage.begun.pop_front().unwrap();
    assert_eq!(write.set, [(output(0), true)]);
    stage.pass(Micros::from_millis(100));
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(stage.said(OVEN), [ON]);
    assert_eq!(stage.last(), [0, 1, 0, 1, 0, 0, 0, 60]);
    assert_eq!(stage.ask(OVEN, &[0x0F, 0, 60, 0, 2, 1, 3]), None);
    let write = stage.begun.pop_front().unwrap();
    stage.end(&write, no_reply());
    assert_eq!(stage.said(OVEN), [[0x8F, 0x0B]]);
    assert_eq!(stage.last(), [0, 2, 0, 4, 1, 45, 0, 60]);
    // Faster than the silence before the answer.
    stage.hear(&frame(OVEN, &OFF));
    let end = stage.now;
    stage.pass(stage.serial.t3_5());
    let write = stage.begun.pop_front().unwrap();
    stage.end(&write, Ok(Confirmation::Reply));
    assert_eq!(stage.answer(OVEN, end), Some(OFF.to_vec()));
}

#[test]
fn a_write_that_takes_longer_is_acknowledged_and_its_end_is_told() {
    let mut stage = Stage::new();
    stage.hear(&frame(OVEN, &ON));
    let asked = stage.now;
    stage.pass(Micros::from_millis(399));
    assert!(stage.sent.is_empty());
    stage.pass(MILLISECOND);
    assert_eq!(stage.sent[0].0.since(asked), REPLY_WITHIN);
    assert_eq!(stage.said(OVEN), [[0x85, 5]]);
    let write = stage.begun.pop_front().unwrap();
    assert_eq!(stage.last(), [0, 1, 0, 6, 0, 0, 0, 60], "under way");
    // Reads are answered, other writes are not, and the same one does not go out twice.
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    assert_eq!(stage.ask(OVEN, &OFF), Some(vec![0x85, 6]));
    assert_eq!(stage.ask(OVEN, &[5, 0, 68, 0xFF, 0]), Some(vec![0x85, 2]));
    assert_eq!(stage.ask(OVEN, &ON), None);
    assert!(stage.begun.is_empty());
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(stage.said(OVEN), [ON], "it joined the first");
    assert_eq!(stage.last(), [0, 1, 0, 1, 0, 0, 0, 60]);
    // Once more, and it ends when nobody waits.
    assert_eq!(stage.ask(OVEN, &ON), None);
    stage.pass(REPLY_WITHIN);
    assert_eq!(stage.said(OVEN), [[0x85, 5]]);
    let write = stage.begun.pop_front().unwrap();
    stage.end(&write, no_reply());
    stage.pass(REPLY_WITHIN);
    assert!(stage.sent.is_empty());
    assert_eq!(stage.last(), [0, 2, 0, 4, 1, 45, 0, 60]);
    // What has ended is not joined.
    assert_eq!(stage.ask(OVEN, &ON), None);
    assert_eq!(stage.begun.pop_front().unwrap().number, 3);
}

#[test]
fn a_write_is_not_held_up_by_another_unit() {
    let mut stage = Stage::new();
    assert_eq!(stage.ask(OVEN, &ON), None);
    let first = stage.begun.pop_front().unwrap();
    // The master gives up earlier than we.
    assert_eq!(stage.ask(BOARD, &[5, 0, 7, 0xFF, 0]), None);
    let second = stage.begun.pop_front().unwrap();
    stage.end(&first, Ok(Confirmation::Reply));
    assert!(stage.sent.is_empty(), "nobody waits for it any more");
    stage.end(&second, Ok(Confirmation::Reply));
    assert_eq!(stage.said(BOARD), [[5, 0, 7, 0xFF, 0]]);
    assert_eq!(stage.heard().unanswered, 1);
}

/// An answer later than another request would be taken for that to the other.
#[test]
fn what_the_master_does_not_wait_for_is_never_answered() {
    let mut stage = Stage::new();
    assert_eq!(stage.ask(OVEN, &ON), None);
    let write = stage.begun.pop_front().unwrap();
    assert_eq!(stage.ask(NOBODY, &READ), None);
    stage.end(&write, Ok(Confirmation::Reply));
    stage.pass(Micros::from_secs(2));
    assert!(stage.sent.is_empty());
    // An answer whose time has come, but something is said.
    assert_eq!(stage.ask(OVEN, &ON), None);
    let write = stage.begun.pop_front().unwrap();
    let next = frame(NOBODY, &READ);
    stage.hear_at_once(&next[..3]);
    stage.end(&write, Ok(Confirmation::Reply));
    stage.pass(Micros::from_millis(10));
    assert!(stage.sent.is_empty());
    stage.hear_at_once(&next[3..]);
    stage.pass(Micros::from_secs(2));
    assert!(stage.sent.is_empty());
    // Noise is no request: it only makes the answer later.
    assert_eq!(stage.ask(OVEN, &ON), None);
    let write = stage.begun.pop_front().unwrap();
    stage.hear(&[7]);
    let noise = stage.now;
    stage.end(&write, Ok(Confirmation::Reply));
    stage.pass(Micros::from_millis(50));
    let (at, answer) = stage.sent.pop_front().unwrap();
    assert_eq!(at.since(noise), Micros::from_millis(20), "it is no piece");
    assert_eq!(answer, frame(OVEN, &ON));
    // This machine had no time for it.
    stage.hear(&frame(OVEN, &READ));
    stage.now = stage.now + REPLY_WITHIN + Micros::from_millis(101);
    stage.pass(Micros::from_secs(1));
    assert!(stage.sent.is_empty());
}

#[test]
fn an_echo_is_no_request() {
    let mut stage = Stage::new();
    stage.echoes = true;
    // The first answer of all looks like its request.
    for _ in 0..3 {
        for pdu in [ON, OFF] {
            assert_eq!(stage.ask(OVEN, &pdu), None);
            let write = stage.begun.pop_front().unwrap();
            stage.end(&write, Ok(Confirmation::Reply));
            stage.pass(Micros::from_secs(1));
            assert_eq!(stage.said(OVEN), [pdu]);
            assert!(stage.begun.is_empty(), "it was taken for a request");
        }
        // As long as a request to read.
        let coils = [1, 0, 0, 0, 20];
        assert_eq!(stage.ask(BOARD, &coils), Some(vec![1, 3, 0, 0, 0]));
        assert_eq!(stage.ask(OVEN, &[0x41]), Some(vec![0xC1, 1]));
    }
    assert_eq!(stage.heard().damaged, 0);
}

/// In pieces, late, behind noise, and together with the next request.
#[test]
fn an_echo_may_come_as_adapters_pass_it_on() {
    let mut stage = Stage::new();
    let write = |stage: &mut Stage| {
        assert_eq!(stage.ask(OVEN, &ON), None);
        let write = stage.begun.pop_front().unwrap();
        stage.end(&write, Ok(Confirmation::Reply));
        let (_, answer) = stage.sent.pop_front().unwrap();
        answer
    };
    stage.echoes = true;
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    stage.echoes = false;
    let answer = write(&mut stage);
    stage.hear(&answer[..3]);
    stage.pass(Micros::from_millis(16));
    stage.hear(&answer[3..]);
    stage.pass(Micros::from_secs(1));
    let answer = write(&mut stage);
    stage.pass(Micros::from_millis(60));
    stage.hear(&answer);
    stage.pass(Micros::from_secs(1));
    let answer = write(&mut stage);
    stage.hear(&[&[0][..], &answer].concat());
    stage.pass(Micros::from_secs(1));
    let answer = write(&mut stage);
    stage.hear(&[&answer[..], &frame(OVEN, &READ)].concat());
    stage.pass(Micros::from_secs(1));
    assert_eq!(stage.said(OVEN), [[1, 1, 0]]);
    assert!(stage.begun.is_empty());
    // It goes on without one.
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
}

#[test]
fn without_echoes_a_repeated_request_is_one() {
    let mut stage = Stage::new();
    for _ in 0..4 {
        assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    }
    for _ in 0..5 {
        assert_eq!(stage.ask(OVEN, &ON), None);
        let write = stage.begun.pop_front().unwrap();
        stage.end(&write, Ok(Confirmation::Reply));
        assert_eq!(stage.said(OVEN), [ON]);
        // As soon as a master can.
        stage.pass(stage.serial.frame_time(8) + stage.serial.t3_5());
    }
}

/// Whatever the adapter does with it: nothing is switched that the master did not ask for.
#[test]
fn a_master_that_only_writes_is_never_obeyed_twice() {
    let serial = SerialSettings {
        baud: Baud::B115200,
        ..SerialSettings::FACTORY
    };
    for (late, is_wire) in [
        (0, true),
        (10, true),
        (16, false),
        (120, true),
        (400, false),
    ] {
        let mut stage = Stage::at(serial);
        stage.slave.opened(is_wire);
        for turn in 0..20 {
            let pdu = [ON, OFF][turn % 2];
            assert_eq!(stage.ask(OVEN, &pdu), None);
            let write = stage.begun.pop_front().expect("it is carried out");
            stage.end(&write, Ok(Confirmation::Reply));
            let (_, answer) = stage.sent.pop_front().expect("an answer");
            stage.pass(Micros::from_millis(late));
            stage.hear(&answer);
            stage.pass(Micros::from_secs(1));
            assert!(stage.begun.is_empty(), "turn {turn}, {late} ms late");
            assert!(stage.sent.is_empty());
        }
    }
}

/// This machine had no time for an echo that came when it should.
#[test]
fn a_late_look_at_a_known_echo_switches_nothing() {
    let mut stage = Stage::new();
    stage.echoes = true;
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    stage.echoes = false;
    assert_eq!(stage.ask(OVEN, &ON), None);
    let write = stage.begun.pop_front().unwrap();
    stage.end(&write, Ok(Confirmation::Reply));
    let (_, answer) = stage.sent.pop_front().unwrap();
    stage.pass(Micros::from_secs(3));
    stage.hear_at_once(&answer);
    stage.pass(Micros::from_secs(1));
    assert!(stage.begun.is_empty() && stage.sent.is_empty());
}

/// An answer that is to be sent is not sent where the next request waits at the port.
#[test]
fn what_waits_at_the_port_comes_before_an_answer() {
    let mut stage = Stage::new();
    stage.hear(&frame(OVEN, &ON));
    stage.pass(Micros::from_millis(50));
    let write = stage.begun.pop_front().unwrap();
    note_end(&mut stage.images, &write, &Ok(Confirmation::Reply));
    let end = Ok(Confirmation::Reply);
    stage.with(|slave, units| slave.ended(&write, &end, units));
    let now = stage.now;
    let next = stage.with(|slave, units| slave.poll(now, units));
    assert_eq!(next, Output::TakeIn);
    stage.slave.handle(now, &frame(OVEN, &READ));
    stage.slave.is_up_to_date();
    stage.pass(Micros::from_secs(1));
    assert_eq!(stage.said(OVEN), [[1, 1, 0]], "to the second alone");
    assert_eq!(stage.heard().unanswered, 1);
}

/// Nothing else was ever heard: each second one may be an echo.
#[test]
fn in_doubt_a_repeated_request_is_lost() {
    let mut stage = Stage::new();
    let mut lost = 0;
    for _ in 0..10 {
        assert_eq!(stage.ask(OVEN, &ON), None);
        match stage.begun.pop_front() {
            Some(write) => {
                stage.end(&write, Ok(Confirmation::Reply));
                assert_eq!(stage.said(OVEN), [ON]);
                stage.pass(Micros::from_millis(20));
            }
            None => lost += 1,
        }
    }
    assert_eq!(lost, 5);
}

/// By another configuration the unit may be another module.
#[test]
fn a_write_is_not_joined_through_a_reload() {
    let mut stage = Stage::new();
    assert_eq!(stage.ask(OVEN, &ON), None);
    let write = stage.begun.pop_front().unwrap();
    stage.config = Arc::new(Config::parse(SITE).unwrap());
    assert_eq!(stage.ask(OVEN, &ON), Some(vec![0x85, 6]));
    stage.end(&write, Ok(Confirmation::Reply));
    assert_eq!(stage.ask(OVEN, &ON), None);
    assert_eq!(stage.begun.len(), 1);
}

#[test]
fn a_line_that_never_is_silent_costs_no_memory() {
    let mut stage = Stage::new();
    for _ in 0..10_000 {
        stage.hear(&[0x55; 64]);
    }
    assert_eq!(stage.heard().damaged, 1, "until it is silent");
    stage.pass(Micros::from_secs(1));
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    for _ in 0..10_000 {
        stage.hear(&[0x55]);
        stage.pass(Micros::from_millis(5));
    }
    stage.pass(Micros::from_secs(1));
    assert_eq!(stage.ask(OVEN, &READ), Some(vec![1, 1, 0]));
    assert!(stage.sent.is_empty() && stage.begun.is_empty());
}
