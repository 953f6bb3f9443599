//! EMD-2A2Q: two analog inputs and two relays on Modbus RTU.
//!
//! Its registers are the ERC-8's shifted by one, with other baud rate codes: what sets the speed of
//! one sets the address of the other [EMD-2A2Q §4.2, ERC-8 §4.2].

use crate::datasheet::{
    Access, Datasheet, Factory, Holds, Key, PerProtocol, PulseTiming, Recognition, Register,
    ScanEvidence, Separation, StoredSetting, Terminal, note, same,
};
use crate::engine::{AnalogCalibration, DeviceState, Eeprom};
use crate::modbus::{self, Answer, respond, run_in};
use crate::sign::{ReadOutcome, Sign};
use crate::{Bank, Observation, Op, Profile, SettingWrite, Setup};
use railbus_wire::rtu::{self, BitSpan, Exception, Function, Request, WordBlock, WordSpan};
use railbus_wire::{
    Address, Baud, Character, Exchange, Frame, Instant, Micros, Protocol, Response, SerialSettings,
    Words,
};

/// The datasheet as data.
pub(crate) static PROFILE: Profile = Profile {
    name: "emd2a2q",
    model: "EMD-2A2Q",
    outputs: 2,
    inputs: 0,
    analogs: 2,
    protocols: &[Protocol::Rtu],
    bauds: &[
        (0, Baud::B2400),
        (1, Baud::B4800),
        (2, Baud::B9600),
        (3, Baud::B19200),
        (4, Baud::B38400),
    ],
    characters: &[(0, Character::N1), (1, Character::O1), (2, Character::E1)],
    addresses: (1, 32),
    gap: Some(Micros::from_millis(10)),
    output_label: ("k", 1),
    input_label: ("d", 1),
};

/// What only a host asks. Terminals and ratings are in the tables at the end of the sheet.
pub(crate) static DATASHEET: Datasheet = Datasheet {
    title: same("EMD-2A2Q"),
    names: &[],
    numbers: &[],
    signs: &SIGNS,
    recognition: PerProtocol::same(Recognition::ByRegisters),
    // [EMD-2A2Q §2.2]
    refuses: true,
    evidence: ScanEvidence::Version,
    channels_vary: false,
    broadcast: None,
    // [EMD-2A2Q §1.2, §1.3, §4.5]; a reset leads there, too [EMD-2A2Q §5.8].
    factory: Factory {
        address: Address(1),
        serial: SerialSettings::FACTORY,
        voltage: Some(500),
    },
    serial_as_one: false,
    settings: &[
        StoredSetting::new(Key::Address, Access::Written),
        StoredSetting::new(Key::Baud, Access::Written),
        StoredSetting::new(Key::Parity, Access::Written),
        StoredSetting::new(Key::CalibrationVoltage, Access::Written),
    ],
    separation: PerProtocol::same(Separation::Plug),
    pulses: PulseTiming::Host,
    dip_switch: false,
    init_pin: false,
    registers: &REGISTER_MAP,
    terminals: &[
        Terminal::new("2 3 4", ["two analog inputs", "两路模拟量输入"]),
        Terminal::new("5 6", same("RS-485")),
        Terminal::new("7 8", ["supply, 9 to 28 VDC", "电源 9–28 VDC"]),
        Terminal::new("11 12 13", same("OUT2")),
        Terminal::new("16 17 18", same("OUT1")),
    ],
    notes: &[
        ["Accuracy 1 % of full scale", "精度：满量程的 1 %"],
        note::CONTACTS,
        note::BUS,
        // [EMD-2A2Q §1.8]
        note::POWER_UP,
    ],
};

