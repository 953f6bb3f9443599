//! The device side. Errors get no reply in all three protocols, unless an option enables one
//! [EDA §2.22, §3.15, §4.2].

use super::{PROTOCOL_CHECKSUM, has_pulses, model, name, read_map, write_map};
use crate::Family;
use crate::engine::{DeviceState, Eeprom};
use crate::modbus::{Answer, respond, run_in};
use railbus_wire::rtu::{self, Exception, WordBlock};
use railbus_wire::{Address, Channel, Frame, Instant, Micros, Protocol, PulseWidth};
use railbus_wire::{ascii, lc02};

/// Carries out an ASCII request and writes the reply.
pub(crate) fn ascii(
    state: &mut DeviceState,
    now: Instant,
    exchange: &ascii::Exchange,
    reply: &mut Frame,
) {
    if exchange.request.is_broadcast() || !state.hears(exchange.address) {
        return;
    }
    let from = state.address();
    let response = match exchange.request {
        ascii::Request::ReadName => {
            ascii::Text::new(name(state.family())).map(ascii::Response::Text)
        }
        ascii::Request::ReadConfig => ascii_config(state),
        ascii::Request::WriteConfig {
            new_address,
            type_code,
            baud_code,
            format,
        } => {
            let written = match (type_code, format) {
                (ascii::TYPE_DIGITAL, 0) => reconfigure(state, new_address, baud_code, Some(false)),
                (ascii::TYPE_DIGITAL, ascii::FORMAT_CHECKSUM) => {
                    reconfigure(state, new_address, baud_code, Some(true))
                }
                _ => None,
            };
            written.map(|()| ascii::Response::Done)
        }
        ascii::Request::ReadData => Some(ascii::Response::Data {
            outputs: state.outputs as u8,
            inputs: state.levels as u8,
        }),
        ascii::Request::WriteOutputs { order, data } => {
            switch_by_order(state, now, order, data).map(|()| ascii::Response::Done)
        }
        ascii::Request::ReadPulse => {
            pulse(state).map(|(mask, width)| ascii::Response::Pulse { mask, width })
        }
        ascii::Request::WritePulse { mask, width } => {
            set_pulse(state, mask, width).map(|()| ascii::Response::Done)
        }
        _ => None,
    };
    // The EDA9050's datasheet prints the new address in this one reply [EDA9050 §3.4].
    let readdressed = match (exchange.request, state.family()) {
        (ascii::Request::WriteConfig { new_address, .. }, Family::Eda9050) => new_address,
        _ => from,
    };
    match response {
        Some(response) => exchange.encode_response(readdressed, &response, reply),
        None if state.options.refuse_aloud => {
            exchange.encode_response(from, &ascii::Response::Invalid, reply);
        }
        None => {}
    }
}

/// Answers a well-framed but invalid request, if the option is on [EDA §2.23].
pub(crate) fn refuse_ascii(state: &DeviceState, address: Option<Address>, reply: &mut Frame) {
    if state.options.refuse_aloud && address == Some(state.address()) {
        let exchange = ascii::Exchange {
            address: state.address(),
            checksum: state.active.checksum,
            request: ascii::Request::ReadName,
        };
        exchange.encode_response(state.address(), &ascii::Response::Invalid, reply);
    }
}

/// Carries out an LC-02 request and writes the reply.
pub(crate) fn lc02(
    state: &mut DeviceState,
    now: Instant,
    exchange: &lc02::Exchange,
    reply: &mut Frame,
) {
    if !state.hears(exchange.address) {
        return;
    }
    let from = state.address();
    let response = match exchange.request {
        lc02::Request::ReadConfig => state.baud_code().map(|baud_code| lc02::Response::Config {
            baud_code,
            model: model(state.family()),
            type_code: 0,
        }),
        lc02::Request::WriteConfig {
            new_address,
            baud_code,
        } => reconfigure(state, new_address, baud_code, None).map(|()| lc02::Response::Done),
        lc02::Request::ReadData => Some(lc02::Response::Data {
            outputs: state.outputs as u8,
            inputs: state.levels as u8,
        }),
        // Outputs are locked: LC-02 refuses by not replying [BEYOND §1.4].
        lc02::Request::WriteOutputs(_) if state.is_locked() => None,
        lc02::Request::WriteOutputs(outputs) => {
            switch(state, now, outputs).map(|()| lc02::Response::Done)
        }
        lc02::Request::WritePulse { mask, width } => {
            set_pulse(state, mask, width).map(|()| lc02::Response::Done)
        }
        lc02::Request::ReadPulse => {
            pulse(state).map(|(mask, width)| lc02::Response::Pulse { mask, width })
        }
    };
    if let Some(response) = response {
        exchange.encode_response(from, response, reply);
    }
}

