//! The state of each module on a line: how fast it answers, and when to ask it next.

use crate::command::bank_of;
use crate::identity::{Identity, IdentityReply};
use crate::{Config, Plan, Presence};
use alloc::vec::Vec;
use railbus_device::{Module, Observation, Op};
use railbus_wire::{Exchange, Frame, Instant, Micros, REPLY_TIMEOUT};

/// The shortest and longest that a learned reply timeout becomes.
pub(crate) const TIMEOUT_MIN: Micros = Micros::from_millis(20);
const TIMEOUT_MAX: Micros = Micros::from_millis(300);
/// The shortest time that late replies are waited for after a request.
pub const LATE_MIN: Micros = Micros::from_millis(500);
/// The longest that an adapter or a network holds a reply back without changing the order of
/// replies.
pub(crate) const HELD_BACK_MAX: Micros = Micros::from_secs(5);
/// After this many failed attempts a module counts as having no fence.
const FENCE_TRIES: u8 = 8;
/// After this many failed attempts the line no longer relies on it.
const FENCE_DOUBTS: u8 = 2;
/// After this many misses in a row a module counts as silent and is only probed.
pub const MISSES_SILENT: u8 = 3;
/// What probing a silent module costs in all, gap and time on the wire included: little, so that
/// its turn comes soon again. One that is known to be slower is waited for. A later reply is
/// recognised as a ghost's and still brings the module online, but on a busy line it meets the next
/// request.
const PROBE_KNOWN: Micros = Micros::from_millis(98);
const PROBE_UNHEARD: Micros = Micros::from_millis(290);
/// The assumed turnaround where nothing is known.
const TURNAROUND_GUESS: Micros = Micros::from_millis(10);
/// The longest time over which the first polls of all modules are spread.
const SPREAD_MAX: Micros = Micros::from_secs(1);
/// The number of turnarounds in a window.
const WINDOW: u16 = 1000;

/// A module on the line.
#[derive(Debug)]
pub(crate) struct ModuleState {
    pub(crate) module: Module,
    pub(crate) presence: Presence,
    /// The presence as published: a module does not count as online before its model is known.
    published: Presence,
    misses: u8,
    turnaround: Turnaround,
    pub(crate) polls: Vec<Poll>,
    /// It is still to be asked which outputs give pulses ([`Module::on_online_op`]).
    asks_pulses: bool,
    /// When to ask that again if it did not answer.
    pub(crate) on_online_at: Instant,
    identity: Identity,
    /// A reading from before its model was known.
    withheld: Option<Reading>,
    fence: Fence,
    pub(crate) plan: Plan,
    /// It was removed from the line; only its number is left.
    pub(crate) retired: bool,
}

/// What shows that older requests to a module are done (docs/decisions/0015).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fence {
    /// Nothing.
    None,
    /// Its polls: a reply to one of them can't be a reply to another.
    Polls,
    /// [`Op::Fence`], if the module answers it: `tries` counts how often it did not and then
    /// answered the next request.
    Untried { tries: u8, missed: bool },
    /// [`Op::Fence`]: the module answered it.
    Known,
}

/// A read of the poll plan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Poll {
    pub(crate) op: Op,
    pub(crate) due: Instant,
    /// When the request of the last good reply began.
    pub(crate) asked: Instant,
}

/// A reading.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    pub(crate) op: Op,
    pub(crate) seen: Observation,
    pub(crate) asked: Instant,
    pub(crate) heard: Instant,
}

/// The slowest recent turnarounds: of the current window and of the one before.
#[derive(Clone, Copy, Debug, Default)]
struct Turnaround {
    now: Micros,
    before: Micros,
    count: u16,
    /// The slowest of the last few: each reply forgets an eighth of it. One slow reply between
    /// others does not count: a module that dies often sends one last.
    lately: Micros,
    /// The last one.
    last: Micros,
}

impl Turnaround {
    fn learn(&mut self, took: Micros) {
        let usual = match self.last {
            Micros::ZERO => took,
            last => took.min(last),
        };
        self.lately = usual.max(self.lately - Micros(self.lately.0 / 8));
        self.last = took;
        self.now = self.now.max(took);
        self.count += 1;
        if self.count == WINDOW {
            *self = Turnaround {
                now: Micros::ZERO,
                before: self.now,
                count: 0,
                ..*self
            };
        }
    }

    fn slowest(self) -> Micros {
        self.now.max(self.before)
    }
}

impl Fence {
    const UNTRIED: Fence = Fence::Untried {
        tries: 0,
        missed: false,
    };

