//! Raw frames.

use crate::Risk;
use railbus_wire::{Bits, Decoded, Exchange, Frame, Protocol, Words, ascii, lc02, r55, rtu};

/// The request that exactly these bytes are, checksum included; `None` if they are none, or one
/// longer than any module accepts. If an ASCII frame can be read with and without a checksum, the
/// reading with the greater effect is returned.
#[must_use]
pub fn request(protocol: Protocol, bytes: &[u8]) -> Option<Exchange<'static>> {
    readings(protocol, bytes).max_by_key(Risk::of)
}

/// The read that these bytes are; `None` if they are not a read.
#[must_use]
pub fn read_request(protocol: Protocol, bytes: &[u8]) -> Option<Exchange<'static>> {
    readings(protocol, bytes).find(|exchange| Risk::of(exchange) == Risk::Read)
}

/// What these bytes may be. An ASCII frame may or may not carry a checksum.
fn readings(protocol: Protocol, bytes: &[u8]) -> impl Iterator<Item = Exchange<'static>> {
    let found = match protocol {
        Protocol::Rtu => [rtu_request(bytes).map(Exchange::Rtu), None],
        Protocol::Lc02 => {
            let whole = all_of(lc02::Exchange::decode_request(bytes), bytes);
            [whole.map(Exchange::Lc02), None]
        }
        Protocol::R55 => {
            let whole = all_of(r55::Exchange::decode_request(bytes), bytes);
            [whole.map(Exchange::R55), None]
        }
        Protocol::Ascii => [false, true].map(|checksum| {
            let rules = ascii::DecodeRules {
                checksum,
                lower_case: false,
            };
            all_of(ascii::Exchange::decode_request(bytes, rules), bytes).map(Exchange::Ascii)
        }),
    };
    // What is sent is the exchange, encoded again.
    let is_same = |exchange: &Exchange<'_>| {
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        frame.bytes() == bytes
    };
    found
        .into_iter()
        .flatten()
        .filter(is_same)
        .collect::<Vec<_>>()
        .into_iter()
}

fn rtu_request(bytes: &[u8]) -> Option<rtu::Exchange<'static>> {
    use rtu::Request as R;
    let rtu::Exchange { address, request } = rtu::Exchange::decode_frame(bytes).ok()?;
    let request = match request {
        R::ReadCoils(span) => R::ReadCoils(span),
        R::ReadDiscreteInputs(span) => R::ReadDiscreteInputs(span),
        R::ReadHoldingRegisters(span) => R::ReadHoldingRegisters(span),
        R::ReadInputRegisters(span) => R::ReadInputRegisters(span),
        R::Diagnose { sub, data } => R::Diagnose { sub, data },
        R::Identify { code, object } => R::Identify { code, object },
        R::WriteCoil { at, value } => R::WriteCoil { at, value },
        R::WriteRegister { at, value } => R::WriteRegister { at, value },
        R::WriteCoils(block) => {
            let values = Bits::from_mask(block.values().to_mask(), block.values().len())?;
            R::WriteCoils(rtu::BitBlock::new(block.start(), values)?)
        }
        R::WriteRegisters(block) => {
            let values = match (block.values().len(), block.values().get(0)?) {
                (1, word) => Words::one(word),
                (2, word) => Words::two(word, block.values().get(1)?),
                _ => return None,
            };
            R::WriteRegisters(rtu::WordBlock::new(block.start(), values)?)
        }
    };
    Some(rtu::Exchange { address, request })
}

/// The value of a frame that consists of nothing else.
fn all_of<T>(decoded: Decoded<T>, bytes: &[u8]) -> Option<T> {
    match decoded {
        Decoded::Whole { len, value } if len == bytes.len() => Some(value),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_pass_and_nothing_else_does() {
        let passes = |protocol, bytes: &[u8]| read_request(protocol, bytes).is_some();
        let coils = [0x03, 0x01, 0x00, 0x3C, 0x00, 0x08, 0xFC, 0x22];
        assert!(passes(Protocol::Rtu, &coils));
        let on = [0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00, 0x4D, 0xD4];
        assert!(!passes(Protocol::Rtu, &on));
        let counter = [0x03, 0x08, 0x00, 0x0C, 0x00, 0x00, 0x21, 0xEA];
        assert!(passes(Protocol::Rtu, &counter));
        let mute = [0x03, 0x08, 0x00, 0x04, 0x00, 0x00, 0xA0, 0x28];
        assert!(!passes(Protocol::Rtu, &mute));
        assert!(passes(Protocol::Ascii, b"$016\r"));
        assert!(!passes(Protocol::Ascii, b"#010001\r"));
        assert!(!passes(Protocol::Ascii, b"$016\r$016\r"));
        let state = [0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69];
        assert!(passes(Protocol::R55, &state));
        assert!(!passes(
            Protocol::R55,
            &[0x55, 0x04, 0x10, 0, 0, 0, 0, 0x6A]
        ));
        assert!(!passes(Protocol::Lc02, &[]));
    }
}
