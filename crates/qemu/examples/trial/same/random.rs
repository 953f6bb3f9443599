//! Valid requests, damaged ones and noise.

use super::pair::{Count, Pair};
use crate::World;
use crate::dice::Dice;
use railbus_conformance::{CaseStep, all};
use railbus_device::{Family, Layout, Options, Setup};
use railbus_wire::{Address, Protocol, crc16, sum8};

/// A stream has so many bursts.
const BURSTS: usize = 40;

/// A request of a case, and whose it is.
pub(super) type Known = (Family, Protocol, Vec<u8>);

/// The requests of the cases, as something to begin with.
pub(super) fn requests() -> Result<Vec<Known>, String> {
    let mut requests = Vec::new();
    for case in all()? {
        for (_, step) in &case.steps {
            if let CaseStep::Ask(request, _) = step {
                let subject = case.modules.first().ok_or("a case without a module")?;
                let setup = subject.setup;
                requests.push((setup.family, setup.protocol, request.clone()));
            }
        }
    }
    Ok(requests)
}

/// One module's life.
pub(super) fn live(world: &World, seed: u64, requests: &[Known]) -> Result<Count, String> {
    let mut dice = Dice::new(seed);
    let setup = setup(seed, &mut dice);
    let own: Vec<&Vec<u8>> = requests
        .iter()
        .filter(|(family, protocol, _)| (*family, *protocol) == (setup.family, setup.protocol))
        .map(|(_, _, request)| request)
        .collect();
    let mut pair = Pair::new(world, setup, Options::default())?;
    for _ in 0..BURSTS {
        pair.ask(&timeless(setup.family, &own, &mut dice))?;
    }
    Ok(pair.count())
}

fn setup(seed: u64, dice: &mut Dice) -> Setup {
    let family = Family::ALL[(seed % 5) as usize];
    let protocols = family.profile().protocols;
    let setup = Setup {
        protocol: protocols[below(dice, protocols.len())],
        ..Setup::new(family, Address(1))
    };
    match (family, setup.protocol) {
        (Family::R55, _) => Setup {
            layout: Layout::Mixed,
            outputs: 16,
            inputs: 8,
            ..setup
        },
        (_, Protocol::Ascii) => Setup {
            checksum: below(dice, 4) == 0,
            ..setup
        },
        _ => setup,
    }
}

/// A burst that lets nothing run by the clock.
fn timeless(family: Family, own: &[&Vec<u8>], dice: &mut Dice) -> Vec<u8> {
    loop {
        let burst = burst(own, dice);
        if !runs_by_the_clock(family, &burst) {
            return burst;
        }
    }
}

/// Whether something may run by the clock that is looked at elsewhere: a pulse, a jog, a
/// calibration, an address that a board takes for its first ten seconds only.
pub(super) fn runs_by_the_clock(family: Family, burst: &[u8]) -> bool {
    match (family, burst) {
        (Family::R55, bytes) => bytes
            .iter()
            .any(|byte| [0x21, 0x22, 0x37, 0x38, 0x41].contains(byte)),
        (Family::Eda9060a, [b'#', _, _, b'4', ..] | [0x4C, 0x57, _, 0x05, ..]) => true,
        (Family::Eda9060a, [_, 0x10, ..]) => true,
        (Family::Emd2a2q, [_, 0x06, _, 0x05, ..] | [_, 0x10, ..]) => true,
        _ => false,
    }
}

/// A request as it is, damaged, cut off or with another value, or noise.
fn burst(own: &[&Vec<u8>], dice: &mut Dice) -> Vec<u8> {
    let mut bytes = own[below(dice, own.len())].clone();
    match below(dice, 8) {
        0 => {
            let at = below(dice, bytes.len());
            bytes[at] ^= 1 << below(dice, 8);
        }
        1 => bytes.truncate(below(dice, bytes.len())),
        2 => {
            bytes = (0..1 + below(dice, 40))
                .map(|_| below(dice, 256) as u8)
                .collect()
        }
        3 => {
            // Another value with a right seal.
            let at = below(dice, bytes.len());
            bytes[at] = below(dice, 256) as u8;
            reseal(&mut bytes);
        }
        _ => {}
    }
    if bytes.is_empty() { vec![0] } else { bytes }
}

/// Computes what ends a frame anew, by the frame's own protocol.
fn reseal(bytes: &mut [u8]) {
    let count = bytes.len();
    match bytes {
        [0x55, .., last] if count == 8 => *last = 0,
        [0x4C, 0x57, ..] | [b'$' | b'#' | b'%', ..] => return,
        _ => {}
    }
    if let [body @ .., low, high] = bytes
        && body.first() != Some(&0x55)
    {
        [*low, *high] = crc16(body).to_le_bytes();
    } else if let [body @ .., last] = bytes {
        *last = sum8(body);
    }
}

/// A number below the limit, or 0.
fn below(dice: &mut Dice, limit: usize) -> usize {
    dice.next() as usize % limit.max(1)
}
