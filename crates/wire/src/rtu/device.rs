//! The device side: decodes requests, writes replies.

use super::{
    BitBlock, BitSpan, CoilValue, Exception, Exchange, Function, Request, Response, WordBlock,
    WordSpan, close, closed,
};
use crate::{Address, Bits, Decoded, Frame, Malformed, Words, crc16};

/// Why a frame is not a valid request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestError {
    /// Fewer than four bytes, more than 256, or a wrong CRC. Never answered by a module
    /// [MODBUS §1.7].
    Garbled,
    /// A function that this codec does not know; exception 01.
    Function {
        /// The module.
        address: Address,
        /// The code on the wire.
        code: u8,
    },
    /// A quantity outside the standard's limits, or a byte count or length that contradicts it;
    /// exception 03.
    Quantity {
        /// The module.
        address: Address,
        /// The requested function.
        function: Function,
    },
    /// The run passes the last of the 65536 coils or registers; exception 02.
    Range {
        /// The module.
        address: Address,
        /// The requested function.
        function: Function,
    },
}

impl RequestError {
    /// The module, the function code, and the exception required by the standard, if the frame was
    /// not corrupted [MODBUS §3.5].
    #[must_use]
    pub const fn exception(&self) -> Option<(Address, u8, Exception)> {
        match *self {
            RequestError::Garbled => None,
            RequestError::Function { address, code } => Some((address, code, Exception::FUNCTION)),
            RequestError::Quantity { address, function } => {
                Some((address, function.code(), Exception::VALUE))
            }
            RequestError::Range { address, function } => {
                Some((address, function.code(), Exception::ADDRESS))
            }
        }
    }
}

