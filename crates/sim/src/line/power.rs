//! Actions at a module, and random losses of power.

use super::VirtualLine;
use crate::slot::Slot;
use crate::talk::{NEVER, State, Talker};
use crate::{Act, Power, SlotId, TraceDirection};
use railbus_device::{Eeprom, Effect, Input};
use railbus_wire::{Instant, Micros};

impl VirtualLine {
    pub(super) fn act(&mut self, at: Instant, module: SlotId, act: Act) {
        self.hand_out_ended(at);
        let eeprom = *self.slots[module.0].engine.eeprom();
        match act {
            Act::Power(Power::Off) => self.power_off(module, at, eeprom),
            Act::Power(Power::On) => self.power_on(module, at),
            Act::Power(Power::Cycle) => self.restart(module, at, eeprom),
            Act::Rewrite(eeprom) => self.restart(module, at, eeprom),
            Act::FactoryReset => {
                let factory = self.slots[module.0].factory();
                self.restart(module, at, factory);
            }
            Act::Babble(time) => self.babble_module(module, at, time),
            Act::Levels(_) | Act::Analog(..) | Act::Init(_) | Act::Dip(_) | Act::Stuck(_) => {
                if let Some(input) = self.slots[module.0].touch(act) {
                    self.note_touch(module, at, act);
                    self.tell_if_powered(module, at, input);
                }
            }
        }
    }

    /// A module's deadline: its reply has been sent, its power changes, or its engine has asked for
    /// it.
    pub(super) fn wake(&mut self, module: SlotId, at: Instant) {
        let slot = &mut self.slots[module.0];
        if slot.power_at <= at {
            self.chance_of_power(module, at);
        } else if slot.sent_at <= at {
            slot.sent_at = NEVER;
            self.tell(module, at, Input::Sent);
        } else {
            self.tell_if_powered(module, at, Input::Timeout);
        }
    }

    fn tell_if_powered(&mut self, module: SlotId, at: Instant, input: Input<'_>) {
        if self.slots[module.0].powered {
            self.tell(module, at, input);
        } else {
            self.slots[module.0].handle(at, input);
            self.wakes[module.0] = self.slots[module.0].power_at;
        }
    }

    fn restart(&mut self, module: SlotId, at: Instant, eeprom: Eeprom) {
        self.power_off(module, at, eeprom);
        self.power_on(module, at);
    }

    /// Switches the power off: outputs drop, a character being sent is truncated, and everything
    /// not in the EEPROM is lost.
    fn power_off(&mut self, module: SlotId, at: Instant, eeprom: Eeprom) {
        self.note(
            at,
            Talker::Module(module),
            TraceDirection::Panel,
            "power off",
            &[],
        );
        let slot = &mut self.slots[module.0];
        let outputs = slot.engine.outputs();
        slot.powered = false;
        slot.power_at = NEVER;
        slot.restart(at, eeprom);
        self.wakes[module.0] = NEVER;
        for talk in &mut self.talks {
            if talk.who == Talker::Module(module) && talk.state != State::Over {
                talk.end_early(at);
            }
        }
        for channel in (0..32).filter(|channel| outputs >> channel & 1 == 1) {
            self.effect(module, at, Effect::Output { channel, on: false });
        }
    }

    fn power_on(&mut self, module: SlotId, at: Instant) {
        if self.slots[module.0].powered {
            return;
        }
        self.note(
            at,
            Talker::Module(module),
            TraceDirection::Panel,
            "power on",
            &[],
        );
        let slot = &mut self.slots[module.0];
        slot.powered = true;
        slot.counts.restarts += 1;
        let eeprom = *slot.engine.eeprom();
        slot.restart(at, eeprom);
        self.plan_power_cut(module, at);
        self.drain(module, at);
    }

    /// Switches a module's power off or on at random.
    fn chance_of_power(&mut self, module: SlotId, at: Instant) {
        let Slot {
            powered,
            faults,
            engine,
            ..
        } = &self.slots[module.0];
        if !powered {
            self.power_on(module, at);
            return;
        }
        let (eeprom, away) = (*engine.eeprom(), faults.cut_for);
        self.injected.cuts += 1;
        self.power_off(module, at, eeprom);
        let back_at = at + self.random.within(away);
        self.slots[module.0].power_at = back_at;
        self.wakes[module.0] = back_at;
    }

    pub(super) fn plan_power_cut(&mut self, module: SlotId, at: Instant) {
        let slot = &mut self.slots[module.0];
        slot.power_at = match slot.faults.cut_every {
            Some(mean) => at + self.random.around(mean),
            None => NEVER,
        };
        let wake = &mut self.wakes[module.0];
        *wake = (*wake).min(slot.power_at);
    }

    fn babble_module(&mut self, module: SlotId, at: Instant, time: Micros) {
        let slot = &self.slots[module.0];
        let settings = slot.engine.active().serial;
        if slot.powered {
            self.talk_garbage(Talker::Module(module), settings, at, time);
        }
    }

    fn note_touch(&mut self, module: SlotId, at: Instant, act: Act) {
        let (event, number) = match act {
            Act::Levels(levels) => ("levels", Some(levels.into())),
            Act::Analog(0, value) => ("analog 1", u64::try_from(value).ok()),
            Act::Analog(_, value) => ("analog 2", u64::try_from(value).ok()),
            Act::Init(grounded) => ("init", Some(grounded.into())),
            Act::Dip(dip) => ("dip", Some(dip.into())),
            Act::Stuck(mask) => ("stuck", Some(mask.into())),
            Act::Power(_) | Act::Rewrite(_) | Act::FactoryReset | Act::Babble(_) => return,
        };
        let who = Talker::Module(module);
        self.note_number(at, who, TraceDirection::Panel, event, number, &[]);
    }
}
