//! The LCUS USB relay boards: `A0 channel state sum`, four bytes, mostly without a reply.
//!
//! Not one of the line protocols of railbus; here so that these frames are recognised.

use crate::{Decoded, Frame, Malformed, decoded::need, sum8};

/// Switches one relay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The relay, as on the wire: 1-based.
    pub channel: u8,
    /// On or off.
    pub on: bool,
}

impl Request {
    /// Writes the frame.
    pub fn encode(&self, out: &mut Frame) {
        let head = [0xA0, self.channel, u8::from(self.on)];
        let [start, channel, on] = head;
        out.set([start, channel, on, sum8(&head)]);
    }

    /// Decodes the beginning of `rx` as such a frame.
    pub fn decode(rx: &[u8]) -> Decoded<Request> {
        match need::<4>(rx) {
            Err(more) => Decoded::Partial { more },
            Ok(&[0xA0, channel, state, sum]) => {
                if sum != sum8(&[0xA0, channel, state]) {
                    return Decoded::Malformed(Malformed::Checksum);
                }
                match state {
                    0 | 1 => Decoded::Whole {
                        len: 4,
                        value: Request {
                            channel,
                            on: state == 1,
                        },
                    },
                    _ => Decoded::Malformed(Malformed::Value),
                }
            }
            Ok(_) => Decoded::Malformed(Malformed::Start),
        }
    }
}
