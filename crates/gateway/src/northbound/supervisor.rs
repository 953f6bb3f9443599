//! Which outlets run: started, stopped and restarted as the configuration says, and again after a
//! while where one ends by itself. No clock, no thread: [`super::run`] drives it.

use super::kind::{OnChange, OutletKind};
use jiff::Timestamp;
use railbus_api::outlets::{OutletError, OutletState};
use railbus_api::problem::{Problem, codes};
use railbus_site::config::change::Keys;
use railbus_store::history::{Event, EventKind, Severity};
use railbus_words::time::rfc3339;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicU64, AtomicUsize};
use std::time::Duration;

/// The time an outlet has to stop before it is abandoned.
pub(super) const STOP_MAX: Duration = Duration::from_secs(5);
/// The longest wait before an outlet that ended is started again.
const WAIT_MAX: Duration = Duration::from_secs(60);
/// An outlet that has run for so long is started again without a longer wait than the first time.
const STEADY: Duration = Duration::from_secs(60);
/// After so many failures in a row there is an event.
const TOLD_AFTER: u32 = 3;
/// How many outlets that do not stop are left alone before no other is started.
const STUCK_MAX: usize = 8;

/// The time: since the start of the supervisor, and for people.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    pub(super) at: Duration,
    pub(super) wall: Timestamp,
}

/// Which outlet.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct OutletId {
    pub(crate) kind: &'static str,
    pub(crate) name: String,
}

/// An outlet as the configuration has it.
#[derive(Clone, Debug)]
pub(crate) struct OutletConfig {
    pub(crate) kind: &'static OutletKind,
    pub(crate) settings: Keys,
    pub(crate) is_enabled: bool,
}

/// One run of an outlet, from its start to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct RunId(pub(super) u64);

/// What an outlet counts, since the daemon started or the outlet was added.
#[derive(Debug, Default)]
pub(crate) struct OutletCounts {
    /// What was delivered.
    pub(crate) sent: AtomicU64,
    /// What the other side refused for good.
    pub(crate) refused: AtomicU64,
    /// What was tried as often as it may be.
    pub(crate) given_up: AtomicU64,
    /// What was never tried, or not to the end, because too much waited.
    pub(crate) dropped: AtomicU64,
    /// What waits, including what is being sent.
    pub(crate) queue: AtomicUsize,
    /// Who is connected to it, for kinds that listen.
    pub(crate) clients: AtomicUsize,
}

#[derive(Debug)]
pub(super) enum Input {
    /// These are the outlets from now on.
    Config(BTreeMap<OutletId, OutletConfig>),
    /// It has begun its work.
    Ready(RunId),
    /// It delivered something.
    Worked(RunId),
    /// What it did failed; it tries again by itself after this time, if at all.
    Failed(RunId, OutletError, Option<Duration>),
    /// Something that it does not fail by.
    Noted(RunId, OutletError),
    /// It ended, and why.
    Ended(RunId, Problem),
    /// The daemon stops.
    Close,
}

#[derive(Debug)]
pub(super) enum Output {
    /// Start it.
    Start(RunId, OutletId),
    /// Hand it its new settings.
    Settings(RunId, Keys),
    /// Ask it to stop.
    Stop(RunId),
    /// Tell the site.
    Tell(Box<Event>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// It is not to run.
    Stopped,
    Starting(RunId),
    /// It works. After failures: when they are forgotten.
    Running(RunId, Option<Duration>),
    /// It runs, but what it does fails. When it tries again.
    Failing(RunId, Option<Duration>),
    /// It ended by itself, and is started again then.
    Waiting(Duration),
    /// It was asked to stop, and is abandoned then.
    Stopping(RunId, Duration),
}

/// One outlet.
#[derive(Debug)]
pub(crate) struct Supervised {
    kind: &'static OutletKind,
    /// As the configuration has it; none once it is gone.
    config: Option<OutletConfig>,
    phase: Phase,
    /// When it came into this state.
    since: Timestamp,
    /// How many times in a row it failed.
    failures: u32,
    /// There was an event about its failures.
    is_told: bool,
    error: Option<OutletError>,
    worked: Option<Timestamp>,
    counts: Arc<OutletCounts>,
}

/// All of them.
#[derive(Debug, Default)]
pub(crate) struct Supervisor {
    outlets: BTreeMap<OutletId, Supervised>,
    /// Runs that were asked to stop and did not.
    stuck: BTreeSet<RunId>,
    newest: u64,
    is_closing: bool,
    out: VecDeque<Output>,
}

impl Supervised {
    /// As the configuration has it.
    pub(crate) const fn config(&self) -> Option<&OutletConfig> {
        self.config.as_ref()
    }

