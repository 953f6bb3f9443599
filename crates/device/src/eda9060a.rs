//! EDA9060A: four relays, which may give pulses, and four inputs. What it shares with the EDA9050
//! is in [`crate::eda`].

use crate::{Profile, eda};
use railbus_wire::{Character, Micros, Protocol, rtu::Function};

/// The datasheet as data.
pub(crate) static PROFILE: Profile = Profile {
    name: "eda9060a",
    model: "EDA9060A",
    outputs: 4,
    inputs: 4,
    analogs: 0,
    protocols: &[Protocol::Ascii, Protocol::Lc02, Protocol::Rtu],
    bauds: &eda::BAUDS,
    characters: &[(0, Character::N1)],
    addresses: (0, 255),
    gap: None,
    output_label: ("do", 0),
    input_label: ("di", 0),
};

/// Functions that the codec knows and the module lacks [EDA9060A §6.1].
pub(crate) const ABSENT: &[Function] = &[Function::ReadInputRegisters, Function::WriteRegister];

/// Half a blink period; the LED blinks once a second [EDA9060A §1.6].
const HALF_BLINK: u32 = 500_000;

/// The LED blinks, and is on while the module sends.
pub(crate) const fn led(since_start: Micros, sending: bool) -> bool {
    let (_, into_blink) = since_start.seconds();
    sending || into_blink < HALF_BLINK
}

/// How long until the LED changes.
pub(crate) const fn led_holds(since_start: Micros) -> Micros {
    let (_, into_blink) = since_start.seconds();
    let left = HALF_BLINK - into_blink % HALF_BLINK;
    Micros(left as u64)
}
