//! Numbers at the ends of their ranges, packed runs, frames that are full or incomplete, and how
//! values are displayed.

use railbus_wire::*;

#[test]
fn small_numbers() {
    assert!(PulseWidth::from_tenths(0).is_none() && PulseWidth::from_tenths(201).is_none());
    assert!(PulseWidth::from_tenths(1).is_some() && PulseWidth::from_tenths(200).is_some());
    assert!(Channel::new(31).is_some() && Channel::new(32).is_none());
    assert!(Bits::from_mask(0, 0).is_none() && Bits::from_mask(0, 33).is_none());
    assert_eq!(Bits::from_mask(!0, 32).unwrap().to_mask(), !0);
    assert_eq!(Bits::from_mask(!0, 5).unwrap().to_mask(), 0x1F);
    assert!(Bits::from_packed(&[0; 2], 8).is_none() && Bits::from_packed(&[0; 1], 9).is_none());
    assert!(Bits::from_packed(&[], 0).is_none() && Bits::from_packed(&[0; 251], 2001).is_none());
    assert!(Words::from_packed(&[0; 3]).is_none() && Words::from_packed(&[]).is_none());
    assert!(Words::from_packed(&[0; 252]).is_none() && Words::from_packed(&[0; 250]).is_some());
}

#[test]
fn runs_of_bits_and_words() {
    let packed = [0b1010_0101, 0xFF];
    let bits = Bits::from_packed(&packed, 9).unwrap();
    assert_eq!(bits.iter().collect::<Vec<bool>>().len(), 9);
    assert_eq!(
        (bits.get(0), bits.get(1), bits.get(8), bits.get(9)),
        (Some(true), Some(false), Some(true), None)
    );
    assert_eq!(bits.to_mask(), 0x1A5);
    // Bits above the last one do not count, the number of bits does.
    assert_eq!(bits, Bits::from_packed(&[0b1010_0101, 1], 9).unwrap());
    assert_ne!(bits, Bits::from_packed(&packed, 10).unwrap());
    assert_ne!(bits, Bits::from_packed(&[0, 1], 9).unwrap());
    assert_eq!(bits, Bits::from_mask(0x1A5, 9).unwrap());

    let words = Words::two(0x1234, 5);
    assert_eq!(
        (words.get(0), words.get(1), words.get(2)),
        (Some(0x1234), Some(5), None)
    );
    assert_eq!(words, Words::from_packed(&[0x12, 0x34, 0, 5]).unwrap());
    assert_ne!(words, Words::one(0x1234));
}

#[test]
fn frames_hold_what_fits() {
    let mut frame = Frame::new();
    assert!(frame.extend(&[1; FRAME_MAX]) && !frame.extend(&[1]));
    assert_eq!(frame.bytes(), [1; FRAME_MAX]);
    let full = frame.clone();
    frame.clear();
    assert!(frame.bytes().is_empty() && frame.extend(&[]));
    assert!(frame != full && frame == Frame::default());
}

#[test]
fn masks_of_channels() {
    let masks = [(0, 1), (1, 2), (31, 1 << 31)];
    for (index, mask) in masks {
        let channel = Channel::new(index).unwrap();
        assert_eq!((channel.index(), channel.mask()), (index, mask));
    }
}

/// What users, logs and failed tests show of values.
#[test]
fn values_are_shown() {
    assert_eq!(Address(10).to_string(), "10 (0Ah)");
    let names = Protocol::ALL.map(|protocol| (protocol.name(), protocol.to_string()));
    let wanted = ["rtu", "ascii", "lc02", "r55"];
    assert_eq!(names, wanted.map(|name| (name, name.to_owned())));
    assert_eq!(Malformed::Checksum.to_string(), "wrong checksum");
    assert_eq!(SerialSettings::FACTORY.to_string(), "9600 8N1");
    assert_eq!(SerialSettings::FACTORY.baud.to_string(), "9600");
    let characters = [Character::N1, Character::E1, Character::O1, Character::N2];
    let shown = characters.map(|character| character.to_string());
    assert_eq!(shown, ["8N1", "8E1", "8O1", "8N2"]);

    let mut frame = Frame::new();
    frame.extend(&[1, 0xAB]);
    assert_eq!(format!("{frame:?}"), "[01, AB]");
    let bits = Bits::from_mask(0b101, 4).unwrap();
    assert_eq!(format!("{bits:?}"), "1010");
    assert_eq!(format!("{:?}", Words::two(1, 2)), "[1, 2]");
    let text = ascii::Text::new(b"9050").unwrap();
    assert_eq!(format!("{text:?}"), "\"9050\"");
}

