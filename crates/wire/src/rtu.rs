//! Modbus RTU: functions 01 02 03 04 05 06 08 0F 10 2B and their exceptions.
//!
//! A frame is `address function data crc`, the CRC low byte first, and ends with silence
//! [MODBUS §1]. The length of a reply follows from its request, so nothing here waits for silence;
//! only *requests* on the device side are delimited by it.

use crate::decoded::need;
use crate::{Address, Bits, Decoded, Frame, Malformed, Reply, Words, crc16};
use core::fmt;

mod device;
mod identity;
pub use device::{RequestError, encode_exception};
pub use identity::{Identification, encode_identification};

/// The broadcast address, which gets no reply [MODBUS §1.6].
pub const BROADCAST: Address = Address(0);

/// A function code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[allow(missing_docs)]
pub enum Function {
    ReadCoils = 0x01,
    ReadDiscreteInputs = 0x02,
    ReadHoldingRegisters = 0x03,
    ReadInputRegisters = 0x04,
    WriteCoil = 0x05,
    WriteRegister = 0x06,
    Diagnose = 0x08,
    WriteCoils = 0x0F,
    WriteRegisters = 0x10,
    Identify = 0x2B,
}

impl Function {
    /// The function with this code.
    #[must_use]
    pub const fn from_code(code: u8) -> Option<Function> {
        Some(match code {
            0x01 => Function::ReadCoils,
            0x02 => Function::ReadDiscreteInputs,
            0x03 => Function::ReadHoldingRegisters,
            0x04 => Function::ReadInputRegisters,
            0x05 => Function::WriteCoil,
            0x06 => Function::WriteRegister,
            0x08 => Function::Diagnose,
            0x0F => Function::WriteCoils,
            0x10 => Function::WriteRegisters,
            0x2B => Function::Identify,
            _ => return None,
        })
    }

    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }
}

/// Why a module refused: the code of an exception reply, as on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Exception(pub u8);

impl Exception {
    /// The module does not have this function.
    pub const FUNCTION: Exception = Exception(1);
    /// The start, or start + count, is outside the module's map.
    pub const ADDRESS: Exception = Exception(2);
    /// A quantity or value is not allowed.
    pub const VALUE: Exception = Exception(3);
    /// The module failed to execute it.
    pub const FAILURE: Exception = Exception(4);
    /// The module has accepted it, and needs longer than a master waits.
    pub const ACKNOWLEDGE: Exception = Exception(5);
    /// The module is busy, or a gateway has too much to do.
    pub const BUSY: Exception = Exception(6);
    /// In the standard a memory parity error; ERC-8 and EMD-2A2Q list it as "CRC error"
    /// [ERC-8 §5.5].
    pub const CHECKSUM: Exception = Exception(8);
    /// A gateway has no way to the module.
    pub const PATH: Exception = Exception(0x0A);
    /// The module behind a gateway did not answer.
    pub const TARGET: Exception = Exception(0x0B);
}

impl fmt::Display for Exception {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match self.0 {
            1 => "illegal function",
            2 => "illegal data address",
            3 => "illegal data value",
            4 => "device failure",
            5 => "acknowledged, still working",
            6 => "device busy",
            8 => "checksum or memory parity error",
            0x0A => "gateway path unavailable",
            0x0B => "gateway target did not respond",
            _ => "undefined exception",
        };
        write!(f, "{:02X} {text}", self.0)
    }
}

/// The value of a coil write, as on the wire. The standard defines [`CoilValue::ON`] and
/// [`CoilValue::OFF`]; boards of other makers toggle with 5500h or switch on with 0100h.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CoilValue(pub u16);

impl CoilValue {
    /// FF00h.
    pub const ON: CoilValue = CoilValue(0xFF00);
    /// 0000h.
    pub const OFF: CoilValue = CoilValue(0x0000);

    /// The state for this value; none for values the standard does not define.
    #[must_use]
    pub const fn state(self) -> Option<bool> {
        match self {
            CoilValue::ON => Some(true),
            CoilValue::OFF => Some(false),
            CoilValue(_) => None,
        }
    }
}

