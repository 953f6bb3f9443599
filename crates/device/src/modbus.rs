//! What the Modbus families share: coils, runs of coils, and replies.

use crate::engine::DeviceState;
use crate::{Bank, Profile, Setup};
use railbus_wire::rtu::{self, BitBlock, Exception, Request, Response, WordSpan};
use railbus_wire::{Address, Bits, Exchange, Frame, Words};

/// The first run of adjacent channels, which one Modbus coil write can carry.
pub(crate) const fn run_of(want: Bank) -> Bank {
    if want.mask == 0 {
        return want;
    }
    let first = want.mask.trailing_zeros();
    let run = crate::family::mask((want.mask >> first).trailing_ones() as u8) << first;
    Bank::new(run, want.on)
}

/// A coil write for one output or a run of them; output 0 is the coil `first_coil`.
pub(crate) fn write_run(setup: &Setup, first_coil: u16, bank: Bank) -> Option<Exchange<'static>> {
    if run_of(bank) != bank {
        return None;
    }
    let first = bank.mask.trailing_zeros();
    let at = first_coil.checked_add(first as u16)?;
    let request = match bank.mask.count_ones() {
        1 => Request::WriteCoil {
            at,
            value: (bank.on != 0).into(),
        },
        count => {
            let values = Bits::from_mask(bank.on >> first, count as u16)?;
            Request::WriteCoils(BitBlock::new(at, values)?)
        }
    };
    Some(Exchange::rtu(setup.address, request))
}

/// The result of a request on the device side, not encoded yet.
pub(crate) enum Answer {
    /// This many of the lowest bits.
    Bits(u32, u16),
    /// Registers, packed, and how many bytes of them.
    Words([u8; 16], usize),
    /// The data of a diagnosis.
    Diagnosis(u16),
    /// A write was carried out.
    Done,
}

impl Answer {
    /// The registers of a span; the map begins at 0 and contains the span.
    pub(crate) fn span(map: &[u16], span: WordSpan) -> Answer {
        let words = map.get(usize::from(span.start())..);
        Answer::words(words.unwrap_or_default(), span.count())
    }

    /// The first `count` of these registers.
    pub(crate) fn words(words: &[u16], count: u16) -> Answer {
        let mut packed = [0; 16];
        let (pairs, _) = packed.as_chunks_mut::<2>();
        for (pair, word) in pairs.iter_mut().zip(words) {
            *pair = word.to_be_bytes();
        }
        Answer::Words(packed, 2 * usize::from(count))
    }
}

/// Device side: reads or writes outputs that are coils from `first_coil` on.
pub(crate) fn coils(
    state: &mut DeviceState,
    first_coil: u16,
    request: Request<'_>,
) -> Result<Answer, Exception> {
    let outputs = state.setup.outputs.into();
    match request {
        Request::ReadCoils(span) => {
            let first = run_in(first_coil, outputs, span.start(), span.count())?;
            Ok(Answer::Bits(
                state.outputs.wrapping_shr(first),
                span.count(),
            ))
        }
        Request::WriteCoil { at, value } => {
            // The value is checked before the address [MODBUS §3.5].
            let on = value.state().ok_or(Exception::VALUE)?;
            let mask = 1u32.wrapping_shl(run_in(first_coil, outputs, at, 1)?);
            state.switch(mask, if on { mask } else { 0 });
            Ok(Answer::Done)
        }
        Request::WriteCoils(block) => {
            let first = run_in(first_coil, outputs, block.start(), block.values().len())?;
            let mask = crate::family::mask(block.values().len() as u8);
            let on = block.values().to_mask().wrapping_shl(first);
            state.switch(mask.wrapping_shl(first), on);
            Ok(Answer::Done)
        }
        _ => Err(Exception::FUNCTION),
    }
}

/// Writes the reply of the module at `from`. A broadcast gets none.
pub(crate) fn respond(
    exchange: &rtu::Exchange<'_>,
    from: Address,
    outcome: Result<Answer, Exception>,
    reply: &mut Frame,
) {
    if exchange.address == rtu::BROADCAST {
        return;
    }
    let mut send = |response| exchange.encode_response(from, &response, reply);
    match outcome {
        Ok(Answer::Done) => send(Response::Done),
        Ok(Answer::Diagnosis(data)) => send(Response::Diagnosis(data)),
        Ok(Answer::Bits(bits, count)) => {
            if let Some(bits) = Bits::from_mask(bits, count) {
                send(Response::Bits(bits));
            }
        }
        Ok(Answer::Words(bytes, len)) => {
            if let Some(words) = bytes.get(..len).and_then(Words::from_packed) {
                send(Response::Words(words));
            }
        }
        Err(why) => send(Response::Exception(why)),
    }
}

/// The offset of a run of coils or registers in a map that has `len` of them from `first` on, or
/// the exception if the run leaves it.
pub(crate) fn run_in(first: u16, len: u16, at: u16, count: u16) -> Result<u32, Exception> {
    let offset = at.checked_sub(first).ok_or(Exception::ADDRESS)?;
    let inside = offset.checked_add(count).is_some_and(|end| end <= len);
    if inside {
        Ok(offset.into())
    } else {
        Err(Exception::ADDRESS)
    }
}

/// An address in a register.
pub(crate) fn address(profile: &Profile, value: u16) -> Result<Address, Exception> {
    let (low, high) = profile.addresses;
    let in_range = u8::try_from(value)
        .ok()
        .filter(|address| (low..=high).contains(address));
    in_range.map(Address).ok_or(Exception::VALUE)
}
