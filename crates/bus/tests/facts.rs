//! What docs/datasheets require of the host, as far as it concerns the line: one test per fact.
//! Facts about frames and ops are tested with the codecs and the families.

mod support;

use railbus_bus::{
    Bus, Config, Confirmation, EchoMode, Event, Fault, Input, ModuleId, Plan, Terms,
};
use railbus_device::{Bank, Family, Module, Observation, Op, Setup};
use railbus_wire::{Address, Channel, Instant, Micros, Protocol, r55::U24};
use support::{Drive, Happening, millis};

/// A line with one module that answers by a script.
struct Script {
    drive: Drive,
    sent: Vec<(Instant, Vec<u8>)>,
    /// When the last request had left.
    left: Instant,
    events: Vec<(Instant, Event)>,
    /// The replies to the requests, in order: this long after the end of the request, in one piece.
    answers: Vec<Option<(Micros, Vec<u8>)>>,
}

impl Script {
    fn new(setups: &[Setup]) -> Script {
        let mut bus = Bus::new(Config {
            echo: EchoMode::Off,
            settle: Micros::ZERO,
            probation: 0,
            fences: false,
            identify: false,
            ..Config::default()
        });
        for setup in setups {
            let module = Module::new(*setup).expect("a possible module");
            bus.add(module, Plan::NEVER);
        }
        let mut script = Script {
            drive: Drive::new(bus),
            sent: Vec::new(),
            left: Instant(0),
            events: Vec::new(),
            answers: Vec::new(),
        };
        script.drive.input(Input::Opened);
        script.run_for(Micros::from_secs(1));
        script
    }

    /// Appends a reply to the script.
    fn answer(&mut self, after: Micros, bytes: &[u8]) {
        self.answers.push(Some((after, bytes.to_vec())));
    }

    fn answer_none(&mut self) {
        self.answers.push(None);
    }

    fn submit(&mut self, module: usize, op: Op) {
        let now = self.drive.now;
        let taken = self
            .drive
            .bus
            .submit(now, ModuleId(module), op, Terms::default());
        taken.expect("taken");
        self.drive.touched();
    }

    fn run_for(&mut self, span: Micros) {
        let until = self.drive.now + span;
        while let Some(happening) = self.drive.step(until) {
            match happening {
                Happening::Frame {
                    bytes,
                    settings,
                    end,
                } => {
                    self.sent.push((self.drive.now, bytes));
                    self.left = end;
                    if !self.answers.is_empty()
                        && let Some((after, reply)) = self.answers.remove(0)
                    {
                        let heard = end + after + settings.frame_time(reply.len());
                        self.drive.hear_at(heard, &reply);
                    }
                }
                Happening::Heard(_) => {}
                Happening::Told(event) => self.events.push((self.drive.now, event)),
            }
        }
    }

    /// How the only command ended.
    fn end(&self) -> Result<Confirmation, Fault> {
        let mut ends = self.events.iter().filter_map(|(_, event)| match event {
            Event::Done { end, .. } => Some(*end),
            _ => None,
        });
        let end = ends.next().expect("it ended");
        assert!(ends.next().is_none(), "it ended once");
        end
    }

    /// The outputs that were seen last.
    fn outputs(&self) -> u32 {
        let seen = self.events.iter().rev().find_map(|(_, event)| match event {
            Event::Seen {
                seen: Observation::Channels { outputs, .. },
                ..
            } => Some(outputs.on),
            _ => None,
        });
        seen.expect("outputs were read")
    }
}

fn setup(family: Family, protocol: Protocol) -> Setup {
    Setup {
        protocol,
        ..Setup::new(family, Address(1))
    }
}

fn first_on() -> Op {
    Op::Write(Bank::one(Channel::new(0).expect("a channel"), true))
}

