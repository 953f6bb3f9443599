//! What modules of other protocols on the same line would make of a frame.

use crate::{Decoded, Protocol, ascii, lc02, r55, rtu};

/// Whether modules that use `protocol` could take these bytes, sent in one go, for a command.
///
/// 0x55 boards, LC-02 and ASCII modules look for a frame at every byte; a Modbus module only takes
/// what silence delimits, so only all of it.
#[must_use]
pub fn carries_command(bytes: &[u8], protocol: Protocol) -> bool {
    let found = |is_whole: &dyn Fn(&[u8]) -> bool| {
        (0..bytes.len()).any(|skip| bytes.get(skip..).is_some_and(is_whole))
    };
    match protocol {
        Protocol::Rtu => rtu::Exchange::decode_frame(bytes).is_ok(),
        Protocol::R55 => found(&|rest| whole(&r55::Exchange::decode_request(rest))),
        Protocol::Lc02 => found(&|rest| whole(&lc02::Exchange::decode_request(rest))),
        Protocol::Ascii => found(&|rest| {
            [true, false].into_iter().any(|checksum| {
                let rules = ascii::DecodeRules {
                    checksum,
                    lower_case: true,
                };
                whole(&ascii::Exchange::decode_request(rest, rules))
            })
        }),
    }
}

/// The first of these protocols, other than the frame's own, whose modules could obey these bytes.
#[must_use]
pub fn foreign_command(
    bytes: &[u8],
    own: Protocol,
    others: impl IntoIterator<Item = Protocol>,
) -> Option<Protocol> {
    let mut others = others.into_iter().filter(|other| *other != own);
    others.find(|other| carries_command(bytes, *other))
}

const fn whole<T>(decoded: &Decoded<T>) -> bool {
    matches!(decoded, Decoded::Whole { .. })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_inside_a_frame_is_found() {
        let mut frame = [0; 17];
        frame[..7].copy_from_slice(&[0x01, 0x10, 0x00, 0x00, 0x00, 0x04, 0x08]);
        frame[7..15].copy_from_slice(&[0x55, 0x04, 0x12, 0, 0, 0, 1, 0x6C]);
        let sum = crate::crc16(&frame[..15]).to_le_bytes();
        frame[15..].copy_from_slice(&sum);
        let found = foreign_command(&frame, Protocol::Rtu, Protocol::ALL);
        assert_eq!(found, Some(Protocol::R55));
        let others = [Protocol::Rtu, Protocol::Ascii];
        assert_eq!(foreign_command(&frame, Protocol::Rtu, others), None);
    }
}
