//! A module of a stage, and manual changes to it.

use crate::active_faults::ActiveFaults;
use railbus_device::{Eeprom, Point, PointKind, Setup};
use railbus_sim::{Act, Input, SlotId, VirtualLine};
use railbus_site::config::{Signal, Swing};
use railbus_wire::{Address, Instant};
use std::collections::BTreeMap;

/// A module and the manual changes to it.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    pub(crate) name: String,
    pub(crate) setup: Setup,
    pub(crate) faults: ActiveFaults,
    pub(super) id: SlotId,
    /// The automatic signals at the inputs.
    pub(super) script: BTreeMap<Point, Signal>,
    /// Manual values that replace some of them.
    pub(super) by_hand: BTreeMap<Point, Signal>,
    pub(super) levels: u32,
    pub(super) analogs: [i16; 2],
    /// It reads INIT* only at power-up.
    pub(super) init_at_power_up: bool,
    /// The level of INIT* that it has not read yet.
    pub(super) init_unseen: Option<bool>,
    /// It is to be powered, unless a fault prevents it.
    pub(super) wanted_power: bool,
    pub(super) has_power: bool,
    /// Its address before a fault changed it.
    pub(super) own_address: Option<Address>,
}

impl Part {
    pub(crate) const fn id(&self) -> SlotId {
        self.id
    }

    /// The module's stored settings, without the address given by a fault.
    pub(crate) fn kept(&self, line: &VirtualLine) -> Eeprom {
        let eeprom = *line.engine(self.id).eeprom();
        let address = self.own_address.unwrap_or(eeprom.address);
        Eeprom { address, ..eeprom }
    }

    pub(crate) const fn levels(&self) -> u32 {
        self.levels
    }

    pub(crate) const fn analogs(&self) -> [i16; 2] {
        self.analogs
    }

    /// Power-up: the level at INIT* takes effect.
    pub(super) fn look_at_init(&mut self, now: Instant, line: &mut VirtualLine) {
        if let Some(grounded) = self.init_unseen.take() {
            line.handle(now, Input::Act(self.id, Act::Init(grounded)));
        }
    }

    /// Whether an input changes automatically.
    pub(super) fn moves(&self) -> bool {
        let mut signals = self.signals();
        signals.any(|(_, signal)| !matches!(signal, Signal::Level(_) | Signal::Value(_)))
    }

    /// Whether this input was set manually.
    pub(crate) fn is_by_hand(&self, point: Point) -> bool {
        self.by_hand.contains_key(&point)
    }

    /// The value at the inputs: manual, otherwise automatic.
    fn signals(&self) -> impl Iterator<Item = (Point, Signal)> {
        let left = |(point, _): &(&Point, &Signal)| !self.by_hand.contains_key(point);
        let script = self.script.iter().filter(left);
        script
            .chain(&self.by_hand)
            .map(|(point, signal)| (*point, *signal))
    }

    /// Updates the inputs.
    pub(super) fn move_inputs(&mut self, at: Instant, line: &mut VirtualLine) {
        // An unconnected input is open.
        let (mut levels, mut analogs) = (self.setup.input_mask(), [0; 2]);
        for (point, signal) in self.signals() {
            match (point.kind, signal_at(signal, at)) {
                (PointKind::Analog, value) => {
                    if let Some(analog) = analogs.get_mut(usize::from(point.index)) {
                        *analog = value;
                    }
                }
                (_, 0) => levels &= !(1 << point.index),
                (_, _) => levels |= 1 << point.index,
            }
        }
        for (index, (value, before)) in (0..).zip(analogs.into_iter().zip(self.analogs)) {
            if value != before {
                line.handle(at, Input::Act(self.id, Act::Analog(index, value)));
            }
        }
        self.analogs = analogs;
        if levels != self.levels {
            self.levels = levels;
            line.handle(at, Input::Act(self.id, Act::Levels(levels)));
        }
    }
}

/// The value of a signal at a moment: hundredths, or 0 for low and 1 for high.
fn signal_at(signal: Signal, at: Instant) -> i16 {
    match signal {
        Signal::Level(high) => high.into(),
        Signal::Value(hundredths) => hundredths,
        Signal::Toggle(every) => (at.0 / every.0.max(1) % 2) as i16,
        Signal::Blink(blink) => {
            let begun = at.0.checked_sub(blink.after.0);
            begun.is_none_or(|begun| begun % blink.every.0.max(1) >= blink.low.0) as i16
        }
        Signal::Swing(swing) => swing_at(swing, at),
    }
}

fn swing_at(swing: Swing, at: Instant) -> i16 {
    let half = (swing.every.0 / 2).max(1);
    let passed = at.0 % (2 * half);
    let up = if passed < half {
        passed
    } else {
        2 * half - passed
    };
    let way = f64::from(swing.to) - f64::from(swing.from);
    let part = up as f64 / half as f64;
    let part = match swing.soft {
        // 3 x^2 - 2 x^3 has no corners.
        true => part * part * (3.0 - 2.0 * part),
        false => part,
    };
    (f64::from(swing.from) + way * part) as i16
}
