//! 0x55/0x22 boards, by the numbered facts of `docs/datasheets/r55.md`. Descriptions are in
//! `setup.rs`.

#[path = "../support/mod.rs"]
mod support;

mod frames;
mod functions;
mod host;
mod settings;

use railbus_device::{
    Applies, Bank, Eeprom, Effect, Family, Input, Layout, Module, Observation, Op, Options,
    SettingWrite, Setup, board_address,
};
use railbus_wire::r55::{self, U24};
use railbus_wire::{Address, Channel, Exchange, Instant, Micros, Reply, SerialSettings, sum8};
use support::{Bench, hex, request, seen};

fn setup(layout: Layout, outputs: u8, inputs: u8) -> Setup {
    Setup {
        layout,
        outputs,
        inputs,
        ..Setup::new(Family::R55, Address(1))
    }
}

/// A board with this many relays at address 1.
fn relays(count: u8) -> Bench {
    Bench::new(setup(Layout::Outputs, count, 0))
}

/// A board with 32 relays, of which these are on.
fn with_on(on: u32) -> Bench {
    let mut board = relays(32);
    board.ask_r55(&format!("01 33 {on:08X}"));
    assert_eq!(board.engine.outputs(), on);
    board.did();
    board
}

fn host(setup: Setup) -> Module {
    Module::new(setup).expect("such a board")
}

/// A request with its start and sum.
fn frame(text: &str) -> Vec<u8> {
    let mut frame = vec![0x55];
    frame.extend(hex(text));
    frame.push(sum8(&frame));
    frame
}

/// Several requests without a gap.
fn chain(texts: &[&str]) -> Vec<u8> {
    texts.iter().flat_map(|text| frame(text)).collect()
}

/// The reply of board 1 with its start and sum.
fn reply(code: u8, word: u32) -> Vec<u8> {
    let mut frame = vec![0x22, 0x01, code];
    frame.extend(word.to_be_bytes());
    frame.push(sum8(&frame));
    frame
}

fn outputs_told(board: &mut Bench) -> Vec<(Instant, u8, bool)> {
    let output = |(at, effect)| match effect {
        Effect::Output { channel, on } => (at, channel, on),
        other => panic!("{other:?} is no change of an output"),
    };
    board.did().into_iter().map(output).collect()
}

const SECOND: Micros = Micros::from_secs(1);
