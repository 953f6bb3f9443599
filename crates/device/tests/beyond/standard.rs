//! Functions 08 and 2B.

use super::support::{Bench, hex, with_crc};
use super::{HALF_SECOND, module, setup, setups};
use railbus_device::{Extensions, Family, Input};
use railbus_wire::rtu::{Exchange, Identification, Request, Response};
use railbus_wire::{Address, Protocol};

fn modbus() -> impl Iterator<Item = Bench> {
    let setups = setups().filter(|setup| setup.protocol == Protocol::Rtu);
    setups.map(|setup| module(setup, Extensions::NEUTRAL))
}

fn counter(module: &mut Bench, sub: u8) -> u16 {
    let reply = module.ask_rtu(&format!("01 08 00{sub:02X} 0000"));
    let reply = reply.expect("a counter");
    assert_eq!(reply[..4], [1, 8, 0, sub]);
    u16::from_be_bytes([reply[4], reply[5]])
}

#[test]
fn an_echo_comes_back() {
    // [BEYOND §4.1, §4.2, §4.6]
    for mut module in modbus() {
        assert_eq!(
            module.ask_rtu("01 08 0000 A55A"),
            Some(hex("01 08 0000 A55A"))
        );
        assert_eq!(
            module.ask_rtu("01 08 0002 0000"),
            Some(hex("01 08 0002 0000"))
        );
        for (request, code) in [
            ("01 08 0001 0000", 1),
            ("01 08 0004 0000", 1),
            ("01 08 0013 0000", 1),
            ("01 08 0002 0001", 3),
            ("01 08 000B 0100", 3),
            ("01 08 000A 0100", 3),
            ("01 08 0000 A55A A55A", 3),
            ("01 08 0000", 3),
        ] {
            module.refuses(request, code);
        }
        module.ignores(&with_crc(&hex("00 08 000A 0000")));
        assert_eq!(
            module.ask_rtu("01 06 BE01 00FF"),
            Some(hex("01 06 BE01 00FF"))
        );
        assert_eq!(
            module.ask_rtu("01 08 0002 0000"),
            Some(hex("01 08 0002 0080"))
        );
    }
}

#[test]
fn what_was_heard_is_counted() {
    // [BEYOND §4.3, §4.5]
    for mut module in modbus() {
        let refused = match module.setup.family {
            Family::Erc8 | Family::Emd2a2q => Some(with_crc(&[1, 0xC1, 1])),
            _ => None,
        };
        let silent = u16::from(refused.is_none());
        assert_eq!(module.ask(&with_crc(&[2, 1, 0, 0, 0, 1])), None);
        assert_eq!(module.ask(&with_crc(&[0, 5, 0, 0, 0, 0])), None);
        assert_eq!(module.ask(&with_crc(&[1, 0x41, 9])), refused);
        assert_eq!(module.ask(&[1, 1, 0, 0, 0, 1, 0xFF, 0xFF]), None);
        assert_eq!(module.ask(&[1, 1]), None);
        module.input(Input::BadByte);
        module.wait(50);
        module.input(Input::Overrun);
        module.wait(50);
        let long = [0x55; 300];
        assert_eq!(module.ask(&long), None);
        assert_eq!(
            counter(&mut module, 0x0B),
            4,
            "two, the unknown, and this one"
        );
        assert_eq!(counter(&mut module, 0x0C), 5, "CRC, short, bad, lost, long");
        assert_eq!(counter(&mut module, 0x0D), 1 - silent);
        assert_eq!(counter(&mut module, 0x0E), 6);
        assert_eq!(counter(&mut module, 0x0F), 1 + silent);
        assert_eq!(counter(&mut module, 0x10), 0);
        assert_eq!(counter(&mut module, 0x11), 0);
        assert_eq!(counter(&mut module, 0x12), 1);
        assert_eq!(
            module.ask_rtu("01 08 0014 0000"),
            Some(hex("01 08 0014 0000"))
        );
        assert_eq!(counter(&mut module, 0x12), 0);
        assert_eq!(counter(&mut module, 0x0C), 5);
        assert_eq!(
            module.ask_rtu("01 08 000A 0000"),
            Some(hex("01 08 000A 0000"))
        );
        assert_eq!(counter(&mut module, 0x0B), 1);
        assert_eq!(counter(&mut module, 0x0C), 0);
    }
}

