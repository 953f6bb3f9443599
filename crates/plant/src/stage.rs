//! One line of a plant in virtual time: its modules, changing inputs, and faults that come and go.
//! The same shape as [`VirtualLine`]; there is no clock here.

mod part;
#[cfg(test)]
mod tests;

pub(super) use part::Part;

use super::active_faults::ActiveFaults;
use railbus_device::{Eeprom, Point, Setup, SetupError};
use railbus_sim::{Act, Input, Output, Power, VirtualLine, VirtualLineConfig};
use railbus_site::config::{FaultOrder, InjectedFault, Signal, SimModule};
use railbus_wire::{Address, Instant, Micros, Protocol, SerialSettings};
use std::collections::BTreeMap;

/// Update interval of changing inputs.
const STEP: Micros = Micros::from_millis(100);
/// Planned duration of babble that ends only on command.
const FOREVER: Micros = Micros(u64::MAX);

/// A line and its environment.
#[derive(Clone, Debug)]
pub(super) struct Stage {
    name: String,
    line: VirtualLine,
    serial: SerialSettings,
    faults: ActiveFaults,
    parts: Vec<Part>,
    step_at: Instant,
}

/// The target of faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FaultTarget {
    Line,
    Module(usize),
}

/// A manual action at a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ManualAction {
    /// Sets an input, or releases it.
    Input(Point, Option<Signal>),
    Power(Power),
    Dip(u8),
    /// Grounds INIT*, or opens it.
    Init(bool),
    /// Changes the protocol, as only the manufacturer's software can.
    Protocol(Protocol),
    /// Restores the factory settings.
    Reset,
}

impl Stage {
    /// A line with nothing on it.
    pub(super) fn new(name: &str, config: VirtualLineConfig, serial: SerialSettings) -> Stage {
        Stage {
            name: name.to_owned(),
            line: VirtualLine::new(config),
            serial,
            faults: ActiveFaults::default(),
            parts: Vec::new(),
            step_at: Instant(0),
        }
    }

    /// Adds a module at the start. Its state from an earlier run takes precedence.
    pub(super) fn add(
        &mut self,
        name: &str,
        setup: &Setup,
        sim: &SimModule,
        kept: Option<Eeprom>,
    ) -> Result<(), SetupError> {
        let now = Instant(0);
        let start = match sim.factory {
            true => as_new(setup),
            false => *setup,
        };
        let eeprom = kept.unwrap_or(Eeprom::of(&start));
        let id = self.line.add(now, name, &start, eeprom, sim.options)?;
        let mut part = Part {
            name: name.to_owned(),
            setup: *setup,
            faults: ActiveFaults::default(),
            id,
            script: sim.inputs.clone(),
            by_hand: BTreeMap::new(),
            levels: setup.input_mask(),
            analogs: [0; 2],
            init_at_power_up: sim.init_at_power_up,
            init_unseen: None,
            wanted_power: sim.powered,
            has_power: true,
            own_address: None,
        };
        let acts = [
            sim.init.map(Act::Init),
            (sim.dip != 0).then_some(Act::Dip(sim.dip)),
        ];
        for act in acts.into_iter().flatten() {
            self.line.handle(now, Input::Act(id, act));
        }
        part.move_inputs(now, &mut self.line);
        self.parts.push(part);
        let index = self.parts.len() - 1;
        self.power(now, index);
        for order in &sim.faults {
            self.add_fault(now, FaultTarget::Module(index), order);
        }
        Ok(())
    }

    /// Reports an event and its time to the line.
    pub(super) fn handle(&mut self, now: Instant, input: Input<'_>) {
        self.catch_up(now);
        self.line.handle(now, input);
    }

