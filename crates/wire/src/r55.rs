//! The relay boards whose requests begin with 55h and whose replies begin with 22h: always eight
//! bytes.
//!
//! `start address function D1 D2 D3 D4 sum`; D1 to D4 are one big-endian word, where bit 0 of D4 is
//! channel 1 and bit 7 of D1 is channel 32 [R55 §1]. Frames need no gap between them, so a board
//! looks for a frame at every byte.

use crate::decoded::need;
use crate::{Address, Channel, Decoded, Frame, Malformed, Reply, sum8};

/// The first byte of a request.
pub const REQUEST_START: u8 = 0x55;
/// The first byte of a reply.
pub const RESPONSE_START: u8 = 0x22;
/// The length of every frame in bytes.
pub const FRAME_LEN: usize = 8;
/// The address that every board listens to [R55 §4.1].
pub const BROADCAST: Address = Address(245);

/// A number of 24 bits: a jog time in milliseconds (up to 4.66 h) or an internal variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct U24(u32);

impl U24 {
    /// The number; none above 16 777 215.
    #[must_use]
    #[inline]
    pub const fn new(value: u32) -> Option<U24> {
        if value < 1 << 24 {
            Some(U24(value))
        } else {
            None
        }
    }

    /// The number, 0 to 16 777 215.
    #[must_use]
    pub const fn get(self) -> u32 {
        self.0
    }
}

/// A request. In masks and states bit 0 is channel 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// 10: read the state.
    ReadState,
    /// 11, 31: switch one relay off.
    Open(Channel),
    /// 12, 32: switch one relay on.
    Close(Channel),
    /// 13, 33: set all outputs to this state.
    SetAll(u32),
    /// 14, 34: switch the relays of the mask off, leave the others.
    GroupOff(u32),
    /// 15, 35: switch the relays of the mask on, leave the others.
    GroupOn(u32),
    /// 16, 36: toggle the relays of the mask, leave the others.
    GroupToggle(u32),
    /// 20, 30: toggle one relay.
    Toggle(Channel),
    /// 21, 37: switch on now, off after so many milliseconds.
    JogClose(Channel, U24),
    /// 22, 38: switch off now, on after so many milliseconds.
    JogOpen(Channel, U24),
    /// 40: read the address; sent to 245 if only one board is on the line.
    ReadAddress,
    /// 41: write the address, within 10 s of power-up.
    WriteAddress(Address),
    /// 70: read an internal variable.
    ReadVariable(u8),
    /// 71: write an internal variable.
    WriteVariable(u8, U24),
}

impl Request {
    /// The function code of the form with a reply.
    #[inline]
    const fn code(&self) -> u8 {
        match self {
            Request::ReadState => 0x10,
            Request::Open(_) => 0x11,
            Request::Close(_) => 0x12,
            Request::SetAll(_) => 0x13,
            Request::GroupOff(_) => 0x14,
            Request::GroupOn(_) => 0x15,
            Request::GroupToggle(_) => 0x16,
            Request::Toggle(_) => 0x20,
            Request::JogClose(..) => 0x21,
            Request::JogOpen(..) => 0x22,
            Request::ReadAddress => 0x40,
            Request::WriteAddress(_) => 0x41,
            Request::ReadVariable(_) => 0x70,
            Request::WriteVariable(..) => 0x71,
        }
    }

    /// The function code of the form without a reply: a table, not an offset [R55 §2.2].
    const fn silent_code(&self) -> Option<u8> {
        Some(match self {
            Request::Open(_) => 0x31,
            Request::Close(_) => 0x32,
            Request::SetAll(_) => 0x33,
            Request::GroupOff(_) => 0x34,
            Request::GroupOn(_) => 0x35,
            Request::GroupToggle(_) => 0x36,
            Request::Toggle(_) => 0x30,
            Request::JogClose(..) => 0x37,
            Request::JogOpen(..) => 0x38,
            Request::ReadState
            | Request::ReadAddress
            | Request::WriteAddress(_)
            | Request::ReadVariable(_)
            | Request::WriteVariable(..) => return None,
        })
    }

