//! Another configuration, while the site is at work.

use super::{HeldTurns, Service, Update, boards, close_all, prepare};
use crate::Config;
use crate::config::{LineConfig, ModuleConfig, Place, Problem};
use crate::core::{LineNow, State};
use railbus_device::{Module, PointKind};
use railbus_host::{LineState, ModuleChanges, ModuleId, PortError};
use railbus_store::history::{Event, EventKind, Severity};
use railbus_wire::Micros;
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::sync::Arc;

/// How many modules a line may have had before it is opened anew rather than changed once more.
const SLOTS_MAX: usize = 512;

/// How long commands in progress may take to end before the name of their module becomes another's.
const TURN_MAX: Micros = Micros::from_secs(30);

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

impl Service {
    /// Takes another configuration. Lines that stay where they are go on: of their modules, those
    /// that changed begin anew, and the others notice nothing. Lines that changed themselves are
    /// closed and opened anew. It goes on to its end, whether or not somebody waits.
    ///
    /// # Errors
    /// Every problem of the text. Then nothing has changed.
    pub async fn reload(&self, text: &str) -> Result<Reloaded, Vec<Problem>> {
        let written = async { Ok::<(), Infallible>(()) };
        let reloaded = self.reload_written(text, written).await?;
        Ok(reloaded.unwrap_or_else(|never| match never {}))
    }

