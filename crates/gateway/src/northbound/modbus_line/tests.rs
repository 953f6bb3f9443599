//! The passage, without line, site and sockets.

use super::passage::{
    ClientId, ClientWrite, LineRead, Output, Passage, ReadEnd, Site, WAITING_MAX,
};
use railbus_device::{Point, PointKind};
use railbus_site::{CommandError, Config, Role};
use railbus_wire::mbap::{self, Message};
use railbus_wire::rtu::Exception;
use railbus_wire::{Decoded, Micros};
use std::cell::Cell;
use std::sync::Arc;
use std::time::Duration;

const SITE: &str = r#"
[line.main]
port = "/dev/ttyS9"
[line.far]
port = "/dev/ttyS8"
[module]
oven = { line = "main", model = "erc8", address = 3 }
tank = { line = "main", model = "emd2a2q", address = 5 }
hall = { line = "main", model = "eda9060a", address = 6 }
lamp = { line = "far", model = "erc8", address = 7 }
"#;

const A: ClientId = ClientId(1);
const B: ClientId = ClientId(2);
/// Coil 60, the first of an ERC-8, and others.
const COIL: [u8; 5] = [1, 0, 60, 0, 1];
const COILS: [u8; 5] = [1, 0, 60, 0, 8];
const ON: [u8; 5] = [5, 0, 60, 0xFF, 0];
const IS_ON: [u8; 3] = [1, 1, 1];

struct Stage {
    passage: Passage,
    config: Arc<Config>,
    now: Duration,
    is_online: Cell<Option<bool>>,
    transaction: u16,
}

impl Stage {
    fn new() -> Stage {
        let mut passage = Passage::new("main");
        passage.came(A);
        passage.came(B);
        Stage {
            passage,
            config: Arc::new(Config::parse(SITE).unwrap()),
            now: Duration::ZERO,
            is_online: Cell::new(Some(true)),
            transaction: 0,
        }
    }