    #[inline]
    const fn data(&self) -> [u8; 4] {
        match *self {
            Request::ReadState | Request::ReadAddress => [0; 4],
            Request::Open(channel) | Request::Close(channel) | Request::Toggle(channel) => {
                low_byte(U24(0), channel.index() + 1)
            }
            Request::SetAll(word)
            | Request::GroupOff(word)
            | Request::GroupOn(word)
            | Request::GroupToggle(word) => word.to_be_bytes(),
            Request::JogClose(channel, time) | Request::JogOpen(channel, time) => {
                low_byte(time, channel.index() + 1)
            }
            Request::WriteAddress(new) => low_byte(U24(0), new.0),
            Request::ReadVariable(index) => low_byte(U24(0), index),
            Request::WriteVariable(index, value) => low_byte(value, index),
        }
    }

    /// The request for a function code and its data, and whether it gets a reply.
    #[inline]
    fn parse(code: u8, data: [u8; 4]) -> Result<(Request, bool), Malformed> {
        let word = u32::from_be_bytes(data);
        let [.., low] = data;
        let high = U24(word >> 8);
        let channel = || {
            low.checked_sub(1)
                .and_then(Channel::new)
                .ok_or(Malformed::Value)
        };
        let request = match code {
            0x10 => Request::ReadState,
            0x11 | 0x31 => Request::Open(channel()?),
            0x12 | 0x32 => Request::Close(channel()?),
            0x13 | 0x33 => Request::SetAll(word),
            0x14 | 0x34 => Request::GroupOff(word),
            0x15 | 0x35 => Request::GroupOn(word),
            0x16 | 0x36 => Request::GroupToggle(word),
            0x20 | 0x30 => Request::Toggle(channel()?),
            0x21 | 0x37 => Request::JogClose(channel()?, high),
            0x22 | 0x38 => Request::JogOpen(channel()?, high),
            0x40 => Request::ReadAddress,
            0x41 => Request::WriteAddress(Address(low)),
            0x70 => Request::ReadVariable(low),
            0x71 => Request::WriteVariable(low, high),
            _ => return Err(Malformed::Function),
        };
        Ok((request, !matches!(code, 0x30..=0x38)))
    }
}

/// A word from its low byte D4 and the 24 bits above it.
const fn low_byte(high: U24, low: u8) -> [u8; 4] {
    (high.0 << 8 | low as u32).to_be_bytes()
}

/// A response: D1 to D4 as they are in the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Response {
    /// D1 to D4, D1 first.
    pub data: [u8; 4],
}

impl Response {
    /// The response with this word in D1 to D4.
    #[must_use]
    pub const fn word(word: u32) -> Response {
        Response {
            data: word.to_be_bytes(),
        }
    }

    /// The response of a variable: its value in D1 to D3, its index in D4.
    #[must_use]
    pub const fn variable(index: u8, value: U24) -> Response {
        Response {
            data: low_byte(value, index),
        }
    }

    /// D1 to D4 as one word, bit 0 being bit 0 of D4.
    #[must_use]
    pub const fn to_word(self) -> u32 {
        u32::from_be_bytes(self.data)
    }

    /// The inputs of a mixed board, D1 and D2, bit 0 being input 1 [R55 §3.3].
    #[must_use]
    pub const fn inputs(self) -> u16 {
        (self.to_word() >> 16) as u16
    }

    /// The outputs of a mixed board, D3 and D4, bit 0 being output 1 [R55 §3.3].
    #[must_use]
    pub const fn outputs(self) -> u16 {
        self.to_word() as u16
    }
}

/// A request to one board, and its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    address: Address,
    request: Request,
    answered: bool,
}

impl Exchange {
    /// The exchange in the form with a reply.
    #[must_use]
    #[inline]
    pub const fn new(address: Address, request: Request) -> Exchange {
        Exchange {
            address,
            request,
            answered: true,
        }
    }

    /// The form without a reply; 10, 40, 41, 70 and 71 have none.
    #[must_use]
    pub const fn without_reply(self) -> Option<Exchange> {
        match self.request.silent_code() {
            Some(_) => Some(Exchange {
                answered: false,
                ..self
            }),
            None => None,
        }
    }

