//! EDA9050: the numbered facts of `docs/datasheets/eda9050.md`.

#[path = "support/eda.rs"]
mod eda;
mod support;

use eda::{PROTOCOLS, converse_rtu, is_silent_to, read, setup};
use railbus_device::{Bank, Eeprom, Effect, Family, Input, Module, Op, Options, SettingWrite};
use railbus_device::{Observation, Setup};
use railbus_wire::{Address, Baud, Channel, Micros, Protocol, PulseWidth};
use support::{Bench, hex, lc02, request, sealed, seen, with_crc};

fn module(protocol: Protocol) -> Bench {
    Bench::new(setup(Family::Eda9050, protocol, 1))
}

fn host(protocol: Protocol) -> Module {
    eda::host(setup(Family::Eda9050, protocol, 1))
}

/// Switches all outputs.
fn write(on: u32) -> Op {
    Op::Write(Bank::new(0xFF, on))
}

/// [EDA9050 §1.1, §1.6] channels and how they are called; a 1 switches on, in every protocol.
#[test]
fn seven_inputs_and_eight_outputs() {
    let setup = Setup::new(Family::Eda9050, Address(1));
    let labels: Vec<_> = setup.points().map(|point| setup.label(point)).collect();
    let outputs = (0..8).map(|index| ("do", index));
    let expected: Vec<_> = outputs.chain((0..7).map(|index| ("di", index))).collect();
    assert_eq!(labels, expected);
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        for channel in (0..8).filter_map(Channel::new) {
            for on in [true, false] {
                module.did();
                module.op(Op::Write(Bank::one(channel, on)));
                let channel = channel.index();
                let switched = [Effect::Output { channel, on }];
                let did: Vec<_> = module.did().into_iter().map(|(_, did)| did).collect();
                assert_eq!(did, switched);
                assert_eq!(read(&mut module, Op::ReadOutputs), u32::from(on) << channel);
            }
        }
        for channel in 0..7 {
            module.input(Input::Levels(1 << channel));
            assert_eq!(read(&mut module, Op::ReadInputs), 1 << channel);
        }
    }
}

/// [EDA9050 §1.2, §1.3]
#[test]
fn identity() {
    let name = module(Protocol::Ascii).ask_text("$01M");
    assert_eq!(name.as_deref(), Some("!019050"));
    assert_eq!(
        module(Protocol::Lc02).op(Op::Identify),
        Some(Observation::Model(0x9050))
    );
    let lc02 = host(Protocol::Lc02);
    let ours = [0x9050, 0x235A, 9050].map(|model| lc02.recognises(&Observation::Model(model)));
    assert_eq!(ours, [true; 3]);
    assert!(!lc02.recognises(&Observation::Model(0x9060)));
    let ascii = host(Protocol::Ascii);
    for (reply, ours) in [(&b"!019050\r"[..], true), (b"!019060\r", false)] {
        assert_eq!(ascii.recognises(&seen(&ascii, &Op::Identify, reply)), ours);
    }
}

/// [EDA9050 §1.4, §1.5] there is no input 7, whatever its level.
#[test]
fn inputs() {
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        assert_eq!(read(&mut module, Op::ReadInputs), 0x7F, "open");
        for (levels, byte) in [(0x00, 0x00), (0x55, 0x55), (0xFF, 0x7F), (0x80, 0x00)] {
            module.input(Input::Levels(levels));
            assert_eq!(read(&mut module, Op::ReadInputs), byte);
            let raw = match protocol {
                Protocol::Ascii => format!("!00{byte:02X}00\r").into_bytes(),
                Protocol::Lc02 => {
                    let data = hex(&format!("01 00 {byte:02X}"));
                    let sum = railbus_wire::sum8(&data);
                    [&[0x6C, 0x63], &data[..], &[sum, 0x0D]].concat()
                }
                _ => with_crc(&hex(&format!("01 02 01 {byte:02X}"))),
            };
            let ask = request(&module.host(), &Op::ReadInputs).expect("a frame");
            assert_eq!(module.ask(&ask), Some(raw));
        }
    }
    // And a reply that contains it is rejected.
    let replies = [
        (Protocol::Ascii, b"!00FF00\r".to_vec()),
        (Protocol::Lc02, hex("6C 63 01 00 FF 00 0D")),
        (Protocol::Rtu, with_crc(&hex("01 02 01 FF"))),
    ];
    for (protocol, reply) in replies {
        match seen(&host(protocol), &Op::ReadInputs, &reply) {
            Observation::Channels { inputs, .. } => assert_eq!(inputs, Bank::new(0x7F, 0x7F)),
            other => panic!("{other:?}"),
        }
    }
}

