//! Edges of the line's rules, each at its exact moment: just in time and just too late.

mod support;

use railbus_bus::{
    Bus, Config, Confirmation, EchoMode, Event, Evidence, Fault, Input, ModuleId, Plan, Presence,
    Probe, Terms,
};
use railbus_device::{Bank, Family, Module, Op, Refusal, SettingWrite, Setup};
use railbus_wire::{
    Address, Channel, Exchange, Instant, Malformed, Micros, Protocol, PulseWidth, SerialSettings,
    ascii, crc16, r55::U24,
};
use support::{Drive, Happening, millis};

/// A line whose modules are addressed by commands only, and what was sent on it.
struct Line {
    drive: Drive,
    frames: Vec<Vec<u8>>,
    told: Vec<(Instant, Event)>,
}

impl Line {
    fn new(echo: EchoMode, setups: &[Setup]) -> Line {
        let config = Config {
            echo,
            settle: Micros::ZERO,
            probation: 0,
            fences: false,
            identify: false,
            ..Config::default()
        };
        Line::of(config, setups)
    }

    fn of(config: Config, setups: &[Setup]) -> Line {
        let mut bus = Bus::new(config);
        for setup in setups {
            bus.add(Module::new(*setup).expect("a possible module"), Plan::NEVER);
        }
        let mut line = Line {
            drive: Drive::new(bus),
            frames: Vec::new(),
            told: Vec::new(),
        };
        line.drive.input(Input::Opened);
        line.run(millis(1000), |_| None);
        line
    }

    fn submit(&mut self, op: Op) {
        self.submit_to(0, op);
    }

    fn submit_to(&mut self, module: usize, op: Op) {
        let now = self.drive.now;
        let taken = self
            .drive
            .bus
            .submit(now, ModuleId(module), op, Terms::default());
        taken.expect("taken");
        self.drive.touched();
    }

    /// Runs for a time; `answer` returns the reply to a frame, which comes 5 ms after it.
    fn run(&mut self, time: Micros, answer: impl Fn(&[u8]) -> Option<Vec<u8>>) {
        let until = self.drive.now + time;
        while let Some(happening) = self.drive.step(until) {
            match happening {
                Happening::Frame {
                    bytes,
                    settings,
                    end,
                } => {
                    if let Some(reply) = answer(&bytes) {
                        let heard = end + millis(5) + settings.frame_time(reply.len());
                        self.drive.hear_at(heard, &reply);
                    }
                    self.frames.push(bytes);
                }
                Happening::Told(event) => self.told.push((self.drive.now, event)),
                Happening::Heard(_) => {}
            }
        }
    }

    /// How commands ended, and how long they took.
    fn ends(&self) -> Vec<(Result<Confirmation, Fault>, Micros)> {
        let done = |(_, event): &(Instant, Event)| match event {
            Event::Done { end, took, .. } => Some((*end, *took)),
            _ => None,
        };
        self.told.iter().filter_map(done).collect()
    }

    fn told_at(&self, wanted: Event) -> Vec<Instant> {
        let same = self.told.iter().filter(|(_, event)| *event == wanted);
        same.map(|(at, _)| *at).collect()
    }
}

fn board() -> Setup {
    Setup {
        outputs: 8,
        ..Setup::new(Family::R55, Address(4))
    }
}

fn jog() -> Op {
    Op::Jog {
        channel: Channel::new(0).expect("it exists"),
        close: true,
        millis: U24::new(500).expect("it fits"),
    }
}

fn eda() -> Setup {
    Setup {
        protocol: Protocol::Rtu,
        ..Setup::new(Family::Eda9060a, Address(1))
    }
}

/// Any 0x55 request is answered with its own function and all outputs off.
fn as_a_board(frame: &[u8]) -> Option<Vec<u8>> {
    let mut reply = vec![0x22, frame[1], frame[2], 0, 0, 0, 0];
    reply.push(
        reply
            .iter()
            .fold(0, |sum: u8, byte| sum.wrapping_add(*byte)),
    );
    Some(reply)
}

/// An EDA module's reply with all outputs off.
fn all_off(address: u8) -> Vec<u8> {
    let mut reply = vec![address, 1, 1, 0];
    reply.extend(crc16(&reply).to_le_bytes());
    reply
}

