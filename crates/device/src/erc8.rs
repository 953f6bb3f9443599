//! ERC-8: eight relays on Modbus RTU.
//!
//! Coils 60 to 67 (decimal) are the relays; three holding registers hold address, speed and parity.
//! The manual lists functions 01, 05 and 0F, and 06 for writing registers [ERC-8 §2, §3].

use crate::datasheet::{
    Access, Datasheet, Factory, Holds, Key, PerProtocol, PulseTiming, Recognition, Register,
    ScanEvidence, Separation, StoredSetting, note, same,
};
use crate::engine::{DeviceState, Eeprom};
use crate::modbus::{self, Answer, respond, run_in};
use crate::sign::{ReadOutcome, Sign};
use crate::{Bank, Observation, Op, Profile, SettingWrite, Setup};
use railbus_wire::rtu::{self, BitSpan, Exception, Function, Request, WordSpan};
use railbus_wire::{
    Address, Baud, Character, Exchange, Frame, Micros, Protocol, Response, SerialSettings,
};

/// The datasheet as data.
pub(crate) static PROFILE: Profile = Profile {
    name: "erc8",
    model: "ERC-8",
    outputs: 8,
    inputs: 0,
    analogs: 0,
    protocols: &[Protocol::Rtu],
    bauds: &[
        (0, Baud::B4800),
        (1, Baud::B9600),
        (2, Baud::B19200),
        (3, Baud::B38400),
    ],
    characters: &[(0, Character::N1), (1, Character::O1), (2, Character::E1)],
    addresses: (1, 32),
    gap: Some(Micros::from_millis(20)),
    output_label: ("k", 1),
    input_label: ("d", 1),
};

/// What only a host asks. Ratings are in the table at the end of the sheet, which numbers no
/// terminals.
pub(crate) static DATASHEET: Datasheet = Datasheet {
    title: same("ERC-8"),
    names: &[],
    numbers: &[],
    signs: &SIGNS,
    recognition: PerProtocol::same(Recognition::ByBehaviour),
    // [ERC-8 §2.4]
    refuses: true,
    evidence: ScanEvidence::Coils,
    channels_vary: false,
    broadcast: None,
    // [ERC-8 §1.2, §1.3]
    factory: Factory {
        address: Address(1),
        serial: SerialSettings::FACTORY,
        voltage: None,
    },
    serial_as_one: false,
    settings: &[
        StoredSetting::new(Key::Address, Access::Written),
        StoredSetting::new(Key::Baud, Access::Written),
        StoredSetting::new(Key::Parity, Access::Written),
    ],
    separation: PerProtocol::same(Separation::Plug),
    pulses: PulseTiming::Host,
    dip_switch: false,
    init_pin: false,
    registers: &[
        Register::new(Holds::Address, ["address", "地址"], "[ERC-8 §4.1]"),
        Register::new(Holds::Baud, ["speed code", "波特率代码"], "[ERC-8 §4.2]"),
        Register::new(Holds::Parity, ["parity code", "校验位代码"], "[ERC-8 §4.3]"),
    ],
    terminals: &[],
    notes: &[
        [
            "Supply 85 to 265 VAC or 110 to 360 VDC",
            "电源 85–265 VAC 或 110–360 VDC",
        ],
        note::CONTACTS,
        note::BUS,
        // [ERC-8 §1.8]
        note::POWER_UP,
        [
            "No timer of its own: pulses are timed by the daemon",
            "模块无计时器：点动由守护进程计时",
        ],
    ],
};

/// The coil of relay 1, decimal 60 as the manual's example shows.
const FIRST_COIL: u16 = 60;
const RELAYS: u16 = 8;

/// The holding registers: address, speed code, parity code.
const ADDRESS: u16 = 0;
const BAUD: u16 = 1;
const CHARACTER: u16 = 2;
const REGISTERS: u16 = 3;

/// Functions that the codec knows and the module lacks [ERC-8 §2.4].
pub(crate) const ABSENT: &[Function] = &[
    Function::ReadDiscreteInputs,
    Function::ReadInputRegisters,
    Function::WriteRegisters,
];