const REGISTER_MAP: [Register; 8] = [
    Register::new(
        Holds::Version,
        ["product version", "产品版本"],
        "[EMD-2A2Q §4.1]",
    ),
    Register::new(Holds::Address, ["address", "地址"], "[EMD-2A2Q §4.2]"),
    Register::new(Holds::Baud, ["speed code", "波特率代码"], "[EMD-2A2Q §4.3]"),
    Register::new(
        Holds::Parity,
        ["parity code", "校验位代码"],
        "[EMD-2A2Q §4.4]",
    ),
    Register::new(
        Holds::Voltage,
        ["calibration voltage in 0.01 V", "校准电压（0.01 V）"],
        "[EMD-2A2Q §4.5]",
    ),
    Register::new(
        Holds::Calibration,
        ["calibration under way", "校准进行中"],
        "[EMD-2A2Q §5.1]",
    ),
    Register::new(
        Holds::Analog(0),
        ["analog input 1, times 100", "模拟量输入 1（×100）"],
        "[EMD-2A2Q §4.6]",
    ),
    Register::new(
        Holds::Analog(1),
        ["analog input 2, times 100", "模拟量输入 2（×100）"],
        "[EMD-2A2Q §4.6]",
    ),
];

/// The coil of OUT1.
const FIRST_COIL: u16 = 8;
const RELAYS: u16 = 2;

const ADDRESS: u16 = 1;
const BAUD: u16 = 2;
const CHARACTER: u16 = 3;
const VOLTAGE: u16 = 4;
const COMMAND: u16 = 5;
const ANALOGS: u16 = 6;
const REGISTERS: u16 = 8;

/// Functions that the codec knows and the module lacks [EMD-2A2Q §2.2].
pub(crate) const ABSENT: &[Function] =
    &[Function::ReadDiscreteInputs, Function::ReadInputRegisters];

/// Register 0 of the simulated module.
const VERSION: u16 = 12;

/// The bits of the command register [EMD-2A2Q §5.1].
const ZERO: u16 = 1 << 0;
const SPAN: u16 = 1 << 1;
const RESTORE: u16 = 1 << 2;

/// How long a calibration takes in the simulated module [EMD-2A2Q §5.5].
const CALIBRATION_TIME: Micros = Micros::from_millis(500);

/// What identifies it: relays at 8 and 9 and nowhere else, and eight registers that hold its own
/// address and codes [EMD-2A2Q §3.1, §3.2, §3.6, §4.2, §4.3, §4.4, §4.7].
const SIGNS: [Option<Sign>; 6] = [
    Sign::coils(0, 8, ReadOutcome::Refusal(Exception::ADDRESS)),
    Sign::coils(60, 8, ReadOutcome::Refusal(Exception::ADDRESS)),
    Sign::registers(0, REGISTERS, ReadOutcome::Registers(could_be_own)),
    Sign::registers(0, REGISTERS + 1, ReadOutcome::Refusal(Exception::ADDRESS)),
    Sign::coils(FIRST_COIL, RELAYS, ReadOutcome::Answer),
    Sign::coils(
        FIRST_COIL + RELAYS,
        1,
        ReadOutcome::Refusal(Exception::ADDRESS),
    ),
];

/// Whether these registers can be those of a module at that address.
fn could_be_own(at: Address, words: &Words<'_>) -> bool {
    let code = |at: u16| words.get(at).and_then(|word| u8::try_from(word).ok());
    code(ADDRESS) == Some(at.0)
        && code(BAUD).and_then(|code| PROFILE.baud_of(code)).is_some()
        && code(CHARACTER)
            .and_then(|code| PROFILE.character_of(code))
            .is_some()
}

