//! What a line knows of each of its modules: how fast it answers, and when to ask it next.

use crate::command::bank_of;
use crate::{Plan, Presence};
use alloc::vec::Vec;
use railbus_device::{Module, Op};
use railbus_wire::{Exchange, Frame, Instant, Micros};

/// How long a module that never answered is waited for, on top of the wire's own time.
const TIMEOUT_UNKNOWN: Micros = Micros::from_millis(300);
/// The shortest and longest that a learned reply timeout becomes.
const TIMEOUT_MIN: Micros = Micros::from_millis(20);
const TIMEOUT_MAX: Micros = Micros::from_millis(300);
/// The least time after which no late reply can arrive any more.
pub const LATE_MIN: Micros = Micros::from_millis(500);
/// After so many misses in a row a module counts as silent and is only probed.
pub const MISSES_SILENT: u8 = 3;
/// What asking a silent module costs in all, gap and wire included: little, so that its turn
/// comes soon again. A reply that comes later is known by its ghost and wakes the module all the
/// same.
const PROBE_KNOWN: Micros = Micros::from_millis(98);
const PROBE_UNHEARD: Micros = Micros::from_millis(290);
/// How long a module takes to answer, where nothing better is known.
const TURNAROUND_GUESS: Micros = Micros::from_millis(10);
/// How many turnarounds make a window of the slowest ones.
const WINDOW: u16 = 1000;

/// A module on the line.
#[derive(Debug)]
pub(crate) struct Node {
    pub(crate) module: Module,
    pub(crate) presence: Presence,
    misses: u8,
    turnaround: Turnaround,
    pub(crate) polls: Vec<Poll>,
    /// Whether the greeting's op was done since the module was last heard anew.
    pub(crate) greeted: bool,
    pub(crate) plan: Plan,
    /// It was taken off the line; only its number is left.
    pub(crate) retired: bool,
}

/// A read of the poll plan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Poll {
    pub(crate) op: Op,
    pub(crate) due: Instant,
    /// When the last good answer was asked for.
    pub(crate) asked: Instant,
}

/// The slowest turnarounds lately: of this window of a thousand and of the one before.
#[derive(Clone, Copy, Debug, Default)]
struct Turnaround {
    now: Micros,
    before: Micros,
    count: u16,
}

impl Turnaround {
    fn learn(&mut self, took: Micros) {
        self.now = self.now.max(took);
        self.count += 1;
        if self.count == WINDOW {
            *self = Turnaround {
                now: Micros::ZERO,
                before: self.now,
                count: 0,
            };
        }
    }

    fn slowest(self) -> Micros {
        self.now.max(self.before)
    }
}

impl Node {
    pub(crate) fn new(module: Module, plan: Plan) -> Node {
        let polls = module
            .full_poll()
            .map(|op| Poll {
                op,
                due: Instant(0),
                asked: Instant(0),
            })
            .collect();
        Node {
            module,
            presence: Presence::Unheard,
            misses: 0,
            turnaround: Turnaround::default(),
            polls,
            greeted: false,
            plan,
            retired: false,
        }
    }

    /// It is not asked any more.
    pub(crate) fn retire(&mut self) {
        self.retired = true;
        self.plan = Plan::NEVER;
        self.polls = Vec::new();
        self.misses = 0;
    }

    /// Spreads the polls over the plan's interval, this module being the `nth` of `count`.
    pub(crate) fn start(&mut self, now: Instant, nth: usize, count: usize) {
        let phase = self.plan.interval.0 / (count.max(1) as u64) * nth as u64;
        for poll in &mut self.polls {
            *poll = Poll {
                due: now + Micros(phase),
                asked: now,
                ..*poll
            };
        }
        self.presence = Presence::Unheard;
        self.misses = 0;
        self.greeted = false;
    }

    /// What reading everything once takes, about.
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

    /// A poll goes out.
    pub(crate) fn poll_started(&mut self, op: &Op, now: Instant) {
        for poll in self.polls.iter_mut().filter(|poll| poll.op == *op) {
            poll.due = now + self.plan.interval;
        }
    }

