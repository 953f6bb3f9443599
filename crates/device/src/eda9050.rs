//! EDA9050: eight open-collector outputs and seven inputs. What it shares with the EDA9060A is in
//! [`crate::eda`].

use crate::Profile;
use crate::datasheet::{
    Access, Datasheet, Key, PerProtocol, PulseTiming, Recognition, ScanEvidence, Separation,
    StoredSetting, Terminal, same,
};
use crate::eda::{self, terminal};
use crate::sign::{ReadOutcome, Sign};
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

/// What only a host asks. Terminals and ratings are in the tables at the end of the sheet.
pub(crate) static DATASHEET: Datasheet = Datasheet {
    title: same("EDA9050"),
    // [EDA9050 §1.2, §1.3]
    names: &[b"9050"],
    numbers: &[0x9050, 9050],
    signs: &SIGNS,
    // Over Modbus nothing reports its name [EDA9050 §5.7].
    recognition: PerProtocol::except(Recognition::ByName, Protocol::Rtu, Recognition::ByBehaviour),
    // [EDA §4.2]
    refuses: false,
    evidence: ScanEvidence::Channels,
    channels_vary: false,
    broadcast: None,
    factory: eda::FACTORY,
    // [EDA §2.15, §3.9, §4.6]
    serial_as_one: true,
    settings: &[
        StoredSetting::new(Key::Address, Access::Written),
        StoredSetting::new(Key::Baud, Access::Written),
        eda::CHECKSUM,
        // The pin does not lead out of Modbus [EDA9050 §2.5].
        StoredSetting {
            key: Key::Protocol,
            access: PerProtocol::except(Access::InitPin, Protocol::Rtu, Access::MakersSoftware),
        },
    ],
    // Grounded, the pin turns ASCII into LC-02 [EDA9050 §2.2].
    separation: PerProtocol::except(Separation::Plug, Protocol::Ascii, Separation::InitPin),
    // [EDA9050 §1.7]
    pulses: PulseTiming::Host,
    dip_switch: false,
    init_pin: true,
    registers: &[],
    terminals: &[
        Terminal::new("1–5", same("DO7 DO6 DO5 DO4 DO3")),
        Terminal::new(
            "6",
            [
                "INIT*: to ground LC-02, open ASCII",
                "INIT*：接地为 LC-02，悬空为 ASCII",
            ],
        ),
        Terminal::new("7", terminal::DATA_PLUS),
        Terminal::new("8", terminal::DATA_MINUS),
        Terminal::new("9", terminal::SUPPLY),
        Terminal::new("10", terminal::GROUND),
        Terminal::new("11 12 13", same("DO2 DO1 DO0")),
        Terminal::new("14–20", same("DI0 … DI6")),
    ],
    notes: &[
        [
            "Supply 10 to 30 VDC, below 0.2 W",
            "电源 10–30 VDC，低于 0.2 W",
        ],
        [
            "Outputs: open collector, 100 mA",
            "输出：集电极开路，100 mA",
        ],
        // [EDA9050 §1.4]
        [
            "An input that is not connected reads high",
            "未接的输入读为高",
        ],
    ],
};

/// It refuses nothing and does not answer what it lacks, like many other boards: nothing it shows
/// proves it [EDA9050 §5.1, §5.2, §5.3, §5.7].
const SIGNS: [Option<Sign>; 5] = [
    Sign::coils(0, 8, ReadOutcome::Answer),
    Sign::registers(0, 4, ReadOutcome::Silence),
    Sign::coils(0, 9, ReadOutcome::Silence),
    Sign::inputs(0, 7, ReadOutcome::Answer),
    Sign::inputs(0, 8, ReadOutcome::Silence),
];

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
