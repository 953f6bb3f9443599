//! How a procedure talks to its driver: it hands out one action and takes in one result.
//!
//! A procedure is an `async fn` that awaits nothing but its own actions. [`Procedure`] polls it by
//! hand, with a no-op waker: it contains no runtime, and never waits for anything but the next
//! [`Procedure::next`].

use super::{BusAddress, JournalRecord, NotWritable, Taken};
use crate::risk::Risk;
use railbus_bus::LATE_MIN;
use railbus_device::{Module, Observation, Op, Setup};
use railbus_wire::{
    Exchange, Frame, Instant, Micros, Protocol, REPLY_TIMEOUT, SerialSettings, foreign_command,
};
use std::fmt;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

/// Gap before every request: adapters deliver bytes late.
const QUIET: Micros = Micros::from_millis(20);

/// The next action.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "one at a time")]
pub enum DriverAction {
    /// Write this to the journal and make it durable.
    Journal(JournalRecord),
    /// Send a request and listen.
    Ask(TimedExchange),
    /// Let this much time pass.
    Wait(Micros),
    /// Report progress to the user.
    Tell(Progress),
    /// Ask the user.
    Confirm(Question),
}

/// A request to send.
#[derive(Clone, Copy, Debug)]
pub struct TimedExchange {
    /// The exchange, which also decodes its reply.
    pub exchange: Exchange<'static>,
    /// Speed and character format.
    pub settings: SerialSettings,
    /// The gap before it.
    pub quiet: Micros,
    /// Timeout of the reply, its own time on the wire included.
    pub timeout: Micros,
}

/// The result of an action.
#[derive(Clone, Debug)]
pub enum Event {
    /// The procedure begins.
    Begin,
    /// The record is durable, or could not be made so.
    Kept(bool),
    /// What was heard.
    Heard(RxBytes),
    /// The time has passed, or the user was informed.
    Over,
    /// The user's answer to a question.
    Answer(bool),
}

/// What was heard after a request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RxBytes {
    /// The bytes after it, without the echo; up to the end of a valid reply, or all.
    pub bytes: Vec<u8>,
    /// Bytes that came after the end of the previous reply.
    pub stray: Vec<u8>,
    /// The port was lost: whether anything was sent is not known.
    pub lost: bool,
}

/// Progress, for the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The module is being read.
    Reading(BusAddress),
    /// Checking that nothing answers at the new address.
    Vacancy(BusAddress),
    /// A write was sent: the number of the step, and of how many.
    Writing(u8, u8),
    /// Looking for it here.
    Looking(BusAddress),
    /// The module must be power-cycled; this many seconds are left.
    PowerCycle(u64),
    /// A calibration is in progress.
    Calibrating,
}

/// A question to the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// Are all analog inputs disconnected? These are the readings, in hundredths.
    ZeroReady([u16; 2]),
    /// Is this voltage, in hundredths, applied to all inputs? These are the readings, in
    /// hundredths.
    SpanReady(u16, [u16; 2]),
}

/// Why a procedure ended without its result. Nothing was written to the module, unless the journal
/// says so.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ProcedureError {
    /// Nothing answers at that place.
    NoReply(BusAddress),
    /// Only invalid replies from that place: noise, or two modules.
    Garbled(BusAddress),
    /// Another model answers at that place; what it says it is, if it says so.
    WrongModel(BusAddress, Option<String>),
    /// The requested settings are not possible.
    Refused(NotWritable),
    /// The new place is in use.
    Taken(Taken),
    /// A module of another protocol could take the frame for a command.
    Unsafe(Protocol),
    /// The journal can't be written; whether a write had already been sent.
    Journal(bool),
    /// The port was lost; whether a write had already been sent.
    Port(bool),
    /// The user stopped it.
    Stopped,
}

impl ProcedureError {
    /// Whether something may have been written nevertheless.
    #[must_use]
    pub const fn may_have_acted(&self) -> bool {
        match self {
            ProcedureError::Port(wrote) | ProcedureError::Journal(wrote) => *wrote,
            ProcedureError::NoReply(_)
            | ProcedureError::Garbled(_)
            | ProcedureError::WrongModel(..)
            | ProcedureError::Refused(_)
            | ProcedureError::Taken(_)
            | ProcedureError::Unsafe(_)
            | ProcedureError::Stopped => false,
        }
    }
}

/// What a procedure does next, or its result.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "one at a time")]
pub enum ProcedureStep<T> {
    /// Do this, and report the result.
    Do(DriverAction),
    /// It has ended.
    Done(T),
}

/// A running procedure.
pub struct Procedure<T> {
    future: Pin<Box<dyn Future<Output = T> + Send>>,
    context: ProcedureContext,
}

impl<T> fmt::Debug for Procedure<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Procedure").finish_non_exhaustive()
    }
}

