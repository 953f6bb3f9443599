//! What runs by the clock. Virtual and real time don't agree, so nothing is looked at near its end:
//! while it surely runs still, and when it surely is over.

use super::pair::{Count, Pair};
use crate::World;
use crate::dice::Dice;
use railbus_device::{Family, Options, Setup};
use railbus_wire::{Address, Protocol, crc16, sum8};

/// So long something runs at least, in milliseconds; the few frames before its end are exchanged
/// in a third of that. A busy machine gets a multiple.
const TIME: u64 = 3_000;

/// So often something is begun.
const ROUNDS: u64 = 2;

/// How long a calibration takes at the most.
const CALIBRATION: u64 = 1_500;

/// What there is that runs by the clock.
#[derive(Clone, Copy, Debug)]
pub(super) enum Clock {
    /// Jogs of a 0x55 board [R55 §2.10].
    Jogs,
    /// Pulses of an EDA9060A [EDA9060A §3.1], in a protocol.
    Pulses(Protocol),
    /// The host's watchdog of a Modbus module [BEYOND §1.1].
    Watchdog(Family),
    /// The calibrations of an EMD-2A2Q [EMD-2A2Q §5.1].
    Calibration,
}

impl Clock {
    /// Each kind once.
    pub(super) const ALL: [Clock; 7] = [
        Clock::Jogs,
        Clock::Pulses(Protocol::Ascii),
        Clock::Pulses(Protocol::Lc02),
        Clock::Pulses(Protocol::Rtu),
        Clock::Watchdog(Family::Erc8),
        Clock::Watchdog(Family::Emd2a2q),
        Clock::Calibration,
    ];

    fn setup(self) -> Setup {
        let of = |family| Setup::new(family, Address(1));
        match self {
            Clock::Jogs => Setup {
                outputs: 32,
                ..of(Family::R55)
            },
            Clock::Pulses(protocol) => Setup {
                protocol,
                ..of(Family::Eda9060a)
            },
            Clock::Watchdog(family) => of(family),
            Clock::Calibration => of(Family::Emd2a2q),
        }
    }
}

/// One module's life.
pub(super) fn live(world: &World, clock: Clock, slower: u32) -> Result<Count, String> {
    let options = Options {
        beyond: true,
        ..Options::default()
    };
    let mut pair = Pair::new(world, clock.setup(), options, slower)?;
    let mut dice = Dice::new(1);
    let time = TIME * u64::from(slower);
    for _ in 0..ROUNDS {
        match clock {
            Clock::Jogs => jogs(&mut pair, &mut dice, time),
            Clock::Pulses(protocol) => pulses(&mut pair, &mut dice, time, protocol),
            Clock::Watchdog(_) => watchdog(&mut pair, &mut dice, time, clock.setup()),
            Clock::Calibration => calibration(&mut pair, &mut dice),
        }?;
    }
    Ok(pair.count())
}

/// It still runs, and then it is over; each time it is asked what is.
fn during_and_after(pair: &mut Pair, time: u64, state: &[u8]) -> Result<(), String> {
    pair.wait(time / 3)?;
    pair.ask(state)?;
    pair.wait(time * 3 / 2)?;
    pair.ask(state)
}

/// Jogs of several channels, answered or not, and something that may end one.
fn jogs(pair: &mut Pair, dice: &mut Dice, time: u64) -> Result<(), String> {
    let frame = |code: u64, data: [u8; 4]| {
        let mut frame = vec![0x55, 0x01, code as u8];
        frame.extend(data);
        frame.push(sum8(&frame));
        frame
    };
    for _ in 0..2 {
        let code = [0x21, 0x22, 0x37, 0x38][dice.between(0, 3) as usize];
        let [_, high, middle, low] = (dice.between(time, time * 5 / 4) as u32).to_be_bytes();
        pair.ask(&frame(code, [high, middle, low, dice.between(1, 32) as u8]))?;
    }
    let other = dice.between(0x11, 0x12) + if dice.one_in(2) { 0x20 } else { 0 };
    pair.ask(&frame(other, [0, 0, 0, dice.between(1, 32) as u8]))?;
    during_and_after(pair, time, &frame(0x10, [0; 4]))
}

