//! The part of a datasheet that only a host asks for: what a module stores and who can change it,
//! how it is recognised, what its registers mean, what is at its terminals.
//!
//! It is kept apart from the [`Profile`](crate::Profile), which both ends of the line read: no
//! module's own half refers to it, so it is in no firmware.

use crate::{Family, Setup, Sign};
use core::fmt;
use railbus_wire::{Address, Protocol, SerialSettings};

/// A text for people, in English and in Chinese.
pub type Bilingual = [&'static str; 2];

/// What only a host asks about a family.
#[derive(Debug)]
pub struct Datasheet {
    /// What people call the model; if the sheet names none, what it is.
    pub title: Bilingual,
    /// The complete names that its modules report, with or without the letter. Many DCON modules
    /// have names that begin the same.
    pub names: &'static [&'static [u8]],
    /// The model numbers that its modules report, in BCD and in binary.
    pub numbers: &'static [u16],
    /// How it behaves over Modbus if it reports no name; empty if it does.
    pub signs: &'static [Option<Sign>],
    /// How a host makes sure that a module of the family is at its place.
    pub recognition: PerProtocol<Recognition>,
    /// Over Modbus it refuses what it does not support; otherwise it stays silent.
    pub refuses: bool,
    /// What a scan can say of a module apart from its model.
    pub evidence: ScanEvidence,
    /// The number of channels varies, and no reply reports it: it is configured.
    pub channels_vary: bool,
    /// The address, among its range, that all modules obey, so that none can have it.
    pub broadcast: Option<Address>,
    /// The settings of a new module, and of one that was reset.
    pub factory: Factory,
    /// One frame sets address, speed and checksum together; otherwise each has its own.
    pub serial_as_one: bool,
    /// What it stores, in the order in which it is shown.
    pub settings: &'static [StoredSetting],
    /// How two modules with the same address are separated.
    pub separation: PerProtocol<Separation>,
    /// Who times the pulses of its outputs.
    pub pulses: PulseTiming,
    /// It has a DIP switch for its address.
    pub dip_switch: bool,
    /// It has an INIT* pin for its protocol.
    pub init_pin: bool,
    /// The holding registers that it has over Modbus, from 0.
    pub registers: &'static [Register],
    /// Its terminals; empty if the sheet does not number them.
    pub terminals: &'static [Terminal],
    /// Ratings, and what surprises.
    pub notes: &'static [Bilingual],
}

impl Datasheet {
    /// The setting with that key, if the family has it.
    #[must_use]
    pub fn setting(&self, key: Key) -> Option<&'static StoredSetting> {
        self.settings.iter().find(|setting| setting.key == key)
    }

    /// Whether it accepts a new address only soon after it was switched on.
    #[must_use]
    pub fn needs_power_cycle(&self) -> bool {
        self.setting(Key::Address)
            .is_some_and(|setting| setting.access.usual == Access::AtPowerUp)
    }

    /// Whether its analog inputs can be calibrated.
    #[must_use]
    pub fn is_calibrated(&self) -> bool {
        self.setting(Key::CalibrationVoltage).is_some()
    }

    /// The number of the register that holds this, if there is one.
    #[must_use]
    pub fn register(&self, holds: Holds) -> Option<u16> {
        (0..)
            .zip(self.registers)
            .find(|(_, register)| register.holds == holds)
            .map(|(number, _)| number)
    }

    /// Whether its modules say over Modbus what they are.
    #[must_use]
    pub fn says_model_in_registers(&self) -> bool {
        self.register(Holds::Model).is_some()
    }
}

/// A value that may be another in one of the protocols.
#[derive(Clone, Copy, Debug)]
pub struct PerProtocol<T> {
    usual: T,
    except: Option<(Protocol, T)>,
}

impl<T: Copy> PerProtocol<T> {
    /// The same in all of them.
    pub(crate) const fn same(usual: T) -> PerProtocol<T> {
        PerProtocol {
            usual,
            except: None,
        }
    }

