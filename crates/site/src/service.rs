//! A site at work: its lines opened, and its [`Core`] driven by them, by the clock and by whoever
//! asks for something.

mod loan;
mod meter;
mod promise_file;
mod record;
mod reload;
mod rules;
mod send;
mod status;
mod update;

pub use loan::{LOAN_MAX, Loan};
pub(crate) use meter::Busy;
pub use meter::{Counts, STEPS};
pub use record::{Events, Work};
pub use reload::Reloaded;
pub use rules::RuleStatus;
pub use send::{Sent, is_refused};
pub use status::{Left, LineStatus, ModuleStatus, PointStatus};
pub use update::{Update, Updates};

use crate::config::Place;
use crate::core::{
    BatchDone, BatchTerms, Command, Context, Core, GroupState, Input, Leased, LineId, Now, Output,
    Pulse, PulseDone, Reply, RequestId, State, ToggleTerms, Turn, Who, WriteDone, WriteTerms,
    boards,
};
use crate::{Config, Failure};
use railbus_device::{Module, Point, SetupError};
use railbus_host::{
    Fault, Line, LineConfig, LineName, NameError, PortError, Probe, ProbeResult, Tap, Terms,
};
use railbus_store::audit::{Audit, Entry, Origin};
use railbus_wire::{Exchange, Instant, Micros, Settings};
use record::Journal;
use rules::Standings;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, SystemTime};
use tokio::sync::{Notify, broadcast, oneshot};

/// How long a frame of one's own waits for the reply to begin, where nobody says.
const RAW_TIMEOUT: Micros = Micros::from_millis(300);

/// How many updates wait for a subscriber before the oldest are dropped.
const UPDATES_MAX: usize = 256;

/// Why a site can't be started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StartError {
    /// The name of a line's port is none.
    Port(String, NameError),
    /// A module can't be as described.
    Setup(String, SetupError),
    /// The folder of the site's state can't be used.
    Folder(std::io::ErrorKind),
    /// The system refuses what it always grants.
    System(PortError),
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StartError::Port(line, why) => write!(f, "line {line}: {why}"),
            StartError::Setup(module, why) => write!(f, "module {module}: {why}"),
            StartError::Folder(why) => write!(f, "the folder of the state: {why}"),
            StartError::System(why) => why.fmt(f),
        }
    }
}

impl std::error::Error for StartError {}

/// A site at work. Clones are handles of the same site; its lines are closed by
/// [`Service::close`], or when the last handle and the last pulse have gone.
///
/// Reads take what is known, and never wait for the line; how old it is, is a part of the
/// answer. Commands go to the line and wait for their end.
#[derive(Clone, Debug)]
pub struct Service {
    inner: Arc<Inner>,
    /// For whom this handle acts.
    origin: Arc<Origin>,
}

pub(crate) struct Inner {
    driven: Mutex<Driven>,
    /// The core has to be told of the time earlier than it was to be.
    alarm: Arc<Notify>,
    newest_line: AtomicU64,
    /// Where what must outlive the process is kept.
    folder: Option<PathBuf>,
    audit: Audit,
    journal: Journal,
    rules: Standings,
    updates: broadcast::Sender<Update>,
    /// Only one at a time may change the configuration.
    reloading: tokio::sync::Mutex<()>,
    runtime: tokio::runtime::Handle,
    start: tokio::time::Instant,
    polls: bool,
}

/// The core, and what it is driven with: one lock for all of it.
struct Driven {
    core: Core,
    lines: BTreeMap<LineId, Line>,
    /// When the core is told of the time, of the site, at the latest.
    alarm_at: Option<Micros>,
    /// While something is under way, the site does not go with its last handle.
    site: Option<Arc<Inner>>,
}

impl fmt::Debug for Inner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Inner")
            .field("start", &self.start)
            .field("polls", &self.polls)
            .finish_non_exhaustive()
    }
}

impl Drop for Inner {
    /// Whoever tells the time need not any more.
    fn drop(&mut self) {
        self.alarm.notify_one();
    }
}

