//! In ASCII: the commands of DCON modules.

use super::support::{Bench, sealed};
use super::{HALF_SECOND, module, setup};
use railbus_device::{Extensions, Family, Op, Setup};
use railbus_wire::Protocol;

fn both() -> [Bench; 2] {
    [Family::Eda9060a, Family::Eda9050]
        .map(|family| module(setup(family, Protocol::Ascii), Extensions::NEUTRAL))
}

fn converse(module: &mut Bench, conversation: &[(&str, Option<&str>)]) {
    for (request, reply) in conversation {
        let said = module.ask_text(request);
        assert_eq!(said.as_deref(), *reply, "{request}");
    }
}

#[test]
fn the_firmware_says_whose_it_is() {
    // [BEYOND §2.1]; the name stays the datasheet's.
    let version = format!("!01railbus {}", env!("CARGO_PKG_VERSION"));
    for mut module in both() {
        assert_eq!(
            module.ask_text("$01F"),
            Some(version[..version.len().min(19)].to_owned())
        );
        let seen = module.op(Op::Identify).expect("a name");
        assert!(module.host().recognises(&seen));
    }
}

#[test]
fn the_watchdog_is_set_read_and_cleared() {
    // [BEYOND §1.7, §1.8, §1.9, §2.3, §2.4, §2.5]
    for mut module in both() {
        converse(
            &mut module,
            &[
                ("~010", Some("!0100")),
                ("~012", Some("!01000")),
                ("~014", Some("!010000")),
                ("~0150201", Some("!01")),
                ("~014", Some("!010201")),
                ("~013114", Some("!01")),
                ("~012", Some("!01114")),
                ("~010", Some("!0180")),
                ("#011001", Some(">")),
            ],
        );
        module.wait(2_100);
        assert_eq!(module.engine.outputs(), 0b01);
        let state = match module.setup.outputs {
            4 => "!010F00",
            _ => "!017F00",
        };
        converse(
            &mut module,
            &[
                ("~010", Some("!0184")),
                ("#011101", Some("!")),
                ("$016", Some(state)),
                ("~013105", Some("!01")),
                ("~010", Some("!0184")),
                ("~011", Some("!01")),
                ("~010", Some("!0180")),
            ],
        );
        assert_eq!(module.engine.outputs(), 0b01, "clearing moves nothing");
        converse(&mut module, &[("#011101", Some(">"))]);
        assert_eq!(module.engine.outputs(), 0b11);
        module.wait(600);
        assert!(module.engine.eeprom().extensions.tripped, "it watches anew");
        converse(
            &mut module,
            &[
                ("~013005", Some("!01")),
                ("~012", Some("!01000")),
                ("~011", Some("!01")),
                ("~010", Some("!0100")),
            ],
        );
        module.wait(60_000);
        assert!(!module.engine.eeprom().extensions.tripped);
    }
}

#[test]
fn what_can_not_be_is_refused() {
    // [BEYOND §2.4, §2.5, §2.6]
    for mut module in both() {
        let absent = if module.setup.outputs == 4 {
            &[("~0151000", Some("?01")), ("~0150010", Some("?01"))][..]
        } else {
            &[]
        };
        let before = *module.engine.eeprom();
        converse(
            &mut module,
            &[
                ("~013100", Some("?01")),
                ("~0132FF", None),
                ("~01Oname", None),
                ("~018", None),
            ],
        );
        converse(&mut module, absent);
        converse(&mut module, &[("~020", None), ("~**", None), ("#**", None)]);
        assert_eq!(*module.engine.eeprom(), before);
    }
}

#[test]
fn host_ok_feeds_with_and_without_a_checksum() {
    // [BEYOND §2.2]
    for checksum in [false, true] {
        let setup = Setup {
            checksum,
            ..setup(Family::Eda9050, Protocol::Ascii)
        };
        let mut module = module(setup, HALF_SECOND);
        let alive = match checksum {
            true => sealed("~**"),
            false => b"~**\r".to_vec(),
        };
        for _ in 0..6 {
            assert_eq!(module.ask(&alive), None);
        }
        assert!(!module.engine.eeprom().extensions.tripped);
        // `#**` does not feed the watchdog.
        let sample = if checksum {
            sealed("#**")
        } else {
            b"#**\r".to_vec()
        };
        for _ in 0..3 {
            assert_eq!(module.ask(&sample), None);
        }
        assert!(module.engine.eeprom().extensions.tripped);
    }
}
