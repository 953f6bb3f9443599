//! ASCII: `docs/datasheets/eda.md`, section 2.

use super::*;

/// [EDA §2.2, §2.4] upper case, and no blanks.
#[test]
fn host_sends_upper_case_and_no_blanks() {
    for family in BOTH {
        let host = host(Setup {
            checksum: true,
            ..setup(family, Protocol::Ascii, 0xAB)
        });
        let (one, all) = (
            Channel::new(2).expect("it exists"),
            host.setup().output_mask(),
        );
        let ops = [
            Op::ReadOutputs,
            Op::ReadConfig,
            Op::Identify,
            Op::Write(Bank::one(one, true)),
            Op::Write(Bank::new(all, 0x0A)),
            serial(0xCD, Baud::B9600, true),
        ];
        for op in ops {
            let frame = request(&host, &op).expect("a frame");
            let text = std::str::from_utf8(&frame).expect("ASCII").trim_end();
            let plain = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit();
            assert!(
                text.starts_with(['$', '%', '#']) && text[1..].chars().all(plain),
                "{text}"
            );
            assert_eq!(&text[1..3], "AB");
            assert_eq!(frame, sealed(&text[..text.len() - 2]));
        }
    }
}

/// [EDA §2.3, §2.12] digits of either case, and of the format only bit 6.
#[test]
fn host_reads_digits_of_either_case_and_bit_6_of_the_format() {
    for family in BOTH {
        let host = host(setup(family, Protocol::Ascii, 0xAB));
        let formats = [
            ("00", false),
            ("40", true),
            ("07", false),
            ("c1", true),
            ("C1", true),
        ];
        for (format, on) in formats {
            for address in ["ab", "AB", "aB"] {
                let reply = format!("!{address}4006{format}\r");
                match seen(&host, &Op::ReadConfig, reply.as_bytes()) {
                    Observation::Config { baud, checksum, .. } => {
                        assert_eq!((baud, checksum), (Some(Baud::B9600), Some(on)));
                    }
                    other => panic!("{reply}: {other:?}"),
                }
            }
        }
        let data = |reply: &[u8]| seen(&host, &Op::ReadInputs, reply);
        assert_eq!(data(b"!0a0b00\r"), data(b"!0A0B00\r"));
    }
}

/// [EDA §2.5, §2.6, §2.7, §2.26]
#[test]
fn the_checksum() {
    assert_eq!((sum8(b"$016"), sum8(b"!112200")), (0xBB, 0x47));
    for mut module in sealing() {
        is_silent_to(
            &mut module,
            &["$016", "$016BC", "$016bb", "$01600", "#01000F", "#01000F00"],
        );
        let inputs = if module.setup.family == Family::Eda9050 {
            "7F"
        } else {
            "0F"
        };
        let name = if module.setup.family == Family::Eda9050 {
            "9050"
        } else {
            "9060"
        };
        let frames = [
            ("$016", format!("!00{inputs}00")),
            ("$012", "!01400640".into()),
            ("$01M", format!("!01{name}")),
            ("#010005", ">".into()),
            ("$016", format!("!05{inputs}00")),
            // The acknowledgement still has the checksum that it switches off.
            ("%0101400600", "!01".into()),
        ];
        for (request, reply) in frames {
            assert_eq!(
                module.ask(&sealed(request)),
                Some(sealed(&reply)),
                "{request}"
            );
        }
        converse(&mut module, &[("$012", "!01400600")]);
    }
}

/// [EDA §2.8]
#[test]
fn lower_case_only_with_the_switch() {
    for family in BOTH {
        let requests = ["$0a2", "%0a0B400600", "%0A0b400600", "#0A000a", "$0a6"];
        let setup = setup(family, Protocol::Ascii, 0x0A);
        is_silent_to(&mut Bench::new(setup), &requests);
        let options = Options {
            lower_case: true,
            ..Options::default()
        };
        let answers = requests.map(|request| with(setup, options).ask_text(request).is_some());
        assert_eq!(answers, [true; 5]);
    }
}

/// [EDA §2.9] no command of the module is this long; `?AA` shows what it takes for a frame.
#[test]
fn more_than_32_characters_are_forgotten() {
    for family in BOTH {
        let mut module = with(setup(family, Protocol::Ascii, 1), ALOUD);
        let long = |length: usize| format!("$01{}\r", "0".repeat(length - 3));
        assert_eq!(module.ask_text(long(32).trim_end()).as_deref(), Some("?01"));
        module.ignores(long(33).as_bytes());
        // What follows belongs to no frame until a delimiter comes.
        module.ignores(long(64).trim_end().as_bytes());
        module.ignores(b"016\r");
        assert!(module.ask_text("$016").is_some());
    }
}

