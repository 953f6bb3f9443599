//! What a module says that it is, and what that means for its being heard and for the commands
//! to it (docs/decisions/0031).

use crate::command::decide;
use crate::flight::Flight;
use crate::node::Node;
use crate::{Bus, Confirmed, Event, ModuleId};
use railbus_device::{Op, Seen};

impl Bus {
    /// Tells how a module is heard, where that is news.
    #[cold]
    pub(crate) fn tell_presence(&mut self, module: ModuleId) {
        let Some(node) = self.nodes.get_mut(module.0) else {
            return;
        };
        let Some(presence) = node.news() else {
            return;
        };
        self.events.tell(Event::Presence { module, presence });
        if let Some(reading) = node.unveil(self.now) {
            self.events.tell(Event::Seen {
                module,
                op: reading.op,
                seen: reading.seen,
                asked: reading.asked,
                heard: reading.heard,
            });
        }
    }

    /// A module said what it is. What was on its way to another one ends.
    #[cold]
    pub(crate) fn identified(&mut self, module: ModuleId, seen: &Seen) {
        let now = self.now;
        if let Some(node) = self.nodes.get_mut(module.0) {
            node.identified(seen, now);
        }
        self.tell_presence(module);
        let node = self.nodes.get(module.0);
        let is_stranger = node.is_some_and(Node::is_stranger);
        let is_settled = node.is_some_and(|node| node.identify_first().is_none());
        decide(&mut self.commands, &mut self.events, now, |command| {
            let asks = command.op == Op::Identify;
            let ends = command.module == module && if asks { is_settled } else { is_stranger };
            match (ends, asks) {
                (false, _) => None,
                // Who asks just that has his answer.
                (true, true) => command.is_unsent().then_some(Ok(Confirmed::Reply)),
                (true, false) => Some(command.end_by_stranger()),
            }
        });
    }

    /// A module did not say what it is.
    #[cold]
    pub(crate) fn not_identified(&mut self, module: ModuleId, flight: &Flight) {
        if let Some(node) = self.nodes.get_mut(module.0) {
            node.not_identified(flight.sent);
        }
        self.tell_presence(module);
        decide(&mut self.commands, &mut self.events, self.now, |command| {
            let asks = command.module == module && command.op == Op::Identify;
            (asks && command.is_unsent()).then(|| Err(command.lost()))
        });
    }

    /// A greeting must not be put on this line.
    #[cold]
    pub(crate) fn cannot_greet(&mut self, module: ModuleId, op: &Op) {
        let Some(node) = self.nodes.get_mut(module.0) else {
            return;
        };
        if *op == Op::Identify {
            node.is_no_stranger();
            self.tell_presence(module);
        } else {
            node.answered_pulses();
            self.tell_pulses(module);
        }
    }
}