/// [EDA9050 §1.7]
#[test]
fn no_pulses() {
    let width = PulseWidth::DEFAULT;
    let ops = [
        Op::ReadPulse,
        Op::Configure(SettingWrite::Pulse { mask: 1, width }),
    ];
    for protocol in PROTOCOLS {
        assert!(ops.iter().all(|op| host(protocol).exchange(op).is_err()));
    }
    is_silent_to(
        &mut module(Protocol::Ascii),
        &["$013", "#014010A", "#014000A"],
    );
    is_silent_to(
        &mut module(Protocol::Lc02),
        &["01 05 01 0A", "01 05 00 0A", "01 06"],
    );
    is_silent_to(&mut module(Protocol::Rtu), &["01 10 0001 0001 02 010A"]);
    // Switching on twice is the same as once: the state is not known.
    let host = host(Protocol::Ascii);
    assert!(host.repeatable(&write(0xFF)));
    assert_eq!((host.on_online_op(), host.pulses()), (None, Some(0)));
}

/// [EDA9050 §1.8]
#[test]
fn the_led() {
    for protocol in PROTOCOLS {
        let mut module = module(protocol);
        module.wait(5_000);
        let (start, lit) = module.effects[0];
        assert_eq!(
            (module.effects.len(), lit),
            (1, Effect::Led(true)),
            "{start:?}"
        );
        let reply = request(&module.host(), &Op::ReadInputs).and_then(|ask| module.ask(&ask));
        let took = module
            .engine
            .active()
            .serial
            .frame_time(reply.expect("one").len());
        match module.effects[1..] {
            [(off, Effect::Led(false)), (on, Effect::Led(true))] => assert_eq!(on, off + took),
            ref other => panic!("{other:?}"),
        }
    }
}

/// [EDA9050 §2.1, §2.2, §2.4]
#[test]
fn the_pin_chooses_the_protocol_and_nothing_else() {
    let (ascii, hexadecimal) = (b"$016\r", lc02("01 03"));
    for protocol in [Protocol::Ascii, Protocol::Lc02] {
        let mut module = module(protocol);
        let heard = module.ask(ascii).is_some();
        assert_eq!(heard, protocol == Protocol::Ascii);
        assert_eq!(module.ask(&hexadecimal).is_some(), !heard);
    }
    let mut module = module(Protocol::Ascii);
    assert!(module.ask_text("%0107400740").is_some());
    assert!(module.ask(&sealed("#0700A5")).is_some());
    let before = *module.engine.eeprom();
    module.did();
    for grounded in [true, false, true, false] {
        module.input(Input::Init(grounded));
        let lc02 = module.ask(&lc02("07 03")).map(|reply| reply[2..5].to_vec());
        assert_eq!(lc02, grounded.then_some(vec![0x07, 0xA5, 0x7F]));
        let ascii = module.ask(&sealed("$076"));
        assert_eq!(ascii, (!grounded).then(|| sealed("!A57F00")));
        assert_eq!((*module.engine.eeprom(), module.did()), (before, vec![]));
    }
}

/// [EDA9050 §2.3]
#[test]
fn the_pin_acts_between_frames() {
    let mut module = module(Protocol::Ascii);
    let ask = |module: &mut Bench, bytes: &[u8]| {
        module.send(bytes);
        module
            .run_until(module.now + Micros::from_millis(100))
            .is_some()
    };
    module.send(b"$01");
    module.input(Input::Init(true));
    assert!(
        ask(&mut module, b"6\r"),
        "the frame that was begun ends as it began"
    );
    assert!(ask(&mut module, &lc02("01 03")), "the next one is LC-02");
    module.send(&lc02("01 03")[..3]);
    module.input(Input::Init(false));
    assert!(ask(&mut module, &lc02("01 03")[3..]));
    assert!(ask(&mut module, b"$016\r"));
    // A frame that never ends does not hold it up.
    module.send(b"$01");
    module.input(Input::Init(true));
    module.wait(10);
    assert!(ask(&mut module, &lc02("01 03")));
}

