//! A command under way: what it may switch on is reserved from before its first frame until it
//! has ended, and it ends exactly once, even where nobody waits for it any more.

use super::command::{Entry, bank_state, confirmed_name};
use super::guard::Now;
use super::promises::Why;
use super::record::Begun;
use super::{Inner, lock};
use crate::config::{Place, Safety};
use crate::{Change, Failure, Value};
use railbus_device::{Bank, Op, Point};
use railbus_host::{Confirmed, Done, Fault};
use railbus_store::audit::Note;
use railbus_store::audit::Origin;
use railbus_wire::Micros;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::SystemTime;

/// How many commands are remembered.
pub const COMMANDS_KEPT: usize = 1_024;

/// A command that was given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Command {
    /// Its number, which is that of its audit entry.
    pub id: String,
    /// When it was asked for.
    pub at: SystemTime,
    /// Who asked for it.
    pub origin: Origin,
    /// The module.
    pub module: String,
    /// What was asked of it.
    pub what: String,
    /// How it ended; none while it is under way.
    pub end: Option<&'static str>,
}

/// The newest commands.
#[derive(Debug, Default)]
pub(super) struct Commands(Mutex<VecDeque<Command>>);

impl Commands {
    pub(super) fn find(&self, id: &str) -> Option<Command> {
        let known = lock(&self.0);
        known.iter().rev().find(|command| command.id == id).cloned()
    }

    fn add(&self, command: Command) {
        let mut known = lock(&self.0);
        if known.len() >= COMMANDS_KEPT {
            known.pop_front();
        }
        known.push_back(command);
    }

    fn end(&self, id: &str, end: &'static str) {
        let mut known = lock(&self.0);
        if let Some(command) = known.iter_mut().rev().find(|command| command.id == id) {
            command.end = Some(end);
        }
    }
}

/// What a command does to outputs of which something is to be watched.
#[derive(Debug, Default)]
pub(super) struct Effect {
    /// Those that it may switch on.
    pub(super) rising: Vec<Place>,
    /// Those of them that are off beyond doubt before it.
    off: Vec<Place>,
    /// Those that it switches off, and that are not off already.
    falling: Vec<Place>,
    /// How long the module goes on by itself once it has the command.
    busy: Micros,
}

/// What a command has done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Acted {
    /// Nothing.
    No,
    /// Nobody knows until it is read.
    Perhaps,
    /// What it was to do; that was read.
    Surely,
}

/// A command under way.
pub(super) struct Underway {
    inner: Arc<Inner>,
    module: String,
    id: String,
    /// The outputs as they were known to be before it.
    before: Vec<(Point, Option<bool>)>,
    effect: Effect,
    /// Outputs whose longest time began with it, and the number of that.
    limits: Vec<(Place, u64)>,
    /// None once it has ended.
    begun: Option<Begun>,
}

impl Underway {
    /// Writes down what is about to be done, and reserves the outputs that it switches on.
    pub(super) async fn begin(
        inner: &Arc<Inner>,
        module: &str,
        points: &[Point],
        entry: &mut Entry,
        mut effect: Effect,
    ) -> Result<Underway, Failure> {
        let before = |point: &Point| (*point, inner.known(&Place::new(module, *point)));
        let before: Vec<_> = points.iter().map(before).collect();
        let begun = match entry.open.take() {
            Some(begun) => begun,
            None => inner.begin_command(module, &before, &entry.note).await?,
        };
        let now = inner.clocks(&[&effect.rising[..], &effect.falling].concat());
        let allowed = {
            let mut state = lock(&inner.state);
            effect.falling = state.not_off(effect.falling, &now);
            effect.off = state.surely_off(&effect.rising, &now);
            state.rise(&effect.rising, &now)
        };
        if let Err(failure) = allowed {
            inner.ended(begun, Err(failure.name()), &[], entry).await;
            return Err(failure);
        }
        Ok(Underway {
            inner: Arc::clone(inner),
            module: module.to_owned(),
            id: begun.id.clone(),
            before,
            effect,
            limits: Vec::new(),
            begun: Some(begun),
        })
    }

    /// Sees to it that outputs which may be on for so long only are switched off then, before
    /// they are switched on.
    pub(super) async fn limit(&mut self) {
        for place in &self.effect.rising {
            let key = (place.clone(), Why::MaxOn);
            if self.effect.off.contains(place) {
                // One that runs began for nothing: what was to switch it on did not.
                self.inner.leave_out(|other| *other == key);
            }
            let runs = self.inner.schedule.find(&key).is_some();
            if let Some(timer) = self.inner.limit_on(place) {
                if !runs {
                    self.limits.push((place.clone(), timer.number()));
                }
                timer.promised().await;
            }
        }
    }

