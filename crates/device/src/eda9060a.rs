//! EDA9060A: four relays, which may give pulses, and four inputs. What it shares with the EDA9050
//! is in [`crate::eda`].

use crate::Profile;
use crate::datasheet::{
    Access, Bilingual, Datasheet, Holds, Key, PerProtocol, PulseTiming, Recognition, Register,
    ScanEvidence, Separation, StoredSetting, Terminal, same,
};
use crate::eda::{self, terminal};
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

/// What only a host asks. Terminals and ratings are in the tables at the end of the sheet.
pub(crate) static DATASHEET: Datasheet = Datasheet {
    title: same("EDA9060A"),
    // [EDA9060A §1.2, §1.3]
    names: &[b"9060", b"9060A"],
    numbers: &[0x9060, 9060],
    signs: &[],
    // Over Modbus by registers 0 and 1 [EDA9060A §6.18].
    recognition: PerProtocol::same(Recognition::ByName),
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
        // [EDA9060A §2.2]
        StoredSetting::new(Key::Protocol, Access::MakersSoftware),
        // [EDA9060A §3.12]
        StoredSetting::new(Key::Mode(0), Access::Written),
        StoredSetting::new(Key::Mode(1), Access::Written),
        StoredSetting::new(Key::Mode(2), Access::Written),
        StoredSetting::new(Key::Mode(3), Access::Written),
        StoredSetting::new(Key::PulseWidth, Access::Written),
    ],
    separation: PerProtocol::same(Separation::Plug),
    // [EDA9060A §3.2, §3.4]
    pulses: PulseTiming::Stored,
    dip_switch: false,
    init_pin: false,
    registers: &[
        Register::new(Holds::Model, ["model", "型号"], "[EDA9060A §6.6]"),
        Register::new(
            Holds::AddressAndBaud,
            ["address, speed code", "地址、波特率代码"],
            "[EDA9060A §6.7]",
        ),
        Register::new(
            Holds::Pulses,
            ["pulse mode, width in 0.1 s", "脉冲方式、宽度（0.1 秒）"],
            "[EDA9060A §6.8]",
        ),
        Register::new(
            Holds::Protocol,
            ["protocol, checksum", "协议、校验和"],
            "[EDA9060A §6.9]",
        ),
    ],
    terminals: &[
        Terminal::new("1–4", same("DI0 DI1 DI2 DI3")),
        Terminal::new("5", ["DGND, common of the inputs", "DGND，输入公共端"]),
        Terminal::new("7", terminal::DATA_PLUS),
        Terminal::new("8", terminal::DATA_MINUS),
        Terminal::new("9", terminal::SUPPLY),
        Terminal::new("10", terminal::GROUND),
        Terminal::new(
            "11 12 13",
            [
                "relay 0: normally open, common, normally closed",
                "继电器 0：常开、公共、常闭",
            ],
        ),
        Terminal::new(
            "14 15 16",
            [
                "relay 1: normally open, common, normally closed",
                "继电器 1：常开、公共、常闭",
            ],
        ),
        Terminal::new(
            "17 18",
            ["relay 2: normally open, common", "继电器 2：常开、公共"],
        ),
        Terminal::new(
            "19 20",
            ["relay 3: normally open, common", "继电器 3：常开、公共"],
        ),
    ],
    notes: &NOTES,
};

const NOTES: [Bilingual; 4] = [
    [
        "Supply 10 to 24 VDC, at most 1.5 W",
        "电源 10–24 VDC，最大 1.5 W",
    ],
    [
        "Contacts: 8 A 125 VAC, 5 A 250 VAC, 5 A 30 VDC",
        "触点：8 A 125 VAC，5 A 250 VAC，5 A 30 VDC",
    ],
    // [EDA9060A §3.4]
    [
        "Times pulses itself: 0.1 to 20 s, one width for the whole module",
        "模块自行计时点动：0.1–20 秒，整个模块共用一个宽度",
    ],
    // [EDA9060A §1.2, §2.2]
    [
        "Reports itself as 9060; the protocol is changed only by the maker's software",
        "自报型号为 9060；协议只能用厂家软件更改",
    ],
];

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
