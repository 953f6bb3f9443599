//! Device identification: function 2B, kind 0E [BEYOND §5].

use super::{Exchange, close};
use crate::decoded::need;
use crate::{Address, Decoded, FRAME_MAX, Frame, Malformed, Reply, crc16, rtu};

/// The kind of function 2B used here: device identification.
pub(super) const KIND: u8 = 0x0E;
/// Conformity: basic and regular objects, as a stream and individually.
const CONFORMITY: u8 = 0x82;
/// Code, conformity, more, next and count precede the objects.
const HEAD: usize = 5;

/// The identification of a module: objects, each a number and a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identification<'a>(&'a [u8]);

impl<'a> Identification<'a> {
    /// The maker.
    pub const VENDOR: u8 = 0;
    /// The maker's product code.
    pub const PRODUCT: u8 = 1;
    /// The version of its firmware.
    pub const REVISION: u8 = 2;
    /// Where to find its documentation.
    pub const URL: u8 = 3;
    /// Its product name.
    pub const NAME: u8 = 4;

    /// From the code on: code, conformity, more, next, count, objects; none if the number or length
    /// of the objects is wrong.
    #[must_use]
    pub fn from_packed(bytes: &'a [u8]) -> Option<Identification<'a>> {
        match measure(bytes) {
            Ok(len) if len == bytes.len() => Some(Identification(bytes)),
            _ => None,
        }
    }

    /// The bytes from the code on.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.0
    }

    /// The objects in order: number and bytes, which should be ASCII.
    pub fn objects(&self) -> impl Iterator<Item = (u8, &'a [u8])> + use<'a> {
        let mut rest = self.0.get(HEAD..).unwrap_or_default();
        core::iter::from_fn(move || {
            let (&[number, len], after) = rest.split_first_chunk::<2>()?;
            let (object, after) = after.split_at_checked(usize::from(len))?;
            rest = after;
            Some((number, object))
        })
    }

    /// The object with that number.
    #[must_use]
    pub fn object(&self, number: u8) -> Option<&'a [u8]> {
        self.objects().find(|(n, _)| *n == number).map(|(_, o)| o)
    }
}

/// How many bytes it has from the code on, or the least number of missing bytes.
fn measure(bytes: &[u8]) -> Result<usize, usize> {
    let &[_, _, _, _, count] = need::<HEAD>(bytes)?;
    let mut len = HEAD;
    for _ in 0..count {
        let Some(object) = bytes.get(len + 1) else {
            return Err(len + 2 - bytes.len());
        };
        len += 2 + usize::from(*object);
    }
    len.checked_sub(bytes.len())
        .filter(|missing| *missing > 0)
        .map_or(Ok(len), Err)
}

/// Writes the reply of the module at `from` with all these objects.
pub fn encode_identification(from: Address, code: u8, objects: &[(u8, &str)], out: &mut Frame) {
    let function = rtu::Function::Identify.code();
    out.set([from.0, function, KIND, code, CONFORMITY, 0, 0]);
    out.push(objects.len() as u8);
    for (number, text) in objects {
        out.extend(&[*number, text.len() as u8]);
        out.extend(text.as_bytes());
    }
    close(out);
}

impl Exchange<'_> {
    /// Decodes a reply to function 2B with this code, after address and function were checked.
    pub(super) fn decode_identification<'r>(
        &self,
        asked: u8,
        rx: &'r [u8],
    ) -> Decoded<Reply<rtu::Response<'r>>> {
        match rx.get(2..4).unwrap_or_default() {
            [KIND, code] if *code == asked => {}
            [KIND, _] => return Decoded::Malformed(Malformed::Echo),
            [] | [_] => {
                return Decoded::Partial {
                    more: 10 - rx.len(),
                };
            }
            _ => return Decoded::Malformed(Malformed::Function),
        }
        let len = match measure(rx.get(3..).unwrap_or_default()) {
            Ok(len) => 3 + len + 2,
            Err(more) if rx.len() + more + 2 > FRAME_MAX => {
                return Decoded::Malformed(Malformed::Length);
            }
            Err(more) => return Decoded::Partial { more: more + 2 },
        };
        if len > FRAME_MAX {
            return Decoded::Malformed(Malformed::Length);
        }
        let Some(frame) = rx.get(..len) else {
            return Decoded::Partial {
                more: len - rx.len(),
            };
        };
        if crc16(frame) != 0 {
            return Decoded::Malformed(Malformed::Checksum);
        }
        let says = frame.get(3..len - 2).and_then(Identification::from_packed);
        match (says, frame.first()) {
            (Some(says), Some(&from)) => {
                Reply::whole(len, Address(from), rtu::Response::Identification(says))
            }
            _ => Decoded::Malformed(Malformed::Length),
        }
    }
}
