//! Drives the [`Supervisor`]: threads, the clock, and changes of the configuration.

use super::NORTHBOUND;
use super::kind::{ENABLED, OutletKind, Work};
use super::outlet::{self, Outlet, Report};
use super::secrets::Secrets;
use super::supervisor::{
    Input, Moment, OutletConfig, OutletCounts, OutletId, Output, RunId, Supervised, Supervisor,
};
use crate::access::Gate;
use crate::config::{RemoteConfig, RemoteConfigCalls, remote_config};
use crate::remote_api::{RemoteApi, RemoteCalls, remote_api};
use crate::site::Site;
use axum::Router;
use jiff::Timestamp;
use railbus_api::outlets::OutletState;
use railbus_api::problem::{Problem, codes};
use railbus_site::config::change::Keys;
use railbus_site::{Config, Events, Service};
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;
use tokio::sync::{Notify, Semaphore, oneshot, watch};
use tokio::time::Instant;

/// At the end of the daemon outlets have this time to stop.
const CLOSE_MAX: Duration = Duration::from_secs(1);
/// How many tests run at a time.
const TESTS_MAX: usize = 4;

/// The outlets of a site.
pub(crate) struct Northbound {
    me: Weak<Northbound>,
    /// What the site is called.
    site: Arc<str>,
    service: Service,
    pub(super) secrets: Arc<Secrets>,
    /// The accounts of the daemon.
    accounts: Arc<Gate>,
    /// The API of the daemon, for outlets; and the requests, until they are served.
    api: RemoteApi,
    asked: Mutex<Option<RemoteCalls>>,
    /// The same for its configuration.
    config: RemoteConfig,
    config_calls: Mutex<Option<RemoteConfigCalls>>,
    /// The state folder.
    folder: Arc<Path>,
    began: Instant,
    state: Mutex<State>,
    /// There is an input, or a run has ended.
    pub(super) news: Notify,
    tests: Arc<Semaphore>,
    /// Held while an invitation is accepted.
    pub(super) joins: Arc<tokio::sync::Mutex<()>>,
}

struct State {
    supervisor: Supervisor,
    runs: BTreeMap<RunId, Handles>,
    /// Outlets that were started before the daemon was ready for them.
    early: Option<Vec<(Outlet, Events)>>,
    /// Events to publish once the daemon is ready for them.
    lost: Vec<Event>,
}

/// The channels to a run.
struct Handles {
    stop: watch::Sender<bool>,
    settings: watch::Sender<Keys>,
}

/// For `/metrics`: an outlet, what became of what it was to deliver, and what waits.
#[derive(Debug)]
pub(crate) struct OutletFigures {
    pub(crate) kind: &'static str,
    pub(crate) name: String,
    pub(crate) results: [(&'static str, u64); 4],
    pub(crate) queue: usize,
    /// For kinds that listen.
    pub(crate) clients: Option<usize>,
    /// None where it is switched off.
    pub(crate) is_up: Option<bool>,
}

impl std::fmt::Debug for Northbound {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Northbound")
            .field("site", &self.site)
            .finish_non_exhaustive()
    }
}

impl Northbound {
    /// The outlets of this site. Events from now on wait for them, until [`Northbound::run`].
    pub(crate) fn new(
        site: &str,
        state: &Path,
        service: &Service,
        accounts: &Arc<Gate>,
    ) -> Arc<Northbound> {
        let (secrets, lost) = Secrets::open(state);
        let (api, asked) = remote_api();
        let (config, config_calls) = remote_config();
        let northbound = Arc::new_cyclic(|me| Northbound {
            me: Weak::clone(me),
            site: site.into(),
            service: service.clone(),
            secrets: Arc::new(secrets),
            accounts: Arc::clone(accounts),
            api,
            asked: Mutex::new(Some(asked)),
            config,
            config_calls: Mutex::new(Some(config_calls)),
            folder: state.into(),
            began: Instant::now(),
            state: Mutex::new(State {
                supervisor: Supervisor::default(),
                runs: BTreeMap::new(),
                early: Some(Vec::new()),
                lost: lost.into_iter().map(secrets_lost).collect(),
            }),
            news: Notify::new(),
            tests: Arc::new(Semaphore::new(TESTS_MAX)),
            joins: Arc::default(),
        });
        northbound.configure();
        northbound
    }

    /// Starts them, and follows the configuration: `changes` says when it is another one.
    pub(crate) fn run(self: &Arc<Self>, changes: watch::Receiver<u64>) {
        let lost = std::mem::take(&mut self.state().lost);
        for event in lost {
            self.service.tell_event(event);
        }
        let early = self.state().early.take();
        early
            .into_iter()
            .flatten()
            .for_each(|each| self.spawn(each));
        tokio::spawn(Arc::clone(self).follow(changes));
    }

