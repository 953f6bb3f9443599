//! A site at work: its lines opened, its truth kept, its commands carried out.

mod batch;
mod command;
mod guard;
mod lease;
mod loan;
mod meter;
mod policy;
mod promises;
mod pulse;
mod record;
mod reload;
mod rules;
mod scene;
mod schedule;
mod send;
mod state;
mod status;
mod timer;
mod turn;
mod underway;
mod update;

pub use batch::{BatchDone, BatchTerms, GroupState, Part, PartDone};
pub use command::{RawTerms, ToggleTerms, WriteDone, WriteTerms};
pub use lease::{LEASE_MAX, LEASE_MIN, Leased};
pub use loan::{LOAN_MAX, Loan};
pub(crate) use meter::Busy;
pub use meter::{Counts, STEPS};
pub use pulse::{By, PULSE_MAX, Pulse, PulseDone};
pub use record::{Events, Work};
pub use reload::Reloaded;
pub use rules::RuleStatus;
pub use send::{Sent, is_refused};
pub use status::{Left, LineStatus, ModuleStatus, PointStatus};
pub use underway::{COMMANDS_KEPT, Command};
pub use update::{Update, Updates};

use crate::{Config, Failure};
use promises::boards;
use railbus_device::{Module, SetupError};
use railbus_host::{Line, LineConfig, LineName, ModuleId, NameError, PortError};
use railbus_store::audit::{Audit, Entry, Note, Origin};
use railbus_wire::{Instant, Micros};
use record::Journal;
use rules::Standings;
use schedule::Schedule;
use state::State;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::broadcast;
use turn::Turns;
use underway::Commands;

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
    state: Mutex<State>,
    lines: Mutex<BTreeMap<String, Line>>,
    audit: Audit,
    journal: Journal,
    commands: Commands,
    turns: Turns,
    schedule: Schedule,
    /// The scenes that are being played.
    playing: Mutex<BTreeSet<String>>,
    rules: Standings,
    updates: broadcast::Sender<Update>,
    /// Only one at a time may change the configuration.
    reloading: tokio::sync::Mutex<()>,
    start: std::time::Instant,
    polls: bool,
}

impl fmt::Debug for Inner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Inner")
            .field("start", &self.start)
            .field("polls", &self.polls)
            .finish_non_exhaustive()
    }
}

/// A panic while the lock was held leaves values that are each whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Service {
    /// Opens the lines of a site and reads its modules again and again. To be called inside a
    /// tokio runtime with I/O and time enabled.
    ///
    /// # Errors
    /// [`StartError`]. A port that can't be opened is none: it is looked for until it is there.
    pub fn start(config: Config) -> Result<Service, StartError> {
        Service::start_with(config, true, Schedule::default())
    }

    /// The same with a folder for what must outlive the process: pulses that are timed here end
    /// after a restart too, and outputs stay off for as long as they must.
    ///
    /// # Errors
    /// As [`Service::start`]; also where the folder can't be used.
    pub fn start_in(config: Config, folder: &Path) -> Result<Service, StartError> {
        let schedule = Schedule::open(folder, boards(&config));
        let schedule = schedule.map_err(|why| StartError::Folder(why.kind()))?;
        Service::start_with(config, true, schedule)
    }

    /// The same, but only what is asked for is read: for a single command.
    ///
    /// # Errors
    /// As [`Service::start`].
    pub fn start_quiet(config: Config) -> Result<Service, StartError> {
        Service::start_with(config, false, Schedule::default())
    }

    fn start_with(config: Config, polls: bool, schedule: Schedule) -> Result<Service, StartError> {
        let names: Vec<String> = config.lines.keys().cloned().collect();
        let prepared: Vec<LineConfig> = names
            .iter()
            .map(|name| prepare(&config, name, polls))
            .collect::<Result<_, _>>()?;
        let service = Service {
            inner: Arc::new(Inner {
                state: Mutex::new(State::new(config, polls)),
                lines: Mutex::new(BTreeMap::new()),
                audit: Audit::default(),
                journal: Journal::default(),
                commands: Commands::default(),
                turns: Turns::default(),
                schedule,
                playing: Mutex::default(),
                rules: Standings::default(),
                updates: broadcast::Sender::new(UPDATES_MAX),
                reloading: tokio::sync::Mutex::new(()),
                start: std::time::Instant::now(),
                polls,
            }),
            origin: Arc::new(Origin::program("railbus")),
        };
        for (name, prepared) in names.into_iter().zip(prepared) {
            service.open(name, prepared).map_err(StartError::System)?;
        }
        service.inner.take_up();
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

    /// What is written down of something that this handle is about to do.
    fn note(&self, what: String) -> Note {
        Note {
            origin: Origin::clone(&self.origin),
            what,
        }
    }

    /// Opens a line whose events the state hears of before anyone else.
    fn open(&self, name: String, mut config: LineConfig) -> Result<(), PortError> {
        let inner = Arc::downgrade(&self.inner);
        let line = name.clone();
        config.observer = Some(Box::new(move |event| {
            // The task outlives the site only while it closes its port.
            if let Some(inner) = inner.upgrade() {
                inner.observe(&line, event);
            }
        }));
        let opened = Line::open(config)?;
        let began = self.inner.now() - opened.now().since(Instant(0));
        if let Some(now) = lock(&self.inner.state).lines.get_mut(&name) {
            now.began = began;
        }
        lock(&self.inner.lines).insert(name, opened);
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
        self.inner.commands.find(id)
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
        self.inner.schedule.stop_all().await;
        self.exit_policy().await;
        let lines = std::mem::take(&mut *lock(&self.inner.lines));
        close_all(lines.into_values()).await;
    }
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

impl Inner {
    fn handle(&self, line: &str) -> Option<Line> {
        lock(&self.lines).get(line).cloned()
    }

    /// Time since the start of the site.
    fn now(&self) -> Micros {
        let passed = self.start.elapsed().as_micros();
        Micros(u64::try_from(passed).unwrap_or(u64::MAX))
    }

    /// The line's handle of a module, and its number there.
    fn place(&self, module: &str) -> Option<(Line, ModuleId)> {
        // The handle first, and no lock within another: a line that is closed is taken out of
        // `lines` before its modules get other numbers, and one that is opened comes after that.
        loop {
            let (line, _) = lock(&self.state).place(module)?;
            let handle = self.handle(&line)?;
            let (now, id) = lock(&self.state).place(module)?;
            if now == line {
                return Some((handle, id));
            }
        }
    }

    /// Fails where nobody listens, which does not matter.
    fn tell(&self, update: Update) {
        let _ = self.updates.send(update);
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// Who waits for the lines keeps nobody from the state.
    #[tokio::test]
    async fn a_place_is_looked_up_with_one_lock_at_a_time() {
        let text = "[line.main]\nport = \"/dev/none-such\"\n\
            [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
        let service = Service::start(Config::parse(text).unwrap()).unwrap();
        let held = lock(&service.inner.lines);
        let inner = Arc::clone(&service.inner);
        let looks = std::thread::spawn(move || inner.place("oven").map(|(_, id)| id));
        let free = || {
            std::thread::sleep(Duration::from_millis(1));
            service.inner.state.try_lock().is_ok()
        };
        let times = (0..100).filter(|_| free()).count();
        drop(held);
        assert_eq!(looks.join().unwrap(), Some(ModuleId(0)));
        assert!(times > 90, "{times}");
        service.close().await;
    }
}