impl<T> Procedure<T> {
    /// A procedure that has not started.
    pub(crate) fn new<F>(body: impl FnOnce(ProcedureContext) -> F) -> Procedure<T>
    where
        F: Future<Output = T> + Send + 'static,
    {
        let context = ProcedureContext::default();
        Procedure {
            future: Box::pin(body(context.clone())),
            context,
        }
    }

    /// Takes the result of the last action and its time, and returns the next action. The first
    /// event is [`Event::Begin`].
    pub fn next(&mut self, now: Instant, event: Event) -> ProcedureStep<T> {
        {
            let mut paper = self.context.lock();
            paper.now = now;
            paper.event = (!matches!(event, Event::Begin)).then_some(event);
        }
        let mut context = Context::from_waker(Waker::noop());
        match self.future.as_mut().poll(&mut context) {
            Poll::Ready(end) => ProcedureStep::Done(end),
            // A procedure that waits without an action would wait for ever: let time pass.
            Poll::Pending => ProcedureStep::Do(
                self.context
                    .lock()
                    .act
                    .take()
                    .unwrap_or(DriverAction::Wait(QUIET)),
            ),
        }
    }

    /// Stops it at the next point where that is safe.
    pub fn stop(&self) {
        self.context.lock().stopped = true;
    }
}

/// The state shared by a procedure and its driver.
#[derive(Clone, Debug, Default)]
pub(crate) struct ProcedureContext(Arc<Mutex<Mailbox>>);

#[derive(Debug, Default)]
struct Mailbox {
    now: Instant,
    act: Option<DriverAction>,
    event: Option<Event>,
    stopped: bool,
    /// Requests whose replies may still arrive, and until when.
    ghosts: Vec<(Exchange<'static>, Instant)>,
    /// Speed and format of the last request.
    settings: Option<SerialSettings>,
    /// The last request, which a second module may answer, too.
    last: Option<Exchange<'static>>,
    /// It did.
    twice: bool,
    /// Bytes arrived before the last request, after one that was not answered.
    stray: bool,
    /// The last request was not answered.
    unanswered: bool,
    /// A request other than a read was sent.
    wrote: bool,
    /// The gap before the next request, if it is to be longer than usual.
    linger: Option<Micros>,
}

/// The result of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Reply {
    /// The module's response.
    Said(Observation),
    /// No reply.
    Silent,
    /// Bytes that are not a valid reply.
    Garbled,
}

