//! What one wants of a module, in channel terms, and what one learns from it.

use railbus_wire::{Address, Baud, Channel, Character, PulseWidth, ascii::Text, r55::U24, rtu};

/// Channels and their states. Bit n is channel n.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Bank {
    /// Which channels are meant.
    pub mask: u32,
    /// Their states; bits outside the mask are 0.
    pub on: u32,
}

impl Bank {
    /// The channels of the mask with these states.
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

    /// The state of one channel, where it is known.
    #[must_use]
    pub const fn get(self, channel: Channel) -> Option<bool> {
        if self.mask & channel.mask() == 0 {
            None
        } else {
            Some(self.on & channel.mask() != 0)
        }
    }
}

/// What one wants of a module. One op is exactly one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Op {
    /// Read outputs, and inputs where one frame holds both.
    ReadOutputs,
    /// Read digital inputs, and outputs where one frame holds both.
    ReadInputs,
    /// Read the analog inputs.
    ReadAnalogs,
    /// Read an internal variable.
    ReadVariable(u8),
    /// Read which outputs give pulses, and how long.
    ReadPulse,
    /// Read the name or version by which the module tells what it is.
    Identify,
    /// Read address, speed, parity, checksum.
    ReadConfig,
    /// Ask something harmless whose reply can be none to the other reads and writes of the module:
    /// once it is answered, whatever was asked before is answered or lost. Only where a poll has
    /// no two such reads anyway.
    Fence,
    /// Bring outputs into these states, and leave the others alone.
    Write(Bank),
    /// The same in a form that no module answers.
    WriteSilent(Bank),
    /// Toggle the outputs of the mask.
    Toggle(u32),
    /// Pull in now (`close`) or release now, and go back after a time in milliseconds.
    Jog {
        /// Which output.
        channel: Channel,
        /// Pull in first and release later, or the reverse.
        close: bool,
        /// Until it goes back, in milliseconds.
        millis: U24,
    },
    /// Write an internal variable.
    WriteVariable(u8, U24),
    /// Change a setting that the module keeps.
    Configure(Change),
}

/// A change to what a module keeps in its EEPROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Change {
    /// Address, speed and checksum at once, as EDA modules take them.
    Serial {
        /// The address from now on.
        address: Address,
        /// The speed from now on.
        baud: Baud,
        /// ASCII frames carry a checksum from now on.
        checksum: bool,
    },
    /// The address alone.
    Address(Address),
    /// The speed alone.
    Baud(Baud),
    /// The character format alone.
    Character(Character),
    /// Which outputs give pulses, and how long.
    Pulse {
        /// Bit n = output n gives pulses.
        mask: u8,
        /// The width of all pulses.
        width: PulseWidth,
    },
    /// The calibration voltage in hundredths of a volt.
    CalibrationVoltage(u16),
    /// Take the present inputs for zero.
    CalibrateZero,
    /// Take the present inputs for the calibration voltage.
    CalibrateSpan,
    /// Back to the factory settings.
    Restore,
}

/// What a reply says.
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
    /// Which outputs give pulses, and how long.
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
    /// Settings as the module keeps them; none where the reply does not say.
    Config {
        /// The address it believes to have.
        address: Option<Address>,
        /// The speed.
        baud: Option<Baud>,
        /// The character format.
        character: Option<Character>,
        /// ASCII frames carry a checksum.
        checksum: Option<bool>,
    },
    /// The write was acknowledged, which says nothing of the outputs' states.
    Done,
    /// The module answered no.
    Refused(Refusal),
    /// The reply is well formed but can't be the answer to this op.
    Unexpected,
}

/// How a module said no.
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
