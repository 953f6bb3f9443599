//! Families of modules: the datasheet as data, and a module as configured.

use crate::datasheet::Datasheet;
use crate::{eda9050, eda9060a, emd2a2q, erc8, r55};
use core::fmt;
use railbus_wire::{Address, Baud, Character, Micros, Protocol, SerialSettings};

/// A kind of module.
///
/// The numbers are those under which stored settings name the families ([`Family::code`]): they
/// are never reused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Family {
    /// EDA9060A: 4 relays, 4 inputs; ASCII, LC-02 or Modbus RTU.
    Eda9060a = 1,
    /// EDA9050: 8 open-collector outputs, 7 inputs; ASCII, LC-02 or Modbus RTU.
    Eda9050 = 2,
    /// ERC-8: 8 relays; Modbus RTU.
    Erc8 = 3,
    /// The 0x55/0x22 boards: up to 32 relays, inputs, or both.
    R55 = 4,
    /// EMD-2A2Q: 2 analog inputs, 2 relays; Modbus RTU.
    Emd2a2q = 5,
}

impl Family {
    /// All five.
    pub const ALL: [Family; 5] = [
        Family::Eda9060a,
        Family::Eda9050,
        Family::Erc8,
        Family::R55,
        Family::Emd2a2q,
    ];

    /// The only family whose device side is built; none if there are several.
    pub(crate) const ONLY: Option<Family> = match (
        cfg!(feature = "eda9060a"),
        cfg!(feature = "eda9050"),
        cfg!(feature = "erc8"),
        cfg!(feature = "r55"),
        cfg!(feature = "emd2a2q"),
    ) {
        (true, false, false, false, false) => Some(Family::Eda9060a),
        (false, true, false, false, false) => Some(Family::Eda9050),
        (false, false, true, false, false) => Some(Family::Erc8),
        (false, false, false, true, false) => Some(Family::R55),
        (false, false, false, false, true) => Some(Family::Emd2a2q),
        _ => None,
    };

    /// The family's numbers and names, which both ends of the line read.
    #[must_use]
    pub const fn profile(self) -> &'static Profile {
        match self {
            Family::Eda9060a => &eda9060a::PROFILE,
            Family::Eda9050 => &eda9050::PROFILE,
            Family::Erc8 => &erc8::PROFILE,
            Family::R55 => &r55::PROFILE,
            Family::Emd2a2q => &emd2a2q::PROFILE,
        }
    }

    /// What only a host asks about the family.
    #[must_use]
    pub const fn datasheet(self) -> &'static Datasheet {
        match self {
            Family::Eda9060a => &eda9060a::DATASHEET,
            Family::Eda9050 => &eda9050::DATASHEET,
            Family::Erc8 => &erc8::DATASHEET,
            Family::R55 => &r55::DATASHEET,
            Family::Emd2a2q => &emd2a2q::DATASHEET,
        }
    }

    /// The number under which stored settings name the family, 1 to 5.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The name in flags and configuration: `eda9060a`, `eda9050`, `erc8`, `r55`, `emd2a2q`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.profile().name
    }

    /// The family with that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Family> {
        Family::ALL.into_iter().find(|family| family.name() == name)
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.profile().model)
    }
}

/// The numbers and names of a family that both ends of the line read; what only a host asks is in
/// its [`Datasheet`].
#[derive(Debug)]
pub struct Profile {
    /// The name in flags and configuration.
    pub name: &'static str,
    /// The model as the maker writes it.
    pub model: &'static str,
    /// Outputs of a module; the maximum where that varies.
    pub outputs: u8,
    /// Digital inputs of a module; the maximum where that varies.
    pub inputs: u8,
    /// Analog inputs of a module.
    pub analogs: u8,
    /// The protocols, the factory setting first.
    pub protocols: &'static [Protocol],
    /// The baud rates and their codes in configuration frames.
    pub bauds: &'static [(u8, Baud)],
    /// The character formats and their codes in configuration registers.
    pub characters: &'static [(u8, Character)],
    /// The lowest and the highest address.
    pub addresses: (u8, u8),
    /// The silence required before a request; none means 3.5 characters.
    pub gap: Option<Micros>,
    /// The letters before an output's number, and the number of the first.
    pub output_label: (&'static str, u8),
    /// The letters before an input's number, and the number of the first.
    pub input_label: (&'static str, u8),
}

impl Profile {
    /// The code of a baud rate in configuration frames.
    #[must_use]
    pub fn baud_code(&self, baud: Baud) -> Option<u8> {
        self.bauds
            .iter()
            .find(|(_, known)| *known == baud)
            .map(|(code, _)| *code)
    }

    /// The baud rate with a code.
    #[must_use]
    pub fn baud_of(&self, code: u8) -> Option<Baud> {
        self.bauds
            .iter()
            .find(|(known, _)| *known == code)
            .map(|(_, baud)| *baud)
    }

    /// The code of a character format in configuration registers.
    #[must_use]
    pub fn character_code(&self, character: Character) -> Option<u8> {
        self.characters
            .iter()
            .find(|(_, known)| *known == character)
            .map(|(code, _)| *code)
    }

    /// The character format with a code.
    #[must_use]
    pub fn character_of(&self, code: u8) -> Option<Character> {
        self.characters
            .iter()
            .find(|(known, _)| *known == code)
            .map(|(_, character)| *character)
    }

    /// Letters and first number of the labels of a kind of point.
    const fn label(&self, kind: PointKind) -> (&'static str, u8) {
        match kind {
            PointKind::Output => self.output_label,
            PointKind::Input => self.input_label,
            PointKind::Analog => ("ai", 1),
            PointKind::Variable => ("v", 0),
        }
    }
}

/// The kind of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PointKind {
    /// A relay or transistor.
    Output,
    /// A digital input; on is high or open.
    Input,
    /// An analog input.
    Analog,
    /// An internal variable of a 0x55 board.
    Variable,
}

/// One channel or value of a module, by 0-based index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Point {
    /// Its kind.
    pub kind: PointKind,
    /// Its index from 0, whatever its label counts from.
    pub index: u8,
}

