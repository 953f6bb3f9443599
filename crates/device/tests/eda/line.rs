//! Settings and line: `docs/datasheets/eda.md`, section 1.

use super::*;
use railbus_device::Input;

/// [EDA §1.1]
#[test]
fn as_shipped() {
    for family in BOTH {
        let mut module = Bench::new(Setup::new(family, Address(1)));
        assert_eq!(module.engine.active().serial.baud.rate(), 9600);
        converse(&mut module, &[("$012", "!01400600")]);
    }
}

/// [EDA §1.2, §1.3, §1.5]
#[test]
fn five_speeds_always_8n1() {
    let speeds = [
        (3, Baud::B1200),
        (4, Baud::B2400),
        (5, Baud::B4800),
        (6, Baud::B9600),
        (7, Baud::B19200),
    ];
    for mut module in speeds.iter().flat_map(|_| all()) {
        let protocol = module.setup.protocol;
        for (code, baud) in speeds {
            let from = module.engine.active().address.0;
            let to = 0x10 + code;
            let reply = module.ask(&write_config(protocol, from, to, code, false));
            assert!(reply.is_some(), "{protocol}, {baud}");
            let now = SerialSettings {
                baud,
                character: Character::N1,
            };
            assert_eq!(module.engine.active().serial, now);
            assert_eq!(
                now.frame_time(3).0,
                30_000_000_u64.div_ceil(baud.rate().into())
            );
            module.power_cycle();
            let active = module.engine.active();
            assert_eq!((active.serial, active.address.0), (now, to));
            assert!(module.op(Op::ReadOutputs).is_some());
        }
    }
    for family in BOTH {
        let with = |serial| {
            let setup = Setup::new(family, Address(1));
            Setup { serial, ..setup }.check()
        };
        let [even, fast] = [(Character::E1, Baud::B9600), (Character::N1, Baud::B38400)]
            .map(|(character, baud)| with(SerialSettings { baud, character }));
        assert_eq!(even, Err(SetupError::Character));
        assert_eq!(fast, Err(SetupError::Baud));
    }
}

/// [EDA §1.4, §4.8, §4.15] every address can be set and then answers; in Modbus not 0.
#[test]
fn every_address_can_be_set_and_used() {
    for mut module in all() {
        let protocol = module.setup.protocol;
        let first = u8::from(protocol == Protocol::Rtu);
        let mut from = 1;
        for to in first..=255 {
            let reply = module.ask(&write_config(protocol, from, to, 6, false));
            assert!(reply.is_some(), "{protocol}: {from} to {to}");
            assert_eq!(module.engine.active().address, Address(to));
            assert!(module.op(Op::ReadOutputs).is_some(), "{protocol}: {to}");
            from = to;
        }
    }
    for mut module in both(Protocol::Rtu, 1) {
        module.ignores(&write_config(Protocol::Rtu, 1, 0, 6, false));
    }
}

/// [EDA §1.5, §1.6]
#[test]
fn settings_survive_power_off_and_outputs_do_not() {
    for mut module in all() {
        let ascii = module.setup.protocol == Protocol::Ascii;
        let on = every_output(&module);
        assert_eq!(module.op(on), Some(Observation::Done));
        assert_eq!(module.engine.outputs(), module.setup.output_mask());
        module.op(serial(7, Baud::B19200, ascii));
        module.power_cycle();
        assert_eq!(module.engine.outputs(), 0);
        let kept = module.engine.active();
        let settings = (kept.address.0, kept.serial.baud.rate(), kept.checksum);
        assert_eq!(settings, (7, 19200, ascii));
        assert!(module.op(Op::ReadOutputs).is_some());
    }
    // A power loss ends a pulse, and nothing happens at the time it would have ended.
    let mut module = both(Protocol::Ascii, 1).next().expect("the EDA9060A");
    converse(&mut module, &[("#0140FC8", "!01"), ("#01000F", ">")]);
    module.power_cycle();
    module.did();
    module.wait(30_000);
    assert_eq!((module.engine.outputs(), module.did()), (0, vec![]));
}

/// [EDA §1.7, §1.8, §1.9] when they act, and [EDA §1.14] what is reported meanwhile.
#[test]
fn when_settings_apply() {
    // Address, speed and checksum after the reply; all of them after the next power-up.
    let cases = [
        (Applies::AfterReply, (2, 19200, true)),
        (Applies::AfterRestart, (1, 9600, false)),
        (Applies::AddressAfterReply, (2, 9600, false)),
    ];
    for (applies, then) in cases {
        for protocol in PROTOCOLS {
            for family in BOTH {
                let options = Options {
                    applies,
                    ..Options::default()
                };
                applies_so(with(setup(family, protocol, 1), options), then);
            }
        }
    }
}

