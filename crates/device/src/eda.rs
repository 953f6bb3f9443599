//! What the two EDA modules share: three protocols over the same few functions.
//!
//! [`host`] turns ops into frames of any of the three; [`answer`] is the device side. Outputs
//! follow the same rules in every protocol [EDA9060A §3.11].

mod answer;
mod host;

pub(crate) use answer::{ascii, lc02, refuse_ascii, rtu};
pub(crate) use host::{exchange, group, interpret, recognises};

use crate::Family;
use crate::datasheet::{Access, Bilingual, Factory, Key, PerProtocol, StoredSetting};
use railbus_wire::{Address, Baud, Protocol, SerialSettings};

/// The baud rates and their codes, the same in all three protocols [EDA §1.2].
pub(crate) static BAUDS: [(u8, Baud); 5] = [
    (0x03, Baud::B1200),
    (0x04, Baud::B2400),
    (0x05, Baud::B4800),
    (0x06, Baud::B9600),
    (0x07, Baud::B19200),
];

/// As shipped [EDA §1.1, §1.3].
pub(crate) const FACTORY: Factory = Factory {
    address: Address(1),
    serial: SerialSettings::FACTORY,
    voltage: None,
};

/// Only in ASCII frames is there a checksum, and only they set it [EDA §2.12, §3.9].
pub(crate) const CHECKSUM: StoredSetting = StoredSetting {
    key: Key::Checksum,
    access: PerProtocol::except(Access::InAscii, Protocol::Ascii, Access::Written),
};

/// What is at terminals that both have.
pub(crate) mod terminal {
    use super::Bilingual;

    pub(crate) const DATA_PLUS: Bilingual = ["RS-485 positive (A)", "RS-485 正（A）"];
    pub(crate) const DATA_MINUS: Bilingual = ["RS-485 negative (B)", "RS-485 负（B）"];
    pub(crate) const SUPPLY: Bilingual = ["supply, positive", "电源正"];
    pub(crate) const GROUND: Bilingual = ["supply, ground", "电源地"];
}

/// The registers that FC03 reads on an EDA9060A [EDA9060A §6.6, §6.7, §6.8, §6.9]. Not those
/// that FC10 writes: the same number means something else there [EDA9060A §6.17].
mod read_map {
    pub(super) const MODEL: u16 = 0;
    pub(super) const SERIAL: u16 = 1;
    pub(super) const PULSE: u16 = 2;
    pub(super) const PROTOCOL: u16 = 3;
    pub(super) const LEN: u16 = 4;
}

/// The registers that FC10 writes [EDA9060A §6.13].
mod write_map {
    pub(super) const SERIAL: u16 = 0;
    pub(super) const PULSE: u16 = 1;
}

/// Bit 7 of the protocol register: ASCII frames carry a checksum [EDA9060A §6.9].
const PROTOCOL_CHECKSUM: u16 = 1 << 7;

const fn has_pulses(family: Family) -> bool {
    matches!(family, Family::Eda9060a)
}

/// The name a module reports: not the one on its front [EDA9060A §1.2].
const fn name(family: Family) -> &'static [u8; 4] {
    if has_pulses(family) { b"9060" } else { b"9050" }
}

/// The model number, BCD [EDA §3.7].
const fn model(family: Family) -> u16 {
    if has_pulses(family) { 0x9060 } else { 0x9050 }
}