#[test]
fn a_line_says_what_it_knows_of_itself() {
    for (echo, echoes) in [(EchoMode::On, Some(true)), (EchoMode::Off, Some(false))] {
        assert_eq!(Line::new(echo, &[board()]).drive.bus.echoes(), echoes);
    }
    let mut line = Line::new(EchoMode::Auto, &[board()]);
    let bus = &line.drive.bus;
    assert_eq!(bus.echoes(), None);
    assert_eq!(bus.presence(ModuleId(0)), Presence::Unheard);
    assert_eq!(
        bus.module(ModuleId(0)).map(|module| *module.setup()),
        Some(board())
    );
    assert!(bus.module(ModuleId(1)).is_none());
    line.submit(Op::ReadOutputs);
    line.run(millis(100), as_a_board);
    assert_eq!(line.drive.bus.presence(ModuleId(0)), Presence::Online);
    assert_eq!(line.drive.bus.echoes(), Some(false));
    line.drive.hear_at(line.drive.now + millis(1), b"noise");
    line.run(millis(10), as_a_board);
    assert_eq!(line.drive.bus.heard(), b"noise");
}

/// Silence after the first read proves that there is no echo; anything else proves nothing.
#[test]
fn silence_proves_that_nothing_echoes() {
    let mut silent = Line::new(EchoMode::Auto, &[board()]);
    silent.submit(Op::ReadOutputs);
    silent.run(millis(400), |_| None);
    assert_eq!(silent.drive.bus.echoes(), Some(false));

    let mut noisy = Line::new(EchoMode::Auto, &[board()]);
    noisy.submit(Op::ReadOutputs);
    noisy.run(millis(400), |_| Some(vec![0x00, 0xFF]));
    assert_eq!(noisy.drive.bus.echoes(), None);
}

/// Toggles and jogs of one output wait until the one before has been read back.
#[test]
fn commands_for_one_output_wait_for_each_other() {
    for (op, code) in [(Op::Toggle(1), 0x20), (jog(), 0x21)] {
        let mut line = Line::new(EchoMode::Off, &[board()]);
        line.submit(op);
        line.submit(op);
        line.run(millis(1000), as_a_board);
        let codes: Vec<u8> = line.frames.iter().map(|frame| frame[2]).collect();
        assert_eq!(codes, [code, 0x10, code, 0x10], "{op:?}");
    }
}

/// As above where the first one's read-back is lost and has to wait for its ghost.
#[test]
fn commands_for_one_output_wait_for_a_read_back_that_is_lost() {
    for (op, code) in [(Op::Toggle(1), 0x20), (jog(), 0x21)] {
        let mut line = Line::new(EchoMode::Off, &[board()]);
        line.submit(op);
        line.submit(op);
        line.run(millis(200), |frame| {
            (frame[2] == code).then(|| as_a_board(frame)).flatten()
        });
        line.run(millis(1000), as_a_board);
        let codes: Vec<u8> = line.frames.iter().map(|frame| frame[2]).collect();
        assert_eq!(codes, [code, 0x10, 0x10, code, 0x10], "{op:?}");
    }
}

/// An abandoned request is a ghost until no reply to it can come; an answered one is none, though
/// its reply may come again.
#[test]
fn a_request_that_was_given_up_haunts_the_line() {
    let mut line = Line::new(EchoMode::Off, &[board()]);
    assert_eq!(line.drive.bus.late_replies_until(), None);
    let left = line.drive.now + SerialSettings::FACTORY.frame_time(8);
    line.submit(Op::Toggle(1));
    line.run(millis(50), |_| None);
    // It is not yet known whether it will be answered.
    assert_eq!(
        line.drive.bus.late_replies_until(),
        Some(left + millis(500))
    );
    line.run(millis(280), |frame| {
        (frame[2] != 0x20).then(|| as_a_board(frame)).flatten()
    });
    // Three times the 300 ms of the reply timeout for a module that never answered.
    assert_eq!(
        line.drive.bus.late_replies_until(),
        Some(left + millis(900))
    );
    line.drive
        .hear_at(line.drive.now, b"\x22\x04\x20\0\0\0\0\x46");
    line.run(millis(10), |_| None);
    assert_eq!(line.drive.bus.late_replies_until(), None, "its reply came");

    let mut cautious = Line::of(Config::default(), &[board()]);
    cautious.submit(Op::ReadOutputs);
    cautious.run(millis(60), as_a_board);
    assert_eq!(cautious.ends().len(), 1);
    assert_eq!(cautious.drive.bus.late_replies_until(), None);
}

