//! All that is known of a site, and the only place where events change it.

use super::guard::Guard;
use super::{Busy, Inner, Update, lock};
use crate::health::Health;
use crate::{Config, Reason, Site};
use railbus_device::PointKind;
use railbus_host::{Event, Fault, LineEvent, LineState, ModuleId, PortError, Presence};
use railbus_wire::Micros;
use std::collections::BTreeMap;
use std::sync::Arc;

/// All that is known of a site.
#[derive(Debug)]
pub(super) struct State {
    pub(super) site: Site,
    pub(super) lines: BTreeMap<String, LineNow>,
    pub(super) health: BTreeMap<String, Health>,
    pub(super) guard: Guard,
    /// Modules that are heard again by the event that is being applied.
    returned: Vec<String>,
    /// Modules that are heard by it, and were not before.
    heard: Vec<String>,
}

/// How a line is.
#[derive(Clone, Debug)]
pub(super) struct LineNow {
    pub(super) state: LineState,
    pub(super) babble: bool,
    /// How much of its time is taken.
    pub(super) busy: Busy,
    /// Somebody else has it for a while.
    pub(super) lent: bool,
    /// When its clock began, in the time of the site: values grow old without it, too.
    pub(super) began: Micros,
    /// The names of its modules, by their numbers on the line; empty for those that left.
    pub(super) modules: Vec<String>,
}

impl LineNow {
    pub(super) fn new(config: &Config, line: &str) -> LineNow {
        LineNow {
            state: LineState::Opening,
            babble: false,
            busy: Busy::default(),
            lent: false,
            began: Micros::ZERO,
            modules: config
                .modules_of(line)
                .map(|(name, _)| name.clone())
                .collect(),
        }
    }
}

impl State {
    pub(super) fn new(config: Config, polls: bool) -> State {
        let lines = config.lines.keys();
        let lines = lines
            .map(|name| (name.clone(), LineNow::new(&config, name)))
            .collect();
        State {
            site: Site::new(config),
            lines,
            health: BTreeMap::new(),
            guard: Guard::new(polls),
            returned: Vec::new(),
            heard: Vec::new(),
        }
    }

    /// The line of a module, and its number there.
    pub(super) fn place(&self, module: &str) -> Option<(String, ModuleId)> {
        let line = &self.site.config().modules.get(module)?.line;
        let modules = &self.lines.get(line)?.modules;
        let id = modules.iter().position(|name| name == module)?;
        Some((line.clone(), ModuleId(id)))
    }

    /// Whether a module's line is open.
    pub(super) fn is_up(&self, module: &str) -> bool {
        let config = self.site.config().modules.get(module);
        let line = config.and_then(|config| self.lines.get(&config.line));
        line.is_some_and(|line| line.state == LineState::Up)
    }

    /// Why nothing can be known over a line now. One that is only just being opened may have
    /// nothing to tell yet, but is no fault.
    pub(super) fn line_fault(&self, line: &str) -> Option<Reason> {
        let line = self.lines.get(line)?;
        match &line.state {
            _ if line.lent => Some(Reason::Exclusive),
            LineState::Up | LineState::Opening => None,
            LineState::Absent(why) => Some(match **why {
                PortError::Busy { .. } => Reason::LineBusy,
                PortError::Exclusive => Reason::Exclusive,
                _ => Reason::LineAbsent,
            }),
            LineState::Closed => Some(Reason::LineClosed),
        }
    }

    /// An exchange with a module failed.
    pub(super) fn missed(&mut self, module: &str, now: Micros, fault: &Fault) {
        self.health_of(module).failed(now, fault);
    }

    fn health_of(&mut self, module: &str) -> &mut Health {
        self.health.entry(module.to_owned()).or_default()
    }

