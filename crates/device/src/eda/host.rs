//! The host side.

use super::{PROTOCOL_CHECKSUM, has_pulses, read_map, write_map};
use crate::{Bank, Family, Observation, Op, Profile, SettingWrite, Setup, modbus};
use railbus_wire::rtu::{self, BitSpan, WordBlock, WordSpan};
use railbus_wire::{Address, Channel, Exchange, Protocol, PulseWidth, Response, Words};
use railbus_wire::{ascii, lc02};

/// The single exchange for an op.
pub(crate) fn exchange(setup: &Setup, op: &Op) -> Option<Exchange<'static>> {
    let pulses = matches!(
        op,
        Op::ReadPulse | Op::Configure(SettingWrite::Pulse { .. })
    );
    if pulses && !has_pulses(setup.family) {
        return None;
    }
    let address = setup.address;
    match setup.protocol {
        Protocol::Ascii => Some(Exchange::ascii(
            address,
            setup.checksum,
            in_ascii(setup, op)?,
        )),
        Protocol::Lc02 => Some(Exchange::lc02(address, in_lc02(setup, op)?)),
        Protocol::Rtu => match op {
            Op::Write(bank) => modbus::write_run(setup, 0, *bank),
            _ => Some(Exchange::rtu(address, in_rtu(setup, op)?)),
        },
        Protocol::R55 => None,
    }
}

fn in_ascii(setup: &Setup, op: &Op) -> Option<ascii::Request> {
    Some(match *op {
        Op::ReadOutputs | Op::ReadInputs => ascii::Request::ReadData,
        Op::ReadPulse => ascii::Request::ReadPulse,
        Op::Identify => ascii::Request::ReadName,
        Op::ReadConfig | Op::Fence => ascii::Request::ReadConfig,
        Op::Write(bank) => {
            let (order, data) = match outputs(setup, bank)? {
                lc02::Outputs::All(value) => (ascii::ALL_OUTPUTS, value),
                lc02::Outputs::One(channel, on) => (0x10 | channel.index(), u8::from(on)),
            };
            ascii::Request::WriteOutputs { order, data }
        }
        Op::Configure(SettingWrite::Pulse { mask, width }) => {
            ascii::Request::WritePulse { mask, width }
        }
        Op::Configure(SettingWrite::Serial {
            address,
            baud,
            checksum,
        }) => ascii::Request::WriteConfig {
            new_address: address,
            type_code: ascii::TYPE_DIGITAL,
            baud_code: profile(setup).baud_code(baud)?,
            format: if checksum { ascii::FORMAT_CHECKSUM } else { 0 },
        },
        _ => return None,
    })
}

fn in_lc02(setup: &Setup, op: &Op) -> Option<lc02::Request> {
    Some(match *op {
        Op::ReadOutputs | Op::ReadInputs => lc02::Request::ReadData,
        Op::ReadPulse => lc02::Request::ReadPulse,
        Op::Identify | Op::ReadConfig | Op::Fence => lc02::Request::ReadConfig,
        Op::Write(bank) => lc02::Request::WriteOutputs(outputs(setup, bank)?),
        Op::Configure(SettingWrite::Pulse { mask, width }) => {
            lc02::Request::WritePulse { mask, width }
        }
        Op::Configure(SettingWrite::Serial {
            address,
            baud,
            checksum: false,
        }) => lc02::Request::WriteConfig {
            new_address: address,
            baud_code: profile(setup).baud_code(baud)?,
        },
        _ => return None,
    })
}

fn in_rtu(setup: &Setup, op: &Op) -> Option<rtu::Request<'static>> {
    let registers = |at, count| {
        let span = WordSpan::new(at, count).filter(|_| has_pulses(setup.family))?;
        Some(rtu::Request::ReadHoldingRegisters(span))
    };
    let write = |at, word| {
        Some(rtu::Request::WriteRegisters(WordBlock::new(
            at,
            Words::one(word),
        )?))
    };
    match *op {
        Op::ReadOutputs => Some(rtu::Request::ReadCoils(BitSpan::new(
            0,
            setup.outputs.into(),
        )?)),
        Op::ReadInputs => Some(rtu::Request::ReadDiscreteInputs(BitSpan::new(
            0,
            setup.inputs.into(),
        )?)),
        Op::ReadPulse => registers(read_map::PULSE, 1),
        Op::Identify => registers(read_map::MODEL, read_map::LEN),
        Op::ReadConfig => registers(read_map::SERIAL, 3),
        Op::Configure(SettingWrite::Pulse { mask, width }) => {
            write(write_map::PULSE, u16::from_be_bytes([mask, width.tenths()]))
        }
        Op::Configure(SettingWrite::Serial {
            address,
            baud,
            checksum: false,
        }) if address.0 != 0 => {
            let code = profile(setup).baud_code(baud)?;
            write(write_map::SERIAL, u16::from_be_bytes([address.0, code]))
        }
        _ => None,
    }
}