/// A panic while the lock was held leaves values that are each whole.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Service {
    /// Opens the lines of a site and reads its modules again and again. To be called inside a
    /// tokio runtime with I/O and time enabled.
    ///
    /// # Errors
    /// [`StartError`]. A port that can't be opened is none: it is looked for until it is there.
    pub fn start(config: Config) -> Result<Service, StartError> {
        Service::start_with(config, true, None)
    }

    /// The same with a folder for what must outlive the process: pulses that are timed here end
    /// after a restart too, and outputs stay off for as long as they must.
    ///
    /// # Errors
    /// As [`Service::start`]; also where the folder can't be used.
    pub fn start_in(config: Config, folder: &Path) -> Result<Service, StartError> {
        Service::start_with(config, true, Some(folder))
    }

    /// The same, but only what is asked for is read: for a single command.
    ///
    /// # Errors
    /// As [`Service::start`].
    pub fn start_quiet(config: Config) -> Result<Service, StartError> {
        Service::start_with(config, false, None)
    }

    fn start_with(
        config: Config,
        polls: bool,
        folder: Option<&Path>,
    ) -> Result<Service, StartError> {
        let kept = folder.map_or_else(|| Ok(Vec::new()), promise_file::open);
        let kept = kept.map_err(|why| StartError::Folder(why.kind()))?;
        let names: Vec<String> = config.lines.keys().cloned().collect();
        let prepared: Vec<LineConfig> = names
            .iter()
            .map(|name| prepare(&config, name, polls))
            .collect::<Result<_, _>>()?;
        let now = Now {
            site: Micros::ZERO,
            wall: SystemTime::now(),
        };
        let service = Service {
            inner: Arc::new(Inner {
                driven: Mutex::new(Driven {
                    core: Core::new(now, config, polls, kept),
                    lines: BTreeMap::new(),
                    alarm_at: None,
                    site: None,
                }),
                alarm: Arc::default(),
                newest_line: AtomicU64::new(0),
                folder: folder.map(Path::to_owned),
                audit: Audit::default(),
                journal: Journal::default(),
                rules: Standings::default(),
                updates: broadcast::Sender::new(UPDATES_MAX),
                reloading: tokio::sync::Mutex::new(()),
                runtime: tokio::runtime::Handle::current(),
                start: tokio::time::Instant::now(),
                polls,
            }),
            origin: Arc::new(Origin::program("railbus")),
        };
        tokio::spawn(tell_time(
            Arc::downgrade(&service.inner),
            Arc::clone(&service.inner.alarm),
        ));
        for (name, prepared) in names.into_iter().zip(prepared) {
            service.open(&name, prepared).map_err(StartError::System)?;
        }
        service.inner.drive(|core, now| core.take_up(now));
        Ok(service)
    }

    /// A handle of the same site that acts for somebody: what it does is written down under that
    /// name.
    #[must_use]
    pub fn on_behalf_of(&self, origin: Origin) -> Service {
        Service {
            inner: Arc::clone(&self.inner),
            origin: Arc::new(origin),
        }
    }

    /// Opens a line whose events the core hears of before anyone else.
    fn open(&self, name: &str, mut config: LineConfig) -> Result<(), PortError> {
        let id = LineId(self.inner.newest_line.fetch_add(1, Ordering::Relaxed));
        let inner = Arc::downgrade(&self.inner);
        let line = name.to_owned();
        config.observer = Some(Box::new(move |event| {
            // The task outlives the site only while it closes its port.
            if let Some(inner) = inner.upgrade() {
                inner.drive(|core, now| core.handle(now, Input::Line(id, &line, event)));
            }
        }));
        let opened = Line::open(config)?;
        // In this order: a reading never seems newer than it is.
        let began = self.inner.now().site - opened.now().since(Instant(0));
        let mut driven = lock(&self.inner.driven);
        driven.lines.insert(id, opened);
        driven
            .core
            .handle(self.inner.now(), Input::Opened(name, id, began));
        Ok(())
    }

    /// What changes from now on. The newest updates are kept for a slow subscriber, which is
    /// told how many older ones it missed.
    #[must_use]
    pub fn subscribe(&self) -> Updates {
        Updates::new(self.inner.updates.subscribe())
    }

    /// What was done lately, oldest first.
    #[must_use]
    pub fn audit(&self) -> Vec<Entry> {
        self.inner.audit.newest()
    }

    /// A command that was given lately, by its number.
    #[must_use]
    pub fn command(&self, id: &str) -> Option<Command> {
        lock(&self.inner.driven).core.command(id).cloned()
    }

    /// Waits until the port of a line is open, or could not be opened once.
    ///
    /// # Errors
    /// [`Failure::NoSuchLine`]. How the port is, [`Service::line`] says.
    pub async fn opened(&self, line: &str) -> Result<(), Failure> {
        let handle = self.inner.handle(line).ok_or(Failure::NoSuchLine)?;
        // The reason is a part of the line's status.
        let _ = handle.opened().await;
        Ok(())
    }

    /// Ends the site: outputs of pulses and leases are released, those with a policy for the end
    /// are switched, commands under way get a second to end, the frames on the wire leave, the
    /// ports are closed. New commands are refused from the beginning on.
    pub async fn close(&self) {
        self.ask(|core, _| async move {
            core.stop_all().await;
            core.exit_policy().await;
        })
        .await;
        let lines = {
            let mut driven = lock(&self.inner.driven);
            for line in driven.core.state(self.inner.now()).lines.values_mut() {
                line.id = None;
            }
            std::mem::take(&mut driven.lines)
        };
        close_all(lines.into_values()).await;
    }

    /// Starts a procedure of the core on behalf of this handle and waits for its end. It goes on
    /// where nobody waits any more.
    async fn ask<T, F>(&self, procedure: impl FnOnce(Context, Who) -> F) -> Option<T>
    where
        T: Send + 'static,
        F: Future<Output = T> + Send + 'static,
    {
        let (end, ended) = oneshot::channel();
        let who = Arc::clone(&self.origin);
        self.inner.drive(|core, now| {
            // Fails where nobody waits any more.
            let end = |value| _ = end.send(value);
            core.start(now, |context| procedure(context, who), end);
        });
        ended.await.ok()
    }

    /// The same of what may fail.
    async fn order<T, F>(&self, procedure: impl FnOnce(Context, Who) -> F) -> Result<T, Failure>
    where
        T: Send + 'static,
        F: Future<Output = Result<T, Failure>> + Send + 'static,
    {
        let end = self.ask(procedure).await;
        // It has none only where a procedure has broken down.
        end.unwrap_or_else(|| Err(Fault::Unknown.into()))
    }

    /// Brings outputs of one module into these states with one command of the line, and leaves
    /// the others alone.
    ///
    /// # Errors
    /// [`Failure`]; [`Failure::may_have_acted`] says whether something may have happened even
    /// so.
    pub async fn write(
        &self,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
    ) -> Result<WriteDone, Failure> {
        let (module, set) = (module.to_owned(), set.to_vec());
        self.order(|core, who| async move { core.write(&who, &module, &set, terms).await })
            .await
    }

    /// Switches an output over. Where it is read first and then set, someone else may come
    /// between.
    ///
    /// # Errors
    /// As [`Service::write`]; [`Fault::Unsupported`] where the model has no such command.
    pub async fn toggle(
        &self,
        module: &str,
        point: Point,
        terms: ToggleTerms,
    ) -> Result<WriteDone, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.toggle(&who, &module, point, terms).await })
            .await
    }

    /// Gives a pulse; returns when it has begun. One that is timed here is ended by the site,
    /// which also tries again until the output is released, another command takes the
    /// output over, or the site is closed. Its end is written down before it begins
    /// ([`Service::start_in`]), and done after a restart where that comes between.
    ///
    /// # Errors
    /// [`Failure::PulseWidth`] where the module has no such pulse, or as [`Service::write`].
    /// Where the module may have acted, the output is released all the same.
    pub async fn pulse(
        &self,
        module: &str,
        point: Point,
        pulse: Pulse,
    ) -> Result<PulseDone, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.pulse(&who, &module, point, pulse).await })
            .await
    }

    /// Waits until all pulses that are timed here have ended.
    pub async fn pulses_ended(&self) {
        self.ask(|core, _| async move { core.all_ended().await })
            .await;
    }

    /// Brings an output into a state and holds it there for a time. Before that time is over it
    /// is to be called again, or the output goes where its policy says (`on_offline`), and
    /// without one into its other state. Another command takes it over.
    ///
    /// # Errors
    /// [`Failure::LeaseTime`], or as [`Service::write`].
    pub async fn lease(
        &self,
        module: &str,
        point: Point,
        held: (bool, Micros),
        confirm: bool,
    ) -> Result<Leased, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.lease(&who, &module, point, held, confirm).await })
            .await
    }

    /// Gives an output back before its time is over: it goes where it would have gone then.
    /// Nothing comes back where it is to stay as it is.
    ///
    /// # Errors
    /// [`Failure::NoLease`], or as [`Service::write`].
    pub async fn end_lease(
        &self,
        module: &str,
        point: Point,
    ) -> Result<Option<WriteDone>, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.end_lease(&who, &module, point).await })
            .await
    }

    /// Switches outputs of any modules. Those of one module go together; where some of them
    /// exclude each other, what goes off goes before what goes on. Where it is all or nothing,
    /// nobody else commands the outputs meanwhile.
    pub async fn batch(&self, set: &[(Place, bool)], terms: BatchTerms) -> BatchDone {
        let asked = set.to_vec();
        let end = self.ask(|core, who| async move { core.batch(&who, &asked, terms).await });
        end.await.unwrap_or_else(|| BatchDone::unknown(set))
    }

    /// Brings a group into a state.
    ///
    /// # Errors
    /// [`Failure::NoSuchGroup`]; where it is to be toggled, also as [`Service::write`] while
    /// others command it.
    pub async fn set_group(
        &self,
        group: &str,
        to: GroupState,
        terms: BatchTerms,
    ) -> Result<BatchDone, Failure> {
        let group = group.to_owned();
        self.order(|core, who| async move { core.set_group(&who, &group, to, terms).await })
            .await
    }

    /// Plays a scene: its steps in their order, those of one module that follow each other and
    /// go the same way with one command. After a step that fails, nothing more is done: later
    /// ones may rely on it. It is played to its end, whether or not somebody waits.
    ///
    /// # Errors
    /// [`Failure::NoSuchScene`]; [`Failure::Playing`] while it is played already.
    pub async fn play(&self, scene: &str, terms: BatchTerms) -> Result<BatchDone, Failure> {
        let scene = scene.to_owned();
        self.order(|core, who| async move { core.play(&who, &scene, terms).await })
            .await
    }

    /// In how many frames these outputs can be brought into one state.
    #[must_use]
    pub fn frames_of(&self, outputs: &[Place]) -> usize {
        self.inner.read(|state| state.frames_of(outputs))
    }

    /// Asks a module for everything now. What it says is known when this returns.
    ///
    /// # Errors
    /// [`Failure::NoSuchModule`], or what the line said.
    pub async fn read_fresh(&self, module: &str) -> Result<(), Failure> {
        let module = module.to_owned();
        self.order(|core, _| async move { core.read_all(&module).await })
            .await
    }

    /// Sends a read of one's own between the line's own exchanges.
    ///
    /// # Errors
    /// [`Failure::NoSuchLine`], or what the line said.
    pub async fn raw(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
    ) -> Result<ProbeResult, Failure> {
        let (handle, probe) = self.probe_of(line, exchange, terms)?;
        Ok(handle.probe(probe).await?)
    }

    /// A line, and a frame of one's own as it is to be sent there.
    pub(super) fn probe_of(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
    ) -> Result<(Line, Probe), Failure> {
        let status = self.line(line).ok_or(Failure::NoSuchLine)?;
        let handle = self.inner.handle(line).ok_or(Failure::Lent)?;
        let settings = terms.settings.unwrap_or(status.serial);
        // What the slowest of the families wants.
        let gap = Micros::from_millis(20).max(settings.t3_5());
        let probe = Probe {
            exchange,
            settings,
            gap: terms.gap.unwrap_or(gap),
            timeout: terms.timeout.unwrap_or(RAW_TIMEOUT),
            clear: terms.clear,
            changes: false,
        };
        Ok((handle, probe))
    }

    /// Looks on at what passes on a line, without touching it. The moment is now as the line
    /// counts.
    ///
    /// # Errors
    /// [`Failure::NoSuchLine`], or [`Fault::Closed`] while the line has no port.
    pub async fn tap(&self, line: &str) -> Result<(Instant, Tap), Failure> {
        let handle = self.inner.handle(line).ok_or(Failure::NoSuchLine)?;
        // A line that is only just being opened will have a port in a moment.
        let _ = handle.opened().await;
        let tap = handle.tap().await?;
        Ok((handle.now(), tap))
    }
}

