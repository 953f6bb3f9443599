//! The meanings of bytes in each protocol: as they are, or as they would be with the right
//! checksum.

use super::meaning;
use railbus_wire::{
    Address, Decoded, Exchange, Protocol, ascii, crc16, lc02, lcus, r55, rtu, sum8,
};
use railbus_words::{Lang, say};

/// One way to decode the bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decoding {
    /// The name of the protocol.
    pub protocol: &'static str,
    /// It is a reply, not a request.
    pub reply: bool,
    /// The address it is sent to, or comes from.
    pub address: Option<Address>,
    /// Its meaning.
    pub meaning: String,
    /// Its checksum.
    pub check: Check,
}

/// The checksum.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Check {
    /// The frame has none.
    None,
    /// It is right.
    Right(String),
    /// It is wrong.
    Wrong {
        /// The checksum found.
        is: String,
        /// The right one.
        should: String,
    },
}

impl Decoding {
    /// Its checksum is right, or it has none.
    pub fn is_good(&self) -> bool {
        !matches!(self.check, Check::Wrong { .. })
    }
}

/// All decodings, best first.
pub fn of(lang: Lang, bytes: &[u8]) -> Vec<Decoding> {
    let mut decodings = Vec::new();
    for protocol in [
        Protocol::R55,
        Protocol::Lc02,
        Protocol::Ascii,
        Protocol::Rtu,
    ] {
        for (frame, check) in checked(protocol, bytes) {
            decodings.extend(in_protocol(lang, protocol, &frame, &check));
        }
    }
    if let Decoded::Whole { len: 4, value } = lcus::Request::decode(bytes)
        && bytes.len() == 4
    {
        let (n, state) = (value.channel, crate::render::values::state(lang, value.on));
        decodings.push(Decoding {
            protocol: "lcus",
            reply: false,
            address: None,
            meaning: say!(
                lang,
                "relay {n} {state} (USB relay board)",
                "继电器 {n} {state}（USB 继电器板）"
            ),
            check: Check::Right(hex(bytes.get(3..).unwrap_or_default())),
        });
    }
    decodings.sort_by_key(|decoding| (!decoding.is_good(), unlikely(decoding)));
    let mut seen: Vec<Decoding> = Vec::new();
    for decoding in decodings {
        if !seen.contains(&decoding) {
            seen.push(decoding);
        }
    }
    seen
}

/// A Modbus RTU frame is recognised by nothing but its CRC: with a wrong one, protocols that also
/// have start and end markers are likelier.
fn unlikely(decoding: &Decoding) -> bool {
    decoding.protocol == Protocol::Rtu.name() && !decoding.is_good()
}

/// The bytes with the right checksum, and the notes about the original.
pub fn checked(protocol: Protocol, bytes: &[u8]) -> Vec<(Vec<u8>, Check)> {
    let verdict = |at: std::ops::Range<usize>, should: Vec<u8>| {
        let is = bytes.get(at.clone())?;
        let check = if is == should {
            Check::Right(hex(is))
        } else {
            Check::Wrong {
                is: hex(is),
                should: hex(&should),
            }
        };
        let mut frame = bytes.to_vec();
        frame.splice(at, should);
        Some((frame, check))
    };
    let len = bytes.len();
    let head = |end: usize| bytes.get(..end).unwrap_or_default();
    match protocol {
        Protocol::Rtu if len >= 4 => {
            let crc = crc16(head(len - 2)).to_le_bytes().to_vec();
            verdict(len - 2..len, crc).into_iter().collect()
        }
        Protocol::R55 if len == r55::FRAME_LEN => {
            let sum = vec![sum8(head(len - 1))];
            verdict(len - 1..len, sum).into_iter().collect()
        }
        Protocol::Lc02 if len >= 5 && bytes.last() == Some(&lc02::envelope::END) => {
            let body = bytes.get(2..len - 2).unwrap_or_default();
            verdict(len - 2..len - 1, vec![sum8(body)])
                .into_iter()
                .collect()
        }
        Protocol::Ascii if bytes.last() == Some(&ascii::CR) => {
            let mut frames = vec![(bytes.to_vec(), Check::None)];
            if len > 4 {
                let sum = format!("{:02X}", sum8(head(len - 3))).into_bytes();
                let text = |digits: &[u8]| String::from_utf8_lossy(digits).into_owned();
                let is = bytes.get(len - 3..len - 1).unwrap_or_default();
                if is == sum {
                    frames.insert(0, (bytes.to_vec(), Check::Right(text(is))));
                }
            }
            frames
        }
        _ => Vec::new(),
    }
}

fn in_protocol(lang: Lang, protocol: Protocol, frame: &[u8], check: &Check) -> Vec<Decoding> {
    let decoding = |reply, address, meaning| Decoding {
        protocol: protocol.name(),
        reply,
        address,
        meaning,
        check: check.clone(),
    };
    let mut decodings = Vec::new();
    match request(protocol, frame, check) {
        Some(Ok(exchange)) => {
            let broadcast = matches!(exchange, Exchange::Ascii(e) if e.request.is_broadcast());
            let address = (!broadcast).then_some(exchange.address());
            decodings.push(decoding(false, address, meaning::request(lang, &exchange)));
        }
        Some(Err((address, code))) => decodings.push(decoding(
            false,
            Some(address),
            say!(
                lang,
                "unknown function {code:02X}h",
                "未知功能码 {code:02X}h"
            ),
        )),
        None => {}
    }
    for (exchange, response, from) in railbus_sniff::replies(frame) {
        let summed = matches!(exchange, Exchange::Ascii(e) if e.checksum);
        let fits = exchange.protocol() == protocol
            && (protocol != Protocol::Ascii || summed == matches!(check, Check::Right(_)));
        if fits {
            decodings.push(decoding(
                true,
                from,
                meaning::response(lang, &exchange, &response),
            ));
        }
    }
    decodings
}

