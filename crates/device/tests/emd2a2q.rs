//! EMD-2A2Q, by the numbered facts of `docs/datasheets/emd2a2q.md`. What it shares with the
//! ERC-8 is in `sisters.rs`, descriptions are in `setup.rs`.

mod support;

use railbus_device::{
    AnalogCalibration, Bank, Eeprom, Effect, Family, Input, Module, Observation, Op, Options,
    SettingWrite, Setup,
};
use railbus_wire::{Address, Baud, Channel, Character, Instant, Micros, SerialSettings};
use support::{Bench, hex, request, seen, with_crc};

fn setup(address: u8) -> Setup {
    Setup::new(Family::Emd2a2q, Address(address))
}

fn emd() -> Bench {
    Bench::new(setup(1))
}

fn host() -> Module {
    Module::new(setup(1)).expect("an EMD-2A2Q")
}

/// One register of module 1.
fn register(module: &mut Bench, at: u16) -> u16 {
    let reply = module.ask_rtu(&format!("01 03 {at:04X} 0001"));
    let reply = reply.expect("a register");
    assert_eq!(reply[..3], [0x01, 0x03, 0x02]);
    u16::from_be_bytes([reply[3], reply[4]])
}

/// Writes one register of module 1, which is answered by its echo.
fn set(module: &mut Bench, at: u16, value: u16) {
    let write = format!("01 06 {at:04X} {value:04X}");
    assert_eq!(module.ask_rtu(&write), Some(hex(&write)));
}

/// What both inputs read.
fn readings(module: &mut Bench) -> [u16; 2] {
    [6, 7].map(|at| register(module, at))
}

/// Sets both inputs.
fn apply(module: &mut Bench, first: i16, second: i16) {
    module.input(Input::Analog(0, first));
    module.input(Input::Analog(1, second));
}

/// [EMD-2A2Q §4.1, §4.2, §4.3, §4.4, §4.5, §4.6, §5.1] the map as shipped; version and inputs
/// are the module's own, and the rest is 1, 9600, no parity, 5.00 V, nothing under way.
#[test]
fn the_register_map() {
    let mut module = emd();
    apply(&mut module, 871, 12);
    let reply = module.ask_rtu("01 03 0000 0008").expect("all of it");
    assert_eq!(reply[..3], hex("01 03 10"));
    assert_eq!(reply[5..], hex("0001 0002 0000 01F4 0000 0367 000C"));
    let version = register(&mut module, 0);
    module.refuses("01 06 0000 0000", 2);
    assert_eq!(register(&mut module, 0), version);
    let read = module.ask_rtu("01 03 0006 0001");
    assert_eq!(read, Some(hex("01 03 02 0367")), "8.71 as printed");
}

/// [EMD-2A2Q §2.1, §2.3] FC06 is answered by its echo, FC10 with start and count.
/// [EMD-2A2Q §4.5] the calibration voltage takes 1-2000.
#[test]
fn registers_are_written_by_two_functions() {
    let mut module = emd();
    for voltage in [1, 500, 1000, 2000] {
        set(&mut module, 4, voltage);
        assert_eq!(register(&mut module, 4), voltage);
    }
    let reply = module.ask_rtu("01 10 0002 0003 06 0003 0001 03E8");
    assert_eq!(reply, Some(hex("01 10 0002 0003")));
    let read = module.ask_rtu("01 03 0002 0003");
    assert_eq!(read, Some(hex("01 03 06 0003 0001 03E8")));
    let active = module.engine.active().serial;
    let expected = (Baud::B19200, Character::O1);
    assert_eq!((active.baud, active.character), expected);
}

/// [EMD-2A2Q §4.6, §4.13, §4.14] an input reads what lies there times 100, whatever its range
/// is called: 10 V is 1000, 20 mA is 2000, and nothing is below 0.
#[test]
fn analog_inputs() {
    let mut module = emd();
    let table = [
        ([0, 0], [0, 0]),
        ([1000, 871], [1000, 871]),
        ([2000, 1], [2000, 1]),
        ([-1, -300], [0, 0]),
    ];
    for ([first, second], expected) in table {
        apply(&mut module, first, second);
        assert_eq!(readings(&mut module), expected);
        let reply = module.ask_rtu("01 03 0006 0002").expect("both");
        let analogs = seen(&host(), &Op::ReadAnalogs, &with_crc(&reply));
        assert_eq!(analogs, Observation::Analogs(expected));
    }
}