/// What identifies it: relays at 60 to 67 and nowhere else, no inputs [ERC-8 §2.4, §3.1, §3.3].
const SIGNS: [Option<Sign>; 4] = [
    Sign::coils(0, 8, ReadOutcome::Refusal(Exception::ADDRESS)),
    Sign::coils(FIRST_COIL, RELAYS, ReadOutcome::Answer),
    Sign::coils(
        FIRST_COIL,
        RELAYS + 1,
        ReadOutcome::Refusal(Exception::ADDRESS),
    ),
    Sign::inputs(0, 1, ReadOutcome::Refusal(Exception::FUNCTION)),
];

/// Host side: the single exchange for an op.
pub(crate) fn exchange(setup: &Setup, op: &Op) -> Option<Exchange<'static>> {
    let register = |at, value| Some(Request::WriteRegister { at, value });
    let request = match *op {
        Op::ReadOutputs => Some(Request::ReadCoils(BitSpan::new(FIRST_COIL, RELAYS)?)),
        Op::ReadConfig | Op::Fence => Some(Request::ReadHoldingRegisters(WordSpan::new(
            ADDRESS, REGISTERS,
        )?)),
        Op::Write(bank) => return modbus::write_run(setup, FIRST_COIL, bank),
        Op::Configure(SettingWrite::Address(new)) => register(ADDRESS, u16::from(new.0)),
        Op::Configure(SettingWrite::Baud(baud)) => register(BAUD, PROFILE.baud_code(baud)?.into()),
        Op::Configure(SettingWrite::Character(character)) => {
            register(CHARACTER, PROFILE.character_code(character)?.into())
        }
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
        (Op::ReadConfig, rtu::Response::Words(words)) => {
            let code = |at| u8::try_from(words.get(at)?).ok();
            Observation::Config {
                address: code(ADDRESS).map(Address),
                baud: code(BAUD).and_then(|code| PROFILE.baud_of(code)),
                character: code(CHARACTER).and_then(|code| PROFILE.character_of(code)),
                checksum: None,
            }
        }
        (_, rtu::Response::Done) => Observation::Done,
        _ => return None,
    })
}

/// Device side: executes a request and writes the reply. Address 0 is only for changing the address
/// [ERC-8 §4.10, §4.11].
pub(crate) fn answer(state: &mut DeviceState, exchange: &rtu::Exchange<'_>, reply: &mut Frame) {
    let broadcast = exchange.address == rtu::BROADCAST;
    let readdresses = matches!(exchange.request, Request::WriteRegister { at: ADDRESS, .. });
    if !state.hears(exchange.address) || broadcast && !readdresses {
        return;
    }
    let from = state.address();
    let outcome = carry_out(state, exchange.request);
    respond(exchange, from, outcome, reply);
}

fn carry_out(state: &mut DeviceState, request: Request<'_>) -> Result<Answer, Exception> {
    match request {
        Request::ReadCoils(_) | Request::WriteCoil { .. } | Request::WriteCoils(_) => {
            modbus::coils(state, FIRST_COIL, request)
        }
        Request::ReadHoldingRegisters(span) => {
            run_in(ADDRESS, REGISTERS, span.start(), span.count())?;
            Ok(Answer::span(&registers(state), span))
        }
        Request::WriteRegister { at, value } => {
            let eeprom = configured(state.eeprom, at, value)?;
            *state.keep() = eeprom;
            Ok(Answer::Done)
        }
        Request::ReadDiscreteInputs(_)
        | Request::ReadInputRegisters(_)
        | Request::WriteRegisters(_)
        | Request::Diagnose { .. }
        | Request::Identify { .. } => Err(Exception::FUNCTION),
    }
}

fn registers(state: &DeviceState) -> [u16; 3] {
    let Eeprom {
        address, serial, ..
    } = state.eeprom;
    let code = |code: Option<u8>| u16::from(code.unwrap_or_default());
    [
        u16::from(address.0),
        code(PROFILE.baud_code(serial.baud)),
        code(PROFILE.character_code(serial.character)),
    ]
}

/// The settings with one register written.
fn configured(mut eeprom: Eeprom, at: u16, value: u16) -> Result<Eeprom, Exception> {
    let code = u8::try_from(value).map_err(|_| Exception::VALUE);
    match at {
        ADDRESS => eeprom.address = modbus::address(&PROFILE, value)?,
        BAUD => eeprom.serial.baud = PROFILE.baud_of(code?).ok_or(Exception::VALUE)?,
        CHARACTER => {
            eeprom.serial.character = PROFILE.character_of(code?).ok_or(Exception::VALUE)?;
        }
        _ => return Err(Exception::ADDRESS),
    }
    Ok(eeprom)
}
