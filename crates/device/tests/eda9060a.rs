//! EDA9060A: the numbered facts of `docs/datasheets/eda9060a.md`.

#[path = "support/eda.rs"]
mod eda;
mod support;

use eda::{PROTOCOLS, converse, converse_rtu, is_silent_to, read, setup};
use railbus_device::{Bank, Eeprom, Effect, Family, Input, Module, Op, Options, SettingWrite};
use railbus_device::{Observation, Setup};
use railbus_wire::{Address, Baud, Channel, Decoded, Instant, Malformed, Micros};
use railbus_wire::{Protocol, PulseWidth, rtu};
use support::{Bench, hex, request, seen, with_crc};

fn module(protocol: Protocol) -> Bench {
    Bench::new(setup(Family::Eda9060a, protocol, 1))
}

fn host(protocol: Protocol) -> Module {
    eda::host(setup(Family::Eda9060a, protocol, 1))
}

/// A module whose relays 0 and 2 give pulses of 1.0 s.
fn pulsing(protocol: Protocol) -> Bench {
    let mut module = module(protocol);
    assert_eq!(module.op(pulse(0b0101, 10)), Some(Observation::Done));
    module
}

fn pulse(mask: u8, tenths: u8) -> Op {
    let width = PulseWidth::from_tenths(tenths).expect("1 to 200");
    Op::Configure(SettingWrite::Pulse { mask, width })
}

/// Switches all relays.
fn write(on: u32) -> Op {
    Op::Write(Bank::new(0b1111, on))
}

fn switch(channel: u8, on: bool) -> Op {
    Op::Write(Bank::one(Channel::new(channel).expect("it exists"), on))
}

/// When each relay was switched since the last call, and how.
fn switched(module: &mut Bench) -> Vec<(Instant, u8, bool)> {
    let effects = module.did().into_iter();
    let outputs = effects.filter_map(|(at, effect)| match effect {
        Effect::Output { channel, on } => Some((at, channel, on)),
        _ => None,
    });
    outputs.collect()
}

/// [EDA9060A §1.1] channels and how they are called.
#[test]
fn four_inputs_and_four_relays() {
    let setup = Setup::new(Family::Eda9060a, Address(1));
    let labels: Vec<_> = setup.points().map(|point| setup.label(point)).collect();
    let expected: Vec<_> = ["do", "di"]
        .into_iter()
        .flat_map(|letters| (0..4).map(move |index| (letters, index)))
        .collect();
    assert_eq!(labels, expected);
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        for channel in 0..4 {
            module.op(switch(channel, true));
            module.input(Input::Levels(1 << channel));
            assert_eq!(read(&mut module, Op::ReadOutputs), (2 << channel) - 1);
            assert_eq!(read(&mut module, Op::ReadInputs), 1 << channel);
        }
        let fifth = Op::Write(Bank::new(0b1_0000, 0b1_0000));
        assert!(module.host().exchange(&fifth).is_err());
    }
}

/// [EDA9060A §1.2, §1.3]
#[test]
fn identity() {
    let ascii = module(Protocol::Ascii).ask_text("$01M");
    assert_eq!(ascii.as_deref(), Some("!019060"));
    let in_ascii = [
        ("9060", true),
        ("9060A", true),
        ("9050", false),
        ("906", false),
    ];
    for (name, ours) in in_ascii {
        let host = host(Protocol::Ascii);
        let name = seen(&host, &Op::Identify, format!("!01{name}\r").as_bytes());
        assert_eq!(host.recognises(&name), ours, "{name:?}");
    }
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        let identity = module.op(Op::Identify).expect("an answer");
        assert!(module.host().recognises(&identity), "{identity:?}");
        if protocol != Protocol::Ascii {
            assert_eq!(identity, Observation::Model(0x9060));
        }
    }
    let host = host(Protocol::Lc02);
    let models = [0x9060, 0x2364, 9060].map(|model| host.recognises(&Observation::Model(model)));
    assert_eq!(models, [true; 3]);
    assert!(!host.recognises(&Observation::Model(0x9050)));
}

/// [EDA9060A §1.4, §3.5, §3.6] the protocol, pulse width and mode as shipped.
#[test]
fn as_shipped() {
    let mut module = Bench::new(Setup::new(Family::Eda9060a, Address(1)));
    assert_eq!(module.ask_text("$013").as_deref(), Some("!01000A"));
    assert_eq!(PulseWidth::DEFAULT.tenths(), 10);
}

