//! Where a module answers, and which settings it has stored.

use railbus_device::Setup;
use railbus_wire::{Address, Baud, Character, PulseWidth, SerialSettings};

/// Where a module answers: what a host must know to talk to it, apart from its protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BusAddress {
    /// Its address.
    pub address: Address,
    /// Speed and character format.
    pub serial: SerialSettings,
    /// Its ASCII frames carry a checksum.
    pub checksum: bool,
}

impl BusAddress {
    /// Where a module with this description answers.
    #[must_use]
    pub const fn of(setup: &Setup) -> BusAddress {
        BusAddress {
            address: setup.address,
            serial: setup.serial,
            checksum: setup.checksum,
        }
    }

    /// The description of the same module here.
    #[must_use]
    pub const fn setup(&self, of: &Setup) -> Setup {
        Setup {
            address: self.address,
            serial: self.serial,
            checksum: self.checksum,
            ..*of
        }
    }
}

/// Which outputs of an EDA9060A give pulses, and how long [EDA9060A §3.4].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PulseSetup {
    /// Bit n = output n gives pulses.
    pub mask: u8,
    /// The width of all pulses.
    pub width: PulseWidth,
}

/// The stored settings of a module, as far as they are known; or the requested ones, as far as they
/// are given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Its address.
    pub address: Option<Address>,
    /// Its speed.
    pub baud: Option<Baud>,
    /// Its character format.
    pub character: Option<Character>,
    /// Its ASCII frames carry a checksum.
    pub checksum: Option<bool>,
    /// Which outputs give pulses, and how long.
    pub pulse: Option<PulseSetup>,
    /// The calibration voltage in hundredths of a volt.
    pub voltage: Option<u16>,
}

impl Kept {
    /// What the place itself shows.
    #[must_use]
    pub const fn at(place: BusAddress) -> Kept {
        Kept {
            address: Some(place.address),
            baud: Some(place.serial.baud),
            character: Some(place.serial.character),
            checksum: Some(place.checksum),
            pulse: None,
            voltage: None,
        }
    }

    /// These settings, completed by the other ones.
    #[must_use]
    pub fn or(self, other: Kept) -> Kept {
        Kept {
            address: self.address.or(other.address),
            baud: self.baud.or(other.baud),
            character: self.character.or(other.character),
            checksum: self.checksum.or(other.checksum),
            pulse: self.pulse.or(other.pulse),
            voltage: self.voltage.or(other.voltage),
        }
    }

    /// Whether the two agree in all that both of them know.
    #[must_use]
    pub fn agrees(&self, other: &Kept) -> bool {
        fn same<T: PartialEq>(a: Option<T>, b: Option<T>) -> bool {
            a.is_none() || b.is_none() || a == b
        }
        same(self.address, other.address)
            && same(self.baud, other.baud)
            && same(self.character, other.character)
            && same(self.checksum, other.checksum)
            && same(self.pulse, other.pulse)
            && same(self.voltage, other.voltage)
    }

    /// Where a module answers once these settings are in effect.
    #[must_use]
    pub fn place(&self, before: BusAddress) -> BusAddress {
        BusAddress {
            address: self.address.unwrap_or(before.address),
            serial: SerialSettings {
                baud: self.baud.unwrap_or(before.serial.baud),
                character: self.character.unwrap_or(before.serial.character),
            },
            checksum: self.checksum.unwrap_or(before.checksum),
        }
    }
}

/// A module that answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// Where.
    pub place: BusAddress,
    /// The settings it reports. What it does not report is empty here.
    pub told: Kept,
    /// The product version, if it reports one (EMD-2A2Q).
    pub version: Option<u16>,
    /// What its analog inputs read, in hundredths (EMD-2A2Q).
    pub analogs: Option<[u16; 2]>,
    /// A calibration is in progress (EMD-2A2Q).
    pub busy: bool,
}

impl Found {
    /// A module that answered here and reported no settings.
    #[must_use]
    pub fn at(place: BusAddress) -> Found {
        Found {
            place,
            told: Kept::default(),
            version: None,
            analogs: None,
            busy: false,
        }
    }

    /// Its settings: those it reports, and otherwise what its place shows.
    #[must_use]
    pub fn kept(&self) -> Kept {
        self.told.or(Kept::at(self.place))
    }
}
