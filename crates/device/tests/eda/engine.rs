//! How requests reach the modules and how replies leave them, in every protocol.

use super::*;
use railbus_device::{Engine, Input, Output};
use railbus_wire::Instant;

/// A request that switches one output on.
fn switch(module: &Bench, channel: u8) -> Vec<u8> {
    let channel = Channel::new(channel).expect("it exists");
    let op = Op::Write(Bank::one(channel, true));
    request(&module.host(), &op).expect("a frame")
}

/// Feeds characters that all end now, and returns the reply.
fn in_one_piece(module: &mut Bench, bytes: &[u8]) -> Option<Vec<u8>> {
    module.wait(50);
    let now = module.now;
    module.engine.handle(now, Input::Bytes(bytes));
    module.run_until(now + Micros::from_millis(300))
}

/// Everything the engine wants done now, and whether it sends then.
fn drain(engine: &mut Engine) -> (Vec<Effect>, Option<Vec<u8>>) {
    let mut effects = Vec::new();
    loop {
        match engine.poll() {
            Output::Effect(effect) => effects.push(effect),
            Output::Transmit(bytes) => return (effects, Some(bytes.to_vec())),
            Output::Wait(_) => return (effects, None),
        }
        assert!(effects.len() < 100, "poll comes to an end");
    }
}

#[test]
fn pieces_do_not_matter() {
    for mut module in all() {
        let ask = request(&module.host(), &Op::ReadInputs).expect("a frame");
        let slowly = module.ask(&ask);
        assert!(slowly.is_some());
        assert_eq!(in_one_piece(&mut module, &ask), slowly);
    }
}

#[test]
fn of_requests_back_to_back_all_act_and_the_last_is_answered() {
    for mut module in all() {
        if module.setup.protocol == Protocol::Rtu {
            continue; // Only silence separates them there.
        }
        let read = request(&module.host(), &Op::ReadOutputs).expect("a frame");
        let frames = [switch(&module, 0), switch(&module, 2), read.clone()].concat();
        let reply = in_one_piece(&mut module, &frames);
        assert_eq!(module.engine.outputs(), 0b101);
        assert_eq!(reply, module.ask(&read));
    }
}

#[test]
fn modbus_requests_back_to_back_are_none() {
    for mut module in both(Protocol::Rtu, 1) {
        let two = [switch(&module, 0), switch(&module, 1)].concat();
        module.ignores(&two);
        // The driver is late: a whole frame, long silence, and a second one, before any timeout.
        let (first, second) = two.split_at(8);
        let now = module.now;
        let later = now + Micros::from_millis(20);
        module.engine.handle(now, Input::Bytes(first));
        module.engine.handle(later, Input::Bytes(second));
        assert_eq!(module.engine.outputs(), 0b01);
    }
}

#[test]
fn noise_before_a_request_does_not_matter() {
    for mut module in all() {
        let ask = request(&module.host(), &Op::ReadOutputs).expect("a frame");
        let clean = module.ask(&ask);
        let noises = [
            "00",
            "FF",
            "FF 00 24",
            "4C",
            "4C 57 01",
            "4C 57 01 02",
            "01 03 0D",
        ];
        for noise in noises.map(hex) {
            module.ignores(&noise);
            assert_eq!(module.ask(&ask), clean, "after {noise:02X?}");
        }
        let bad = Input::BadByte;
        module.input(bad);
        assert_eq!(module.ask(&ask), clean, "after a bad character");
        // Directly before it, only Modbus loses the request.
        let close = module.ask(&[&[0xFF], &ask[..]].concat());
        assert_eq!(close.is_none(), module.setup.protocol == Protocol::Rtu);
    }
}

#[test]
fn a_bad_character_spoils_its_request() {
    for mut module in all() {
        let ask = switch(&module, 0);
        for at in 0..ask.len() {
            module.wait(50);
            module.send(&ask[..at]);
            module.input(Input::BadByte);
            module.send(&ask[at + 1..]);
            module.wait(300);
            assert_eq!(module.engine.outputs(), 0, "bad at {at}");
        }
    }
}

#[test]
fn effects_come_once_and_in_order() {
    for mut module in all() {
        let on = every_output(&module);
        module.did();
        assert_eq!(module.op(on), Some(Observation::Done));
        let outputs = 0..module.setup.outputs;
        let switched = outputs.map(|channel| Effect::Output { channel, on: true });
        let did = |module: &mut Bench| {
            let effects = module.did().into_iter();
            effects.map(|(_, effect)| effect).collect::<Vec<_>>()
        };
        assert_eq!(did(&mut module), switched.collect::<Vec<_>>());
        module.op(on);
        module.op(Op::ReadOutputs);
        module.op(serial(1, Baud::B9600, false));
        assert_eq!(did(&mut module), [], "nothing new");
        module.op(serial(2, Baud::B1200, false));
        let kept = *module.engine.eeprom();
        let expected = [Effect::Save(kept), Effect::Serial(kept.serial)];
        assert_eq!(did(&mut module), expected);
        assert_eq!((kept.address.0, kept.serial.baud), (2, Baud::B1200));
        module.op(serial(3, Baud::B1200, false));
        assert_eq!(did(&mut module), [Effect::Save(*module.engine.eeprom())]);
    }
}