    fn of(module: &Module) -> Fence {
        let mut exchanges = module
            .full_poll()
            .filter_map(|op| module.exchange(&op).ok());
        let first = exchanges.next();
        let differs = |other: Exchange<'_>| first.is_some_and(|first| first.stands_apart(&other));
        if exchanges.any(differs) {
            Fence::Polls
        } else if module.exchange(&Op::Fence).is_ok() {
            Fence::UNTRIED
        } else {
            Fence::None
        }
    }
}

impl ModuleState {
    pub(crate) fn new(module: Module, plan: Plan, config: &Config) -> ModuleState {
        let polls = module
            .full_poll()
            .map(|op| Poll {
                op,
                due: Instant(0),
                asked: Instant(0),
            })
            .collect();
        let fence = if config.fences {
            Fence::of(&module)
        } else {
            Fence::None
        };
        let asks = config.identify && plan.identify;
        let identity = Identity::new(asks && module.can_be_contradicted());
        ModuleState {
            asks_pulses: module.on_online_op().is_some(),
            module,
            presence: Presence::Unheard,
            published: Presence::Unheard,
            misses: 0,
            turnaround: Turnaround::default(),
            polls,
            on_online_at: Instant(0),
            identity,
            withheld: None,
            fence,
            plan,
            retired: false,
        }
    }

    /// It is no longer asked anything.
    pub(crate) fn retire(&mut self) {
        self.retired = true;
        self.plan = Plan::NEVER;
        self.polls = Vec::new();
        self.misses = 0;
    }

    /// Spreads the polls over the plan's interval, but not over more than [`SPREAD_MAX`]: a module
    /// that is polled every ten minutes is read at the start, too. This one is the `nth` of
    /// `count`.
    pub(crate) fn start(&mut self, now: Instant, nth: usize, count: usize) {
        let spread = self.plan.interval.min(SPREAD_MAX);
        let phase = spread.0 / (count.max(1) as u64) * nth as u64;
        for poll in &mut self.polls {
            *poll = Poll {
                due: now + Micros(phase),
                asked: now,
                ..*poll
            };
        }
        (self.presence, self.published) = (Presence::Unheard, Presence::Unheard);
        self.misses = 0;
        self.withheld = None;
        self.invalidate();
        if let Fence::Untried { .. } = self.fence {
            self.fence = Fence::UNTRIED;
        }
    }

    /// Roughly how long reading everything once takes.
    pub(crate) fn cycle(&self) -> Micros {
        let setup = self.module.setup();
        let mut frame = Frame::new();
        let exchanges = self
            .polls
            .iter()
            .filter_map(|poll| self.module.exchange(&poll.op).ok());
        let times = exchanges.map(|exchange| {
            exchange.encode(&mut frame);
            let bytes = frame.bytes().len() + exchange.response_len_max();
            setup.serial.frame_time(bytes) + setup.request_gap() + TURNAROUND_GUESS
        });
        times.fold(Micros::ZERO, |sum, time| sum + time)
    }

    /// A poll is sent.
    pub(crate) fn poll_started(&mut self, op: &Op, now: Instant) {
        if let Some(poll) = self.polls.iter_mut().find(|poll| poll.op == *op) {
            poll.due = now + self.plan.interval;
        }
    }

    /// Postpones its polls until this moment; a fence takes the place of a poll.
    pub(crate) fn put_off(&mut self, until: Instant) {
        for poll in &mut self.polls {
            poll.due = poll.due.max(until);
        }
    }

    /// Something was read, by a poll or for a command.
    pub(crate) fn polled(&mut self, op: &Op, asked: Instant) {
        if let Some(poll) = self.polls.iter_mut().find(|poll| poll.op == *op) {
            poll.asked = asked;
            poll.due = poll.due.max(asked + self.plan.interval);
        }
    }

    /// From when on a poll goes before commands, so that no reading becomes too old if reading
    /// everything once takes `cycle`.
    pub(crate) fn urgent_at(&self, poll: &Poll, cycle: Micros) -> Instant {
        let reserve = cycle * 2 + self.timeout();
        poll.due.max(poll.asked + (self.plan.max_age - reserve))
    }

    /// How long to wait for the beginning of a reply, from the end of the request.
    pub(crate) fn timeout(&self) -> Micros {
        match self.turnaround.slowest() {
            Micros::ZERO => REPLY_TIMEOUT,
            slowest => (slowest * 2).clamp(TIMEOUT_MIN, TIMEOUT_MAX),
        }
    }

