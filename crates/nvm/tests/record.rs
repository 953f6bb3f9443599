//! Records and their bytes.

mod support;

use proptest::collection::vec;
use proptest::prelude::*;
use railbus_device::{
    AnalogCalibration, Applies, Eeprom, Engine, Extensions, Family, Input, Layout,
};
use railbus_device::{Effect, Options, Output, Setup};
use railbus_nvm::{Record, RecordError, Unreadable};
use railbus_wire::{
    Address, Baud, Character, Instant, Micros, Protocol, PulseWidth, SerialSettings,
};
use support::{factory, record};

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.chunks(2).map(byte).collect()
}

/// A module with something in every place.
fn full() -> Record {
    let setup = Setup {
        outputs: 16,
        inputs: 14,
        variables: 9,
        layout: Layout::Mixed,
        invert_on_off: true,
        gap: Some(Micros(0x0102_0304)),
        ..Setup::new(Family::R55, Address(1))
    };
    let options = Options {
        turnaround: Micros(0x0A0B_0C0D),
        applies: Applies::AddressAfterReply,
        refuse_aloud: true,
        lower_case: false,
        answer_bad_frames: true,
        insist_on_gap: false,
        extensions: true,
    };
    let eeprom = Eeprom {
        address: Address(0x42),
        serial: SerialSettings::FACTORY,
        protocol: Protocol::R55,
        checksum: true,
        pulse_mask: 0x0A,
        pulse_width: PulseWidth::from_tenths(200).unwrap(),
        calibration: AnalogCalibration {
            voltage: 0x1122,
            zero: [-2, 0x3344],
            span: [(0x5566, 0x7788), (0x99AA, 0xBBCC)],
        },
        extensions: Extensions {
            watchdog: 0x77,
            power_on: 0xDEAD_BEEF,
            safe: 0x0102_0408,
            tripped: true,
        },
    };
    Record::new(&setup, options, eeprom).unwrap()
}