/// How a 0x55 board uses the 32 bits of its state [R55 §3.4].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Layout {
    /// All 32 are outputs.
    #[default]
    Outputs,
    /// All 32 are inputs.
    Inputs,
    /// The high 16 are inputs, the low 16 outputs.
    Mixed,
}

/// A module as the user describes it: what can't be read from it, or has not been read yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Its family.
    pub family: Family,
    /// Its address.
    pub address: Address,
    /// The protocol it uses.
    pub protocol: Protocol,
    /// Speed and character format.
    pub serial: SerialSettings,
    /// Its ASCII frames carry a checksum.
    pub checksum: bool,
    /// How many outputs it has. Only 0x55 boards differ.
    pub outputs: u8,
    /// How many digital inputs it has. Only 0x55 boards differ.
    pub inputs: u8,
    /// How many internal variables it has, 0 to 32. Only programmable 0x55 boards have any.
    pub variables: u8,
    /// How a 0x55 board uses the bits of its state.
    pub layout: Layout,
    /// A 0x55 board with 11 and 12 swapped [R55 §3.9].
    pub invert_on_off: bool,
    /// The silence before a request, if it differs from the profile's.
    pub gap: Option<Micros>,
}

/// Why a setup is not possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetupError {
    /// The family has no such address; its lowest and highest.
    Address(u8, u8),
    /// The family does not support that protocol.
    Protocol,
    /// The family does not support that baud rate.
    Baud,
    /// The family does not support that character format.
    Character,
    /// More channels than the family has, or than the layout has room for.
    Channels,
    /// Only ASCII has an optional checksum.
    Checksum,
    /// The device side was built for another family.
    Family,
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SetupError::Address(low, high) => {
                write!(f, "the address must be {low} to {high} for this model")
            }
            SetupError::Protocol => f.write_str("this model does not speak that protocol"),
            SetupError::Baud => f.write_str("this model does not have that speed"),
            SetupError::Character => f.write_str("this model does not have that parity"),
            SetupError::Channels => f.write_str("this model does not have so many channels"),
            SetupError::Checksum => f.write_str("only the ASCII protocol has a checksum switch"),
            SetupError::Family => f.write_str("this firmware was built for another model"),
        }
    }
}

impl core::error::Error for SetupError {}

impl Setup {
    /// A module in its factory state, at an address.
    #[must_use]
    pub fn new(family: Family, address: Address) -> Setup {
        let profile = family.profile();
        Setup {
            family,
            address,
            protocol: profile.protocols.first().copied().unwrap_or(Protocol::Rtu),
            serial: SerialSettings::FACTORY,
            checksum: false,
            outputs: profile.outputs,
            inputs: if family == Family::R55 {
                0
            } else {
                profile.inputs
            },
            variables: 0,
            layout: Layout::Outputs,
            invert_on_off: false,
            gap: None,
        }
    }

    /// Checks everything that the family limits.
    ///
    /// # Errors
    /// The first [`SetupError`] found.
    pub fn check(&self) -> Result<(), SetupError> {
        self.check_by(self.family.profile())
    }

    /// Also checks that the family's device side is built.
    ///
    /// # Errors
    /// The first [`SetupError`] found.
    pub fn check_built(&self) -> Result<(), SetupError> {
        match Family::ONLY {
            Some(only) if only != self.family => Err(SetupError::Family),
            // By name, so that the other families' data is not linked.
            Some(only) => self.check_by(only.profile()),
            None => self.check(),
        }
    }

