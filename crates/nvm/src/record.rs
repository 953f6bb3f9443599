//! The stored record and its encoding.
//!
//! Numbers are little-endian. The first byte is the version of the layout; this is version 1:
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 1 | version: 1 |
//! | | | **how the module is built** |
//! | 1 | 1 | family: 1 EDA9060A, 2 EDA9050, 3 ERC-8, 4 0x55 board, 5 EMD-2A2Q |
//! | 2 | 1 | outputs |
//! | 3 | 1 | digital inputs |
//! | 4 | 1 | internal variables |
//! | 5 | 1 | layout of a 0x55 board: 0 outputs, 1 inputs, 2 mixed |
//! | 6 | 1 | bit 0: on and off are swapped; bit 1: the silence that follows counts |
//! | 7 | 4 | silence before a request, microseconds |
//! | | | **what the datasheets leave open** ([`Options`]) |
//! | 11 | 1 | bit 0: refuses aloud; 1: lower case; 2: bad frames; 3: the gap; 4: beyond |
//! | 12 | 1 | changes apply: 0 after the reply, 1 after a restart, 2 the address after the reply |
//! | 13 | 4 | turnaround, microseconds |
//! | | | **its settings** ([`Eeprom`]) |
//! | 17 | 1 | address |
//! | 18 | 1 | protocol: 1 Modbus RTU, 2 ASCII, 3 LC-02, 4 that of the 0x55 boards |
//! | 19 | 4 | speed, bits per second |
//! | 23 | 1 | characters: 0 8N1, 1 8E1, 2 8O1, 3 8N2 |
//! | 24 | 1 | ASCII frames carry a checksum: 0 no, 1 yes |
//! | 25 | 1 | outputs that give pulses: bit n = output n |
//! | 26 | 1 | pulse width, tenths of a second |
//! | 27 | 2 | calibration voltage, hundredths of a volt |
//! | 29 | 2 + 2 | measured at the zero step, hundredths, signed: input 1, input 2 |
//! | 33 | 2 + 2 | span step of input 1, hundredths: measured, applied |
//! | 37 | 2 + 2 | span step of input 2, likewise |
//! | | | **beyond the datasheet** ([`Extensions`]) |
//! | 41 | 1 | host watchdog, tenths of a second; 0 does not watch |
//! | 42 | 4 | outputs at power-up: bit n = output n is on |
//! | 46 | 4 | outputs when the watchdog trips |
//! | 50 | 1 | it has tripped: 0 no, 1 yes |
//!
//! A version never changes once a firmware with it was released. Later layouts have a higher
//! version, and may be longer, up to 119 bytes. A firmware reads every version up to its own, and
//! refuses a higher one ([`Unreadable::Newer`]).

use crate::bytes::{Reader, Writer};
use core::fmt;
use railbus_device::{AnalogCalibration, Applies, Eeprom, Extensions, Family, Layout, Options};
use railbus_device::{Setup, SetupError};
use railbus_wire::{Address, Baud, Character, Micros, Protocol, PulseWidth, SerialSettings};

/// The version of the layout written.
const VERSION: u8 = 1;

const PROTOCOLS: [Protocol; 4] = [
    Protocol::Rtu,
    Protocol::Ascii,
    Protocol::Lc02,
    Protocol::R55,
];
const LAYOUTS: [Layout; 3] = [Layout::Outputs, Layout::Inputs, Layout::Mixed];
const APPLIES: [Applies; 3] = [
    Applies::AfterReply,
    Applies::AfterRestart,
    Applies::AddressAfterReply,
];

/// A module as stored. It is always a possible module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    setup: Setup,
    options: Options,
    eeprom: Eeprom,
}

/// Why a module can't be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordError {
    /// The setup is not possible.
    Setup(SetupError),
    /// The silence before a request, or the turnaround, is above 4,294 s, the maximum.
    Long,
}

impl fmt::Display for RecordError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RecordError::Setup(error) => error.fmt(f),
            RecordError::Long => f.write_str("gap and turnaround must be at most 4294 s"),
        }
    }
}

impl core::error::Error for RecordError {}

impl From<SetupError> for RecordError {
    fn from(error: SetupError) -> RecordError {
        RecordError::Setup(error)
    }
}

/// Why bytes are not a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unreadable {
    /// Written by a newer firmware, in this version.
    Newer(u8),
    /// A module of a family whose device side is not built here.
    OtherFamily,
    /// Not written by any version.
    Malformed,
}

impl Record {
    /// The length of a record in bytes.
    pub const LEN: usize = 51;

    /// A module with this setup, these options and these settings. Where two of them define the
    /// same thing (the address, the protocol, speed and characters, the checksum), the settings
    /// count.
    ///
    /// # Errors
    /// If there is no such module.
    pub fn new(setup: &Setup, options: Options, eeprom: Eeprom) -> Result<Record, RecordError> {
        let setup = Setup {
            address: eeprom.address,
            protocol: eeprom.protocol,
            serial: eeprom.serial,
            // An EDA9050 whose pin has selected ASCII has a checksum as well as LC-02.
            checksum: eeprom.checksum && eeprom.protocol == Protocol::Ascii,
            ..*setup
        };
        setup.check_built()?;
        let times = [setup.gap.unwrap_or_default(), options.turnaround];
        if times.iter().any(|time| u32::try_from(time.0).is_err()) {
            return Err(RecordError::Long);
        }
        Ok(Record {
            setup,
            options,
            eeprom,
        })
    }