/// The request that a whole frame is, or an unknown function.
fn request<'a>(
    protocol: Protocol,
    frame: &'a [u8],
    check: &Check,
) -> Option<Result<Exchange<'a>, (Address, u8)>> {
    let whole = |len: usize| len == frame.len();
    match protocol {
        Protocol::Rtu => match rtu::Exchange::decode_frame(frame) {
            Ok(exchange) => Some(Ok(Exchange::Rtu(exchange))),
            Err(rtu::RequestError::Function { address, code })
                if code < 0x80 && matches!(check, Check::Right(_)) =>
            {
                Some(Err((address, code)))
            }
            Err(_) => None,
        },
        Protocol::R55 => match (r55::Exchange::decode_request(frame), frame) {
            (Decoded::Whole { len, value }, _) if whole(len) => Some(Ok(Exchange::R55(value))),
            (_, [r55::REQUEST_START, address, code, ..]) => Some(Err((Address(*address), *code))),
            _ => None,
        },
        Protocol::Lc02 => match lc02::Exchange::decode_request(frame) {
            Decoded::Whole { len, value } if whole(len) => Some(Ok(Exchange::Lc02(value))),
            _ => None,
        },
        Protocol::Ascii => {
            let rules = ascii::DecodeRules {
                checksum: matches!(check, Check::Right(_)),
                lower_case: true,
            };
            match ascii::Exchange::decode_request(frame, rules) {
                Decoded::Whole { len, value } if whole(len) => Some(Ok(Exchange::Ascii(value))),
                _ => None,
            }
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    railbus_words::hex::spaced(bytes)
}

/// The checksum of a frame of that protocol and the right one, if it is wrong.
pub fn wrong_check(protocol: Protocol, bytes: &[u8]) -> Option<(String, String)> {
    let checks = checked(protocol, bytes).into_iter();
    checks
        .map(|(_, check)| check)
        .find_map(|check| match check {
            Check::Wrong { is, should } => Some((is, should)),
            Check::None | Check::Right(_) => None,
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_words::hex::parse;

    fn best(text: &str) -> Decoding {
        let bytes = parse(text).unwrap();
        of(Lang::En, &bytes).remove(0)
    }

    #[test]
    fn frames_of_the_datasheets_are_read() {
        for (frame, protocol, reply, address, meaning) in [
            (
                "03 01 00 3C 00 08 FC 22",
                "rtu",
                false,
                Some(3),
                "read 8 coils from 60",
            ),
            (
                "03 05 00 3C FF 00 4D D4",
                "rtu",
                false,
                Some(3),
                "coil 60 on",
            ),
            (
                "01 81 02 C1 91",
                "rtu",
                true,
                Some(1),
                "refused: exception 02 illegal data address",
            ),
            (
                "55 04 10 00 00 00 00 69",
                "r55",
                false,
                Some(4),
                "read state",
            ),
            ("22 04 10 00 00 00 05 3B", "r55", true, Some(4), "k1 k3 on"),
            (
                "4C 57 01 03 04 0D",
                "lc02",
                false,
                Some(1),
                "read outputs and inputs",
            ),
            ("$01M", "ascii", false, Some(1), "read name"),
            (
                "!030200",
                "ascii",
                true,
                None,
                "outputs do0 do1 on; inputs di1 on",
            ),
            (
                "A0 01 01 A2",
                "lcus",
                false,
                None,
                "relay 1 on (USB relay board)",
            ),
        ] {
            let best = best(frame);
            assert!(best.is_good(), "{best:?}");
            assert_eq!((best.protocol, best.reply), (protocol, reply), "{best:?}");
            assert_eq!(best.address.map(|address| address.0), address, "{best:?}");
            assert_eq!(best.meaning, meaning);
        }
    }

    #[test]
    fn a_wrong_checksum_is_named_and_the_rest_is_read() {
        let decoding = best("6C 63 01 03 22 34 0D");
        assert_eq!(decoding.protocol, "lc02");
        assert_eq!(decoding.meaning, "outputs do0 do1 on; inputs di1 di5 on");
        let check = Check::Wrong {
            is: "34".to_owned(),
            should: "26".to_owned(),
        };
        assert_eq!(decoding.check, check);
    }

    #[test]
    fn bytes_that_are_two_things_are_read_as_both() {
        let bytes = parse("55 01 00 03 00 04 C0 1D").unwrap();
        let decodings = of(Lang::En, &bytes);
        let protocols: Vec<&str> = decodings.iter().map(|decoding| decoding.protocol).collect();
        assert!(
            protocols.contains(&"rtu") && protocols.contains(&"r55"),
            "{decodings:?}"
        );
        assert!(decodings.iter().take(2).all(Decoding::is_good));
    }

    #[test]
    fn any_bytes_are_read_without_harm() {
        let mut seed = 1_u32;
        for len in 0..64 {
            for _ in 0..50 {
                let bytes: Vec<u8> = (0..len)
                    .map(|_| {
                        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        (seed >> 24) as u8
                    })
                    .collect();
                of(Lang::Zh, &bytes);
            }
        }
    }
}