    fn check_by(&self, profile: &Profile) -> Result<(), SetupError> {
        let (low, high) = profile.addresses;
        let low = if self.protocol == Protocol::Rtu {
            low.max(1)
        } else {
            low
        };
        let broadcast = self.family == Family::R55 && self.address == railbus_wire::r55::BROADCAST;
        if !(low..=high).contains(&self.address.0) || broadcast {
            return Err(SetupError::Address(low, high));
        }
        if !profile.protocols.contains(&self.protocol) {
            return Err(SetupError::Protocol);
        }
        if profile.baud_code(self.serial.baud).is_none() {
            return Err(SetupError::Baud);
        }
        if profile.character_code(self.serial.character).is_none() {
            return Err(SetupError::Character);
        }
        if self.checksum && self.protocol != Protocol::Ascii {
            return Err(SetupError::Checksum);
        }
        self.check_channels(profile)
    }

    fn check_channels(&self, profile: &Profile) -> Result<(), SetupError> {
        let fits = match (self.family, self.layout) {
            (Family::R55, Layout::Outputs) => self.outputs <= 32 && self.inputs == 0,
            (Family::R55, Layout::Inputs) => self.outputs == 0 && self.inputs <= 32,
            (Family::R55, Layout::Mixed) => self.outputs <= 16 && self.inputs <= 16,
            _ => self.outputs == profile.outputs && self.inputs == profile.inputs,
        };
        let variables_fit = self.variables <= if self.family == Family::R55 { 32 } else { 0 };
        if fits && variables_fit {
            Ok(())
        } else {
            Err(SetupError::Channels)
        }
    }

    /// How many points of a kind the module has.
    #[must_use]
    pub fn count(&self, kind: PointKind) -> u8 {
        match kind {
            PointKind::Output => self.outputs,
            PointKind::Input => self.inputs,
            PointKind::Analog => self.family.profile().analogs,
            PointKind::Variable => self.variables,
        }
    }

    /// The label of a point as printed at its terminal, in two parts: `("do", 0)` for `do0`.
    #[must_use]
    pub fn label(&self, point: Point) -> (&'static str, u8) {
        let (letters, first) = self.family.profile().label(point.kind);
        (letters, first.saturating_add(point.index))
    }

    /// The point with this label, such as `do0`, `k1`, `ai2`.
    #[must_use]
    pub fn point(&self, label: &str) -> Option<Point> {
        let at = label.find(|c: char| c.is_ascii_digit())?;
        let (letters, number) = label.split_at(at);
        let canonical = number == "0" || !number.starts_with('0');
        let number: u8 = number.parse().ok().filter(|_| canonical)?;
        let kinds = [
            PointKind::Output,
            PointKind::Input,
            PointKind::Analog,
            PointKind::Variable,
        ];
        let kind = kinds.into_iter().find(|kind| {
            self.family.profile().label(*kind).0 == letters && self.count(*kind) > 0
        })?;
        let index = number.checked_sub(self.family.profile().label(kind).1)?;
        (index < self.count(kind)).then_some(Point { kind, index })
    }

    /// All points, outputs first.
    pub fn points(&self) -> impl Iterator<Item = Point> + use<> {
        let setup = *self;
        [
            PointKind::Output,
            PointKind::Input,
            PointKind::Analog,
            PointKind::Variable,
        ]
        .into_iter()
        .flat_map(move |kind| (0..setup.count(kind)).map(move |index| Point { kind, index }))
    }

    /// The mask of all outputs: bit 0 is the first.
    #[must_use]
    pub const fn output_mask(&self) -> u32 {
        mask(self.outputs)
    }

    /// The mask of all digital inputs: bit 0 is the first.
    #[must_use]
    pub const fn input_mask(&self) -> u32 {
        mask(self.inputs)
    }

    /// The silence required before a request to this module.
    #[must_use]
    pub fn request_gap(&self) -> Micros {
        self.gap_of(self.family.profile(), self.protocol, self.serial)
    }

    /// The same for other settings than the configured ones.
    #[inline]
    pub(crate) const fn gap_of(
        &self,
        profile: &Profile,
        protocol: Protocol,
        serial: SerialSettings,
    ) -> Micros {
        match (self.gap, profile.gap, protocol) {
            (Some(gap), ..) => gap,
            (None, Some(gap), _) => gap,
            (None, None, Protocol::Rtu) => serial.t3_5(),
            (None, None, _) => Micros::from_millis(5),
        }
    }
}

/// The lowest `count` bits.
pub(crate) const fn mask(count: u8) -> u32 {
    match 1u32.checked_shl(count as u32) {
        Some(bit) => bit - 1,
        None => u32::MAX,
    }
}
