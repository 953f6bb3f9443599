//! Replies without their requests: tries every request that the bytes could answer.

use railbus_wire::{
    Address, Bits, Channel, Decoded, Exchange, Response, Words, ascii, lc02, r55, rtu,
};

/// The values of a write, which its reply does not contain.
static UNTOLD: [u8; 256] = [0; 256];

/// The ways to decode complete bytes as a reply: to which request, and from which module.
pub fn replies(bytes: &[u8]) -> Vec<(Exchange<'static>, Response<'_>, Option<Address>)> {
    let mut found = Vec::new();
    for exchange in candidates(bytes) {
        if let Decoded::Whole { len, value } = exchange.decode_response(bytes)
            && len == bytes.len()
        {
            found.push((exchange, value.response, value.from));
        }
    }
    found
}

/// The requests that these bytes could answer; likelier ones first.
fn candidates(bytes: &[u8]) -> impl Iterator<Item = Exchange<'static>> {
    let marked = candidate_r55(bytes)
        .into_iter()
        .chain(candidates_lc02(bytes))
        .chain(candidates_ascii(bytes));
    marked.chain(candidate_rtu(bytes))
}

pub(crate) fn candidate_r55(bytes: &[u8]) -> Option<Exchange<'static>> {
    match bytes {
        [r55::RESPONSE_START, address, code, ..] => {
            r55_request(*code).map(|request| Exchange::r55(Address(*address), request))
        }
        _ => None,
    }
}

pub(crate) fn candidates_lc02(bytes: &[u8]) -> impl Iterator<Item = Exchange<'static>> + use<> {
    let address = match bytes {
        [0x6C, 0x63, address, ..] => Some(Address(*address)),
        _ => None,
    };
    let requests = [
        lc02::Request::ReadConfig,
        lc02::Request::ReadData,
        lc02::Request::ReadPulse,
        lc02::Request::WriteOutputs(lc02::Outputs::All(0)),
    ];
    let each = move |address| requests.map(|request| Exchange::lc02(address, request));
    address.into_iter().flat_map(each)
}

fn r55_request(code: u8) -> Option<r55::Request> {
    let one = Channel::new(0)?;
    let zero = r55::U24::new(0)?;
    use r55::Request as R;
    let all = [
        R::ReadState,
        R::Open(one),
        R::Close(one),
        R::SetAll(0),
        R::GroupOff(0),
        R::GroupOn(0),
        R::GroupToggle(0),
        R::Toggle(one),
        R::JogClose(one, zero),
        R::JogOpen(one, zero),
        R::ReadAddress,
        R::WriteAddress(Address(0)),
        R::ReadVariable(0),
        R::WriteVariable(0, zero),
    ];
    let is_it = |request: &R| r55::Exchange::new(Address(0), *request).code() == code;
    all.into_iter().find(is_it)
}

/// Likelier ones first: a data reply can also be decoded as a name.
pub(crate) fn candidates_ascii(bytes: &[u8]) -> impl Iterator<Item = Exchange<'static>> + use<> {
    let begins = matches!(bytes.first(), Some(b'!' | b'>' | b'?'));
    let digits = bytes
        .get(1..3)
        .and_then(|digits| std::str::from_utf8(digits).ok());
    let address = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok());
    let address = Address(address.unwrap_or_default());
    use ascii::Request as R;
    let requests = [
        R::ReadData,
        R::ReadConfig,
        R::ReadPulse,
        R::WriteOutputs { order: 0, data: 0 },
        R::ReadAll,
        R::ReadName,
    ];
    let each = move |checksum| {
        let exchange = move |request| Exchange::ascii(address, checksum, request);
        requests.into_iter().map(exchange)
    };
    let all = each(false).chain(each(true));
    all.filter(move |_| begins)
}

/// The request of a Modbus reply, whose length tells how much was read.
pub(crate) fn candidate_rtu(bytes: &[u8]) -> Option<Exchange<'static>> {
    let &[address, code, third, ..] = bytes else {
        return None;
    };
    let function = rtu::Function::from_code(code & 0x7F)?;
    let bits = || rtu::BitSpan::new(0, (u16::from(third) * 8).max(1));
    let words = || rtu::WordSpan::new(0, (u16::from(third) / 2).max(1));
    let is_exception = code & 0x80 != 0;
    let one = |span: Option<rtu::BitSpan>| {
        if is_exception {
            rtu::BitSpan::new(0, 1)
        } else {
            span
        }
    };
    let few = |span: Option<rtu::WordSpan>| {
        if is_exception {
            rtu::WordSpan::new(0, 1)
        } else {
            span
        }
    };
    use rtu::Function as F;
    let request = match function {
        F::ReadCoils => rtu::Request::ReadCoils(one(bits())?),
        F::ReadDiscreteInputs => rtu::Request::ReadDiscreteInputs(one(bits())?),
        F::ReadHoldingRegisters => rtu::Request::ReadHoldingRegisters(few(words())?),
        F::ReadInputRegisters => rtu::Request::ReadInputRegisters(few(words())?),
        F::WriteCoil | F::WriteRegister | F::WriteCoils | F::WriteRegisters => {
            return write_request(bytes, function, Address(address));
        }
        F::Diagnose if is_exception => rtu::Request::Diagnose { sub: 0, data: 0 },
        F::Diagnose => {
            let &[_, _, sub_high, sub_low, high, low, ..] = bytes else {
                return None;
            };
            rtu::Request::Diagnose {
                sub: u16::from_be_bytes([sub_high, sub_low]),
                data: u16::from_be_bytes([high, low]),
            }
        }
        F::Identify => rtu::Request::Identify {
            code: bytes.get(3).copied().filter(|_| !is_exception).unwrap_or(1),
            object: 0,
        },
    };
    Some(Exchange::rtu(Address(address), request))
}

/// The write that these bytes acknowledge.
fn write_request(bytes: &[u8], function: rtu::Function, at: Address) -> Option<Exchange<'static>> {
    let word = |from: usize| {
        let pair = bytes.get(from..from + 2)?;
        Some(u16::from_be_bytes([*pair.first()?, *pair.get(1)?]))
    };
    let is_exception = bytes.get(1)? & 0x80 != 0;
    let (first, second) = if is_exception {
        (0, 1)
    } else {
        (word(2)?, word(4)?)
    };
    let request = match function {
        rtu::Function::WriteCoil => rtu::Request::WriteCoil {
            at: first,
            value: rtu::CoilValue(second),
        },
        rtu::Function::WriteRegister => rtu::Request::WriteRegister {
            at: first,
            value: second,
        },
        // The reply tells how many were written, not which values.
        rtu::Function::WriteCoils => {
            let none = UNTOLD.get(..usize::from(second.div_ceil(8)))?;
            rtu::Request::WriteCoils(rtu::BitBlock::new(first, Bits::from_packed(none, second)?)?)
        }
        rtu::Function::WriteRegisters => {
            let none = UNTOLD.get(..2 * usize::from(second))?;
            let none = Words::from_packed(none)?;
            rtu::Request::WriteRegisters(rtu::WordBlock::new(first, none)?)
        }
        _ => return None,
    };
    Some(Exchange::rtu(at, request))
}
