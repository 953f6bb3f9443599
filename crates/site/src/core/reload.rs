//! Another configuration, while the site is at work.

use super::context::{Context, Store};
use super::lines::LineNow;
use super::promises::{Why, boards};
use super::state::State;
use super::{LineId, Output};
use crate::config::{Config, LineConfig, ModuleConfig, Place};
use crate::service::Update;
use crate::{CommandError, Rights};
use railbus_device::{Module, PointKind, Setup};
use railbus_host::{Fault, LineState, ModuleChanges, ModuleId, PortError};
use railbus_store::history::{Event, EventKind, Severity};
use railbus_wire::Micros;
use std::collections::BTreeSet;
use std::sync::Arc;

/// How many modules a line may have had before it is opened anew rather than changed once more.
const SLOTS_MAX: usize = 512;

/// How long commands in progress may take to end before the name of their module becomes another's.
pub(super) const TURN_MAX: Micros = Micros::from_secs(30);

/// What another configuration changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reloaded {
    /// Lines that go on, with all that is known of the modules that are as they were.
    pub kept: Vec<String>,
    /// Lines that were opened, or closed and opened again.
    pub opened: Vec<String>,
    /// Lines that are no more.
    pub closed: Vec<String>,
    /// Modules that are as they were to their lines.
    pub modules_kept: Vec<String>,
}

impl Context {
    /// Takes another configuration, and has it written before that where it is to be: lines that
    /// stay where they are go on, and of their modules those that changed begin anew. Lines that
    /// changed themselves are closed and opened. None where it was not written.
    ///
    /// # Errors
    /// As [`Rights::may_reload`], asked by the configuration that it would replace;
    /// [`Fault::Overloaded`] where too many wait for lines. [`Fault::Closed`] where the site began
    /// to end before that: what is on the disk then comes into force with the next start.
    pub(crate) async fn reload(
        &self,
        rights: &Rights,
        config: Config,
        store: Option<Store>,
    ) -> Result<Option<Reloaded>, CommandError> {
        let _turn = self.line_turn_if_free().await?;
        rights.may_reload(&self.config(), &config)?;
        self.reload_in_turn(config, store).await
    }

    /// The same while no other procedure opens or closes lines.
    pub(super) async fn reload_in_turn(
        &self,
        config: Config,
        store: Option<Store>,
    ) -> Result<Option<Reloaded>, CommandError> {
        let config = Arc::new(config);
        // What was to be done later to outputs whose names are about to stand for others is done
        // now: afterwards it would meet no board, or another one. They accept no commands until
        // they are where they belong. The end of the site does not wait for that, nor for the disk:
        // it needs these outputs, and nobody would see to another configuration.
        let others = self.with(|state| state.others(&config));
        let prepares = async {
            let (turns, left) = self.end_now(|place| others.contains(place), TURN_MAX).await;
            let is_written = match store {
                Some(store) => self.store(store).await,
                None => true,
            };
            (turns, left, is_written)
        };
        let prepared = self.unless_stopping(prepares).await;
        let (turns, left, is_written) = prepared.ok_or(Fault::Closed)?;
        if !is_written {
            self.with(|state| state.hasten(&left));
            return Ok(None);
        }
        let reloaded = self.with(|state| {
            let reloaded = state.reloads(&config);
            state.close_lines(&reloaded.opened);
            state.close_lines(&reloaded.closed);
            reloaded
        });
        self.closed(&reloaded.opened).await;
        self.closed(&reloaded.closed).await;
        let changes = self.with(|state| {
            let changes = state.take_config(&config, &reloaded, &others);
            // Before they are removed from the disk: after a restart nothing would report them.
            state.tell_dropped_ends();
            changes
        });
        let changes = changes.into_iter();
        let changes = changes.map(|(line, change)| self.change_modules(line, change));
        self.all(changes.collect::<Vec<_>>()).await;
        drop(turns);
        self.with(|state| {
            for line in &reloaded.opened {
                // A line that is lent is opened when it is given back.
                let is_lent = |now: &LineNow| now.lent.is_some();
                if !state.lines.get(line).is_some_and(is_lent) {
                    state.open_line(line);
                }
            }
        });
        for place in self.limit_anew() {
            self.with(|state| {
                let label = state.label(&place.module, place.point);
                let event = Event::new(EventKind::System, Severity::Warning, "limit_dropped");
                state.tell_event(event.module(&place.module).point(&label));
            });
        }
        // What the disk refuses holds as long as the process does.
        let _ = self.keep().await;
        self.with(|state| state.publish(Update::Reloaded));
        Ok(Some(reloaded))
    }
}