/// How long a module that never answered is waited for after a request, not counting wire time.
fn patience(setup: Setup) -> Micros {
    let mut script = Script::new(&[setup]);
    // A write without a second attempt, whose end shows the reply timeout.
    let op = Op::ReadOutputs;
    script.submit(0, op);
    script.run_for(Micros::from_secs(8));
    let module = Module::new(setup).expect("a possible module");
    let exchange = module.exchange(&op).expect("an exchange");
    let done = script
        .events
        .iter()
        .find(|(_, event)| matches!(event, Event::Done { .. }));
    let (at, _) = done.expect("it ended");
    let wire = setup.serial.frame_time(exchange.response_len_max());
    let waited = at.since(script.left);
    // A reply that begins just in time is taken.
    let mut script = Script::new(&[setup]);
    let good = reply(setup);
    script.answer(millis(300), &good);
    script.submit(0, op);
    script.run_for(Micros::from_secs(1));
    assert_eq!(script.end(), Ok(Confirmation::Reply), "{setup:?}");
    waited - wire
}

/// A good reply to reading the outputs of module 1.
fn reply(setup: Setup) -> Vec<u8> {
    match (setup.protocol, setup.family) {
        (Protocol::Rtu, _) => vec![0x01, 0x01, 0x01, 0x01, 0x90, 0x48],
        (Protocol::Ascii, _) => b"!010F00\r".to_vec(),
        (Protocol::Lc02, _) => vec![0x6C, 0x63, 0x01, 0x01, 0x0F, 0x11, 0x0D],
        (Protocol::R55, _) => vec![0x22, 0x01, 0x10, 0x00, 0x00, 0x00, 0x01, 0x34],
    }
}

/// The silence from a foreign character to the next request.
fn gap(setup: Setup) -> Micros {
    let mut script = Script::new(&[setup]);
    script.drive.input(Input::Bytes(&[0xFF]));
    let heard = script.drive.now;
    script.submit(0, Op::ReadOutputs);
    script.run_for(millis(100));
    script.sent[0].0.since(heard)
}

/// [EDA §1.11] At least 5 ms of silence before every ASCII or LC-02 request.
#[test]
fn eda_modules_get_5_ms_of_silence() {
    assert_eq!(gap(setup(Family::Eda9060a, Protocol::Ascii)), millis(5));
    assert_eq!(gap(setup(Family::Eda9050, Protocol::Lc02)), millis(5));
}

/// [ERC-8 §1.6] At least 20 ms of silence before every frame, whichever module the traffic before
/// it was for.
#[test]
fn erc8_gets_20_ms_of_silence() {
    assert_eq!(gap(setup(Family::Erc8, Protocol::Rtu)), millis(20));
}

/// [EMD-2A2Q §1.6] At least 10 ms of silence before every frame.
#[test]
fn emd2a2q_gets_10_ms_of_silence() {
    assert_eq!(gap(setup(Family::Emd2a2q, Protocol::Rtu)), millis(10));
}

/// [R55 §1.9] At least 5 ms of silence before a request, and none between the frames of a chain
/// of no-reply requests.
#[test]
fn r55_gets_5_ms_of_silence_and_none_in_a_chain() {
    let board = setup(Family::R55, Protocol::R55);
    assert_eq!(gap(board), millis(5));
    let mut script = Script::new(&[board]);
    for channel in 0..3 {
        let channel = Channel::new(channel).expect("a channel");
        script.submit(0, Op::WriteSilent(Bank::one(channel, true)));
    }
    script.submit(0, Op::ReadOutputs);
    script.run_for(millis(100));
    let starts: Vec<Instant> = script.sent.iter().map(|(at, _)| *at).collect();
    let frame = board.serial.frame_time(8);
    assert_eq!(starts[1], starts[0] + frame);
    assert_eq!(starts[2], starts[1] + frame);
    assert_eq!(starts[3], starts[2] + frame + millis(5));
}