/// A broadcast is answered by no module.
#[test]
fn broadcasts_expect_no_reply() {
    let ascii = |request| Exchange::ascii(Address(1), false, request);
    assert!(ascii(ascii::Request::ReadData).expects_reply());
    assert!(!ascii(ascii::Request::SampleAll).expects_reply());
    assert_eq!(ascii(ascii::Request::SampleAll).response_len_max(), 0);
    let rtu = |address| {
        let value = rtu::CoilValue(0xFF00);
        Exchange::rtu(Address(address), rtu::Request::WriteCoil { at: 0, value })
    };
    assert!(rtu(1).expects_reply() && !rtu(0).expects_reply());
    assert_eq!(
        (rtu(1).response_len_max(), rtu(0).response_len_max()),
        (8, 0)
    );
}

/// A 0x55 board's four bytes, as one word and as the two halves of a mixed board [R55 §3.3].
#[test]
fn data_of_a_relay_board() {
    let response = r55::Response {
        data: [0x80, 0x01, 0x40, 0x02],
    };
    assert_eq!(response.to_word(), 0x8001_4002);
    assert_eq!(response, r55::Response::word(0x8001_4002));
    assert_eq!((response.inputs(), response.outputs()), (0x8001, 0x4002));
    let value = r55::U24::new(0x12_3456).unwrap();
    assert_eq!(value.get(), 0x12_3456);
    let variable = r55::Response::variable(7, value);
    assert_eq!(variable.data, [0x12, 0x34, 0x56, 7]);
}

#[test]
fn parts_of_modbus_requests() {
    use rtu::{BitBlock, BitSpan, CoilValue, WordBlock};
    let states = [CoilValue::ON, CoilValue::OFF, CoilValue(0x0100)].map(CoilValue::state);
    assert_eq!(states, [Some(true), Some(false), None]);
    assert_eq!(
        [true, false].map(CoilValue::from),
        [CoilValue::ON, CoilValue::OFF]
    );
    let span = BitSpan::new(60, 8).unwrap();
    assert_eq!((span.start(), span.count()), (60, 8));
    let bits = Bits::from_mask(0b101, 3).unwrap();
    let block = BitBlock::new(60, bits).unwrap();
    assert_eq!((block.start(), *block.values()), (60, bits));
    let words = Words::two(7, 9);
    let block = WordBlock::new(2, words).unwrap();
    assert_eq!((block.start(), *block.values()), (2, words));
    assert_eq!((bits.len(), words.len()), (3, 2));
    assert!(rtu::Request::ReadCoils(span).is_read());
    assert!(!rtu::Request::WriteRegister { at: 0, value: 0 }.is_read());
}

#[test]
fn exceptions_are_named_and_marked() {
    let names = [
        (1, "01 illegal function"),
        (2, "02 illegal data address"),
        (3, "03 illegal data value"),
        (4, "04 device failure"),
        (5, "05 acknowledged, still working"),
        (6, "06 device busy"),
        (8, "08 checksum or memory parity error"),
        (0x0A, "0A gateway path unavailable"),
        (0x0B, "0B gateway target did not respond"),
        (0x7F, "7F undefined exception"),
    ];
    for (code, name) in names {
        assert_eq!(rtu::Exception(code).to_string(), name);
    }
    // A function code with its top bit already set is its own exception code.
    let mut frame = Frame::new();
    for code in [0x2B, 0xAB] {
        rtu::encode_exception(Address(1), code, rtu::Exception::FUNCTION, &mut frame);
        assert_eq!(frame.bytes().get(..3), Some(&[1, 0xAB, 1][..]));
    }
}

/// Times saturate instead of wrapping around.
#[test]
fn times_are_added_and_taken_away() {
    let (two, five) = (Micros(2), Micros(5));
    assert_eq!(
        (five + two, five - two, two - five, five * 3),
        (Micros(7), Micros(3), Micros(0), Micros(15))
    );
    assert_eq!(Micros(u64::MAX) + two, Micros(u64::MAX));
    assert_eq!(Micros(u64::MAX) * 2, Micros(u64::MAX));
    let mut sum = two;
    sum += five;
    assert_eq!(sum, Micros(7));
    assert_eq!(
        (Micros::from_millis(3), Micros::from_secs(3)),
        (Micros(3000), Micros(3_000_000))
    );
    let at_19200 = SerialSettings {
        baud: Baud::B19200,
        ..SerialSettings::FACTORY
    };
    // The last speed whose silences are counted in characters [MODBUS §1.4, §1.5].
    assert_eq!(
        (at_19200.t1_5(), at_19200.t3_5()),
        (Micros(782), Micros(1823))
    );
    let moment = Instant(10);
    assert_eq!(moment + two, Instant(12));
    assert_eq!(
        (moment.since(Instant(4)), Instant(4).since(moment)),
        (Micros(6), Micros(0))
    );
}

