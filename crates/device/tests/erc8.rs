//! ERC-8, by the numbered facts of `docs/datasheets/erc8.md`. What it shares with the EMD-2A2Q
//! is in `sisters.rs`, descriptions are in `setup.rs`.

mod support;

use railbus_device::{Bank, Change, Effect, Family, Module, Op, Refusal, Seen, Setup};
use railbus_wire::rtu::Exception;
use railbus_wire::{Address, Baud, Channel, Character};
use support::{Bench, hex, request, seen, with_crc};

fn erc8() -> Bench {
    Bench::new(Setup::new(Family::Erc8, Address(1)))
}

fn host() -> Module {
    Module::new(Setup::new(Family::Erc8, Address(1))).expect("an ERC-8")
}

/// [ERC-8 §3.6] relay 1 on reads as bit 0; [ERC-8 §3.5] FC05 is answered by its echo.
#[test]
fn the_printed_frames() {
    let mut module = erc8();
    let on = hex("01 05 00 3C FF 00 4C 36");
    assert_eq!(module.ask(&on), Some(on));
    assert_eq!(
        module.ask_hex("01 01 00 3C 00 01 3D C6"),
        Some(hex("01 01 01 01 90 48"))
    );
    assert_eq!(module.engine.outputs(), 1);
}

/// [ERC-8 §1.1, §2.1, §3.1, §3.4, §3.5] relays 1-8 are the coils 60-67; FF00 is on, 0000 is off.
#[test]
fn every_relay_has_its_coil() {
    let mut module = erc8();
    for relay in 0..8u8 {
        let coil = 60 + relay;
        for (value, on) in [("FF00", true), ("0000", false)] {
            let write = format!("01 05 00 {coil:02X} {value}");
            module.did();
            assert_eq!(module.ask_rtu(&write), Some(hex(&write)));
            let mask = if on { 1 << relay } else { 0 };
            assert_eq!(module.engine.outputs(), mask);
            let effects: Vec<Effect> = module.did().into_iter().map(|(_, what)| what).collect();
            assert_eq!(effects, [Effect::Output { channel: relay, on }]);
            let read = module.ask_rtu("01 01 003C 0008");
            assert_eq!(read, Some(vec![0x01, 0x01, 0x01, mask as u8]));
        }
    }
}

/// [ERC-8 §2.1, §3.6, §3.7] FC0F sets a run and leaves the others alone; FC01 reads a run, whose
/// first coil is bit 0.
#[test]
fn runs_of_relays() {
    let mut module = erc8();
    let table = [
        ("01 0F 003C 0008 01 FF", 0xFF),
        ("01 0F 003E 0003 01 02", 0xEB),
        ("01 0F 0043 0001 01 00", 0x6B),
        ("01 0F 003C 0002 01 FC", 0x68),
    ];
    for (write, outputs) in table {
        let echo = hex(write)[..6].to_vec();
        assert_eq!(module.ask_rtu(write), Some(echo));
        assert_eq!(module.engine.outputs(), outputs, "{write}");
    }
    assert_eq!(module.ask_rtu("01 01 003F 0004"), Some(hex("01 01 01 0D")));
    assert_eq!(module.ask_rtu("01 01 0043 0001"), Some(hex("01 01 01 00")));
}

/// [ERC-8 §3.2, §3.3, §3.8] coils outside 60-67 decimal do not exist; [ERC-8 §3.4] FC05 takes
/// two values; [ERC-8 §4.7, §4.8] registers 0-2 take what they are for, and there are no others.
/// [ERC-8 §2.4] functions that there are not.
#[test]
fn what_is_refused() {
    let mut module = erc8();
    module.ask_rtu("01 0F 003C 0008 01 A5");
    let by_code: [(u8, &[&str]); 3] = [
        (
            1,
            &[
                "01 02 003C 0001",
                "01 04 0000 0001",
                "01 10 0000 0001 02 0002",
                "01 10 0000 0001 03 0002",
                "01 07",
                "01 08 0000 1234",
                "01 0B",
                "01 0C",
                "01 11",
                "01 15 00",
                "01 16 0000 0000 0000",
                "01 17 0000 0001 0000 0001 02 0001",
                "01 2B 0E 01 00",
                "01 00",
            ],
        ),
        (
            2,
            &[
                "01 05 0060 FF00",
                "01 01 0060 0001",
                "01 05 003B FF00",
                "01 05 0044 FF00",
                "01 05 0000 0000",
                "01 01 003B 0001",
                "01 01 0044 0001",
                "01 01 003B 0009",
                "01 01 003C 0009",
                "01 01 0043 0002",
                "01 0F 003B 0001 01 00",
                "01 0F 0043 0002 01 00",
                "01 0F 003C 0009 02 00 00",
                "01 03 0003 0001",
                "01 03 0000 0004",
                "01 03 0002 0002",
                "01 06 0003 0001",
                "01 06 FFFF 0001",
            ],
        ),
        (
            3,
            &[
                "01 05 003C 0001",
                "01 05 003C FF01",
                "01 05 003C 00FF",
                "01 05 003C 5500",
                "01 06 0000 0000",
                "01 06 0000 0021",
                "01 06 0001 0004",
                "01 06 0002 0003",
                "01 0F 003C 0008 02 0000",
                "01 0F 003C 0000 00",
                "01 03 0000 0000",
            ],
        ),
    ];
    for (code, requests) in by_code {
        for request in requests {
            module.refuses(request, code);
        }
    }
    assert_eq!(module.engine.outputs(), 0xA5);
}

