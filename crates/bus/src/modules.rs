//! The modules of a line: they may join and leave while it is in use.

use crate::command::{Stage, end_commands};
use crate::in_flight::InFlight;
use crate::module_state::ModuleState;
use crate::{Bus, Fault, ModuleId, Plan};
use railbus_device::Module;
use railbus_wire::{Instant, Micros};

impl Bus {
    /// Adds a module to the line; it is polled as the plan says.
    pub fn add(&mut self, module: Module, plan: Plan) -> ModuleId {
        let id = ModuleId(self.modules.len());
        let mut state = ModuleState::new(module, plan, &self.config);
        state.start(self.now, id.0, id.0 + 1);
        let protocol = state.module.setup().protocol;
        self.mixed |= self
            .modules
            .iter()
            .any(|other| other.module.setup().protocol != protocol);
        self.modules.push(state);
        id
    }

    /// Adds a module to a line in use: its polls begin now, those of the others continue.
    pub fn join(&mut self, now: Instant, module: Module, plan: Plan) -> ModuleId {
        self.now = now;
        let id = self.add(module, plan);
        self.measure();
        self.reassign_ghosts();
        id
    }

    /// Removes a module from a line in use. Its queued commands end now, one in flight when its
    /// reply has come; its number is not reused.
    pub fn leave(&mut self, now: Instant, id: ModuleId) {
        self.now = now;
        let Some(state) = self.modules.get_mut(id.0) else {
            return;
        };
        state.retire();
        self.end_commands_of(id);
        self.measure();
        self.reassign_ghosts();
    }

    /// Ends the commands for a removed module, except those in flight.
    fn end_commands_of(&mut self, id: ModuleId) {
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            let waits = command.module == id && command.stage != Stage::Sent;
            waits.then(|| match command.is_unsent() {
                true => Err(Fault::Closed),
                false => command.end_by_time(),
            })
        });
    }

    /// An exchange has ended: a module removed meanwhile gets no other one.
    pub(crate) fn end_if_left(&mut self, flight: &InFlight) {
        if let Some(id) = flight.job.module()
            && self.modules.get(id.0).is_some_and(|state| state.retired)
        {
            self.end_commands_of(id);
        }
    }

    /// Updates what depends on the set of modules.
    pub(crate) fn measure(&mut self) {
        let there = self.modules.iter().filter(|state| !state.retired);
        let mut protocols = there.map(|state| state.module.setup().protocol);
        let first = protocols.next();
        self.mixed = protocols.any(|protocol| Some(protocol) != first);
        let cycles = self.modules.iter().map(ModuleState::cycle);
        self.cycle = cycles.fold(Micros::ZERO, |sum, cycle| sum + cycle);
    }
}
