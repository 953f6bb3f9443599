//! The task of a line: runs the state machine, and reopens the port when it was lost.

use crate::backoff::Backoff;
use crate::clock::Alarm;
use crate::event::Publisher;
use crate::line::{Job, ModuleChanges};
use crate::pending::{PendingCalls, PendingRun};
use crate::wake_flag::WakeFlag;
use crate::{LineState, Port, PortError};
use railbus_bus::LateReply;
use railbus_bus::{Bus, Config, Event, Fault, Input, Medium, ModuleId, Output, Plan};
use railbus_device::Module;
use railbus_wire::{Instant, Micros, SerialSettings};
use std::future::{Future, poll_fn};
use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use tokio::sync::{mpsc, oneshot};

/// How long pending commands may take to end when the line is closed.
const CLOSING_MAX: Micros = Micros::from_secs(1);
/// More than any frame, and more than any chunk that adapters deliver at once.
const BUFFER: usize = 512;

/// A line's port, state machine and callers.
#[derive(Debug)]
pub(crate) struct Task<P> {
    port: P,
    bus: Bus,
    config: Config,
    members: Members,
    jobs: mpsc::Receiver<Job>,
    pending: PendingCalls,
    publisher: Publisher,
    alarm: Alarm,
    /// The alarm or the jobs may be ready.
    others: WakeFlag,
    /// The last moment passed to the state machine.
    told: Instant,
    /// How far its time lags behind the clock. The state machine assumes that a frame is sent at
    /// the last moment passed to it. A task that was delayed sends later, and would count the
    /// silence after the frame from too early on: so the state machine's time stands still until
    /// something is received.
    lag: Micros,
    last: LastFrame,
    closing: Option<Closing>,
}

/// The modules of a line by their numbers.
#[derive(Debug)]
struct Members {
    modules: Vec<(Module, Plan)>,
    /// Those that were removed.
    left: Vec<ModuleId>,
}

impl Members {
    fn change(&mut self, bus: &mut Bus, now: Instant, change: ModuleChanges) {
        for id in change.leave {
            bus.leave(now, id);
            self.left.push(id);
        }
        for (module, plan) in change.join {
            bus.join(now, module.clone(), plan);
            self.modules.push((module, plan));
        }
    }

    fn build(&self, config: Config) -> Bus {
        let mut bus = Bus::new(config);
        for (module, plan) in &self.modules {
            bus.add(module.clone(), *plan);
        }
        for id in &self.left {
            bus.leave(Instant(0), *id);
        }
        bus
    }
}

/// When the last frame was sent, and what is needed to compute when it is complete on the wire.
#[derive(Clone, Copy, Debug)]
struct LastFrame {
    at: Instant,
    bytes: usize,
    settings: SerialSettings,
}

/// The line is being closed.
#[derive(Debug)]
struct Closing {
    /// Commands may end until then.
    until: Instant,
    /// Who asked for it; none if all handles were dropped.
    reply: Option<oneshot::Sender<()>>,
}

/// What wakes the line's task.
#[derive(Debug)]
enum Wakeup {
    Bytes(io::Result<usize>),
    Deadline(io::Result<Instant>),
    Job(Option<Job>),
}

/// Why the line stops.
#[derive(Debug)]
enum Stop {
    Lost(io::Error),
    Closed,
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Stop {
        Stop::Lost(error)
    }
}

impl<P: Port> Task<P> {
    pub(crate) fn new(
        port: P,
        (config, modules): (Config, Vec<(Module, Plan)>),
        jobs: mpsc::Receiver<Job>,
        publisher: Publisher,
        alarm: Alarm,
    ) -> Task<P> {
        let config = with_medium(config, port.medium());
        let members = Members {
            modules,
            left: Vec::new(),
        };
        Task {
            bus: members.build(config),
            port,
            config,
            members,
            jobs,
            pending: PendingCalls::new(),
            publisher,
            told: alarm.now(),
            alarm,
            others: WakeFlag::new(),
            lag: Micros::ZERO,
            last: LastFrame {
                at: Instant(0),
                bytes: 0,
                settings: SerialSettings::FACTORY,
            },
            closing: None,
        }
    }