    /// The board; 245 is the broadcast address.
    #[must_use]
    pub const fn address(&self) -> Address {
        self.address
    }

    /// The request.
    #[must_use]
    pub const fn request(&self) -> Request {
        self.request
    }

    /// Whether this form gets a reply.
    #[must_use]
    pub const fn expects_reply(&self) -> bool {
        self.answered
    }

    /// The function code on the wire.
    #[must_use]
    #[inline]
    pub const fn code(&self) -> u8 {
        match self.request.silent_code() {
            Some(code) if !self.answered => code,
            _ => self.request.code(),
        }
    }

    /// Writes the request frame.
    #[inline]
    pub fn encode(&self, out: &mut Frame) {
        out.set(frame(
            REQUEST_START,
            self.address,
            self.code(),
            self.request.data(),
        ));
    }

    /// Decodes the beginning of `rx` as a request; a wrong sum makes it malformed.
    #[inline]
    pub fn decode_request(rx: &[u8]) -> Decoded<Exchange> {
        open(rx, REQUEST_START, |_, _| true).and_then(|(address, code, data)| {
            let (request, answered) = Request::parse(code, data)?;
            Ok(Exchange {
                address,
                request,
                answered,
            })
        })
    }

    /// Decodes the beginning of `rx` as the reply to this request: start, address, function and sum
    /// are checked. An address read may be answered by any board.
    #[inline]
    pub fn decode_response(&self, rx: &[u8]) -> Decoded<Reply<Response>> {
        let anyone = matches!(self.request, Request::ReadAddress) && self.address == BROADCAST;
        let ours = |from: u8, code: Option<u8>| {
            (anyone || from == self.address.0)
                && code.is_none_or(|code| code == self.request.code())
        };
        open(rx, RESPONSE_START, ours).map(|(from, _, data)| Reply {
            from: Some(from),
            response: Response { data },
        })
    }

    /// Writes the reply of the board at `from`.
    #[inline]
    pub fn encode_response(&self, from: Address, response: Response, out: &mut Frame) {
        out.set(frame(
            RESPONSE_START,
            from,
            self.request.code(),
            response.data,
        ));
    }

    /// Whether one frame could be a reply to both: same board, same function.
    #[must_use]
    pub fn confusable(&self, other: &Exchange) -> bool {
        let anyone = |e: &Exchange| e.address == BROADCAST;
        (self.address == other.address || anyone(self) || anyone(other))
            && self.request.code() == other.request.code()
    }
}

#[inline]
fn frame(start: u8, address: Address, code: u8, [d1, d2, d3, d4]: [u8; 4]) -> [u8; FRAME_LEN] {
    let head = [start, address.0, code, d1, d2, d3, d4];
    [start, address.0, code, d1, d2, d3, d4, sum8(&head)]
}

/// Address, function and data of a frame. `ours` is called as soon as the address is known, and
/// again with the function, so that foreign frames are recognised early.
#[inline]
fn open(
    rx: &[u8],
    start: u8,
    ours: impl Fn(u8, Option<u8>) -> bool,
) -> Decoded<(Address, u8, [u8; 4])> {
    if let Ok(&[first, address, code, d1, d2, d3, d4, sum]) = need::<FRAME_LEN>(rx) {
        let why = if first != start {
            Malformed::Start
        } else if !ours(address, None) {
            Malformed::Address
        } else if !ours(address, Some(code)) {
            Malformed::Function
        } else if sum8(&[first, address, code, d1, d2, d3, d4]) != sum {
            Malformed::Checksum
        } else {
            let value = (Address(address), code, [d1, d2, d3, d4]);
            return Decoded::Whole {
                len: FRAME_LEN,
                value,
            };
        };
        return Decoded::Malformed(why);
    }
    match *rx {
        [first, ..] if first != start => Decoded::Malformed(Malformed::Start),
        [_, address, ..] if !ours(address, None) => Decoded::Malformed(Malformed::Address),
        [_, address, code, ..] if !ours(address, Some(code)) => {
            Decoded::Malformed(Malformed::Function)
        }
        _ => Decoded::Partial {
            more: FRAME_LEN - rx.len(),
        },
    }
}