    /// It has ended, and the outputs are known to be so; gives back its number, and how they
    /// were before.
    pub(super) async fn end(
        mut self,
        end: &Result<Done, Fault>,
        after: &[(Point, Option<bool>)],
        entry: &mut Entry,
    ) -> (String, Vec<(Point, Option<bool>)>) {
        let (told, acted) = match end {
            Ok(done) if done.confirmed == Confirmed::Readback => {
                (confirmed_name(done.confirmed), Acted::Surely)
            }
            Ok(done) => (confirmed_name(done.confirmed), Acted::Perhaps),
            // Of several frames, one before may have been taken.
            Err(fault @ Fault::Refused(_)) => (fault.name(), Acted::Perhaps),
            Err(fault) if fault.may_have_acted() => (fault.name(), Acted::Perhaps),
            Err(fault) => (fault.name(), Acted::No),
        };
        if let Some(begun) = self.begun.take() {
            self.release(acted);
            let is_done = acted == Acted::Surely || end.is_ok() && !entry.is_release;
            let told = if is_done { Ok(told) } else { Err(told) };
            self.inner.ended(begun, told, after, entry).await;
        }
        (
            std::mem::take(&mut self.id),
            std::mem::take(&mut self.before),
        )
    }

    /// What it switched on is reserved no longer: from now on readings say how it is.
    fn release(&self, acted: Acted) {
        let Effect {
            rising,
            falling,
            busy,
            ..
        } = &self.effect;
        let from = self.inner.line_time(&self.module);
        let doubt = match acted {
            Acted::No => None,
            Acted::Surely if *busy == Micros::ZERO => None,
            Acted::Surely | Acted::Perhaps => Some(from),
        };
        let now = self.inner.now();
        let mut state = lock(&self.inner.state);
        for place in rising {
            state.guard.ended(place, doubt);
            if acted != Acted::No && *busy > Micros::ZERO {
                state.guard.busy_until(place, now + *busy);
                state.went_off(place, now + *busy);
            }
        }
        if acted != Acted::No {
            for place in falling {
                state.went_off(place, now);
            }
        }
        // What was never sent has begun no longest time; one that ran before goes on.
        let is_on = |place: &Place| {
            let known = state.site.point(&place.module, place.point, from).0;
            known.is_some_and(|known| known.value == Value::Bool(true))
        };
        let limits = self.limits.iter();
        let unused: Vec<u64> = limits
            .filter(|(place, _)| acted == Acted::No && !is_on(place))
            .map(|(_, number)| *number)
            .collect();
        drop(state);
        self.inner.leave_out_numbers(&unused);
    }
}

impl Drop for Underway {
    /// Who asked went away; the line does it all the same.
    fn drop(&mut self) {
        let Some(begun) = self.begun.take() else {
            return;
        };
        let end = Fault::Unknown.name();
        self.release(Acted::Perhaps);
        self.inner.commands.end(&self.id, end);
        let inner = Arc::clone(&self.inner);
        // Without a runtime the process ends, and the entry says that it began.
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            runtime.spawn(async move { inner.end(begun, end, &[]).await });
        }
    }
}

impl Inner {
    async fn begin_command(
        &self,
        module: &str,
        before: &[(Point, Option<bool>)],
        note: &Note,
    ) -> Result<Begun, Failure> {
        let begun = self.begin(module, before, note.clone()).await?;
        self.commands.add(Command {
            id: begun.id.clone(),
            at: SystemTime::now(),
            origin: note.origin.clone(),
            module: module.to_owned(),
            what: note.what.clone(),
            end: None,
        });
        Ok(begun)
    }

    /// Writes down how a command ended, or keeps that back where it failed not for the first
    /// time.
    async fn ended(
        &self,
        begun: Begun,
        end: Result<&'static str, &'static str>,
        after: &[(Point, Option<bool>)],
        entry: &mut Entry,
    ) {
        let is_again = entry.failed.is_some();
        entry.failed = end.err();
        let (Ok(told) | Err(told)) = end;
        if end.is_err() && is_again {
            entry.open = Some(begun);
        } else {
            self.commands.end(&begun.id, told);
            self.end(begun, told, after).await;
        }
    }

    /// Nobody tries any more.
    pub(super) async fn close(&self, entry: Entry) {
        if let (Some(begun), Some(told)) = (entry.open, entry.failed) {
            self.commands.end(&begun.id, told);
            self.end(begun, told, &[]).await;
        }
    }