/// On what terms a read of one's own is sent; what is not said is as the line has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawTerms {
    /// Speed and character format.
    pub settings: Option<Settings>,
    /// The silence before it.
    pub gap: Option<Micros>,
    /// How long the reply may take to begin.
    pub timeout: Option<Micros>,
    /// A lone CR goes before it: see [`railbus_host::Probe::clear`].
    pub clear: bool,
}

/// Closes lines side by side.
async fn close_all(lines: impl Iterator<Item = Line>) {
    let close = |line: Line| tokio::spawn(async move { line.close().await });
    let closing: Vec<_> = lines.map(close).collect();
    for line in closing {
        // Fails only where the runtime itself ends.
        let _ = line.await;
    }
}

/// Tells the core of the time when it wants that.
async fn tell_time(site: Weak<Inner>, alarm: Arc<Notify>) {
    let mut next = None;
    loop {
        tokio::select! {
            () = alarm.notified() => {}
            () = sleep_until(next) => {}
        }
        let Some(inner) = site.upgrade() else {
            return;
        };
        inner.drive(|core, now| core.handle(now, Input::Time));
        let mut driven = lock(&inner.driven);
        driven.alarm_at = driven.core.deadline();
        next = driven
            .alarm_at
            .map(|at| inner.start + Duration::from_micros(at.0));
    }
}

