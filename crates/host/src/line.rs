//! The handle of a line.

use crate::clock::{Alarm, Clock};
use crate::event::Publisher;
use crate::pending::{ProbeReply, RunReply};
use crate::tap::Tap;
use crate::task::Task;
use crate::{
    AnyPort, Granted, LineEvent, LineEvents, LineName, LineState, Observer, Port, PortError,
    SerialOptions,
};
use railbus_bus::LateReply;
use railbus_bus::{Config, Confirmation, Fault, ModuleId, Plan, Probe, Probed, Terms};
use railbus_device::{Module, Observation, Op};
use railbus_wire::{Decoded, Exchange, Instant, Micros};
use std::fmt;
use std::sync::Arc;
use tokio::sync::{broadcast, mpsc, oneshot, watch};

/// How many jobs may wait for the line's task. Jobs that the task has taken wait in the state
/// machine's own queue, which has the same length.
pub const JOBS_MAX: usize = 64;

/// The configuration of a line.
pub struct LineOptions {
    /// Its port.
    pub name: LineName,
    /// Options for a serial port.
    pub serial: SerialOptions,
    /// How the line is operated. If the port turns out to be buffered, the medium is, too.
    pub bus: Config,
    /// Its modules; their [`ModuleId`]s count from 0 in this order.
    pub modules: Vec<(Module, Plan)>,
    /// Called first with every event.
    pub observer: Option<Observer>,
}

impl LineOptions {
    /// A line without modules, with defaults for everything else.
    #[must_use]
    pub fn new(name: LineName) -> LineOptions {
        LineOptions {
            name,
            serial: SerialOptions::default(),
            bus: Config::default(),
            modules: Vec::new(),
            observer: None,
        }
    }

    /// Adds a module.
    #[must_use]
    pub fn with(mut self, module: Module, plan: Plan) -> LineOptions {
        self.modules.push((module, plan));
        self
    }
}

impl fmt::Debug for LineOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LineConfig")
            .field("name", &self.name)
            .field("serial", &self.serial)
            .field("bus", &self.bus)
            .field("modules", &self.modules)
            .finish_non_exhaustive()
    }
}

/// Identifies an op of [`Line::submit`] to the observer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunId(pub u64);

/// The result of a successful command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Done {
    /// How it was confirmed.
    pub confirmed: Confirmation,
    /// From submission to the last byte of its own reply, without the read-back.
    pub took: Micros,
    /// For a read, what was read; for a write, the outputs as last read after its reply, if they
    /// were.
    pub seen: Option<Observation>,
}

/// The result of a probe.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProbeResult {
    /// What kind of answer came.
    pub outcome: Probed,
    /// What came back, without the echo.
    pub bytes: Vec<u8>,
    /// From the end of the request to the end of what came back.
    pub after: Micros,
    /// Late replies to earlier probes, oldest first; at most [`LATE_MAX`].
    pub late: Vec<LateReply>,
}

impl ProbeResult {
    /// The bytes of the reply to what was asked; none if there was no good one. See [`reply_in`].
    #[must_use]
    pub fn reply(&self, asked: &Exchange<'_>) -> Option<&[u8]> {
        let is_answered = self.outcome == Probed::Answered;
        is_answered.then(|| reply_in(asked, &self.bytes)).flatten()
    }
}

/// The bytes of the reply within everything received for an answered probe. The line accepts it as
/// soon as it is complete: whatever precedes it is another module's late reply, or noise.
#[must_use]
pub fn reply_in<'h>(asked: &Exchange<'_>, heard: &'h [u8]) -> Option<&'h [u8]> {
    let whole = |skip: usize| {
        let rest = heard.get(skip..)?;
        match asked.decode_response(rest) {
            Decoded::Whole { len, .. } => Some((skip + len, rest.get(..len)?)),
            _ => None,
        }
    };
    // Of those with the same end, the longest.
    let each = (0..heard.len()).rev().filter_map(whole);
    each.max_by_key(|(end, _)| *end).map(|(_, reply)| reply)
}

/// The most late replies that are kept for the next probe.
pub const LATE_MAX: usize = 16;

/// Modules to add to a line in use, and to remove from it.
#[derive(Debug, Default)]
pub struct ModuleChanges {
    /// These are removed. Their numbers are not reused.
    pub leave: Vec<ModuleId>,
    /// These are added; their numbers follow the highest one so far.
    pub join: Vec<(Module, Plan)>,
}

/// A request to the line's task.
#[derive(Debug)]
pub(crate) enum Job {
    Run {
        module: ModuleId,
        op: Op,
        terms: Terms,
        reply: RunReply,
    },
    Probe {
        probe: Probe,
        reply: ProbeReply,
    },
    Tap {
        reply: oneshot::Sender<Tap>,
    },
    Change(ModuleChanges),
    Close {
        reply: oneshot::Sender<()>,
    },
}

/// A line of modules. Clones are handles of the same line; when the last one is dropped, the line
/// is closed as by [`Line::close`].
///
/// There is no way to send arbitrary bytes: the state machine must know what may answer, or a reply
/// could be taken for another one. Requests that are not an [`Op`] can be sent with
/// [`Line::probe`].
#[derive(Clone, Debug)]
pub struct Line {
    name: Arc<str>,
    jobs: mpsc::Sender<Job>,
    events: broadcast::WeakSender<LineEvent>,
    state: watch::Receiver<LineState>,
    granted: watch::Receiver<Option<Granted>>,
    clock: Clock,
}