    /// The same for a probe of a silent module.
    pub(crate) fn probe_timeout(&self, exchange: &Exchange<'_>) -> Micros {
        let setup = self.module.setup();
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        let bytes = frame.bytes().len() + exchange.response_len_max();
        let all = match self.presence {
            Presence::Unheard => PROBE_UNHEARD,
            Presence::Online | Presence::Silent | Presence::OtherModel => PROBE_KNOWN,
        };
        let rest = all - setup.serial.frame_time(bytes) - setup.request_gap();
        self.timeout()
            .min(rest.max(TIMEOUT_MIN).max(self.probe_least()))
    }

    /// How long a probe waits for it at least: less than what it took before would never meet it.
    pub(crate) fn probe_least(&self) -> Micros {
        let lately = self.turnaround.lately;
        (lately + Micros(lately.0 / 4)).min(self.timeout())
    }

    /// How long after its request a module may still answer.
    pub(crate) fn late_max(&self) -> Micros {
        (self.timeout() * 3).max(LATE_MIN)
    }

    /// A reply came.
    pub(crate) fn answered(&mut self, turnaround: Micros) {
        self.turnaround.learn(turnaround.max(Micros(1)));
        self.misses = 0;
        if !self.is_online() {
            self.presence = Presence::Online;
            self.invalidate();
        }
    }

    /// Everything it was asked on coming online may have changed.
    pub(crate) fn invalidate(&mut self) {
        self.asks_pulses = self.module.on_online_op().is_some();
        self.identity.invalidate();
    }

    /// Whether it answers, and as what, as far as published.
    pub(crate) const fn published_presence(&self) -> Presence {
        self.published
    }

    /// Its presence, if there is a change to publish.
    #[inline]
    pub(crate) fn take_change(&mut self) -> Option<Presence> {
        let is = match self.presence {
            Presence::Online if self.identity.is_other_model() => Presence::OtherModel,
            Presence::Online if self.is_withholding() => return None,
            presence => presence,
        };
        (is != self.published).then(|| {
            self.published = is;
            is
        })
    }

    /// Whether to withhold a reading: another model's would be decoded by the wrong datasheet.
    /// While a module has not identified itself, its last reading waits for that.
    #[cold]
    pub(crate) fn withholds(&mut self, reading: Reading) -> bool {
        let is_withholding = self.is_withholding();
        let is_reading = reading.op.is_read() && reading.op != Op::Identify;
        let withholds = is_reading && (is_withholding || self.is_other_model());
        if withholds {
            self.polled(&reading.op, reading.asked);
        }
        if withholds && is_withholding {
            self.withheld = Some(reading);
        }
        withholds
    }

    /// The reading that may be published now. The other polls are due again.
    pub(crate) fn release_withheld(&mut self, now: Instant) -> Option<Reading> {
        if self.is_online() && !self.is_settled() {
            return None;
        }
        let reading = self.withheld.take()?;
        for poll in self.polls.iter_mut().filter(|poll| poll.op != reading.op) {
            poll.due = poll.due.min(now);
        }
        (self.published == Presence::Online).then_some(reading)
    }

    /// Whether it answers.
    pub(crate) const fn is_online(&self) -> bool {
        matches!(self.presence, Presence::Online)
    }

    /// Whether its values are withheld until it has reported its model, or all attempts have
    /// failed.
    pub(crate) fn is_withholding(&self) -> bool {
        self.identify_first().is_some()
    }

    /// Its line was closed.
    pub(crate) fn close(&mut self) {
        if self.published != Presence::Unheard {
            self.presence = Presence::Silent;
        }
    }

    /// Whether it reports another model.
    pub(crate) const fn is_other_model(&self) -> bool {
        self.identity.is_other_model() && self.is_online()
    }

    /// It answered something other than [`Op::Fence`]: if it did not answer that before, it may not
    /// support it.
    pub(crate) const fn answered_no_fence(&mut self) {
        if let Fence::Untried { tries, missed } = &mut self.fence
            && core::mem::replace(missed, false)
        {
            *tries = tries.saturating_add(1);
        }
    }

    /// It answered [`Op::Fence`], in time or late.
    pub(crate) const fn answered_fence(&mut self) {
        if let Fence::Untried { .. } = self.fence {
            self.fence = Fence::Known;
        }
    }

    /// It refused [`Op::Fence`] or an older request, or must not be asked on this line.
    pub(crate) const fn refused_fence(&mut self) {
        if let Fence::Untried { tries, .. } = &mut self.fence {
            *tries = tries.saturating_add(1);
        }
    }