#[test]
fn a_counter_stays_at_its_end() {
    // [BEYOND §4.4]
    let mut module = module(setup(Family::Erc8, Protocol::Rtu), Extensions::NEUTRAL);
    for _ in 0..70_000 {
        module.input(Input::Overrun);
    }
    module.wait(50);
    assert_eq!(counter(&mut module, 0x12), 0xFFFF);
    assert_eq!(
        counter(&mut module, 0x0C),
        1,
        "all of them spoilt one frame"
    );
    module.power_cycle();
    assert_eq!(counter(&mut module, 0x12), 0);
}

#[test]
fn a_lost_character_spoils_its_frame() {
    // [BEYOND §4.7]
    for setup in setups() {
        let mut module = module(setup, HALF_SECOND);
        let host = module.host();
        let op = railbus_device::Op::ReadOutputs;
        let ask = super::support::request(&host, &op).expect("a frame");
        module.wait(50);
        module.send(&ask[..3]);
        module.input(Input::Overrun);
        module.send(&ask[3..]);
        let end = module.now + railbus_wire::Micros::from_millis(100);
        assert_eq!(module.run_until(end), None, "{setup:?}");
        assert!(module.ask(&ask).is_some(), "{setup:?}");
    }
}

fn identification(module: &mut Bench, code: u8, object: u8) -> Vec<(u8, String)> {
    let exchange = Exchange {
        address: Address(1),
        request: Request::Identify { code, object },
    };
    let request = [1, 0x2B, 0x0E, code, object];
    let reply = module.ask(&with_crc(&request)).expect("an identification");
    match exchange
        .decode_response(&reply)
        .whole()
        .map(|reply| reply.response)
    {
        Some(Response::Identification(says)) => says
            .objects()
            .map(|(number, text)| (number, String::from_utf8(text.to_vec()).expect("ASCII")))
            .collect(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_module_says_what_it_is() {
    // [BEYOND §5.1, §5.2, §5.3]
    for mut module in modbus() {
        let profile = module.setup.family.profile();
        let version = env!("CARGO_PKG_VERSION");
        let texts = [
            "railbus",
            profile.name,
            version,
            env!("CARGO_PKG_REPOSITORY"),
            profile.model,
        ];
        let all: Vec<(u8, String)> = (0..).zip(texts.map(str::to_owned)).collect();
        for (code, object, wanted) in [
            (1, 0, &all[..3]),
            (1, 2, &all[2..3]),
            (1, 3, &all[..3]),
            (2, 0, &all),
            (2, 3, &all[3..]),
            (3, 9, &all),
            (4, 2, &all[2..3]),
            (4, 4, &all[4..]),
        ] {
            assert_eq!(
                identification(&mut module, code, object),
                wanted,
                "{code} {object}"
            );
        }
        assert_eq!(all[usize::from(Identification::REVISION)].1, version);
    }
}

#[test]
fn what_it_can_not_say_is_refused() {
    // [BEYOND §5.3, §5.4]
    for mut module in modbus() {
        for (request, code) in [
            ("01 2B 0E 04 05", 2),
            ("01 2B 0E 00 00", 3),
            ("01 2B 0E 05 00", 3),
            ("01 2B 0E 01", 3),
            ("01 2B 0E 01 00 00", 3),
            ("01 2B 0D 01 00", 1),
            ("01 2B", 1),
        ] {
            module.refuses(request, code);
        }
        module.ignores(&with_crc(&hex("00 2B 0E 01 00")));
    }
}