/// [EDA9060A §1.5]
#[test]
fn open_inputs_read_1() {
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        for levels in [0b1111, 0b0000, 0b0101] {
            if levels != 0b1111 {
                module.input(Input::Levels(levels)); // Not connected to begin with.
            }
            assert_eq!(read(&mut module, Op::ReadInputs), levels);
        }
    }
}

/// [EDA9060A §1.6]
#[test]
fn the_led() {
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        let start = module.now;
        module.wait(3_200);
        let millis = |at: Instant| at.since(start).0 / 1000;
        let led: Vec<_> = module
            .effects
            .drain(..)
            .map(|(at, effect)| (millis(at), effect))
            .collect();
        let blinks = (0..7).map(|half| (500 * half, Effect::Led(half % 2 == 0)));
        assert_eq!(led, blinks.collect::<Vec<_>>());
        // Other traffic does not affect its rhythm.
        module.input(Input::Levels(0));
        module.wait(500);
        let told: Vec<_> = module.effects.drain(..).collect();
        assert_eq!(
            told,
            [(start + Micros::from_millis(3_500), Effect::Led(false))]
        );
        module.wait(500);
        // In the dark half it is lit from the first bit of a reply to the last.
        module.wait(300);
        module.effects.clear();
        let ask = request(&module.host(), &Op::ReadInputs).expect("a frame");
        module.wait(50);
        module.send(&ask);
        let reply = module.run_until(module.now + Micros::from_millis(50));
        let took = module
            .engine
            .active()
            .serial
            .frame_time(reply.expect("one").len());
        match module.effects[..] {
            [(on, Effect::Led(true)), (off, Effect::Led(false))] => assert_eq!(off, on + took),
            ref other => panic!("{other:?}"),
        }
    }
}

/// [EDA9060A §2.1, §3.12]
#[test]
fn one_protocol_at_a_time_is_kept() {
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        module.op(pulse(0b1010, 200));
        module.power_cycle();
        assert_eq!(module.engine.active().protocol, protocol);
        let width = PulseWidth::from_tenths(200).expect("1 to 200");
        let kept = Observation::Pulse {
            mask: 0b1010,
            width,
        };
        assert_eq!(module.op(Op::ReadPulse), Some(kept));
        for other in PROTOCOLS.into_iter().filter(|other| *other != protocol) {
            module.ignores(&request(&host(other), &Op::ReadPulse).expect("a frame"));
        }
    }
}

/// [EDA9060A §2.2, §2.3] the host's configuration writes stay in the write map, and the module
/// refuses what lies behind it.
#[test]
fn nothing_changes_the_protocol() {
    let serial = |checksum| {
        Op::Configure(SettingWrite::Serial {
            address: Address(2),
            baud: Baud::B1200,
            checksum,
        })
    };
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        module.op(pulse(0b1111, 1));
        module.op(serial(protocol == Protocol::Ascii));
        assert_eq!(module.engine.eeprom().protocol, protocol);
    }
    for op in [pulse(0b1111, 1), serial(false)] {
        match host(Protocol::Rtu).exchange(&op) {
            Ok(railbus_wire::Exchange::Rtu(rtu::Exchange {
                request: rtu::Request::WriteRegisters(block),
                ..
            })) => assert!(block.start() + block.values().len() <= 2),
            other => panic!("{other:?}"),
        }
    }
    let mut module = module(Protocol::Rtu);
    for protocol in ["0100", "0200", "0280"] {
        is_silent_to(&mut module, &[&format!("01 10 0002 0001 02 {protocol}")]);
        is_silent_to(&mut module, &[&format!("01 10 0003 0001 02 {protocol}")]);
    }
}

/// [EDA9060A §3.1, §3.2, §3.3, §3.9, §3.10, §3.11] relays 0 and 2 give pulses.
#[test]
fn levels_and_pulses() {
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        module.op(pulse(0b0101, 50));
        module.did();
        module.op(write(0b0111));
        let [(at, 0, true), (_, 1, true), (_, 2, true)] = switched(&mut module)[..] else {
            panic!("three relays pull in");
        };
        assert_eq!(read(&mut module, Op::ReadOutputs), 0b0111);
        // A 0 releases relay 1 and leaves 2 alone; one relay or all makes no difference.
        module.op(write(0b1000));
        module.op(switch(0, false));
        let [(_, 1, false), (_, 3, true)] = switched(&mut module)[..] else {
            panic!("only the level relays move");
        };
        assert_eq!(read(&mut module, Op::ReadOutputs), 0b1101);
        module.wait(5_000);
        let end = at + Micros::from_secs(5);
        assert_eq!(switched(&mut module), [(end, 0, false), (end, 2, false)]);
        assert_eq!(read(&mut module, Op::ReadOutputs), 0b1000);
        module.op(switch(2, true));
        assert_eq!(module.engine.outputs(), 0b1100);
        module.wait(5_000);
        assert_eq!(module.engine.outputs(), 0b1000);
    }
}

