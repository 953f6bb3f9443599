//! The demo line: five modules, one of each family, at 9600 8N1. Used in the README, the tutorials
//! and many tests.
//!
//! | module | model | address | protocol |
//! |---|---|---|---|
//! | `pump` | EDA9060A | 1 | ASCII |
//! | `gate` | EDA9050 | 2 | LC-02 |
//! | `oven` | ERC-8 | 3 | Modbus RTU |
//! | `yard` | 0x55 board, 8 relays | 4 | 0x55 |
//! | `tank` | EMD-2A2Q-V | 5 | Modbus RTU |
//!
//! Its inputs move by themselves: see [`pump_inputs`], [`gate_inputs`] and [`tank_analogs`].

use crate::{Act, Input, Output, SlotId, VirtualLine, VirtualLineConfig};
use railbus_device::{Eeprom, Family, Options, Setup, SetupError};
use railbus_wire::{Address, Instant, Micros, Protocol};

/// From the end of a request to a module's reply.
const TURNAROUND: Micros = Micros::from_millis(5);

/// How often the inputs are updated.
const STEP: Micros = Micros::from_millis(100);

/// The five modules, by name, in the order of their addresses.
#[must_use]
pub fn modules() -> [(&'static str, Setup); 5] {
    let setup = |family, address| Setup::new(family, Address(address));
    [
        ("pump", setup(Family::Eda9060a, 1)),
        (
            "gate",
            Setup {
                protocol: Protocol::Lc02,
                ..setup(Family::Eda9050, 2)
            },
        ),
        ("oven", setup(Family::Erc8, 3)),
        (
            "yard",
            Setup {
                outputs: 8,
                ..setup(Family::R55, 4)
            },
        ),
        ("tank", setup(Family::Emd2a2q, 5)),
    ]
}

/// The levels at the inputs of `pump`: they count up in binary, one step every 10 s.
#[must_use]
pub const fn pump_inputs(now: Instant) -> u32 {
    (now.0 / 10_000_000 % 16) as u32
}

/// The levels at the inputs of `gate`: one low input moves along the seven, one step every 3 s, and
/// all are high in between.
#[must_use]
pub const fn gate_inputs(now: Instant) -> u32 {
    let step = now.0 / 3_000_000 % 14;
    let all = 0x7F;
    if step.is_multiple_of(2) {
        all
    } else {
        all & !(1 << (step / 2))
    }
}

/// The values at the analog inputs of `tank`, in hundredths of a volt: a level that rises from 1.20
/// V to 8.80 V and falls again within 4 minutes, and a pressure that swings around 5.00 V every 20
/// s.
#[must_use]
pub const fn tank_analogs(now: Instant) -> [i16; 2] {
    let millis = (now.0 / 1_000) as i64;
    let level = 120 + triangle(millis, 240_000) * 760 / 1_000;
    let pressure = 400 + soft(triangle(millis, 20_000)) * 200 / 1_000;
    [level as i16, pressure as i16]
}

/// A triangle from 0 to 1000 and back.
const fn triangle(millis: i64, period: i64) -> i64 {
    let half = period / 2;
    let at = millis % period;
    let up = if at < half { at } else { period - at };
    up * 1_000 / half
}

/// Rounds the corners of a triangle, similar to a sine: 3 x^2 - 2 x^3.
const fn soft(x: i64) -> i64 {
    (3_000 - 2 * x) * x * x / 1_000_000
}

/// The demo line, whose inputs move. Used like [`VirtualLine`].
#[derive(Clone, Debug)]
pub struct Demo {
    line: VirtualLine,
    step_at: Instant,
    pump: SlotId,
    gate: SlotId,
    tank: SlotId,
    shown: Shown,
}

/// The inputs as last set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shown {
    pump: u32,
    gate: u32,
    tank: [i16; 2],
}

impl Shown {
    const fn at(now: Instant) -> Shown {
        Shown {
            pump: pump_inputs(now),
            gate: gate_inputs(now),
            tank: tank_analogs(now),
        }
    }
}

impl Demo {
    /// The demo line, powered up now.
    ///
    /// # Errors
    /// None: the setups of the five modules are valid, which a test checks.
    pub fn new(now: Instant, config: VirtualLineConfig) -> Result<Demo, SetupError> {
        let mut line = VirtualLine::new(config);
        let options = Options {
            turnaround: TURNAROUND,
            ..Options::default()
        };
        let mut add =
            |(name, setup): (&str, Setup)| line.add(now, name, &setup, Eeprom::of(&setup), options);
        let [pump, gate, oven, yard, tank] = modules().map(&mut add);
        let (pump, gate, tank) = (pump?, gate?, tank?);
        oven?;
        yard?;
        let mut demo = Demo {
            line,
            step_at: now,
            pump,
            gate,
            tank,
            shown: Shown {
                pump: 0xF,
                gate: 0x7F,
                tank: [0; 2],
            },
        };
        demo.move_inputs(now);
        Ok(demo)
    }

    /// Passes in what happened, and when.
    pub fn handle(&mut self, now: Instant, input: Input<'_>) {
        self.move_inputs(now);
        self.line.handle(now, input);
    }

    /// The next output.
    pub fn poll(&mut self) -> Output<'_> {
        match self.line.poll() {
            Output::Wait(at) => {
                let first = at.map_or(self.step_at, |at| at.min(self.step_at));
                Output::Wait(Some(first))
            }
            other => other,
        }
    }

    /// The line.
    #[must_use]
    pub const fn line(&self) -> &VirtualLine {
        &self.line
    }

    /// The line, for faults and for actions at a module.
    pub const fn line_mut(&mut self) -> &mut VirtualLine {
        &mut self.line
    }

    /// Updates the inputs that are due.
    fn move_inputs(&mut self, now: Instant) {
        while self.step_at <= now {
            let at = self.step_at;
            self.step_at = at + STEP;
            let (before, after) = (self.shown, Shown::at(at));
            self.shown = after;
            let mut act = |module, act| self.line.handle(at, Input::Act(module, act));
            if before.pump != after.pump {
                act(self.pump, Act::Levels(after.pump));
            }
            if before.gate != after.gate {
                act(self.gate, Act::Levels(after.gate));
            }
            for (channel, (before, after)) in (0..).zip(before.tank.into_iter().zip(after.tank)) {
                if before != after {
                    act(self.tank, Act::Analog(channel, after));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_analogs_move_within_their_bounds() {
        let at = |seconds: u64| tank_analogs(Instant(seconds * 1_000_000));
        assert_eq!(at(0), [120, 400]);
        assert_eq!(at(5), [151, 500]);
        assert_eq!(at(10), [183, 600]);
        assert_eq!(at(120), [880, 400]);
        assert_eq!(at(240), [120, 400]);
    }

    #[test]
    fn the_inputs_move() {
        let gate = |seconds: u64| gate_inputs(Instant(seconds * 1_000_000));
        assert_eq!(
            [gate(0), gate(3), gate(6), gate(9)],
            [0x7F, 0x7E, 0x7F, 0x7D]
        );
        assert_eq!(pump_inputs(Instant(25_000_000)), 2);
    }

    #[test]
    fn the_five_modules_are_possible() {
        assert!(Demo::new(Instant(0), VirtualLineConfig::default()).is_ok());
    }
}