/// Once a fence is answered, no older reply can come to this line. The next user of the port can't
/// rely on that order: to it the request is a ghost for as long as one of an unknown module.
#[test]
fn what_a_fence_has_ended_haunts_the_next_user_of_the_port() {
    let config = Config {
        echo: EchoMode::Off,
        settle: Micros::ZERO,
        probation: 0,
        ..Config::default()
    };
    let mut line = Line::of(config, &[board()]);
    line.submit(Op::ReadOutputs);
    line.run(millis(100), as_a_board);
    let left = line.drive.now + SerialSettings::FACTORY.frame_time(8);
    line.submit(Op::ReadOutputs);
    line.frames.clear();
    line.run(millis(30), |_| None);
    line.run(millis(170), as_a_board);
    let codes: Vec<u8> = line.frames.iter().map(|frame| frame[2]).collect();
    assert_eq!(codes, [0x10, 0x40, 0x10], "asked, fenced, and asked again");
    assert_eq!(line.ends().len(), 2);
    assert_eq!(
        line.drive.bus.late_replies_until(),
        Some(left + millis(900))
    );
}

/// A module's address is not changed while an earlier command for it waits for a ghost: the command
/// would then be sent to an address without a module.
#[test]
fn a_change_of_settings_waits_for_earlier_commands() {
    let mut line = Line::new(EchoMode::Off, &[Setup::new(Family::Erc8, Address(1))]);
    let first = Channel::new(0).expect("it exists");
    line.submit(Op::Write(Bank::one(first, true)));
    line.submit(Op::Configure(SettingWrite::Address(Address(2))));
    // The write's reply is lost, the relay reads off, so it is repeated after its ghost.
    line.run(millis(2000), |frame| (frame[1] == 1).then(|| all_off(1)));
    let codes: Vec<u8> = line.frames.iter().map(|frame| frame[1]).collect();
    let readdressed = codes
        .iter()
        .position(|code| *code == 6)
        .expect("it was sent");
    let rewritten = codes
        .iter()
        .rposition(|code| *code == 5)
        .expect("it was sent");
    assert!(readdressed > rewritten && rewritten > 0, "{codes:?}");
}

/// Babble is reported once it has lasted for more than half a second without a silence of more than
/// 50 ms, once, and it ends with the silence before the next request.
#[test]
fn a_babble_is_named_and_ends() {
    let chatter = |line: &mut Line, from: u64, to: u64, step: u64| {
        let start = line.drive.now;
        for at in (from..=to).step_by(step as usize) {
            line.drive.hear_at(start + millis(at), &[0xA5]);
        }
        line.run(millis(to + 200), |_| None);
        start
    };
    let mut line = Line::new(EchoMode::Off, &[board()]);
    let start = chatter(&mut line, 100, 1100, 10);
    assert_eq!(line.told_at(Event::Babble), [start + millis(100 + 510)]);
    line.submit(Op::ReadOutputs);
    line.run(millis(100), as_a_board);
    assert_eq!(line.told_at(Event::Quiet).len(), 1);

    let mut at_the_edge = Line::new(EchoMode::Off, &[board()]);
    chatter(&mut at_the_edge, 100, 600, 10);
    assert!(
        at_the_edge.told_at(Event::Babble).is_empty(),
        "500 ms are no babble yet"
    );

    let mut just_joined = Line::new(EchoMode::Off, &[board()]);
    chatter(&mut just_joined, 100, 1100, 50);
    assert_eq!(
        just_joined.told_at(Event::Babble).len(),
        1,
        "50 ms are no silence yet"
    );

    let mut with_silences = Line::new(EchoMode::Off, &[board()]);
    chatter(&mut with_silences, 100, 1100, 51);
    assert!(with_silences.told_at(Event::Babble).is_empty());
}

