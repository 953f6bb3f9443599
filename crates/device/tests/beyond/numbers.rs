//! The settings as registers and as variables.

use super::support::{Bench, hex, with_crc};
use super::{HALF_SECOND, module, setup, setups};
use railbus_device::{Eeprom, Extensions, Family, Layout, Setup};
use railbus_wire::Protocol;

fn modbus() -> impl Iterator<Item = Bench> {
    let setups = setups().filter(|setup| setup.protocol == Protocol::Rtu);
    setups.map(|setup| module(setup, Extensions::NEUTRAL))
}

fn board() -> Bench {
    module(setup(Family::R55, Protocol::R55), Extensions::NEUTRAL)
}

#[test]
fn registers_hold_the_settings() {
    // [BEYOND §3.1, §3.2]
    for mut module in modbus() {
        let told = |module: &mut Bench, text: &str| module.ask_rtu(text);
        let mut says = |request: &str, reply: &str| {
            assert_eq!(told(&mut module, request), Some(hex(reply)), "{request}");
        };
        says("01 03 BE00 0006", "01 03 0C 0000 0000 0000 0000 0000 0000");
        says("01 06 BE01 0005", "01 06 BE01 0005");
        says("01 10 BE02 0004 08 0002 0000 0001 0000", "01 10 BE02 0004");
        says("01 03 BE00 0006", "01 03 0C 0080 0005 0002 0000 0001 0000");
        assert_eq!(module.engine.eeprom().extensions, HALF_SECOND);
        module.wait(600);
        let mut says = |request: &str, reply: &str| {
            assert_eq!(told(&mut module, request), Some(hex(reply)), "{request}");
        };
        says("01 03 BE00 0001", "01 03 02 0084");
        says("01 06 BE00 0000", "01 06 BE00 0000");
        says("01 03 BE00 0001", "01 03 02 0080");
        assert_eq!(module.engine.outputs(), 0b01);
        module.power_cycle();
        assert_eq!(module.engine.outputs(), 0b10);
    }
}

#[test]
fn registers_refuse_as_the_standard_does_and_then_do_nothing() {
    // [BEYOND §3.2, §3.3, §3.4]
    for mut module in modbus() {
        for (request, code) in [
            ("01 06 BE00 0001", 3),
            ("01 06 BE01 0100", 3),
            ("01 06 BE02 0100", 3),
            ("01 06 BE03 0001", 3),
            ("01 06 BE05 8000", 3),
            ("01 03 BE05 0002", 2),
            ("01 03 BE00 0007", 2),
            ("01 10 BE05 0002 04 0000 0000", 2),
            // The first of the two would be valid.
            ("01 10 BE01 0002 04 0005 0100", 3),
        ] {
            module.refuses(request, code);
        }
    }
}

#[test]
fn a_request_to_all_configures_nobody() {
    // [BEYOND §3.5, §3.7]
    for mut module in modbus() {
        for request in [
            "00 06 BE01 0005",
            "00 10 BE01 0001 02 0005",
            "00 03 BE00 0001",
        ] {
            module.ignores(&with_crc(&hex(request)));
        }
    }
    let mut board = board();
    let before = *board.engine.eeprom();
    assert_eq!(board.ask_r55("F5 71 000005 E1"), None);
    assert_eq!(*board.engine.eeprom(), before);
}

#[test]
fn variables_hold_the_settings_of_a_board() {
    // [BEYOND §3.6]
    let mut board = board();
    let mut says = |request: &str, reply: Option<&str>| {
        assert_eq!(board.ask_r55(request), reply.map(hex), "{request}");
    };
    says("01 70 000000 E1", Some("01 70 000000 E1"));
    says("01 71 000005 E1", Some("01 71 000005 E1"));
    says("01 71 000002 E2", Some("01 71 000002 E2"));
    says("01 71 000001 E4", Some("01 71 000001 E4"));
    says("01 70 000000 E0", Some("01 70 000080 E0"));
    for refused in [
        "01 71 000001 E0",
        "01 71 000100 E1",
        "01 71 000100 E2",
        "01 71 000001 E3",
        "01 71 010000 E4",
        "01 71 000000 E6",
        "01 70 000000 E6",
        "01 70 000000 00",
    ] {
        says(refused, None);
    }
    assert_eq!(board.engine.eeprom().extensions, HALF_SECOND);
    board.wait(600);
    assert_eq!(board.engine.outputs(), 0b01);
    let mut says = |request: &str, reply: &str| {
        assert_eq!(board.ask_r55(request), Some(hex(reply)), "{request}");
    };
    says("01 70 000000 E0", "01 70 000084 E0");
    says("01 71 000000 E0", "01 71 000000 E0");
    says("01 12 00000002", "01 12 00000003");
}

#[test]
fn a_board_with_32_outputs_has_them_all() {
    // [BEYOND §3.1, §3.6]
    let setup = Setup {
        layout: Layout::Outputs,
        outputs: 32,
        ..setup(Family::R55, Protocol::R55)
    };
    let mut board = module(setup, Extensions::NEUTRAL);
    for request in [
        "01 71 00BEEF E4",
        "01 71 00DEAD E5",
        "01 71 000001 E3",
        "01 71 000001 E1",
    ] {
        assert!(board.ask_r55(request).is_some(), "{request}");
    }
    assert_eq!(
        board.ask_r55("01 70 000000 E5"),
        Some(hex("01 70 00DEAD E5"))
    );
    board.wait(600);
    assert_eq!(board.engine.outputs(), 0xDEAD_BEEF);
    assert_eq!(board.engine.eeprom().extensions.power_on, 0x0001_0000);
}

#[test]
fn what_is_set_in_one_protocol_acts_in_the_other() {
    // [BEYOND §3.8]
    let mut pin = module(setup(Family::Eda9050, Protocol::Ascii), HALF_SECOND);
    pin.input(railbus_device::Input::Init(true));
    pin.ignores(b"~010\r");
    pin.wait(600);
    assert!(pin.engine.eeprom().extensions.tripped);
    assert_eq!(pin.engine.outputs(), 0b01);
    pin.input(railbus_device::Input::Init(false));
    assert_eq!(pin.ask_text("~010").as_deref(), Some("!0184"));
    assert_eq!(pin.ask_text("~011").as_deref(), Some("!01"));
}

#[test]
fn a_restore_leaves_it_alone() {
    // [BEYOND §1.3]
    let mut emd = module(setup(Family::Emd2a2q, Protocol::Rtu), HALF_SECOND);
    assert!(emd.ask_rtu("01 06 0005 0004").is_some());
    let kept: Eeprom = *emd.engine.eeprom();
    assert_eq!(kept.extensions, HALF_SECOND);
}
