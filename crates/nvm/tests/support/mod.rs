//! What the tests of this crate have in common: random numbers, records, and models of a byte
//! EEPROM and of a NOR flash that may lose their power at any byte.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

pub mod chip;
pub mod nor;

use proptest::prelude::*;
use railbus_device::{
    AnalogCalibration, Applies, Eeprom, Extensions, Family, Layout, Options, Setup,
};
use railbus_nvm::Record;
use railbus_wire::{Address, Micros, Protocol, PulseWidth, SerialSettings};

/// Random numbers from a seed (SplitMix64).
#[derive(Clone, Debug)]
pub struct Rng(pub u64);

impl Rng {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }
}

/// A module of this family as it leaves the factory, at this address.
pub fn factory(family: Family, address: u8) -> Record {
    Record::factory(&Setup::new(family, Address(address))).expect("a possible module")
}

/// The records of a module whose address is changed again and again.
pub fn history(len: u8) -> Vec<Record> {
    (1..=len)
        .map(|address| factory(Family::Eda9060a, address))
        .collect()
}

/// Any module that can be kept.
pub fn record() -> impl Strategy<Value = Record> {
    (setup(), options(), eeprom()).prop_filter_map("no such module", |(setup, options, eeprom)| {
        let eeprom = Eeprom {
            address: setup.address,
            protocol: setup.protocol,
            serial: setup.serial,
            ..eeprom
        };
        Record::new(&setup, options, eeprom).ok()
    })
}

fn setup() -> impl Strategy<Value = Setup> {
    let layouts = vec![Layout::Outputs, Layout::Inputs, Layout::Mixed];
    let parts = (
        prop::sample::select(Family::ALL.to_vec()),
        any::<[u8; 4]>(),
        (0..=32_u8, 0..=32_u8, 0..=32_u8),
        prop::sample::select(layouts),
        any::<bool>(),
        prop::option::of(0..=u64::from(u32::MAX)),
    );
    parts.prop_map(|(family, picks, channels, layout, invert, gap)| {
        let [address, protocol, baud, character] = picks;
        let profile = family.profile();
        let (bauds, characters) = (profile.bauds, profile.characters);
        let serial = SerialSettings {
            baud: bauds[usize::from(baud) % bauds.len()].1,
            character: characters[usize::from(character) % characters.len()].1,
        };
        let mut setup = Setup {
            protocol: profile.protocols[usize::from(protocol) % profile.protocols.len()],
            serial,
            invert_on_off: invert,
            gap: gap.map(Micros),
            ..Setup::new(family, Address(address))
        };
        if family == Family::R55 {
            let (outputs, inputs, variables) = channels;
            let (outputs, inputs) = match layout {
                Layout::Outputs => (outputs, 0),
                Layout::Inputs => (0, inputs),
                Layout::Mixed => (outputs / 2, inputs / 2),
            };
            setup = Setup {
                outputs,
                inputs,
                variables,
                layout,
                ..setup
            };
        }
        setup
    })
}

fn options() -> impl Strategy<Value = Options> {
    let applies = vec![
        Applies::AfterReply,
        Applies::AfterRestart,
        Applies::AddressAfterReply,
    ];
    let applies = prop::sample::select(applies);
    (applies, any::<[bool; 5]>(), any::<u32>()).prop_map(|(applies, switches, turnaround)| {
        let [
            refuse_aloud,
            lower_case,
            answer_bad_frames,
            insist_on_gap,
            extensions,
        ] = switches;
        Options {
            turnaround: Micros(turnaround.into()),
            applies,
            refuse_aloud,
            lower_case,
            answer_bad_frames,
            insist_on_gap,
            extensions,
        }
    })
}

fn eeprom() -> impl Strategy<Value = Eeprom> {
    let calibration = (any::<u16>(), any::<[i16; 2]>(), any::<[(u16, u16); 2]>());
    let extensions = (any::<u8>(), any::<u32>(), any::<u32>(), any::<bool>());
    let pulses = (any::<u8>(), 1..=200_u8);
    (any::<bool>(), pulses, calibration, extensions).prop_map(
        |(checksum, pulses, kept, extensions)| {
            let (voltage, zero, span) = kept;
            let (watchdog, power_on, safe, tripped) = extensions;
            Eeprom {
                address: Address(1),
                serial: SerialSettings::FACTORY,
                protocol: Protocol::Rtu,
                checksum,
                pulse_mask: pulses.0,
                pulse_width: PulseWidth::from_tenths(pulses.1).expect("1 to 200"),
                calibration: AnalogCalibration {
                    voltage,
                    zero,
                    span,
                },
                extensions: Extensions {
                    watchdog,
                    power_on,
                    safe,
                    tripped,
                },
            }
        },
    )
}