/// [EDA9060A §3.4]
#[test]
fn one_width_from_100_ms_to_20_s() {
    for protocol in PROTOCOLS {
        for tenths in [1, 2, 100, 200] {
            let mut module = module(protocol);
            module.op(pulse(0b1111, tenths));
            module.op(write(0b1111));
            module.wait(30_000);
            let mut moves = switched(&mut module);
            let released = moves.split_off(4);
            let width = Micros::from_millis(100) * u64::from(tenths);
            let expected = moves
                .iter()
                .map(|&(at, relay, _)| (at + width, relay, false));
            assert_eq!(released, expected.collect::<Vec<_>>());
        }
    }
    assert_eq!([0, 201, 255].map(PulseWidth::from_tenths), [None; 3]);
}

/// [EDA9060A §3.7]
#[test]
fn a_pulse_is_started_anew() {
    for protocol in PROTOCOLS {
        let mut module = pulsing(protocol);
        module.op(switch(0, true));
        module.wait(300);
        switched(&mut module);
        module.wait(50);
        module.send(&request(&module.host(), &write(0b0001)).expect("a frame"));
        module.run_until(module.now + Micros::from_millis(990));
        assert_eq!(switched(&mut module), [], "it goes on without a break");
        module.wait(100);
        assert_eq!(module.engine.outputs(), 0);
    }
}

/// [EDA9060A §3.8]
#[test]
fn a_running_pulse_keeps_its_rules() {
    for protocol in PROTOCOLS {
        for change in [pulse(0b0101, 200), pulse(0b0101, 1), pulse(0b0000, 10)] {
            let mut module = pulsing(protocol);
            module.did();
            module.op(switch(2, true));
            module.op(change);
            module.wait(2_000);
            let [(begin, 2, true), (end, 2, false)] = switched(&mut module)[..] else {
                panic!("one pulse");
            };
            assert_eq!(end, begin + Micros::from_secs(1));
        }
        // A relay that is on stays on when it is made a pulse relay.
        let mut module = module(protocol);
        module.op(switch(1, true));
        module.op(pulse(0b0010, 1));
        module.op(switch(1, false));
        module.wait(1_000);
        assert_eq!(module.engine.outputs(), 0b0010);
    }
}

/// A write that may begin a pulse is not repeated.
#[test]
fn what_the_host_may_repeat() {
    let mut host = host(Protocol::Ascii);
    let repeatable = |host: &Module| [0, 1].map(|relay| host.repeatable(&switch(relay, true)));
    assert_eq!(repeatable(&host), [false; 2], "not asked yet");
    assert_eq!(
        (host.on_online_op(), host.pulses()),
        (Some(Op::ReadPulse), None)
    );
    host.learn(&seen(&host, &Op::ReadPulse, b"!01010A\r"));
    assert_eq!(repeatable(&host), [false, true]);
    assert!(host.repeatable(&switch(0, false)) && !host.repeatable(&pulse(0, 10)));
    assert_eq!(host.pulses(), Some(0b0001));
}

/// [EDA9060A §4.3, §4.4, §4.5]
#[test]
fn pulses_in_ascii() {
    let mut module = module(Protocol::Ascii);
    let conversation = [
        ("$013", "!01000A"),
        ("#0140F01", "!01"),
        ("$013", "!010F01"),
        ("#0140DC8", "!01"),
        ("$013", "!010DC8"),
        ("#01000F", ">"), // one character less, and it switches
        ("$013", "!010DC8"),
        ("$016", "!0F0F00"),
    ];
    converse(&mut module, &conversation);
    let host = host(Protocol::Ascii);
    let set = request(&host, &pulse(0x0D, 200));
    assert_eq!(set, Some(b"#0140DC8\r".to_vec()));
    assert_eq!(request(&host, &Op::ReadPulse), Some(b"$013\r".to_vec()));
}