/// The outputs of a write, if one frame can carry them: one, or all.
fn outputs(setup: &Setup, bank: Bank) -> Option<lc02::Outputs> {
    let on = bank.on as u8;
    if bank.mask == setup.output_mask() {
        Some(lc02::Outputs::All(on))
    } else if bank.mask.count_ones() == 1 {
        let channel = Channel::new(bank.mask.trailing_zeros() as u8)?;
        Some(lc02::Outputs::One(channel, on != 0))
    } else {
        None
    }
}

/// As much of a write as one frame can carry: in Modbus a run, otherwise all outputs or one.
pub(crate) const fn group(setup: &Setup, want: Bank) -> Bank {
    match setup.protocol {
        Protocol::Rtu => modbus::run_of(want),
        _ if want.mask == setup.output_mask() => want,
        _ => Bank::new(want.mask & want.mask.wrapping_neg(), want.on),
    }
}

/// Decodes a reply.
pub(crate) fn interpret(setup: &Setup, op: &Op, response: &Response<'_>) -> Option<Observation> {
    match response {
        Response::Ascii(response) => of_ascii(setup, response),
        Response::Lc02(response) => of_lc02(setup, op, response),
        Response::Rtu(response) => of_rtu(setup, op, response),
        Response::R55(_) => None,
    }
}

fn of_ascii(setup: &Setup, response: &ascii::Response) -> Option<Observation> {
    Some(match *response {
        ascii::Response::Data { outputs, inputs } => channels(setup, outputs, inputs),
        // A late name has bits that no mask has: `!019060`.
        ascii::Response::Pulse { mask, .. } if u32::from(mask) & !setup.output_mask() != 0 => {
            return None;
        }
        ascii::Response::Pulse { mask, width } => Observation::Pulse { mask, width },
        ascii::Response::Text(name) => Observation::Name(name),
        ascii::Response::Config {
            baud_code, format, ..
        } => Observation::Config {
            address: None,
            baud: profile(setup).baud_of(baud_code),
            character: None,
            checksum: Some(format & ascii::FORMAT_CHECKSUM != 0),
        },
        ascii::Response::Done => Observation::Done,
        _ => return None,
    })
}

fn of_lc02(setup: &Setup, op: &Op, response: &lc02::Response) -> Option<Observation> {
    Some(match *response {
        lc02::Response::Data { outputs, inputs } => channels(setup, outputs, inputs),
        lc02::Response::Pulse { mask, width } => Observation::Pulse { mask, width },
        lc02::Response::Config { model, .. } if matches!(op, Op::Identify) => {
            Observation::Model(model)
        }
        lc02::Response::Config { baud_code, .. } => Observation::Config {
            address: None,
            baud: profile(setup).baud_of(baud_code),
            character: None,
            checksum: None,
        },
        lc02::Response::Done => Observation::Done,
    })
}

fn of_rtu(setup: &Setup, op: &Op, response: &rtu::Response<'_>) -> Option<Observation> {
    Some(match (op, response) {
        (Op::ReadOutputs, rtu::Response::Bits(bits)) => Observation::Channels {
            outputs: Bank::new(setup.output_mask(), bits.to_mask()),
            inputs: Bank::default(),
        },
        (Op::ReadInputs, rtu::Response::Bits(bits)) => Observation::Channels {
            outputs: Bank::default(),
            inputs: Bank::new(setup.input_mask(), bits.to_mask()),
        },
        // Another module may have answered after its address was changed: it reports the new one.
        (Op::Identify, rtu::Response::Words(words)) => {
            let [address, _] = words.get(read_map::SERIAL)?.to_be_bytes();
            if Address(address) != setup.address {
                return None;
            }
            Observation::Model(words.get(read_map::MODEL)?)
        }
        (Op::ReadPulse, rtu::Response::Words(words)) => {
            let [mask, width] = words.get(0)?.to_be_bytes();
            Observation::Pulse {
                mask: mask & 0x0F,
                width: PulseWidth::from_tenths(width)?,
            }
        }
        (Op::ReadConfig, rtu::Response::Words(words)) => {
            let [address, baud_code] = words.get(0)?.to_be_bytes();
            let protocol = words.get(read_map::PROTOCOL - read_map::SERIAL)?;
            Observation::Config {
                address: Some(Address(address)),
                baud: profile(setup).baud_of(baud_code),
                character: None,
                checksum: Some(protocol & PROTOCOL_CHECKSUM != 0),
            }
        }
        (_, rtu::Response::Done) => Observation::Done,
        _ => return None,
    })
}

/// Whether a name or model number is this model's [EDA §3.7].
pub(crate) fn recognises(setup: &Setup, seen: &Observation) -> bool {
    match seen {
        Observation::Name(name) => Family::of_name(name.bytes()) == Some(setup.family),
        Observation::Model(number) => Family::of_number(*number) == Some(setup.family),
        _ => true,
    }
}

/// Outputs and inputs of one frame, without bits that the model does not have.
fn channels(setup: &Setup, outputs: u8, inputs: u8) -> Observation {
    Observation::Channels {
        outputs: Bank::new(setup.output_mask(), outputs.into()),
        inputs: Bank::new(setup.input_mask(), inputs.into()),
    }
}

const fn profile(setup: &Setup) -> &'static Profile {
    setup.family.profile()
}
