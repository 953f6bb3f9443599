//! What each family is, as a description: counts, labels, addresses, speeds, gaps, and what
//! `Setup::check` refuses.

use railbus_device::{Family, Layout, Module, Op, Point, PointKind, Setup, SetupError};
use railbus_wire::{Address, Baud, Character, Micros, Protocol, SerialSettings, r55::U24};

/// A module in the middle of its addresses.
fn setup(family: Family) -> Setup {
    Setup::new(family, Address(5))
}

fn board(layout: Layout, outputs: u8, inputs: u8) -> Setup {
    Setup {
        layout,
        outputs,
        inputs,
        ..setup(Family::R55)
    }
}

fn labels(setup: &Setup) -> Vec<String> {
    let label = |point| {
        let (letters, number) = setup.label(point);
        format!("{letters}{number}")
    };
    setup.points().map(label).collect()
}

/// [ERC-8 §1.1, EMD-2A2Q §1.1, R55 §2.1] what there is, and how terminals count it.
#[test]
fn points_are_labelled_as_printed() {
    let expected = [
        (setup(Family::Eda9060a), "do0 do1 do2 do3 di0 di1 di2 di3"),
        (
            setup(Family::Eda9050),
            "do0 do1 do2 do3 do4 do5 do6 do7 di0 di1 di2 di3 di4 di5 di6",
        ),
        (setup(Family::Erc8), "k1 k2 k3 k4 k5 k6 k7 k8"),
        (setup(Family::Emd2a2q), "k1 k2 ai1 ai2"),
        (board(Layout::Outputs, 3, 0), "k1 k2 k3"),
        (board(Layout::Inputs, 0, 2), "d1 d2"),
        (board(Layout::Mixed, 2, 1), "k1 k2 d1"),
    ];
    for (setup, text) in expected {
        assert_eq!(labels(&setup).join(" "), text, "{}", setup.family);
    }
    let largest = labels(&setup(Family::R55));
    assert_eq!((largest.len(), largest[31].as_str()), (32, "k32"));
}

#[test]
fn a_point_is_found_by_its_label_and_by_no_other() {
    let all = Family::ALL
        .map(setup)
        .into_iter()
        .chain([board(Layout::Mixed, 16, 16), board(Layout::Inputs, 0, 32)]);
    for setup in all {
        for (point, label) in setup.points().zip(labels(&setup)) {
            assert_eq!(setup.point(&label), Some(point), "{label}");
        }
    }
    let erc8 = setup(Family::Erc8);
    for label in [
        "", "k", "1", "k0", "k9", "k01", "k1x", "K1", " k1", "k1 ", "k256", "k-1", "d1", "ai1",
        "do1", "v0",
    ] {
        assert_eq!(erc8.point(label), None, "{label:?} is no point");
    }
}

/// [R55 §5.4] variables are points only where the description says how many.
#[test]
fn variables_are_counted_by_the_description() {
    let programmable = |variables| Setup {
        variables,
        ..board(Layout::Outputs, 1, 0)
    };
    assert_eq!(labels(&programmable(0)), ["k1"]);
    assert_eq!(labels(&programmable(2)), ["k1", "v0", "v1"]);
    let variable = |index| Point {
        kind: PointKind::Variable,
        index,
    };
    assert_eq!(programmable(2).point("v1"), Some(variable(1)));
    assert_eq!(programmable(2).point("v2"), None);
    assert_eq!(programmable(0).point("v0"), None);
    let checked = [32, 33].map(|variables| programmable(variables).check());
    assert_eq!(checked, [Ok(()), Err(SetupError::Channels)]);

    let module = Module::new(programmable(2)).expect("such a board");
    let value = U24::new(7).expect("24 bits");
    for (index, has) in [(0, true), (1, true), (2, false), (255, false)] {
        for op in [Op::ReadVariable(index), Op::WriteVariable(index, value)] {
            assert_eq!(module.exchange(&op).is_ok(), has, "{op:?}");
        }
    }
    let read: Vec<Op> = module.full_poll().collect();
    let expected = [Op::ReadOutputs, Op::ReadVariable(0), Op::ReadVariable(1)];
    assert_eq!(read, expected);
}

/// [ERC-8 §1.2, EMD-2A2Q §1.2, R55 §4.5, §4.9] the addresses that a module can have. A board never
/// has 245, so no request for one board is a broadcast.
#[test]
fn addresses() {
    let in_protocol = |family, protocol| Setup {
        protocol,
        ..setup(family)
    };
    let ranges = [
        (setup(Family::Erc8), 1..=32),
        (setup(Family::Emd2a2q), 1..=32),
        (setup(Family::R55), 1..=255),
        (in_protocol(Family::Eda9060a, Protocol::Ascii), 0..=255),
        (in_protocol(Family::Eda9060a, Protocol::Lc02), 0..=255),
        (in_protocol(Family::Eda9060a, Protocol::Rtu), 1..=255),
        (in_protocol(Family::Eda9050, Protocol::Rtu), 1..=255),
    ];
    for (setup, range) in ranges {
        for address in (0..=255).map(Address) {
            let is_broadcast = setup.family == Family::R55 && address == Address(245);
            let expected = if range.contains(&address.0) && !is_broadcast {
                Ok(())
            } else {
                Err(SetupError::Address(*range.start(), *range.end()))
            };
            let checked = Setup { address, ..setup }.check();
            assert_eq!(checked, expected, "{} {address}", setup.family);
        }
    }
}