/// [EMD-2A2Q §5.1, §5.3, §5.5] zero: what both inputs measure becomes 0, after 500 ms to the
/// microsecond, and is kept.
#[test]
fn calibration_of_zero() {
    let mut module = emd();
    apply(&mut module, 12, -7);
    module.wait(50);
    module.did();
    module.send(&with_crc(&hex("01 06 0005 0001")));
    let begun = module.now + SerialSettings::FACTORY.t3_5();
    assert!(module.run_until(begun + Micros::from_millis(100)).is_some());
    assert_eq!(register(&mut module, 5), 1);
    module.wait(1000);
    let kept = Eeprom {
        calibration: AnalogCalibration {
            zero: [12, -7],
            ..AnalogCalibration::NEUTRAL
        },
        ..Eeprom::of(&module.setup)
    };
    let done = begun + Micros::from_millis(500);
    assert_eq!(module.did(), [(done, Effect::Save(kept))]);
    assert_eq!(
        (register(&mut module, 5), readings(&mut module)),
        (0, [0, 0])
    );
    apply(&mut module, 112, 93);
    assert_eq!(readings(&mut module), [100, 100]);
}

/// A calibration that is interrupted by power-off has no effect.
#[test]
fn power_off_ends_a_calibration() {
    let mut module = emd();
    apply(&mut module, 12, 12);
    set(&mut module, 5, 1);
    module.power_cycle();
    module.wait(1000);
    apply(&mut module, 12, 12);
    assert_eq!(
        (register(&mut module, 5), readings(&mut module)),
        (0, [12, 12])
    );
}

/// [EMD-2A2Q §5.2] bits 3-15 do nothing; [EMD-2A2Q §5.6] of several bits only the first of
/// restore, zero and span is carried out.
#[test]
fn command_bits() {
    let table = [
        (0x0000, 0, [300, 400]),
        (0x0008, 0, [300, 400]),
        (0xFFF8, 0, [300, 400]),
        (0xFFF9, 1, [0, 0]),
        (0xFFFA, 2, [500, 500]),
        (0x0003, 1, [0, 0]),
        (0x0004, 0, [300, 400]),
        (0x0007, 0, [300, 400]),
    ];
    for (command, under_way, afterwards) in table {
        let mut module = emd();
        apply(&mut module, 300, 400);
        set(&mut module, 5, command);
        assert_eq!(register(&mut module, 5), under_way, "{command:04X}");
        module.wait(500);
        let after = (register(&mut module, 5), readings(&mut module));
        assert_eq!(after, (0, afterwards), "{command:04X}");
        if under_way == 0 {
            assert_eq!(*module.engine.eeprom(), Eeprom::of(&module.setup));
        }
    }
}

/// A module at 9, 19200 8E1, whose calibration is not the neutral one.
fn configured() -> Bench {
    let calibration = AnalogCalibration {
        voltage: 1000,
        zero: [5, 6],
        span: [(900, 1000), (1100, 1000)],
    };
    let serial = SerialSettings {
        baud: Baud::B19200,
        character: Character::E1,
    };
    let setup = Setup { serial, ..setup(9) };
    let eeprom = Eeprom {
        calibration,
        ..Eeprom::of(&setup)
    };
    Bench::with(setup, eeprom, Options::default())
}

/// [EMD-2A2Q §5.8] restore answers in the old way and then is as shipped; relays stay.
#[test]
fn restore() {
    let mut module = configured();
    apply(&mut module, 300, 400);
    assert!(module.ask_rtu("09 0F 0008 0002 01 02").is_some());
    let write = "09 06 0005 0004";
    module.wait(50);
    module.did();
    let old = module.engine.active().serial;
    module.send(&with_crc(&hex(write)));
    let understood = module.now + old.t3_5();
    let left = understood + old.frame_time(8);
    assert_eq!(module.run_until(left), Some(with_crc(&hex(write))));
    let shipped = Eeprom::of(&setup(1));
    assert_eq!(
        module.did(),
        [
            (understood, Effect::Save(shipped)),
            (left, Effect::Serial(SerialSettings::FACTORY)),
        ]
    );
    assert_eq!(module.engine.outputs(), 0b10);
    assert_eq!(readings(&mut module), [300, 400]);
    let read = module.ask_rtu("01 03 0001 0005");
    assert_eq!(read, Some(hex("01 03 0A 0001 0002 0000 01F4 0000")));
    module.power_cycle();
    assert_eq!(*module.engine.active(), shipped);
}

/// [EMD-2A2Q §5.8] a restore cancels a running calibration.
#[test]
fn restore_ends_a_calibration() {
    let mut module = configured();
    apply(&mut module, 300, 400);
    assert!(module.ask_rtu("09 06 0005 0001").is_some());
    assert!(module.ask_rtu("09 06 0005 0004").is_some());
    assert_eq!(register(&mut module, 5), 0);
    module.wait(1000);
    assert_eq!(readings(&mut module), [300, 400]);
}

/// A late timer does not change the reply to the next request.
#[test]
fn a_late_timer_comes_before_the_next_request() {
    let mut module = emd();
    apply(&mut module, 12, 12);
    set(&mut module, 5, 1);
    // A second later the driver, having missed the end, feeds a whole request.
    module.now = module.now + Micros::from_secs(1);
    let read = with_crc(&hex("01 03 0005 0002"));
    module.engine.handle(module.now, Input::Bytes(&read));
    let reply = module.run_until(module.now + Micros::from_millis(100));
    assert_eq!(reply, Some(with_crc(&hex("01 03 04 0000 0000"))));
}

