//! Modbus RTU: `docs/datasheets/eda.md`, section 4.

use super::*;

/// [EDA §4.1]
#[test]
fn the_printed_crcs() {
    let printed = [
        "01 01 00 02 00 02 1C 0B",
        "01 01 01 02 D0 49",
        "01 01 00 00 00 10 3D C6",
        "01 01 02 02 00 B8 9C",
        "01 02 00 00 00 10 79 C6",
        "01 02 02 02 00 B8 D8",
        "01 02 00 01 00 03 69 CB",
        "01 02 01 02 20 49",
        "01 03 00 02 00 02 65 CB",
        "01 03 04 0D 64 00 00 B9 40",
        "01 05 00 00 FF 00 8C 3A",
        "01 05 00 01 00 00 9C 0A",
        "01 0F 00 00 00 10 02 05 00 E1 70",
        "01 0F 00 00 00 10 54 07",
        "01 10 00 00 00 01 02 02 06 27 32",
        "01 10 00 00 00 01 01 C9",
    ];
    for frame in printed.map(hex) {
        let (body, crc) = frame.split_at(frame.len() - 2);
        assert_eq!(crc16(body).to_le_bytes(), crc);
    }
}

/// Requests that both modules refuse, and the exception where they are to give one.
const REFUSED: [(&str, u8); 22] = [
    ("01 04 0000 0001", 1),
    ("01 04 0000 0000", 1),
    ("01 06 0000 0206", 1),
    ("01 07", 1),
    ("01 08 0000 0000", 1),
    ("01 0B", 1),
    ("01 0C", 1),
    ("01 11", 1),
    ("01 2B 0E 01 00", 1),
    ("01 01 0000 0011", 2),
    ("01 02 0000 0011", 2),
    ("01 02 0010 0001", 2),
    ("01 05 0010 FF00", 2),
    ("01 0F 0000 0011 03 000000", 2),
    ("01 10 0002 0001 02 0206", 2),
    ("01 01 0000 0000", 3),
    ("01 02 0000 07D1", 3),
    ("01 05 0000 0100", 3),
    ("01 05 0010 5500", 3),
    ("01 10 0000 0001 02 0006", 3),
    ("01 10 0000 0001 02 0208", 3),
    ("01 10 0000 0001 04 02060000", 3),
];

/// [EDA §4.2, §4.3, §4.12]
#[test]
fn what_modbus_refuses() {
    for family in BOTH {
        let mut module = Bench::new(setup(family, Protocol::Rtu, 1));
        let mut aloud = with(setup(family, Protocol::Rtu, 1), ALOUD);
        for (request, exception) in REFUSED {
            is_silent_to(&mut module, &[request]);
            aloud.refuses(request, exception);
            // Requests for other modules, and broadcasts, are never answered.
            for address in ["00", "02"] {
                let request = request.replacen("01", address, 1);
                is_silent_to(&mut aloud, &[&request]);
            }
        }
    }
}

/// [EDA §4.4] an exception is an answer; that silence is one too is tested with the bus.
#[test]
fn host_takes_exceptions() {
    for family in BOTH {
        let host = host(setup(family, Protocol::Rtu, 1));
        for code in [1, 2, 3, 4, 0x60] {
            let reply = with_crc(&[1, 0x81, code]);
            let refused = Observation::Refused(Refusal::Exception(Exception(code)));
            assert_eq!(seen(&host, &Op::ReadOutputs, &reply), refused);
        }
    }
}

/// [EDA §4.6, §4.7, §4.8, §4.11]
#[test]
fn configuration_in_modbus() {
    for mut module in both(Protocol::Rtu, 1) {
        for invalid in ["0006", "0202", "0208", "0200", "02FF"] {
            is_silent_to(&mut module, &[&format!("01 10 0000 0001 02 {invalid}")]);
        }
        let acknowledged = Some(hex("01 10 00 00 00 01 01 C9"));
        assert_eq!(
            module.ask_hex("01 10 00 00 00 01 02 02 06 27 32"),
            acknowledged
        );
        assert_eq!(module.engine.active().address, Address(2));
        assert!(module.ask_rtu("02 10 0000 0001 02 0307").is_some());
        let active = module.engine.active();
        assert_eq!((active.address.0, active.serial.baud), (3, Baud::B19200));
    }
}

/// [EDA §4.9]
#[test]
fn address_0_in_modbus() {
    for family in BOTH {
        let setup = setup(family, Protocol::Rtu, 1);
        let address = Address(0);
        let eeprom = Eeprom {
            address,
            ..Eeprom::of(&setup)
        };
        for options in [Options::default(), ALOUD] {
            let mut module = Bench::with(setup, eeprom, options);
            for unheard in ["00 01 0000 0004", "00 04 0000 0001", "01 05 0000 FF00"] {
                is_silent_to(&mut module, &[unheard]);
            }
            assert_eq!(module.ask_rtu("00 05 0001 FF00"), None);
            assert_eq!(module.engine.outputs(), 0b10);
            assert_eq!(module.ask_rtu("00 10 0000 0001 02 0506"), None);
            assert!(module.ask_rtu("05 01 0000 0004").is_some());
        }
    }
}

/// [EDA §4.10]
#[test]
fn host_never_has_a_modbus_module_at_0() {
    for family in BOTH {
        let at = |address| setup(family, Protocol::Rtu, address);
        assert_eq!(at(0).check(), Err(SetupError::Address(1, 255)));
        assert!((1..=255).all(|address| at(address).check() == Ok(())));
        let host = host(at(1));
        assert!(host.exchange(&serial(0, Baud::B9600, false)).is_err());
        assert!(host.exchange(&serial(255, Baud::B9600, false)).is_ok());
    }
}

/// [EDA §4.13] whatever the switches say.
#[test]
fn a_wrong_crc_is_ignored() {
    let requests = [
        "01 01 0000 0004",
        "01 05 0000 FF00",
        "01 0F 0000 0004 01 0F",
        "01 10 0000 0001 02 0207",
    ];
    let noisy = Options {
        answer_bad_frames: true,
        ..ALOUD
    };
    for options in [Options::default(), noisy] {
        for family in BOTH {
            let mut module = with(setup(family, Protocol::Rtu, 1), options);
            for request in requests.map(|text| with_crc(&hex(text))) {
                damaged(&request).for_each(|frame| module.ignores(&frame));
            }
        }
    }
}

/// [EDA §4.14]
#[test]
fn broadcasts_in_modbus() {
    for mut module in both(Protocol::Rtu, 1) {
        for (request, outputs) in [("00 05 0002 FF00", 4), ("00 0F 0000 0004 01 09", 9)] {
            assert_eq!(module.ask_rtu(request), None);
            assert_eq!(module.engine.outputs(), outputs);
        }
        for read in ["00 01 0000 0004", "00 02 0000 0004", "00 03 0000 0001"] {
            is_silent_to(&mut module, &[read]);
        }
        assert_eq!(module.ask_rtu("00 10 0000 0001 02 0907"), None);
        let active = module.engine.active();
        assert_eq!((active.address.0, active.serial.baud), (9, Baud::B19200));
    }
}