/// What firmware has written stays readable: these bytes are never changed.
#[test]
fn version_1_is_what_it_was() {
    let bytes = hex("
        01  04 10 0E 09 02 03  04030201
        15 02  0D0C0B0A
        42 04 80250000 00 01 0A C8  2211 FEFF4433 66558877 AA99CCBB
        77 EFBEADDE 08040201 01");
    assert_eq!(full().encode()[..], bytes);
    assert_eq!(Record::decode(&bytes), Ok(full()));
    assert_eq!(bytes.len(), Record::LEN);
}

#[test]
fn version_1_of_each_family_is_what_it_was() {
    let tail = "000000000000 0000 00000000";
    let neutral = "F401 00000000 F401F401 F401F401 00 00000000 00000000 00";
    let expected = [
        (
            Family::Eda9060a,
            "01 01 04 04 00",
            "07 02 80250000 00 00 00 0A",
        ),
        (
            Family::Eda9050,
            "01 02 08 07 00",
            "07 02 80250000 00 00 00 0A",
        ),
        (Family::Erc8, "01 03 08 00 00", "07 01 80250000 00 00 00 0A"),
        (Family::R55, "01 04 20 00 00", "07 04 80250000 00 00 00 0A"),
        (
            Family::Emd2a2q,
            "01 05 02 00 00",
            "07 01 80250000 00 00 00 0A",
        ),
    ];
    for (family, head, settings) in expected {
        let bytes = hex(&[head, tail, settings, neutral].concat());
        assert_eq!(factory(family, 7).encode()[..], bytes, "{family}");
    }
}

#[test]
fn a_newer_version_is_refused_whatever_it_holds() {
    let mut bytes = full().encode().to_vec();
    for version in 2..=255 {
        bytes[0] = version;
        assert_eq!(Record::decode(&bytes), Err(Unreadable::Newer(version)));
        assert_eq!(Record::decode(&[version]), Err(Unreadable::Newer(version)));
    }
    bytes[0] = 0;
    assert_eq!(Record::decode(&bytes), Err(Unreadable::Malformed));
    assert_eq!(Record::decode(&[]), Err(Unreadable::Malformed));
}

#[test]
fn what_is_cut_short_or_too_long_is_nothing() {
    let bytes = &full().encode()[..];
    for len in 1..bytes.len() {
        assert_eq!(Record::decode(&bytes[..len]), Err(Unreadable::Malformed));
    }
    let longer = [bytes, &[0]].concat();
    assert_eq!(Record::decode(&longer), Err(Unreadable::Malformed));
}

#[test]
fn codes_and_switches_that_no_version_1_writes_are_refused() {
    let bad = [
        (1, 0),     // family
        (1, 6),     // family
        (2, 17),    // outputs of a mixed board
        (4, 33),    // variables
        (5, 3),     // layout
        (6, 4),     // switches
        (11, 0x20), // options
        (12, 3),    // applies
        (17, 245),  // the broadcast address
        (18, 0),    // protocol
        (18, 1),    // a protocol that the family does not speak
        (19, 0x81), // speed
        (23, 4),    // characters
        (23, 1),    // characters that the family does not have
        (24, 2),    // checksum
        (26, 0),    // pulse width
        (26, 201),  // pulse width
        (50, 2),    // tripped
    ];
    for (at, value) in bad {
        let mut bytes = full().encode().to_vec();
        bytes[at] = value;
        let read = Record::decode(&bytes);
        assert_eq!(read, Err(Unreadable::Malformed), "{value} at {at}");
    }
}

#[test]
fn times_that_do_not_fit_are_refused() {
    let fits = Micros(u32::MAX.into());
    let long = fits + Micros(1);
    let setup = Setup::new(Family::Erc8, Address(1));
    let with = |gap, turnaround| {
        let setup = Setup { gap, ..setup };
        let options = Options {
            turnaround,
            ..Options::default()
        };
        Record::new(&setup, options, Eeprom::of(&setup)).map(|_| ())
    };
    assert_eq!(with(Some(fits), fits), Ok(()));
    assert_eq!(with(Some(long), fits), Err(RecordError::Long));
    assert_eq!(with(None, long), Err(RecordError::Long));
}

/// The setup handed to the engine says what the settings say.
#[test]
fn the_settings_count() {
    let setup = Setup::new(Family::Eda9060a, Address(1));
    let eeprom = Eeprom {
        address: Address(9),
        serial: SerialSettings {
            baud: Baud::B19200,
            character: Character::N1,
        },
        protocol: Protocol::Ascii,
        checksum: true,
        ..Eeprom::of(&setup)
    };
    let record = Record::new(&setup, Options::default(), eeprom).unwrap();
    let kept = record.setup();
    assert_eq!((kept.address, kept.serial), (Address(9), eeprom.serial));
    assert!(kept.checksum);
}

#[derive(Clone, Debug)]
enum Happens {
    Hears(String, bool),
    HearsBytes(Vec<u8>),
    Init(bool),
    Waits(u32),
}

fn happens() -> impl Strategy<Value = Happens> {
    let config = prop_oneof![
        "%01[0-9A-F]{2}400[0-9A-F](00|40)",
        "%[0-9A-F]{2}[0-9A-F]{2}400[0-9](00|40)",
        "~01[0-9A-F]{6}",
    ];
    prop_oneof![
        6 => (config, any::<bool>()).prop_map(|(text, sum)| Happens::Hears(text, sum)),
        3 => (0..=8_u8, 0..=70_u16, any::<u16>()).prop_map(|(address, at, value)| {
            let [at, value] = [at.to_be_bytes(), value.to_be_bytes()];
            let mut frame = vec![address, 6, at[0], at[1], value[0], value[1]];
            frame.extend(railbus_wire::crc16(&frame).to_le_bytes());
            Happens::HearsBytes(frame)
        }),
        1 => vec(any::<u8>(), 0..12).prop_map(Happens::HearsBytes),
        2 => any::<bool>().prop_map(Happens::Init),
        3 => (0..1_000_000_u32).prop_map(Happens::Waits),
    ]
}

/// Lets things happen to a module; all that it wants kept.
fn saves(record: &Record, happens: &[Happens]) -> Vec<Eeprom> {
    let mut now = Instant(0);
    let engine = Engine::new(record.setup(), record.eeprom(), record.options(), now);
    let mut engine = engine.expect("what is kept is a possible module");
    let mut saved = Vec::new();
    for event in happens {
        now = now + Micros(20_000);
        match event {
            Happens::Hears(text, sum) => {
                let check = if *sum {
                    format!("{:02X}", railbus_wire::sum8(text.as_bytes()))
                } else {
                    String::new()
                };
                engine.handle(now, Input::Bytes(format!("{text}{check}\r").as_bytes()));
            }
            Happens::HearsBytes(bytes) => engine.handle(now, Input::Bytes(bytes)),
            Happens::Init(grounded) => engine.handle(now, Input::Init(*grounded)),
            Happens::Waits(micros) => now = now + Micros((*micros).into()),
        }
        for _ in 0..100 {
            match engine.poll() {
                Output::Effect(Effect::Save(eeprom)) => saved.push(eeprom),
                Output::Effect(_) => {}
                Output::Transmit(_) => engine.handle(now, Input::Sent),
                Output::Wait(Some(at)) => {
                    now = now.max(at);
                    engine.handle(now, Input::Timeout);
                    if at > now + Micros::from_secs(1) {
                        break;
                    }
                }
                Output::Wait(None) => break,
            }
        }
    }
    saved
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn every_record_comes_back(record in record()) {
        prop_assert_eq!(Record::decode(&record.encode()), Ok(record));
    }

    #[test]
    fn any_bytes_are_nothing_or_a_possible_module(bytes in vec(any::<u8>(), 0..128)) {
        if let Ok(record) = Record::decode(&bytes) {
            prop_assert_eq!(record.setup().check(), Ok(()));
        }
    }

    /// One wrong byte in a good record, the CRC notwithstanding.
    #[test]
    fn a_changed_byte_is_nothing_or_a_possible_module(
        record in record(), at in 0..Record::LEN, value: u8,
    ) {
        let mut bytes = record.encode().to_vec();
        bytes[at] = value;
        if let Ok(read) = Record::decode(&bytes) {
            prop_assert_eq!(read.setup().check(), Ok(()));
            prop_assert_eq!(read.encode().len(), Record::LEN);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3_000))]

    /// Whatever a module receives, what it wants stored can be stored, and makes the same module.
    #[test]
    fn what_a_module_wants_kept_can_be_kept(record in record(), happens in vec(happens(), 0..30)) {
        for eeprom in saves(&record, &happens) {
            let kept = record.with(eeprom);
            let back = kept.ok().map(|kept| Record::decode(&kept.encode()));
            prop_assert_eq!(back.map(|back| back.map(|back| back.eeprom())), Some(Ok(eeprom)));
        }
    }
}
