//! What is fed: each target takes any bytes and panics where an invariant breaks.
//!
//! Invariants: nothing panics; a frame is no longer than what was received and no shorter than
//! its bytes; what follows a frame does not change it; a request that was read can be written
//! again and is then the same bytes (0x55 boards ignore some); a reply that was read can be
//! written again and means the same; where two exchanges take the same bytes, they are
//! confusable.

use crate::sniffed;
use railbus_wire::*;

/// A target and its name.
pub type Target = (&'static str, fn(&[u8]));

/// Every target. Further ones (a module's engine, a whole line) belong at the end.
pub const TARGETS: &[Target] = &[
    ("rtu_request", rtu_request),
    ("rtu_response", rtu_response),
    ("ascii_request", ascii_request),
    ("ascii_response", ascii_response),
    ("lc02_request", lc02_request),
    ("lc02_response", lc02_response),
    ("r55_request", r55_request),
    ("r55_response", r55_response),
    ("lcus_request", lcus_request),
    ("carried_command", carried_command),
    ("found_response", found_response),
    ("told_apart", told_apart),
    ("listened", sniffed::listened),
    ("captured", sniffed::captured),
    ("kept", sniffed::kept),
];

/// How many bytes at the start of an input choose the exchange that it is read with.
pub const CHOICE: usize = 8;

/// A Modbus request, with silence around it and without.
pub fn rtu_request(data: &[u8]) {
    let (_, rx) = split(data);
    if let Ok(exchange) = rtu::Exchange::decode_frame(rx) {
        assert_eq!(request_bytes(&Exchange::Rtu(exchange)), rx);
    }
    let decode = |rx| rtu::Exchange::decode_request(rx);
    if let Some((len, exchange)) = whole(rx, &decode(rx)) {
        assert_eq!(request_bytes(&Exchange::Rtu(exchange)), rx[..len]);
        assert_eq!(
            decode(&rx[..len]),
            Decoded::Whole {
                len,
                value: exchange
            }
        );
    }
}

/// A Modbus reply.
pub fn rtu_response(data: &[u8]) {
    let (choice, rx) = split(data);
    response(&rtu_exchange(choice), rx);
}

/// An ASCII request under every rule.
pub fn ascii_request(data: &[u8]) {
    let (choice, rx) = split(data);
    let rules = ascii::DecodeRules {
        checksum: choice[0] & 1 == 1,
        lower_case: choice[0] & 2 == 2,
    };
    let decode = |rx| ascii::Exchange::decode_request(rx, rules);
    if let Some((len, exchange)) = whole(rx, &decode(rx)) {
        let again = request_bytes(&Exchange::Ascii(exchange));
        let same_case = rules.lower_case && again.eq_ignore_ascii_case(&rx[..len]);
        // The checksum of lower-case digits is not that of upper-case ones.
        let respelled = rules.lower_case && rules.checksum;
        assert!(again == rx[..len] || same_case || respelled);
        assert_eq!(
            decode(&again).map(|again| again == exchange).whole(),
            Some(true)
        );
        assert_eq!(
            decode(&rx[..len]),
            Decoded::Whole {
                len,
                value: exchange
            }
        );
    }
    let _ = ascii::address_of(rx, rules);
}

/// An ASCII reply.
pub fn ascii_response(data: &[u8]) {
    let (choice, rx) = split(data);
    response(&ascii_exchange(choice), rx);
}

/// An LC-02 request.
pub fn lc02_request(data: &[u8]) {
    let (_, rx) = split(data);
    let decode = |rx| lc02::Exchange::decode_request(rx);
    if let Some((len, exchange)) = whole(rx, &decode(rx)) {
        assert_eq!(request_bytes(&Exchange::Lc02(exchange)), rx[..len]);
        assert_eq!(
            decode(&rx[..len]),
            Decoded::Whole {
                len,
                value: exchange
            }
        );
    }
}

/// An LC-02 reply.
pub fn lc02_response(data: &[u8]) {
    let (choice, rx) = split(data);
    response(&lc02_exchange(choice), rx);
}

/// A request to a 0x55 board. Data that its function ignores are not kept.
pub fn r55_request(data: &[u8]) {
    let (_, rx) = split(data);
    let decode = |rx| r55::Exchange::decode_request(rx);
    if let Some((len, exchange)) = whole(rx, &decode(rx)) {
        let again = request_bytes(&Exchange::R55(exchange));
        assert_eq!(again[..3], rx[..3]);
        assert_eq!(
            decode(&again),
            Decoded::Whole {
                len,
                value: exchange
            }
        );
    }
}

/// The reply of a 0x55 board.
pub fn r55_response(data: &[u8]) {
    let (choice, rx) = split(data);
    response(&r55_exchange(choice), rx);
}

/// An LCUS frame.
pub fn lcus_request(data: &[u8]) {
    let (_, rx) = split(data);
    if let Some((len, request)) = whole(rx, &lcus::Request::decode(rx)) {
        let mut frame = Frame::new();
        request.encode(&mut frame);
        assert_eq!(frame.bytes(), &rx[..len]);
    }
}

/// Commands that other protocols would see in any bytes.
pub fn carried_command(data: &[u8]) {
    let (choice, rx) = split(data);
    for protocol in Protocol::ALL {
        let carried = carries_command(rx, protocol);
        if protocol != Protocol::Rtu && carried {
            let behind = [&choice[..2], rx].concat();
            assert!(
                carries_command(&behind, protocol),
                "bytes before it hide a command"
            );
        }
    }
    let own = [rtu_exchange, ascii_exchange, lc02_exchange, r55_exchange];
    let exchange = own[usize::from(choice[0] & 3)](choice);
    assert!(carries_command(
        &request_bytes(&exchange),
        exchange.protocol()
    ));
}

/// A reply somewhere in any bytes.
pub fn found_response(data: &[u8]) {
    let (choice, rx) = split(data);
    let exchange = any_exchange(choice);
    let (skipped, found) = exchange.find_response(rx);
    assert!(skipped <= rx.len());
    for early in 0..skipped {
        let passed = exchange.decode_response(&rx[early..]);
        assert!(
            matches!(passed, Decoded::Malformed(_)),
            "passed over {early}"
        );
    }
    if skipped < rx.len() {
        assert_eq!(exchange.decode_response(&rx[skipped..]), found);
    }
}

/// The ghost rule: bytes that answer two exchanges make them confusable. The bytes are those
/// received and a reply to the one made from them.
pub fn told_apart(data: &[u8]) {
    let (choice, rx) = split(data);
    let mut other = choice;
    other.rotate_left(3);
    let own = [rtu_exchange, ascii_exchange, lc02_exchange, r55_exchange];
    let make = own[usize::from(choice[7] & 3)];
    let (one, two) = (make(choice), make(other));
    assert_eq!(one.confusable(&two), two.confusable(&one));
    for rx in [rx, &reply_to(&one, rx)] {
        let answered =
            |exchange: &Exchange<'_>| matches!(exchange.decode_response(rx), Decoded::Whole { .. });
        let both = answered(&one) && answered(&two);
        assert!(!both || one.confusable(&two), "{one:?}, {two:?}: {rx:02X?}");
    }
}

/// A reply to this exchange with data from anywhere; no bytes where none is made.
fn reply_to(exchange: &Exchange<'_>, data: &[u8]) -> Vec<u8> {
    let from = exchange.address();
    // Data that look like sums and end marks, one byte in two.
    let at = |index: usize| match data.get(index).copied().unwrap_or(0) {
        0..0x40 => from.0,
        0x40..0x80 => 0x0D,
        byte => byte,
    };
    let four = [at(0), at(1), at(2), at(3)];
    let mut frame = Frame::new();
    match exchange {
        Exchange::Rtu(e) => {
            let response = match e.request.is_read() {
                true => rtu::Response::Exception(rtu::Exception(at(0))),
                false => rtu::Response::Done,
            };
            e.encode_response(from, &response, &mut frame);
        }
        Exchange::Ascii(e) => {
            let (outputs, inputs) = (at(0), at(1));
            let response = match e.request {
                ascii::Request::ReadData => ascii::Response::Data { outputs, inputs },
                ascii::Request::ReadAll => {
                    ascii::Response::All(u16::from_be_bytes([outputs, inputs]))
                }
                ascii::Request::WriteOutputs { .. } if outputs == 0x0D => ascii::Response::Ignored,
                _ if inputs == 0x0D => ascii::Response::Invalid,
                _ => ascii::Response::Done,
            };
            e.encode_response(from, &response, &mut frame);
        }
        Exchange::Lc02(e) => {
            let [baud_code, high, low, type_code] = four;
            let model = u16::from_be_bytes([high, low]);
            let response = match e.request {
                lc02::Request::ReadConfig => lc02::Response::Config {
                    baud_code,
                    model,
                    type_code,
                },
                lc02::Request::ReadData => lc02::Response::Data {
                    outputs: baud_code,
                    inputs: high,
                },
                _ => lc02::Response::Done,
            };
            e.encode_response(from, response, &mut frame);
        }
        Exchange::R55(e) => e.encode_response(from, r55::Response { data: four }, &mut frame),
    }
    frame.bytes().to_vec()
}

/// The choice and what is received; an input that is too short chooses zeros.
fn split(data: &[u8]) -> ([u8; CHOICE], &[u8]) {
    match data.split_first_chunk() {
        Some((choice, rx)) => (*choice, rx),
        None => ([0; CHOICE], data),
    }
}

/// Length and value of a whole frame; of anything else, that it is sensible.
fn whole<T: Copy>(rx: &[u8], decoded: &Decoded<T>) -> Option<(usize, T)> {
    match *decoded {
        Decoded::Whole { len, value } => {
            assert!(0 < len && len <= rx.len());
            Some((len, value))
        }
        Decoded::Partial { more } => {
            assert!(more > 0 && rx.len() + more <= 2 * FRAME_MAX);
            None
        }
        Decoded::Malformed(_) => None,
    }
}

fn request_bytes(exchange: &Exchange<'_>) -> Vec<u8> {
    let mut frame = Frame::new();
    exchange.encode(&mut frame);
    frame.bytes().to_vec()
}

/// Reads a reply; one that is whole is written again, read again, and means the same.
fn response(exchange: &Exchange<'_>, rx: &[u8]) {
    let Some((len, reply)) = whole(rx, &exchange.decode_response(rx)) else {
        return;
    };
    assert_eq!(
        exchange.decode_response(&rx[..len]),
        Decoded::Whole { len, value: reply }
    );
    let from = reply.from.unwrap_or(exchange.address());
    let mut frame = Frame::new();
    match (exchange, &reply.response) {
        (Exchange::Rtu(e), Response::Rtu(response)) => {
            e.encode_response(from, response, &mut frame)
        }
        (Exchange::Ascii(e), Response::Ascii(response)) => {
            e.encode_response(from, response, &mut frame);
        }
        (Exchange::Lc02(e), Response::Lc02(response)) => {
            e.encode_response(from, *response, &mut frame);
        }
        (Exchange::R55(e), Response::R55(response)) => {
            e.encode_response(from, *response, &mut frame);
        }
        _ => panic!("a reply in another protocol"),
    }
    let again = exchange.decode_response(frame.bytes()).whole();
    assert_eq!(again.map(|again| again.response), Some(reply.response));
    if exchange.protocol() != Protocol::Ascii {
        assert_eq!(frame.bytes(), &rx[..len]);
    }
}

fn any_exchange(choice: [u8; CHOICE]) -> Exchange<'static> {
    let own = [rtu_exchange, ascii_exchange, lc02_exchange, r55_exchange];
    own[usize::from(choice[7] & 3)](choice)
}