    /// The same in all but one.
    pub(crate) const fn except(usual: T, protocol: Protocol, other: T) -> PerProtocol<T> {
        PerProtocol {
            usual,
            except: Some((protocol, other)),
        }
    }

    /// The value in this protocol.
    #[must_use]
    pub fn of(&self, protocol: Protocol) -> T {
        match self.except {
            Some((except, other)) if except == protocol => other,
            _ => self.usual,
        }
    }
}

/// How a host makes sure that a module of the family is at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recognition {
    /// It reports its name or number.
    ByName,
    /// It has all the registers of the family, and then all its [signs](Datasheet::signs).
    ByRegisters,
    /// It reports its outputs, and then shows all its [signs](Datasheet::signs).
    ByBehaviour,
}

/// What a scan can say of a module apart from its model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScanEvidence {
    /// How many channels it has, which follows from its model.
    Channels,
    /// That it has coils where only its family has them.
    Coils,
    /// The version in its first register.
    Version,
    /// The highest channel that is on: it may have more.
    HighestOn,
}

/// How two modules with the same address are separated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separation {
    /// One is switched on alone, and takes a new address then.
    PowerUp,
    /// The INIT* pin of one of them chooses another protocol.
    InitPin,
    /// One is unplugged from the line.
    Plug,
}

/// Who times the pulses of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PulseTiming {
    /// The host.
    Host,
    /// The module: it stores which outputs give pulses, and one width for all of them.
    Stored,
    /// The module: each command says how long.
    Command,
}

impl PulseTiming {
    /// The name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            PulseTiming::Host => "host",
            PulseTiming::Stored => "stored",
            PulseTiming::Command => "command",
        }
    }
}

/// The settings of a new module.
#[derive(Clone, Copy, Debug)]
pub struct Factory {
    /// The address.
    pub address: Address,
    /// Speed and character format.
    pub serial: SerialSettings,
    /// The calibration voltage, in hundredths, if it has one.
    pub voltage: Option<u16>,
}

/// A setting, and who can change it.
#[derive(Clone, Copy, Debug)]
pub struct StoredSetting {
    /// Which one.
    pub key: Key,
    /// Who can change it.
    pub access: PerProtocol<Access>,
}

impl StoredSetting {
    /// The same access in every protocol.
    pub(crate) const fn new(key: Key, access: Access) -> StoredSetting {
        StoredSetting {
            key,
            access: PerProtocol::same(access),
        }
    }
}

/// One setting of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Key {
    /// The address.
    Address,
    /// The speed.
    Baud,
    /// Parity.
    Parity,
    /// ASCII frames carry a checksum.
    Checksum,
    /// The protocol.
    Protocol,
    /// Whether an output follows its commands or gives pulses.
    Mode(u8),
    /// The width of all pulses.
    PulseWidth,
    /// The voltage applied for the span step.
    CalibrationVoltage,
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Key::Address => f.write_str("address"),
            Key::Baud => f.write_str("baud"),
            Key::Parity => f.write_str("parity"),
            Key::Checksum => f.write_str("checksum"),
            Key::Protocol => f.write_str("protocol"),
            // Only EDA modules have modes, and their labels count from 0.
            Key::Mode(channel) => write!(f, "do{channel}.mode"),
            Key::PulseWidth => f.write_str("pulse_width"),
            Key::CalibrationVoltage => f.write_str("calibration_voltage"),
        }
    }
}

/// Whether a command changes a setting, and what prevents it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// A command does; effective after the reply [EDA §1.7, ERC-8 §4.4, EMD-2A2Q §4.10].
    Written,
    /// A command does, within 10 s of power-up and with the DIP switch at 0 [R55 §4.6, §4.8].
    AtPowerUp,
    /// The manufacturer's software does, by undocumented means [EDA9060A §2.2].
    MakersSoftware,
    /// The level at the INIT* pin does [EDA9050 §2.1, §2.2].
    InitPin,
    /// Only while the module speaks ASCII: its current protocol has no frame for it [EDA §3.9].
    InAscii,
    /// The family has only one value.
    Fixed,
}

impl Access {
    /// Whether a command can change it now.
    #[must_use]
    pub const fn is_writable(self) -> bool {
        matches!(self, Access::Written | Access::AtPowerUp)
    }

