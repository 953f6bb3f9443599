//! A connection and its units, without sockets.

use super::conn::{AskedWrite, ModbusConn};
use crate::northbound::modbus::ends::LastEnd;
use crate::northbound::modbus::image::UnitImage;
use crate::northbound::modbus::request::{Units, WriteEnd, note_end};
use railbus_device::{Point, PointKind};
use railbus_host::{Confirmation, Evidence, Fault};
use railbus_site::config::Range;
use railbus_site::{BadReason, CommandError, Config, PointQuality, PointStatus, PointValue};
use railbus_wire::mbap;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Units and one client.
struct Stage {
    config: Arc<Config>,
    images: BTreeMap<u8, UnitImage>,
    conn: ModbusConn,
    transaction: u16,
}

const SITE: &str = r#"
[line.main]
port = "/dev/ttyS9"
[module]
oven = { line = "main", model = "erc8", address = 3 }
board = { line = "main", model = "r55", address = 4, outputs = 20, variables = 2 }
tank = { line = "main", model = "emd2a2q", address = 5 }
hall = { line = "main", model = "eda9060a", address = 6 }
"#;

const OVEN: u8 = 3;
const BOARD: u8 = 4;
const TANK: u8 = 5;
const ASCII: u8 = 6;

impl Stage {
    /// An ERC-8 `oven`, a 0x55 board with 20 outputs and two variables, an EMD-2A2Q `tank` by the
    /// uniform map, and an EDA9060A that speaks ASCII. All outputs are off.
    fn new() -> Stage {
        let config = Arc::new(Config::parse(SITE).unwrap());
        let unit = |unit, name, is_uniform| (unit, name, config.modules[name].setup, is_uniform);
        let units = [
            unit(OVEN, "oven", false),
            unit(BOARD, "board", false),
            unit(TANK, "tank", true),
            unit(ASCII, "hall", false),
        ];
        let images = units.map(|(unit, name, setup, is_uniform)| {
            (unit, UnitImage::new(name, "main", setup, is_uniform))
        });
        let mut stage = Stage {
            config: Arc::clone(&config),
            images: images.into(),
            conn: ModbusConn::default(),
            transaction: 0,
        };
        for (unit, name, setup, _) in units {
            for point in setup.points() {
                let value = match point.kind {
                    PointKind::Output | PointKind::Input => PointValue::Bool(false),
                    PointKind::Analog => PointValue::Analog(0.0, 0),
                    PointKind::Variable => PointValue::Number(0),
                };
                stage.tell(unit, name, point, (Some(value), PointQuality::Good));
            }
        }
        stage
    }

    fn tell(
        &mut self,
        unit: u8,
        module: &str,
        point: Point,
        (value, quality): (Option<PointValue>, PointQuality),
    ) {
        let status = PointStatus {
            module: module.to_owned(),
            point,
            label: String::new(),
            config: Default::default(),
            value,
            quality,
            age: None,
            time: None,
            max_age: None,
            interlock: Vec::new(),
            left: Default::default(),
            range: (point.kind == PointKind::Analog).then(Range::volts),
            pulse: None,
            is_pulse_known: true,
        };
        self.images.get_mut(&unit).unwrap().apply(&status);
    }