/// Host side: the single exchange for an op.
pub(crate) fn exchange(setup: &Setup, op: &Op) -> Option<Exchange<'static>> {
    let read = |at, count| Some(Request::ReadHoldingRegisters(WordSpan::new(at, count)?));
    let register = |at, value| Some(Request::WriteRegister { at, value });
    let request = match *op {
        Op::ReadOutputs => Some(Request::ReadCoils(BitSpan::new(FIRST_COIL, RELAYS)?)),
        Op::ReadAnalogs => read(ANALOGS, 2),
        Op::Identify => read(0, 1),
        Op::ReadConfig => read(ADDRESS, 3),
        Op::Write(bank) => return modbus::write_run(setup, FIRST_COIL, bank),
        Op::Configure(SettingWrite::Address(new)) => register(ADDRESS, u16::from(new.0)),
        Op::Configure(SettingWrite::Baud(baud)) => register(BAUD, PROFILE.baud_code(baud)?.into()),
        Op::Configure(SettingWrite::Character(character)) => {
            register(CHARACTER, PROFILE.character_code(character)?.into())
        }
        Op::Configure(SettingWrite::CalibrationVoltage(voltage)) => register(VOLTAGE, voltage),
        Op::Configure(SettingWrite::CalibrateZero) => register(COMMAND, ZERO),
        Op::Configure(SettingWrite::CalibrateSpan) => register(COMMAND, SPAN),
        Op::Configure(SettingWrite::Restore) => register(COMMAND, RESTORE),
        _ => None,
    };
    Some(Exchange::rtu(setup.address, request?))
}

/// Host side: decodes a reply.
pub(crate) fn interpret(op: &Op, response: &Response<'_>) -> Option<Observation> {
    let Response::Rtu(response) = response else {
        return None;
    };
    Some(match (op, response) {
        (Op::ReadOutputs, rtu::Response::Bits(relays)) => Observation::Channels {
            outputs: Bank::new(crate::family::mask(PROFILE.outputs), relays.to_mask()),
            inputs: Bank::default(),
        },
        (Op::ReadAnalogs, rtu::Response::Words(words)) => {
            Observation::Analogs([words.get(0)?, words.get(1)?])
        }
        (Op::Identify, rtu::Response::Words(words)) => Observation::Version(words.get(0)?),
        (Op::ReadConfig, rtu::Response::Words(words)) => seen_config(words),
        (_, rtu::Response::Done) => Observation::Done,
        _ => return None,
    })
}

fn seen_config(words: &Words<'_>) -> Observation {
    let code = |at: u16| u8::try_from(words.get(at - ADDRESS)?).ok();
    Observation::Config {
        address: code(ADDRESS).map(Address),
        baud: code(BAUD).and_then(|code| PROFILE.baud_of(code)),
        character: code(CHARACTER).and_then(|code| PROFILE.character_of(code)),
        checksum: None,
    }
}

/// Device side: executes a request and writes the reply. Every write to address 0 is executed
/// [EMD-2A2Q §6.1].
pub(crate) fn answer(
    state: &mut DeviceState,
    now: Instant,
    exchange: &rtu::Exchange<'_>,
    reply: &mut Frame,
) {
    if !state.hears(exchange.address) {
        return;
    }
    let from = state.address();
    let outcome = carry_out(state, now, exchange.request);
    respond(exchange, from, outcome, reply);
}

fn carry_out(
    state: &mut DeviceState,
    now: Instant,
    request: Request<'_>,
) -> Result<Answer, Exception> {
    match request {
        Request::ReadCoils(_) | Request::WriteCoil { .. } | Request::WriteCoils(_) => {
            modbus::coils(state, FIRST_COIL, request)
        }
        Request::ReadHoldingRegisters(span) => {
            run_in(0, REGISTERS, span.start(), span.count())?;
            Ok(Answer::span(&registers(state), span))
        }
        Request::WriteRegister { at, value } => {
            let block = WordBlock::new(at, Words::one(value)).ok_or(Exception::ADDRESS)?;
            write_registers(state, now, &block)
        }
        Request::WriteRegisters(block) => write_registers(state, now, &block),
        Request::ReadDiscreteInputs(_)
        | Request::ReadInputRegisters(_)
        | Request::Diagnose { .. }
        | Request::Identify { .. } => Err(Exception::FUNCTION),
    }
}