/// Carries out a Modbus request and writes the reply.
pub(crate) fn rtu(
    state: &mut DeviceState,
    now: Instant,
    exchange: &rtu::Exchange<'_>,
    reply: &mut Frame,
) {
    if !state.hears(exchange.address) {
        return;
    }
    let from = state.address();
    match carry_out(state, now, &exchange.request) {
        Err(why) => {
            let code = exchange.request.function().code();
            state.refuse_rtu(Some((exchange.address, code, why)), reply);
        }
        answer => respond(exchange, from, answer, reply),
    }
}

fn carry_out(
    state: &mut DeviceState,
    now: Instant,
    request: &rtu::Request<'_>,
) -> Result<Answer, Exception> {
    // Reserved coils and inputs of an EDA9060A read 0 [EDA9060A §6.2, §6.3]; an EDA9050 has none
    // [EDA9050 §5.2, §5.3].
    let (coils, inputs) = if has_pulses(state.family()) {
        (16, 16)
    } else {
        (8, 7)
    };
    match request {
        rtu::Request::ReadCoils(span) => {
            let first = run_in(0, coils, span.start(), span.count())?;
            Ok(Answer::Bits(
                state.outputs.wrapping_shr(first),
                span.count(),
            ))
        }
        rtu::Request::ReadDiscreteInputs(span) => {
            let first = run_in(0, inputs, span.start(), span.count())?;
            Ok(Answer::Bits(state.levels.wrapping_shr(first), span.count()))
        }
        rtu::Request::WriteCoil { at, value } => {
            // The value is checked before the address [MODBUS §3.5].
            let on = value.state().ok_or(Exception::VALUE)?;
            let channel = run_in(0, state.setup.outputs.into(), *at, 1)?;
            switch_bits(
                state,
                now,
                1u32.wrapping_shl(channel),
                if on { u32::MAX } else { 0 },
            );
            Ok(Answer::Done)
        }
        rtu::Request::WriteCoils(block) => {
            let first = run_in(0, coils, block.start(), block.values().len())?;
            let mask = crate::family::mask(block.values().len() as u8);
            let on = block.values().to_mask().wrapping_shl(first);
            switch_bits(state, now, mask.wrapping_shl(first), on);
            Ok(Answer::Done)
        }
        rtu::Request::ReadHoldingRegisters(span) if has_pulses(state.family()) => {
            run_in(0, read_map::LEN, span.start(), span.count())?;
            Ok(Answer::span(&registers(state), *span))
        }
        rtu::Request::WriteRegisters(block) => write_registers(state, block),
        _ => Err(Exception::FUNCTION),
    }
}

/// The read map of an EDA9060A.
fn registers(state: &DeviceState) -> [u16; 4] {
    let Eeprom {
        address,
        pulse_mask,
        pulse_width,
        checksum,
        protocol,
        ..
    } = state.eeprom;
    let protocol: u16 = match protocol {
        Protocol::Rtu | Protocol::R55 => 0b00,
        Protocol::Lc02 => 0b01,
        Protocol::Ascii => 0b10,
    };
    [
        model(state.family()),
        u16::from_be_bytes([address.0, state.baud_code().unwrap_or_default()]),
        u16::from_be_bytes([pulse_mask, pulse_width.tenths()]),
        protocol << 8 | if checksum { PROTOCOL_CHECKSUM } else { 0 },
    ]
}