impl State {
    /// The outputs whose names are about to stand for others.
    fn others(&self, config: &Config) -> BTreeSet<Place> {
        let old = self.site.config();
        let was_lent = |module: &str| {
            let line = old.modules.get(module).map(|module| &module.line);
            line.and_then(|line| self.lines.get(line))
                .is_some_and(|line| line.was_lent)
        };
        let is_other = |place: &Place| {
            // The holder of a line may have moved its modules: then the name counts.
            !was_lent(&place.module) && !same_board(old, config, &place.module)
        };
        self.outputs().into_iter().filter(is_other).collect()
    }

    /// What a configuration changes as the lines are now.
    fn reloads(&self, config: &Config) -> Reloaded {
        let old = self.site.config();
        let (kept, opened): (Vec<String>, Vec<String>) = config
            .lines
            .keys()
            .cloned()
            .partition(|line| self.goes_on(config, line));
        let stays = |module: &&String| {
            let line = config.modules.get(*module).map(|module| &module.line);
            line.is_some_and(|line| kept.contains(line)) && same_module(old, config, module)
        };
        let modules_kept = config.modules.keys().filter(stays).cloned().collect();
        let is_gone = |line: &&String| !config.lines.contains_key(*line);
        let closed = old.lines.keys().filter(is_gone).cloned().collect();
        Reloaded {
            kept,
            opened,
            closed,
            modules_kept,
        }
    }

    /// Whether a line goes on: its port is the same, and it is here where its modules change.
    fn goes_on(&self, config: &Config, line: &str) -> bool {
        let old = self.site.config();
        let both = (old.lines.get(line), config.lines.get(line));
        if !matches!(both, (Some(a), Some(b)) if same_line(a, b)) {
            return false;
        }
        let Some(now) = self.lines.get(line) else {
            return false;
        };
        let mut names = old.modules_of(line).chain(config.modules_of(line));
        let is_same = names.all(|(name, _)| same_module(old, config, name));
        let is_open = now.open().is_some();
        if is_same {
            is_open || now.lent.is_some()
        } else {
            is_open && now.modules.len() + config.modules_of(line).count() <= SLOTS_MAX
        }
    }

    /// The configuration is another one from here on: the lines that it changes are closed, and
    /// nothing comes between. Gives back which modules leave and join lines that go on. Promises
    /// that could not be kept are not kept at the boards that have the names now.
    fn take_config(
        &mut self,
        config: &Arc<Config>,
        reloaded: &Reloaded,
        others: &BTreeSet<Place>,
    ) -> Vec<(LineId, ModuleChanges)> {
        let old = Arc::clone(self.site.config());
        // What is not told yet is about the boards of that one.
        self.stream_rest();
        // How long the other board's may be on counts anew, once they are seen; what is on at this
        // one stays on.
        self.schedule
            .drop_of(&boards(&old), |place| others.contains(place));
        for line in &reloaded.closed {
            self.lines.remove(line);
        }
        for line in &reloaded.opened {
            let mut now = LineNow::new(config, line);
            // What ends before it is opened ends in its time, not in that of the site.
            now.began = self.now.site;
            if let Some(before) = self.lines.get(line) {
                (now.lent, now.was_lent) = (before.lent, before.was_lent);
            }
            if self.is_closed {
                now.state = LineState::Closed;
            } else if now.lent.is_some() {
                now.state = LineState::Absent(Arc::new(PortError::Exclusive));
            }
            self.lines.insert(line.clone(), now);
        }
        let keep = |module: &str| reloaded.modules_kept.iter().any(|kept| kept == module);
        let mut changes = Vec::new();
        for line in &reloaded.kept {
            if let Some(now) = self.lines.get_mut(line) {
                let change = membership(config, line, now, self.polls, keep);
                let is_any = !change.leave.is_empty() || !change.join.is_empty();
                // Otherwise the whole site is being closed.
                changes.extend(now.open().filter(|_| is_any).map(|id| (id, change)));
            }
        }
        let is_other = |module: &str| !same_board(&old, config, module);
        self.reconfigure(Arc::clone(config), keep, is_other);
        self.wake_opening();
        changes
    }