    /// The name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Access::Written => "written",
            Access::AtPowerUp => "at_power_up",
            Access::MakersSoftware => "makers_software",
            Access::InitPin => "init_pin",
            Access::InAscii => "in_ascii",
            Access::Fixed => "fixed",
        }
    }
}

/// A holding register.
#[derive(Clone, Copy, Debug)]
pub struct Register {
    /// What it holds.
    pub holds: Holds,
    /// The same for people.
    pub name: Bilingual,
    /// The fact that says so, as `[ERC-8 §4.1]`.
    pub fact: &'static str,
}

impl Register {
    pub(crate) const fn new(holds: Holds, name: Bilingual, fact: &'static str) -> Register {
        Register { holds, name, fact }
    }
}

/// What a register holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holds {
    /// The model number.
    Model,
    /// The version of the product.
    Version,
    /// The address in the high byte, the code of the speed in the low one.
    AddressAndBaud,
    /// Which outputs give pulses, and their width.
    Pulses,
    /// The protocol, and whether ASCII frames carry a checksum.
    Protocol,
    /// The address.
    Address,
    /// The code of the speed.
    Baud,
    /// The code of the parity.
    Parity,
    /// The calibration voltage, in hundredths.
    Voltage,
    /// The calibration in progress: 0 if there is none.
    Calibration,
    /// An analog input by its index, in hundredths.
    Analog(u8),
}

/// Terminals by the numbers on the housing, and what is there.
#[derive(Clone, Copy, Debug)]
pub struct Terminal {
    /// `5`, `11 12 13`.
    pub numbers: &'static str,
    /// What is there.
    pub what: Bilingual,
}

impl Terminal {
    pub(crate) const fn new(numbers: &'static str, what: Bilingual) -> Terminal {
        Terminal { numbers, what }
    }
}

/// A text that is the same in both languages.
pub(crate) const fn same(text: &'static str) -> Bilingual {
    [text, text]
}

/// The notes that several sheets share.
pub(crate) mod note {
    use super::Bilingual;

    pub(crate) const CONTACTS: Bilingual = [
        "Contacts: 5 A at 250 VAC or 30 VDC, resistive load; one normally open and one normally \
         closed each",
        "触点：5 A 250 VAC 或 30 VDC（阻性负载）；每路一常开、一常闭",
    ];
    pub(crate) const BUS: Bilingual = [
        "RS-485, up to 32 modules, 1200 m of twisted pair",
        "RS-485，最多 32 个模块，双绞线 1200 米",
    ];
    pub(crate) const POWER_UP: Bilingual =
        ["All relays release at power-up", "上电时所有继电器断开"];
}

impl Family {
    /// The family whose modules report this name.
    #[must_use]
    pub fn of_name(name: &[u8]) -> Option<Family> {
        let mut all = Family::ALL.into_iter();
        all.find(|family| family.datasheet().names.contains(&name))
    }

    /// The family whose modules have this model number.
    #[must_use]
    pub fn of_number(number: u16) -> Option<Family> {
        let mut all = Family::ALL.into_iter();
        all.find(|family| family.datasheet().numbers.contains(&number))
    }

    /// How a module of the family behaves over Modbus if it reports no name; empty for those that
    /// do.
    pub fn signs(self) -> impl Iterator<Item = Sign> {
        self.datasheet().signs.iter().copied().flatten()
    }
}

impl Setup {
    /// A module as new: with the address, speed and format of the factory.
    #[must_use]
    pub fn factory(family: Family) -> Setup {
        let factory = family.datasheet().factory;
        Setup {
            serial: factory.serial,
            ..Setup::new(family, factory.address)
        }
    }

    /// The holding registers of the module, from 0; empty if it does not speak Modbus.
    #[must_use]
    pub fn registers(&self) -> &'static [Register] {
        match self.protocol {
            Protocol::Rtu => self.family.datasheet().registers,
            Protocol::Ascii | Protocol::Lc02 | Protocol::R55 => &[],
        }
    }
}