impl From<bool> for CoilValue {
    fn from(on: bool) -> CoilValue {
        if on { CoilValue::ON } else { CoilValue::OFF }
    }
}

/// A run of 1 to `MAX` coils or registers within the 65536 possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Span<const MAX: u16> {
    start: u16,
    count: u16,
}

/// Coils or inputs to read: 1 to 2000 [MODBUS §3.1].
pub type BitSpan = Span<{ Bits::MAX }>;
/// Registers to read: 1 to 125 [MODBUS §3.2].
pub type WordSpan = Span<{ Words::MAX }>;

impl<const MAX: u16> Span<MAX> {
    /// The run from `start`, 0-based; none if the count is out of range or the run passes 65535.
    #[must_use]
    pub const fn new(start: u16, count: u16) -> Option<Span<MAX>> {
        let in_range = count >= 1 && count <= MAX;
        if in_range && start.checked_add(count - 1).is_some() {
            Some(Span { start, count })
        } else {
            None
        }
    }

    /// The first one, 0-based.
    #[must_use]
    pub const fn start(self) -> u16 {
        self.start
    }

    /// The number of coils or registers.
    #[must_use]
    pub const fn count(self) -> u16 {
        self.count
    }
}

/// Coils to write: their start and their 1 to 1968 values [MODBUS §3.3].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitBlock<'a> {
    start: u16,
    values: Bits<'a>,
}

impl<'a> BitBlock<'a> {
    /// The most in one request.
    pub const MAX: u16 = 1968;

    /// The block from `start`, 0-based; none if it is too long or passes 65535.
    #[must_use]
    pub const fn new(start: u16, values: Bits<'a>) -> Option<BitBlock<'a>> {
        match Span::<{ BitBlock::MAX }>::new(start, values.len()) {
            Some(_) => Some(BitBlock { start, values }),
            None => None,
        }
    }

    /// The first coil, 0-based.
    #[must_use]
    pub const fn start(&self) -> u16 {
        self.start
    }

    /// The values.
    #[must_use]
    pub const fn values(&self) -> &Bits<'a> {
        &self.values
    }
}

/// Registers to write: their start and their 1 to 123 values [MODBUS §3.4].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WordBlock<'a> {
    start: u16,
    values: Words<'a>,
}

impl<'a> WordBlock<'a> {
    /// The most in one request.
    pub const MAX: u16 = 123;

    /// The block from `start`, 0-based; none if it is too long or passes 65535.
    #[must_use]
    pub const fn new(start: u16, values: Words<'a>) -> Option<WordBlock<'a>> {
        match Span::<{ WordBlock::MAX }>::new(start, values.len()) {
            Some(_) => Some(WordBlock { start, values }),
            None => None,
        }
    }

    /// The first register, 0-based.
    #[must_use]
    pub const fn start(&self) -> u16 {
        self.start
    }

    /// The values.
    #[must_use]
    pub const fn values(&self) -> &Words<'a> {
        &self.values
    }

    /// Each written register, 0-based, with its value.
    pub fn words(&self) -> impl Iterator<Item = (u16, u16)> {
        // The block ends with 65535 at the latest, so only a count after it wraps around.
        let mut next = self.start;
        self.values.iter().map(move |word| {
            let at = next;
            next = next.wrapping_add(1);
            (at, word)
        })
    }
}