    /// Reports which promised ends of pulses and leases are not done any more: the names of their
    /// modules stand for other boards now, or for none.
    pub(crate) fn tell_dropped_ends(&mut self) {
        for ((place, why), board) in self.schedule.take_dropped() {
            if why == Why::MinOff {
                continue;
            }
            let output = u16::from(place.point.index) + 1;
            let event = Event::new(EventKind::System, Severity::Error, "end_dropped");
            let event = event.module(&place.module).line(&board.line);
            self.tell_event(event.text(format!("address {}, output {output}", board.address)));
        }
    }

    pub(super) fn tell_event(&mut self, event: Event) {
        let event = Box::new(event);
        self.runs.outputs.push_back(Output::Event(event));
    }
}

/// Which modules of a line that goes on leave it, and which join it. The numbers of those that
/// join are theirs from now on: the line gives them in the same order.
fn membership(
    config: &Config,
    line: &str,
    now: &mut LineNow,
    polls: bool,
    keep: impl Fn(&str) -> bool,
) -> ModuleChanges {
    let mut change = ModuleChanges::default();
    for (number, slot) in now.modules.iter_mut().enumerate() {
        if !slot.is_empty() && !keep(slot) {
            change.leave.push(ModuleId(number));
            slot.clear();
        }
    }
    for (name, described) in config.modules_of(line).filter(|(name, _)| !keep(name)) {
        let plan = described.plan_where(polls);
        // A configuration that was read has no module that can't be.
        if let Ok(module) = Module::new(described.setup) {
            now.modules.push(name.clone());
            change.join.push((module, plan));
        }
    }
    change
}

/// Whether a line is the same. What it is called is no business of its port.
fn same_line(a: &LineConfig, b: &LineConfig) -> bool {
    a.port == b.port && a.serial == b.serial && a.echo == b.echo
}

/// Whether a name is that of the same board, however that is addressed on its line and however
/// often it is read.
pub(super) fn same_board(old: &Config, new: &Config, module: &str) -> bool {
    let both = (old.modules.get(module), new.modules.get(module));
    matches!(both, (Some(a), Some(b)) if a.line == b.line
        && spoken_to_as(a.setup, &b.setup) == b.setup)
}

/// The same board, with the speed, protocol and pause of another one.
fn spoken_to_as(setup: Setup, as_other: &Setup) -> Setup {
    Setup {
        protocol: as_other.protocol,
        serial: as_other.serial,
        checksum: as_other.checksum,
        gap: as_other.gap,
        ..setup
    }
}

/// Whether values that were read before mean what they would mean now.
fn same_ranges(a: &ModuleConfig, b: &ModuleConfig) -> bool {
    let mut analogs = a.setup.points().filter(|at| at.kind == PointKind::Analog);
    analogs.all(|at| a.range_of(at) == b.range_of(at))
}

/// Whether a module is the same to its line. What its points are called and which are locked is
/// no business of that.
fn same_module(old: &Config, new: &Config, module: &str) -> bool {
    let both = (old.modules.get(module), new.modules.get(module));
    matches!(both, (Some(a), Some(b)) if a.line == b.line
        && a.setup == b.setup
        && a.plan == b.plan
        && same_ranges(a, b))
}
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_not_told_in_a_unit_in_which_it_was_not_read() {
        let config = |more: &str| {
            let text = "[line.main]\nport = \"/dev/ttyUSB0\"\n[module.tank]\nline = \"main\"\n\
                model = \"emd2a2q\"\naddress = 5\n";
            Config::parse(&format!("{text}{more}")).unwrap()
        };
        let before = config("");
        let called = config("name = \"Tank\"\npoint.ai1 = { name = \"Level\", hidden = true }\n");
        assert!(same_module(&before, &called, "tank"));
        let amps = config("range = \"0-20mA\"\n");
        assert!(!same_module(&before, &amps, "tank"));
        let bar = "{ signal = \"4-20mA\", low = 0, high = 16, unit = \"bar\" }";
        let scaled = config(&format!("point.ai2 = {{ range = {bar} }}\n"));
        assert!(!same_module(&before, &scaled, "tank"));
    }
}