    /// Something was read, by a poll or for a command.
    pub(crate) fn polled(&mut self, op: &Op, asked: Instant) {
        for poll in self.polls.iter_mut().filter(|poll| poll.op == *op) {
            poll.asked = asked;
            poll.due = poll.due.max(asked + self.plan.interval);
        }
    }

    /// From when on a poll goes before commands, so that no reading becomes too old where
    /// reading everything once takes `cycle`.
    pub(crate) fn urgent_at(&self, poll: &Poll, cycle: Micros) -> Instant {
        let reserve = cycle * 2 + self.timeout();
        poll.due.max(poll.asked + (self.plan.max_age - reserve))
    }

    /// How long to wait for a reply to begin, from the end of the request.
    pub(crate) fn timeout(&self) -> Micros {
        match self.turnaround.slowest() {
            Micros::ZERO => TIMEOUT_UNKNOWN,
            slowest => (slowest * 2).clamp(TIMEOUT_MIN, TIMEOUT_MAX),
        }
    }

    /// The same for a probe of a module that is silent.
    pub(crate) fn probe_timeout(&self, exchange: &Exchange<'_>) -> Micros {
        let setup = self.module.setup();
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        let bytes = frame.bytes().len() + exchange.response_len_max();
        let all = match self.presence {
            Presence::Unheard => PROBE_UNHEARD,
            Presence::Online | Presence::Silent => PROBE_KNOWN,
        };
        let rest = all - setup.serial.frame_time(bytes) - setup.request_gap();
        self.timeout().min(rest.max(TIMEOUT_MIN))
    }

    /// How long after its request a reply may still come.
    pub(crate) fn late_max(&self) -> Micros {
        (self.timeout() * 3).max(LATE_MIN)
    }

    /// A reply came; true when the module was not heard before it.
    pub(crate) fn answered(&mut self, turnaround: Micros) -> bool {
        self.turnaround.learn(turnaround.max(Micros(1)));
        self.misses = 0;
        let news = self.presence != Presence::Online;
        if news {
            self.presence = Presence::Online;
            self.greeted = false;
        }
        news
    }

    /// No reply came; true when the module counts as silent from now on.
    pub(crate) fn missed(&mut self) -> bool {
        self.misses = self.misses.saturating_add(1);
        let falls_silent = self.misses == MISSES_SILENT && self.presence == Presence::Online;
        if falls_silent {
            self.presence = Presence::Silent;
        }
        falls_silent
    }

    /// Whether it is only probed, in turn with the other silent ones.
    pub(crate) const fn is_silent(&self) -> bool {
        self.misses >= MISSES_SILENT
    }

    /// What to probe it with: something whose reply can't be another module's, where there is.
    pub(crate) fn probe_op(&self) -> Option<Op> {
        let addressed = |op: &Op| match self.module.exchange(op) {
            Ok(Exchange::Ascii(_)) => matches!(op, Op::ReadConfig),
            Ok(_) => true,
            Err(_) => false,
        };
        let polls = self.polls.iter().map(|poll| poll.op);
        polls.chain([Op::ReadConfig]).find(addressed)
    }

    /// Whether it was asked what the greeting asks since it was heard anew. Until
    /// then what it does with commands may have changed.
    fn is_known(&self) -> bool {
        self.greeted || self.module.greeting().is_none()
    }

    /// Whether doing the op twice is certainly the same as doing it once.
    pub(crate) fn repeatable(&self, op: &Op) -> bool {
        let switches_on = bank_of(op).is_some_and(|bank| bank.on != 0);
        self.module.repeatable(op) && (self.is_known() || !switches_on)
    }

    /// Which outputs give pulses, where that is known.
    pub(crate) fn pulses(&self) -> Option<u32> {
        self.module.pulses().filter(|_| self.is_known())
    }

    /// The greeting's op, where it is still to be done.
    pub(crate) const fn greeting(&self) -> Option<Op> {
        match self.presence {
            Presence::Online if !self.greeted => self.module.greeting(),
            Presence::Online | Presence::Unheard | Presence::Silent => None,
        }
    }
}
