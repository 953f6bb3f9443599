//! Finds what begins at a position, in any protocol.

use crate::frame::{FrameRole, FrameVerdict, Reading};
use crate::replies;
use railbus_wire::{
    Address, Decoded, Exchange, Malformed, Protocol, Response, ascii, lc02, r55, rtu, sum8,
};

/// The longest line of printable characters that is taken for an ASCII frame. Modules of other
/// makers send eight analog values in one.
const LINE_MAX: usize = 128;

/// How certain a reading is, least certain first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Trust {
    /// The envelope of a protocol around unknown content.
    Envelope,
    /// Start and end marks.
    Marks,
    /// An 8-bit sum.
    Sum,
    /// A 16-bit CRC.
    Crc,
    /// The reply to the previous request.
    Paired,
}

/// A frame that was found.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Find {
    pub(crate) len: usize,
    pub(crate) trust: Trust,
    pub(crate) reading: Reading,
    pub(crate) verdict: FrameVerdict,
}

/// All frames that begin at one position.
#[derive(Debug, Default)]
pub(crate) struct Look {
    pub(crate) finds: Vec<Find>,
    /// Something may have begun that needs more bytes.
    pub(crate) partial: bool,
    /// That is a Modbus RTU frame.
    pub(crate) partial_rtu: bool,
}

impl Look {
    /// The likeliest frame. Some replies repeat their request: after its timeout (`late`), such
    /// bytes are the request again.
    pub(crate) fn best(&self, late: bool) -> Option<Find> {
        let key = |find: &&Find| (find.trust, find.len);
        // The first of equals.
        let best = self.finds.iter().rev().max_by_key(key).copied()?;
        let again = |find: &&Find| {
            find.len == best.len
                && find.reading.role == Some(FrameRole::Request)
                && find.reading.protocol == best.reading.protocol
        };
        let again = self.finds.iter().find(again).copied();
        Some(again.filter(|_| late).unwrap_or(best))
    }

    /// All readings of the best frame's bytes, the best first: one for each protocol and role.
    pub(crate) fn readings(&self, best: Find) -> Vec<Reading> {
        let mut readings = vec![best.reading];
        let paired = best.trust == Trust::Paired;
        for find in self.finds.iter().filter(|find| find.len == best.len) {
            let same = |known: &Reading| {
                let as_good = known.protocol == find.reading.protocol;
                as_good && (paired || known.checksum == find.reading.checksum)
            };
            let weak = find.trust == Trust::Envelope && best.trust == Trust::Paired;
            if !weak && !readings.iter().any(same) {
                readings.push(find.reading);
            }
        }
        readings
    }

    fn add(&mut self, decoded: &Decoded<Reading>, trust: Trust, verdict: FrameVerdict) {
        match *decoded {
            Decoded::Whole { len, value } => self.finds.push(Find {
                len,
                trust,
                reading: value,
                verdict,
            }),
            Decoded::Partial { .. } => self.partial = true,
            Decoded::Malformed(_) => {}
        }
    }
}

/// Looks at the beginning of `rx`; `pending` is the request that waits for its reply.
pub(crate) fn look(rx: &[u8], pending: Option<&Exchange<'_>>) -> Look {
    let mut look = Look::default();
    let lines = ascii_line(rx);
    if let Some(asked) = pending
        && !(asked.protocol() == Protocol::Ascii && lines == Line::None)
    {
        let decoded = asked.decode_response(rx);
        look.partial_rtu |=
            matches!(asked, Exchange::Rtu(_)) && matches!(decoded, Decoded::Partial { .. });
        reply(&mut look, asked, decoded, Trust::Paired);
    }
    match rx.first() {
        Some(&(r55::REQUEST_START | r55::RESPONSE_START)) => of_r55(&mut look, rx),
        Some(b'L' | b'l') => of_lc02(&mut look, rx),
        Some(_) if lines != Line::None => of_ascii(&mut look, rx, lines, pending),
        _ => {}
    }
    of_rtu(&mut look, rx);
    look
}

/// Adds a reply to a known or assumed request.
fn reply(
    look: &mut Look,
    asked: &Exchange<'_>,
    decoded: Decoded<railbus_wire::Reply<Response<'_>>>,
    trust: Trust,
) {
    let mut verdict = FrameVerdict::Good;
    let paired = (trust == Trust::Paired).then(|| asked.address());
    let checksum = matches!(asked, Exchange::Ascii(e) if e.checksum);
    let decoded = decoded.map(|reply| {
        if is_refusal(&reply.response) {
            verdict = FrameVerdict::Refused;
        }
        Reading {
            protocol: asked.protocol(),
            role: Some(FrameRole::Reply),
            checksum,
            address: reply.from.or(paired),
        }
    });
    look.add(&decoded, trust, verdict);
}

const fn is_refusal(response: &Response<'_>) -> bool {
    matches!(
        response,
        Response::Rtu(rtu::Response::Exception(_))
            | Response::Ascii(ascii::Response::Invalid | ascii::Response::Ignored)
    )
}

fn request(protocol: Protocol, address: Option<Address>, checksum: bool) -> Reading {
    Reading {
        protocol,
        role: Some(FrameRole::Request),
        checksum,
        address,
    }
}