    fn with<T>(&mut self, work: impl FnOnce(&mut Passage, &Site<'_>) -> T) -> T {
        let is_online = |_: &str| self.is_online.get();
        let site = Site {
            config: &self.config,
            is_up: true,
            is_online: &is_online,
        };
        work(&mut self.passage, &site)
    }

    /// A client asks; the number of its transaction.
    fn ask(&mut self, client: ClientId, unit: u8, pdu: &[u8]) -> u16 {
        self.transaction += 1;
        let transaction = self.transaction;
        let mut bytes = mbap::header(transaction, 1 + pdu.len()).to_vec();
        bytes.push(unit);
        bytes.extend_from_slice(pdu);
        let Decoded::Whole { value, .. } = Message::decode(&bytes) else {
            panic!("{bytes:?}");
        };
        self.with(|passage, site| passage.request(client, &value, site));
        transaction
    }

    /// What is to be done now, without answers.
    fn poll(&mut self) -> Vec<Output> {
        let now = self.now;
        let mut all = Vec::new();
        while let Some(output) = self.with(|passage, site| passage.poll(now, site)) {
            all.push(output);
        }
        all.retain(|output| !matches!(output, Output::Answered(_)));
        all
    }

    /// The read that is to be sent, and nothing else.
    fn read(&mut self) -> LineRead {
        let mut all = self.poll();
        match (all.pop(), all.pop()) {
            (Some(Output::Read(read)), None) => read,
            other => panic!("{other:?}"),
        }
    }

    fn write(&mut self) -> ClientWrite {
        let mut all = self.poll();
        match (all.pop(), all.pop()) {
            (Some(Output::Write(write)), None) => write,
            other => panic!("{other:?}"),
        }
    }

    /// The read under way is answered after 5 ms, or not until its time is up.
    fn end(&mut self, read: &LineRead, answer: Option<&[u8]>) {
        let took = Micros::from_millis(5);
        let end = match answer {
            Some(pdu) => ReadEnd::Answered(pdu.to_vec(), took),
            None => ReadEnd::Silent,
        };
        let took = answer.map_or(read.timeout, |_| took);
        self.now += Duration::from_micros(took.0);
        self.passage.read_ended(self.now, &end);
    }

    /// What a client was answered: transaction, unit, and what follows.
    fn answers(&mut self, client: ClientId) -> Vec<(u16, u8, Vec<u8>)> {
        let bytes = self.passage.take_answers(client);
        let (mut rest, mut all) = (&bytes[..], Vec::new());
        while let Decoded::Whole { len, value } = Message::decode(rest) {
            all.push((value.transaction, value.unit.0, value.pdu.to_vec()));
            rest = &rest[len..];
        }
        assert_eq!(rest, [0; 0]);
        all
    }

    /// What is answered at once.
    fn at_once(&mut self, unit: u8, pdu: &[u8]) -> Vec<u8> {
        let transaction = self.ask(A, unit, pdu);
        assert_eq!(self.poll(), [], "unit {unit}, {pdu:?}");
        let mut answers = self.answers(A);
        let (to, of, answer) = answers.pop().unwrap();
        assert_eq!((to, of, answers), (transaction, unit, Vec::new()));
        answer
    }
}

fn output(index: u8) -> Point {
    Point {
        kind: PointKind::Output,
        index,
    }
}

#[test]
fn a_read_goes_to_the_line_and_its_answer_back() {
    let mut stage = Stage::new();
    let transaction = stage.ask(A, 3, &COIL);
    let read = stage.read();
    assert_eq!((read.unit, read.exchange.address().0), (3, 3));
    assert_eq!(stage.poll(), [], "one at a time");
    stage.end(&read, Some(&IS_ON));
    let answer = (transaction, 3, IS_ON.to_vec());
    assert_eq!(stage.answers(A), [answer]);
    // A module that is not configured, and its own exception.
    let transaction = stage.ask(B, 200, &[4, 0, 0, 0, 2]);
    let read = stage.read();
    stage.end(&read, Some(&[0x84, 2]));
    assert_eq!(stage.answers(B), [(transaction, 200, vec![0x84, 2])]);
    assert_eq!(stage.passage.answered.good, 1);
    assert_eq!(stage.passage.answered.refused, 1);
}

#[test]
fn what_changes_more_than_outputs_never_passes() {
    let mut stage = Stage::new();
    for (unit, pdu, why) in [
        // Registers of settings, and all modules at once.
        (3, &[6, 0, 4, 0, 1][..], 1),
        (3, &[0x10, 0, 4, 0, 1, 2, 0, 1], 1),
        (3, &[0x10, 0, 4, 0, 3, 6, 0, 1, 0, 1, 0, 1], 1),
        (0, &ON, 1),
        (0, &COIL, 1),
        (3, &[8, 0, 4, 0, 0], 1),
        (3, &[8, 0, 1, 0, 0], 1),
        // Coils that are no outputs, all or some.
        (3, &[5, 0, 59, 0xFF, 0], 1),
        (3, &[5, 0, 68, 0xFF, 0], 1),
        (3, &[0x0F, 0, 66, 0, 3, 1, 7], 1),
        (3, &[0x0F, 0, 0, 0, 61, 8, 0, 0, 0, 0, 0, 0, 0, 0], 1),
        // A module that is not configured, another protocol, another line.
        (4, &ON, 1),
        (6, &[5, 0, 0, 0xFF, 0], 1),
        (7, &ON, 1),
        // Functions that are not known, and requests that are none.
        (3, &[0x11], 1),
        (3, &[0x17, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 0], 1),
        (3, &[0x41, 0], 1),
        (3, &[5, 0, 60, 0x55, 0], 3),
        (3, &[1, 0, 60, 0, 0], 3),
        (3, &[1, 0xFF, 0xFF, 0, 2], 2),
        (3, &[1, 0, 60], 3),
        // No address of a module, and the gateway itself.
        (248, &COIL, 10),
        (254, &ON, 10),
        (255, &COIL, 1),
        (255, &ON, 1),
    ] {
        let answer = stage.at_once(unit, pdu);
        assert_eq!(answer, [pdu[0] | 0x80, why], "unit {unit}, {pdu:?}");
    }
    let name = stage.at_once(255, &[0x2B, 0x0E, 2, 0]);
    let name = String::from_utf8_lossy(&name).into_owned();
    assert!(name.contains("railbus") && name.contains("main"), "{name}");
}

#[test]
fn a_write_of_outputs_is_a_command() {
    let mut stage = Stage::new();
    let one = stage.ask(A, 3, &[5, 0, 61, 0xFF, 0]);
    let write = stage.write();
    assert_eq!(&*write.write.module, "oven");
    assert_eq!(write.write.set, [(output(1), true)]);
    stage.passage.write_ended(&write, Ok(()));
    assert_eq!(stage.answers(A), [(one, 3, vec![5, 0, 61, 0xFF, 0])]);
    let two = stage.ask(A, 5, &[0x0F, 0, 8, 0, 2, 1, 0b10]);
    let write = stage.write();
    assert_eq!(write.write.set, [(output(0), false), (output(1), true)]);
    stage.passage.write_ended(&write, Ok(()));
    assert_eq!(stage.answers(A), [(two, 5, vec![0x0F, 0, 8, 0, 2])]);
}

#[test]
fn a_command_that_was_not_done_is_never_told_as_done() {
    let mut stage = Stage::new();
    let (role, need) = (Role::Viewer, Role::Operator);
    let point = output(0);
    let no_reply = railbus_host::Fault::NoReply(railbus_host::Evidence::default());
    for (failure, why) in [
        (CommandError::RoleTooLow { role, need }, 1),
        (CommandError::Locked(point), 1),
        (CommandError::Confirm(point), 4),
        (CommandError::Lent, 10),
        (CommandError::Line(railbus_host::Fault::Closed), 10),
        (CommandError::Line(no_reply), 11),
        (CommandError::Line(railbus_host::Fault::Expired), 6),
    ] {
        let transaction = stage.ask(A, 3, &ON);
        let write = stage.write();
        stage.passage.write_ended(&write, Err(&failure));
        assert_eq!(
            stage.answers(A),
            [(transaction, 3, vec![0x85, why])],
            "{failure}"
        );
    }
}

#[test]
fn equal_reads_are_one() {
    let mut stage = Stage::new();
    let early = stage.ask(B, 5, &[3, 0, 6, 0, 2]);
    let read = stage.read();
    let first = stage.ask(A, 3, &COIL);
    let second = stage.ask(B, 3, &COIL);
    let third = stage.ask(A, 3, &COIL);
    let other = stage.ask(B, 3, &COILS);
    let volts = [3, 4, 0, 1, 0, 2];
    stage.end(&read, Some(&volts));
    assert_eq!(stage.answers(B), [(early, 5, volts.to_vec())]);
    let read = stage.read();
    stage.end(&read, Some(&IS_ON));
    let answer = |transaction| (transaction, 3, IS_ON.to_vec());
    assert_eq!(stage.answers(A), [answer(first), answer(third)]);
    assert_eq!(stage.answers(B), [answer(second)]);
    let read = stage.read();
    stage.end(&read, Some(&[1, 1, 255]));
    assert_eq!(stage.answers(B), [(other, 3, vec![1, 1, 255])]);
    assert_eq!(stage.poll(), []);
}

/// Whatever happened since one was sent, by whomever, it may not show it.
#[test]
fn a_read_is_not_one_that_was_sent_before() {
    let mut stage = Stage::new();
    let first = stage.ask(A, 3, &COIL);
    let before = stage.read();
    let second = stage.ask(B, 3, &COIL);
    stage.end(&before, Some(&[1, 1, 0]));
    assert_eq!(stage.answers(A), [(first, 3, vec![1, 1, 0])]);
    assert_eq!(stage.answers(B), []);
    let read = stage.read();
    stage.end(&read, Some(&IS_ON));
    assert_eq!(stage.answers(B), [(second, 3, IS_ON.to_vec())]);
}

/// A read that was sent before a write ended does not show its effect.
#[test]
fn a_read_after_a_write_is_not_one_from_before() {
    let mut stage = Stage::new();
    stage.ask(B, 3, &COIL);
    let before = stage.read();
    stage.ask(A, 3, &ON);
    let after = stage.ask(A, 3, &COIL);
    let write = stage.write();
    stage.passage.write_ended(&write, Ok(()));
    stage.answers(A);
    stage.end(&before, Some(&[1, 1, 0]));
    assert_eq!(stage.answers(A), []);
    let read = stage.read();
    stage.end(&read, Some(&IS_ON));
    assert_eq!(stage.answers(A), [(after, 3, IS_ON.to_vec())]);
}

#[test]
fn requests_to_a_unit_keep_their_order_around_a_write() {
    let mut stage = Stage::new();
    let first = stage.ask(A, 3, &COIL);
    let write = stage.ask(A, 3, &ON);
    let refused = stage.ask(A, 3, &[6, 0, 4, 0, 1]);
    let last = stage.ask(A, 3, &COIL);
    let other = stage.ask(A, 5, &[3, 0, 6, 0, 2]);
    let read = stage.read();
    stage.end(&read, Some(&[1, 1, 0]));
    // The other unit's read and the write; nothing behind the write.
    let both = stage.poll();
    let [Output::Write(begun), Output::Read(read)] = &both[..] else {
        panic!("{both:?}");
    };
    stage.end(read, Some(&[3, 4, 0, 1, 0, 2]));
    assert_eq!(stage.poll(), []);
    stage.passage.write_ended(begun, Ok(()));
    let read = stage.read();
    stage.end(&read, Some(&IS_ON));
    let order: Vec<u16> = stage.answers(A).into_iter().map(|(one, ..)| one).collect();
    assert_eq!(order, [first, other, write, refused, last]);
}

#[test]
fn clients_take_turns() {
    let mut stage = Stage::new();
    for at in 0..8 {
        stage.ask(A, 3, &[1, 0, at, 0, 1]);
    }
    let read = stage.read();
    stage.ask(B, 5, &[3, 0, 6, 0, 1]);
    stage.ask(B, 5, &[3, 0, 7, 0, 1]);
    stage.end(&read, Some(&IS_ON));
    let mut units = Vec::new();
    for _ in 0..4 {
        let read = stage.read();
        units.push(read.unit);
        stage.end(&read, Some(&IS_ON));
    }
    assert_eq!(units, [5, 3, 5, 3]);
}

#[test]
fn no_more_than_sixteen_wait() {
    let mut stage = Stage::new();
    let mut asked = Vec::new();
    for at in 0..WAITING_MAX as u8 {
        asked.push(stage.ask(A, 3, &[1, 0, at, 0, 1]));
    }
    assert_eq!(stage.answers(A), []);
    let more = stage.ask(A, 3, &COIL);
    assert_eq!(stage.answers(A), [(more, 3, vec![0x81, 6])]);
    let of_another = stage.ask(B, 3, &COILS);
    while let Some(Output::Read(read)) = stage.poll().pop() {
        stage.end(&read, Some(&IS_ON));
    }
    let told: Vec<u16> = stage.answers(A).into_iter().map(|(one, ..)| one).collect();
    assert_eq!(told, asked);
    assert_eq!(stage.answers(B).len(), 1, "{of_another}");
}

#[test]
fn who_has_gone_is_not_asked_for() {
    let mut stage = Stage::new();
    stage.ask(A, 3, &COIL);
    let read = stage.read();
    stage.ask(A, 3, &COILS);
    stage.ask(B, 3, &COILS);
    stage.ask(A, 4, &COILS);
    stage.passage.gone(A);
    stage.end(&read, Some(&IS_ON));
    let read = stage.read();
    stage.end(&read, Some(&IS_ON));
    assert_eq!(stage.poll(), []);
    assert_eq!(stage.answers(B).len(), 1);
    assert_eq!(stage.answers(A), []);
}

/// One client asks a unit that does not answer, as fast as it can, and another one that does: the
/// line is for the other one nearly all of the time.
#[test]
fn a_dead_unit_costs_others_little() {
    let mut stage = Stage::new();
    stage.ask(A, 4, &COIL);
    stage.ask(B, 3, &COIL);
    let (mut dead, mut live, mut spent) = (0, 0, Duration::ZERO);
    while stage.now < Duration::from_secs(60) {
        let begun = stage.now;
        match stage.poll().pop() {
            Some(Output::Read(read)) if read.unit == 4 => {
                stage.end(&read, None);
                spent += stage.now - begun;
            }
            Some(Output::Read(read)) => stage.end(&read, Some(&IS_ON)),
            _ => stage.now += Duration::from_millis(1),
        }
        for (_, unit, answer) in stage.answers(A) {
            assert_eq!((unit, &answer[..]), (4, &[0x81, 11][..]));
            dead += 1;
            stage.ask(A, 4, &COIL);
        }
        for (_, unit, answer) in stage.answers(B) {
            assert_eq!((unit, &answer[..]), (3, &IS_ON[..]));
            live += 1;
            stage.ask(B, 3, &COIL);
        }
    }
    assert!(dead > 1_000 && live > 10_000, "{dead} {live}");
    assert!(spent < Duration::from_secs(2), "{spent:?}");
}

/// A module that the site does not hear is not asked, though it never failed to answer here.
#[test]
fn a_module_that_is_not_heard_takes_no_time_of_the_line() {
    let mut stage = Stage::new();
    stage.is_online.set(Some(false));
    assert_eq!(stage.at_once(3, &COIL), [0x81, 11]);
    stage.is_online.set(Some(true));
    stage.ask(A, 3, &COIL);
    assert_eq!(stage.read().unit, 3);
}

/// After one lost reply the unit is asked again before exception 0B is answered.
#[test]
fn after_one_silence_a_unit_is_asked_again() {
    let mut stage = Stage::new();
    stage.ask(A, 3, &COIL);
    let read = stage.read();
    stage.end(&read, None);
    assert_eq!(
        stage.answers(A).len(),
        1,
        "it was asked, and did not answer"
    );
    let again = stage.ask(A, 3, &COIL);
    assert_eq!(stage.poll(), [], "its reply may still come");
    stage.now = stage.passage.deadline().unwrap();
    let read = stage.read();
    assert_eq!(stage.passage.deadline(), None);
    stage.end(&read, Some(&IS_ON));
    assert_eq!(stage.answers(A), [(again, 3, IS_ON.to_vec())]);
}

#[test]
fn a_line_that_is_not_there_is_said_at_once() {
    let mut stage = Stage::new();
    for unit in [3, 4] {
        let transaction = stage.ask(A, unit, &COIL);
        stage.read();
        let end = ReadEnd::NotAsked(Exception::PATH);
        stage.passage.read_ended(stage.now, &end);
        assert_eq!(stage.answers(A), [(transaction, unit, vec![0x81, 10])]);
    }
    stage.ask(A, 3, &COIL);
    let read = stage.read();
    stage.end(&read, Some(&IS_ON));
}