fn registers(state: &DeviceState) -> [u16; 8] {
    let Eeprom {
        address,
        serial,
        calibration,
        ..
    } = state.eeprom;
    let code = |code: Option<u8>| u16::from(code.unwrap_or_default());
    let [first, second] = [0, 1].map(|channel| reading(state, channel));
    [
        VERSION,
        u16::from(address.0),
        code(PROFILE.baud_code(serial.baud)),
        code(PROFILE.character_code(serial.character)),
        calibration.voltage,
        state.calibrating.map_or(0, |(bit, _)| bit),
        first,
        second,
    ]
}

/// What an input reads after calibration, in hundredths, never below 0 [EMD-2A2Q §4.14].
fn reading(state: &DeviceState, channel: usize) -> u16 {
    let calibration = &state.eeprom.calibration;
    let measured = state.analogs.get(channel).copied().unwrap_or_default();
    let zero = calibration.zero.get(channel).copied().unwrap_or_default();
    let (at_span, voltage) = calibration.span.get(channel).copied().unwrap_or((1, 1));
    // At most 65535, so the product fits; negative values read 0.
    let above_zero = (i32::from(measured) - i32::from(zero))
        .max(0)
        .unsigned_abs();
    let scaled = above_zero * u32::from(voltage) / u32::from(at_span.max(1));
    u16::try_from(scaled).unwrap_or(u16::MAX)
}

/// Writes all registers of a block, or none [EMD-2A2Q §2.4].
fn write_registers(
    state: &mut DeviceState,
    now: Instant,
    block: &WordBlock<'_>,
) -> Result<Answer, Exception> {
    run_in(0, REGISTERS, block.start(), block.values().len())?;
    let mut eeprom = state.eeprom;
    let mut command = 0;
    for (at, value) in block.words() {
        let code = u8::try_from(value).map_err(|_| Exception::VALUE);
        match at {
            ADDRESS => eeprom.address = modbus::address(&PROFILE, value)?,
            BAUD => eeprom.serial.baud = PROFILE.baud_of(code?).ok_or(Exception::VALUE)?,
            CHARACTER => {
                eeprom.serial.character = PROFILE.character_of(code?).ok_or(Exception::VALUE)?;
            }
            VOLTAGE if (1..=2000).contains(&value) => eeprom.calibration.voltage = value,
            VOLTAGE => return Err(Exception::VALUE),
            COMMAND => command = value,
            _ => return Err(Exception::ADDRESS),
        }
    }
    start(state, now, command, eeprom);
    Ok(Answer::Done)
}

/// Stores the settings and starts what the command register asks for: restore before zero before
/// span, and only the first [EMD-2A2Q §5.6].
fn start(state: &mut DeviceState, now: Instant, command: u16, eeprom: Eeprom) {
    if command & RESTORE != 0 {
        // A calibration in progress would undo its part of the restore [EMD-2A2Q §5.8].
        state.calibrating = None;
        *state.keep() = Eeprom {
            address: Address(1),
            serial: SerialSettings::FACTORY,
            calibration: AnalogCalibration::NEUTRAL,
            ..eeprom
        };
        return;
    }
    if eeprom != state.eeprom {
        *state.keep() = eeprom;
    }
    let bit = if command & ZERO != 0 {
        ZERO
    } else {
        command & SPAN
    };
    if bit != 0 {
        state.calibrating = Some((bit, now + CALIBRATION_TIME));
    }
}

/// Ends a calibration whose time is over.
pub(crate) fn run_calibration(state: &mut DeviceState, now: Instant) {
    let Some((bit, _)) = state.calibrating.take_if(|(_, at)| *at <= now) else {
        return;
    };
    let mut calibration = state.eeprom.calibration;
    if bit == ZERO {
        calibration.zero = state.analogs;
    } else {
        for ((span, measured), zero) in calibration
            .span
            .iter_mut()
            .zip(state.analogs)
            .zip(calibration.zero)
        {
            let above_zero = measured.saturating_sub(zero);
            *span = (
                u16::try_from(above_zero).unwrap_or(1).max(1),
                calibration.voltage,
            );
        }
    }
    state.keep().calibration = calibration;
}
