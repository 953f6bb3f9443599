//! LC-02: `docs/datasheets/eda.md`, section 3.

use super::*;

/// [EDA §3.2] 0D is a byte like others, and the end byte is not looked for.
#[test]
fn lc02_goes_by_length() {
    for mut module in both(Protocol::Lc02, 0x0D) {
        assert!(module.ask(&lc02("0D 04 FF 0D")).is_some());
        assert_eq!(module.engine.outputs(), 0x0D);
        for end in [0x00, 0x0A, 0x0C, 0x8D] {
            let mut request = lc02("0D 04 FF 00");
            *request.last_mut().expect("an end") = end;
            module.ignores(&request);
        }
        let host = module.host();
        let reply = hex("6C 63 0D 0D 0D 27 0D");
        assert!(matches!(
            seen(&host, &Op::ReadOutputs, &reply),
            Observation::Channels { .. }
        ));
        let exchange = host.exchange(&Op::ReadOutputs).expect("a frame");
        for more in 1..reply.len() {
            let beginning = exchange.decode_response(&reply[..reply.len() - more]);
            assert_eq!(beginning, Decoded::Partial { more });
        }
        let wrong_end = hex("6C 63 0D 0D 0D 27 0A");
        let wrong_end = exchange.decode_response(&wrong_end);
        assert_eq!(wrong_end, Decoded::Malformed(Malformed::End));
    }
}

/// [EDA §3.7]
#[test]
fn model_numbers_in_bcd_and_binary() {
    let models = [
        (Family::Eda9060a, ["06 90 60 00 F7", "06 23 64 00 8E"]),
        (Family::Eda9050, ["06 90 50 00 E7", "06 23 5A 00 84"]),
    ];
    for (family, replies) in models {
        for (of, _) in models {
            let host = host(setup(of, Protocol::Lc02, 1));
            for reply in replies {
                let model = seen(&host, &Op::Identify, &hex(&format!("6C 63 01 {reply} 0D")));
                assert_eq!(host.recognises(&model), of == family, "{model:?}");
            }
        }
    }
}

/// [EDA §3.8, §3.9, §3.10]
#[test]
fn configuration_in_lc02() {
    for family in BOTH {
        let setup = setup(family, Protocol::Lc02, 1);
        let eeprom = Eeprom {
            checksum: true,
            ..Eeprom::of(&setup)
        };
        let mut module = Bench::with(setup, eeprom, Options::default());
        for third in ["01", "40", "FF"] {
            is_silent_to(&mut module, &[&format!("01 02 02 07 {third}")]);
        }
        let change = serial(2, Baud::B19200, false);
        for reply in ["6C 63 01 01 0D", "6C 63 02 02 0D"] {
            assert_eq!(
                seen(&module.host(), &change, &hex(reply)),
                Observation::Done
            );
        }
        assert_eq!(
            module.ask(&lc02("01 02 02 07 00")),
            Some(hex("6C 63 01 01 0D"))
        );
        let active = *module.engine.active();
        assert_eq!((active.address.0, active.serial.baud), (2, Baud::B19200));
        assert!(active.checksum && module.engine.eeprom().checksum);
        assert!(module.ask(&lc02("02 03")).is_some());
    }
}

/// [EDA §3.15, §3.16]
#[test]
fn what_lc02_ignores() {
    let valid = [
        "01 01",
        "01 02 02 07 00",
        "01 03",
        "01 04 FF 0F",
        "01 04 02 01",
    ]
    .map(lc02);
    let wrong = [
        "02 03",
        "00 03",
        "02 04 FF 0F", // for others
        "01 00",
        "01 07",
        "01 08",
        "01 30 0E",
        "01 FF",
        "01 03 00", // unknown
        "01 02 02 02 00",
        "01 02 02 08 00",
        "01 02 02 00 00", // speeds
        "01 04 08 01",
        "01 04 FE 01",
        "01 04 00 02",
        "01 04 00 FF", // channels and states
    ];
    for mut module in both(Protocol::Lc02, 1) {
        for frame in valid.iter().flat_map(|request| damaged(request)) {
            // A turned bit in command or address may spoil the sum, never pass it.
            module.ignores(&frame);
        }
        is_silent_to(&mut module, &wrong);
        assert!(module.op(Op::ReadOutputs).is_some(), "and it still hears");
    }
}

/// [EDA §3.17]
#[test]
fn host_takes_the_right_length_from_the_right_module() {
    for family in BOTH {
        let host = host(setup(family, Protocol::Lc02, 1));
        let exchange = host.exchange(&Op::ReadOutputs).expect("a frame");
        let other = hex("6C 63 02 00 0F 11 0D");
        assert_eq!(
            exchange.decode_response(&other),
            Decoded::Malformed(Malformed::Address)
        );
        let (short, long) = ("6C 63 01 01 0D", "6C 63 01 06 90 60 00 F7 0D");
        assert_eq!(
            exchange.decode_response(&hex(short)),
            Decoded::Partial { more: 2 }
        );
        assert_eq!(
            exchange.decode_response(&hex(long)),
            Decoded::Malformed(Malformed::End)
        );
        assert_eq!(
            exchange
                .decode_response(&hex("6C 63 01 00 0F 10 0D"))
                .whole()
                .map(|r| r.from),
            Some(Some(Address(1)))
        );
    }
}

/// [EDA §3.18]
#[test]
fn the_envelope_of_other_meters() {
    let request = lc02("AA 30 0E");
    let opened = envelope::open(envelope::REQUEST_START, &request, 7).whole();
    assert_eq!(opened, Some((Address(0xAA), &[0x30, 0x0E][..])));
    let mut reply = hex("6C 63 AA");
    reply.extend([0x0D; 40]);
    reply.extend([sum8(&reply[2..]), 0x0D]);
    let opened = envelope::open(envelope::RESPONSE_START, &reply, 45).whole();
    assert_eq!(opened, Some((Address(0xAA), &[0x0D; 40][..])));
    for mut module in both(Protocol::Lc02, 0xAA) {
        module.ignores(&request);
    }
}