async fn sleep_until(at: Option<tokio::time::Instant>) {
    match at {
        Some(at) => tokio::time::sleep_until(at).await,
        None => std::future::pending().await,
    }
}

impl Inner {
    /// The line's handle, where it is open.
    fn handle(&self, line: &str) -> Option<Line> {
        let mut driven = lock(&self.driven);
        let id = driven.core.state(self.now()).lines.get(line)?.id?;
        driven.lines.get(&id).cloned()
    }

    /// Takes a line's handle out: commands that come from now on find none.
    fn take_line(&self, line: &str) -> Option<Line> {
        let mut driven = lock(&self.driven);
        let known = driven.core.state(self.now()).lines.get_mut(line);
        let id = known?.id.take()?;
        driven.lines.remove(&id)
    }

    fn now(&self) -> Now {
        let passed = self.start.elapsed().as_micros();
        Now {
            site: Micros(u64::try_from(passed).unwrap_or(u64::MAX)),
            wall: SystemTime::now(),
        }
    }

    /// Looks at what is known.
    fn read<T>(&self, look: impl FnOnce(&mut State) -> T) -> T {
        look(lock(&self.driven).core.state(self.now()))
    }

    /// Changes what is known, as one step.
    fn change<T>(self: &Arc<Inner>, change: impl FnOnce(&mut State) -> T) -> T {
        self.drive(|core, now| core.change(now, |context| context.with(change)))
    }

