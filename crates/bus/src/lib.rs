//! The line master: one half-duplex line as a state machine. It reports nothing untrue
//! about its modules: a late reply is never taken for another, "done" means that the module said
//! so, and a command that may or may not have acted is reported as such.
//!
//! The driver passes in what happens ([`Bus::handle`]) and then drains [`Bus::poll`] until it
//! returns [`Output::Wait`]; each `Wait` replaces the previous deadline. The crate uses no clock
//! and no port.
//!
//! Three words are our own: a *ghost* is a request that timed out and whose reply may still come; a
//! *fence* is a harmless read whose reply can't be mistaken for a ghost's; a *babble* is a line
//! that another sender never lets fall silent.
//!
//! # Where things are
//! What is sent next, after how much silence: `schedule` (how much a family needs: its `Profile`).
//! Commands, with their deadline in the queue: `command`, [`Terms`]. What came of a request:
//! `outcome`, `event`. Requests whose replies may come late: `ghost`; how long that is: `late_max`
//! and `HELD_BACK_MAX` in `module_state`; how they are ruled out sooner: `fence`. Modules
//! that do not answer: `silent`; health and learned times: `module_state`; their model: `identity`.
//! Bytes, echoes: `rx_buffer`. Replies that may be noise: `noise`.

#![no_std]
#![forbid(unsafe_code)]
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::unreachable
)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::indexing_slicing))]

extern crate alloc;

mod command;
mod config;
mod event;
mod fence;
mod ghost;
mod identity;
mod in_flight;
mod module_state;
mod modules;
mod noise;
mod outcome;
mod rx_buffer;
mod schedule;
mod silent;

pub use config::{Config, EchoMode, Medium, Plan, PortHistory, Terms};
use event::Events;
pub use event::{Confirmation, Event, Evidence, Fault, LateReply, Presence, Probed, Ticket};
pub use module_state::{LATE_MIN, MISSES_SILENT};
pub use schedule::COMMANDS_MAX;

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use command::{Command, end_commands};
use fence::shows_order;
use ghost::{Ghost, GhostReply, Ghosts};
use in_flight::{InFlight, Job, write_frame};
pub use in_flight::{PIECE_PAUSE, Probe};
use module_state::{HELD_BACK_MAX, ModuleState};
use railbus_device::{Module, Observation, Op, Refusal};
use railbus_wire::{
    Decoded, Exchange, Frame, Instant, Malformed, Micros, Reply, Response, SerialSettings, rtu,
};
use rx_buffer::{EchoChange, RxBuffer};

/// A module's number on its line, in the order in which they were added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ModuleId(pub usize);

/// What happens to a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// The port is open.
    Opened,
    /// The port is gone, or was closed.
    Closed,
    /// Characters were received; the last one ended now.
    Bytes(&'a [u8]),
    /// The deadline of [`Output::Wait`] has come.
    Timeout,
}

/// What the driver has to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output<'a> {
    /// Send these bytes now, with these settings.
    Transmit {
        /// The frame.
        bytes: &'a [u8],
        /// Speed and character format.
        settings: SerialSettings,
    },
    /// Something happened.
    Event(Event),
    /// Nothing more to do until the deadline, or until something happens.
    Wait(Option<Instant>),
}

/// One line and its modules.
#[derive(Debug)]
pub struct Bus {
    config: Config,
    modules: Vec<ModuleState>,
    /// Modules of more than one protocol share the line.
    mixed: bool,
    commands: VecDeque<Command>,
    events: Events,
    ghosts: Ghosts,
    rx: RxBuffer,
    state: State,
    probe: Option<Probe>,
    last: Last,
    /// The frame being sent, kept for the driver and to recognise its echo.
    outgoing: Frame,
    outgoing_taken: bool,
    settings: SerialSettings,
    /// When the line was last busy: a received character, or the end of what was sent.
    busy_until: Instant,
    /// The line was idle when it was opened, and has been since.
    at_rest: bool,
    /// What is known of earlier users of the port, as long as it matters.
    past: PortHistory,
    /// When it was opened.
    opened: Instant,
    /// When the next silent module may be probed.
    probe_silent_at: Instant,
    next_silent: usize,
    /// Until when the others have the line to themselves for what silent modules were asked for
    /// callers.
    asked_paid_until: Instant,
    /// Roughly how long reading everything once takes.
    cycle: Micros,
    next_ticket: u64,
    now: Instant,
}