/// [EDA9060A §4.7, §5.5] the printed data, and a sum that was printed wrong.
#[test]
fn the_printed_data() {
    let frames = [
        (Protocol::Ascii, b"$016\r".to_vec(), b"!030200\r".to_vec()),
        (
            Protocol::Lc02,
            hex("4C 57 01 03 04 0D"),
            hex("6C 63 01 03 02 06 0D"),
        ),
    ];
    for (protocol, request, reply) in frames {
        let mut module = module(protocol);
        module.op(write(0b0011));
        module.input(Input::Levels(0b0010));
        assert_eq!(module.ask(&request), Some(reply));
    }
    let exchange = host(Protocol::Lc02).exchange(&Op::ReadInputs);
    let misprint = hex("6C 63 01 03 22 34 0D");
    let read = exchange.expect("a frame").decode_response(&misprint);
    assert_eq!(read, Decoded::Malformed(Malformed::Checksum));
}

/// [EDA9060A §4.8] in both directions.
#[test]
fn four_bits_of_eight() {
    for protocol in [Protocol::Ascii, Protocol::Lc02] {
        let mut module = module(protocol);
        module.input(Input::Levels(u32::MAX));
        module.op(write(0b1111));
        let reply = match protocol {
            Protocol::Ascii => b"!0F0F00\r".to_vec(),
            _ => hex("6C 63 01 0F 0F 1F 0D"),
        };
        let ask = request(&module.host(), &Op::ReadInputs).expect("a frame");
        assert_eq!(module.ask(&ask), Some(reply));
    }
    let impossible = seen(&host(Protocol::Ascii), &Op::ReadInputs, b"!112200\r");
    let masked = Observation::Channels {
        outputs: Bank::new(0b1111, 0b0001),
        inputs: Bank::new(0b1111, 0b0010),
    };
    assert_eq!(impossible, masked);
}

/// [EDA9060A §6.5, §6.6, §6.7, §6.8, §6.9]
#[test]
fn the_read_map() {
    let mut module = module(Protocol::Rtu);
    let shipped = "01 03 08 9060 0106 000A 0000";
    converse_rtu(&mut module, &[("01 03 0000 0004", shipped)]);
    module.op(pulse(0b1101, 100));
    let one_by_one = [
        ("01 03 0000 0001", "01 03 02 9060"),
        ("01 03 0001 0001", "01 03 02 0106"),
        ("01 03 0002 0001", "01 03 02 0D64"),
        ("01 03 0003 0001", "01 03 02 0000"),
        ("01 03 0002 0002", "01 03 04 0D64 0000"),
    ];
    converse_rtu(&mut module, &one_by_one);
    // The register reports what is stored: an out-of-band change acts at the next power-up.
    let checksum = true;
    let setup = setup(Family::Eda9060a, Protocol::Rtu, 1);
    let eeprom = Eeprom {
        checksum,
        ..Eeprom::of(&setup)
    };
    let mut sealing = Bench::with(setup, eeprom, Options::default());
    converse_rtu(&mut sealing, &[("01 03 0003 0001", "01 03 02 0080")]);
    let config = sealing.op(Op::ReadConfig);
    assert!(matches!(
        config,
        Some(Observation::Config {
            checksum: Some(true),
            ..
        })
    ));
}

/// [EDA9060A §6.17] what is read at one number is written at the one before it.
#[test]
fn host_has_two_maps() {
    let host = host(Protocol::Rtu);
    let frame = |op: &Op| request(&host, op).map(|frame| frame[..6].to_vec());
    let serial = Op::Configure(SettingWrite::Serial {
        address: Address(2),
        baud: Baud::B9600,
        checksum: false,
    });
    let maps = [
        (Op::ReadConfig, "01 03 0001 0003", serial, "01 10 0000 0001"),
        (
            Op::ReadPulse,
            "01 03 0002 0001",
            pulse(1, 10),
            "01 10 0001 0001",
        ),
    ];
    for (read, read_at, write, written_at) in maps {
        assert_eq!(frame(&read), Some(hex(read_at)));
        assert_eq!(frame(&write), Some(hex(written_at)));
    }
}

/// [EDA9060A §6.18]
#[test]
fn host_identifies_it_over_modbus() {
    let host = host(Protocol::Rtu);
    let ask = request(&host, &Op::Identify);
    assert_eq!(ask, Some(with_crc(&hex("01 03 0000 0004"))));
    let replies = [
        ("9060 0106 000A 0000", true),
        ("2364 0106 000A 0000", true),
        ("9050 0106 000A 0000", false),
        ("9060 0206 000A 0000", false),
    ];
    for (registers, ours) in replies {
        let reply = with_crc(&hex(&format!("01 03 08 {registers}")));
        let identity = seen(&host, &Op::Identify, &reply);
        let model = matches!(identity, Observation::Model(_));
        assert_eq!(model && host.recognises(&identity), ours, "{registers}");
    }
}