fn applies_so(mut module: Bench, (address, speed, checksum): (u8, u32, bool)) {
    let (protocol, family) = (module.setup.protocol, module.setup.family);
    let ascii = protocol == Protocol::Ascii;
    let settings = |module: &Bench| {
        let active = module.engine.active();
        (active.address.0, active.serial.baud.rate(), active.checksum)
    };
    module.did();
    let reply = module.ask(&write_config(protocol, 1, 2, 7, true));
    let reply = reply.expect("an acknowledgement");
    assert!(!ascii || reply.len() == 4, "no checksum yet: {reply:02X?}");
    let took = SerialSettings::FACTORY.frame_time(reply.len());
    match module.did()[..] {
        [(saved, Effect::Save(_)), (changed, Effect::Serial(now))] => {
            assert_eq!(now.baud.rate(), speed);
            assert_eq!(changed, saved + took, "after the last stop bit");
        }
        [(_, Effect::Save(_))] => assert_eq!(speed, 9600),
        ref other => panic!("{other:?}"),
    }
    assert_eq!(settings(&module), (address, speed, checksum && ascii));
    if (family, protocol) != (Family::Eda9050, Protocol::Rtu) {
        assert_eq!(
            module.op(Op::ReadConfig),
            Some(Observation::Config {
                address: (protocol == Protocol::Rtu).then_some(Address(2)),
                baud: Some(Baud::B19200),
                character: None,
                checksum: (protocol != Protocol::Lc02).then_some(ascii),
            })
        );
    }
    module.power_cycle();
    assert_eq!(settings(&module), (2, 19200, ascii));
    assert!(module.op(Op::ReadOutputs).is_some());
}

/// [EDA §1.10]
#[test]
fn frames_of_the_other_protocols_are_not_answered() {
    for mut module in all() {
        let ops = [
            Op::ReadOutputs,
            Op::ReadInputs,
            every_output(&module),
            serial(9, Baud::B1200, false),
        ];
        for protocol in PROTOCOLS {
            if protocol == module.setup.protocol {
                continue;
            }
            let foreign = host(setup(module.setup.family, protocol, 1));
            for op in ops {
                module.ignores(&request(&foreign, &op).expect("a frame"));
            }
        }
        assert!(
            module.op(Op::ReadOutputs).is_some(),
            "and it still hears its own"
        );
    }
}

/// [EDA §1.11] the gap that the host leaves; a module that insists on it goes without.
#[test]
fn the_gap_before_requests() {
    for family in BOTH {
        for protocol in PROTOCOLS {
            let setup = setup(family, protocol, 1);
            let gap = setup.request_gap();
            if protocol != Protocol::Rtu {
                assert_eq!(gap, Micros::from_millis(5));
            }
            let insist_on_gap = true;
            let mut module = with(
                setup,
                Options {
                    insist_on_gap,
                    ..Options::default()
                },
            );
            let ask = request(&module.host(), &Op::ReadOutputs).expect("a frame");
            // A frame for another module, then the request.
            for (silence, heard) in [(gap.0 - 10, false), (gap.0, true)] {
                module.send(b"?");
                let begin = module.now + Micros(silence);
                assert_eq!(module.run_until(begin), None);
                module.send(&ask);
                let end = module.now + Micros::from_millis(100);
                assert_eq!(module.run_until(end).is_some(), heard, "{protocol}");
            }
            // Two in one piece: the second keeps no gap, and in Modbus they are no frame at all.
            module.wait(50);
            let on = request(&module.host(), &every_output(&module)).expect("a frame");
            module
                .engine
                .handle(module.now, Input::Bytes(&[ask, on].concat()));
            let answered = module.run_until(module.now + Micros::from_millis(100));
            assert_eq!(answered.is_some(), protocol != Protocol::Rtu);
            assert_eq!(module.engine.outputs(), 0);
        }
    }
}

/// [EDA §1.11] the gap goes by the settings in force, whatever the module was described as.
#[test]
fn the_gap_follows_the_settings() {
    let options = Options {
        insist_on_gap: true,
        ..Options::default()
    };
    let is_heard = |module: &mut Bench, silence, ask: &[u8]| {
        module.send(b"?");
        let begin = module.now + Micros::from_millis(silence);
        assert_eq!(module.run_until(begin), None);
        module.send(ask);
        let end = module.now + Micros::from_millis(100);
        module.run_until(end).is_some()
    };
    let read = |setup| request(&host(setup), &Op::ReadOutputs).expect("a frame");
    for family in BOTH {
        // 5 ms in ASCII, 3.6 ms in Modbus.
        let changes = [
            (Protocol::Ascii, Protocol::Rtu, true),
            (Protocol::Rtu, Protocol::Ascii, false),
        ];
        for (described, protocol, heard) in changes {
            let described = setup(family, described, 1);
            let eeprom = Eeprom {
                protocol,
                ..Eeprom::of(&described)
            };
            let mut module = Bench::with(described, eeprom, options);
            let ask = read(setup(family, protocol, 1));
            assert_eq!(is_heard(&mut module, 4, &ask), heard, "{protocol}");
        }
        // 29 ms at 1200, and less than 2 ms at 19200.
        let serial_1200 = SerialSettings {
            baud: Baud::B1200,
            ..SerialSettings::FACTORY
        };
        let slow = Setup {
            serial: serial_1200,
            ..setup(family, Protocol::Rtu, 1)
        };
        let mut module = with(slow, options);
        assert!(module.op(serial(1, Baud::B19200, false)).is_some());
        assert!(is_heard(&mut module, 10, &read(slow)));
    }
}