impl<'a> Exchange<'a> {
    /// Decodes a complete frame, as delimited by silence, as a request.
    ///
    /// # Errors
    /// [`RequestError`] in the standard's order: CRC, function, quantity, range.
    #[inline]
    pub fn decode_frame(frame: &'a [u8]) -> Result<Exchange<'a>, RequestError> {
        let [address, pdu @ .., _, _] = frame else {
            return Err(RequestError::Garbled);
        };
        if frame.len() > crate::FRAME_MAX || crc16(frame) != 0 {
            return Err(RequestError::Garbled);
        }
        Exchange::decode_pdu(Address(*address), pdu)
    }

    /// Decodes a function and its data as a request to this module: what stands between address
    /// and CRC, and after the unit in Modbus TCP ([`crate::mbap`]).
    ///
    /// # Errors
    /// [`RequestError`] in the standard's order: function, quantity, range;
    /// [`RequestError::Garbled`] if there is nothing.
    #[inline]
    pub fn decode_pdu(address: Address, pdu: &'a [u8]) -> Result<Exchange<'a>, RequestError> {
        let &[code, ref fields @ ..] = pdu else {
            return Err(RequestError::Garbled);
        };
        let Some(function) = Function::from_code(code) else {
            return Err(RequestError::Function { address, code });
        };
        let quantity = RequestError::Quantity { address, function };
        if function == Function::Identify {
            return match *fields {
                [super::identity::KIND, code, object] => {
                    let request = Request::Identify { code, object };
                    Ok(Exchange { address, request })
                }
                [super::identity::KIND, ..] => Err(quantity),
                _ => Err(RequestError::Function { address, code }),
            };
        }
        let Some((&[at_high, at_low, high, low], rest)) = fields.split_first_chunk::<4>() else {
            return Err(quantity);
        };
        let (at, value) = (
            u16::from_be_bytes([at_high, at_low]),
            u16::from_be_bytes([high, low]),
        );
        let data = match (function, rest) {
            (Function::WriteCoils | Function::WriteRegisters, [bytes, data @ ..])
                if usize::from(*bytes) == data.len() =>
            {
                data
            }
            (Function::WriteCoils | Function::WriteRegisters, _) => return Err(quantity),
            (_, []) => &[],
            _ => return Err(quantity),
        };
        match parse(function, at, value, data) {
            Some(request) => Ok(Exchange { address, request }),
            None if at.checked_add(value.saturating_sub(1)).is_none()
                && parse(function, 0, value, data).is_some() =>
            {
                Err(RequestError::Range { address, function })
            }
            None => Err(quantity),
        }
    }

    /// Decodes the beginning of `rx` as a request, for a listener that does not know the silences.
    pub fn decode_request(rx: &'a [u8]) -> Decoded<Exchange<'a>> {
        let Some(&code) = rx.get(1) else {
            return Decoded::Partial { more: 4 - rx.len() };
        };
        let len = match Function::from_code(code) {
            None => return Decoded::Malformed(Malformed::Function),
            Some(Function::WriteCoils | Function::WriteRegisters) => match rx.get(6) {
                Some(&bytes) => 9 + usize::from(bytes),
                None => {
                    return Decoded::Partial {
                        more: 10 - rx.len(),
                    };
                }
            },
            Some(Function::Identify) => 7,
            Some(_) => 8,
        };
        if len > crate::FRAME_MAX {
            return Decoded::Malformed(Malformed::Length);
        }
        let Some(frame) = rx.get(..len) else {
            return Decoded::Partial {
                more: len - rx.len(),
            };
        };
        match Exchange::decode_frame(frame) {
            Ok(value) => Decoded::Whole { len, value },
            Err(RequestError::Garbled) => Decoded::Malformed(Malformed::Checksum),
            Err(RequestError::Function { .. }) => Decoded::Malformed(Malformed::Function),
            Err(RequestError::Quantity { .. }) => Decoded::Malformed(Malformed::Length),
            Err(RequestError::Range { .. }) => Decoded::Malformed(Malformed::Value),
        }
    }

    /// Writes the reply of the module at `from` to this request.
    ///
    /// The response must have the request's kind and length; the module's own address replaces 0.
    #[inline]
    pub fn encode_response(&self, from: Address, response: &Response<'_>, out: &mut Frame) {
        let function = self.request.function().code();
        let data = match response {
            Response::Done => {
                let [_, rest @ ..] = self.echo();
                let [a, b, c, d, e] = rest;
                return out.set(closed([from.0, a, b, c, d, e]));
            }
            Response::Exception(why) => {
                return encode_exception(from, function, *why, out);
            }
            Response::Diagnosis(data) => {
                let [_, _, sub_high, sub_low, ..] = self.echo();
                let [high, low] = data.to_be_bytes();
                return out.set(closed([from.0, function, sub_high, sub_low, high, low]));
            }
            Response::Identification(says) => {
                out.set([from.0, function, super::identity::KIND]);
                out.extend(says.bytes());
                return close(out);
            }
            Response::Bits(bits) => bits.bytes(),
            Response::Words(words) => words.bytes(),
        };
        out.set([from.0, function, data.len() as u8]);
        out.extend(data);
        close(out);
    }
}

/// Writes an exception reply to a function code, which need not be a known one.
pub fn encode_exception(from: Address, code: u8, why: Exception, out: &mut Frame) {
    out.set([from.0, code | 0x80, why.0]);
    close(out);
}

/// The request with these numbers; none if one of them is out of range.
#[inline]
fn parse(function: Function, at: u16, value: u16, data: &[u8]) -> Option<Request<'_>> {
    Some(match function {
        Function::ReadCoils => Request::ReadCoils(BitSpan::new(at, value)?),
        Function::ReadDiscreteInputs => Request::ReadDiscreteInputs(BitSpan::new(at, value)?),
        Function::ReadHoldingRegisters => Request::ReadHoldingRegisters(WordSpan::new(at, value)?),
        Function::ReadInputRegisters => Request::ReadInputRegisters(WordSpan::new(at, value)?),
        Function::WriteCoil => Request::WriteCoil {
            at,
            value: CoilValue(value),
        },
        Function::WriteRegister => Request::WriteRegister { at, value },
        Function::Diagnose => Request::Diagnose {
            sub: at,
            data: value,
        },
        Function::Identify => return None,
        Function::WriteCoils => {
            Request::WriteCoils(BitBlock::new(at, Bits::from_packed(data, value)?)?)
        }
        Function::WriteRegisters => {
            let words = Words::from_packed(data).filter(|words| words.len() == value)?;
            Request::WriteRegisters(WordBlock::new(at, words)?)
        }
    })
}
