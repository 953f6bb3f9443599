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
                let rules = ascii::Rules {
                    checksum,
                    lower_case: true,
                };
                whole(&ascii::Exchange::decode_request(rest, rules))
            })
        }),
    }
}

const fn whole<T>(decoded: &Decoded<T>) -> bool {
    matches!(decoded, Decoded::Whole { .. })
}
