//! What EDA9060A and EDA9050 share: the numbered facts of `docs/datasheets/eda.md`, on both
//! modules and in all three protocols.

mod ascii;
#[path = "../support/eda.rs"]
mod eda;
mod engine;
mod lc02;
mod line;
mod rtu;
#[path = "../support/mod.rs"]
mod support;

use eda::{PROTOCOLS, converse, host, is_silent_to, setup};
use railbus_device::{Applies, Bank, Eeprom, Effect, Family, Op, Options, SettingWrite};
use railbus_device::{Observation, Refusal, Setup, SetupError};
use railbus_wire::{Address, Baud, Channel, Character, Decoded, Malformed, Micros, Protocol};
use railbus_wire::{SerialSettings, crc16, lc02::envelope, rtu::Exception, sum8};
use support::{Bench, hex, lc02, request, sealed, seen, with_crc};

const BOTH: [Family; 2] = [Family::Eda9060a, Family::Eda9050];
/// Both modules at an address, in one protocol.
fn both(protocol: Protocol, address: u8) -> impl Iterator<Item = Bench> {
    BOTH.map(|family| Bench::new(setup(family, protocol, address)))
        .into_iter()
}

/// Both modules at address 1, in each protocol.
fn all() -> impl Iterator<Item = Bench> {
    PROTOCOLS.into_iter().flat_map(|protocol| both(protocol, 1))
}

/// Both modules at address 1, in ASCII with checksum.
fn sealing() -> impl Iterator<Item = Bench> {
    BOTH.into_iter().map(|family| {
        Bench::new(Setup {
            checksum: true,
            ..setup(family, Protocol::Ascii, 1)
        })
    })
}

fn with(setup: Setup, options: Options) -> Bench {
    Bench::with(setup, Eeprom::of(&setup), options)
}

const ALOUD: Options = Options {
    refuse_aloud: true,
    turnaround: Micros::ZERO,
    applies: Applies::AfterReply,
    lower_case: false,
    answer_bad_frames: false,
    insist_on_gap: false,
    extensions: false,
};

/// A configuration write; only ASCII has the checksum setting in it.
fn write_config(protocol: Protocol, from: u8, to: u8, code: u8, checksum: bool) -> Vec<u8> {
    let format = if checksum { "40" } else { "00" };
    match protocol {
        Protocol::Ascii => format!("%{from:02X}{to:02X}40{code:02X}{format}\r").into_bytes(),
        Protocol::Lc02 => lc02(&format!("{from:02X} 02 {to:02X} {code:02X} 00")),
        _ => with_crc(&hex(&format!(
            "{from:02X} 10 0000 0001 02 {to:02X}{code:02X}"
        ))),
    }
}

fn every_output(bench: &Bench) -> Op {
    let all = bench.setup.output_mask();
    Op::Write(Bank::new(all, all))
}

fn serial(address: u8, baud: Baud, checksum: bool) -> Op {
    Op::Configure(SettingWrite::Serial {
        address: Address(address),
        baud,
        checksum,
    })
}

/// The request with each of its bits inverted in turn.
fn damaged(request: &[u8]) -> impl Iterator<Item = Vec<u8>> + use<> {
    let request = request.to_vec();
    (0..8 * request.len()).map(move |bit| {
        let mut frame = request.clone();
        frame[bit / 8] ^= 1 << (bit % 8);
        frame
    })
}