impl Line {
    /// Starts a line's task, which opens the port; [`Line::opened`] tells whether that succeeds.
    /// Call it inside a tokio runtime with I/O enabled.
    ///
    /// # Errors
    /// If the system provides no timer.
    pub fn open(config: LineOptions) -> Result<Line, PortError> {
        let mut serial = config.serial;
        if let Some((first, _)) = config.modules.first() {
            // Saves one change of speed.
            serial.settings = first.setup().serial;
        }
        let port = AnyPort::new(&config.name, serial);
        Line::over(port, config.bus, config.modules, config.observer)
    }

    /// The same over any [`Port`].
    ///
    /// # Errors
    /// If the system provides no timer.
    pub fn over(
        port: impl Port,
        bus: Config,
        modules: Vec<(Module, Plan)>,
        observer: Option<Observer>,
    ) -> Result<Line, PortError> {
        let alarm = Alarm::new().map_err(|error| PortError::of_loss(&error))?;
        let (sender, jobs) = mpsc::channel(JOBS_MAX);
        let publisher = Publisher::new(observer);
        let line = Line {
            name: port.name().into(),
            jobs: sender,
            events: publisher.events(),
            state: publisher.state(),
            granted: publisher.granted(),
            clock: alarm.clock(),
        };
        let task = Task::new(port, (bus, modules), jobs, publisher, alarm);
        tokio::spawn(task.run());
        Ok(line)
    }

    /// The name of its port.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The state of its port.
    #[must_use]
    pub fn state(&self) -> LineState {
        self.state.borrow().clone()
    }

    /// What the port's driver granted when it was last opened, such as low latency.
    #[must_use]
    pub fn granted(&self) -> Option<Granted> {
        *self.granted.borrow()
    }

    /// Waits until the port is open, or the first attempt has failed.
    ///
    /// # Errors
    /// Why it failed. The line keeps trying.
    pub async fn opened(&self) -> Result<(), PortError> {
        let mut state = self.state.clone();
        let settled = state.wait_for(|state| *state != LineState::Opening).await;
        match settled.as_deref() {
            Ok(LineState::Absent(why)) => Err(PortError::clone(why)),
            Ok(LineState::Up | LineState::Opening) => Ok(()),
            Ok(LineState::Closed) | Err(_) => Err(PortError::Gone),
        }
    }

    /// Its events from now on.
    #[must_use]
    pub fn events(&self) -> LineEvents {
        LineEvents::of(&self.events)
    }

    /// The line's time, used in [`Terms::expires`] and in events: microseconds since its start.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.clock.now()
    }

    /// Runs an op on a module and waits for its end. Dropping the future does not cancel the
    /// command.
    ///
    /// # Errors
    /// How it failed, and whether the module may have acted ([`Fault::may_have_acted`]).
    pub async fn run(&self, module: ModuleId, op: Op, terms: Terms) -> Result<Done, Fault> {
        let (reply, end) = oneshot::channel();
        self.enqueue(Job::Run {
            module,
            op,
            terms,
            reply: RunReply::Caller(reply),
        })?;
        // There is no answer only if the line's task has panicked.
        end.await.unwrap_or(Err(Fault::Unknown))
    }

    /// Hands in an op without waiting. The observer gets its end ([`LineEvent::Ended`]) in the same
    /// call as the events of that wake-up, exactly once; a line without an observer reports none.
    ///
    /// # Errors
    /// [`Fault::Closed`], or [`Fault::Overloaded`] if too many wait. Then there is no further end.
    pub fn submit(&self, run: RunId, module: ModuleId, op: Op, terms: Terms) -> Result<(), Fault> {
        let reply = RunReply::Observer(run);
        self.enqueue(Job::Run {
            module,
            op,
            terms,
            reply,
        })
    }

    /// Makes a raw exchange between the line's own; probes run one after the other. Dropping the
    /// future cancels it as long as it was not sent.
    ///
    /// # Errors
    /// [`Fault::Closed`], or [`Fault::Overloaded`] if too many wait; [`Fault::Unknown`] if the port
    /// was lost during one that may change something.
    pub async fn probe(&self, probe: Probe) -> Result<ProbeResult, Fault> {
        let (reply, end) = oneshot::channel();
        self.enqueue(Job::Probe { probe, reply })?;
        // There is no answer only if the line's task has panicked, or had no port.
        end.await.unwrap_or(Err(Fault::Unknown))
    }

    /// Taps the line's traffic from now on. The tap survives a loss of the port.
    ///
    /// # Errors
    /// [`Fault::Closed`] while there is no port, or [`Fault::Overloaded`].
    pub async fn tap(&self) -> Result<Tap, Fault> {
        let (reply, tap) = oneshot::channel();
        self.enqueue(Job::Tap { reply })?;
        tap.await.map_err(|_| Fault::Closed)
    }

    /// Changes the modules of the line between two exchanges; polling of the others is not
    /// interrupted. Anything submitted afterwards sees the new modules.
    ///
    /// # Errors
    /// [`Fault::Closed`]: the line was closed.
    pub async fn change(&self, change: ModuleChanges) -> Result<(), Fault> {
        let handed = self.jobs.send(Job::Change(change)).await;
        handed.map_err(|_| Fault::Closed)
    }

    fn enqueue(&self, job: Job) -> Result<(), Fault> {
        self.jobs.try_send(job).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => Fault::Overloaded,
            mpsc::error::TrySendError::Closed(_) => Fault::Closed,
        })
    }

    /// Closes the line: takes no more commands, gives pending ones up to a second to end, lets the
    /// frame on the wire finish, and releases the port. Closes it for all clones.
    pub async fn close(&self) {
        let (reply, closed) = oneshot::channel();
        if self.jobs.send(Job::Close { reply }).await.is_ok() {
            let _ = closed.await;
        }
        let mut state = self.state.clone();
        // Fails if the task has already ended.
        let _ = state.wait_for(|state| *state == LineState::Closed).await;
    }
}
