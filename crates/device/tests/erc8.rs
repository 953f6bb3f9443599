//! ERC-8 as the host sees it, by the numbered facts of `docs/datasheets/erc8.md`; the module's
//! own half is in `vectors/cases/erc8.txt`. What it shares with the EMD-2A2Q
//! is in `sisters.rs`, descriptions are in `setup.rs`.

mod support;

use railbus_device::{Bank, Family, Module, Observation, Op, Refusal, SettingWrite, Setup};
use railbus_wire::rtu::Exception;
use railbus_wire::{Address, Baud, Channel, Character};
use support::{hex, request, seen, with_crc};

fn host() -> Module {
    Module::new(Setup::new(Family::Erc8, Address(1))).expect("an ERC-8")
}

/// [ERC-8 §2.5] settings are written with FC06, never with FC10, and tried with FC03.
#[test]
fn the_host_asks() {
    let relay = |index| Channel::new(index).expect("a relay");
    let change = |change| Op::Configure(change);
    let table = [
        (Op::ReadOutputs, "01 01 003C 0008"),
        (Op::ReadConfig, "01 03 0000 0003"),
        (Op::Write(Bank::one(relay(0), true)), "01 05 003C FF00"),
        (Op::Write(Bank::one(relay(7), false)), "01 05 0043 0000"),
        (Op::Write(Bank::new(0xFF, 0xFF)), "01 0F 003C 0008 01 FF"),
        (Op::Write(Bank::new(0x1C, 0x14)), "01 0F 003E 0003 01 05"),
        (change(SettingWrite::Address(Address(9))), "01 06 0000 0009"),
        (change(SettingWrite::Baud(Baud::B4800)), "01 06 0001 0000"),
        (change(SettingWrite::Baud(Baud::B38400)), "01 06 0001 0003"),
        (
            change(SettingWrite::Character(Character::E1)),
            "01 06 0002 0002",
        ),
    ];
    for (op, frame) in table {
        assert_eq!(request(&host(), &op), Some(with_crc(&hex(frame))), "{op:?}");
    }
    let none = [
        Op::ReadInputs,
        Op::ReadAnalogs,
        Op::Identify,
        Op::Toggle(1),
        Op::WriteSilent(Bank::new(1, 1)),
        Op::Write(Bank::new(0, 0)),
        Op::Write(Bank::new(0x05, 0x05)),
        Op::Write(Bank::new(0x100, 0)),
        change(SettingWrite::Baud(Baud::B2400)),
        change(SettingWrite::Character(Character::N2)),
        change(SettingWrite::Restore),
    ];
    for op in none {
        assert_eq!(request(&host(), &op), None, "{op:?}");
    }
}

/// [ERC-8 §2.5] exception 01 to FC03 is what the module said, and no broken reply.
#[test]
fn the_host_understands() {
    let host = host();
    let said = |op, reply| seen(&host, &op, &with_crc(&hex(reply)));
    let relays = Observation::Channels {
        outputs: Bank::new(0xFF, 0x81),
        inputs: Bank::default(),
    };
    assert_eq!(said(Op::ReadOutputs, "01 01 01 81"), relays);
    let config = Observation::Config {
        address: Some(Address(6)),
        baud: Some(Baud::B19200),
        character: Some(Character::O1),
        checksum: None,
    };
    assert_eq!(said(Op::ReadConfig, "01 03 06 0006 0002 0001"), config);
    let unknown = Observation::Config {
        address: None,
        baud: None,
        character: None,
        checksum: None,
    };
    assert_eq!(said(Op::ReadConfig, "01 03 06 0106 0004 0003"), unknown);
    let refused = Observation::Refused(Refusal::Exception(Exception::FUNCTION));
    assert_eq!(said(Op::ReadConfig, "01 83 01"), refused);
    let on = Op::Write(Bank::new(1, 1));
    assert_eq!(said(on, "01 05 003C FF00"), Observation::Done);
    assert_eq!(host.read_back(&on), Some(Op::ReadOutputs));
    assert!(host.repeatable(&on));
    assert!(!host.repeatable(&Op::Configure(SettingWrite::Address(Address(2)))));
}