    /// Runs the line until it is closed or all its handles are dropped.
    pub(crate) async fn run(mut self) {
        let mut backoff = Backoff::new();
        while self.closing.is_none() {
            let lost = match self.open().await {
                Some(Ok(())) => {
                    backoff.reset();
                    self.be_up().await
                }
                Some(Err(why)) => Some(why),
                None => None,
            };
            if let Some(why) = lost
                && self.closing.is_none()
            {
                self.publisher.set_state(LineState::Absent(Arc::new(why)));
                self.pause(backoff.next()).await;
            }
        }
        self.publisher.set_state(LineState::Closed);
        if let Some(reply) = self.closing.take().and_then(|closing| closing.reply) {
            let _ = reply.send(());
        }
    }

    /// Opens the port; none if the line was closed meanwhile.
    async fn open(&mut self) -> Option<Result<(), PortError>> {
        let (members, bus, told) = (&mut self.members, &mut self.bus, self.told);
        let change = |change| members.change(bus, told, change);
        let queue = (&mut self.jobs, &mut self.publisher);
        match without_port(queue, change, self.port.open()).await {
            Ok(end) => Some(end),
            Err(closed) => {
                self.begin_close(closed);
                None
            }
        }
    }

    /// Waits before the next attempt to open the port.
    async fn pause(&mut self, pause: Micros) {
        let (members, bus, told) = (&mut self.members, &mut self.bus, self.told);
        let change = |change| members.change(bus, told, change);
        let wait = self.alarm.sleep(pause);
        let queue = (&mut self.jobs, &mut self.publisher);
        if let Err(closed) = without_port(queue, change, wait).await {
            self.begin_close(closed);
        }
    }

    /// Drives the line until the port is lost, or the line is closed.
    async fn be_up(&mut self) -> Option<PortError> {
        let config = with_medium(self.config, self.port.medium());
        if config.medium != self.config.medium {
            // The medium is known only once the port is open. No command was taken yet.
            self.config = config;
            self.bus = self.members.build(config);
        }
        self.lag = Micros::ZERO;
        self.publisher.set_granted(self.port.granted());
        self.publisher.set_state(LineState::Up);
        self.bus.found(self.port.past());
        self.handle(self.alarm.now(), Input::Opened);
        let stop = self.drive().await;
        if let Stop::Closed = stop {
            self.let_frame_leave().await;
            let now = self.alarm.now();
            if self.late_replies_until().is_none_or(|until| until <= now) {
                self.port.settle();
            }
        }
        self.port.close();
        let probe_was_sent = !self.bus.withdraw_probe();
        self.handle(self.alarm.now(), Input::Closed);
        while let Output::Event(event) = self.bus.poll() {
            self.on_event(&event);
        }
        self.pending.clear(probe_was_sent, &mut self.publisher);
        self.publisher.flush();
        match stop {
            Stop::Lost(error) => Some(PortError::of_loss(&error)),
            Stop::Closed => None,
        }
    }

    /// The line's loop.
    async fn drive(&mut self) -> Stop {
        let mut buffer = [0; BUFFER];
        // While there was no port, others were polled by the task's own waker.
        self.others.set();
        match self.react() {
            Ok(()) => poll_fn(|cx| self.poll_drive(cx, &mut buffer)).await,
            Err(stop) => stop,
        }
    }

    fn poll_drive(&mut self, cx: &mut Context<'_>, buffer: &mut [u8; BUFFER]) -> Poll<Stop> {
        loop {
            let wakeup = ready!(self.poll_next(cx, buffer));
            if let Err(stop) = self.take_wakeup(wakeup, buffer).and_then(|()| self.react()) {
                return Poll::Ready(stop);
            }
        }
    }

    fn take_wakeup(&mut self, wakeup: Wakeup, buffer: &[u8; BUFFER]) -> Result<(), Stop> {
        match wakeup {
            Wakeup::Bytes(count) => {
                let bytes = buffer.get(..count?).unwrap_or_default();
                self.lag = Micros::ZERO;
                self.pending
                    .heard(bytes, || self.bus.echoes() == Some(true));
                self.handle(self.alarm.now(), Input::Bytes(bytes));
            }
            Wakeup::Deadline(now) => self.handle(now?, Input::Timeout),
            Wakeup::Job(job) => self.take_all(job),
        }
        Ok(())
    }

    /// Does what the state machine wants, and sets the alarm for its deadline.
    fn react(&mut self) -> Result<(), Stop> {
        let deadline = self.drain();
        self.publisher.flush();
        self.alarm.set(deadline?)?;
        Ok(())
    }