/// [EMD-2A2Q §6.1] every write to address 0 is carried out and not answered.
/// [EMD-2A2Q §6.2] reads from address 0 are ignored.
#[test]
fn broadcasts() {
    let mut module = Bench::new(setup(6));
    apply(&mut module, 300, 400);
    let table = [
        "00 05 0008 FF00",
        "00 0F 0008 0002 01 03",
        "00 06 0004 0064",
    ];
    for request in table {
        assert_eq!(module.ask_rtu(request), None);
    }
    assert_eq!(module.engine.outputs(), 0b11);
    assert_eq!(module.engine.eeprom().calibration.voltage, 100);
    for request in ["00 01 0008 0002", "00 03 0000 0008", "00 06 0001 0021"] {
        module.ignores(&with_crc(&hex(request)));
    }
    assert_eq!(module.ask_hex("00 06 0001 0001 181B"), None);
    assert_eq!(register(&mut module, 1), 1);
    assert_eq!(module.ask_rtu("00 10 0002 0002 04 0003 0001"), None);
    let serial = module.engine.active().serial;
    assert_eq!(
        (serial.baud, serial.character),
        (Baud::B19200, Character::O1)
    );
    assert_eq!(module.ask_rtu("00 06 0005 0001"), None);
    module.wait(500);
    assert_eq!(readings(&mut module), [0, 0]);
}

/// Settings that come without a reply act when the request has been understood.
#[test]
fn broadcast_settings_act_at_once() {
    let mut module = emd();
    module.wait(50);
    module.did();
    module.send(&with_crc(&hex("00 06 0002 0004")));
    let understood: Instant = module.now + SerialSettings::FACTORY.t3_5();
    module.wait(100);
    let times: Vec<Instant> = module.did().into_iter().map(|(at, _)| at).collect();
    assert_eq!(times, [understood; 2], "saved and in force");
    assert_eq!(module.engine.active().serial.baud, Baud::B38400);
}

/// [EMD-2A2Q §5.7] one command bit at a time; and the other ops.
#[test]
fn the_host_asks() {
    let relay = |index| Channel::new(index).expect("a relay");
    let change = |change| Op::Configure(change);
    let table = [
        (Op::ReadOutputs, "01 01 0008 0002"),
        (Op::ReadAnalogs, "01 03 0006 0002"),
        (Op::Identify, "01 03 0000 0001"),
        (Op::ReadConfig, "01 03 0001 0003"),
        (Op::Write(Bank::one(relay(0), true)), "01 05 0008 FF00"),
        (Op::Write(Bank::one(relay(1), false)), "01 05 0009 0000"),
        (Op::Write(Bank::new(3, 2)), "01 0F 0008 0002 01 02"),
        (change(SettingWrite::Address(Address(9))), "01 06 0001 0009"),
        (change(SettingWrite::Baud(Baud::B2400)), "01 06 0002 0000"),
        (change(SettingWrite::Baud(Baud::B38400)), "01 06 0002 0004"),
        (
            change(SettingWrite::Character(Character::O1)),
            "01 06 0003 0001",
        ),
        (
            change(SettingWrite::CalibrationVoltage(1000)),
            "01 06 0004 03E8",
        ),
        (change(SettingWrite::CalibrateZero), "01 06 0005 0001"),
        (change(SettingWrite::CalibrateSpan), "01 06 0005 0002"),
        (change(SettingWrite::Restore), "01 06 0005 0004"),
    ];
    for (op, frame) in table {
        assert_eq!(request(&host(), &op), Some(with_crc(&hex(frame))), "{op:?}");
    }
    for op in [
        Op::ReadInputs,
        Op::Toggle(1),
        Op::WriteSilent(Bank::new(1, 1)),
        Op::Write(Bank::new(4, 4)),
        change(SettingWrite::Baud(Baud::B1200)),
    ] {
        assert_eq!(request(&host(), &op), None, "{op:?}");
    }
}

#[test]
fn the_host_understands() {
    let host = host();
    let said = |op, reply| seen(&host, &op, &with_crc(&hex(reply)));
    let relays = Observation::Channels {
        outputs: Bank::new(3, 2),
        inputs: Bank::default(),
    };
    assert_eq!(said(Op::ReadOutputs, "01 01 01 FE"), relays);
    assert_eq!(
        said(Op::Identify, "01 03 02 0102"),
        Observation::Version(0x0102)
    );
    let config = Observation::Config {
        address: Some(Address(6)),
        baud: Some(Baud::B2400),
        character: Some(Character::E1),
        checksum: None,
    };
    assert_eq!(said(Op::ReadConfig, "01 03 06 0006 0000 0002"), config);
    let zero = Op::Configure(SettingWrite::CalibrateZero);
    assert_eq!(said(zero, "01 06 0005 0001"), Observation::Done);
    assert!(!host.repeatable(&zero));
    let read: Vec<Op> = host.full_poll().collect();
    assert_eq!(read, [Op::ReadOutputs, Op::ReadAnalogs]);
}