/// [EDA9050 §2.5]
#[test]
fn modbus_is_out_of_band() {
    let mut module = module(Protocol::Rtu);
    for grounded in [true, false] {
        module.input(Input::Init(grounded));
        assert!(module.ask_rtu("01 01 0000 0008").is_some());
        module.ignores(b"$016\r");
        module.ignores(&lc02("01 03"));
    }
    // What the maker's software writes is kept.
    let setup = Setup::new(Family::Eda9050, Address(1));
    let eeprom = Eeprom {
        protocol: Protocol::Rtu,
        ..Eeprom::of(&setup)
    };
    let mut module = Bench::with(setup, eeprom, Options::default());
    for _ in 0..2 {
        assert!(module.ask_rtu("01 01 0000 0008").is_some());
        module.power_cycle();
    }
    // No command of the line reaches it: configuration leaves the protocol alone.
    for protocol in PROTOCOLS {
        let mut module = Bench::new(Setup { protocol, ..setup });
        module.op(Op::Configure(SettingWrite::Serial {
            address: Address(2),
            baud: Baud::B1200,
            checksum: false,
        }));
        assert_eq!(module.engine.eeprom().protocol, protocol);
    }
}

/// [EDA9050 §2.6]
#[test]
fn modbus_is_not_assumed() {
    let shipped = Setup::new(Family::Eda9050, Address(1));
    assert_eq!(shipped.protocol, Protocol::Ascii);
    for protocol in PROTOCOLS {
        assert_eq!(
            Setup {
                protocol,
                ..shipped
            }
            .check(),
            Ok(())
        );
    }
}

/// [EDA9050 §3.1, §3.2]
#[test]
fn outputs_in_ascii() {
    let mut module = module(Protocol::Ascii);
    for value in 0..=0xFF {
        let reply = module.ask_text(&format!("#0100{value:02X}"));
        assert_eq!(
            (reply.as_deref(), module.engine.outputs()),
            (Some(">"), value)
        );
    }
    for channel in 0..8 {
        assert!(module.ask_text(&format!("#011{channel}00")).is_some());
        assert_eq!(module.engine.outputs(), 0xFE << channel & 0xFF);
    }
    is_silent_to(&mut module, &["#011801", "#011901", "#011A01", "#011F01"]);
}

/// [EDA9050 §4.1]
#[test]
fn outputs_in_lc02() {
    let mut module = module(Protocol::Lc02);
    for value in 0..=0xFF {
        assert!(
            module
                .ask(&lc02(&format!("01 04 FF {value:02X}")))
                .is_some()
        );
        assert_eq!(module.engine.outputs(), value);
    }
    for channel in 0..8 {
        assert!(module.ask(&lc02(&format!("01 04 0{channel} 00"))).is_some());
        assert_eq!(module.engine.outputs(), 0xFE << channel & 0xFF);
    }
    is_silent_to(
        &mut module,
        &["01 04 08 01", "01 04 10 01", "01 04 80 01", "01 04 FE 01"],
    );
}

/// [EDA9050 §5.2, §5.3, §5.5] every start and count, and whether it is inside.
#[test]
fn spans() {
    let mut module = module(Protocol::Rtu);
    module.op(write(0b1010_0110));
    module.input(Input::Levels(0b0101_0011));
    for (start, count) in (0..10_u16).flat_map(|start| (0..10_u16).map(move |n| (start, n))) {
        let spans = [(1, 8, 0b1010_0110), (2, 7, 0b0101_0011)];
        for (function, channels, states) in spans {
            let ask = format!("01 0{function} {start:04X} {count:04X}");
            if count == 0 || start + count > channels {
                is_silent_to(&mut module, &[&ask]);
            } else {
                let bits = states >> start & ((1 << count) - 1);
                let reply = format!("01 0{function} 01 {bits:02X}");
                converse_rtu(&mut module, &[(&ask, &reply)]);
            }
        }
        let bytes = count.div_ceil(8);
        let zeros = "FF".repeat(bytes.into());
        let ask = format!("01 0F {start:04X} {count:04X} {bytes:02X} {zeros}");
        let inside = count > 0 && start + count <= 8;
        assert_eq!(module.ask_rtu(&ask).is_some(), inside, "{ask}");
        let on = if inside {
            ((1 << count) - 1) << start
        } else {
            0
        };
        assert_eq!(module.engine.outputs(), 0b1010_0110 | on);
        module.op(write(0b1010_0110));
    }
}

/// [EDA9050 §5.7]
#[test]
fn host_has_no_request_that_identifies_it_over_modbus() {
    let host = host(Protocol::Rtu);
    for op in [Op::Identify, Op::ReadConfig, Op::ReadPulse] {
        assert!(host.exchange(&op).is_err(), "{op:?}");
    }
}
