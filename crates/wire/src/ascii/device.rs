//! The device side: decodes requests.

use super::{Exchange, FRAME_MAX, Line, Request, Text};
use crate::hex::byte;
use crate::{Address, Decoded, Malformed, PulseWidth};

/// How strictly a module decodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DecodeRules {
    /// Frames must carry a checksum.
    pub checksum: bool,
    /// Hexadecimal digits a to f are accepted too. Off by default [EDA §2.8].
    pub lower_case: bool,
}

impl Exchange {
    /// Decodes the beginning of `rx`, which starts with a delimiter, as a request.
    #[inline]
    pub fn decode_request(rx: &[u8], rules: DecodeRules) -> Decoded<Exchange> {
        match rx.first() {
            None => return Decoded::Partial { more: 4 },
            Some(b'$' | b'%' | b'#' | b'@' | b'~') => {}
            Some(_) => return Decoded::Malformed(Malformed::Start),
        }
        let Some(line) = Line::first(rx) else {
            return match rx.len() {
                FRAME_MAX.. => Decoded::Malformed(Malformed::End),
                _ => Decoded::Partial { more: 1 },
            };
        };
        match parse(line, rules) {
            Ok(value) => Decoded::Whole {
                len: line.frame_len(),
                value,
            },
            Err(why) => Decoded::Malformed(why),
        }
    }
}

/// Decodes a request.
#[inline]
fn parse(line: Line<'_>, rules: DecodeRules) -> Result<Exchange, Malformed> {
    let text = line.unsealed(rules.checksum, rules.lower_case)?;
    let checksum = rules.checksum;
    let [delimiter, high, low, body @ ..] = text else {
        return Err(Malformed::Length);
    };
    if [*high, *low] == *b"**" {
        let request = match (delimiter, body) {
            (b'#', []) => Request::SampleAll,
            (b'~', []) => Request::HostOk,
            _ => return Err(Malformed::Function),
        };
        return Ok(Exchange {
            address: Address(0),
            checksum,
            request,
        });
    }
    let address = Address(byte(*high, *low, rules.lower_case).ok_or(Malformed::Syntax)?);
    Ok(Exchange {
        address,
        checksum,
        request: parse_body(*delimiter, body, rules.lower_case)?,
    })
}

#[inline]
fn parse_body(delimiter: u8, body: &[u8], lower_case: bool) -> Result<Request, Malformed> {
    Ok(match (delimiter, body) {
        (b'$', [b'M']) => Request::ReadName,
        (b'$', [b'F']) => Request::ReadFirmware,
        (b'$', [b'2']) => Request::ReadConfig,
        (b'$', [b'3']) => Request::ReadPulse,
        (b'$', [b'4']) => Request::ReadLatched,
        (b'$', [b'5']) => Request::ReadReset,
        (b'$', [b'6']) => Request::ReadData,
        (b'$', [b'I']) => Request::ReadInit,
        (b'%', [_, _, _, _, _, _, _, _]) => {
            let [address, type_code, baud_code, format] = bytes(body, lower_case)?;
            Request::WriteConfig {
                new_address: Address(address),
                type_code,
                baud_code,
                format,
            }
        }
        (b'#', [_, _, _, _]) => {
            let [order, data, ..] = bytes(body, lower_case)?;
            Request::WriteOutputs { order, data }
        }
        (b'#', [b'4', rest @ ..]) if rest.len() == 4 => {
            let [mask, width, ..] = bytes(rest, lower_case)?;
            Request::WritePulse {
                mask,
                width: PulseWidth::from_tenths(width).ok_or(Malformed::Value)?,
            }
        }
        (b'@', []) => Request::ReadAll,
        (b'~', [b'0']) => Request::ReadWatchdogStatus,
        (b'~', [b'1']) => Request::ClearWatchdog,
        (b'~', [b'2']) => Request::ReadWatchdog,
        (b'~', [b'3', e, rest @ ..]) if rest.len() == 2 => {
            let enabled = match e {
                b'0' => false,
                b'1' => true,
                _ => return Err(Malformed::Value),
            };
            let [tenths, ..] = bytes(rest, lower_case)?;
            Request::WriteWatchdog { enabled, tenths }
        }
        (b'~', [b'4']) => Request::ReadSafe,
        (b'~', [b'5', rest @ ..]) if rest.len() == 4 => {
            let [power_on, safe, ..] = bytes(rest, lower_case)?;
            Request::WriteSafe { power_on, safe }
        }
        (b'~', [b'O', name @ ..]) => Request::Rename(Text::parse(name)?),
        _ => return Err(Malformed::Function),
    })
}

/// The bytes written as up to eight digits; 0 where there are none.
#[cfg_attr(feature = "small", inline(never))]
fn bytes(digits: &[u8], lower_case: bool) -> Result<[u8; 4], Malformed> {
    let mut bytes = [0; 4];
    let (pairs, _) = digits.as_chunks::<2>();
    for (to, [high, low]) in bytes.iter_mut().zip(pairs) {
        *to = byte(*high, *low, lower_case).ok_or(Malformed::Syntax)?;
    }
    Ok(bytes)
}

/// The address in a frame that ends with CR but is not a request, if its checksum is correct: so
/// that a module can answer `?AA`.
#[must_use]
pub fn address_of(frame: &[u8], rules: DecodeRules) -> Option<Address> {
    let line = Line::first(frame)?;
    let text = line.unsealed(rules.checksum, rules.lower_case).ok()?;
    match *text {
        [_, high, low, ..] => byte(high, low, rules.lower_case).map(Address),
        _ => None,
    }
}
