//! What depends on the clock. Virtual and real time don't agree, so nothing is checked near its
//! end: only while it is certainly still running, and when it is certainly over.

use super::pair::{Count, Pair};
use crate::World;
use crate::dice::Dice;
use railbus_conformance::bytes;
use railbus_device::{Family, Options, Setup};
use railbus_wire::{Address, Protocol};

/// So long something runs at least, in milliseconds; the few frames before its end are exchanged
/// in a third of that, by the board's clock.
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
pub(super) fn live(world: &World, clock: Clock) -> Result<Count, String> {
    let options = Options {
        extensions: true,
        ..Options::default()
    };
    let mut pair = Pair::new(world, clock.setup(), options)?;
    let mut dice = Dice::new(1);
    for _ in 0..ROUNDS {
        match clock {
            Clock::Jogs => jogs(&mut pair, &mut dice, TIME),
            Clock::Pulses(protocol) => pulses(&mut pair, &mut dice, TIME, protocol),
            Clock::Watchdog(_) => watchdog(&mut pair, &mut dice, TIME, clock.setup()),
            Clock::Calibration => calibration(&mut pair, &mut dice),
        }?;
    }
    Ok(pair.count())
}

/// It still runs, and then it is over; each time it is asked what is.
fn during_and_after(pair: &mut Pair, time: u64, state: &str) -> Result<(), String> {
    pair.wait(time / 3)?;
    ask(pair, state)?;
    pair.wait(time * 3 / 2)?;
    ask(pair, state)
}

/// Jogs of several channels, answered or not, and something that may end one.
fn jogs(pair: &mut Pair, dice: &mut Dice, time: u64) -> Result<(), String> {
    for _ in 0..2 {
        let code = [0x21, 0x22, 0x37, 0x38][dice.between(0, 3) as usize];
        let (jog, channel) = (dice.between(time, time * 5 / 4), dice.between(1, 32));
        ask(
            pair,
            &format!("55 01 {code:02X} {jog:06X} {channel:02X} sum"),
        )?;
    }
    let other = dice.between(0x11, 0x12) + if dice.one_in(2) { 0x20 } else { 0 };
    let channel = dice.between(1, 32);
    ask(pair, &format!("55 01 {other:02X} 000000 {channel:02X} sum"))?;
    during_and_after(pair, time, "55 01 10 00000000 sum")
}

/// Pulses of some outputs while others stay, begun anew while they run.
fn pulses(pair: &mut Pair, dice: &mut Dice, time: u64, protocol: Protocol) -> Result<(), String> {
    let width = (time / 100).min(200) as u8;
    let mask = dice.between(1, 15);
    ask(
        pair,
        &match protocol {
            Protocol::Ascii => format!("\"#014{mask:02X}{width:02X}\" cr"),
            Protocol::Lc02 => format!("4C57 01 05 {mask:02X} {width:02X} sum cr"),
            _ => format!("01 10 0001 0001 02 {mask:02X} {width:02X} crc"),
        },
    )?;
    for _ in 0..2 {
        let on = dice.between(0, 15);
        ask(
            pair,
            &match protocol {
                Protocol::Ascii => format!("\"#0100{on:02X}\" cr"),
                Protocol::Lc02 => format!("4C57 01 04 FF {on:02X} sum cr"),
                _ => format!("01 0F 0000 0004 01 {on:02X} crc"),
            },
        )?;
    }
    let read = match protocol {
        Protocol::Ascii => "\"$016\" cr",
        Protocol::Lc02 => "4C57 01 03 sum cr",
        _ => "01 01 0000 0004 crc",
    };
    during_and_after(pair, time, read)
}

/// The host stops: the outputs stay for a while, and go to their safe states.
fn watchdog(pair: &mut Pair, dice: &mut Dice, time: u64, setup: Setup) -> Result<(), String> {
    let outputs = u64::from(setup.output_mask());
    let tenths = (time / 100).min(255);
    let safe = dice.between(0, outputs);
    let on = dice.between(0, outputs);
    let (first, count) = (
        if setup.family == Family::Erc8 { 60 } else { 8 },
        setup.outputs,
    );
    let switch = format!("01 0F {first:04X} {count:04X} 01 {on:02X} crc");
    ask(pair, &format!("01 06 BE04 {safe:04X} crc"))?;
    ask(pair, &format!("01 06 BE01 {tenths:04X} crc"))?;
    ask(pair, &switch)?;
    during_and_after(pair, time, "01 03 BE00 0006 crc")?;
    // It has tripped: no output can be switched before it is cleared.
    for tried in [
        &switch,
        "01 06 BE01 0000 crc",
        "01 06 BE00 0000 crc",
        &switch,
    ] {
        ask(pair, tried)?;
    }
    Ok(())
}

/// Zero and span at other inputs than before, and what the inputs then are.
fn calibration(pair: &mut Pair, dice: &mut Dice) -> Result<(), String> {
    for command in [1, 2] {
        let input = |dice: &mut Dice| dice.between(100 * command, 900) as i16;
        pair.analogs([input(dice), input(dice)])?;
        let voltage = dice.between(1, 2000);
        ask(pair, &format!("01 06 0004 {voltage:04X} crc"))?;
        ask(pair, &format!("01 06 0005 {command:04X} crc"))?;
        pair.wait(CALIBRATION)?;
        ask(pair, "01 03 0000 0008 crc")?;
        pair.analogs([input(dice), input(dice)])?;
        ask(pair, "01 03 0006 0002 crc")?;
    }
    Ok(())
}

/// Asks both, in the words of the cases.
fn ask(pair: &mut Pair, frame: &str) -> Result<(), String> {
    pair.ask(&bytes(frame)?)
}