/// [EDA §2.12, §2.13, §2.15, §2.31] format, speed and address change together, at once, and
/// under no further condition.
#[test]
fn configuration_in_ascii() {
    for mut module in both(Protocol::Ascii, 8) {
        converse(&mut module, &[("$082", "!08400600")]);
        assert!(module.ask_text("%0809400700").is_some());
        assert_eq!(module.engine.active().serial.baud, Baud::B19200);
        is_silent_to(&mut module, &["$082", "$086"]);
        converse(
            &mut module,
            &[("$092", "!09400700"), ("%0909400340", "!09")],
        );
        assert_eq!(module.engine.active().serial.baud, Baud::B1200);
        assert_eq!(module.ask(&sealed("$092")), Some(sealed("!09400340")));
        assert_eq!(module.ask(&sealed("%0909400600")), Some(sealed("!09")));
        converse(&mut module, &[("$092", "!09400600")]);
    }
}

/// [EDA §2.14]
#[test]
fn who_acknowledges_a_configuration() {
    for mut module in both(Protocol::Ascii, 8) {
        let (host, change) = (module.host(), serial(9, Baud::B19200, false));
        let (old, new) = (b"!08\r", b"!09\r");
        for reply in [old, new] {
            assert_eq!(seen(&host, &change, reply), Observation::Done);
        }
        let exchange = host.exchange(&change).expect("a frame");
        let other = exchange.decode_response(b"!07\r");
        assert_eq!(other, Decoded::Malformed(Malformed::Address));
        let by_family = if module.setup.family == Family::Eda9060a {
            old
        } else {
            new
        };
        assert_eq!(
            module.ask(b"%0809400700\r").as_deref(),
            Some(&by_family[..])
        );
    }
}

const VALID: [&str; 6] = ["$01M", "$012", "%0102400740", "$016", "#01000F", "#011201"];

/// [EDA §2.22] with the checksum on, no damaged bit passes, and there is no `?AA`.
#[test]
fn damage_is_ignored() {
    for mut module in sealing() {
        for request in VALID.map(sealed) {
            damaged(&request).for_each(|frame| module.ignores(&frame));
        }
    }
    let errors = [
        "$01",
        "$01MM",
        "$",
        "$0",
        "$0G6",
        "#01",
        "#01000",
        "#0100000F",
        "%01024006000",
    ];
    for mut module in both(Protocol::Ascii, 1) {
        is_silent_to(&mut module, &errors);
        // A character with a framing error invalidates its request.
        module.send(b"$0");
        module.input(railbus_device::Input::BadByte);
        module.send(b"16\r");
        module.wait(300);
        assert!(module.ask_text("$016").is_some());
    }
}

/// Values that are out of range on both modules.
const INVALID: [&str; 17] = [
    "%0102410600",
    "%0102000600",
    "%0102200600",
    "%0102400200",
    "%0102400800",
    "%0102400041",
    "%0102400641",
    "%0102400680",
    "#011002",
    "#0110FF",
    "#011801",
    "#012001",
    "#010100",
    "#010A01",
    "#01A001",
    "#01FF00",
    "#011F01",
];

/// [EDA §2.24, §2.25]
#[test]
fn values_out_of_range_are_ignored() {
    for mut module in both(Protocol::Ascii, 1) {
        is_silent_to(&mut module, &INVALID);
    }
}

/// Commands that ADAM modules have.
const ADAM: [&str; 16] = [
    "$01F", "$014", "$015", "$01I", "$01P", "@01", "#**", "~**", "~010", "~011", "~012", "~013101",
    "~014", "~0150000", "~01Onew", "$01A",
];

/// [EDA §2.28]
#[test]
fn commands_of_adam_modules_are_ignored() {
    for mut module in both(Protocol::Ascii, 1) {
        is_silent_to(&mut module, &ADAM);
    }
}

/// [EDA §2.23]
#[test]
fn the_switch_for_refusals() {
    for family in BOTH {
        let setup = setup(family, Protocol::Ascii, 1);
        let mut module = with(setup, ALOUD);
        let refused = INVALID
            .iter()
            .chain(&ADAM)
            .filter(|text| !text.contains('*'));
        for request in refused.chain(&["$01 6", "$01", "$01MM", "$01m"]) {
            converse(&mut module, &[(request, "?01")]);
        }
        is_silent_to(&mut module, &["$02 6", "%0202410600", "#**", "$", "016"]);
        let address = Address(0);
        let mut nought = with(Setup { address, ..setup }, ALOUD);
        is_silent_to(&mut nought, &["#**", "~**"]);
        let checksum = true;
        let mut module = with(Setup { checksum, ..setup }, ALOUD);
        assert_eq!(module.ask(&sealed("$01F")), Some(sealed("?01")));
        is_silent_to(&mut module, &["$01F", "$01F00", "$016"]);
    }
}

/// [EDA §2.27]
#[test]
fn line_feeds_are_ignored() {
    let options = Options {
        // So that the request after it is still received.
        turnaround: Micros::from_millis(10),
        ..Options::default()
    };
    for family in BOTH {
        let mut module = with(setup(family, Protocol::Ascii, 1), options);
        let inputs = module.ask(b"$016\r");
        for request in ["\n$016\r", "$016\r\n", "$\n0\n1\n6\n\r\n"] {
            assert_eq!(module.ask(request.as_bytes()), inputs);
        }
    }
    for mut module in sealing() {
        assert!(module.ask(b"$0\n16BB\n\r").is_some());
    }
}