/// What the line is doing.
#[derive(Clone, Copy, Debug)]
enum State {
    Closed,
    /// Waiting until this moment: replies to requests from before the opening may still come.
    Settling(Instant),
    Idle,
    Waiting(InFlight),
}

impl Bus {
    /// A closed line without modules.
    #[must_use]
    pub fn new(config: Config) -> Bus {
        Bus {
            config,
            modules: Vec::new(),
            mixed: false,
            commands: VecDeque::with_capacity(COMMANDS_MAX),
            events: Events::new(),
            ghosts: Ghosts::new(config.ghosts),
            rx: RxBuffer::new(config.echo, config.probation),
            state: State::Closed,
            probe: None,
            last: Last::default(),
            outgoing: Frame::new(),
            outgoing_taken: true,
            settings: SerialSettings::FACTORY,
            busy_until: Instant(0),
            at_rest: false,
            past: PortHistory::Unknown,
            opened: Instant(0),
            probe_silent_at: Instant(0),
            next_silent: 0,
            asked_paid_until: Instant(0),
            cycle: Micros::ZERO,
            next_ticket: 0,
            now: Instant(0),
        }
    }

    /// The module with this number.
    #[must_use]
    pub fn module(&self, id: ModuleId) -> Option<&Module> {
        self.modules.get(id.0).map(|state| &state.module)
    }

    /// Whether a module answers.
    #[must_use]
    pub fn presence(&self, id: ModuleId) -> Presence {
        self.modules
            .get(id.0)
            .map(ModuleState::published_presence)
            .unwrap_or_default()
    }

    /// The bytes received since the last request, without the echo. For the driver, right after
    /// [`Event::Probed`].
    #[must_use]
    pub fn heard(&self) -> &[u8] {
        self.rx.heard()
    }

    /// Whether the adapter echoes; none while that is unknown.
    #[must_use]
    pub const fn echoes(&self) -> Option<bool> {
        self.rx.echoes()
    }

    /// Whether the echo of the last request was received and removed.
    #[must_use]
    pub const fn took_echo(&self) -> bool {
        self.rx.took_echo()
    }

    /// Until when a reply may still come to a request that timed out or is in flight: the next user
    /// of the port could take it for a reply to a request of its own.
    #[must_use]
    pub fn late_replies_until(&self) -> Option<Instant> {
        let under_way = match &self.state {
            State::Waiting(flight) if flight.exchange.expects_reply() => {
                Some(flight.sent + LATE_MIN)
            }
            _ => None,
        };
        self.ghosts.late_replies_until().max(under_way)
    }

    /// Sets what is known of earlier users of the port, before it is opened.
    pub const fn found(&mut self, past: PortHistory) {
        self.at_rest = matches!(past, PortHistory::Rested);
        self.past = past;
    }

    /// Passes in what happened, and when. Time never runs backwards.
    pub fn handle(&mut self, now: Instant, input: Input<'_>) {
        self.now = now;
        self.ghosts.expire(now);
        // Every transition of a line is in this match.
        match (&self.state, input) {
            (State::Closed, Input::Opened) => self.open(),
            (State::Closed, _) => {}
            (_, Input::Opened) => {
                self.close();
                self.open();
            }
            (_, Input::Closed) => self.close(),
            (State::Settling(until), Input::Timeout) if *until <= now => self.settled(),
            (State::Settling(_), Input::Bytes(_)) => self.busy_until = now,
            (State::Idle, Input::Bytes(bytes)) => self.overhear(bytes),
            (State::Waiting(flight), Input::Bytes(bytes)) => self.listen(*flight, bytes),
            (State::Waiting(flight), Input::Timeout) if flight.deadline <= now => {
                self.give_up(*flight);
            }
            (_, Input::Timeout) => {}
        }
        self.expire_commands();
    }