/// A request. Starts are 0-based, as on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request<'a> {
    /// Function 01.
    ReadCoils(BitSpan),
    /// Function 02.
    ReadDiscreteInputs(BitSpan),
    /// Function 03.
    ReadHoldingRegisters(WordSpan),
    /// Function 04.
    ReadInputRegisters(WordSpan),
    /// Function 05.
    WriteCoil {
        /// The coil, 0-based.
        at: u16,
        /// The value.
        value: CoilValue,
    },
    /// Function 06.
    WriteRegister {
        /// The register, 0-based.
        at: u16,
        /// The value.
        value: u16,
    },
    /// Function 0F.
    WriteCoils(BitBlock<'a>),
    /// Function 10.
    WriteRegisters(WordBlock<'a>),
    /// Function 08, only the forms with one word of data.
    Diagnose {
        /// The sub-function; see [`diagnosis`].
        sub: u16,
        /// Its data.
        data: u16,
    },
    /// Function 2B, kind 0E: device identification.
    Identify {
        /// 1 basic, 2 regular, 3 extended objects, 4 one object.
        code: u8,
        /// The first object, or the only one.
        object: u8,
    },
}

/// The sub-functions of [`Request::Diagnose`] [BEYOND §4].
pub mod diagnosis {
    /// Returns the data.
    pub const ECHO: u16 = 0x00;
    /// The diagnostic register.
    pub const REGISTER: u16 = 0x02;
    /// Clears all counters.
    pub const CLEAR: u16 = 0x0A;
    /// The first of the eight counters.
    pub const FIRST_COUNTER: u16 = 0x0B;
    /// The last of them.
    pub const LAST_COUNTER: u16 = 0x12;
    /// Clears the counter of lost characters.
    pub const CLEAR_OVERRUN: u16 = 0x14;
}

impl Request<'_> {
    /// Its function.
    #[must_use]
    #[inline]
    pub const fn function(&self) -> Function {
        match self {
            Request::ReadCoils(_) => Function::ReadCoils,
            Request::ReadDiscreteInputs(_) => Function::ReadDiscreteInputs,
            Request::ReadHoldingRegisters(_) => Function::ReadHoldingRegisters,
            Request::ReadInputRegisters(_) => Function::ReadInputRegisters,
            Request::WriteCoil { .. } => Function::WriteCoil,
            Request::WriteRegister { .. } => Function::WriteRegister,
            Request::WriteCoils(_) => Function::WriteCoils,
            Request::WriteRegisters(_) => Function::WriteRegisters,
            Request::Diagnose { .. } => Function::Diagnose,
            Request::Identify { .. } => Function::Identify,
        }
    }

    /// The two numbers after the function code: start and count, or address and value.
    #[inline]
    const fn head(&self) -> (u16, u16) {
        match self {
            Request::ReadCoils(span) | Request::ReadDiscreteInputs(span) => {
                (span.start, span.count)
            }
            Request::ReadHoldingRegisters(span) | Request::ReadInputRegisters(span) => {
                (span.start, span.count)
            }
            Request::WriteCoil { at, value } => (*at, value.0),
            Request::WriteRegister { at, value } => (*at, *value),
            Request::WriteCoils(block) => (block.start, block.values.len()),
            Request::WriteRegisters(block) => (block.start, block.values.len()),
            Request::Diagnose { sub, data } => (*sub, *data),
            // The last of the four bytes is not sent.
            Request::Identify { code, object } => (
                u16::from_be_bytes([identity::KIND, *code]),
                u16::from_be_bytes([*object, 0]),
            ),
        }
    }

    /// Whether this only reads.
    #[must_use]
    pub const fn is_read(&self) -> bool {
        match self {
            Request::Diagnose { sub, .. } => matches!(
                *sub,
                diagnosis::ECHO | diagnosis::REGISTER | diagnosis::FIRST_COUNTER
                    ..=diagnosis::LAST_COUNTER
            ),
            Request::Identify { .. } => true,
            _ => self.read_bytes().is_some(),
        }
    }

    /// The byte count of the reply to a read.
    #[inline]
    const fn read_bytes(&self) -> Option<u8> {
        match self {
            Request::ReadCoils(span) | Request::ReadDiscreteInputs(span) => {
                Some(span.count.div_ceil(8) as u8)
            }
            Request::ReadHoldingRegisters(span) | Request::ReadInputRegisters(span) => {
                Some((2 * span.count) as u8)
            }
            Request::WriteCoil { .. }
            | Request::WriteRegister { .. }
            | Request::WriteCoils(_)
            | Request::WriteRegisters(_)
            | Request::Diagnose { .. }
            | Request::Identify { .. } => None,
        }
    }
}

