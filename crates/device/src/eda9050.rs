//! EDA9050: eight open-collector outputs and seven inputs. What it shares with the EDA9060A is in
//! [`crate::eda`].

use crate::{Profile, eda};
use railbus_wire::{Character, Protocol, rtu::Function};

/// The datasheet as data.
pub(crate) static PROFILE: Profile = Profile {
    name: "eda9050",
    model: "EDA9050",
    outputs: 8,
    inputs: 7,
    analogs: 0,
    protocols: &[Protocol::Ascii, Protocol::Lc02, Protocol::Rtu],
    bauds: &eda::BAUDS,
    characters: &[(0, Character::N1)],
    addresses: (0, 255),
    gap: None,
    output_label: ("do", 0),
    input_label: ("di", 0),
};

/// Functions that the codec knows and the module lacks [EDA9050 §5.1].
pub(crate) const ABSENT: &[Function] = &[
    Function::ReadHoldingRegisters,
    Function::ReadInputRegisters,
    Function::WriteRegister,
];

/// The protocol that the INIT* pin chooses: grounded LC-02, open ASCII [EDA9050 §2.1, §2.2].
pub(crate) const fn protocol_by_pin(init_grounded: bool) -> Protocol {
    if init_grounded {
        Protocol::Lc02
    } else {
        Protocol::Ascii
    }
}

/// The LED is on, and off while the module sends [EDA9050 §1.8].
pub(crate) const fn led(sending: bool) -> bool {
    !sending
}