    /// It did not answer [`Op::Fence`]; true if that may be because it does not support it.
    pub(crate) const fn missed_fence(&mut self) -> bool {
        let Fence::Untried { missed, .. } = &mut self.fence else {
            return false;
        };
        let is_first = !core::mem::replace(missed, true);
        is_first && matches!(self.presence, Presence::Online)
    }

    /// Whether it is still to be tested for [`Op::Fence`].
    pub(crate) const fn tries_fence(&self) -> bool {
        let is_untried = matches!(
            self.fence,
            Fence::Untried {
                tries: ..FENCE_TRIES,
                missed: false
            }
        );
        is_untried && matches!(self.presence, Presence::Online)
    }

    /// Whether, as far as is known, it can give an answer that shows that older requests are done.
    pub(crate) const fn has_fence(&self) -> bool {
        match self.fence {
            Fence::None
            | Fence::Untried {
                tries: FENCE_TRIES..,
                ..
            } => false,
            Fence::Polls | Fence::Untried { .. } | Fence::Known => true,
        }
    }

    /// Whether it has shown that it has a fence.
    pub(crate) const fn knows_fence(&self) -> bool {
        matches!(self.fence, Fence::Polls | Fence::Known)
    }

    /// Whether ghosts are kept until a fence ends them, however long that takes: not for a module
    /// that did not answer one when it was tested and tested again.
    pub(crate) const fn relies_on_fence(&self) -> bool {
        matches!(
            self.fence,
            Fence::Polls
                | Fence::Known
                | Fence::Untried {
                    tries: ..FENCE_DOUBTS,
                    ..
                }
        )
    }