    /// Takes note of an event; gives back what changed by it.
    fn apply(&mut self, line: &str, event: &LineEvent, now: Micros) -> Vec<Update> {
        let this = || Update::Line(line.to_owned());
        let Some(known) = self.lines.get_mut(line) else {
            return Vec::new();
        };
        let event = match event {
            // What the line's task says at its end does not matter any more.
            LineEvent::State(_) if known.lent => return Vec::new(),
            LineEvent::State(state) => {
                known.state = state.clone();
                if *state == LineState::Up {
                    self.heard.clone_from(&known.modules);
                }
                return vec![this()];
            }
            LineEvent::Bus(event) => event,
            LineEvent::Lagged(_) => return Vec::new(),
        };
        let name = |id: ModuleId| known.modules.get(id.0).cloned().unwrap_or_default();
        if module_of(event).is_some_and(|id| name(id).is_empty()) {
            // Of a module that left, an exchange may still have been under way.
            return Vec::new();
        }
        match event {
            Event::Seen {
                module,
                seen,
                asked,
                heard,
                ..
            } => {
                let module = name(*module);
                let took = heard.since(*asked);
                known.busy.add(now, took);
                self.health_of(&module).replied(took);
                let stranger = self.site.stranger(&module).map(str::to_owned);
                let changes = self.site.saw(&module, seen, *asked);
                for change in &changes {
                    self.watch_off(change, now);
                }
                // Yet another one may have taken its place.
                let is_other = self.site.stranger(&module) != stranger.as_deref();
                let other = is_other.then_some(Update::Module(module));
                let changes = changes.into_iter().map(Update::Point);
                changes.chain(other).collect()
            }
            Event::Missed { module, fault, .. } => {
                let module = name(*module);
                self.missed(&module, now, fault);
                let is_lost = self.site.missed(&module);
                is_lost
                    .then_some(Update::Module(module))
                    .into_iter()
                    .collect()
            }
            Event::Presence { module, presence } => {
                let module = name(*module);
                let before = self.site.presence(&module);
                self.site.heard(&module, *presence);
                if before != Presence::Online && *presence == Presence::Online {
                    self.heard.push(module.clone());
                }
                let was_away = matches!(before, Presence::Silent | Presence::OtherModel);
                if was_away && *presence == Presence::Online {
                    self.returned.push(module.clone());
                }
                vec![Update::Module(module)]
            }
            Event::Late { module, .. } => {
                let module = name(*module);
                let health = self.health_of(&module);
                health.late.count(now);
                health.counts.late += 1;
                Vec::new()
            }
            Event::Babble | Event::Quiet => {
                known.babble = *event == Event::Babble;
                vec![this()]
            }
            Event::Echo | Event::EchoGone | Event::Duplicates | Event::Done { .. } => Vec::new(),
            Event::Probed { .. } | Event::ProbedLate { .. } => Vec::new(),
        }
    }
}

/// The module that an event is about.
const fn module_of(event: &Event) -> Option<ModuleId> {
    match event {
        Event::Seen { module, .. }
        | Event::Missed { module, .. }
        | Event::Presence { module, .. }
        | Event::Late { module, .. } => Some(*module),
        _ => None,
    }
}

impl Inner {
    /// Called in the line's task, before a command's caller is answered: who has written and
    /// then reads, reads what was written.
    pub(super) fn observe(self: &Arc<Inner>, line: &str, event: &LineEvent) {
        let (updates, returned, heard) = {
            let mut state = lock(&self.state);
            let updates = state.apply(line, event, self.now());
            let returned = std::mem::take(&mut state.returned);
            (updates, returned, std::mem::take(&mut state.heard))
        };
        if !heard.is_empty() {
            let of = |module: &str| heard.iter().any(|heard| heard == module);
            self.schedule.try_again(of);
        }
        for update in updates {
            if let Update::Point(change) = &update
                && change.point.kind == PointKind::Output
            {
                self.watch_on(change);
                self.keep_min_off(change);
            }
            self.tell(update);
        }
        for module in returned {
            self.returned(module);
        }
    }
}