    /// Lets the core take a step, and does what it says.
    fn drive<T>(self: &Arc<Inner>, step: impl FnOnce(&mut Core, Now) -> T) -> T {
        let mut driven = lock(&self.driven);
        let result = step(&mut driven.core, self.now());
        while let Some(output) = driven.core.poll() {
            self.carry_out(&mut driven, output);
        }
        let next = driven.core.deadline();
        if let Some(at) = next
            && driven.alarm_at.is_none_or(|alarm_at| at < alarm_at)
        {
            driven.alarm_at = next;
            self.alarm.notify_one();
        }
        driven.site = driven.core.is_busy().then(|| Arc::clone(self));
        result
    }

    /// Begins what the core says; nothing here waits.
    fn carry_out(self: &Arc<Inner>, driven: &mut Driven, output: Output) {
        let inner = Arc::clone(self);
        match output {
            // Fails where nobody listens, which does not matter.
            Output::Publish(update) => _ = self.updates.send(update),
            Output::Run {
                request,
                at,
                op,
                verify,
                expires,
            } => {
                let Some(line) = driven.lines.get(&at.line).cloned() else {
                    let closed = Reply::Ran(Err(Fault::Closed));
                    let input = Input::Done(request, closed);
                    return driven.core.handle(self.now(), input);
                };
                let left = expires - self.now().site;
                let expires = Some(line.now() + left);
                let terms = Terms { verify, expires };
                self.runtime.spawn(async move {
                    let end = line.run(at.module, op, terms).await;
                    inner.done(request, Reply::Ran(end));
                });
            }
            Output::Begin {
                request,
                module,
                label,
                note,
                before,
            } => {
                _ = self.runtime.spawn(async move {
                    let begun = inner.begin(&module, label, note, before).await;
                    inner.done(request, Reply::Begun(begun));
                })
            }
            Output::End {
                request,
                begun,
                end,
                after,
            } => {
                _ = self.runtime.spawn(async move {
                    inner.end(begun, end, after).await;
                    inner.done(request, Reply::Ended);
                })
            }
            Output::Keep(promises) => match self.folder.clone() {
                None => driven.core.handle(self.now(), Input::Kept(Ok(()))),
                Some(folder) => {
                    _ = self.runtime.spawn(async move {
                        let write = move || promise_file::write(&folder, &promises);
                        let end = tokio::task::spawn_blocking(write).await;
                        let end = end.unwrap_or_else(|why| Err(std::io::Error::other(why)));
                        let end = end.map_err(|why| why.kind());
                        inner.drive(|core, now| core.handle(now, Input::Kept(end)));
                    })
                }
            },
        }
    }