/// The reply waits for the turnaround; a request that ends before that replaces it.
#[test]
fn turnaround() {
    let turnaround = Micros::from_millis(20);
    for protocol in PROTOCOLS {
        let options = Options {
            turnaround,
            ..Options::default()
        };
        let mut module = with(setup(Family::Eda9050, protocol, 1), options);
        let ask = request(&module.host(), &Op::ReadOutputs).expect("a frame");
        module.send(&ask);
        let (asked, silence) = (module.now, module.engine.active().serial.t3_5());
        let mut early = asked + Micros(19_999);
        if protocol == Protocol::Rtu {
            early = early + silence;
        }
        if protocol != Protocol::Rtu {
            module.send(&[0xFF]); // Noise is no request.
        }
        assert_eq!(module.run_until(early), None);
        assert!(module.run_until(early + Micros(1)).is_some());
        module.wait(50);
        module.send(&switch(&module, 0));
        assert_eq!(module.run_until(module.now + Micros::from_millis(5)), None);
        module.send(&ask);
        let reply = module.run_until(module.now + Micros::from_millis(300));
        let read = seen(&module.host(), &Op::ReadOutputs, &reply.expect("one reply"));
        assert!(
            matches!(read, Observation::Channels { .. }),
            "that of the last"
        );
        assert_eq!(module.engine.outputs(), 1);
    }
}

/// A host that has addressed another module meanwhile is not interrupted.
#[test]
fn a_request_to_another_module_ends_the_wait() {
    let options = Options {
        turnaround: Micros::from_millis(20),
        ..Options::default()
    };
    for protocol in PROTOCOLS {
        let mut module = with(setup(Family::Eda9060a, protocol, 1), options);
        module.send(&switch(&module, 0));
        assert_eq!(module.run_until(module.now + Micros::from_millis(5)), None);
        let other = host(setup(Family::Eda9060a, protocol, 2));
        let ask = request(&other, &Op::ReadOutputs).expect("a frame");
        module.send(&ask);
        assert_eq!(
            module.run_until(module.now + Micros::from_millis(300)),
            None
        );
        assert_eq!(module.engine.outputs(), 1);
        assert!(module.op(Op::ReadOutputs).is_some());
    }
}

/// A [`Input::Sent`] that belongs to no reply does nothing, in particular it applies no settings.
#[test]
fn nothing_was_sent() {
    let options = Options {
        turnaround: Micros::from_millis(20),
        ..Options::default()
    };
    for protocol in PROTOCOLS {
        let mut module = with(setup(Family::Eda9060a, protocol, 1), options);
        module.send(&write_config(protocol, 1, 2, 7, false));
        module.input(Input::Sent);
        assert_eq!(module.engine.active().address, Address(1));
        module.wait(5);
        module.input(Input::Sent);
        assert_eq!(module.engine.active().serial, SerialSettings::FACTORY);
        let end = module.now + Micros::from_millis(50);
        assert!(module.run_until(end).is_some());
        assert_eq!(module.engine.active().address, Address(2));
    }
}

/// What arrives while the module sends is discarded, and it begins nothing new meanwhile.
#[test]
fn half_duplex() {
    for module in all() {
        let (mut engine, ask) = (module.engine.clone(), switch(&module, 0));
        let at = |millis: u64| module.now + Micros::from_millis(millis);
        let half = Input::Bytes(&ask[..4]);
        engine.handle(at(20), Input::Bytes(&ask));
        engine.handle(at(30), Input::Timeout);
        let (effects, reply) = drain(&mut engine);
        let on = Effect::Output {
            channel: 0,
            on: true,
        };
        assert!(effects.contains(&on) && reply.is_some());
        for (millis, input) in [(31, Input::Bytes(&ask)), (32, half), (60, Input::Timeout)] {
            engine.handle(at(millis), input);
            assert_eq!(drain(&mut engine).1, None);
        }
        engine.handle(at(70), Input::Sent);
        engine.handle(at(90), Input::Timeout);
        assert_eq!(drain(&mut engine).1, None, "the half frame is forgotten");
    }
}

/// New settings wait for the last stop bit, whatever arrives while the module sends.
#[test]
fn noise_does_not_hurry_new_settings() {
    for module in all() {
        let (mut engine, protocol) = (module.engine.clone(), module.setup.protocol);
        let change = write_config(protocol, 1, 2, 7, false);
        let at = |millis: u64| module.now + Micros::from_millis(millis);
        engine.handle(at(20), Input::Bytes(&change));
        engine.handle(at(30), Input::Timeout);
        assert!(drain(&mut engine).1.is_some());
        for (millis, input) in [(31, Input::BadByte), (40, Input::Timeout)] {
            engine.handle(at(millis), input);
            assert_eq!(drain(&mut engine), (vec![], None), "{protocol}");
            assert_eq!(engine.active().address, Address(1), "{protocol}");
        }
        engine.handle(at(50), Input::Sent);
        assert_eq!(engine.active().address, Address(2));
    }
}