    pub(crate) const fn state(&self) -> OutletState {
        match self.phase {
            Phase::Stopped | Phase::Stopping(..) => OutletState::Stopped,
            Phase::Starting(_) => OutletState::Starting,
            Phase::Running(..) => OutletState::Running,
            Phase::Failing(..) | Phase::Waiting(_) => OutletState::Waiting,
        }
    }

    pub(crate) const fn since(&self) -> Timestamp {
        self.since
    }

    /// When it is tried again.
    pub(crate) const fn retry_at(&self) -> Option<Duration> {
        match self.phase {
            Phase::Failing(_, at) => at,
            Phase::Waiting(at) => Some(at),
            _ => None,
        }
    }

    /// How many times in a row it has failed.
    pub(crate) const fn failures(&self) -> u32 {
        self.failures
    }

    /// The last failure.
    pub(crate) const fn error(&self) -> Option<&OutletError> {
        self.error.as_ref()
    }

    /// When it last delivered something.
    pub(crate) const fn worked(&self) -> Option<Timestamp> {
        self.worked
    }

    pub(crate) const fn counts(&self) -> &Arc<OutletCounts> {
        &self.counts
    }

    const fn run(&self) -> Option<RunId> {
        match self.phase {
            Phase::Starting(run)
            | Phase::Running(run, _)
            | Phase::Failing(run, _)
            | Phase::Stopping(run, _) => Some(run),
            Phase::Stopped | Phase::Waiting(_) => None,
        }
    }

    /// When time changes something.
    const fn deadline(&self) -> Option<Duration> {
        match self.phase {
            Phase::Running(_, at) => at,
            Phase::Waiting(at) | Phase::Stopping(_, at) => Some(at),
            Phase::Stopped | Phase::Starting(_) | Phase::Failing(..) => None,
        }
    }

    /// Whether it is to run.
    pub(crate) fn is_wanted(&self) -> bool {
        self.config.as_ref().is_some_and(|config| config.is_enabled)
    }

    fn enter(&mut self, now: Moment, phase: Phase) {
        let before = self.state();
        self.phase = phase;
        if self.state() != before {
            self.since = now.wall;
        }
    }

    /// Notes a failure; `is_final` if it is not tried again. The event that it makes.
    fn failed(&mut self, id: &OutletId, error: OutletError, is_final: bool) -> Option<Event> {
        self.failures = self.failures.saturating_add(1);
        let code = error.problem.code.clone();
        self.error = Some(error);
        let is_news = (is_final || self.failures >= TOLD_AFTER) && !self.is_told;
        self.is_told |= is_news;
        let event = || id.event(self.kind, "fails", Severity::Warning).text(code);
        is_news.then(event)
    }

    /// Forgets its failures. The event that this makes.
    fn recovered(&mut self, id: &OutletId) -> Option<Event> {
        self.failures = 0;
        let was_told = std::mem::take(&mut self.is_told);
        was_told.then(|| id.event(self.kind, "works", Severity::Info))
    }
}

impl OutletId {
    /// An event about it, by its last word.
    fn event(&self, kind: &OutletKind, what: &str, severity: Severity) -> Event {
        let code = kind.event(what);
        Event::new(EventKind::System, severity, &code).what(&self.name)
    }
}

impl Supervisor {
    /// Takes in what happened.
    pub(super) fn handle(&mut self, now: Moment, input: Input) {
        match input {
            Input::Config(wanted) => self.configure(now, wanted),
            Input::Ready(run) => self.ready(now, run),
            Input::Worked(run) => self.worked(now, run),
            Input::Failed(run, error, retry) => self.failed(now, run, error, retry),
            Input::Noted(run, error) => self.with(run, |_, _, outlet| {
                // What it fails by is to be seen as long as it does.
                if !matches!(outlet.phase, Phase::Failing(..)) {
                    outlet.error = Some(error);
                }
            }),
            Input::Ended(run, why) => self.ended(now, run, why),
            Input::Close => {
                self.is_closing = true;
                self.each(|supervisor, _, outlet| supervisor.stop(now, outlet));
            }
        }
    }

