//! What the tests of both EDA modules have in common.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

use crate::support::{Bench, hex, lc02, with_crc};
use railbus_device::{Family, Module, Observation, Op, Setup};
use railbus_wire::{Address, Protocol};

/// What both modules speak.
pub const PROTOCOLS: [Protocol; 3] = [Protocol::Ascii, Protocol::Lc02, Protocol::Rtu];

pub fn setup(family: Family, protocol: Protocol, address: u8) -> Setup {
    Setup {
        protocol,
        ..Setup::new(family, Address(address))
    }
}

pub fn host(setup: Setup) -> Module {
    Module::new(setup).expect("a possible module")
}

/// What the module reads back, or has at its inputs, as the host understands it.
pub fn read(module: &mut Bench, op: Op) -> u32 {
    match (module.op(op), op) {
        (Some(Observation::Channels { outputs, .. }), Op::ReadOutputs) => outputs.on,
        (Some(Observation::Channels { inputs, .. }), _) => inputs.on,
        other => panic!("{other:?}"),
    }
}

/// Requests get silence, and nothing happens. ASCII is given without its CR, LC-02 from
/// address to data, Modbus without its CRC.
pub fn is_silent_to(module: &mut Bench, requests: &[&str]) {
    for request in requests {
        let frame = match module.setup.protocol {
            Protocol::Ascii => format!("{request}\r").into_bytes(),
            Protocol::Lc02 => lc02(request),
            _ => with_crc(&hex(request)),
        };
        module.ignores(&frame);
    }
}

/// What a module says to ASCII requests, CR apart.
pub fn converse(module: &mut Bench, conversation: &[(&str, &str)]) {
    for (request, reply) in conversation {
        let said = module.ask_text(request);
        assert_eq!(said.as_deref(), Some(*reply), "{request}");
    }
}

/// What a module says to Modbus requests, CRC apart.
pub fn converse_rtu(module: &mut Bench, conversation: &[(&str, &str)]) {
    for (request, reply) in conversation {
        assert_eq!(module.ask_rtu(request), Some(hex(reply)), "{request}");
    }
}