    /// A module with this setup, and everything else in its factory state.
    ///
    /// # Errors
    /// If there is no such module.
    pub fn factory(setup: &Setup) -> Result<Record, RecordError> {
        setup.check_built()?;
        Record::new(setup, Options::default(), Eeprom::of(setup))
    }

    /// The same module with other settings.
    ///
    /// # Errors
    /// If there is no such module.
    pub fn with(&self, eeprom: Eeprom) -> Result<Record, RecordError> {
        Record::new(&self.setup, self.options, eeprom)
    }

    /// The setup, with its settings.
    #[must_use]
    pub const fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The options.
    #[must_use]
    pub const fn options(&self) -> Options {
        self.options
    }

    /// Its settings.
    #[must_use]
    pub const fn eeprom(&self) -> Eeprom {
        self.eeprom
    }

    /// The record as bytes.
    #[must_use]
    pub fn encode(&self) -> [u8; Record::LEN] {
        let (setup, options, eeprom) = (&self.setup, &self.options, &self.eeprom);
        let mut bytes = [0; Record::LEN];
        let mut room = Writer(&mut bytes);
        room.put([VERSION]);
        encode_setup(setup, &mut room);
        encode_options(options, &mut room);
        encode_eeprom(eeprom, &mut room);
        bytes
    }

    /// Decodes a record.
    ///
    /// # Errors
    /// If a newer firmware wrote the bytes, if they are another family's, or if they are not a
    /// record.
    pub fn decode(bytes: &[u8]) -> Result<Record, Unreadable> {
        match bytes.split_first() {
            Some((&VERSION, _)) => decode_1(bytes.try_into().map_err(|_| Unreadable::Malformed)?),
            Some((&newer, _)) if Record::is_newer(bytes) => Err(Unreadable::Newer(newer)),
            _ => Err(Unreadable::Malformed),
        }
    }

    /// Whether a newer firmware wrote these bytes.
    pub(crate) fn is_newer(bytes: &[u8]) -> bool {
        bytes.first().is_some_and(|version| *version > VERSION)
    }
}

/// Decodes version 1.
fn decode_1(bytes: &[u8; Record::LEN]) -> Result<Record, Unreadable> {
    let mut from = Reader(bytes);
    from.u8();
    let setup = decode_setup(&mut from).ok_or(Unreadable::Malformed)?;
    let options = decode_options(&mut from).ok_or(Unreadable::Malformed)?;
    let eeprom = decode_eeprom(&mut from).ok_or(Unreadable::Malformed)?;
    Record::new(&setup, options, eeprom).map_err(|error| match error {
        RecordError::Setup(SetupError::Family) => Unreadable::OtherFamily,
        _ => Unreadable::Malformed,
    })
}

fn encode_setup(setup: &Setup, bytes: &mut Writer<'_>) {
    let Setup {
        family,
        outputs,
        inputs,
        variables,
        layout,
        invert_on_off,
        gap,
        // These are in the settings.
        address: _,
        protocol: _,
        serial: _,
        checksum: _,
    } = *setup;
    bytes.put([
        family.code(),
        outputs,
        inputs,
        variables,
        layout_code(layout),
        switches(&[invert_on_off, gap.is_some()]),
    ]);
    encode_time(gap.unwrap_or_default(), bytes);
}

fn decode_setup(from: &mut Reader<'_>) -> Option<Setup> {
    let [family, outputs, inputs, variables, layout, bits] = from.take();
    let [invert_on_off, has_gap] = switches_of(bits)?;
    let gap = decode_time(from);
    Some(Setup {
        family: find(Family::ALL, Family::code, family)?,
        outputs,
        inputs,
        variables,
        layout: find(LAYOUTS, layout_code, layout)?,
        invert_on_off,
        gap: has_gap.then_some(gap),
        // These come from the settings.
        address: Address(0),
        protocol: Protocol::Rtu,
        serial: SerialSettings::FACTORY,
        checksum: false,
    })
}

fn encode_options(options: &Options, bytes: &mut Writer<'_>) {
    let Options {
        turnaround,
        applies,
        refuse_aloud,
        lower_case,
        answer_bad_frames,
        insist_on_gap,
        extensions,
    } = *options;
    let bits = switches(&[
        refuse_aloud,
        lower_case,
        answer_bad_frames,
        insist_on_gap,
        extensions,
    ]);
    bytes.put([bits, applies_code(applies)]);
    encode_time(turnaround, bytes);
}

