//! What our own modules do beyond the datasheets.

#[path = "../support/mod.rs"]
mod support;

mod commands;
mod fuzz;
mod numbers;
mod off;
mod standard;
mod watchdog;

use railbus_device::{Eeprom, Extensions, Family, Options, Setup};
use railbus_wire::{Address, Protocol};
use support::Bench;

const ON: Options = Options {
    refuse_aloud: false,
    turnaround: railbus_wire::Micros::ZERO,
    applies: railbus_device::Applies::AfterReply,
    lower_case: false,
    answer_bad_frames: false,
    insist_on_gap: false,
    extensions: true,
};

/// Every family in every protocol it speaks, at address 1, with eight outputs where that varies.
fn setups() -> impl Iterator<Item = Setup> {
    let all = Family::ALL.into_iter();
    all.flat_map(|family| {
        let protocols = family.profile().protocols.iter();
        protocols.map(move |protocol| setup(family, *protocol))
    })
}

fn setup(family: Family, protocol: Protocol) -> Setup {
    let setup = Setup::new(family, Address(1));
    Setup {
        protocol,
        outputs: setup.outputs.min(8),
        ..setup
    }
}

fn module(setup: Setup, extensions: Extensions) -> Bench {
    let eeprom = Eeprom {
        extensions,
        ..Eeprom::of(&setup)
    };
    Bench::with(setup, eeprom, ON)
}

/// Watches for half a second; the first output is safe on, the second on at power-up.
const HALF_SECOND: Extensions = Extensions {
    watchdog: 5,
    power_on: 0b10,
    safe: 0b01,
    tripped: false,
};

/// A number from 0 on, below `end`: SplitMix64 of a seed.
fn dice(state: &mut u64, end: u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ z >> 31) % end
}
