//! All that is known of a site, and the only place where events change it.

use super::commands::Commands;
use super::context::{Runs, TaskId};
use super::guard::Guard;
use super::lines::{LineNow, LineTurns};
use super::promises::boards;
use super::quality::Qualities;
use super::rules::RuleStates;
use super::schedule::Schedule;
use super::stream::Stream;
use super::turns::Turns;
use super::{At, LineId, Now};
use crate::config::{ModuleConfig, Place};
use crate::health::Health;
use crate::rights::Who;
use crate::service::Update;
use crate::{BadReason, CommandError, Config, PointChange, PointQuality, PointValue, Site};
use railbus_device::{Point, PointKind};
use railbus_host::{Event, Fault, LineEvent, LineState, ModuleId, Presence};
use railbus_wire::{Instant, Micros};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// All that is known of a site.
#[derive(Debug)]
pub(crate) struct State {
    pub(crate) now: Now,
    pub(crate) site: Site,
    pub(crate) lines: BTreeMap<String, LineNow>,
    pub(crate) health: BTreeMap<String, Health>,
    pub(super) guard: Guard,
    pub(super) turns: Turns,
    pub(super) schedule: Schedule,
    pub(super) commands: Commands,
    /// The scenes that are being played.
    pub(super) playing: BTreeSet<String>,
    pub(super) runs: Runs,
    pub(crate) rules: RuleStates,
    /// What was last told of every point.
    pub(super) qualities: Qualities,
    /// What is about to be told to all who follow.
    pub(super) stream: Stream,
    /// The site is read again and again.
    pub(crate) polls: bool,
    /// Procedures that wait until a line is opened for the first time, or closed.
    pub(super) opening: BTreeSet<TaskId>,
    pub(super) line_turns: LineTurns,
    /// How many lines were opened; the next one has this number.
    pub(super) lines_opened: u64,
    pub(super) newest_loan: u64,
    /// The site has ended: lines are not opened any more.
    pub(super) is_closed: bool,
    /// All that belongs to its end is done, and the ports are free.
    pub(super) has_ended: bool,
    /// Outputs whose policy for the end of the site is not done yet.
    pub(super) exiting: BTreeSet<Place>,
    /// Outputs that the event that is being applied has shown in another state.
    pub(super) changed: Vec<PointChange>,
    /// Modules that are heard again by it.
    pub(super) returned: Vec<String>,
    /// Modules that are heard by it, and were not before.
    heard: Vec<String>,
}

impl State {
    pub(crate) fn new(config: Config, polls: bool) -> State {
        let lines = config.lines.keys();
        let lines = lines
            .map(|name| (name.clone(), LineNow::new(&config, name)))
            .collect();
        State {
            now: Now::default(),
            site: Site::new(config),
            lines,
            health: BTreeMap::new(),
            guard: Guard::new(polls),
            turns: Turns::default(),
            schedule: Schedule::default(),
            commands: Commands::default(),
            playing: BTreeSet::new(),
            runs: Runs::default(),
            rules: RuleStates::default(),
            qualities: Qualities::default(),
            stream: Stream::default(),
            polls,
            opening: BTreeSet::new(),
            line_turns: LineTurns::default(),
            lines_opened: 0,
            newest_loan: 0,
            is_closed: false,
            has_ended: false,
            exiting: BTreeSet::new(),
            changed: Vec::new(),
            returned: Vec::new(),
            heard: Vec::new(),
        }
    }

    /// Where a module hangs now, where its line is open.
    pub(crate) fn at(&self, module: &str) -> Option<At> {
        let line = &self.site.config().modules.get(module)?.line;
        let line = self.lines.get(line)?;
        let module = line.modules.iter().position(|name| name == module)?;
        Some(At {
            line: line.open()?,
            module: ModuleId(module),
        })
    }

    /// Whether there is a module at this place still.
    pub(super) fn has(&self, at: At) -> bool {
        let line = self
            .lines
            .values()
            .find(|line| line.open() == Some(at.line));
        let name = line.and_then(|line| line.modules.get(at.module.0));
        name.is_some_and(|name| !name.is_empty())
    }

