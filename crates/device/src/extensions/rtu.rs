//! The extensions of Modbus modules: registers, diagnosis, identification.

use super::{Counters, VERSION, number};
use crate::engine::DeviceState;
use crate::modbus::{Answer, respond, run_in};
use railbus_wire::rtu::{
    self, Exception, Exchange, Identification, Request, WordBlock, WordSpan, diagnosis,
};
use railbus_wire::{Frame, Instant, Words};

/// The register for number 0. No datasheet has any near it [BEYOND §3.1].
const FIRST: u16 = 0xBE00;

/// Where to find its documentation.
const URL: &str = env!("CARGO_PKG_REPOSITORY");

/// Executes a request that is an extension and writes the reply; returns whether it is one. A
/// broadcast is not: it has no effect here [BEYOND §3.5].
pub(crate) fn answer(
    state: &mut DeviceState,
    now: Instant,
    exchange: &Exchange<'_>,
    reply: &mut Frame,
) -> bool {
    if !state.options.extensions || exchange.address != state.address() {
        return false;
    }
    let from = state.address();
    let outcome = match exchange.request {
        Request::ReadHoldingRegisters(span) if is_ours(span.start()) => read(state, span),
        Request::WriteRegister { at, value } if is_ours(at) => {
            WordBlock::new(at, Words::one(value))
                .ok_or(Exception::ADDRESS)
                .and_then(|block| write(state, now, &block))
        }
        Request::WriteRegisters(block) if is_ours(block.start()) => write(state, now, &block),
        Request::WriteCoil { .. } | Request::WriteCoils(_) if state.is_locked() => {
            Err(Exception::FAILURE)
        }
        Request::Diagnose { sub, data } => diagnose(state, sub, data).map(Answer::Diagnosis),
        Request::Identify { code, object } => match identify(state, code, object, reply) {
            Ok(()) => return true,
            Err(why) => Err(why),
        },
        _ => return false,
    };
    respond(exchange, from, outcome, reply);
    true
}

const fn is_ours(register: u16) -> bool {
    register >= FIRST && register - FIRST < number::COUNT
}

fn read(state: &DeviceState, span: WordSpan) -> Result<Answer, Exception> {
    let first = run_in(FIRST, number::COUNT, span.start(), span.count())?;
    let extensions = &state.eeprom.extensions;
    let all: [u16; number::COUNT as usize] =
        core::array::from_fn(|number| extensions.number(number as u16));
    let asked = all.get(first as usize..).unwrap_or_default();
    Ok(Answer::words(asked, span.count()))
}

/// Writes all registers of a block, or none.
fn write(
    state: &mut DeviceState,
    now: Instant,
    block: &WordBlock<'_>,
) -> Result<Answer, Exception> {
    run_in(FIRST, number::COUNT, block.start(), block.values().len())?;
    let mut extensions = state.eeprom.extensions;
    for (at, value) in block.words() {
        let number = at.wrapping_sub(FIRST);
        extensions = extensions.with(number, value).ok_or(Exception::VALUE)?;
    }
    if state.store_extensions(now, extensions) {
        Ok(Answer::Done)
    } else {
        Err(Exception::VALUE)
    }
}

/// Function 08 [BEYOND §4].
fn diagnose(state: &mut DeviceState, sub: u16, data: u16) -> Result<u16, Exception> {
    match sub {
        diagnosis::ECHO => return Ok(data),
        diagnosis::REGISTER
        | diagnosis::CLEAR
        | diagnosis::FIRST_COUNTER..=diagnosis::LAST_COUNTER
        | diagnosis::CLEAR_OVERRUN => {}
        _ => return Err(Exception::FUNCTION),
    }
    if data != 0 {
        return Err(Exception::VALUE);
    }
    match sub {
        diagnosis::CLEAR => state.counters = Counters::default(),
        diagnosis::CLEAR_OVERRUN => state.counters.overruns = 0,
        diagnosis::REGISTER => return Ok(state.eeprom.extensions.status().into()),
        _ => return Ok(state.counters.get(sub)),
    }
    Ok(0)
}

/// Function 2B [BEYOND §5].
fn identify(state: &DeviceState, code: u8, object: u8, reply: &mut Frame) -> Result<(), Exception> {
    let profile = state.family().profile();
    let all = [
        (Identification::VENDOR, "railbus"),
        (Identification::PRODUCT, profile.name),
        (Identification::REVISION, VERSION),
        (Identification::URL, URL),
        (Identification::NAME, profile.model),
    ];
    let from = usize::from(object);
    let objects = match code {
        1 => stream(all.split_at(3).0, from),
        2 | 3 => stream(&all, from),
        4 => all.get(from..=from).ok_or(Exception::ADDRESS)?,
        _ => return Err(Exception::VALUE),
    };
    rtu::encode_identification(state.address(), code, objects, reply);
    Ok(())
}

/// The objects from one on; one that does not exist means the first [BEYOND §5.3].
fn stream<T>(objects: &[T], from: usize) -> &[T] {
    let rest = objects.get(from..).filter(|rest| !rest.is_empty());
    rest.unwrap_or(objects)
}