/// [ERC-8 §2.2, §2.3, §4.6] FC06 writes a setting and FC03 reads them: module 6 becomes module 1.
#[test]
fn the_printed_address_write() {
    let mut module = Bench::new(Setup::new(Family::Erc8, Address(6)));
    let write = hex("06 06 0000 0001 49BD");
    assert_eq!(module.ask(&write), Some(write));
    let read = module.ask_rtu("01 03 0000 0003");
    assert_eq!(read, Some(hex("01 03 06 0001 0001 0000")));
}

/// [ERC-8 §4.10] FC06 at register 0 to address 0 sets the address without a reply, and
/// [ERC-8 §4.11] nothing else to address 0 does anything.
#[test]
fn broadcasts() {
    let mut module = Bench::new(Setup::new(Family::Erc8, Address(6)));
    let ignored = [
        "00 05 003C FF00",
        "00 0F 003C 0008 01 FF",
        "00 06 0001 0002",
        "00 06 0002 0001",
        "00 06 0000 0021",
        "00 10 0000 0001 02 0002",
        "00 01 003C 0008",
        "00 03 0000 0003",
    ];
    for request in ignored {
        module.ignores(&with_crc(&hex(request)));
    }
    assert_eq!(module.ask_hex("00 06 0000 0001 49DB"), None);
    assert_eq!(module.engine.active().address, Address(1));
    assert!(module.ask_rtu("01 01 003C 0001").is_some());
    module.power_cycle();
    assert_eq!(module.engine.active().address, Address(1));
}

/// Frames for others are none of its business.
#[test]
fn other_addresses() {
    let mut module = erc8();
    for request in ["02 05 003C FF00", "21 06 0000 0002", "02 08 0000 0000"] {
        module.ignores(&with_crc(&hex(request)));
    }
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
        (change(Change::Address(Address(9))), "01 06 0000 0009"),
        (change(Change::Baud(Baud::B4800)), "01 06 0001 0000"),
        (change(Change::Baud(Baud::B38400)), "01 06 0001 0003"),
        (change(Change::Character(Character::E1)), "01 06 0002 0002"),
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
        change(Change::Baud(Baud::B2400)),
        change(Change::Character(Character::N2)),
        change(Change::Restore),
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
    let relays = Seen::Channels {
        outputs: Bank::new(0xFF, 0x81),
        inputs: Bank::default(),
    };
    assert_eq!(said(Op::ReadOutputs, "01 01 01 81"), relays);
    let config = Seen::Config {
        address: Some(Address(6)),
        baud: Some(Baud::B19200),
        character: Some(Character::O1),
        checksum: None,
    };
    assert_eq!(said(Op::ReadConfig, "01 03 06 0006 0002 0001"), config);
    let unknown = Seen::Config {
        address: None,
        baud: None,
        character: None,
        checksum: None,
    };
    assert_eq!(said(Op::ReadConfig, "01 03 06 0106 0004 0003"), unknown);
    let refused = Seen::Refused(Refusal::Exception(Exception::FUNCTION));
    assert_eq!(said(Op::ReadConfig, "01 83 01"), refused);
    let on = Op::Write(Bank::new(1, 1));
    assert_eq!(said(on, "01 05 003C FF00"), Seen::Done);
    assert_eq!(host.read_back(&on), Some(Op::ReadOutputs));
    assert!(host.repeatable(&on));
    assert!(!host.repeatable(&Op::Configure(Change::Address(Address(2)))));
}