/// Pulses of some outputs while others stay, begun anew while they run.
fn pulses(pair: &mut Pair, dice: &mut Dice, time: u64, protocol: Protocol) -> Result<(), String> {
    let width = (time / 100).min(200) as u8;
    pair.ask(&eda(
        protocol,
        Say::Pulses(dice.between(1, 15) as u8, width),
    ))?;
    for _ in 0..2 {
        pair.ask(&eda(protocol, Say::Outputs(dice.between(0, 15) as u8)))?;
    }
    during_and_after(pair, time, &eda(protocol, Say::Read))
}

/// The host falls silent: the outputs stay for a while, and go to their safe states.
fn watchdog(pair: &mut Pair, dice: &mut Dice, time: u64, setup: Setup) -> Result<(), String> {
    let outputs = u64::from(setup.output_mask());
    let tenths = (time / 100).min(255) as u8;
    let safe = dice.between(0, outputs) as u8;
    let coil = if setup.family == Family::Erc8 {
        0x3C
    } else {
        8
    };
    pair.ask(&rtu(&[0x06, 0xBE, 0x04, 0, safe]))?;
    pair.ask(&rtu(&[0x06, 0xBE, 0x01, 0, tenths]))?;
    let on = dice.between(0, outputs) as u8;
    pair.ask(&rtu(&[0x0F, 0, coil, 0, setup.outputs, 1, on]))?;
    during_and_after(pair, time, &rtu(&[0x03, 0xBE, 0, 0, 6]))?;
    // It has tripped: nobody switches anything before it is cleared.
    for tried in [
        &[0x0F, 0, coil, 0, setup.outputs, 1, on][..],
        &[0x06, 0xBE, 0x01, 0, 0],
        &[0x06, 0xBE, 0x00, 0, 0],
        &[0x0F, 0, coil, 0, setup.outputs, 1, on],
    ] {
        pair.ask(&rtu(tried))?;
    }
    Ok(())
}

/// Zero and span at other inputs than before, and what the inputs then are.
fn calibration(pair: &mut Pair, dice: &mut Dice) -> Result<(), String> {
    for command in [1, 2] {
        let input = |dice: &mut Dice| dice.between(100 * command, 900) as i16;
        pair.analogs([input(dice), input(dice)])?;
        let [high, low] = (dice.between(1, 2000) as u16).to_be_bytes();
        pair.ask(&rtu(&[0x06, 0, 4, high, low]))?;
        pair.ask(&rtu(&[0x06, 0, 5, 0, command as u8]))?;
        pair.wait(CALIBRATION)?;
        pair.ask(&rtu(&[0x03, 0, 0, 0, 8]))?;
        pair.analogs([input(dice), input(dice)])?;
        pair.ask(&rtu(&[0x03, 0, 6, 0, 2]))?;
    }
    Ok(())
}

/// What one says to an EDA9060A.
enum Say {
    /// These outputs give pulses, so many tenths of a second wide.
    Pulses(u8, u8),
    /// The outputs go into these states.
    Outputs(u8),
    /// How are they?
    Read,
}

fn eda(protocol: Protocol, say: Say) -> Vec<u8> {
    match (protocol, say) {
        (Protocol::Ascii, Say::Pulses(mask, width)) => {
            format!("#014{mask:02X}{width:02X}\r").into_bytes()
        }
        (Protocol::Ascii, Say::Outputs(on)) => format!("#0100{on:02X}\r").into_bytes(),
        (Protocol::Ascii, Say::Read) => b"$016\r".to_vec(),
        (Protocol::Lc02, Say::Pulses(mask, width)) => lc02(&[0x05, mask, width]),
        (Protocol::Lc02, Say::Outputs(on)) => lc02(&[0x04, 0xFF, on]),
        (Protocol::Lc02, Say::Read) => lc02(&[0x03]),
        (_, Say::Pulses(mask, width)) => rtu(&[0x10, 0, 1, 0, 1, 2, mask, width]),
        (_, Say::Outputs(on)) => rtu(&[0x0F, 0, 0, 0, 4, 1, on]),
        (_, Say::Read) => rtu(&[0x01, 0, 0, 0, 4]),
    }
}

fn rtu(pdu: &[u8]) -> Vec<u8> {
    let mut frame = vec![1];
    frame.extend(pdu);
    frame.extend(crc16(&frame).to_le_bytes());
    frame
}

fn lc02(command: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x4C, 0x57, 1];
    frame.extend(command);
    frame.push(sum8(&frame[2..]));
    frame.push(b'\r');
    frame
}