    fn with<T>(&mut self, work: impl FnOnce(&mut ModbusConn, &mut Units<'_>) -> T) -> T {
        let look = |_: &str| [7, 1, 12];
        let mut units = Units {
            images: &mut self.images,
            look: &look,
            site: "my plant",
            config: &self.config,
        };
        work(&mut self.conn, &mut units)
    }

    /// Sends a request; its transaction.
    fn send(&mut self, unit: u8, pdu: &[u8]) -> u16 {
        self.transaction += 1;
        let header = mbap::header(self.transaction, 1 + pdu.len());
        self.conn.received.extend_from_slice(&header);
        self.conn.received.push(unit);
        self.conn.received.extend_from_slice(pdu);
        self.with(|conn, units| conn.answer(units)).unwrap();
        self.transaction
    }

    /// The answers by now: transaction and what stands after the unit.
    fn answers(&mut self) -> Vec<(u16, Vec<u8>)> {
        let out = std::mem::take(&mut self.conn.out);
        let mut rest = &out[..];
        let mut found = Vec::new();
        while let railbus_wire::Decoded::Whole { len, value } = mbap::Message::decode(rest) {
            found.push((value.transaction, value.pdu.to_vec()));
            rest = &rest[len..];
        }
        assert!(rest.is_empty(), "{rest:02X?}");
        found
    }

    /// Sends a request that is answered at once.
    fn ask(&mut self, unit: u8, pdu: &[u8]) -> Vec<u8> {
        let transaction = self.send(unit, pdu);
        let mut answers = self.answers();
        let (to, answer) = answers.pop().expect("an answer");
        assert_eq!((to, answers.len()), (transaction, 0));
        answer
    }

    fn end(&mut self, asked: &AskedWrite, end: WriteEnd) {
        note_end(&mut self.images, &asked.write, &end);
        self.with(|conn, units| conn.ended(asked, &end, units));
    }

    fn write(&mut self) -> AskedWrite {
        self.conn.writes.pop_front().expect("a write")
    }
}

fn output(index: u8) -> Point {
    Point {
        kind: PointKind::Output,
        index,
    }
}

const ON: (Option<PointValue>, PointQuality) = (Some(PointValue::Bool(true)), PointQuality::Good);

fn no_reply() -> WriteEnd {
    let failure = CommandError::Line(Fault::NoReply(Evidence::default()));
    Err((failure, 301))
}

#[test]
fn an_erc_8_keeps_its_coils_and_others_have_theirs_from_0() {
    let mut stage = Stage::new();
    stage.tell(OVEN, "oven", output(0), ON);
    stage.tell(OVEN, "oven", output(2), ON);
    assert_eq!(stage.ask(OVEN, &[1, 0, 60, 0, 8]), [1, 1, 0b101]);
    assert_eq!(stage.ask(OVEN, &[1, 0, 62, 0, 1]), [1, 1, 1]);
    assert_eq!(stage.ask(OVEN, &[1, 0, 0, 0, 1]), [0x81, 2], "no coil 0");
    assert_eq!(
        stage.ask(OVEN, &[1, 0, 60, 0, 9]),
        [0x81, 2],
        "one too many"
    );
    assert_eq!(
        stage.ask(OVEN, &[3, 0, 0, 0, 1]),
        [0x83, 2],
        "its address register"
    );
    stage.tell(BOARD, "board", output(19), ON);
    assert_eq!(stage.ask(BOARD, &[1, 0, 0, 0, 20]), [1, 3, 0, 0, 0b1000]);
    assert_eq!(stage.ask(BOARD, &[2, 0, 100, 0, 20]), [2, 3, 0, 0, 0b1000]);
    assert_eq!(stage.ask(BOARD, &[3, 0, 0, 0, 2]), [3, 4, 0, 0, 0, 0b1000]);
    let input = Point {
        kind: PointKind::Input,
        index: 1,
    };
    stage.tell(ASCII, "hall", input, ON);
    assert_eq!(stage.ask(ASCII, &[2, 0, 0, 0, 4]), [2, 1, 0b10]);
}

#[test]
fn numbers_have_their_scale() {
    let mut stage = Stage::new();
    let analog = |index| Point {
        kind: PointKind::Analog,
        index,
    };
    let tell = |stage: &mut Stage, index, value, register| {
        let value = PointValue::Analog(value, register);
        stage.tell(
            TANK,
            "tank",
            analog(index),
            (Some(value), PointQuality::Good),
        );
    };
    tell(&mut stage, 0, 8.71, 871);
    tell(&mut stage, 1, -4.5, 0);
    // Two decimals.
    let scaled = [871i16, -450].map(i16::to_be_bytes).concat();
    let answer = [&[4, 4][..], &scaled].concat();
    assert_eq!(stage.ask(TANK, &[4, 0, 0, 0, 2]), answer);
    let floats = [8.71f32, -4.5].map(f32::to_be_bytes).concat();
    let answer = [&[4, 8][..], &floats].concat();
    assert_eq!(stage.ask(TANK, &[4, 0, 16, 0, 4]), answer);
    assert_eq!(
        stage.ask(TANK, &[4, 0, 17, 0, 1])[2..],
        floats[2..4],
        "half of one"
    );
    tell(&mut stage, 0, 400.0, 0);
    assert_eq!(
        stage.ask(TANK, &[4, 0, 0, 0, 1]),
        [0x84, 4],
        "it does not fit"
    );
    let variable = Point {
        kind: PointKind::Variable,
        index: 1,
    };
    let value = Some(PointValue::Number(0x0012_3456));
    stage.tell(BOARD, "board", variable, (value, PointQuality::Good));
    assert_eq!(
        stage.ask(BOARD, &[4, 1, 2, 0, 2]),
        [4, 4, 0x00, 0x12, 0x34, 0x56]
    );
}

/// What is not known at the moment is never sent.
#[test]
fn a_value_that_is_not_good_is_an_exception() {
    let mut stage = Stage::new();
    let off = Some(PointValue::Bool(false));
    for (quality, exception, number) in [
        (PointQuality::Stale, 0x0B, 1),
        (PointQuality::Bad(BadReason::NeverRead), 0x0B, 2),
        (PointQuality::Bad(BadReason::Offline), 0x0B, 3),
        (PointQuality::Bad(BadReason::LineAbsent), 0x0A, 4),
        (PointQuality::Bad(BadReason::LineBusy), 0x0A, 5),
        (PointQuality::Bad(BadReason::Exclusive), 0x0A, 6),
        (PointQuality::Bad(BadReason::LineClosed), 0x0A, 7),
        (PointQuality::Bad(BadReason::OtherModel), 0x0B, 8),
    ] {
        stage.tell(BOARD, "board", output(5), (off, quality));
        for read in [
            [1, 0, 5, 0, 1],
            [1, 0, 0, 0, 8],
            [2, 0, 105, 0, 1],
            [3, 0, 0, 0, 1],
        ] {
            let answer = stage.ask(BOARD, &read);
            assert_eq!(answer, [read[0] | 0x80, exception], "{quality:?} {read:?}");
        }
        assert_eq!(
            stage.ask(BOARD, &[1, 0, 6, 0, 1]),
            [1, 1, 0],
            "the next one"
        );
        assert_eq!(
            stage.ask(BOARD, &[3, 0, 1, 0, 1]),
            [3, 2, 0, 0],
            "the other word"
        );
        // Registers about the unit are always there.
        assert_eq!(
            stage.ask(BOARD, &[4, 0, 64, 0, 4]),
            [4, 8, 0, number, 0, 7, 0, 1, 0, 12]
        );
    }
}

#[test]
fn a_write_is_answered_with_its_end() {
    let mut stage = Stage::new();
    let status = |stage: &mut Stage| {
        let answer = stage.ask(OVEN, &[4, 0, 68, 0, 4]);
        let words = answer[2..].as_chunks::<2>().0;
        words
            .iter()
            .map(|word| u16::from_be_bytes(*word))
            .collect::<Vec<_>>()
    };
    assert_eq!(status(&mut stage), [0, 0, 0, 0]);
    let request = [5, 0, 61, 0xFF, 0];
    let asked = stage.send(OVEN, &request);
    assert_eq!(stage.answers(), [], "not before it has ended");
    let write = stage.write();
    assert_eq!((write.write.unit, &*write.write.module), (OVEN, "oven"));
    assert_eq!(write.write.set, [(output(1), true)]);
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(stage.answers(), [(asked, request.to_vec())]);
    assert_eq!(status(&mut stage), [1, LastEnd::Readback as u16, 0, 61]);
    // [MODBUS §2.4]
    let several = [0x0F, 0, 60, 0, 3, 1, 0b101];
    let asked = stage.send(OVEN, &several);
    let write = stage.write();
    let set = [(output(0), true), (output(1), false), (output(2), true)];
    assert_eq!(write.write.set, set);
    stage.end(&write, no_reply());
    assert_eq!(stage.answers(), [(asked, vec![0x8F, 0x0B])]);
    assert_eq!(status(&mut stage), [2, LastEnd::Unknown as u16, 301, 60]);
    let asked = stage.send(OVEN, &request);
    let write = stage.write();
    stage.end(&write, Err((CommandError::Confirm(output(1)), 209)));
    assert_eq!(stage.answers(), [(asked, vec![0x85, 4])]);
    assert_eq!(status(&mut stage), [3, LastEnd::Failed as u16, 209, 61]);
}

#[test]
fn words_of_outputs_are_one_command() {
    let mut stage = Stage::new();
    let asked = stage.send(BOARD, &[6, 0, 1, 0, 0b1001]);
    let write = stage.write();
    let set = [
        (output(16), true),
        (output(17), false),
        (output(18), false),
        (output(19), true),
    ];
    assert_eq!(write.write.set, set);
    stage.end(&write, Ok(Confirmation::Reply));
    assert_eq!(stage.answers(), [(asked, vec![6, 0, 1, 0, 0b1001])]);
    stage.send(BOARD, &[0x10, 0, 0, 0, 2, 4, 0x80, 0, 0, 1]);
    let write = stage.write();
    assert_eq!(write.write.set.len(), 20);
    let on: Vec<_> = write.write.set.iter().filter(|(_, on)| *on).collect();
    assert_eq!(on, [&(output(15), true), &(output(16), true)]);
    stage.end(&write, Ok(Confirmation::Reply));
    stage.answers();
    // Outputs that it does not have.
    assert_eq!(stage.ask(BOARD, &[6, 0, 1, 0, 0b1_0000]), [0x86, 3]);
    assert_eq!(stage.ask(ASCII, &[6, 0, 1, 0, 0]), [0x86, 2], "4 outputs");
    assert_eq!(stage.ask(ASCII, &[6, 0, 0, 0, 0x10]), [0x86, 3]);
    assert_eq!(stage.conn.writes, []);
}

#[test]
fn a_mask_commands_only_its_bits_and_a_read_comes_after_its_write() {
    let mut stage = Stage::new();
    // Bits 0 and 2 are set by it: 1 and 0.
    let mask = [0x16, 0, 0, 0xFF, 0b1111_1010, 0, 0b0000_0001];
    let asked = stage.send(BOARD, &mask);
    let write = stage.write();
    assert_eq!(write.write.set, [(output(0), true), (output(2), false)]);
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(stage.answers(), [(asked, mask.to_vec())]);
    let nothing = [0x16, 0, 0, 0xFF, 0xFF, 0, 1];
    assert_eq!(stage.ask(BOARD, &nothing), nothing);
    assert_eq!(
        stage.ask(BOARD, &[0x16, 0, 1, 0, 0, 0x80, 0]),
        [0x96, 3],
        "no output"
    );
    assert_eq!(stage.ask(OVEN, &mask), [0x96, 2], "no such register");
    assert_eq!(stage.ask(BOARD, &mask[..6]), [0x96, 3]);

    let both = [0x17, 0, 0, 0, 2, 0, 1, 0, 1, 2, 0, 0b1000];
    let asked = stage.send(BOARD, &both);
    let write = stage.write();
    assert_eq!(write.write.set[3], (output(19), true));
    stage.tell(BOARD, "board", output(19), ON);
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(stage.answers(), [(asked, vec![0x17, 4, 0, 0, 0, 0b1000])]);
    stage.send(BOARD, &both);
    let write = stage.write();
    stage.end(&write, no_reply());
    assert_eq!(stage.answers()[0].1, [0x97, 0x0B]);
    // It was written, and what is to be read is not known.
    let (off, offline) = (Some(PointValue::Bool(false)), BadReason::Offline);
    stage.tell(BOARD, "board", output(0), (off, PointQuality::Bad(offline)));
    stage.send(BOARD, &both);
    let write = stage.write();
    stage.end(&write, Ok(Confirmation::Reply));
    assert_eq!(stage.answers()[0].1, [0x97, 0x0B]);
    for (wrong, exception) in [
        (&both[..11], 3),
        (&[0x17, 0, 0, 0, 0, 0, 1, 0, 1, 2, 0, 0][..], 3),
        (&[0x17, 0, 0, 0, 2, 0, 1, 0, 2, 2, 0, 0], 3),
        (&[0x17, 0, 1, 0, 2, 0, 1, 0, 1, 2, 0, 0], 2),
        (&[0x17, 0, 0, 0, 1, 0, 2, 0, 1, 2, 0, 0], 2),
    ] {
        assert_eq!(stage.ask(BOARD, wrong), [0x97, exception], "{wrong:02X?}");
    }
    assert_eq!(stage.ask(9, &both), [0x97, 0x0A]);
    assert_eq!(stage.conn.writes, []);
}

#[test]
fn requests_behind_a_write_wait_and_those_to_other_units_do_not() {
    let mut stage = Stage::new();
    let first = stage.send(OVEN, &[5, 0, 60, 0xFF, 0]);
    let write = stage.write();
    let read = stage.send(OVEN, &[1, 0, 60, 0, 1]);
    let second = stage.send(OVEN, &[5, 0, 60, 0, 0]);
    let behind = stage.send(OVEN, &[1, 0, 60, 0, 1]);
    assert_eq!(stage.answers(), []);
    assert_eq!(stage.conn.writes, [], "one after the other");
    assert_eq!(stage.ask(BOARD, &[1, 0, 0, 0, 1]), [1, 1, 0]);
    stage.tell(OVEN, "oven", output(0), ON);
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(
        stage.answers(),
        [(first, vec![5, 0, 60, 0xFF, 0]), (read, vec![1, 1, 1])]
    );
    let write = stage.write();
    assert_eq!(write.write.set, [(output(0), false)]);
    stage.end(&write, no_reply());
    assert_eq!(
        stage.answers(),
        [(second, vec![0x85, 0x0B]), (behind, vec![1, 1, 1])]
    );
    assert_eq!(stage.ask(OVEN, &[1, 0, 60, 0, 1]), [1, 1, 1]);
}

/// By another configuration the unit may be another module.
#[test]
fn what_waited_through_a_reload_is_not_carried_out() {
    let mut stage = Stage::new();
    let first = stage.send(OVEN, &[5, 0, 60, 0xFF, 0]);
    let write = stage.write();
    let second = stage.send(OVEN, &[5, 0, 62, 0xFF, 0]);
    let third = stage.send(OVEN, &[1, 0, 60, 0, 1]);
    let by_then = Arc::clone(&stage.config);
    stage.config = Arc::new(Config::parse(SITE).unwrap());
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(
        stage.answers(),
        [
            (first, vec![5, 0, 60, 0xFF, 0]),
            (second, vec![0x85, 6]),
            (third, vec![0x81, 6])
        ]
    );
    assert_eq!(stage.conn.writes, []);
    assert!(Arc::ptr_eq(&write.write.asked_by, &by_then));
    stage.send(OVEN, &[5, 0, 62, 0xFF, 0]);
    assert!(Arc::ptr_eq(&stage.write().write.asked_by, &stage.config));
}

/// Its unit says how it ended though its client has gone.
#[test]
fn the_end_of_a_command_is_noted_without_its_client() {
    let mut stage = Stage::new();
    stage.send(OVEN, &[5, 0, 60, 0xFF, 0]);
    let write = stage.write();
    stage.conn = ModbusConn::default();
    note_end(&mut stage.images, &write.write, &no_reply());
    let last = stage.images[&OVEN].last;
    assert_eq!((last.end, last.code), (LastEnd::Unknown, 301));
    // The same board goes on under its name, another one begins anew.
    let setup = stage.images[&OVEN].setup;
    let mut same = UnitImage::new("oven", "main", setup, false);
    same.goes_on_from(&stage.images[&OVEN]);
    assert_eq!(same.last, last);
    let mut other = UnitImage::new("oven", "far", setup, false);
    other.goes_on_from(&stage.images[&OVEN]);
    // A number is not given again while a command with it may be under way.
    let (number, end) = (other.last.number, other.last.end);
    assert_eq!((number, end), (last.number + 1, LastEnd::None));
    let mut slower = stage.images[&OVEN].setup;
    slower.gap = Some(railbus_wire::Micros::from_millis(9));
    let mut slower = UnitImage::new("oven", "main", slower, false);
    slower.goes_on_from(&stage.images[&OVEN]);
    assert_eq!(slower.last, last, "the same board");
}

#[test]
fn no_more_than_16_requests_wait() {
    let mut stage = Stage::new();
    stage.send(OVEN, &[5, 0, 60, 0xFF, 0]);
    let write = stage.write();
    for _ in 0..15 {
        stage.send(OVEN, &[1, 0, 60, 0, 1]);
    }
    assert_eq!(stage.answers(), []);
    assert_eq!(stage.ask(OVEN, &[1, 0, 60, 0, 1]), [0x81, 6]);
    assert_eq!(stage.ask(BOARD, &[5, 0, 0, 0xFF, 0]), [0x85, 6], "a write");
    assert_eq!(
        stage.ask(BOARD, &[1, 0, 0, 0, 1]),
        [1, 1, 0],
        "a read of another"
    );
    stage.end(&write, Ok(Confirmation::Readback));
    assert_eq!(stage.answers().len(), 16);
    stage.send(OVEN, &[5, 0, 60, 0xFF, 0]);
    stage.write();
}

/// [MODBUS §3.5]: function, quantity and value, address.
#[test]
fn bad_requests_are_refused_in_the_order_of_the_standard() {
    let mut stage = Stage::new();
    for (pdu, exception) in [
        (&[0x11][..], 1),
        (&[8, 0, 0, 1, 2], 1),
        (&[1, 0, 60, 0, 0], 3),
        (&[1, 0, 60, 7, 0xD1], 3),
        (&[1, 0, 60, 0], 3),
        (&[1, 0, 60, 0, 1, 0], 3),
        (&[5, 0, 60, 0x55, 0], 3),
        (&[5, 0, 59, 0x55, 0], 3),
        (&[5, 0, 59, 0xFF, 0], 2),
        (&[0x0F, 0, 60, 0, 9, 1, 0], 3),
        (&[0x0F, 0, 60, 0, 9, 2, 0, 0], 2),
        (&[6, 0, 0, 0, 1], 2),
        (&[1, 0xFF, 0xFF, 0, 2], 2),
        (&[4, 0, 64, 0, 9], 2),
        (&[0x0F, 0xFF, 0xFF, 0, 1, 1, 0], 2),
    ] {
        let answer = stage.ask(OVEN, pdu);
        assert_eq!(answer, [pdu[0] | 0x80, exception], "{pdu:02X?}");
    }
    assert_eq!(stage.conn.writes, []);
    for (unit, exception) in [(0, 1), (9, 0x0A), (255, 1)] {
        assert_eq!(stage.ask(unit, &[1, 0, 0, 0, 1]), [0x81, exception]);
    }
}

#[test]
fn a_unit_says_what_it_is() {
    let mut stage = Stage::new();
    let texts = |answer: &[u8]| {
        let said = railbus_wire::rtu::Identification::from_packed(&answer[2..]).unwrap();
        let objects = said.objects();
        objects
            .map(|(number, text)| format!("{number} {}", String::from_utf8_lossy(text)))
            .collect::<Vec<_>>()
    };
    let version = format!("2 {}", env!("CARGO_PKG_VERSION"));
    let answer = stage.ask(OVEN, &[0x2B, 0x0E, 2, 0]);
    assert_eq!(texts(&answer), ["0 railbus", "1 ERC-8", &version, "4 oven"]);
    let answer = stage.ask(255, &[0x2B, 0x0E, 1, 0]);
    assert_eq!(texts(&answer), ["0 railbus", "1 railbus", &version]);
    let answer = stage.ask(OVEN, &[0x2B, 0x0E, 4, 1]);
    assert_eq!(texts(&answer), ["1 ERC-8"]);
    let answer = stage.ask(255, &[0x2B, 0x0E, 2, 4]);
    assert_eq!(texts(&answer), ["4 my plant"]);
    // [BEYOND §5]: one that does not exist is the first.
    let answer = stage.ask(255, &[0x2B, 0x0E, 1, 0x80]);
    assert_eq!(texts(&answer).len(), 3);
    assert_eq!(stage.ask(OVEN, &[0x2B, 0x0E, 4, 3]), [0xAB, 2]);
    assert_eq!(stage.ask(OVEN, &[0x2B, 0x0E, 5, 0]), [0xAB, 3]);
    assert_eq!(stage.ask(OVEN, &[0x2B, 0x0D, 0, 0]), [0xAB, 1]);
}

#[test]
fn bytes_may_come_in_any_pieces_and_nonsense_ends_the_connection() {
    let mut stage = Stage::new();
    let message = [0, 9, 0, 0, 0, 6, OVEN, 1, 0, 60, 0, 8];
    let both = [message, message].concat();
    for cut in 0..both.len() {
        stage.conn.received.extend_from_slice(&both[..cut]);
        let done = stage.with(|conn, units| conn.answer(units)).unwrap();
        assert_eq!(done, cut / message.len(), "{cut}");
        assert_eq!(stage.conn.is_partial(), cut % message.len() > 0);
        stage.conn.received.extend_from_slice(&both[cut..]);
        stage.with(|conn, units| conn.answer(units)).unwrap();
        assert_eq!(stage.answers(), vec![(9, vec![1, 1, 0]); 2], "{cut}");
    }
    stage.conn.received.extend_from_slice(&message);
    stage.conn.received.extend_from_slice(b"GET / HTTP/1.1\r\n");
    assert!(stage.with(|conn, units| conn.answer(units)).is_err());
    assert_eq!(stage.answers().len(), 1, "what came before is answered");
}

/// Another client's command to the unit is the last one, whichever ends first.
#[test]
fn the_last_command_is_the_one_that_began_last() {
    let mut stage = Stage::new();
    stage.send(OVEN, &[5, 0, 60, 0xFF, 0]);
    let first = stage.write();
    let mut other = std::mem::take(&mut stage.conn);
    stage.send(OVEN, &[5, 0, 61, 0xFF, 0]);
    let second = stage.write();
    std::mem::swap(&mut other, &mut stage.conn);
    stage.end(&first, no_reply());
    std::mem::swap(&mut other, &mut stage.conn);
    let last = stage.images[&OVEN].last;
    assert_eq!((last.number, last.end, last.at), (2, LastEnd::UnderWay, 61));
    stage.end(&second, Ok(Confirmation::Readback));
    assert_eq!(stage.images[&OVEN].last.end, LastEnd::Readback);
}