/// Addresses are few, so that they meet those of the corpus and each other.
fn address(byte: u8) -> Address {
    Address(
        [
            0, 1, 2, 6, 8, 9, 0x0D, 0x14, 0x15, 0x21, 0x3F, 0xF5, byte, 1, 1, 1,
        ][usize::from(byte >> 4)],
    )
}

fn rtu_exchange([a, f, s0, s1, n0, n1, ..]: [u8; CHOICE]) -> Exchange<'static> {
    use rtu::{BitBlock, BitSpan, CoilValue, Request, WordBlock, WordSpan};
    let start = u16::from_be_bytes([s0, s1]);
    let value = u16::from_be_bytes([n0, n1]);
    let bits = BitSpan::new(start, 1 + value % Bits::MAX);
    let words = WordSpan::new(start, 1 + value % Words::MAX);
    let coils = Bits::from_mask(u32::from(value), 1 + u16::from(n0 % 32));
    let coils = coils.and_then(|values| BitBlock::new(start, values));
    let registers = WordBlock::new(start, Words::two(value, start));
    let request = match f % 10 {
        0 => bits.map(Request::ReadCoils),
        1 => bits.map(Request::ReadDiscreteInputs),
        2 => words.map(Request::ReadHoldingRegisters),
        3 => words.map(Request::ReadInputRegisters),
        4 => coils.map(Request::WriteCoils),
        5 => registers.map(Request::WriteRegisters),
        6 => Some(Request::WriteCoil {
            at: start,
            value: CoilValue(value),
        }),
        7 => Some(Request::Diagnose {
            sub: start,
            data: value,
        }),
        8 => Some(Request::Identify {
            code: s0,
            object: n0,
        }),
        _ => None,
    };
    // Where the run would pass the end, and for the last function.
    let request = request.unwrap_or(Request::WriteRegister { at: start, value });
    Exchange::rtu(address(a), request)
}