    /// The requests that serve as fence, the best first where nothing is known of the line.
    pub(crate) fn fences(&self, by_polls: bool) -> impl Iterator<Item = Op> + '_ {
        let by_polls = by_polls || self.fence == Fence::Polls;
        let polls = self.polls.iter().map(|poll| poll.op);
        polls
            .filter(move |_| by_polls)
            .chain((!by_polls).then_some(Op::Fence))
    }

    /// Whether this is [`Op::Fence`], if that is this module's fence.
    pub(crate) fn is_fence(&self, exchange: &Exchange<'_>) -> bool {
        !matches!(self.fence, Fence::None | Fence::Polls)
            && self.module.exchange(&Op::Fence).as_ref() == Ok(exchange)
    }

    /// No reply came.
    pub(crate) fn missed(&mut self) {
        self.misses = self.misses.saturating_add(1);
        self.identity.suspect();
        if self.misses == MISSES_SILENT && self.is_online() {
            self.presence = Presence::Silent;
        }
    }

    /// Whether it is only probed, in turn with the other silent modules.
    pub(crate) const fn is_silent(&self) -> bool {
        self.misses >= MISSES_SILENT
    }

    /// What to probe it with: preferably something whose reply can't be another module's.
    pub(crate) fn probe_op(&self) -> Option<Op> {
        let addressed = |op: &Op| match self.module.exchange(op) {
            Ok(Exchange::Ascii(_)) => matches!(op, Op::ReadConfig),
            Ok(_) => true,
            Err(_) => false,
        };
        let polls = self.polls.iter().map(|poll| poll.op);
        polls.chain([Op::ReadConfig]).find(addressed)
    }

    /// Whether it has answered since it came online which outputs give pulses. Until then its
    /// reaction to commands may have changed.
    const fn is_known(&self) -> bool {
        !self.asks_pulses
    }

    /// Whether doing the op twice is certainly the same as doing it once.
    pub(crate) fn repeatable(&self, op: &Op) -> bool {
        let switches_on = bank_of(op).is_some_and(|bank| bank.on != 0);
        self.module.repeatable(op) && (self.is_known() || !switches_on)
    }

    /// Which outputs give pulses, if known.
    pub(crate) fn pulses(&self) -> Option<u32> {
        self.module.pulses().filter(|_| self.is_known())
    }

    /// Whether there is anything left to ask on coming online.
    #[inline]
    pub(crate) fn has_on_online_ops(&self) -> bool {
        (self.asks_pulses || self.identity.is_to_be_asked()) && self.is_online()
    }

    /// What is left to ask on coming online, and from when on.
    pub(crate) fn on_online_ops(&self) -> impl Iterator<Item = (Op, Instant)> + use<> {
        let identity = self.identity.is_to_be_asked();
        let identity = identity.then_some((Op::Identify, self.identity.at()));
        let is_open = self.identity.comes_first() || self.identity.claims_other_model();
        let pulses = self.pulse_question().filter(|_| !is_open);
        let pulses = pulses.map(|op| (op, self.on_online_at));
        identity.into_iter().chain(pulses)
    }

    /// Whether it is to be asked for its model, now or later.
    pub(crate) const fn is_to_be_identified(&self) -> bool {
        self.identity.is_to_be_asked()
    }

    /// Whether it has reported another model: then it is asked for nothing else.
    pub(crate) const fn claims_other_model(&self) -> bool {
        self.identity.claims_other_model()
    }

    /// The request for the outputs that give pulses, if it is still to be asked.
    #[inline]
    pub(crate) const fn pulse_question(&self) -> Option<Op> {
        match self.presence {
            Presence::Online if self.asks_pulses => self.module.on_online_op(),
            _ => None,
        }
    }

    /// It answered which outputs give pulses, or must not be asked on this line.
    pub(crate) const fn answered_pulses(&mut self) {
        self.asks_pulses = false;
    }

    /// When to ask for its model, if that has to come before anything else. Once another model is
    /// confirmed, only if the module is not polled; otherwise its polls ask for it.
    #[inline]
    pub(crate) fn identify_first(&self) -> Option<Instant> {
        let is_first = !self.is_settled() || self.identity.is_other_model() && !self.plan.enabled;
        (is_first && self.is_online()).then_some(self.identity.at())
    }

    /// Whether its model is known as far as it can be.
    pub(crate) const fn is_settled(&self) -> bool {
        !self.identity.comes_first()
    }

    /// Whether it may be another model since an exchange failed, and may be asked now.
    #[inline]
    pub(crate) fn is_suspected(&self, now: Instant) -> bool {
        self.is_online() && self.identity.is_suspected(now)
    }

    /// It reported its model, or refused to.
    pub(crate) fn identified(&mut self, seen: &Observation, now: Instant) {
        let said = match seen {
            Observation::Refused(_) => IdentityReply::Refusal,
            name if self.module.recognises(name) => IdentityReply::Itself,
            name => IdentityReply::Other(*name),
        };
        if !matches!(said, IdentityReply::Itself) {
            self.drop_withheld(now);
        }
        self.identity.said(said, now);
    }

    /// It did not report its model.
    pub(crate) fn not_identified(&mut self, sent: Instant) {
        self.drop_withheld(sent);
        self.identity.lost(sent);
    }

    /// It reported its model after the timeout, which is longer now.
    pub(crate) fn identified_late(&mut self, after: Micros, now: Instant) {
        if after <= TIMEOUT_MAX {
            self.identity.said_late(now);
        }
    }

    /// Drops the withheld reading, which may be another module's, and reads it again.
    fn drop_withheld(&mut self, now: Instant) {
        if self.withheld.take().is_some() {
            for poll in &mut self.polls {
                poll.due = poll.due.min(now);
            }
        }
    }

    /// It must not be asked for its model on this line.
    pub(crate) const fn skip_identity(&mut self) {
        self.identity.settle();
    }

    /// Whether a missing answer to that question says nothing about the module's state: true until
    /// it has answered it.
    pub(crate) const fn may_be_mute(&self) -> bool {
        !self.identity.has_answered()
    }

    /// Whether this is asked on coming online, by a module that may answer neither that nor a
    /// fence.
    pub(crate) fn may_be_mute_to(&self, exchange: &Exchange<'_>) -> bool {
        let is = |op: Op| self.module.exchange(&op).as_ref() == Ok(exchange);
        let is_pulses = || self.asks_pulses && self.module.on_online_op().is_some_and(is);
        !self.knows_fence() && (self.may_be_mute() && self.identifies(exchange) || is_pulses())
    }

    /// Whether this asks for its model.
    pub(crate) fn identifies(&self, exchange: &Exchange<'_>) -> bool {
        self.module.exchange(&Op::Identify).as_ref() == Ok(exchange)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A module that dies often sends one slow reply last; its checks must not get longer for that.
    #[test]
    fn one_slow_reply_is_not_what_a_module_takes() {
        let mut turnaround = Turnaround::default();
        let (usual, slow) = (Micros::from_millis(5), Micros::from_millis(280));
        for _ in 0..10 {
            turnaround.learn(usual);
        }
        turnaround.learn(slow);
        assert_eq!(turnaround.lately, usual);
        // Two in a row are.
        turnaround.learn(slow);
        assert_eq!(turnaround.lately, slow);
        for _ in 0..20 {
            turnaround.learn(usual);
        }
        assert!(turnaround.lately < Micros::from_millis(30));
    }
}