    /// The same of a text that is written meanwhile: what is promised of modules whose names are
    /// about to stand for others is done before that, so that a crash leaves nothing behind that is
    /// to be done at a board without a name. What can't be written is not taken.
    ///
    /// # Errors
    /// As [`Service::reload`]; inside it, why it was not written.
    pub async fn reload_written<E: Send + 'static>(
        &self,
        text: &str,
        written: impl Future<Output = Result<(), E>> + Send + 'static,
    ) -> Result<Result<Reloaded, E>, Vec<Problem>> {
        let config = Config::parse(text)?;
        let service = self.clone();
        match tokio::spawn(async move { service.take_config(config, written).await }).await {
            Ok(reloaded) => Ok(reloaded),
            Err(broken) => match broken.try_into_panic() {
                Ok(why) => std::panic::resume_unwind(why),
                // The runtime ends, and this with it.
                Err(_) => std::future::pending().await,
            },
        }
    }

    async fn take_config<E>(
        &self,
        config: Config,
        written: impl Future<Output = Result<(), E>>,
    ) -> Result<Reloaded, E> {
        let _one_at_a_time = self.inner.reloading.lock().await;
        let old = self.config();
        let goes_on = |line: &&String| self.goes_on(&old, &config, line);
        let kept: BTreeSet<String> = config.lines.keys().filter(goes_on).cloned().collect();
        let changed = |line: &&String| !kept.contains(*line);
        let keep = |module: &str| {
            let line = config.modules.get(module).map(|module| &module.line);
            line.is_some_and(|line| kept.contains(line)) && same_module(&old, &config, module)
        };
        let reloaded = Reloaded {
            modules_kept: config.modules.keys().filter(|m| keep(m)).cloned().collect(),
            kept: kept.iter().cloned().collect(),
            opened: config.lines.keys().filter(changed).cloned().collect(),
            closed: old
                .lines
                .keys()
                .filter(|line| !config.lines.contains_key(*line))
                .cloned()
                .collect(),
        };

        // Their outputs accept no commands until they are where they belong.
        let (turns, left) = self.end_on_others(&old, &config).await;
        if let Err(why) = written.await {
            self.inner.change(|state| state.hasten(&left));
            return Err(why);
        }
        self.drop_on_others(&old, &config, &left);
        self.keep().await;
        let ending = reloaded.opened.iter().chain(&reloaded.closed);
        let gone: Vec<_> = ending
            .filter_map(|line| self.inner.take_line(line))
            .collect();
        close_all(gone.into_iter()).await;

        let memberships = self.inner.change(|state| {
            for line in &reloaded.closed {
                state.lines.remove(line);
            }
            for line in &reloaded.opened {
                let lent = state.lines.get(line).is_some_and(|now| now.lent);
                let mut now = LineNow::new(&config, line);
                if lent {
                    now.lent = true;
                    now.state = LineState::Absent(Arc::new(PortError::Exclusive));
                }
                state.lines.insert(line.clone(), now);
            }
            let polls = state.polls;
            let lines = state.lines.iter_mut();
            let lines = lines.filter(|(line, _)| kept.contains(*line));
            let memberships: Vec<_> = lines
                .map(|(line, now)| {
                    let change = membership(&config, line, now, polls, keep);
                    (line.clone(), change)
                })
                .collect();
            let is_other = |module: &str| !same_board(&old, &config, module);
            state.reconfigure(config.clone(), keep, is_other);
            memberships
        });
        for (line, change) in memberships {
            if let Some(handle) = self.inner.handle(&line)
                && (!change.leave.is_empty() || !change.join.is_empty())
            {
                // Fails where the whole site is being closed.
                let _ = handle.change(change).await;
            }
        }
        drop(turns);
        for line in &reloaded.opened {
            // The holder releases it.
            let lent = |state: &mut State| state.lines.get(line).is_some_and(|now| now.lent);
            if !self.inner.read(lent) {
                self.open_again(&config, line);
            }
        }
        let unlimited = self
            .inner
            .drive(|core, now| core.change(now, |context| context.limit_anew()));
        for place in unlimited {
            let label = self
                .inner
                .read(|state| state.label(&place.module, place.point));
            let event = Event::new(EventKind::System, Severity::Warning, "limit_dropped");
            self.tell_event(event.module(&place.module).point(&label));
        }
        self.keep().await;
        self.inner.tell(Update::Reloaded);
        self.tell_dropped_ends();
        Ok(reloaded)
    }

    fn is_other(&self, old: &Config, new: &Config, place: &Place) -> bool {
        // The holder of a line may have moved its modules: then the name counts.
        let is_here = || self.inner.read(|state| state.at(&place.module).is_some());
        !same_board(old, new, &place.module) && is_here()
    }

    /// What was to be done later to outputs of modules whose name is no more, or another's, is
    /// done now: afterwards it would meet nobody, or another module. Gives back what could not be
    /// done.
    async fn end_on_others(&self, old: &Config, new: &Config) -> (HeldTurns, Vec<u64>) {
        let others = self.others(old, new);
        self.end_now(others, TURN_MAX).await
    }

    /// The outputs whose names are about to stand for others.
    fn others(&self, old: &Config, new: &Config) -> BTreeSet<Place> {
        let outputs = self.inner.read(|state| state.outputs());
        let is_other = |place: &Place| self.is_other(old, new, place);
        outputs.into_iter().filter(is_other).collect()
    }

    /// Ends the pulses and leases of these outputs now, as far as that can be within this time;
    /// those that could not be come back. Nobody commands the others until the turns are dropped.
    pub(super) async fn end_now(
        &self,
        of: BTreeSet<Place>,
        patience: Micros,
    ) -> (HeldTurns, Vec<u64>) {
        let ended = self.ask(move |core| async move {
            core.end_now(|place| of.contains(place), patience).await
        });
        let (turns, left) = ended.await.unwrap_or_default();
        let inner = Arc::clone(&self.inner);
        (HeldTurns { inner, turns }, left)
    }

    /// Brings what is promised to the disk. What that refuses holds as long as the process does.
    async fn keep(&self) {
        self.ask(|core| async move { core.keep().await.is_ok() })
            .await;
    }

    /// What could not be done to them is not done to those that have their names from now on, and
    /// told.
    fn drop_on_others(&self, old: &Config, new: &Config, left: &[u64]) {
        let (boards, others) = (boards(old), self.others(old, new));
        // How long the other board's may be on counts anew, once they are seen; what is on at this
        // one stays on.
        let is_other = |place: &Place| others.contains(place);
        self.inner
            .change(|state| state.drop_of(&boards, left, is_other));
    }

    /// Opens a line of a configuration that was checked. What the system refuses even so is the
    /// line's state.
    pub(super) fn open_again(&self, config: &Config, line: &str) {
        let Ok(prepared) = prepare(config, line, self.inner.polls) else {
            return;
        };
        self.inner.change(|state| {
            if let Some(now) = state.lines.get_mut(line) {
                // Modules that joined and left have left gaps; the new line numbers them anew.
                now.modules = LineNow::new(config, line).modules;
            }
        });
        if let Err(why) = self.open(line, prepared) {
            let absent = LineState::Absent(Arc::new(why));
            self.inner.change(|state| {
                if let Some(now) = state.lines.get_mut(line) {
                    now.state = absent;
                }
            });
        }
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

impl Service {
    /// Whether a line goes on: its port is the same, and it is here where its modules change.
    fn goes_on(&self, old: &Config, new: &Config, line: &str) -> bool {
        let both = (old.lines.get(line), new.lines.get(line));
        if !matches!(both, (Some(a), Some(b)) if same_line(a, b)) {
            return false;
        }
        let mut names = old.modules_of(line).chain(new.modules_of(line));
        let is_same = names.all(|(name, _)| same_module(old, new, name));
        let is_open = self.inner.handle(line).is_some();
        let (slots, lent) = self.inner.read(|state| {
            let now = state.lines.get(line);
            now.map_or((0, false), |now| (now.modules.len(), now.lent))
        });
        let room = slots + new.modules_of(line).count() <= SLOTS_MAX;
        if is_same {
            is_open || lent
        } else {
            is_open && room
        }
    }
}

/// Whether a line is the same. What it is called is no business of its port.
fn same_line(a: &LineConfig, b: &LineConfig) -> bool {
    a.port == b.port && a.serial == b.serial && a.echo == b.echo
}

/// Whether a name is that of the same module, however often that is read.
fn same_board(old: &Config, new: &Config, module: &str) -> bool {
    let both = (old.modules.get(module), new.modules.get(module));
    matches!(both, (Some(a), Some(b)) if a.line == b.line && a.setup == b.setup)
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
    let same = matches!(both, (Some(a), Some(b)) if a.plan == b.plan && same_ranges(a, b));
    same && same_board(old, new, module)
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