impl ProcedureContext {
    fn lock(&self) -> MutexGuard<'_, Mailbox> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn act(&self, act: DriverAction) -> Event {
        self.lock().act = Some(act);
        poll_fn(|_| match self.lock().event.take() {
            Some(event) => Poll::Ready(event),
            None => Poll::Pending,
        })
        .await
    }

    pub(crate) fn now(&self) -> Instant {
        self.lock().now
    }

    /// Whether the user asked to stop.
    pub(crate) fn stopped(&self) -> bool {
        self.lock().stopped
    }

    /// The next request waits as long as a second module may take to answer the last one.
    pub(crate) fn linger(&self) {
        self.lock().linger = Some(REPLY_TIMEOUT);
    }

    /// Whether a request was answered twice: two modules have one address.
    pub(crate) fn heard_twice(&self) -> bool {
        self.lock().twice
    }

    /// Whether the request before the last one was answered after it had timed out.
    pub(crate) fn heard_late(&self) -> bool {
        self.lock().stray
    }

    pub(crate) async fn journal(&self, record: JournalRecord) -> Result<(), ProcedureError> {
        match self.act(DriverAction::Journal(record)).await {
            Event::Kept(true) => Ok(()),
            _ => Err(ProcedureError::Journal(self.lock().wrote)),
        }
    }

    pub(crate) async fn wait(&self, time: Micros) {
        self.act(DriverAction::Wait(time)).await;
    }

    pub(crate) async fn tell(&self, progress: Progress) {
        self.act(DriverAction::Tell(progress)).await;
    }

    pub(crate) async fn confirm(&self, question: Question) -> bool {
        matches!(
            self.act(DriverAction::Confirm(question)).await,
            Event::Answer(true)
        )
    }

    /// Sends one request and receives its reply. A request whose reply could be confused with a
    /// late reply to an earlier one waits until none can arrive any more.
    pub(crate) async fn exchange(
        &self,
        setup: &Setup,
        exchange: Exchange<'static>,
        timeout: Micros,
    ) -> Result<Vec<u8>, ProcedureError> {
        if let Some(protocol) = carried(&exchange) {
            return Err(ProcedureError::Unsafe(protocol));
        }
        self.outwait_ghosts(&exchange).await;
        let serial = setup.serial;
        let switching = {
            let before = self.lock().settings.replace(serial);
            let slower = before.map_or(Micros::ZERO, |before| before.t3_5().max(serial.t3_5()));
            if before == Some(serial) {
                Micros::ZERO
            } else {
                Micros(2 * slower.0)
            }
        };
        let ask = TimedExchange {
            exchange,
            settings: serial,
            quiet: self.quiet().max(setup.request_gap()).max(switching),
            timeout: timeout + serial.frame_time(exchange.response_len_max()),
        };
        self.lock().wrote |= Risk::of(&exchange) > Risk::Read;
        let Event::Heard(heard) = self.act(DriverAction::Ask(ask)).await else {
            return Err(ProcedureError::Port(self.lock().wrote));
        };
        let mut paper = self.lock();
        if heard.lost {
            return Err(ProcedureError::Port(paper.wrote));
        }
        if let Some(last) = paper.last.replace(exchange) {
            paper.twice |= last.find_response(&heard.stray).1.whole().is_some();
        }
        let unanswered = std::mem::replace(&mut paper.unanswered, heard.bytes.is_empty());
        paper.stray = unanswered && !heard.stray.is_empty();
        if exchange.find_response(&heard.bytes).1.whole().is_none() {
            let until = paper.now + LATE_MIN;
            paper.ghosts.push((exchange, until));
        }
        Ok(heard.bytes)
    }

    /// Ignores late replies from now on: they can't affect what follows.
    pub(crate) fn forget_ghosts(&self) {
        self.lock().ghosts.clear();
    }

    fn quiet(&self) -> Micros {
        self.lock().linger.take().unwrap_or(QUIET)
    }

    async fn outwait_ghosts(&self, exchange: &Exchange<'static>) {
        let until = {
            let mut paper = self.lock();
            let now = paper.now;
            paper.ghosts.retain(|(_, until)| *until > now);
            let confusable = paper
                .ghosts
                .iter()
                .filter(|(ghost, _)| ghost.confusable(exchange));
            confusable.map(|(_, until)| until.since(now)).max()
        };
        if let Some(time) = until {
            self.wait(time).await;
        }
    }

    /// Performs an op once.
    pub(crate) async fn op(&self, module: &Module, op: &Op) -> Result<Reply, ProcedureError> {
        self.op_within(module, op, REPLY_TIMEOUT).await
    }

    pub(crate) async fn op_within(
        &self,
        module: &Module,
        op: &Op,
        timeout: Micros,
    ) -> Result<Reply, ProcedureError> {
        let Ok(exchange) = module.exchange(op) else {
            return Err(ProcedureError::Refused(NotWritable::NoCommand));
        };
        let heard = self.exchange(module.setup(), exchange, timeout).await?;
        Ok(match exchange.find_response(&heard).1.whole() {
            Some(reply) => Reply::Said(module.interpret(op, &reply.response)),
            None if heard.is_empty() => Reply::Silent,
            None => Reply::Garbled,
        })
    }

    /// Performs a read-only op, with retries.
    pub(crate) async fn read(&self, module: &Module, op: &Op) -> Result<Reply, ProcedureError> {
        self.read_times(module, op, 3).await
    }

    /// The same, with this many attempts at most.
    pub(crate) async fn read_times(
        &self,
        module: &Module,
        op: &Op,
        times: usize,
    ) -> Result<Reply, ProcedureError> {
        let mut last = Reply::Silent;
        for _ in 0..times {
            last = match self.op(module, op).await? {
                Reply::Said(seen) => return Ok(Reply::Said(seen)),
                // One garbled reply says more than silence after it.
                Reply::Garbled => Reply::Garbled,
                Reply::Silent => last,
            };
        }
        Ok(last)
    }
}

/// The protocol of another module that could take the request for a command.
pub(crate) fn carried(exchange: &Exchange<'_>) -> Option<Protocol> {
    let mut frame = Frame::new();
    exchange.encode(&mut frame);
    foreign_command(frame.bytes(), exchange.protocol(), Protocol::ALL)
}

impl From<NotWritable> for ProcedureError {
    fn from(why: NotWritable) -> ProcedureError {
        ProcedureError::Refused(why)
    }
}

impl ProcedureError {
    /// The place it refers to, if any.
    #[must_use]
    pub const fn place(&self) -> Option<BusAddress> {
        match self {
            ProcedureError::NoReply(place)
            | ProcedureError::Garbled(place)
            | ProcedureError::WrongModel(place, _) => Some(*place),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_procedure_hands_out_its_acts_one_by_one() {
        let mut procedure = Procedure::new(|context| async move {
            context.wait(Micros(5)).await;
            context.confirm(Question::ZeroReady([0; 2])).await
        });
        let now = Instant(0);
        let ProcedureStep::Do(DriverAction::Wait(Micros(5))) = procedure.next(now, Event::Begin)
        else {
            panic!("it waits first");
        };
        let ProcedureStep::Do(DriverAction::Confirm(_)) = procedure.next(now, Event::Over) else {
            panic!("then it asks");
        };
        let ProcedureStep::Done(true) = procedure.next(now, Event::Answer(true)) else {
            panic!("and ends");
        };
    }
}
