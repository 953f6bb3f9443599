//! The handle of a line.

use crate::clock::{Alarm, Clock};
use crate::event::Publisher;
use crate::pending::ProbeReply;
use crate::tap::Tap;
use crate::task::Task;
use crate::{
    AnyPort, Events, Granted, LineEvent, LineName, LineState, Observer, Port, PortError,
    SerialOptions,
};
use railbus_bus::LateReply;
use railbus_bus::{Config, Confirmed, Fault, ModuleId, Plan, Probe, Probed, Terms};
use railbus_device::{Module, Observation, Op};
use railbus_wire::{Decoded, Exchange, Instant, Micros};
use std::fmt;
use std::sync::Arc;
use tokio::sync::{broadcast, mpsc, oneshot, watch};

/// How many jobs may wait for the line's task. Those that the task has taken wait in the
/// state machine's own queue, which is as long.
pub const JOBS_MAX: usize = 64;

/// Everything about a line.
pub struct LineConfig {
    /// Where its port is.
    pub name: LineName,
    /// How a serial port is to be used.
    pub serial: SerialOptions,
    /// How the line is to be treated. A medium that the port shows to be buffered is.
    pub bus: Config,
    /// Its modules; their [`ModuleId`]s count from 0 in this order.
    pub modules: Vec<(Module, Plan)>,
    /// Sees every event first.
    pub observer: Option<Observer>,
}

impl LineConfig {
    /// A line without modules, and everything else as usual.
    #[must_use]
    pub fn new(name: LineName) -> LineConfig {
        LineConfig {
            name,
            serial: SerialOptions::default(),
            bus: Config::default(),
            modules: Vec::new(),
            observer: None,
        }
    }

    /// The same with one module more.
    #[must_use]
    pub fn with(mut self, module: Module, plan: Plan) -> LineConfig {
        self.modules.push((module, plan));
        self
    }
}

impl fmt::Debug for LineConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LineConfig")
            .field("name", &self.name)
            .field("serial", &self.serial)
            .field("bus", &self.bus)
            .field("modules", &self.modules)
            .finish_non_exhaustive()
    }
}

/// How a command ended well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Done {
    /// How far that is certain.
    pub confirmed: Confirmed,
    /// From handing it in to the last byte of its own reply, the read-back apart.
    pub took: Micros,
    /// What was read: for a read what was asked for; for a write the outputs as they were last
    /// read after its reply, where they were.
    pub seen: Option<Observation>,
}

/// What a probe met.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProbeResult {
    /// In one word.
    pub outcome: Probed,
    /// What came back, echo taken out.
    pub bytes: Vec<u8>,
    /// From the end of the request to the end of what came back.
    pub after: Micros,
    /// Replies to probes before it that were no longer waited for, oldest first; at most
    /// [`LATE_MAX`].
    pub late: Vec<LateReply>,
}

impl ProbeResult {
    /// The bytes of the reply to what was asked; none where no good one came. See [`reply_in`].
    #[must_use]
    pub fn reply(&self, asked: &Exchange<'_>) -> Option<&[u8]> {
        let is_answered = self.outcome == Probed::Answered;
        is_answered.then(|| reply_in(asked, &self.bytes)).flatten()
    }
}

/// The bytes of the reply among all that was heard of a probe that was answered. The line takes it
/// as soon as it is whole: what stands before it is another module's late reply, or noise.
#[must_use]
pub fn reply_in<'h>(asked: &Exchange<'_>, heard: &'h [u8]) -> Option<&'h [u8]> {
    let whole = |skip: usize| {
        let rest = heard.get(skip..)?;
        match asked.decode_response(rest) {
            Decoded::Whole { len, .. } => Some((skip + len, rest.get(..len)?)),
            _ => None,
        }
    };
    // Of those with the same end the longest.
    let each = (0..heard.len()).rev().filter_map(whole);
    each.max_by_key(|(end, _)| *end).map(|(_, reply)| reply)
}

/// The most late replies that are kept for the next probe.
pub const LATE_MAX: usize = 16;

/// Other modules for a line at work.
#[derive(Debug, Default)]
pub struct ModuleChanges {
    /// These are not asked any more. Their numbers are not given again.
    pub leave: Vec<ModuleId>,
    /// These are asked from now on; their numbers follow the highest one given.
    pub join: Vec<(Module, Plan)>,
}