/// A response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response<'a> {
    /// The requested coils or inputs.
    Bits(Bits<'a>),
    /// The requested registers.
    Words(Words<'a>),
    /// The write was executed; address and value (or count) were repeated correctly.
    Done,
    /// The data of a sub-function of 08.
    Diagnosis(u16),
    /// The identification of the module.
    Identification(Identification<'a>),
    /// The module refused.
    Exception(Exception),
}

/// A request to one module, and its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange<'a> {
    /// The module; 0 is the broadcast address.
    pub address: Address,
    /// The request.
    pub request: Request<'a>,
}

impl<'a> Exchange<'a> {
    /// Writes the request frame.
    #[inline]
    pub fn encode(&self, out: &mut Frame) {
        let head = self.echo();
        let (bytes, count) = match &self.request {
            Request::WriteCoils(block) => (block.values.bytes(), block.values.len().div_ceil(8)),
            Request::WriteRegisters(block) => (block.values.bytes(), 2 * block.values.len()),
            Request::Identify { .. } => {
                let [a, b, c, d, e, _] = head;
                out.set([a, b, c, d, e]);
                return close(out);
            }
            _ => return out.set(closed(head)),
        };
        out.set(head);
        out.push(count as u8);
        out.extend(bytes);
        close(out);
    }

    /// Whether the request gets a reply. A write to address 0 gets none.
    #[must_use]
    pub const fn expects_reply(&self) -> bool {
        self.address.0 != BROADCAST.0 || self.request.is_read()
    }

    /// How many bytes the reply has if it is not an exception; the maximum where that varies.
    #[must_use]
    pub const fn response_len(&self) -> usize {
        match (self.request.read_bytes(), &self.request) {
            (Some(bytes), _) => 5 + bytes as usize,
            (None, Request::Identify { .. }) => crate::FRAME_MAX,
            (None, _) => 8,
        }
    }

    /// Decodes the beginning of `rx` as the reply to this request.
    ///
    /// Checks address, function, byte count or repeated values, and CRC. A read sent to address 0
    /// may be answered with the module's own address.
    #[inline]
    pub fn decode_response<'r>(&self, rx: &'r [u8]) -> Decoded<Reply<Response<'r>>> {
        let &[from, code] = match need::<2>(rx) {
            Ok(front) => front,
            Err(more) => return self.short(rx, more),
        };
        if !self.may_answer(from) {
            return Decoded::Malformed(Malformed::Address);
        }
        let function = self.request.function().code();
        if code == function | 0x80 {
            return decode_exception(rx);
        }
        if code != function {
            return Decoded::Malformed(Malformed::Function);
        }
        match (self.request, self.request.read_bytes()) {
            (Request::Identify { code, .. }, _) => self.decode_identification(code, rx),
            (_, Some(bytes)) => self.decode_read(rx, bytes),
            (_, None) => self.decode_ack(rx),
        }
    }

    /// Decodes a reply of three bytes as an exception without CRC, as the manuals of ERC-8 and
    /// EMD-2A2Q print them [ERC-8 §5.2]. Only for modules known to send them like that, and only if
    /// silence followed.
    #[must_use]
    pub fn decode_bare_exception(&self, rx: &[u8]) -> Option<Exception> {
        match *rx {
            [from, code, why]
                if self.may_answer(from) && code == self.request.function().code() | 0x80 =>
            {
                Some(Exception(why))
            }
            _ => None,
        }
    }

    /// Whether one frame could be a reply to both: same module, same function. An exception reply
    /// says nothing else, and the reply to a read does not say what was read.
    #[must_use]
    pub fn confusable(&self, other: &Exchange<'_>) -> bool {
        let anyone = |e: &Exchange<'_>| e.address == BROADCAST;
        (self.address == other.address || anyone(self) || anyone(other))
            && self.request.function() == other.request.function()
    }

    #[inline]
    fn may_answer(&self, from: u8) -> bool {
        from == self.address.0 || self.address == BROADCAST
    }

    /// Whether a sub-function of 08 returns its data.
    #[inline]
    const fn wants_echo(&self) -> bool {
        match self.request {
            Request::Diagnose { sub, .. } => matches!(
                sub,
                diagnosis::ECHO | diagnosis::CLEAR | diagnosis::CLEAR_OVERRUN
            ),
            _ => true,
        }
    }

    /// The six bytes that begin a request and make up the reply to a write.
    #[inline]
    const fn echo(&self) -> [u8; 6] {
        let (at, value) = self.request.head();
        let ([at_high, at_low], [high, low]) = (at.to_be_bytes(), value.to_be_bytes());
        [
            self.address.0,
            self.request.function().code(),
            at_high,
            at_low,
            high,
            low,
        ]
    }

    #[inline]
    fn short<'r>(&self, rx: &[u8], more: usize) -> Decoded<Reply<Response<'r>>> {
        match rx.first() {
            Some(&from) if !self.may_answer(from) => Decoded::Malformed(Malformed::Address),
            _ => Decoded::Partial { more },
        }
    }

    #[inline]
    fn decode_read<'r>(&self, rx: &'r [u8], bytes: u8) -> Decoded<Reply<Response<'r>>> {
        match rx.get(2) {
            None => {
                return Decoded::Partial {
                    more: 3 + usize::from(bytes),
                };
            }
            Some(&sent) if sent != bytes => return Decoded::Malformed(Malformed::Length),
            Some(_) => {}
        }
        let len = 5 + usize::from(bytes);
        let Some(frame) = rx.get(..len) else {
            return Decoded::Partial {
                more: len - rx.len(),
            };
        };
        if crc16(frame) != 0 {
            return Decoded::Malformed(Malformed::Checksum);
        }
        let data = frame.get(3..len - 2).unwrap_or_default();
        let response = match self.request {
            Request::ReadCoils(span) | Request::ReadDiscreteInputs(span) => {
                Bits::from_packed(data, span.count).map(Response::Bits)
            }
            _ => Words::from_packed(data).map(Response::Words),
        };
        match (response, frame.first()) {
            (Some(response), Some(&from)) => Reply::whole(len, Address(from), response),
            _ => Decoded::Malformed(Malformed::Length),
        }
    }

    #[inline]
    fn decode_ack<'r>(&self, rx: &'r [u8]) -> Decoded<Reply<Response<'r>>> {
        let frame = match need::<8>(rx) {
            Ok(frame) => frame,
            Err(more) => return Decoded::Partial { more },
        };
        if crc16(frame) != 0 {
            return Decoded::Malformed(Malformed::Checksum);
        }
        let [from, _, a, b, c, d, ..] = *frame;
        let [_, _, echo @ ..] = self.echo();
        let response = match self.request {
            Request::Diagnose { sub, .. } if [a, b] == sub.to_be_bytes() => {
                Response::Diagnosis(u16::from_be_bytes([c, d]))
            }
            _ => Response::Done,
        };
        // The answer to 08 replaces the data sent, unless that data is to be returned.
        let answers = matches!(response, Response::Diagnosis(_)) && !self.wants_echo();
        if [a, b, c, d] != echo && !answers {
            return Decoded::Malformed(Malformed::Echo);
        }
        Reply::whole(8, Address(from), response)
    }
}

#[inline]
fn decode_exception<'r>(rx: &[u8]) -> Decoded<Reply<Response<'r>>> {
    match need::<5>(rx) {
        Err(more) => Decoded::Partial { more },
        Ok(frame) if crc16(frame) != 0 => Decoded::Malformed(Malformed::Checksum),
        Ok(&[from, _, code, ..]) => {
            Reply::whole(5, Address(from), Response::Exception(Exception(code)))
        }
    }
}

/// Six bytes and their CRC.
#[inline]
fn closed(head: [u8; 6]) -> [u8; 8] {
    let [low, high] = crc16(&head).to_le_bytes();
    let [a, b, c, d, e, f] = head;
    [a, b, c, d, e, f, low, high]
}

/// Appends the CRC.
#[inline]
fn close(out: &mut Frame) {
    let crc = crc16(out.bytes());
    out.extend(&crc.to_le_bytes());
}