/// Babble that leaves room for a request now and then is reported as well, whatever its bytes, and
/// so is babble that drowns the replies; a good reply or a silence ends it.
#[test]
fn a_babble_that_leaves_room_for_requests_is_named() {
    let noise = vec![0xA5, 0x5A, 0x00];
    let foreign = all_off(9);
    for said in [noise, foreign] {
        for step in [8, 10, 14, 20, 30, 45] {
            let mut line = Line::new(EchoMode::Off, &[eda()]);
            let start = line.drive.now;
            for at in (0..4_000).step_by(step) {
                line.drive.hear_at(start + millis(at), &said);
            }
            for _ in 0..8 {
                line.submit(Op::ReadOutputs);
                line.run(millis(500), |_| None);
            }
            let named = line.told_at(Event::Babble);
            assert_eq!(named.len(), 1, "every {step} ms: {named:?}");
            assert!(named[0] < start + millis(2_000), "{named:?}");
            assert!(line.told_at(Event::Quiet).is_empty());
            line.submit(Op::ReadOutputs);
            line.run(millis(2_000), |_| Some(all_off(1)));
            assert_eq!(line.told_at(Event::Quiet).len(), 1);
        }
    }
}

/// A module whose every reply is garbled, polled without a pause, is no babble.
#[test]
fn spoilt_replies_are_no_babble() {
    let mut line = Line::new(EchoMode::Off, &[eda(), board()]);
    for _ in 0..10 {
        line.submit_to(0, Op::ReadOutputs);
        line.submit_to(1, Op::ReadOutputs);
        line.run(millis(2_000), |_| Some(vec![0xA5; 5]));
    }
    assert!(line.told_at(Event::Babble).is_empty());
}

/// Overheard bytes are kept, up to 300 without a silence; one more clears the buffer.
#[test]
fn three_hundred_bytes_are_kept_of_what_is_overheard() {
    let mut line = Line::new(EchoMode::Off, &[board()]);
    let start = line.drive.now;
    for (at, count, kept) in [(10, 150, 150), (20, 150, 300), (30, 1, 1)] {
        line.drive.hear_at(start + millis(at), &vec![0xA5; count]);
        line.run(millis(10), |_| None);
        assert_eq!(line.drive.bus.heard().len(), kept, "after {at} ms");
    }
}

/// Where an echo is known and does not come, silence is no reply, and other bytes are one only if
/// they are valid and can't be the echo itself.
#[test]
fn without_its_echo_a_reply_counts_only_where_it_is_none_itself() {
    let end_after = |answer: &dyn Fn(&[u8]) -> Option<Vec<u8>>| {
        let mut line = Line::new(EchoMode::On, &[board()]);
        line.submit(Op::ReadOutputs);
        line.run(Micros::from_secs(3), answer);
        let ends = line.ends();
        ends.first().expect("it ended").0
    };
    let lost = |garbled, bytes, why| Evidence {
        attempts: 3,
        garbled,
        bytes,
        why,
    };
    assert_eq!(end_after(&|_| None), Err(Fault::NoReply(lost(0, 0, None))));
    let garbled = Fault::Garbled(lost(3, 24, Some(Malformed::Start)));
    assert_eq!(end_after(&|_| Some(vec![0x22; 8])), Err(garbled));
    assert_eq!(end_after(&as_a_board), Ok(Confirmation::Reply));

    let mut line = Line::new(EchoMode::On, &[eda()]);
    line.submit(Op::Write(Bank::new(1, 1)));
    line.run(Micros::from_secs(5), |frame| {
        (frame[1] == 5).then(|| frame.to_vec())
    });
    let (end, _) = line.ends()[0];
    assert!(matches!(end, Err(Fault::NoReply(_))), "{end:?}");
}

/// The reply timeout forgets a slow turnaround with the second thousand of quick ones after it.
#[test]
fn a_slow_reply_is_forgotten_with_the_second_thousand_of_quick_ones() {
    let mut line = Line::new(EchoMode::Off, &[eda()]);
    let frame_time = |bytes| SerialSettings::FACTORY.frame_time(bytes);
    // 11 characters out, 8 back, to a command that is not sent twice.
    let set_pulse = Op::Configure(SettingWrite::Pulse {
        mask: 0,
        width: PulseWidth::DEFAULT,
    });
    let waits = |line: &mut Line| {
        line.submit(set_pulse);
        line.run(Micros::from_secs(2), |_| None);
        let (end, took) = line.ends().pop().expect("it ended");
        assert!(matches!(end, Err(Fault::NoReply(_))), "{end:?}");
        took - frame_time(11) - frame_time(8)
    };
    let quick = |line: &mut Line, times: usize| {
        for _ in 0..times {
            line.submit(Op::ReadOutputs);
            line.run(millis(50), |_| Some(all_off(1)));
        }
    };
    line.submit(Op::ReadOutputs);
    let left = line.drive.now + frame_time(8);
    line.drive
        .hear_at(left + millis(100) + frame_time(6), &all_off(1));
    line.run(millis(400), |_| None);
    assert_eq!(waits(&mut line), millis(200), "twice the slowest");
    quick(&mut line, 1998);
    assert_eq!(
        waits(&mut line),
        millis(200),
        "it is in the thousand before"
    );
    quick(&mut line, 1);
    assert_eq!(waits(&mut line), millis(20), "it is forgotten");
}