/// What the line's task is asked for.
#[derive(Debug)]
pub(crate) enum Job {
    Run {
        module: ModuleId,
        op: Op,
        terms: Terms,
        reply: oneshot::Sender<Result<Done, Fault>>,
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

/// A line of modules. Clones are handles of the same line; when the last one is dropped, the
/// line is closed as by [`Line::close`].
///
/// There is no way to send arbitrary bytes: the state machine must know what may answer, or a
/// reply could be taken for another one. What is no [`Op`] can be asked with [`Line::probe`].
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
    /// Starts a line's task, which opens the port. Whether that succeeds, [`Line::opened`] says.
    /// To be called inside a tokio runtime with I/O enabled.
    ///
    /// # Errors
    /// Where the system gives no timer.
    pub fn open(config: LineConfig) -> Result<Line, PortError> {
        let mut serial = config.serial;
        if let Some((first, _)) = config.modules.first() {
            // One switch of speed less.
            serial.settings = first.setup().serial;
        }
        let port = AnyPort::new(&config.name, serial);
        Line::over(port, config.bus, config.modules, config.observer)
    }

    /// The same over a port of one's own.
    ///
    /// # Errors
    /// Where the system gives no timer.
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

    /// How its port is.
    #[must_use]
    pub fn state(&self) -> LineState {
        self.state.borrow().clone()
    }

    /// What the port's driver granted at the last opening, such as low latency.
    #[must_use]
    pub fn granted(&self) -> Option<Granted> {
        *self.granted.borrow()
    }

    /// Waits until the port is open, or could not be opened once.
    ///
    /// # Errors
    /// Why it could not. The line goes on trying.
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
    pub fn events(&self) -> Events {
        Events::of(&self.events)
    }

    /// The line's time, in which [`Terms::expires`] and events are told: microseconds since
    /// its start.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.clock.now()
    }

    /// Does an op with a module and waits for its end. To drop the future does not take the
    /// command back.
    ///
    /// # Errors
    /// How it failed, and whether the module may have acted ([`Fault::may_have_acted`]).
    pub async fn run(&self, module: ModuleId, op: Op, terms: Terms) -> Result<Done, Fault> {
        let (reply, end) = oneshot::channel();
        self.enqueue(Job::Run {
            module,
            op,
            terms,
            reply,
        })?;
        // Nobody answers only when the line's task broke down.
        end.await.unwrap_or(Err(Fault::Unknown))
    }

    /// Makes an exchange of one's own between the line's, one after the other. To drop the future
    /// takes it back as long as it was not sent.
    ///
    /// # Errors
    /// [`Fault::Closed`], or [`Fault::Overloaded`] while too many wait; [`Fault::Unknown`] where
    /// the port was lost behind one that may change something.
    pub async fn probe(&self, probe: Probe) -> Result<ProbeResult, Fault> {
        let (reply, end) = oneshot::channel();
        self.enqueue(Job::Probe { probe, reply })?;
        // Nobody answers only when the line's task broke down, or had no port.
        end.await.unwrap_or(Err(Fault::Unknown))
    }

    /// Looks on at what passes from now on. It goes on when the port was lost and is found again.
    ///
    /// # Errors
    /// [`Fault::Closed`] while there is no port, or [`Fault::Overloaded`].
    pub async fn tap(&self) -> Result<Tap, Fault> {
        let (reply, tap) = oneshot::channel();
        self.enqueue(Job::Tap { reply })?;
        tap.await.map_err(|_| Fault::Closed)
    }

    /// Changes the modules of the line, between its exchanges: those that stay are asked on as if
    /// nothing had been. What is handed in after this meets the modules that joined.
    ///
    /// # Errors
    /// [`Fault::Closed`]: the line is no more.
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

    /// Closes the line: takes no more commands, gives those it has up to a second to end, lets
    /// the frame on the wire leave, and releases the port. All clones are closed with it.
    pub async fn close(&self) {
        let (reply, closed) = oneshot::channel();
        if self.jobs.send(Job::Close { reply }).await.is_ok() {
            let _ = closed.await;
        }
        let mut state = self.state.clone();
        // Fails where the task is gone already.
        let _ = state.wait_for(|state| *state == LineState::Closed).await;
    }
}