    /// Runs the state machine until it waits; returns the deadline in the clock's time.
    fn drain(&mut self) -> Result<Option<Instant>, Stop> {
        loop {
            if self.is_drained() {
                return Err(Stop::Closed);
            }
            if self.pending.has_probes() {
                self.turn_to_next_probe();
            }
            match self.bus.poll() {
                Output::Transmit { bytes, settings } => {
                    self.port.send(bytes, settings)?;
                    self.pending.sent(bytes, settings);
                    let at = self.alarm.now();
                    self.lag = at.since(self.told);
                    self.last = LastFrame {
                        at,
                        bytes: bytes.len(),
                        settings,
                    };
                }
                Output::Event(event) => self.on_event(&event),
                Output::Wait(at) => return Ok(self.wake_at(at)),
            }
        }
    }

    /// The state machine's deadline in the clock's time, at most the deadline for closing.
    fn wake_at(&self, deadline: Option<Instant>) -> Option<Instant> {
        let deadline = deadline.map(|at| at + self.lag);
        let Some(closing) = &self.closing else {
            return deadline;
        };
        let closing = match self.late_replies_until() {
            Some(until) => until.min(closing.until),
            None => closing.until,
        };
        Some(deadline.map_or(closing, |at| at.min(closing)))
    }

    /// Bytes go first: they decide what a deadline means. Jobs go last, so that a flood of them
    /// delays nothing.
    fn poll_next(&mut self, cx: &mut Context<'_>, buffer: &mut [u8; BUFFER]) -> Poll<Wakeup> {
        if let Poll::Ready(count) = self.port.poll_read(cx, buffer) {
            return Poll::Ready(Wakeup::Bytes(count));
        }
        if !self.others.take(cx) {
            return Poll::Pending;
        }
        let wakeup = self.poll_others();
        if wakeup.is_ready() {
            // There may be more.
            self.others.set();
        }
        wakeup
    }

    fn poll_others(&mut self) -> Poll<Wakeup> {
        let cx = &mut Context::from_waker(self.others.waker());
        if let Poll::Ready(now) = self.alarm.poll(cx) {
            return Poll::Ready(Wakeup::Deadline(now));
        }
        if self.closing.is_some() {
            return Poll::Pending;
        }
        self.jobs.poll_recv(cx).map(Wakeup::Job)
    }

    fn handle(&mut self, now: Instant, input: Input<'_>) {
        self.told = self.bus_time(now);
        self.bus.handle(self.told, input);
    }

    fn bus_time(&self, now: Instant) -> Instant {
        Instant(now.0.saturating_sub(self.lag.0)).max(self.told)
    }

    /// The observer has all events before a caller gets its result: a read after a write sees the
    /// write.
    fn on_event(&mut self, event: &Event) {
        self.publisher.publish(event);
        match event {
            Event::Seen {
                module,
                op,
                seen,
                asked,
                ..
            } => self.pending.seen(*module, op, seen, *asked),
            Event::Done { ticket, end, took } => {
                self.pending
                    .end(*ticket, (*end, *took), &mut self.publisher);
            }
            Event::ProbedLate {
                exchange,
                after,
                again,
            } => self.pending.late(LateReply {
                exchange: *exchange,
                after: *after,
                again: *again,
            }),
            Event::Probed { outcome, after } => {
                self.publisher.flush();
                self.pending
                    .end_probe(*outcome, *after, self.bus.took_echo());
            }
            Event::Overflow { .. } => self.publish_presence(),
            _ => {}
        }
    }

    /// Events were lost: whether each module answers is published anew.
    #[cold]
    fn publish_presence(&mut self) {
        for module in (0..self.members.modules.len()).map(ModuleId) {
            if !self.members.left.contains(&module) {
                let presence = self.bus.presence(module);
                self.publisher
                    .publish(&Event::Presence { module, presence });
            }
        }
    }

    /// Takes all waiting jobs, so that writes submitted together can share a frame.
    fn take_all(&mut self, first: Option<Job>) {
        self.take(first);
        while self.closing.is_none()
            && let Ok(job) = self.jobs.try_recv()
        {
            self.take(Some(job));
        }
    }

    fn take(&mut self, job: Option<Job>) {
        self.told = self.bus_time(self.alarm.now());
        match job {
            Some(Job::Run {
                module,
                op,
                terms,
                reply,
            }) => match self.bus.submit(self.told, module, op, terms) {
                Ok(ticket) => self.pending.add(PendingRun {
                    ticket,
                    module,
                    op,
                    submitted: self.told,
                    seen: None,
                    reply,
                }),
                Err(fault) => reply.send(Err(fault), &mut self.publisher),
            },
            Some(Job::Probe { probe, reply }) => self.pending.queue_probe(probe, reply),
            Some(Job::Tap { reply }) => {
                let _ = reply.send(self.pending.tap(self.alarm.clock()));
            }
            Some(Job::Change(change)) => {
                self.members.change(&mut self.bus, self.told, change);
            }
            Some(Job::Close { reply }) => self.begin_close(Some(reply)),
            None => self.begin_close(None),
        }
    }