    /// The next output.
    pub(super) fn poll(&mut self) -> Output<'_> {
        let own = self.next_change();
        match self.line.poll() {
            Output::Wait(at) => Output::Wait(at.into_iter().chain(own).min()),
            other => other,
        }
    }

    pub(super) const fn line(&self) -> &VirtualLine {
        &self.line
    }

    pub(super) const fn line_mut(&mut self) -> &mut VirtualLine {
        &mut self.line
    }

    /// The settings of a master that sends these characters at this speed over a PTY, which has no
    /// parity: those of the addressed module, otherwise those of the line.
    pub(super) fn settings_for(&self, bytes: &[u8], of_port: SerialSettings) -> SerialSettings {
        let modules = self.line.addressed(bytes);
        let mut serials = modules.map(|module| self.line.engine(module).active().serial);
        let fitting = serials.find(|serial| serial.baud == of_port.baud);
        fitting.unwrap_or(of_port)
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn parts(&self) -> &[Part] {
        &self.parts
    }

    pub(super) const fn serial(&self) -> SerialSettings {
        self.serial
    }

    /// Carries out a manual action.
    pub(super) fn act(&mut self, now: Instant, index: usize, deed: ManualAction) {
        self.catch_up(now);
        let Some(part) = self.parts.get_mut(index) else {
            return;
        };
        let id = part.id;
        match deed {
            ManualAction::Input(point, signal) => {
                match signal {
                    Some(signal) => part.by_hand.insert(point, signal),
                    None => part.by_hand.remove(&point),
                };
                part.move_inputs(now, &mut self.line);
            }
            ManualAction::Dip(dip) => self.line.handle(now, Input::Act(id, Act::Dip(dip))),
            ManualAction::Init(grounded) if part.init_at_power_up && part.has_power => {
                part.init_unseen = Some(grounded);
            }
            ManualAction::Init(grounded) => {
                part.init_unseen = None;
                self.line.handle(now, Input::Act(id, Act::Init(grounded)));
            }
            ManualAction::Power(power) => {
                part.wanted_power = power != Power::Off;
                if power == Power::Cycle && part.has_power {
                    part.has_power = false;
                    self.line
                        .handle(now, Input::Act(id, Act::Power(Power::Off)));
                }
                self.power(now, index);
            }
            ManualAction::Protocol(protocol) => {
                let eeprom = *self.line.engine(id).eeprom();
                let eeprom = Eeprom {
                    protocol,
                    checksum: eeprom.checksum && protocol == Protocol::Ascii,
                    ..eeprom
                };
                self.rewrite(now, index, Act::Rewrite(eeprom));
            }
            ManualAction::Reset => {
                part.own_address = None;
                self.rewrite(now, index, Act::FactoryReset);
            }
        }
    }

    /// Adds a fault.
    pub(super) fn add_fault(&mut self, now: Instant, target: FaultTarget, order: &FaultOrder) {
        let replies = self.replies(target);
        self.change_faults(now, target, |faults| faults.add(now, replies, order));
    }

    /// Ends a kind of fault.
    pub(super) fn clear_faults(&mut self, now: Instant, target: FaultTarget) {
        self.change_faults(now, target, ActiveFaults::clear);
    }

    /// Ends the faults with this specification or name.
    pub(super) fn clear_some(&mut self, now: Instant, target: FaultTarget, words: &str) {
        self.change_faults(now, target, |faults| faults.clear_some(words));
    }

    /// Ends all faults.
    pub(super) fn clear_all(&mut self, now: Instant) {
        self.clear_faults(now, FaultTarget::Line);
        for index in 0..self.parts.len() {
            self.clear_faults(now, FaultTarget::Module(index));
        }
    }

    /// Updates inputs and ends faults that are due by now, one after another.
    fn catch_up(&mut self, now: Instant) {
        while let Some(at) = self.next_change().filter(|at| *at <= now) {
            self.line.handle(at, Input::Timeout);
            if self.step_at <= at {
                self.step_at = at + STEP;
                for part in &mut self.parts {
                    part.move_inputs(at, &mut self.line);
                }
            }
            self.expire(at);
        }
        self.expire(now);
        self.line.handle(now, Input::Timeout);
    }

    /// Ends expired faults. One limited by a number of replies ends before the next request, which
    /// is soon enough.
    fn expire(&mut self, at: Instant) {
        let modules = (0..self.parts.len()).map(FaultTarget::Module);
        for target in std::iter::once(FaultTarget::Line).chain(modules) {
            let replies = self.replies(target);
            if self.faults_of(target).is_due(at, replies) {
                self.change_faults(at, target, |faults| faults.expire(at, replies));
            }
        }
    }

    /// Number of replies given; faults of a line are not counted by them.
    pub(super) fn replies(&self, target: FaultTarget) -> u64 {
        match target {
            FaultTarget::Line => 0,
            FaultTarget::Module(index) => self.line.counts(self.parts[index].id).replies,
        }
    }

    /// The faults of a module, or of the line.
    pub(super) fn faults_of(&self, target: FaultTarget) -> &ActiveFaults {
        match target {
            FaultTarget::Line => &self.faults,
            FaultTarget::Module(index) => &self.parts[index].faults,
        }
    }

    fn next_change(&self) -> Option<Instant> {
        let moves = self.parts.iter().any(Part::moves).then_some(self.step_at);
        let ends = self.parts.iter().filter_map(|part| part.faults.next_end());
        ends.chain(self.faults.next_end()).chain(moves).min()
    }

    fn change_faults(
        &mut self,
        now: Instant,
        target: FaultTarget,
        change: impl FnOnce(&mut ActiveFaults),
    ) {
        match target {
            FaultTarget::Line => self.change_line_faults(now, change),
            FaultTarget::Module(index) => self.change_module_faults(now, index, change),
        }
    }

    fn change_line_faults(&mut self, now: Instant, change: impl FnOnce(&mut ActiveFaults)) {
        let babbled = self.faults.has(InjectedFault::Babble(None));
        change(&mut self.faults);
        self.line.set_faults(self.faults.faults(self.serial));
        self.line.set_echo(self.faults.has(InjectedFault::Echo));
        match (babbled, self.faults.has(InjectedFault::Babble(None))) {
            (false, true) => self.line.babble(FOREVER),
            (true, false) => self.line.hush(None),
            _ => {}
        }
        for index in 0..self.parts.len() {
            self.power(now, index);
        }
    }

    fn change_module_faults(
        &mut self,
        now: Instant,
        index: usize,
        change: impl FnOnce(&mut ActiveFaults),
    ) {
        let part = &mut self.parts[index];
        let id = part.id;
        let babbled = part.faults.has(InjectedFault::Babble(None));
        change(&mut part.faults);
        let babbles = part.faults.has(InjectedFault::Babble(None));
        let (faults, stuck) = (part.faults.faults(self.serial), part.faults.stuck());
        self.line.set_module_faults(id, faults);
        self.line.handle(now, Input::Act(id, Act::Stuck(stuck)));
        match (babbled, babbles) {
            (false, true) => self.line.handle(now, Input::Act(id, Act::Babble(FOREVER))),
            (true, false) => self.line.hush(Some(id)),
            _ => {}
        }
        self.readdress(now, index);
        self.power(now, index);
    }

    /// Gives the module the address required by a fault, or its own one back.
    fn readdress(&mut self, now: Instant, index: usize) {
        let part = &mut self.parts[index];
        let eeprom = *self.line.engine(part.id).eeprom();
        let address = match part.faults.address() {
            Some(address) => {
                part.own_address.get_or_insert(eeprom.address);
                Address(address)
            }
            None => match part.own_address.take() {
                Some(own) => own,
                None => return,
            },
        };
        if address != eeprom.address {
            self.rewrite(now, index, Act::Rewrite(Eeprom { address, ..eeprom }));
        }
    }

    /// Writes the EEPROM, which restarts the module; one without power stays off.
    fn rewrite(&mut self, now: Instant, index: usize, act: Act) {
        let part = &mut self.parts[index];
        part.look_at_init(now, &mut self.line);
        self.line.handle(now, Input::Act(part.id, act));
        part.has_power = true;
        self.power(now, index);
    }

    /// Switches the module's power, as requested and as faults require.
    fn power(&mut self, now: Instant, index: usize) {
        let dead = self.faults.has(InjectedFault::Dead);
        let part = &mut self.parts[index];
        let power = part.wanted_power && !dead && !part.faults.has(InjectedFault::Dead);
        if part.has_power == power {
            return;
        }
        part.has_power = power;
        if power {
            part.look_at_init(now, &mut self.line);
        }
        let act = Act::Power(if power { Power::On } else { Power::Off });
        self.line.handle(now, Input::Act(part.id, act));
        if power && part.faults.has(InjectedFault::Babble(None)) {
            self.line
                .handle(now, Input::Act(part.id, Act::Babble(FOREVER)));
        }
    }
}

/// The same module with factory settings: nothing configured, INIT* not wired.
fn as_new(setup: &Setup) -> Setup {
    Setup {
        outputs: setup.outputs,
        inputs: setup.inputs,
        variables: setup.variables,
        layout: setup.layout,
        invert_on_off: setup.invert_on_off,
        ..Setup::factory(setup.family)
    }
}
