//! Frames of one's own: only reads may go out without a command of their own.

use railbus_wire::{Decoded, Exchange, Protocol, ascii, lc02, r55, rtu};

/// The read that these bytes are, checksum and all; nothing where they are none. An ASCII frame
/// may carry a checksum or not.
#[must_use]
pub fn read_request(protocol: Protocol, bytes: &[u8]) -> Option<Exchange<'static>> {
    match protocol {
        Protocol::Rtu => rtu_read(bytes).map(Exchange::Rtu),
        Protocol::Ascii => [false, true]
            .into_iter()
            .filter_map(|checksum| {
                let rules = ascii::Rules {
                    checksum,
                    lower_case: false,
                };
                all_of(ascii::Exchange::decode_request(bytes, rules), bytes)
            })
            .find(|exchange| is_ascii_read(&exchange.request))
            .map(Exchange::Ascii),
        Protocol::Lc02 => all_of(lc02::Exchange::decode_request(bytes), bytes)
            .filter(|exchange| {
                use lc02::Request::{ReadConfig, ReadData, ReadPulse};
                matches!(exchange.request, ReadConfig | ReadData | ReadPulse)
            })
            .map(Exchange::Lc02),
        Protocol::R55 => all_of(r55::Exchange::decode_request(bytes), bytes)
            .filter(|exchange| {
                use r55::Request::{ReadAddress, ReadState, ReadVariable};
                matches!(
                    exchange.request(),
                    ReadState | ReadAddress | ReadVariable(_)
                )
            })
            .map(Exchange::R55),
    }
}

fn rtu_read(bytes: &[u8]) -> Option<rtu::Exchange<'static>> {
    use rtu::Request as R;
    let rtu::Exchange { address, request } = rtu::Exchange::decode_frame(bytes).ok()?;
    let request = match request {
        R::ReadCoils(span) => R::ReadCoils(span),
        R::ReadDiscreteInputs(span) => R::ReadDiscreteInputs(span),
        R::ReadHoldingRegisters(span) => R::ReadHoldingRegisters(span),
        R::ReadInputRegisters(span) => R::ReadInputRegisters(span),
        R::Diagnose { sub, data } if request.is_read() => R::Diagnose { sub, data },
        R::Identify { code, object } => R::Identify { code, object },
        R::Diagnose { .. } => return None,
        R::WriteCoil { .. } | R::WriteRegister { .. } => return None,
        R::WriteCoils(_) | R::WriteRegisters(_) => return None,
    };
    // Nobody answers a broadcast.
    (address.0 != 0).then_some(rtu::Exchange { address, request })
}

const fn is_ascii_read(request: &ascii::Request) -> bool {
    use ascii::Request as R;
    match request {
        R::ReadName | R::ReadFirmware | R::ReadConfig | R::ReadData | R::ReadPulse => true,
        R::ReadLatched | R::ReadInit | R::ReadAll => true,
        R::ReadWatchdogStatus | R::ReadWatchdog | R::ReadSafe => true,
        // Reading it clears it.
        R::ReadReset => false,
        R::WriteConfig { .. } | R::WriteOutputs { .. } | R::WritePulse { .. } => false,
        R::SampleAll | R::HostOk | R::ClearWatchdog => false,
        R::WriteWatchdog { .. } | R::WriteSafe { .. } | R::Rename(_) => false,
    }
}

/// The value of a frame that is all there is.
fn all_of<T>(decoded: Decoded<T>, bytes: &[u8]) -> Option<T> {
    match decoded {
        Decoded::Whole { len, value } if len == bytes.len() => Some(value),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_pass_and_nothing_else_does() {
        let passes = |protocol, bytes: &[u8]| read_request(protocol, bytes).is_some();
        let coils = [0x03, 0x01, 0x00, 0x3C, 0x00, 0x08, 0xFC, 0x22];
        assert!(passes(Protocol::Rtu, &coils));
        let on = [0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00, 0x4D, 0xD4];
        assert!(!passes(Protocol::Rtu, &on));
        let counter = [0x03, 0x08, 0x00, 0x0C, 0x00, 0x00, 0x21, 0xEA];
        assert!(passes(Protocol::Rtu, &counter));
        let mute = [0x03, 0x08, 0x00, 0x04, 0x00, 0x00, 0xA0, 0x28];
        assert!(!passes(Protocol::Rtu, &mute));
        assert!(passes(Protocol::Ascii, b"$016\r"));
        assert!(!passes(Protocol::Ascii, b"#010001\r"));
        assert!(!passes(Protocol::Ascii, b"$016\r$016\r"));
        let state = [0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69];
        assert!(passes(Protocol::R55, &state));
        assert!(!passes(
            Protocol::R55,
            &[0x55, 0x04, 0x10, 0, 0, 0, 0, 0x6A]
        ));
        assert!(!passes(Protocol::Lc02, &[]));
    }
}