    /// Probes run one after the other. One that was not sent yet is dropped when its caller is
    /// gone; one that was sent is waited for, so that the next one does not get its reply.
    #[cold]
    fn turn_to_next_probe(&mut self) {
        if self.pending.is_abandoned() && self.bus.withdraw_probe() {
            self.pending.forget_probe();
        }
        if let Some((probe, reply)) = self.pending.next_probe() {
            if self.bus.submit_probe(self.told, probe) {
                self.pending.add_probe(probe.changes, reply);
            } else {
                let _ = reply.send(Err(Fault::Closed));
            }
        }
    }

    /// Begins to close the line: takes no more jobs.
    fn begin_close(&mut self, reply: Option<oneshot::Sender<()>>) {
        self.refuse_all();
        let until = self.alarm.now() + CLOSING_MAX;
        self.closing = Some(Closing { until, reply });
    }

    /// Whether nothing is pending on a line that is being closed.
    fn is_drained(&self) -> bool {
        let Some(closing) = &self.closing else {
            return false;
        };
        let now = self.alarm.now();
        let awaits_late = self.late_replies_until().is_some_and(|until| until > now);
        closing.until <= now || self.pending.is_idle() && !awaits_late
    }

    /// Until when a late reply may come that would reach the next user of the port.
    fn late_replies_until(&self) -> Option<Instant> {
        self.bus.late_replies_until().map(|until| until + self.lag)
    }

    /// A truncated frame could be taken for another one.
    async fn let_frame_leave(&mut self) {
        let LastFrame {
            at,
            bytes,
            settings,
        } = self.last;
        let left = (at + settings.frame_time(bytes)).since(self.alarm.now());
        if left > Micros::ZERO {
            let _ = self.alarm.sleep(left).await;
        }
    }
}

impl<P> Task<P> {
    /// Takes no more jobs.
    fn refuse_all(&mut self) {
        self.jobs.close();
        while let Ok(job) = self.jobs.try_recv() {
            job.refuse(&mut self.publisher);
        }
    }
}

impl<P> Drop for Task<P> {
    /// A task that panicked, or whose runtime ended, owes ends. After [`Task::run`] there are none.
    fn drop(&mut self) {
        self.refuse_all();
        self.pending.clear(true, &mut self.publisher);
        self.publisher.flush();
    }
}

impl Job {
    /// Ends a job that needs a port.
    fn refuse(self, publisher: &mut Publisher) {
        match self {
            Job::Run { reply, .. } => reply.send(Err(Fault::Closed), publisher),
            Job::Probe { reply, .. } => drop(reply.send(Err(Fault::Closed))),
            // The caller sees that the channel is closed.
            Job::Tap { reply } => drop(reply),
            Job::Change(_) => {}
            Job::Close { reply } => drop(reply.send(())),
        }
    }
}

/// Waits for something while there is no port: modules can change, other jobs are refused. If the
/// line is closed before that, the error says by whom.
async fn without_port<T>(
    (jobs, publisher): (&mut mpsc::Receiver<Job>, &mut Publisher),
    mut change: impl FnMut(ModuleChanges),
    work: impl Future<Output = T>,
) -> Result<T, Option<oneshot::Sender<()>>> {
    let mut work = pin!(work);
    poll_fn(|cx| {
        while let Poll::Ready(job) = jobs.poll_recv(cx) {
            match job {
                None => return Poll::Ready(Err(None)),
                Some(Job::Close { reply }) => return Poll::Ready(Err(Some(reply))),
                Some(Job::Change(wanted)) => change(wanted),
                Some(job) => job.refuse(publisher),
            }
        }
        publisher.flush();
        work.as_mut().poll(cx).map(Ok)
    })
    .await
}

/// A buffered port makes the line buffered; one that is not may still have a buffered one behind
/// it.
const fn with_medium(config: Config, medium: Medium) -> Config {
    Config {
        medium: match medium {
            Medium::Buffered => medium,
            Medium::Wire => config.medium,
        },
        ..config
    }
}