fn ascii_exchange([a, f, x, y, z, w, c, _]: [u8; CHOICE]) -> Exchange<'static> {
    use ascii::{Request, Text};
    let width = PulseWidth::from_tenths(y).unwrap_or(PulseWidth::DEFAULT);
    let name = [x, y, z].map(|byte| byte % 0x5F + 0x20);
    let request = match f % 22 {
        0 => Request::ReadName,
        1 => Request::ReadFirmware,
        2 => Request::ReadConfig,
        3 => Request::WriteConfig {
            new_address: address(x),
            type_code: y,
            baud_code: z,
            format: w,
        },
        4 => Request::WriteOutputs { order: x, data: y },
        5 => Request::ReadPulse,
        6 => Request::WritePulse { mask: x, width },
        7 => Request::ReadLatched,
        8 => Request::ReadReset,
        9 => Request::ReadInit,
        10 => Request::ReadAll,
        11 => Request::ReadWatchdogStatus,
        12 => Request::ClearWatchdog,
        13 => Request::ReadWatchdog,
        14 => Request::WriteWatchdog {
            enabled: x & 1 == 1,
            tenths: y,
        },
        15 => Request::ReadSafe,
        16 => Request::WriteSafe {
            power_on: x,
            safe: y,
        },
        17 => Request::SampleAll,
        18 => Request::HostOk,
        19 => Text::new(&name).map_or(Request::ReadName, Request::Rename),
        _ => Request::ReadData,
    };
    Exchange::ascii(address(a), c & 1 == 1, request)
}