fn of_r55(look: &mut Look, rx: &[u8]) {
    let before = look.finds.len();
    let decoded = r55::Exchange::decode_request(rx);
    let decoded = decoded.map(|e| request(Protocol::R55, Some(e.address()), false));
    look.add(&decoded, Trust::Sum, FrameVerdict::Good);
    if let Some(asked) = replies::candidate_r55(rx) {
        reply(look, &asked, asked.decode_response(rx), Trust::Sum);
    }
    let Some(&[start, address, _, _, _, _, _, sum]) = rx.first_chunk::<{ r55::FRAME_LEN }>() else {
        look.partial = true;
        return;
    };
    let right = rx.get(..7).is_some_and(|head| sum8(head) == sum);
    if right && look.finds.len() == before {
        let role = match start {
            r55::REQUEST_START => FrameRole::Request,
            _ => FrameRole::Reply,
        };
        look.finds.push(Find {
            len: r55::FRAME_LEN,
            trust: Trust::Envelope,
            reading: Reading {
                protocol: Protocol::R55,
                role: Some(role),
                checksum: false,
                address: Some(Address(address)),
            },
            verdict: FrameVerdict::Unknown,
        });
    }
}

fn of_lc02(look: &mut Look, rx: &[u8]) {
    let decoded = lc02::Exchange::decode_request(rx);
    let decoded = decoded.map(|e| request(Protocol::Lc02, Some(e.address), false));
    look.add(&decoded, Trust::Sum, FrameVerdict::Good);
    if rx.len() < 3 && b"lc".starts_with(rx) {
        look.partial = true;
    }
    for asked in replies::candidates_lc02(rx) {
        reply(look, &asked, asked.decode_response(rx), Trust::Sum);
    }
}

fn of_rtu(look: &mut Look, rx: &[u8]) {
    let decoded = rtu::Exchange::decode_request(rx);
    look.partial_rtu |= matches!(decoded, Decoded::Partial { .. });
    let decoded = decoded.map(|e| request(Protocol::Rtu, Some(e.address), false));
    look.add(&decoded, Trust::Crc, FrameVerdict::Good);
    match replies::candidate_rtu(rx) {
        Some(asked) => {
            let decoded = asked.decode_response(rx);
            look.partial_rtu |= matches!(decoded, Decoded::Partial { .. });
            reply(look, &asked, decoded, Trust::Crc);
        }
        // An exception or reply, too short yet to tell its request.
        None if rx.len() < 6 && function(rx).is_some() => {
            look.partial = true;
            look.partial_rtu = true;
        }
        None => {}
    }
}

/// The Modbus function in the second byte.
fn function(rx: &[u8]) -> Option<rtu::Function> {
    rtu::Function::from_code(rx.get(1)? & 0x7F)
}

/// Whether printable characters from a delimiter on are a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    None,
    Begun,
    Whole(usize),
}

fn ascii_line(rx: &[u8]) -> Line {
    if !matches!(
        rx.first(),
        Some(b'$' | b'%' | b'#' | b'@' | b'~' | b'!' | b'>' | b'?')
    ) {
        return Line::None;
    }
    for (at, byte) in rx.iter().enumerate().take(LINE_MAX) {
        match byte {
            &ascii::CR => return Line::Whole(at + 1),
            b' '..=b'~' => {}
            _ => return Line::None,
        }
    }
    match rx.len() {
        LINE_MAX.. => Line::None,
        _ => Line::Begun,
    }
}

fn of_ascii(look: &mut Look, rx: &[u8], line: Line, pending: Option<&Exchange<'_>>) {
    let Line::Whole(len) = line else {
        look.partial = true;
        return;
    };
    let Some(rx) = rx.get(..len) else { return };
    for checksum in [true, false] {
        let rules = ascii::DecodeRules {
            checksum,
            lower_case: true,
        };
        let decoded = ascii::Exchange::decode_request(rx, rules);
        let decoded = decoded.map(|e| {
            let address = (!e.request.is_broadcast()).then_some(e.address);
            request(Protocol::Ascii, address, checksum)
        });
        look.add(&decoded, by_sum(checksum), FrameVerdict::Good);
    }
    // An ASCII reply does not say what it answers: if a request is pending, only that can tell
    // whether it is valid, unless it contains another module's address.
    let judged = match pending {
        Some(asked @ Exchange::Ascii(_)) => !matches!(
            asked.decode_response(rx),
            Decoded::Malformed(Malformed::Address | Malformed::Start)
        ),
        _ => false,
    };
    if !judged {
        for asked in replies::candidates_ascii(rx) {
            let summed = matches!(asked, Exchange::Ascii(e) if e.checksum);
            reply(look, &asked, asked.decode_response(rx), by_sum(summed));
        }
    }
    let is_reply = matches!(rx.first(), Some(b'!' | b'>' | b'?'));
    if look.finds.is_empty() && !(judged && is_reply) {
        let role = if is_reply {
            FrameRole::Reply
        } else {
            FrameRole::Request
        };
        let rules = ascii::DecodeRules {
            checksum: false,
            lower_case: true,
        };
        look.finds.push(Find {
            len,
            trust: Trust::Envelope,
            reading: Reading {
                protocol: Protocol::Ascii,
                role: Some(role),
                checksum: false,
                address: ascii::address_of(rx, rules).filter(|_| !is_reply),
            },
            verdict: FrameVerdict::Unknown,
        });
    }
}

const fn by_sum(checksum: bool) -> Trust {
    if checksum { Trust::Sum } else { Trust::Marks }
}