    /// Those who wait for a line to be opened or closed look again.
    pub(super) fn wake_opening(&mut self) {
        for task in std::mem::take(&mut self.opening) {
            self.runs.wake(task);
        }
    }

    /// Whether the port of a module's line is open, or could not be opened once.
    pub(super) fn is_opened(&self, module: &str) -> bool {
        let module = self.site.config().modules.get(module);
        module.is_none_or(|module| self.is_line_opened(&module.line))
    }

    /// Whether the port of a line is open, or could not be opened once.
    pub(crate) fn is_line_opened(&self, line: &str) -> bool {
        let line = self.lines.get(line).filter(|_| !self.is_closed);
        line.is_none_or(|line| line.state != LineState::Opening)
    }

    /// The time in which readings of a module are told.
    pub(crate) fn line_time(&self, module: &str) -> Instant {
        let module = self.site.config().modules.get(module);
        let line = module.and_then(|module| self.lines.get(&module.line));
        let began = line.map_or(Micros::ZERO, |line| line.began);
        Instant(0) + (self.now.site - began)
    }

    pub(super) fn described(&self, module: &str) -> Result<&ModuleConfig, CommandError> {
        let config = self.site.config().modules.get(module);
        config.ok_or(CommandError::NoSuchModule)
    }

    /// Whether this caller may switch these points now, by the present configuration. Asked when
    /// the command comes, and again when its turn has come.
    pub(super) fn may_command(
        &self,
        who: &Who,
        module: &str,
        points: &[Point],
        confirm: bool,
    ) -> Result<(), CommandError> {
        let config = self.site.config();
        let may_switch = |point: &Point| who.rights.may_switch_in(config, module, *point);
        points.iter().try_for_each(may_switch)?;
        self.writable(module, points)?;
        if self.schedule.is_stopping {
            return Err(Fault::Closed.into());
        }
        let safety = |point: &Point| config.safety(&Place::new(module, *point));
        let asks = |point: &&Point| safety(point).is_some_and(|safety| safety.confirm.is_some());
        match points.iter().find(asks) {
            Some(point) if !confirm => Err(CommandError::Confirm(*point)),
            _ => Ok(()),
        }
    }

    /// Somebody sees to it that these outputs are switched off when they have been on for as
    /// long as they may.
    pub(super) fn watched(
        &self,
        module: &str,
        on: impl IntoIterator<Item = Point>,
    ) -> Result<(), CommandError> {
        let limited = |point: &Point| {
            let safety = self.site.config().safety(&Place::new(module, *point));
            safety.is_some_and(|safety| safety.max_on.is_some())
        };
        match on.into_iter().find(limited) {
            Some(point) if !self.polls => Err(CommandError::Unwatched(point)),
            _ => Ok(()),
        }
    }

    /// Whether these points are outputs that may be written.
    pub(super) fn writable(&self, module: &str, points: &[Point]) -> Result<(), CommandError> {
        let config = self.described(module)?;
        if points.is_empty() {
            return Err(CommandError::NoSuchPoint);
        }
        for point in points {
            if point.index >= config.setup.count(point.kind) {
                return Err(CommandError::NoSuchPoint);
            }
            if point.kind != PointKind::Output {
                return Err(CommandError::NotAnOutput(*point));
            }
            if config.points.get(point).is_some_and(|point| point.locked) {
                return Err(CommandError::Locked(*point));
            }
        }
        Ok(())
    }

    /// What an output was when it was last read.
    pub(super) fn output(&self, module: &str, point: Point) -> Option<bool> {
        let (known, _) = self.site.point(module, point, Instant(0));
        match known?.value {
            PointValue::Bool(on) => Some(on),
            PointValue::Analog(..) | PointValue::Number(_) => None,
        }
    }