    /// What is to be done; none until the next input or [`Supervisor::deadline`].
    pub(super) fn poll(&mut self, now: Moment) -> Option<Output> {
        if self.deadline().is_some_and(|at| at <= now.at) {
            self.each(|supervisor, id, outlet| {
                if outlet.deadline().is_some_and(|at| at <= now.at) {
                    supervisor.due(now, id, outlet);
                }
            });
        }
        self.out.pop_front()
    }

    /// When to poll at the latest.
    pub(super) fn deadline(&self) -> Option<Duration> {
        self.outlets.values().filter_map(Supervised::deadline).min()
    }

    /// Every outlet of the configuration.
    pub(crate) fn outlets(&self) -> impl Iterator<Item = (&OutletId, &Supervised)> {
        let all = self.outlets.iter();
        all.filter(|(_, outlet)| outlet.config.is_some())
    }

    /// An outlet of the configuration.
    pub(super) fn find(&self, id: &OutletId) -> Option<&Supervised> {
        let found = self.outlets.get(id);
        found.filter(|outlet| outlet.config.is_some())
    }

    /// Whether none runs that was not left alone.
    pub(super) fn is_idle(&self) -> bool {
        self.outlets.values().all(|outlet| outlet.run().is_none())
    }

    /// Does something with each outlet, and drops those that are gone.
    fn each(&mut self, what: impl Fn(&mut Supervisor, &OutletId, &mut Supervised)) {
        let mut outlets = std::mem::take(&mut self.outlets);
        for (id, outlet) in &mut outlets {
            what(self, id, outlet);
        }
        outlets.retain(|_, outlet| outlet.config.is_some() || outlet.run().is_some());
        self.outlets = outlets;
    }

    /// Does something with the outlet of this run, unless the run was left alone.
    fn with(&mut self, run: RunId, what: impl FnOnce(&mut Supervisor, &OutletId, &mut Supervised)) {
        let mut outlets = std::mem::take(&mut self.outlets);
        let found = outlets
            .iter_mut()
            .find(|(_, outlet)| outlet.run() == Some(run));
        if let Some((id, outlet)) = found {
            what(self, id, outlet);
        }
        outlets.retain(|_, outlet| outlet.config.is_some() || outlet.run().is_some());
        self.outlets = outlets;
    }

    fn configure(&mut self, now: Moment, mut wanted: BTreeMap<OutletId, OutletConfig>) {
        let mut outlets = std::mem::take(&mut self.outlets);
        for (id, outlet) in &mut outlets {
            let next = wanted.remove(id);
            let is_same = match (&outlet.config, &next) {
                (Some(old), Some(new)) => {
                    old.is_enabled == new.is_enabled && old.settings == new.settings
                }
                (old, new) => old.is_none() && new.is_none(),
            };
            if !is_same {
                outlet.config = next;
                self.changed(now, id, outlet);
            }
        }
        for (id, config) in wanted {
            let mut outlet = Supervised {
                kind: config.kind,
                config: Some(config),
                phase: Phase::Stopped,
                since: now.wall,
                failures: 0,
                is_told: false,
                error: None,
                worked: None,
                counts: Arc::default(),
            };
            self.start(now, &id, &mut outlet);
            outlets.insert(id, outlet);
        }
        outlets.retain(|_, outlet| outlet.config.is_some() || outlet.run().is_some());
        self.outlets = outlets;
    }

    /// The configuration has it otherwise.
    fn changed(&mut self, now: Moment, id: &OutletId, outlet: &mut Supervised) {
        match (outlet.phase, &outlet.config) {
            (Phase::Stopping(..), _) => {}
            (Phase::Stopped | Phase::Waiting(_), _) => {
                outlet.failures = 0;
                outlet.enter(now, Phase::Stopped);
                self.start(now, id, outlet);
            }
            (
                Phase::Starting(run) | Phase::Running(run, _) | Phase::Failing(run, _),
                Some(config),
            ) if config.is_enabled && outlet.kind.on_change == OnChange::HandOver => {
                let settings = config.settings.clone();
                self.out.push_back(Output::Settings(run, settings));
            }
            _ => self.stop(now, outlet),
        }
    }