    /// What an op does to the outputs of a module that something is said of.
    pub(super) fn effect(&self, module: &str, points: &[Point], op: &Op) -> Effect {
        let state = lock(&self.state);
        let config = state.site.config();
        let watched = |place: &Place| {
            let of = |safety: &Safety| {
                !safety.interlock.is_empty() || safety.min_off.is_some() || safety.max_on.is_some()
            };
            config.safety(place).is_some_and(of)
        };
        let places = points.iter().map(|point| Place::new(module, *point));
        let (rising, falling): (Vec<_>, Vec<_>) = places
            .filter(watched)
            .partition(|place| rises(op, place.point));
        let pulses = state.site.pulses(module);
        let width = |place: &Place| {
            let pulse = pulses.and_then(|pulses| pulses.of(place.point));
            pulse.map_or(0, |width| u64::from(width.tenths()) * 100)
        };
        let busy = match op {
            Op::Jog { millis, .. } => u64::from(millis.get()),
            Op::Write(_) => rising.iter().map(width).max().unwrap_or_default(),
            _ => 0,
        };
        Effect {
            rising,
            off: Vec::new(),
            falling,
            busy: Micros::from_millis(busy),
        }
    }

    /// Asks the modules of which nothing sure is known, where outputs that exclude these hang on
    /// them. What that brings is looked at afterwards.
    pub(super) async fn ask_excluded(&self, rising: &[Place]) {
        if rising.is_empty() {
            return;
        }
        let now = self.clocks(rising);
        let unsure = lock(&self.state).to_be_asked(rising, &now);
        for module in unsure {
            let _ = self.read_all(&module).await;
        }
    }

    /// The time, as far as it concerns these outputs and those that they exclude.
    fn clocks(&self, places: &[Place]) -> Now {
        let modules = lock(&self.state).concerned(places);
        let time = |module: String| {
            let time = self.line_time(&module);
            (module, time)
        };
        Now {
            site: self.now(),
            lines: modules.into_iter().map(time).collect(),
        }
    }

    /// Keeps on the disk how long outputs must stay off, where a change concerns that.
    pub(super) fn keep_min_off(self: &Arc<Inner>, change: &Change) {
        let place = Place::new(&change.module, change.point);
        let outputs = {
            let state = lock(&self.state);
            let safety = state.site.config().safety(&place);
            if safety.is_none_or(|safety| safety.min_off.is_none()) {
                return;
            }
            state.must_stay_off(self.now())
        };
        let inner = Arc::clone(self);
        tokio::spawn(async move { inner.schedule.must_stay_off(outputs).await });
    }
}

/// Whether an op may switch an output on.
fn rises(op: &Op, point: Point) -> bool {
    match op {
        Op::Write(bank) | Op::WriteSilent(bank) => state_in(*bank, point),
        // Whatever it is now, it may be on before it is read again.
        Op::Toggle(_) | Op::Jog { .. } => true,
        _ => false,
    }
}

fn state_in(bank: Bank, point: Point) -> bool {
    bank_state(bank, point) == Some(true)
}

#[cfg(test)]
mod tests {
    use super::super::Service;
    use super::*;
    use crate::{Config, WriteTerms};
    use railbus_device::PointKind;
    use std::time::Duration;

    /// A pump runs, and nothing is known of it for a moment.
    #[tokio::test(start_paused = true)]
    async fn a_command_that_was_never_sent_leaves_the_longest_time_as_it_runs() {
        let text = "[line.main]\nport = \"/dev/railbus-test-nothing-here\"\n\
                    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
                    [module.oven.point]\nk1.max_on = \"1h\"\nk2.max_on = \"1h\"\n";
        let service = Service::start(Config::parse(text).unwrap()).unwrap();
        service.opened("main").await.unwrap();
        let kind = PointKind::Output;
        let points = [0, 1].map(|index| Point { kind, index });
        let [runs, other] = points.map(|point| Place::new("oven", point));
        service.inner.limit_on(&runs).unwrap().promised().await;
        tokio::time::sleep(Duration::from_secs(600)).await;
        let left = |place: &Place| service.inner.schedule.left(place).max_on;
        let before = left(&runs);
        assert!(before.is_some());
        let on = points.map(|point| (point, true));
        let refused = service.write("oven", &on, WriteTerms::default()).await;
        assert_eq!(refused, Err(Failure::Line(Fault::Closed)));
        assert_eq!(left(&runs), before);
        assert_eq!(left(&other), None, "it was never switched on");
        service.close().await;
    }
}