/// Writes all registers of a block, or none [EDA §4.16].
fn write_registers(state: &mut DeviceState, block: &WordBlock<'_>) -> Result<Answer, Exception> {
    let writable = if has_pulses(state.family()) { 2 } else { 1 };
    run_in(0, writable, block.start(), block.values().len())?;
    let mut eeprom = state.eeprom;
    for (at, word) in block.words() {
        let [high, low] = word.to_be_bytes();
        match at {
            write_map::SERIAL if high != 0 => {
                eeprom.address = Address(high);
                let baud = state.family().profile().baud_of(low);
                eeprom.serial.baud = baud.ok_or(Exception::VALUE)?;
            }
            write_map::PULSE if high <= 0x0F => {
                eeprom.pulse_mask = high;
                eeprom.pulse_width = PulseWidth::from_tenths(low).ok_or(Exception::VALUE)?;
            }
            _ => return Err(Exception::VALUE),
        }
    }
    *state.keep() = eeprom;
    Ok(Answer::Done)
}

fn ascii_config(state: &DeviceState) -> Option<ascii::Response> {
    let format = if state.eeprom.checksum {
        ascii::FORMAT_CHECKSUM
    } else {
        0
    };
    let baud_code = state.baud_code()?;
    Some(ascii::Response::Config {
        type_code: ascii::TYPE_DIGITAL,
        baud_code,
        format,
    })
}

/// Takes new serial settings; no checksum means that it stays as it is.
fn reconfigure(
    state: &mut DeviceState,
    address: Address,
    baud_code: u8,
    checksum: Option<bool>,
) -> Option<()> {
    let baud = state.family().profile().baud_of(baud_code)?;
    let eeprom = state.keep();
    eeprom.address = address;
    eeprom.serial.baud = baud;
    eeprom.checksum = checksum.unwrap_or(eeprom.checksum);
    Some(())
}

/// Pulse mask and width, if the module has pulses.
fn pulse(state: &DeviceState) -> Option<(u8, PulseWidth)> {
    let Eeprom {
        pulse_mask,
        pulse_width,
        ..
    } = state.eeprom;
    has_pulses(state.family()).then_some((pulse_mask, pulse_width))
}

fn set_pulse(state: &mut DeviceState, mask: u8, width: PulseWidth) -> Option<()> {
    if !has_pulses(state.family()) || u32::from(mask) & !state.setup.output_mask() != 0 {
        return None;
    }
    let eeprom = state.keep();
    eeprom.pulse_mask = mask;
    eeprom.pulse_width = width;
    Some(())
}

/// `#AAoodd` [EDA §2.18, §2.19].
fn switch_by_order(state: &mut DeviceState, now: Instant, order: u8, data: u8) -> Option<()> {
    let outputs = match (order, data) {
        (ascii::ALL_OUTPUTS, value) => lc02::Outputs::All(value),
        (0x10..=0x17, 0 | 1) => lc02::Outputs::One(Channel::new(order & 0x0F)?, data == 1),
        _ => return None,
    };
    switch(state, now, outputs)
}

/// Switches all outputs or one, unless a channel or value is out of range.
fn switch(state: &mut DeviceState, now: Instant, outputs: lc02::Outputs) -> Option<()> {
    let all = state.setup.output_mask();
    let (mask, on) = match outputs {
        lc02::Outputs::All(value) => (all, u32::from(value)),
        lc02::Outputs::One(channel, true) => (channel.mask(), channel.mask()),
        lc02::Outputs::One(channel, false) => (channel.mask(), 0),
    };
    if (mask | on) & !all != 0 {
        return None;
    }
    switch_bits(state, now, mask, on);
    Some(())
}

/// Switches outputs, each by its own mode: a level output follows its bit, a pulse output starts a
/// pulse on 1 and ignores 0 [EDA9060A §3.1, §3.2, §3.3, §3.9].
fn switch_bits(state: &mut DeviceState, now: Instant, mask: u32, on: u32) {
    let pulses = u32::from(state.eeprom.pulse_mask);
    let width = Micros::from_millis(100) * u64::from(state.eeprom.pulse_width.tenths());
    state.switch(mask & !pulses, on);
    for channel in (0..state.setup.outputs).filter_map(Channel::new) {
        if mask & on & pulses & channel.mask() != 0 {
            state.switch_for(now, channel, true, width);
        }
    }
}
