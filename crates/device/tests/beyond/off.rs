//! With the extensions switched off, a module follows its datasheet only.

use super::support::{Bench, hex, with_crc};
use super::{HALF_SECOND, setup, setups};
use railbus_device::{Eeprom, Extensions, Family, Options};
use railbus_wire::Protocol;

#[test]
fn off_by_default() {
    // [BEYOND §1.11]
    assert!(!Options::default().extensions);
    for setup in setups() {
        assert_eq!(Eeprom::of(&setup).extensions, Extensions::NEUTRAL);
    }
}

#[test]
fn what_is_kept_has_no_effect_and_no_command_is_known() {
    // [BEYOND §1.11]
    for setup in setups() {
        let eeprom = Eeprom {
            extensions: Extensions {
                tripped: true,
                ..HALF_SECOND
            },
            ..Eeprom::of(&setup)
        };
        let mut module = Bench::with(setup, eeprom, Options::default());
        assert_eq!(module.engine.outputs(), 0, "{setup:?}");
        module.wait(60_000);
        assert_eq!(module.engine.outputs(), 0, "{setup:?}");
        match (setup.protocol, setup.family) {
            (Protocol::Ascii, _) => {
                for text in [
                    "$01F", "~010", "~011", "~012", "~013105", "~014", "~0150000", "~**",
                ] {
                    module.ignores(format!("{text}\r").as_bytes());
                }
            }
            (Protocol::Rtu, Family::Erc8 | Family::Emd2a2q) => {
                for text in [
                    "01 08 0000 A55A",
                    "01 08 000A 0000",
                    "01 08 0000",
                    "01 2B 0E 01 00",
                ] {
                    module.refuses(text, 1);
                }
                module.refuses("01 03 BE00 0001", 2);
                module.refuses("01 06 BE00 0000", 2);
            }
            (Protocol::Rtu, _) => {
                for text in [
                    "01 08 0000 A55A",
                    "01 2B 0E 01 00",
                    "01 03 BE00 0001",
                    "01 06 BE01 0005",
                ] {
                    module.ignores(&with_crc(&hex(text)));
                }
            }
            (Protocol::R55, _) => {
                let frame = hex("55 01 70 000000 E1 A7");
                module.ignores(&frame);
            }
            (Protocol::Lc02, _) => {}
        }
        let op = railbus_device::Op::Write(railbus_device::Bank::new(1, 1));
        assert!(module.op(op).is_some());
        assert_eq!(module.engine.outputs(), 1, "nothing is locked");
    }
}

#[test]
fn aloud_refusals_stay_as_they_are() {
    // With the datasheet's switch on, the order of checks is that of a module without 08 and 2B.
    let aloud = Options {
        refuse_aloud: true,
        ..Options::default()
    };
    let eda = setup(Family::Eda9050, Protocol::Rtu);
    let mut module = Bench::with(eda, Eeprom::of(&eda), aloud);
    for text in [
        "01 08 0000 A55A",
        "01 08 00",
        "01 2B 0E 01 00",
        "01 2B 0E",
        "01 2B 0D",
    ] {
        module.refuses(text, 1);
    }
}