/// A late driver still ends what has expired, and nothing of it is sent.
#[test]
fn a_command_expires_though_the_driver_comes_late() {
    let mut line = Line::new(EchoMode::Off, &[board()]);
    line.submit(Op::Toggle(1));
    line.drive.now = line.drive.now + Micros::from_secs(6);
    line.drive.input(Input::Timeout);
    line.run(Micros::from_secs(1), |_| None);
    assert_eq!(line.ends(), [(Err(Fault::Expired), Micros::from_secs(6))]);
    assert!(line.frames.is_empty(), "{:?}", line.frames);
}

/// A command that was under way to the line for too long is not sent, and neither is one that
/// expires while another one is handed in.
#[test]
fn a_command_that_is_handed_in_too_late_is_not_sent() {
    for (left, is_sent) in [(0, false), (1, true)] {
        let mut line = Line::new(EchoMode::Off, &[board()]);
        let (now, module) = (line.drive.now, ModuleId(0));
        let terms = Terms {
            expires: Some(now + Micros(left)),
            ..Terms::default()
        };
        let taken = line.drive.bus.submit(now, module, Op::Toggle(1), terms);
        assert!(taken.is_ok());
        line.drive.touched();
        line.run(Micros::from_secs(1), |_| None);
        assert_eq!(!line.frames.is_empty(), is_sent, "{left}");
        let expired = (Err(Fault::Expired), Micros::ZERO);
        assert_eq!(line.ends() == [expired], !is_sent, "{left}");
    }
    let mut line = Line::new(EchoMode::Off, &[board()]);
    line.submit(Op::Toggle(1));
    line.drive.now = line.drive.now + Micros::from_secs(6);
    line.submit(Op::ReadOutputs);
    line.run(Micros::ZERO, |_| None);
    assert_eq!(line.ends(), [(Err(Fault::Expired), Micros::from_secs(6))]);
    assert_eq!(line.frames.len(), 1, "{:?}", line.frames);
}

#[test]
fn a_fault_says_whether_the_module_may_have_acted() {
    let evidence = Evidence::default();
    let did_nothing = [
        Fault::Unsupported,
        Fault::Overloaded,
        Fault::Expired,
        Fault::Locked,
        Fault::Closed,
        Fault::Refused(Refusal::Invalid),
    ];
    let may_have_acted = [
        Fault::NoReply(evidence),
        Fault::Garbled(evidence),
        Fault::NotVerified,
        Fault::Unknown,
    ];
    assert!(did_nothing.iter().all(|fault| !fault.may_have_acted()));
    assert!(may_have_acted.iter().all(Fault::may_have_acted));
}

/// A probe may be preceded by a lone CR, and a reply that comes after it ended is reported: as
/// late, and once more.
#[test]
fn replies_to_a_probe_that_is_over_are_told_of() {
    let mut line = Line::new(EchoMode::Off, &[]);
    let exchange = Exchange::ascii(Address(1), false, ascii::Request::ReadName);
    let probe = Probe {
        exchange,
        settings: SerialSettings::FACTORY,
        gap: millis(5),
        timeout: Micros::ZERO,
        clear: true,
        changes: false,
        as_module: false,
    };
    let reply = b"!019060\r";
    for (at, again) in [(60, false), (7, true)] {
        line.told.clear();
        line.frames.clear();
        assert!(line.drive.bus.submit_probe(line.drive.now, probe));
        line.drive.touched();
        if again {
            line.run(millis(30), |_| Some(reply.to_vec()));
        }
        line.drive.hear_at(line.drive.now + millis(at), reply);
        line.run(millis(600), |_| None);
        assert_eq!(line.frames, [b"\r$01M\r"]);
        let late = line.told.iter().filter_map(|(_, event)| match event {
            Event::ProbedLate {
                exchange, again, ..
            } => Some((*exchange, *again)),
            _ => None,
        });
        assert_eq!(late.collect::<Vec<_>>(), [(exchange, again)]);
    }
}