/// [EDA §1.12] [ERC-8 §1.7] [EMD-2A2Q §1.7] [R55 §3.10] The reply timeout is 300 ms plus the wire
/// time, as long as the module has never answered.
#[test]
fn a_module_that_never_answered_has_300_ms() {
    for (family, protocol) in [
        (Family::Eda9060a, Protocol::Rtu),
        (Family::Eda9060a, Protocol::Ascii),
        (Family::Eda9050, Protocol::Lc02),
        (Family::Erc8, Protocol::Rtu),
        (Family::Emd2a2q, Protocol::Rtu),
        (Family::R55, Protocol::R55),
    ] {
        assert_eq!(patience(setup(family, protocol)), millis(300), "{family}");
    }
}

/// [EDA §1.13] Silence after a valid request to a module that answers otherwise means "refused or
/// lost"; a write that got none may have acted, and its outputs are read before anything is
/// repeated.
#[test]
fn a_write_without_reply_is_read_before_it_is_repeated() {
    for protocol in [Protocol::Ascii, Protocol::Lc02, Protocol::Rtu] {
        let module = setup(Family::Eda9050, protocol);
        let mut script = Script::new(&[module]);
        script.answer(millis(5), &reply(module));
        script.submit(0, Op::ReadOutputs);
        script.run_for(millis(100));
        script.events.clear();
        script.sent.clear();
        // It did act: it is not repeated.
        script.answer_none();
        script.answer(millis(5), &reply(module));
        script.submit(0, first_on());
        script.run_for(Micros::from_secs(3));
        assert_eq!(script.end(), Ok(Confirmation::Readback), "{protocol}");
        assert_eq!(script.sent.len(), 2, "{protocol}: written once, read once");
        // It refused each time: only "no reply" is reported.
        script.events.clear();
        let off = Op::Write(Bank::one(Channel::new(0).expect("a channel"), false));
        for _ in 0..3 {
            script.answer_none();
            script.answer(millis(5), &reply(module));
        }
        script.answer(millis(5), &reply(module));
        script.submit(0, off);
        script.run_for(Micros::from_secs(4));
        let fault = script.end().expect_err("never acknowledged");
        assert_eq!(fault.name(), "no_reply", "{protocol}");
        assert!(fault.may_have_acted());
    }
}

/// [EDA §2.29] [EDA §3.19] Input that arrived before a request is discarded, since `>` and
/// `!OOII00` name no module and an LC-02 reply names no command.
#[test]
fn input_before_a_request_is_discarded() {
    for protocol in [Protocol::Ascii, Protocol::Lc02] {
        let module = setup(Family::Eda9050, protocol);
        let mut script = Script::new(&[module]);
        script.drive.input(Input::Bytes(&reply(module)));
        script.submit(0, Op::ReadOutputs);
        script.run_for(Micros::from_secs(8));
        let fault = script.end().expect_err("nothing answered it");
        assert_eq!(fault.name(), "no_reply", "{protocol}");
        // The same if its first part arrived early: the rest alone is no reply.
        let mut script = Script::new(&[module]);
        let whole = reply(module);
        let (begin, rest) = whole.split_at(4);
        script.drive.input(Input::Bytes(begin));
        script.submit(0, Op::ReadOutputs);
        script.answer(Micros::ZERO, rest);
        script.run_for(Micros::from_secs(8));
        assert!(script.end().is_err(), "{protocol}");
    }
}

/// [EDA §2.3] Replies are accepted with hexadecimal digits of either case.
#[test]
fn replies_may_be_in_lower_case() {
    let mut script = Script::new(&[setup(Family::Eda9050, Protocol::Ascii)]);
    script.answer(millis(5), b"!0a0f00\r");
    script.submit(0, Op::ReadOutputs);
    script.run_for(Micros::from_secs(1));
    assert_eq!(script.outputs(), 0x0A);
}

/// [EDA §4.4] Silence and an exception both count as a possible end of an invalid request.
#[test]
fn an_invalid_modbus_request_ends_by_silence_or_exception() {
    let module = setup(Family::Eda9060a, Protocol::Rtu);
    for (answer, name) in [
        (Some(&[0x01, 0x81, 0x02, 0xC1, 0x91]), "refused"),
        (None, "no_reply"),
    ] {
        let mut script = Script::new(&[module]);
        match answer {
            Some(exception) => script.answer(millis(5), exception),
            None => script.answer_none(),
        }
        script.submit(0, Op::ReadOutputs);
        script.run_for(Micros::from_secs(8));
        assert_eq!(script.end().expect_err("no values came").name(), name);
    }
}

