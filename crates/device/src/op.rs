//! Operations on a module and what they return, in channel terms.

use railbus_wire::{Address, Baud, Channel, Character, PulseWidth, ascii::Text, r55::U24, rtu};

/// Channels and their states. Bit n is channel n.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Bank {
    /// The channels.
    pub mask: u32,
    /// Their states; bits outside the mask are 0.
    pub on: u32,
}

impl Bank {
    /// These channels with these states.
    #[must_use]
    pub const fn new(mask: u32, on: u32) -> Bank {
        Bank {
            mask,
            on: on & mask,
        }
    }

    /// One channel.
    #[must_use]
    pub const fn one(channel: Channel, on: bool) -> Bank {
        Bank {
            mask: channel.mask(),
            on: if on { channel.mask() } else { 0 },
        }
    }

    /// The state of one channel, if it is known.
    #[must_use]
    pub const fn get(self, channel: Channel) -> Option<bool> {
        if self.mask & channel.mask() == 0 {
            None
        } else {
            Some(self.on & channel.mask() != 0)
        }
    }
}

/// An operation on a module. One op is exactly one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Op {
    /// Read outputs, and inputs if one frame holds both.
    ReadOutputs,
    /// Read digital inputs, and outputs if one frame holds both.
    ReadInputs,
    /// Read the analog inputs.
    ReadAnalogs,
    /// Read an internal variable.
    ReadVariable(u8),
    /// Read which outputs give pulses, and their width.
    ReadPulse,
    /// Read the name or version with which the module identifies itself.
    Identify,
    /// Read address, speed, parity, checksum.
    ReadConfig,
    /// A harmless request whose reply can't be taken for the reply to any other read or write of
    /// the module: once it is answered, every earlier request is answered or lost. Only for modules
    /// whose polls do not already contain two such reads.
    Fence,
    /// Switch these outputs, and leave the others alone.
    Write(Bank),
    /// The same in a form that gets no reply.
    WriteSilent(Bank),
    /// Toggle the outputs of the mask.
    Toggle(u32),
    /// Switch on (`close`) or off now, and back after a time in milliseconds.
    Jog {
        /// Which output.
        channel: Channel,
        /// On first and off later, or the reverse.
        close: bool,
        /// The time until it switches back, in milliseconds.
        millis: U24,
    },
    /// Write an internal variable.
    WriteVariable(u8, U24),
    /// Change a stored setting.
    Configure(SettingWrite),
}

/// A change to the settings in a module's EEPROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SettingWrite {
    /// Address, speed and checksum together, as EDA modules take them.
    Serial {
        /// The new address.
        address: Address,
        /// The new speed.
        baud: Baud,
        /// Whether ASCII frames carry a checksum.
        checksum: bool,
    },
    /// The address alone.
    Address(Address),
    /// The speed alone.
    Baud(Baud),
    /// The character format alone.
    Character(Character),
    /// Which outputs give pulses, and their width.
    Pulse {
        /// Bit n = output n gives pulses.
        mask: u8,
        /// The width of all pulses.
        width: PulseWidth,
    },
    /// The calibration voltage in hundredths of a volt.
    CalibrationVoltage(u16),
    /// Calibrate zero with the present inputs.
    CalibrateZero,
    /// Calibrate the calibration voltage with the present inputs.
    CalibrateSpan,
    /// Restore the factory settings.
    Restore,
}

/// The decoded reply to an op.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Observation {
    /// The states of outputs and inputs. A bank with an empty mask says nothing.
    Channels {
        /// Outputs read back.
        outputs: Bank,
        /// Inputs; on is high or open.
        inputs: Bank,
    },
    /// The analog inputs in hundredths of their unit.
    Analogs([u16; 2]),
    /// An internal variable.
    Variable(u8, U24),
    /// Which outputs give pulses, and their width.
    Pulse {
        /// Bit n = output n gives pulses.
        mask: u8,
        /// The width of all pulses.
        width: PulseWidth,
    },
    /// A name.
    Name(Text),
    /// A model number, as two BCD or binary bytes.
    Model(u16),
    /// A product version.
    Version(u16),
    /// Stored settings; none where the reply does not say.
    Config {
        /// The address the module reports.
        address: Option<Address>,
        /// The speed.
        baud: Option<Baud>,
        /// The character format.
        character: Option<Character>,
        /// ASCII frames carry a checksum.
        checksum: Option<bool>,
    },
    /// The write was acknowledged, which says nothing about the outputs' states.
    Done,
    /// The module refused.
    Refused(Refusal),
    /// A well-formed reply that can't be the answer to this op.
    Unexpected,
}

/// How a module refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// A Modbus exception.
    Exception(rtu::Exception),
    /// `?AA` of an ADAM or DCON module.
    Invalid,
    /// `!` of a module whose host watchdog has tripped.
    WatchdogTripped,
}

/// The module has no single frame for this op.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unsupported;

impl core::fmt::Display for Unsupported {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("this model has no command for that")
    }
}

impl core::error::Error for Unsupported {}

impl Op {
    /// Whether this only reads.
    #[must_use]
    pub const fn is_read(&self) -> bool {
        matches!(
            self,
            Op::ReadOutputs
                | Op::ReadInputs
                | Op::ReadAnalogs
                | Op::ReadVariable(_)
                | Op::ReadPulse
                | Op::Identify
                | Op::ReadConfig
                | Op::Fence
        )
    }
}