/// A request that arrives when a late reply goes out is lost, not answered in between.
#[test]
fn a_reply_that_meets_a_request() {
    let turnaround = Micros::from_millis(20);
    for family in BOTH {
        let options = Options {
            turnaround,
            ..Options::default()
        };
        let module = with(setup(family, Protocol::Rtu, 1), options);
        let (mut engine, ask) = (module.engine.clone(), switch(&module, 0));
        let at = |millis: u64| module.now + Micros::from_millis(millis);
        engine.handle(at(20), Input::Bytes(&ask));
        engine.handle(at(24), Input::Timeout);
        engine.handle(at(44), Input::Bytes(&ask));
        assert!(drain(&mut engine).1.is_some());
        engine.handle(at(60), Input::Timeout);
        assert_eq!(drain(&mut engine).1, None);
    }
}

/// A late driver: what was due by then is done before new input is handled.
#[test]
fn time_goes_first() {
    let mut module = Bench::new(setup(Family::Eda9060a, Protocol::Ascii, 1));
    converse(&mut module, &[("#0140101", "!01"), ("#011001", ">")]);
    let late = Instant(module.now.0 + 1_000_000);
    module.engine.handle(late, Input::Bytes(b"$016\r"));
    assert_eq!(drain(&mut module.engine).1, Some(b"!000F00\r".to_vec()));
}

/// One frame holds outputs and inputs, but Modbus has one for each.
#[test]
fn what_reads_everything_once() {
    for module in all() {
        let ops: Vec<Op> = module.host().full_poll().collect();
        let expected = match module.setup.protocol {
            Protocol::Rtu => vec![Op::ReadOutputs, Op::ReadInputs],
            _ => vec![Op::ReadOutputs],
        };
        assert_eq!(ops, expected, "{}", module.setup.protocol);
    }
}

/// Setting several outputs takes few frames: in Modbus one for each run, otherwise one for all
/// outputs.
#[test]
fn what_one_frame_brings_about() {
    for module in all() {
        let (host, every) = (module.host(), module.setup.output_mask());
        let runs = module.setup.protocol == Protocol::Rtu;
        let table = [
            (Bank::new(every, 0b0101), every),
            (
                Bank::new(0b0110, 0b0010),
                if runs { 0b0110 } else { 0b0010 },
            ),
            (
                Bank::new(0b1011, 0b0001),
                if runs { 0b0011 } else { 0b0001 },
            ),
        ];
        for (wish, mask) in table {
            assert_eq!(host.group(wish), Bank::new(mask, wish.on), "{wish:?}");
        }
    }
}

/// The host knows what none of these modules' frames can do.
#[test]
fn what_no_frame_does() {
    let channel = Channel::new(0).expect("it exists");
    let never = [
        Op::WriteSilent(Bank::one(channel, true)),
        Op::Toggle(1),
        Op::ReadAnalogs,
        Op::ReadVariable(0),
        Op::Configure(SettingWrite::Address(Address(2))),
        Op::Configure(SettingWrite::Baud(Baud::B1200)),
        Op::Configure(SettingWrite::Restore),
        Op::Write(Bank::new(0x100, 0x100)),
        serial(2, Baud::B38400, false),
    ];
    let two = Op::Write(Bank::new(0b11, 0b01));
    for module in all() {
        let (host, protocol) = (module.host(), module.setup.protocol);
        for op in never {
            assert!(host.exchange(&op).is_err(), "{protocol}: {op:?}");
        }
        // Modbus has runs of coils, and only ASCII has a checksum to set.
        let sealed = host.exchange(&serial(2, Baud::B1200, true));
        assert_eq!(sealed.is_ok(), protocol == Protocol::Ascii);
        assert_eq!(host.exchange(&two).is_ok(), protocol == Protocol::Rtu);
    }
}

/// A partial frame of another protocol may be pending in the receiver: an LC-02 reply contains a
/// `#` here. The request after it kept its gap.
#[test]
fn a_gap_counts_after_the_bytes_of_another_protocol() {
    let setup = Setup::new(Family::Eda9060a, Address(1));
    let options = Options {
        insist_on_gap: true,
        ..Options::default()
    };
    let mut module = Bench::with(setup, Eeprom::of(&setup), options);
    module.send(b"$01M\r");
    module.wait(50);
    module.send(&[0x6C, 0x63, 0x02, 0x23, 0x00, 0x25, 0x0C]);
    assert_eq!(module.ask(b"$016\r"), Some(b"!000F00\r".to_vec()));
}