    /// Answers what outlets ask the API, with these handlers, until the daemon stops.
    pub(crate) fn serve_api(&self, handlers: Router, stop: watch::Receiver<bool>) {
        let mut asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(asked) = asked.take() {
            tokio::spawn(asked.serve(handlers, stop));
        }
    }

    /// Does what outlets want with the configuration, until the daemon stops.
    pub(crate) fn serve_config(&self, site: Site) {
        let calls = &self.config_calls;
        let mut calls = calls.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(calls) = calls.take() {
            tokio::spawn(calls.serve(site));
        }
    }

    async fn follow(self: Arc<Self>, mut changes: watch::Receiver<u64>) {
        self.configure();
        loop {
            // Before the deadline is looked up, so that no other one is missed.
            let news = self.news.notified();
            let deadline = self.state().supervisor.deadline();
            let due = async {
                match deadline {
                    Some(at) => tokio::time::sleep_until(self.began + at).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                changed = changes.changed() => match changed {
                    Ok(()) => self.configure(),
                    // The sender is gone: no more changes.
                    Err(_) => return,
                },
                () = news => {}
                () = due => self.drive(|_, _| {}),
            }
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> Moment {
        Moment {
            at: self.began.elapsed(),
            wall: Timestamp::now(),
        }
    }

    /// Has the outlets of the configuration, and no others, at work.
    fn configure(&self) {
        let wanted = wanted(&self.service.config());
        self.input(Input::Config(wanted));
    }

    pub(super) fn input(&self, input: Input) {
        self.drive(|supervisor, now| supervisor.handle(now, input));
        self.news.notify_waiters();
    }

    /// Changes the supervisor, and does what it says.
    fn drive(&self, change: impl FnOnce(&mut Supervisor, Moment)) {
        let (mut started, mut events) = (Vec::new(), Vec::new());
        {
            let mut state = self.state();
            let state = &mut *state;
            let now = self.now();
            change(&mut state.supervisor, now);
            while let Some(output) = state.supervisor.poll(now) {
                match output {
                    Output::Start(run, id) => {
                        let Some(outlet) = self.outlet(state, run, &id) else {
                            continue;
                        };
                        let started = state.early.as_mut().unwrap_or(&mut started);
                        started.push((outlet, self.service.follow_events()));
                    }
                    // Fails if it has just ended, which the supervisor is notified of.
                    Output::Settings(run, settings) => {
                        if let Some(handles) = state.runs.get(&run) {
                            let _ = handles.settings.send(settings);
                        }
                    }
                    Output::Stop(run) => {
                        if let Some(handles) = state.runs.remove(&run) {
                            let _ = handles.stop.send(true);
                        }
                    }
                    Output::Tell(event) => events.push(*event),
                }
            }
        }
        started.into_iter().for_each(|each| self.spawn(each));
        for event in events {
            self.service.tell_event(event);
        }
    }

    /// What a run of an outlet gets.
    fn outlet(&self, state: &mut State, run: RunId, id: &OutletId) -> Option<Outlet> {
        let supervised = state.supervisor.find(id)?;
        let config = supervised.config()?;
        let (stop, stopped) = watch::channel(false);
        let (settings, changes) = watch::channel(config.settings.clone());
        let counts = Arc::clone(supervised.counts());
        let made = self.make(id, config, (run, counts), (stopped, changes));
        state.runs.insert(run, Handles { stop, settings });
        Some(made)
    }

    fn make(
        &self,
        id: &OutletId,
        config: &OutletConfig,
        (run, counts): (RunId, Arc<OutletCounts>),
        (stop, settings): (watch::Receiver<bool>, watch::Receiver<Keys>),
    ) -> Outlet {
        let rights = outlet::rights(&config.settings);
        Outlet {
            name: id.name.clone(),
            site: Arc::clone(&self.site),
            service: self.service.on_behalf_of(outlet::origin(id), rights),
            settings,
            report: Report {
                run,
                counts,
                to: Weak::clone(&self.me),
            },
            kind: config.kind,
            secrets: Arc::clone(&self.secrets),
            accounts: Arc::clone(&self.accounts),
            api: Arc::new(self.api.for_another()),
            config: self.config.clone(),
            folder: Arc::clone(&self.folder),
            stop,
        }
    }

    fn spawn(&self, (outlet, events): (Outlet, Events)) {
        let (run, me) = (outlet.report.run, Weak::clone(&self.me));
        let ended = move |why| {
            if let Some(northbound) = me.upgrade() {
                northbound.state().runs.remove(&run);
                northbound.input(Input::Ended(run, why));
            }
        };
        if let Err(error) = outlet::spawn(outlet, events, ended) {
            self.state().runs.remove(&run);
            let why = Problem::new(codes::INTERNAL).with("reason", error.to_string());
            self.input(Input::Ended(run, why));
        }
    }

    /// Looks at every outlet of the configuration.
    pub(crate) fn each<T>(&self, look: impl Fn(&OutletId, &Supervised) -> T) -> Vec<T> {
        let state = self.state();
        let all = state.supervisor.outlets();
        all.map(|(id, outlet)| look(id, outlet)).collect()
    }

    /// For `/metrics`.
    pub(crate) fn figures(&self) -> Vec<OutletFigures> {
        self.each(|id, outlet| {
            let counts = outlet.counts();
            let has_clients = super::of_name(id.kind).is_some_and(|kind| kind.has_clients);
            OutletFigures {
                kind: id.kind,
                name: id.name.clone(),
                results: [
                    ("ok", counts.sent.load(Relaxed)),
                    ("refused", counts.refused.load(Relaxed)),
                    ("given_up", counts.given_up.load(Relaxed)),
                    ("dropped", counts.dropped.load(Relaxed)),
                ],
                queue: counts.queue.load(Relaxed),
                clients: has_clients.then(|| counts.clients.load(Relaxed)),
                is_up: outlet
                    .is_wanted()
                    .then(|| outlet.state() == OutletState::Running),
            }
        })
    }

    /// Looks at one outlet.
    pub(crate) fn look<T>(&self, id: &OutletId, look: impl FnOnce(&Supervised) -> T) -> Option<T> {
        self.state().supervisor.find(id).map(look)
    }

    /// Whether an outlet has a secret.
    pub(super) fn has_secret(&self, kind: &OutletKind, outlet: &str) -> bool {
        self.secrets.of(kind, outlet).is_some()
    }

    /// The wall-clock time of a moment of the supervisor.
    pub(crate) fn wall(&self, at: Duration) -> Timestamp {
        let wait = at.saturating_sub(self.began.elapsed());
        let now = Timestamp::now();
        now.checked_add(wait).unwrap_or(now)
    }

    /// Tries something with what an outlet has, on a thread of its own, beside its run, in the name
    /// of who asks for it. It has to stop when its caller is gone.
    ///
    /// # Errors
    /// There is no such outlet, too many are tried at once, or it panicked.
    pub(crate) async fn aside<T: Send + 'static>(
        &self,
        id: &OutletId,
        by: Origin,
        what: fn(Outlet) -> Work<T>,
    ) -> Result<T, Problem> {
        let internal = |reason: String| Problem::new(codes::INTERNAL).with("reason", reason);
        let Ok(turn) = Arc::clone(&self.tests).try_acquire_owned() else {
            return Err(Problem::new(codes::OVERLOADED));
        };
        let made = self.look(id, |supervised| {
            let config = supervised.config()?;
            let (stop, stopped) = watch::channel(false);
            let (settings, changes) = watch::channel(config.settings.clone());
            let run = (RunId(0), Arc::default());
            let outlet = self.make(id, config, run, (stopped, changes));
            Some((outlet, Handles { stop, settings }))
        });
        // Dropped with this call, which is what stops the test.
        let Some((mut outlet, _handles)) = made.flatten() else {
            return Err(super::missing(id));
        };
        let rights = outlet::rights(&outlet.settings.borrow());
        outlet.service = self.service.on_behalf_of(by, rights);
        let (done, end) = oneshot::channel();
        let thread = std::thread::Builder::new().name("outlet test".to_owned());
        let spawned = thread.spawn(move || {
            // Fails if the caller has gone.
            let _ = done.send(outlet::on_this_thread(|| what(outlet)));
            // Not earlier, though the caller may have gone: a test that hangs counts.
            drop(turn);
        });
        spawned.map_err(|error| internal(error.to_string()))?;
        let end = end.await.map_err(|error| internal(error.to_string()))?;
        end.map_err(internal)
    }

    /// The state folder.
    pub(super) fn folder(&self) -> Arc<Path> {
        Arc::clone(&self.folder)
    }

    /// Stops them all. Those that do not stop in time are left alone.
    pub(crate) async fn close(&self) {
        self.input(Input::Close);
        let idle = async {
            loop {
                let news = self.news.notified();
                if self.state().supervisor.is_idle() {
                    return;
                }
                news.await;
            }
        };
        let _ = tokio::time::timeout(CLOSE_MAX, idle).await;
    }
}

/// The event about secrets that can't be read.
fn secrets_lost((kind, problem): (&'static OutletKind, Problem)) -> Event {
    let code = kind.event("secrets_lost");
    Event::new(EventKind::System, Severity::Error, &code).text(problem.code)
}

/// The outlets of a configuration.
fn wanted(config: &Config) -> BTreeMap<OutletId, OutletConfig> {
    let mut all = BTreeMap::new();
    for kind in NORTHBOUND {
        for (name, settings) in (kind.outlets)(kind, config) {
            let id = OutletId {
                kind: kind.name,
                name,
            };
            let config = OutletConfig {
                kind,
                is_enabled: settings.get(ENABLED) != Some(&false.into()),
                settings,
            };
            all.insert(id, config);
        }
    }
    all
}