    /// What an output is, where that is known now.
    pub(super) fn known(&self, place: &Place) -> Option<bool> {
        let status = self.point_of(&place.module, place.point)?;
        match (status.quality, status.value) {
            (PointQuality::Good, Some(PointValue::Bool(on))) => Some(on),
            _ => None,
        }
    }

    /// Whether an output's module is likely to answer: it did lately.
    pub(super) fn can_be_read(&self, place: &Place) -> bool {
        let status = self.point_of(&place.module, place.point);
        status.is_some_and(|status| !matches!(status.quality, PointQuality::Bad(_)))
    }

    pub(crate) fn label(&self, module: &str, point: Point) -> String {
        let label = self.described(module).map(|module| {
            let (letters, number) = module.setup.label(point);
            format!("{letters}{number}")
        });
        label.unwrap_or_default()
    }

    /// `do0=on do1=off`.
    pub(super) fn describe(&self, module: &str, set: &[(Point, bool)]) -> String {
        let mut text = String::new();
        for (point, on) in set {
            let on = if *on { "on" } else { "off" };
            // Writing into a String does not fail.
            let _ = write!(text, "{}={on} ", self.label(module, *point));
        }
        text.truncate(text.trim_end().len());
        text
    }

    /// All outputs of the site.
    pub(crate) fn outputs(&self) -> Vec<Place> {
        let modules = self.site.config().modules.iter();
        let outputs = modules.flat_map(|(module, config)| {
            let outputs = 0..config.setup.count(PointKind::Output);
            outputs.map(move |index| {
                let kind = PointKind::Output;
                Place::new(module, Point { kind, index })
            })
        });
        outputs.collect()
    }

    /// Whether a module's line is open.
    pub(crate) fn is_up(&self, module: &str) -> bool {
        let config = self.site.config().modules.get(module);
        let line = config.and_then(|config| self.lines.get(&config.line));
        line.is_some_and(|line| line.state == LineState::Up)
    }

    /// Why nothing can be known over a line now.
    pub(crate) fn line_fault(&self, line: &str) -> Option<BadReason> {
        self.lines.get(line)?.fault()
    }

