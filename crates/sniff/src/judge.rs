//! Judges bytes between valid frames.

use crate::frame::{Flaw, FrameRole, FrameVerdict, Reading};
use railbus_wire::{Address, Decoded, Exchange, Malformed, Protocol, crc16, lc02, r55, rtu};

/// What bytes that match no protocol probably were.
pub(crate) fn judge(bytes: &[u8], pending: Option<&Exchange<'_>>) -> (Vec<Reading>, FrameVerdict) {
    let found = whole_but_unknown(bytes)
        .or_else(|| bare_exception(bytes, pending))
        .or_else(|| broken_reply(bytes, pending))
        .or_else(|| marked(bytes))
        .or_else(|| broken_rtu(bytes));
    match found {
        Some((reading, verdict)) => (vec![reading], verdict),
        None => (Vec::new(), FrameVerdict::Bad(Flaw::Foreign)),
    }
}

type Found = Option<(Reading, FrameVerdict)>;

fn reading(protocol: Protocol, role: Option<FrameRole>, address: Option<u8>) -> Reading {
    Reading {
        protocol,
        role,
        checksum: false,
        address: address.map(Address),
    }
}

/// A correct CRC around an unknown function, whose length only silence determines.
fn whole_but_unknown(bytes: &[u8]) -> Found {
    let &[address, code, .., _, _] = bytes else {
        return None;
    };
    if bytes.len() > railbus_wire::FRAME_MAX || crc16(bytes) != 0 {
        return None;
    }
    if bytes.len() == 5 && code & 0x80 != 0 {
        let reply = reading(Protocol::Rtu, Some(FrameRole::Reply), Some(address));
        return Some((reply, FrameVerdict::Refused));
    }
    Some((
        reading(Protocol::Rtu, None, Some(address)),
        FrameVerdict::Unknown,
    ))
}

/// Some modules send exceptions without CRC [ERC-8 §5.2].
fn bare_exception(bytes: &[u8], pending: Option<&Exchange<'_>>) -> Found {
    let Some(Exchange::Rtu(asked)) = pending else {
        return None;
    };
    asked.decode_bare_exception(bytes)?;
    let reply = reading(Protocol::Rtu, Some(FrameRole::Reply), Some(asked.address.0));
    Some((reply, FrameVerdict::Refused))
}

/// Bytes that begin like the pending reply.
fn broken_reply(bytes: &[u8], pending: Option<&Exchange<'_>>) -> Found {
    let asked = pending?;
    let marked = matches!(bytes.first(), Some(b'!' | b'>' | b'?'));
    if asked.protocol() == Protocol::Ascii && !marked {
        return None;
    }
    let flaw = match asked.decode_response(bytes) {
        Decoded::Partial { .. } => Flaw::Short,
        Decoded::Malformed(Malformed::Checksum) => Flaw::Checksum,
        Decoded::Malformed(Malformed::Start | Malformed::Address | Malformed::Function) => {
            return None;
        }
        Decoded::Malformed(_) | Decoded::Whole { .. } => Flaw::Form,
    };
    // Longer than the reply can be: the end alone says nothing.
    if bytes.len() > asked.response_len_max().max(8) + 2 {
        return None;
    }
    let mut reply = reading(
        asked.protocol(),
        Some(FrameRole::Reply),
        Some(asked.address().0),
    );
    reply.checksum = matches!(asked, Exchange::Ascii(e) if e.checksum);
    Some((reply, FrameVerdict::Bad(flaw)))
}

/// Bytes with the marks of a protocol.
fn marked(bytes: &[u8]) -> Found {
    let bad = |reading, flaw| Some((reading, FrameVerdict::Bad(flaw)));
    let address = |at: usize| bytes.get(at).copied();
    match *bytes {
        [start @ (r55::REQUEST_START | r55::RESPONSE_START), ..]
            if bytes.len() <= r55::FRAME_LEN && broken_rtu(bytes).is_none() =>
        {
            let role = match start {
                r55::REQUEST_START => FrameRole::Request,
                _ => FrameRole::Reply,
            };
            let flaw = match bytes.len() {
                r55::FRAME_LEN => Flaw::Checksum,
                _ => Flaw::Short,
            };
            // A single byte is more likely noise than a board.
            (bytes.len() > 1).then_some(())?;
            bad(reading(Protocol::R55, Some(role), address(1)), flaw)
        }
        [b'L', b'W', ..] | [b'l', b'c', ..] => {
            let role = match bytes.first() {
                Some(b'L') => FrameRole::Request,
                _ => FrameRole::Reply,
            };
            let at = reading(Protocol::Lc02, Some(role), address(2));
            let ended = bytes.len() >= 5 && bytes.last() == Some(&lc02::envelope::END);
            let right = match bytes {
                [_, _, body @ .., sum, _] if ended => railbus_wire::sum8(body) == *sum,
                _ => false,
            };
            match (right, ended) {
                (true, _) => Some((at, FrameVerdict::Unknown)),
                (false, true) => bad(at, Flaw::Checksum),
                (false, false) => bad(at, Flaw::Short),
            }
        }
        [
            b'$' | b'%' | b'#' | b'@' | b'~' | b'!' | b'>' | b'?',
            ref rest @ ..,
        ] if rest.len() >= 2 && rest.iter().all(|byte| matches!(byte, b' '..=b'~')) => {
            let role = match bytes.first() {
                Some(b'!' | b'>' | b'?') => FrameRole::Reply,
                _ => FrameRole::Request,
            };
            bad(reading(Protocol::Ascii, Some(role), None), Flaw::Short)
        }
        _ => None,
    }
}

/// A Modbus RTU frame, judged by its function and its length alone.
fn broken_rtu(bytes: &[u8]) -> Found {
    let &[address, code, third, ..] = bytes else {
        return None;
    };
    let function = rtu::Function::from_code(code & 0x7F)?;
    let len = bytes.len();
    let counted = 5 + usize::from(third);
    use rtu::Function as F;
    let (as_request, as_reply) = match function {
        F::ReadCoils | F::ReadDiscreteInputs | F::ReadHoldingRegisters | F::ReadInputRegisters => {
            (len == 8, third > 0 && len == counted)
        }
        F::WriteCoil | F::WriteRegister => (len == 8, false),
        F::WriteCoils | F::WriteRegisters => {
            let bytes = bytes.get(6).copied().map(usize::from);
            (bytes.is_some_and(|bytes| len == 9 + bytes), len == 8)
        }
        F::Diagnose => (len == 8, false),
        F::Identify => (len == 7, third == 0x0E && len >= 10),
    };
    let role = match (code & 0x80 != 0, as_request, as_reply) {
        (true, _, _) if len == 5 => FrameRole::Reply,
        (false, true, _) => FrameRole::Request,
        (false, false, true) => FrameRole::Reply,
        _ => return None,
    };
    let at = reading(Protocol::Rtu, Some(role), Some(address));
    Some((at, FrameVerdict::Bad(Flaw::Checksum)))
}
