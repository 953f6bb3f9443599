//! Modbus TCP: the header before each message, which takes the place of the CRC.
//!
//! A message is transaction, protocol (0) and length, of 16 bits each, high byte first; then what
//! the length counts: the unit, and the function with its data. There is no checksum
//! [MODBUS §5.1].

use crate::decoded::need;
use crate::{Address, Decoded, Malformed};

/// Transaction, protocol and length, in bytes.
pub const HEADER: usize = 6;
/// The least that the length counts: the unit and a function.
pub const INSIDE_MIN: usize = 2;
/// The most: the unit, and a function with its data of 253 bytes.
pub const INSIDE_MAX: usize = 254;
/// The longest message.
pub const MESSAGE_MAX: usize = HEADER + INSIDE_MAX;

/// A message of Modbus TCP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// The number that a client gives its request, and that the reply repeats.
    pub transaction: u16,
    /// The module behind the gateway.
    pub unit: Address,
    /// The function and its data.
    pub pdu: &'a [u8],
    /// The unit and the function with its data.
    pub inside: &'a [u8],
}

impl<'a> Message<'a> {
    /// Decodes the beginning of `rx`.
    ///
    /// What is malformed ends the connection: nothing says where the next message begins.
    #[inline]
    pub fn decode(rx: &'a [u8]) -> Decoded<Message<'a>> {
        let &[t1, t0, p1, p0, l1, l0] = match need::<HEADER>(rx) {
            Ok(header) => header,
            Err(more) => return Decoded::Partial { more },
        };
        if (p1, p0) != (0, 0) {
            return Decoded::Malformed(Malformed::Start);
        }
        let inside = usize::from(u16::from_be_bytes([l1, l0]));
        if !(INSIDE_MIN..=INSIDE_MAX).contains(&inside) {
            return Decoded::Malformed(Malformed::Length);
        }
        let len = HEADER + inside;
        let Some(inside) = rx.get(HEADER..len) else {
            return Decoded::Partial {
                more: len - rx.len(),
            };
        };
        let [unit, pdu @ ..] = inside else {
            return Decoded::Malformed(Malformed::Length);
        };
        let value = Message {
            transaction: u16::from_be_bytes([t1, t0]),
            unit: Address(*unit),
            pdu,
            inside,
        };
        Decoded::Whole { len, value }
    }
}

/// The header of a message; `inside` counts the unit and the function with its data, of
/// [`INSIDE_MIN`] to [`INSIDE_MAX`] bytes.
#[must_use]
#[inline]
pub const fn header(transaction: u16, inside: usize) -> [u8; HEADER] {
    let [t1, t0] = transaction.to_be_bytes();
    [t1, t0, 0, 0, 0, inside as u8]
}

#[cfg(test)]
mod tests {
    use super::*;

    const MESSAGE: [u8; 12] = [0x12, 0x34, 0, 0, 0, 6, 9, 1, 0, 60, 0, 1];

    /// [MODBUS §5.1] [MODBUS §5.3]
    #[test]
    fn a_message_may_come_in_any_pieces() {
        for cut in 0..MESSAGE.len() {
            let decoded = Message::decode(&MESSAGE[..cut]);
            let fits = |more| more >= 1 && cut + more <= MESSAGE.len();
            let is_partial = matches!(decoded, Decoded::Partial { more } if fits(more));
            assert!(is_partial, "{cut}: {decoded:?}");
        }
        let more = [&MESSAGE[..], &[0; 3]].concat();
        let whole = Message {
            transaction: 0x1234,
            unit: Address(9),
            pdu: &MESSAGE[7..],
            inside: &MESSAGE[6..],
        };
        assert_eq!(
            Message::decode(&more),
            Decoded::Whole {
                len: 12,
                value: whole
            }
        );
        assert_eq!(header(0x1234, 6), MESSAGE[..HEADER]);
    }

    /// [MODBUS §5.2]
    #[test]
    fn what_is_not_modbus_tcp_is_malformed() {
        for wrong in [
            [0, 1, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 1],
            [0, 1, 0, 0, 0, 255],
            [0, 1, 0, 0, 1, 0],
        ] {
            let decoded = Message::decode(&wrong);
            assert_eq!(decoded, Decoded::Malformed(Malformed::Length), "{wrong:?}");
        }
        for wrong in [[0, 1, 0, 1, 0, 4], *b"HTTP/1"] {
            let decoded = Message::decode(&wrong);
            assert_eq!(decoded, Decoded::Malformed(Malformed::Start), "{wrong:?}");
        }
    }
}