fn lc02_exchange([a, f, x, y, ..]: [u8; CHOICE]) -> Exchange<'static> {
    use lc02::{Outputs, Request};
    let width = PulseWidth::from_tenths(y).unwrap_or(PulseWidth::DEFAULT);
    let one = Channel::new(x % 8).map(|channel| Outputs::One(channel, y & 1 == 1));
    let request = match f % 8 {
        0 => Request::ReadConfig,
        1 => Request::WriteConfig {
            new_address: address(x),
            baud_code: y,
        },
        2 | 3 => Request::ReadData,
        4 => Request::WriteOutputs(Outputs::All(x)),
        5 => Request::WriteOutputs(one.unwrap_or(Outputs::All(x))),
        6 => Request::WritePulse { mask: x, width },
        _ => Request::ReadPulse,
    };
    Exchange::lc02(address(a), request)
}

fn r55_exchange([a, f, d1, d2, d3, d4, ..]: [u8; CHOICE]) -> Exchange<'static> {
    // Built through the decoder, which r55_request tests.
    const CODES: [u8; 23] = [
        0x10, 0x11, 0x12, 0x13, 0x14, 0x15, 0x16, 0x20, 0x21, 0x22, 0x30, 0x31, 0x32, 0x33, 0x34,
        0x35, 0x36, 0x37, 0x38, 0x40, 0x41, 0x70, 0x71,
    ];
    let code = CODES[usize::from(f) % CODES.len()];
    let mut frame = [0x55, address(a).0, code, d1, d2, d3, d4 % 32 + 1, 0];
    frame[7] = sum8(&frame[..7]);
    let exchange = r55::Exchange::decode_request(&frame).whole();
    Exchange::R55(exchange.expect("a good frame"))
}