    /// An exchange with a module failed.
    pub(crate) fn missed(&mut self, module: &str, now: Micros, fault: &Fault) {
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
            // What the line's task says at its end does not matter, unless the site ends.
            LineEvent::State(_) if known.lent.is_some() && known.is_closing && !self.is_closed => {
                return Vec::new();
            }
            LineEvent::State(state) => {
                known.state = state.clone();
                if *state == LineState::Up {
                    self.heard.clone_from(&known.modules);
                }
                return vec![this()];
            }
            LineEvent::Bus(event) => event,
            LineEvent::Lagged(_) | LineEvent::Ended(..) => return Vec::new(),
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
                // Events come at once, so the request began so long ago. The line's clock is not
                // asked: when that began may not be known yet.
                let time = self.now.wall.checked_sub(Duration::from_micros(took.0));
                let time = time.unwrap_or(SystemTime::UNIX_EPOCH);
                let changes = self.site.saw(&module, seen, *asked, time);
                if !changes.is_empty() || !self.qualities.is_good(&module) {
                    self.site.touch(&module);
                }
                for change in &changes {
                    self.watch_off(change);
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
            // Whether its modules answer follows, and everything is read again.
            Event::Overflow { .. } => Vec::new(),
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

impl State {
    /// Applies an event of a line: what changes by it is told, and what waits for it goes on. Who
    /// has written and then reads, reads what was written.
    pub(super) fn observe(&mut self, id: LineId, line: &str, event: &LineEvent) {
        let known = self.lines.get(line).and_then(|line| line.id);
        if known != Some(id) {
            // Of a line that was closed since.
            return;
        }
        let updates = self.apply(line, event, self.now.site);
        if matches!(event, LineEvent::State(_)) {
            self.wake_opening();
        }
        let heard = std::mem::take(&mut self.heard);
        if !heard.is_empty() {
            let of = |module: &str| heard.iter().any(|heard| heard == module);
            self.schedule.try_again(of);
        }
        for update in updates {
            if let Update::Point(change) = &update
                && change.point.kind == PointKind::Output
            {
                self.changed.push(change.clone());
            }
            self.publish(update);
        }
    }

    /// These are due now.
    pub(super) fn hasten(&mut self, numbers: &[u64]) {
        for number in numbers {
            self.schedule.hasten(*number, self.now.site);
        }
    }

    /// There is another configuration. What is known of the modules that are kept stays known;
    /// `is_other` are those whose name stands for another board now.
    pub(super) fn reconfigure(
        &mut self,
        config: Arc<Config>,
        keep: impl Fn(&str) -> bool,
        is_other: impl Fn(&str) -> bool,
    ) {
        let now = self.now.site;
        self.schedule.now_of(boards(&config), &is_other, now);
        self.site.reconfigure(config, &keep);
        self.health.retain(|module, _| keep(module));
        // The clocks of the other lines begin anew.
        self.guard.forget_doubts(|module| !keep(module));
        let config = self.site.config();
        self.guard.retain(|place| config.safety(place).is_some());
        self.may_have_gone_off(is_other, self.now.site);
        self.rules.follow(self.site.config(), self.now.site);
    }

    /// Somebody else had these modules, who may have done anything, and the clock of their line
    /// begins anew.
    pub(super) fn come_back(&mut self, of: impl Fn(&str) -> bool) {
        self.doubt_own_pulses(&of);
        self.site.forget(&of);
        self.guard.forget_doubts(&of);
        self.may_have_gone_off(of, self.now.site);
    }

    /// A frame of somebody's own is about to be sent to these modules: any of their outputs may
    /// be on until [`State::no_longer_doubt`].
    pub(crate) fn doubt(&mut self, modules: &[String]) -> Vec<Place> {
        let config = self.site.config();
        let outputs = modules.iter().flat_map(|name| {
            let setup = config.modules.get(name).map(|module| module.setup);
            let points = setup.into_iter().flat_map(|setup| setup.points());
            let outputs = points.filter(|point| point.kind == PointKind::Output);
            outputs.map(|point| Place::new(name, point))
        });
        let outputs: Vec<Place> = outputs.collect();
        for place in &outputs {
            self.guard.rises(place);
        }
        outputs
    }

    /// It was sent, or was not: what is read from now on says how they are.
    pub(crate) fn no_longer_doubt(&mut self, modules: &[String], outputs: &[Place]) {
        self.doubt_own_pulses(|module| modules.iter().any(|name| name == module));
        for place in outputs {
            let from = self.line_time(&place.module);
            self.guard.ended(place, Some(from));
            // Should it be off, it went off just now; where it is on, a reading says so.
            self.went_off(place, self.now.site);
        }
        self.site
            .doubt(|module| modules.iter().any(|name| name == module));
        for module in modules {
            self.publish(Update::Module(module.clone()));
        }
    }

    /// Whether the site is being closed.
    pub(crate) const fn is_stopping(&self) -> bool {
        self.schedule.is_stopping
    }

    /// Of the outputs of these that may be on for so long only, and are: how long yet.
    pub(super) fn limits(&self, of: impl Fn(&Place) -> bool) -> Vec<(Duration, Place)> {
        let limits = self.schedule.limits(of).into_iter();
        limits
            .filter_map(|key| Some((self.time_to(&key)?, key.0)))
            .collect()
    }

    pub(crate) fn publish(&mut self, update: Update) {
        self.stream.take(&update);
        self.rules.take(&update, self.now.site);
        self.runs.outputs.push_back(super::Output::Publish(update));
    }
}

#[cfg(test)]
impl State {
    /// No turn is held or waited for, no output reserved, no reply awaited.
    pub(super) fn is_at_rest(&self) -> bool {
        self.turns.is_empty() && self.guard.is_at_rest() && self.runs.nothing_is_pending()
    }
}

/// What stands for the state while the procedures have it.
impl Default for State {
    fn default() -> State {
        State::new(Config::default(), false)
    }
}