/// [EDA §3.17] A reply is accepted only in the length that the request leads to and from the
/// address asked.
#[test]
fn lc02_replies_of_others_or_of_other_lengths_are_not_taken() {
    for wrong in [
        &[0x6C, 0x63, 0x02, 0x01, 0x0F, 0x12, 0x0D][..],
        &[0x6C, 0x63, 0x01, 0x01, 0x02, 0x0D],
        &[0x6C, 0x63, 0x01, 0x01, 0x0F, 0x00, 0x11, 0x0D],
    ] {
        let mut script = Script::new(&[setup(Family::Eda9050, Protocol::Lc02)]);
        for _ in 0..3 {
            script.answer(millis(5), wrong);
        }
        script.submit(0, Op::ReadOutputs);
        script.run_for(Micros::from_secs(8));
        let fault = script.end().expect_err("no good reply");
        assert_eq!(fault.name(), "garbled", "{wrong:02X?}");
    }
}

/// [R55 §3.8] After 11-16 and 20-22 a missing reply means "unconfirmed": the state is read with 10
/// and compared, and a toggle is never repeated blindly.
#[test]
fn an_unconfirmed_r55_command_is_followed_by_reading_the_state() {
    let board = setup(Family::R55, Protocol::R55);
    let jog = Op::Jog {
        channel: Channel::new(0).expect("a channel"),
        close: true,
        millis: U24::new(500).expect("24 bits"),
    };
    for (op, code, confirmed) in [
        (first_on(), 0x12, true),
        (Op::Toggle(1), 0x20, false),
        (Op::Toggle(3), 0x16, false),
        (jog, 0x21, false),
    ] {
        let mut script = Script::new(&[board]);
        script.answer_none();
        script.answer(millis(5), &reply(board));
        script.submit(0, op);
        script.run_for(Micros::from_secs(5));
        let codes: Vec<u8> = script.sent.iter().map(|(_, frame)| frame[2]).collect();
        assert_eq!(codes, [code, 0x10], "{op:?}");
        assert_eq!(script.outputs(), 1, "the state is known");
        match script.end() {
            Ok(end) => assert!(confirmed && end == Confirmation::Readback, "{op:?}"),
            Err(fault) => {
                assert!(!confirmed, "{op:?}");
                assert_eq!(fault.name(), "no_reply");
                assert!(fault.may_have_acted());
            }
        }
    }
}

/// [EMD-2A2Q §6.7] [ERC-8 §5.5] Exception 08 is a transmission error, and the request may be
/// repeated.
#[test]
fn exception_08_is_repeated() {
    let mut script = Script::new(&[setup(Family::Emd2a2q, Protocol::Rtu)]);
    script.answer(millis(5), &[0x01, 0x81, 0x08, 0x41, 0x96]);
    script.answer(millis(5), &[0x01, 0x01, 0x01, 0x01, 0x90, 0x48]);
    script.submit(0, Op::ReadOutputs);
    script.run_for(Micros::from_secs(1));
    assert_eq!(script.end(), Ok(Confirmation::Reply));
    assert_eq!(script.sent.len(), 2);
}

/// [ERC-8 §5.2] A bare exception of three bytes is no reply where the module's quirk for it is off,
/// as it is by default.
#[test]
fn a_bare_exception_is_no_reply() {
    let mut script = Script::new(&[setup(Family::Erc8, Protocol::Rtu)]);
    for _ in 0..3 {
        script.answer(millis(5), &[0x01, 0x81, 0x02]);
    }
    script.submit(0, Op::ReadOutputs);
    script.run_for(Micros::from_secs(8));
    assert_eq!(script.end().expect_err("no reply").name(), "garbled");
}
