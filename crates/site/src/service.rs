//! A running site: its open lines, and its [`Core`], driven by them, by the clock and by callers.

mod alarm;
mod driver;
mod entries;
mod exclusive_hold;
mod follow;
mod meter;
mod once;
mod orders;
mod promise_file;
mod record;
mod reload;
mod rules;
mod send;
mod status;
mod update;

pub use exclusive_hold::ExclusiveHold;
pub use follow::Follower;
pub(crate) use meter::Busy;
pub use meter::{Counts, STEPS};
pub use once::{CommandKey, KEY_LEN_MAX, KeyRefusal, KeyTold};
pub use record::{Events, Work};
pub use reload::ReloadError;
pub use rules::RuleStatus;
pub use send::{Sent, is_refused};
pub use status::{Left, LineStatus, ModuleStatus, PointNow, PointStatus};
pub use update::{Update, Updates};

use crate::core::{Command, Context, Core, Input, LineId, News, Now, State, TaskId};
use crate::rights::Who;
use crate::{CommandError, Config, Rights};
use alarm::Alarm;
use entries::Waits;
use once::Once;
use railbus_commission::Risk;
use railbus_device::{Module, SetupError};
use railbus_host::{
    Fault, Line, LineName, LineOptions, NameError, PortError, Probe, ProbeResult, Tap,
};
use railbus_store::audit::{Audit, Entry, Origin};
use railbus_wire::{
    Exchange, Frame, Instant, Micros, Protocol, REPLY_TIMEOUT, SerialSettings, foreign_command,
};
use record::Journal;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::SystemTime;
use tokio::sync::{broadcast, oneshot};
use tokio::task::AbortHandle;

/// The default timeout of a raw frame.
const RAW_TIMEOUT: Micros = REPLY_TIMEOUT;

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
    who: Who,
}

pub(crate) struct Inner {
    driven: Mutex<Driven>,
    /// Tells the core of the time.
    clock: OnceLock<AbortHandle>,
    /// Where what must outlive the process is kept.
    folder: Option<PathBuf>,
    audit: Audit,
    journal: Journal,
    once: Arc<Once>,
    updates: broadcast::Sender<Update>,
    news: broadcast::Sender<News>,
    runtime: tokio::runtime::Handle,
    start: tokio::time::Instant,
    polls: bool,
    #[cfg(test)]
    counts: Mutex<BTreeMap<&'static str, usize>>,
}

/// The core, and what it is driven with: one lock for all of it.
struct Driven {
    core: Core,
    lines: BTreeMap<LineId, Line>,
    waits: Waits,
    alarm: Alarm,
    /// While something is in progress, the site lives on after its last handle is dropped.
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
    /// Stops the task that reports the time.
    fn drop(&mut self) {
        if let Some(clock) = self.clock.get() {
            clock.abort();
        }
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
    /// after a restart too, outputs stay off for as long as they must, and commands can be given
    /// under keys ([`Service::once`]). No other process may use the folder.
    ///
    /// # Errors
    /// As [`Service::start`]; also where the folder can't be used.
    pub fn start_in(config: Config, folder: &Path) -> Result<Service, StartError> {
        Service::start_with(config, true, Some(folder))
    }

    /// The same without polling, for a single command.
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
        let prepared: Vec<LineOptions> = names
            .iter()
            .map(|name| prepare(&config, name, polls))
            .collect::<Result<_, _>>()?;
        let now = Now {
            site: Micros::ZERO,
            wall: SystemTime::now(),
        };
        let start = tokio::time::Instant::now();
        let service = Service {
            inner: Arc::new(Inner {
                driven: Mutex::new(Driven {
                    core: Core::new(now, config, polls, kept),
                    lines: BTreeMap::new(),
                    waits: Waits::default(),
                    alarm: Alarm::new(start),
                    site: None,
                }),
                clock: OnceLock::new(),
                folder: folder.map(Path::to_owned),
                audit: Audit::default(),
                journal: Journal::default(),
                once: Arc::new(Once::open(folder)),
                updates: broadcast::Sender::new(UPDATES_MAX),
                news: broadcast::Sender::new(follow::NEWS_MAX),
                runtime: tokio::runtime::Handle::current(),
                start,
                polls,
                #[cfg(test)]
                counts: Mutex::default(),
            }),
            who: Who::program("railbus"),
        };
        let clock = tokio::spawn(driver::tell_time(Arc::downgrade(&service.inner)));
        _ = service.inner.clock.set(clock.abort_handle());
        for (name, prepared) in names.into_iter().zip(prepared) {
            service.open(&name, prepared)?;
        }
        service.inner.drive(|core, now| core.take_up(now));
        Ok(service)
    }