/// [ERC-8 §1.3, EMD-2A2Q §1.3, R55 §1.5] as shipped all are 9600 8N1.
#[test]
fn as_shipped() {
    for family in Family::ALL {
        let SerialSettings { baud, character } = setup(family).serial;
        assert_eq!((baud.rate(), character), (9600, Character::N1), "{family}");
        assert_eq!(setup(family).check(), Ok(()));
    }
}

/// [ERC-8 §1.4, §1.5, EMD-2A2Q §1.4, §1.5, R55 §1.5] the speeds and character formats there
/// are; every other one is refused.
#[test]
fn speeds_and_character_formats() {
    use Character::{E1, N1, N2, O1};
    let table: [(Family, &[u32], &[Character]); 3] = [
        (Family::Erc8, &[4800, 9600, 19200, 38400], &[N1, O1, E1]),
        (
            Family::Emd2a2q,
            &[2400, 4800, 9600, 19200, 38400],
            &[N1, O1, E1],
        ),
        (Family::R55, &[9600], &[N1]),
    ];
    for (family, rates, characters) in table {
        for baud in Baud::ALL {
            for character in [N1, E1, O1, N2] {
                let serial = SerialSettings { baud, character };
                let expected = if !rates.contains(&baud.rate()) {
                    Err(SetupError::Baud)
                } else if !characters.contains(&character) {
                    Err(SetupError::Character)
                } else {
                    Ok(())
                };
                let checked = Setup {
                    serial,
                    ..setup(family)
                }
                .check();
                assert_eq!(checked, expected, "{family} at {serial}");
            }
        }
    }
}

/// [ERC-8 §1.6, EMD-2A2Q §1.6, R55 §1.9] the silence before a request; the description may
/// say another one.
#[test]
fn gaps() {
    let rtu = |family, baud| Setup {
        protocol: Protocol::Rtu,
        serial: SerialSettings {
            baud,
            ..SerialSettings::FACTORY
        },
        ..setup(family)
    };
    let table = [
        (setup(Family::Erc8), 20_000),
        (rtu(Family::Erc8, Baud::B38400), 20_000),
        (setup(Family::Emd2a2q), 10_000),
        (rtu(Family::Emd2a2q, Baud::B2400), 10_000),
        (setup(Family::R55), 5_000),
        (setup(Family::Eda9060a), 5_000),
        (rtu(Family::Eda9060a, Baud::B9600), 3_646),
        (rtu(Family::Eda9050, Baud::B1200), 29_167),
    ];
    for (setup, micros) in table {
        assert_eq!(setup.request_gap(), Micros(micros), "{}", setup.family);
        let gap = Some(Micros(77));
        assert_eq!(Setup { gap, ..setup }.request_gap(), Micros(77));
    }
}

/// [R55 §3.4] the description says how many outputs and inputs a board has, and which layout:
/// up to 32 of one kind, or 16 of each.
#[test]
fn channels_and_layouts() {
    use Layout::{Inputs, Mixed, Outputs};
    let fits = [
        (Outputs, 0, 0),
        (Outputs, 32, 0),
        (Inputs, 0, 32),
        (Inputs, 0, 0),
        (Mixed, 16, 16),
        (Mixed, 0, 1),
    ];
    for (layout, outputs, inputs) in fits {
        assert_eq!(board(layout, outputs, inputs).check(), Ok(()));
    }
    let too_much = [
        (Outputs, 33, 0),
        (Outputs, 1, 1),
        (Inputs, 0, 33),
        (Inputs, 1, 1),
        (Mixed, 17, 0),
        (Mixed, 0, 17),
    ];
    for (layout, outputs, inputs) in too_much {
        let checked = board(layout, outputs, inputs).check();
        assert_eq!(checked, Err(SetupError::Channels), "{layout:?}");
    }
    for family in [Family::Erc8, Family::Emd2a2q, Family::Eda9060a] {
        let fewer = Setup {
            outputs: 1,
            ..setup(family)
        };
        assert_eq!(fewer.check(), Err(SetupError::Channels));
        let variables = Setup {
            variables: 1,
            ..setup(family)
        };
        assert_eq!(variables.check(), Err(SetupError::Channels));
    }
}

#[test]
fn protocols_and_checksums() {
    for family in Family::ALL {
        let its_own = family.profile().protocols;
        for protocol in Protocol::ALL {
            let expected = if its_own.contains(&protocol) {
                Ok(())
            } else {
                Err(SetupError::Protocol)
            };
            let described = Setup {
                protocol,
                ..setup(family)
            };
            assert_eq!(described.check(), expected, "{family} in {protocol}");
            let checksum = Setup {
                checksum: true,
                ..described
            };
            let allowed = protocol == Protocol::Ascii;
            assert_eq!(checksum.check().is_ok(), expected.is_ok() && allowed);
        }
    }
}

#[test]
fn families_are_found_by_their_names() {
    let names = [
        ("eda9060a", "EDA9060A"),
        ("eda9050", "EDA9050"),
        ("erc8", "ERC-8"),
        ("r55", "0x55 board"),
        ("emd2a2q", "EMD-2A2Q"),
    ];
    for (family, (name, model)) in Family::ALL.into_iter().zip(names) {
        assert_eq!(
            (family.name(), Family::from_name(name)),
            (name, Some(family))
        );
        assert_eq!(family.to_string(), model);
    }
    assert_eq!(Family::from_name("ERC-8"), None);
    let error = SetupError::Address(1, 32).to_string();
    assert_eq!(error, "the address must be 1 to 32 for this model");
}
