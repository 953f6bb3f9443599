//! The committed frames as what passes on a line: each module hears all of those in its protocol,
//! requests for itself and for others, what others answered, misprints and what other makers'
//! boards say.

use super::pair::{Count, Pair};
use super::random::runs_by_the_clock;
use crate::World;
use crate::site::said;
use railbus_device::{Family, Options, Setup};
use railbus_wire::{Address, Protocol};
use serde_json::Value;

/// Every family in every protocol that it speaks.
pub(super) fn setups() -> impl Iterator<Item = Setup> {
    let of = |family: Family| {
        let protocols = family.profile().protocols.iter();
        protocols.map(move |protocol| Setup {
            protocol: *protocol,
            ..Setup::new(family, Address(1))
        })
    };
    Family::ALL.into_iter().flat_map(of)
}

/// One module hears a file of frames, from first to last.
pub(super) fn live(world: &World, setup: Setup) -> Result<Count, String> {
    let mut pair = Pair::new(world, setup, Options::default())?;
    for frame in frames(setup.protocol)? {
        if !runs_by_the_clock(setup.family, &frame) {
            pair.ask(&frame)?;
        }
    }
    Ok(pair.count())
}

fn frames(protocol: Protocol) -> Result<Vec<Vec<u8>>, String> {
    let name = match protocol {
        Protocol::Rtu => "rtu",
        Protocol::Ascii => "ascii",
        Protocol::Lc02 => "lc02",
        Protocol::R55 => "r55",
    };
    let path = railbus_conformance::folder().join(format!("../{name}.json"));
    let text = std::fs::read_to_string(&path).map_err(said)?;
    let vectors: Vec<Value> = serde_json::from_str(&text).map_err(said)?;
    vectors.iter().map(bytes).collect()
}

fn bytes(vector: &Value) -> Result<Vec<u8>, String> {
    let hex = vector["hex"].as_str().ok_or("a vector without bytes")?;
    let bytes = hex
        .split_whitespace()
        .map(|two| u8::from_str_radix(two, 16));
    bytes.collect::<Result<_, _>>().map_err(said)
}