    /// Starts it, if it is to run.
    fn start(&mut self, now: Moment, id: &OutletId, outlet: &mut Supervised) {
        if self.is_closing || !outlet.is_wanted() {
            return outlet.enter(now, Phase::Stopped);
        }
        if self.stuck.len() >= STUCK_MAX {
            let problem = Problem::new(codes::OUTLET_STUCK).with("name", id.name.as_str());
            return self.wait(now, id, outlet, problem);
        }
        self.newest += 1;
        let run = RunId(self.newest);
        outlet.enter(now, Phase::Starting(run));
        self.out.push_back(Output::Start(run, id.clone()));
    }

    /// Asks it to stop, if it runs.
    fn stop(&mut self, now: Moment, outlet: &mut Supervised) {
        let phase = match (outlet.run(), outlet.phase) {
            (_, Phase::Stopping(..)) => return,
            (Some(run), _) => {
                self.out.push_back(Output::Stop(run));
                Phase::Stopping(run, now.at + STOP_MAX)
            }
            (None, _) => Phase::Stopped,
        };
        outlet.enter(now, phase);
    }

    /// It failed, and is started again after a while.
    fn wait(&mut self, now: Moment, id: &OutletId, outlet: &mut Supervised, why: Problem) {
        let error = OutletError {
            at: rfc3339(now.wall),
            tries: outlet.failures.saturating_add(1),
            problem: why,
        };
        let event = outlet.failed(id, error, false);
        self.tell(event);
        let wait = Duration::from_secs(1 << outlet.failures.saturating_sub(1).min(6));
        outlet.enter(now, Phase::Waiting(now.at + wait.min(WAIT_MAX)));
    }

    fn ready(&mut self, now: Moment, run: RunId) {
        self.with(run, |_, _, outlet| {
            if matches!(outlet.phase, Phase::Starting(_)) {
                let steady = (outlet.failures > 0).then_some(now.at + STEADY);
                outlet.enter(now, Phase::Running(run, steady));
            }
        });
    }

    fn worked(&mut self, now: Moment, run: RunId) {
        self.with(run, |supervisor, id, outlet| {
            outlet.worked = Some(now.wall);
            let event = outlet.recovered(id);
            supervisor.tell(event);
            if !matches!(outlet.phase, Phase::Stopping(..)) {
                outlet.enter(now, Phase::Running(run, None));
            }
        });
    }

    fn failed(&mut self, now: Moment, run: RunId, error: OutletError, retry: Option<Duration>) {
        self.with(run, |supervisor, id, outlet| {
            let event = outlet.failed(id, error, retry.is_none());
            supervisor.tell(event);
            if !matches!(outlet.phase, Phase::Stopping(..)) {
                let at = retry.map(|wait| now.at + wait);
                outlet.enter(now, Phase::Failing(run, at));
            }
        });
    }

    fn ended(&mut self, now: Moment, run: RunId, why: Problem) {
        self.stuck.remove(&run);
        self.with(run, |supervisor, id, outlet| {
            // What waited for it is gone with it.
            outlet.counts.queue.store(0, Relaxed);
            outlet.counts.clients.store(0, Relaxed);
            match outlet.phase {
                Phase::Stopping(..) => {
                    outlet.enter(now, Phase::Stopped);
                    supervisor.start(now, id, outlet);
                }
                _ => supervisor.wait(now, id, outlet, why),
            }
        });
    }

    /// Its time has come.
    fn due(&mut self, now: Moment, id: &OutletId, outlet: &mut Supervised) {
        match outlet.phase {
            Phase::Running(run, _) => {
                let event = outlet.recovered(id);
                self.tell(event);
                outlet.enter(now, Phase::Running(run, None));
            }
            Phase::Waiting(_) => self.start(now, id, outlet),
            Phase::Stopping(run, _) => {
                self.stuck.insert(run);
                outlet.enter(now, Phase::Stopped);
                self.start(now, id, outlet);
            }
            Phase::Stopped | Phase::Starting(_) | Phase::Failing(..) => {}
        }
    }

    fn tell(&mut self, event: Option<Event>) {
        let event = event.map(|event| Output::Tell(Box::new(event)));
        self.out.extend(event);
    }
}

#[cfg(test)]
mod tests;