    /// The next thing to do; [`Output::Wait`] when there is nothing more.
    pub fn poll(&mut self) -> Output<'_> {
        if let Some(event) = self.events.next() {
            return Output::Event(event);
        }
        if let Some(lost) = self.events.take_lost() {
            self.read_all_again();
            return Output::Event(Event::Overflow { lost });
        }
        let next = match &self.state {
            State::Closed => None,
            State::Settling(until) => Some(*until),
            State::Waiting(flight) => Some(flight.deadline),
            State::Idle => {
                let next = self.start_next();
                if self.outgoing_taken
                    && let Some(event) = self.events.next()
                {
                    return Output::Event(event);
                }
                next
            }
        };
        if !self.outgoing_taken {
            self.outgoing_taken = true;
            return Output::Transmit {
                bytes: self.outgoing.bytes(),
                settings: self.settings,
            };
        }
        Output::Wait(match (self.next_expiry(), next) {
            (Some(expiry), Some(next)) => Some(expiry.min(next)),
            (expiry, next) => expiry.or(next),
        })
    }

    fn open(&mut self) {
        let settle = match self.past {
            PortHistory::Rested => Micros::ZERO,
            PortHistory::Unknown => self.config.settle,
            PortHistory::Abandoned => LATE_MIN,
        };
        self.state = State::Settling(self.now + settle);
        self.ghosts.clear();
        self.rx = RxBuffer::new(self.config.echo, self.config.probation);
        self.busy_until = self.now;
        self.opened = self.now;
        self.probe_silent_at = self.now;
        self.asked_paid_until = self.now;
        let count = self.modules.len();
        let now = self.now + settle;
        self.cycle = Micros::ZERO;
        for (nth, state) in self.modules.iter_mut().enumerate() {
            state.start(now, nth, count);
            self.cycle += state.cycle();
        }
    }

    fn settled(&mut self) {
        self.rx.forget();
        self.state = State::Idle;
    }

    fn close(&mut self) {
        self.state = State::Closed;
        self.outgoing_taken = true;
        self.ghosts.clear();
        self.probe = None;
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            Some(Err(if command.is_unsent() {
                Fault::Closed
            } else {
                Fault::Unknown
            }))
        });
        for index in 0..self.modules.len() {
            if let Some(state) = self.modules.get_mut(index) {
                state.close();
            }
            self.publish_presence(ModuleId(index));
        }
    }

    /// Unsolicited bytes: late or duplicated replies, or noise.
    fn overhear(&mut self, bytes: &[u8]) {
        let babbles = self.rx.overhear(self.now, self.busy_until, bytes);
        self.busy_until = self.now;
        self.at_rest = false;
        if babbles {
            self.events.push(Event::Babble);
        }
        self.take_late_replies();
    }

    /// Looks for late replies among the received bytes, and drops those bytes.
    #[inline]
    fn take_late_replies(&mut self) {
        if !self.rx.heard().is_empty() {
            self.take_late_replies_heard();
        }
    }

    #[cold]
    fn take_late_replies_heard(&mut self) {
        if let Some(met) = self.ghosts.take_reply(self.rx.heard()) {
            self.rx.forget();
            self.on_late_reply(met);
        } else if self.rx.holds_duplicate() {
            self.rx.forget();
            self.become_cautious();
        }
    }

    /// A late reply came. One that names no module is only dropped.
    fn on_late_reply(&mut self, met: GhostReply) {
        let Some(ghost) = met.ghost else { return };
        let after = self.now.since(ghost.sent);
        if ghost.module.is_none() {
            self.events.push(Event::ProbedLate {
                exchange: ghost.exchange,
                after,
                again: ghost.answered,
            });
        }
        if ghost.answered {
            self.become_cautious();
            return;
        }
        if self.rx.is_cautious() {
            self.expect_copy(ghost);
        }
        let Some(module) = ghost.module else { return };
        self.ghosts.end_before(module, ghost.sent);
        if ghost.fence {
            self.answered_fence(module);
        }
        if self.now <= ghost.late {
            self.note_answer(module, after);
            if let Some(state) = self.modules.get_mut(module.0)
                && state.identifies(&ghost.exchange)
            {
                state.identified_late(after, self.now);
            }
        } else {
            // It says nothing about how fast the module is, nor about its state now: ask it.
            if self
                .modules
                .get(module.0)
                .is_some_and(ModuleState::is_silent)
            {
                (self.probe_silent_at, self.next_silent) = (self.now, module.0);
            }
        }
        self.events.push(Event::Late { module, after });
    }

    /// The reply to this one came; it may come a second time.
    fn expect_copy(&mut self, ghost: Ghost) {
        let until = self.now + self.config.duplicate_window;
        self.ghosts.add(Ghost {
            late: until,
            until,
            answered: true,
            ..ghost
        });
    }

    fn become_cautious(&mut self) {
        if self.rx.become_cautious() {
            self.events.push(Event::Duplicates);
        }
    }

    #[inline]
    fn note_answer(&mut self, module: ModuleId, turnaround: Micros) {
        let Some(state) = self.modules.get_mut(module.0) else {
            return;
        };
        state.answered(turnaround);
        if state.published_presence() != Presence::Online {
            self.publish_presence(module);
        }
    }

    /// Bytes while a reply is awaited.
    fn listen(&mut self, mut flight: InFlight, bytes: &[u8]) {
        self.busy_until = self.now.max(self.busy_until);
        let too_early = self.config.medium == Medium::Wire && self.now < flight.sent;
        let echo = self
            .rx
            .listen(bytes, &flight.exchange, self.outgoing.bytes(), too_early);
        if let Some(news) = echo {
            self.suspect_echo(news);
        }
        let heard = self.rx.reply();
        let missing = match &flight.exchange.find_response(heard) {
            &(skip, Decoded::Whole { len, ref value })
                if !self
                    .ghosts
                    .overlaps(heard, skip..skip + doubtful(&flight.exchange, len)) =>
            {
                let outcome = self.interpret(&flight, value);
                let in_order = shows_order(&flight, value);
                return self.answered(&flight, (skip, len), outcome, in_order);
            }
            (_, Decoded::Partial { more }) => *more,
            _ if heard.is_empty() => return,
            // Another module, or noise: the reply may still follow.
            (_, Decoded::Malformed(_) | Decoded::Whole { .. }) => {
                if let Some(met) = self.ghosts.take_reply(heard) {
                    self.rx.cut(met.at, met.len);
                    self.on_late_reply(met);
                }
                flight.exchange.response_len_max()
            }
        };
        flight.extend(self.now, self.settings.frame_time(missing));
        self.state = State::Waiting(flight);
    }

    /// A request came back on a line that was not known to echo.
    #[cold]
    fn suspect_echo(&mut self, news: EchoChange) {
        for command in &mut self.commands {
            command.suspect_echo();
        }
        if news == EchoChange::Found {
            self.events.push(Event::Echo);
        }
    }

    /// The reply timed out: a last look at what was received, then the fault.
    fn give_up(&mut self, flight: InFlight) {
        if !flight.exchange.expects_reply() {
            return self.sent(flight);
        }
        self.rx
            .end_of_listening(&flight.exchange, self.outgoing.bytes());
        for skip in 0..self.rx.reply().len() {
            let rest = self.rx.reply().get(skip..).unwrap_or_default();
            // Bytes that have not come by now will not come: what looked like the head of another
            // reply was none.
            if let Decoded::Whole { len, value } = flight.exchange.decode_response(rest)
                && !self.ghosts.overlaps(self.rx.reply(), skip..skip)
            {
                let outcome = self.interpret(&flight, &value);
                let in_order = shows_order(&flight, &value);
                return self.answered(&flight, (skip, len), outcome, in_order);
            }
        }
        self.missed(flight);
    }

    fn interpret(&self, flight: &InFlight, reply: &Reply<Response<'_>>) -> Outcome {
        let state = flight.job.module().and_then(|id| self.modules.get(id.0));
        match state {
            Some(state) => {
                let op = match flight.job.op() {
                    Op::Fence if state.identifies(&flight.exchange) => Op::Identify,
                    op => op,
                };
                Outcome::Seen(state.module.interpret(&op, &reply.response))
            }
            None => Outcome::Probed,
        }
    }

    /// A good reply came, `len` bytes after `skip` others. With `in_order` it shows that older
    /// requests are done.
    fn answered(
        &mut self,
        flight: &InFlight,
        (skip, len): (usize, usize),
        outcome: Outcome,
        in_order: bool,
    ) {
        if len <= noise::NAMELESS_MAX && self.may_be_noise(&flight.exchange, skip) {
            return self.noise(flight);
        }
        self.state = State::Idle;
        let reply_time = self.settings.frame_time(len);
        // A reply recognised only at the deadline came before it.
        let turnaround = self.busy_until.since(flight.sent) - reply_time;
        let echo_is_gone = self
            .rx
            .answered(&flight.exchange, self.outgoing.bytes(), skip, len);
        if echo_is_gone {
            self.events.push(Event::EchoGone);
        }
        if self.rx.fell_silent() {
            self.events.push(Event::Quiet);
        }
        let is_inherited = self.past == PortHistory::Abandoned && self.is_inherited();
        if is_inherited {
            self.rx.forget();
            self.add_ghost(flight);
            self.fail(flight, len, None);
            return self.end_if_left(flight);
        }
        let is_own = self.is_own(flight, in_order, skip);
        self.take_late_replies();
        // Two modules with the same address both answer a probe.
        if self.rx.is_cautious() || self.may_have_twins(&flight.job) {
            let until = self.now + self.config.duplicate_window;
            let module = flight.job.module();
            let ghost = Ghost {
                exchange: flight.exchange,
                module,
                sent: flight.sent,
                late: until,
                until,
                answered: true,
                fence: flight.is_fence(),
            };
            self.ghosts.add(ghost);
        }
        if let Some(module) = flight.job.module() {
            self.note_answer(module, turnaround);
        }
        match outcome {
            // It may be the reply to an older request; the reply to this one may have been lost.
            _ if !is_own => self.fail(flight, len, None),
            Outcome::Probed => {
                self.events.push(Event::Probed {
                    outcome: Probed::Answered,
                    after: turnaround,
                });
            }
            Outcome::Seen(Observation::Refused(Refusal::Exception(rtu::Exception::CHECKSUM))) => {
                self.fail(flight, len, Some(Malformed::Checksum));
            }
            Outcome::Seen(Observation::Unexpected) => {
                self.fail(flight, len, Some(Malformed::Value))
            }
            Outcome::Seen(seen) => self.learn(flight, seen),
        }
        self.end_if_left(flight);
    }

    /// Whether two modules may answer this: a probe does not say which, unless the module there is
    /// polled, where two would have been heard.
    fn may_have_twins(&self, job: &Job) -> bool {
        let Job::Probe { addressee, .. } = job else {
            return false;
        };
        let state = addressee.and_then(|id| self.modules.get(id.0));
        let is_polled = |state: &ModuleState| {
            state.plan.enabled && state.published_presence() == Presence::Online
        };
        !state.is_some_and(is_polled)
    }

    /// Whether the reply just received may belong to a killed process that had the port before:
    /// replies held back for it arrive together.
    #[cold]
    fn is_inherited(&mut self) -> bool {
        if self.now > self.opened + HELD_BACK_MAX {
            self.past = PortHistory::Unknown;
            return false;
        }
        !self.rx.heard().is_empty()
    }

    /// A frame that gets no reply was sent.
    fn sent(&mut self, flight: InFlight) {
        self.state = State::Idle;
        match flight.job {
            Job::Command { module, .. } => {
                self.end_sent_commands(module, |_| Some(Ok(Confirmation::Sent)))
            }
            Job::Poll { .. } | Job::ReadBack { .. } | Job::OnOnline { .. } | Job::Fence { .. } => {}
            Job::Probe { .. } => self.events.push(Event::Probed {
                outcome: Probed::Silent,
                after: Micros::ZERO,
            }),
        }
    }

    /// Starts an exchange; returns when its reply times out.
    fn start(&mut self, job: &Job, exchange: &Exchange<'static>, timeout: Micros) -> Instant {
        write_frame(job, exchange, &mut self.outgoing);
        self.outgoing_taken = false;
        let expects_reply = exchange.expects_reply();
        // A frame that gets no reply must be given its time on the wire, even where it is buffered.
        let sent = match self.config.medium {
            Medium::Buffered if expects_reply => self.now,
            _ => self.now + self.settings.frame_time(self.outgoing.bytes().len()),
        };
        if self.rx.prepare(self.now, self.busy_until) {
            self.events.push(Event::Quiet);
        }
        self.busy_until = sent;
        self.at_rest = false;
        let deadline = if expects_reply {
            sent + timeout + self.wire_time(exchange)
        } else {
            sent
        };
        let asked = self.now;
        self.state = State::Waiting(InFlight::new(*job, *exchange, (asked, sent, deadline)));
        deadline
    }

    /// How long the request (if it is buffered) and the reply take on the wire, in addition to the
    /// turnaround.
    fn wire_time(&self, exchange: &Exchange<'_>) -> Micros {
        let reply = self.settings.frame_time(exchange.response_len_max());
        match self.config.medium {
            Medium::Wire => reply,
            Medium::Buffered => reply + self.settings.frame_time(self.outgoing.bytes().len()),
        }
    }
}

/// How many bytes of a reply may belong to another one: a CRC over all of it rules that out.
const fn doubtful(exchange: &Exchange<'_>, len: usize) -> usize {
    match exchange {
        Exchange::Rtu(_) => 0,
        Exchange::Ascii(_) | Exchange::Lc02(_) | Exchange::R55(_) => len,
    }
}

/// What was sent last.
#[derive(Clone, Copy, Debug, Default)]
struct Last {
    /// A probe of a scan.
    probe: bool,
    /// A poll that could not wait any longer.
    urgent: bool,
    /// A frame that another may follow without a gap.
    chain: bool,
}

/// The meaning of a reply, without its bytes.
#[derive(Clone, Copy, Debug)]
enum Outcome {
    Seen(Observation),
    Probed,
}