    fn done(self: &Arc<Inner>, request: RequestId, reply: Reply) {
        self.drive(|core, now| core.handle(now, Input::Done(request, reply)));
    }

    /// Fails where nobody listens, which does not matter.
    fn tell(&self, update: Update) {
        let _ = self.updates.send(update);
    }
}

/// Turns that are held outside the core, until this is dropped.
struct HeldTurns {
    inner: Arc<Inner>,
    turns: Vec<Arc<Turn>>,
}

impl Drop for HeldTurns {
    fn drop(&mut self) {
        let turns = std::mem::take(&mut self.turns);
        self.inner
            .drive(|core, now| core.handle(now, Input::Release(turns)));
    }
}

/// A line as the host wants it described.
fn prepare(config: &Config, name: &str, polls: bool) -> Result<LineConfig, StartError> {
    let wrong_port = |why| StartError::Port(name.to_owned(), why);
    let Some(line) = config.lines.get(name) else {
        return Err(wrong_port(NameError::Form));
    };
    let port: LineName = line.port.parse().map_err(wrong_port)?;
    let mut prepared = LineConfig::new(port);
    prepared.serial.settings = line.serial;
    prepared.bus.echo = line.echo;
    for (module, described) in config.modules_of(name) {
        let wrong = |why| StartError::Setup(module.clone(), why);
        let plan = described.plan_where(polls);
        let module = Module::new(described.setup).map_err(wrong)?;
        prepared.modules.push((module, plan));
    }
    Ok(prepared)
}