fn decode_options(from: &mut Reader<'_>) -> Option<Options> {
    let [bits, applies] = from.take();
    let [
        refuse_aloud,
        lower_case,
        answer_bad_frames,
        insist_on_gap,
        extensions,
    ] = switches_of(bits)?;
    Some(Options {
        turnaround: decode_time(from),
        applies: find(APPLIES, applies_code, applies)?,
        refuse_aloud,
        lower_case,
        answer_bad_frames,
        insist_on_gap,
        extensions,
    })
}

/// The settings, with those of the extensions.
fn encode_eeprom(eeprom: &Eeprom, bytes: &mut Writer<'_>) {
    let Eeprom {
        address,
        serial,
        protocol,
        checksum,
        pulse_mask,
        pulse_width,
        calibration,
        extensions,
    } = eeprom;
    bytes.put([address.0, protocol_code(*protocol)]);
    bytes.put(serial.baud.rate().to_le_bytes());
    bytes.put([
        character_code(serial.character),
        u8::from(*checksum),
        *pulse_mask,
        pulse_width.tenths(),
    ]);
    encode_calibration(calibration, bytes);
    encode_extensions(extensions, bytes);
}

fn decode_eeprom(from: &mut Reader<'_>) -> Option<Eeprom> {
    let [address, protocol] = from.take();
    let baud = Baud::from_rate(from.u32())?;
    let [character, checksum, pulse_mask, pulse_width] = from.take();
    let [checksum] = switches_of(checksum)?;
    Some(Eeprom {
        address: Address(address),
        serial: SerialSettings {
            baud,
            character: find(Character::ALL, character_code, character)?,
        },
        protocol: find(PROTOCOLS, protocol_code, protocol)?,
        checksum,
        pulse_mask,
        pulse_width: PulseWidth::from_tenths(pulse_width)?,
        calibration: decode_calibration(from),
        extensions: decode_extensions(from)?,
    })
}

fn encode_extensions(extensions: &Extensions, bytes: &mut Writer<'_>) {
    let Extensions {
        watchdog,
        power_on,
        safe,
        tripped,
    } = *extensions;
    bytes.put([watchdog]);
    bytes.put(power_on.to_le_bytes());
    bytes.put(safe.to_le_bytes());
    bytes.put([u8::from(tripped)]);
}

fn decode_extensions(from: &mut Reader<'_>) -> Option<Extensions> {
    let (watchdog, power_on, safe) = (from.u8(), from.u32(), from.u32());
    let [tripped] = switches_of(from.u8())?;
    Some(Extensions {
        watchdog,
        power_on,
        safe,
        tripped,
    })
}

fn encode_calibration(calibration: &AnalogCalibration, bytes: &mut Writer<'_>) {
    let AnalogCalibration {
        voltage,
        zero,
        span,
    } = calibration;
    bytes.put(voltage.to_le_bytes());
    for zero in zero {
        bytes.put(zero.to_le_bytes());
    }
    for (measured, applied) in span {
        bytes.put(measured.to_le_bytes());
        bytes.put(applied.to_le_bytes());
    }
}

fn decode_calibration(from: &mut Reader<'_>) -> AnalogCalibration {
    AnalogCalibration {
        voltage: from.u16(),
        zero: [from.i16(), from.i16()],
        span: [(from.u16(), from.u16()), (from.u16(), from.u16())],
    }
}

/// Encodes a time that [`Record::new`] has checked.
fn encode_time(time: Micros, bytes: &mut Writer<'_>) {
    bytes.put((time.0 as u32).to_le_bytes());
}

fn decode_time(from: &mut Reader<'_>) -> Micros {
    Micros(from.u32().into())
}

/// Bit n = the n-th is true.
fn switches(switches: &[bool]) -> u8 {
    let bits = switches.iter().rev();
    bits.fold(0, |bits, on| bits << 1 | u8::from(*on))
}

/// The lowest `N` bits; none if a higher one is set.
fn switches_of<const N: usize>(bits: u8) -> Option<[bool; N]> {
    let known = bits.checked_shr(N as u32).unwrap_or(0) == 0;
    known.then(|| core::array::from_fn(|at| bits >> at & 1 == 1))
}

/// The value with this code.
fn find<T: Copy, const N: usize>(all: [T; N], code_of: fn(T) -> u8, code: u8) -> Option<T> {
    all.into_iter().find(|one| code_of(*one) == code)
}

const fn layout_code(layout: Layout) -> u8 {
    match layout {
        Layout::Outputs => 0,
        Layout::Inputs => 1,
        Layout::Mixed => 2,
    }
}

const fn protocol_code(protocol: Protocol) -> u8 {
    match protocol {
        Protocol::Rtu => 1,
        Protocol::Ascii => 2,
        Protocol::Lc02 => 3,
        Protocol::R55 => 4,
    }
}

const fn character_code(character: Character) -> u8 {
    match character {
        Character::N1 => 0,
        Character::E1 => 1,
        Character::O1 => 2,
        Character::N2 => 3,
    }
}

const fn applies_code(applies: Applies) -> u8 {
    match applies {
        Applies::AfterReply => 0,
        Applies::AfterRestart => 1,
        Applies::AddressAfterReply => 2,
    }
}