/// How many bytes a binary reply lacks is exact, as soon as its length is certain.
#[test]
fn what_is_missing_is_told() {
    let coils = rtu::BitSpan::new(0, 16).unwrap();
    let write = rtu::Request::WriteRegister { at: 1, value: 2 };
    let whole = [
        (
            Exchange::rtu(Address(1), rtu::Request::ReadCoils(coils)),
            3,
            7,
        ),
        (Exchange::rtu(Address(1), write), 2, 8),
        (Exchange::lc02(Address(1), lc02::Request::ReadConfig), 0, 9),
        (Exchange::r55(Address(1), r55::Request::ReadState), 0, 8),
    ];
    let beginnings: [&[u8]; 4] = [
        &[1, 1, 2, 0, 0, 0],
        &[1, 6, 0, 1, 0, 2, 0],
        &[0x6C, 0x63, 1, 0, 0, 0, 0, 0],
        &[0x22, 1, 0x10, 0, 0, 0, 0],
    ];
    for ((exchange, certain_from, len), beginning) in whole.into_iter().zip(beginnings) {
        assert_eq!(exchange.response_len_max(), len);
        for heard in certain_from..len {
            let more = len - heard;
            let read = exchange.decode_response(&beginning[..heard]);
            assert_eq!(read, Decoded::Partial { more }, "{exchange:?} {heard}");
        }
    }
}

/// Also of a Modbus request, as soon as its first bytes give its length.
#[test]
fn what_is_missing_of_a_modbus_request_is_told() {
    let beginnings: [(&[u8], usize); 7] = [
        (&[], 4),
        (&[1], 3),
        (&[1, 0x01], 6),
        (&[1, 0x01, 0, 0, 0], 3),
        (&[1, 0x0F], 8),
        (&[1, 0x0F, 0, 0, 0, 9], 4),
        (&[1, 0x0F, 0, 0, 0, 9, 2, 0], 3),
    ];
    for (heard, more) in beginnings {
        let read = rtu::Exchange::decode_request(heard);
        assert_eq!(read, Decoded::Partial { more }, "{heard:02X?}");
    }
}

/// A frame that is no request still names its module if it arrived whole.
#[test]
fn addresses_of_frames_that_are_no_requests() {
    let rules = |checksum| ascii::DecodeRules {
        checksum,
        lower_case: false,
    };
    for (frame, checksum, address) in [
        ("$1AX\r", false, Some(Address(0x1A))),
        ("$1A\r", false, Some(Address(0x1A))),
        ("$1A", false, None),
        ("$1\r", false, None),
        ("$1aX\r", false, None),
        ("$016BB\r", true, Some(Address(1))),
        ("$016BC\r", true, None),
    ] {
        let found = ascii::address_of(frame.as_bytes(), rules(checksum));
        assert_eq!(found, address, "{frame:?}");
    }
}

/// An address that any board answers makes requests to it confusable with every module's, whichever
/// of the two is asked first.
#[test]
fn a_request_to_all_is_confusable_with_one_to_any() {
    let board = |address| Exchange::r55(Address(address), r55::Request::ReadState);
    let module = |address| {
        let span = rtu::BitSpan::new(0, 8).unwrap();
        Exchange::rtu(Address(address), rtu::Request::ReadCoils(span))
    };
    for (one, other, all) in [
        (board(1), board(2), board(r55::BROADCAST.0)),
        (module(1), module(2), module(rtu::BROADCAST.0)),
    ] {
        assert!(one.confusable(&one) && !one.confusable(&other));
        assert!(one.confusable(&all) && all.confusable(&one));
    }
}

/// An ASCII reply without an address may begin with what reads as another module's: `!010F00` is
/// the outputs and inputs of any module, or the pulses of module 01.
#[test]
fn a_reply_without_an_address_is_confusable_with_one_that_has_one() {
    let ask = |address, request| Exchange::ascii(Address(address), false, request);
    let any = ask(2, ascii::Request::ReadData);
    let named = ask(1, ascii::Request::ReadPulse);
    assert!(any.confusable(&named) && named.confusable(&any));
    assert!(any.confusable(&ask(1, ascii::Request::ReadData)));
    assert!(!named.confusable(&ask(2, ascii::Request::ReadPulse)));
    let name = ask(1, ascii::Request::ReadInit);
    assert!(!any.confusable(&name), "their lengths differ");
}

#[test]
fn rates_and_formats_are_read_back_by_name() {
    let rates = Baud::ALL.map(|baud| baud.to_string());
    assert_eq!(rates, Baud::NAMES);
    for character in Character::ALL {
        assert_eq!(Character::from_name(character.name()), Some(character));
    }
    assert_eq!(Character::from_name("8n1"), None);
}