    /// A handle of the same site that acts for a caller: what it does is recorded under that name,
    /// and what these rights do not cover is refused. They are a copy as of now. Asked by the
    /// present configuration: for a command, when it comes and when the turn of its outputs has
    /// come; for a frame of one's own, before its audit entry and after it; for a loan of a line,
    /// work on a module's settings and another configuration, when they begin.
    #[must_use]
    pub fn on_behalf_of(&self, origin: Origin, rights: Rights) -> Service {
        Service {
            inner: Arc::clone(&self.inner),
            who: Who {
                origin: Arc::new(origin),
                rights,
            },
        }
    }

    /// Opens a line of a site that begins.
    fn open(&self, name: &str, config: LineOptions) -> Result<(), StartError> {
        let mut driven = self.inner.driven();
        let now = self.inner.now();
        if let Some(id) = driven.core.state(now).line_opens(name) {
            let began = self.inner.open(&mut driven, (name, id), config);
            let began = began.map_err(StartError::System)?;
            driven.core.handle(now, Input::Opened(name, id, Ok(began)));
        }
        Ok(())
    }

    /// Changes from now on. The newest updates are buffered for a slow subscriber, which is told
    /// how many it missed.
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
        self.inner.driven().core.command(id).cloned()
    }

    /// Waits until the port of a line is open, or could not be opened once.
    ///
    /// # Errors
    /// [`CommandError::NoSuchLine`]. How the port is, [`Service::line`] says.
    pub async fn opened(&self, line: &str) -> Result<(), CommandError> {
        let known = |state: &mut State| {
            let is_known = state.lines.contains_key(line);
            is_known.then(|| state.is_line_opened(line))
        };
        if !self.inner.read(known).ok_or(CommandError::NoSuchLine)? {
            let line = line.to_owned();
            self.ask_while(|core| async move { core.opened(&line).await })
                .await;
        }
        Ok(())
    }

    /// Ends the site: outputs of pulses and leases are released, those with a policy for the end
    /// are switched, commands under way get a second to end, the frames on the wire leave, the
    /// ports are closed. New commands are refused from the beginning on.
    pub async fn close(&self) {
        self.ask(|core| async move { core.close_site().await })
            .await;
        self.inner.drive(|core, now| core.finish_stream(now));
    }

    /// Starts a procedure of the core and waits for its end. It goes on where nobody waits any
    /// more.
    async fn ask<T, F>(&self, procedure: impl FnOnce(Context) -> F) -> Option<T>
    where
        T: Send + 'static,
        F: Future<Output = T> + Send + 'static,
    {
        let (end, ended) = oneshot::channel();
        self.inner.drive(|core, now| {
            // Fails if the caller has gone.
            let end = |value| _ = end.send(value);
            core.start(now, procedure, end)
        });
        let end = ended.await.ok();
        self.inner.count("hand-overs");
        end
    }

    /// The same for a procedure that is cancelled if the caller goes away.
    async fn ask_while<T, F>(&self, procedure: impl FnOnce(Context) -> F) -> Option<T>
    where
        T: Send + 'static,
        F: Future<Output = T> + Send + 'static,
    {
        let (end, ended) = oneshot::channel();
        let task = self.inner.drive(|core, now| {
            let end = |value| _ = end.send(value);
            core.start(now, procedure, end)
        });
        let _asking = Asking {
            inner: Arc::clone(&self.inner),
            task,
        };
        let end = ended.await.ok();
        self.inner.count("hand-overs");
        end
    }

    /// Sends a raw read between the line's own exchanges, once its port is open.
    ///
    /// # Errors
    /// As [`Service::may_send`]; [`CommandError::NoSuchLine`], or what the line reported.
    pub async fn raw(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
    ) -> Result<ProbeResult, CommandError> {
        self.may_send(line, &exchange)?;
        self.opened(line).await?;
        let (handle, probe) = self.probe_of(line, exchange, terms)?;
        Ok(handle.probe(probe).await?)
    }

    /// Sends a raw read of a master that is not part of this program, between the line's own
    /// exchanges. It reads, so it needs no rights; which lines such masters may read is for the
    /// configuration to say.
    ///
    /// # Errors
    /// [`Fault::Unsupported`] if it may change something, or a module of another protocol could
    /// take it for a command; [`CommandError::NoSuchLine`],
    /// [`CommandError::Lent`], or what the line reported.
    pub async fn read_for_master(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
    ) -> Result<ProbeResult, CommandError> {
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        // Also where no module of such a protocol is configured: there may be one.
        let hidden = foreign_command(frame.bytes(), exchange.protocol(), Protocol::ALL);
        if Risk::of(&exchange) != Risk::Read || hidden.is_some() {
            return Err(Fault::Unsupported.into());
        }
        self.opened(line).await?;
        let (handle, probe) = self.probe_of(line, exchange, terms)?;
        let as_module = true;
        Ok(handle.probe(Probe { as_module, ..probe }).await?)
    }

    /// A line, and a raw frame for it.
    pub(super) fn probe_of(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
    ) -> Result<(Line, Probe), CommandError> {
        let status = self.line(line).ok_or(CommandError::NoSuchLine)?;
        let handle = self.inner.handle(line).ok_or(CommandError::Lent)?;
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
            as_module: false,
        };
        Ok((handle, probe))
    }

    /// Taps the traffic of a line, without affecting it. Also returns the present time on the
    /// line's clock.
    ///
    /// # Errors
    /// [`CommandError::NoSuchLine`], or [`Fault::Closed`] while the line has no port.
    pub async fn tap(&self, line: &str) -> Result<(Instant, Tap), CommandError> {
        // A line that is only just being opened will have a port in a moment.
        self.opened(line).await?;
        let handle = self.inner.handle(line).ok_or(Fault::Closed)?;
        let tap = handle.tap().await?;
        Ok((handle.now(), tap))
    }
}

/// The terms of a raw read; the default is the line's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawTerms {
    /// Speed and character format.
    pub settings: Option<SerialSettings>,
    /// The silence before it.
    pub gap: Option<Micros>,
    /// How long the reply may take to begin.
    pub timeout: Option<Micros>,
    /// A lone CR goes before it: see [`railbus_host::Probe::clear`].
    pub clear: bool,
}

/// A procedure that ends when this is dropped.
struct Asking {
    inner: Arc<Inner>,
    task: TaskId,
}

impl Drop for Asking {
    fn drop(&mut self) {
        let task = self.task;
        self.inner.drive(|core, now| core.cancel(now, task));
    }
}

/// A line as the host wants it described.
fn prepare(config: &Config, name: &str, polls: bool) -> Result<LineOptions, StartError> {
    let wrong_port = |why| StartError::Port(name.to_owned(), why);
    let Some(line) = config.lines.get(name) else {
        return Err(wrong_port(NameError::Form));
    };
    let port: LineName = line.port.parse().map_err(wrong_port)?;
    let mut prepared = LineOptions::new(port);
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
