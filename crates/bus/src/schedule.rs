//! What is sent next: commands first, but no reading becomes too old; silent modules share one
//! twentieth of the time.

use crate::command::{Command, Stage, bank_of, end_commands, touched};
use crate::in_flight::{Job, Probe, write_frame};
use crate::module_state::{ModuleState, TIMEOUT_MIN};
use crate::{Bus, Event, Fault, Last, ModuleId, Probed, State, Terms, Ticket};
use railbus_device::{Bank, Module, Op};
use railbus_wire::{Exchange, Instant, Micros, Protocol, SerialSettings, foreign_command};

/// The longest queue of commands.
pub const COMMANDS_MAX: usize = 64;
/// How long a command waits for its turn before it expires.
const TIME_TO_LIVE: Micros = Micros::from_secs(5);
/// How long a poll at another speed waits for polls at the current one.
const SPEED_PATIENCE: Micros = Micros::from_millis(250);
/// How long after its request a silent module is preempted by a command.
const PREEMPT_AFTER: Micros = Micros::from_millis(60);

/// An exchange that could be sent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Work {
    job: Job,
    exchange: Exchange<'static>,
    settings: SerialSettings,
    gap: Micros,
    timeout: Micros,
    /// It goes before commands.
    urgent: bool,
}

/// The result of looking for work.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Search {
    work: Option<Work>,
    /// When to look again.
    again: Option<Instant>,
}

impl Search {
    pub(crate) fn look_again(&mut self, at: Instant) {
        self.again = Some(self.again.map_or(at, |known| known.min(at)));
    }

    /// The module of what was found.
    pub(crate) fn module(&self) -> Option<ModuleId> {
        self.work.and_then(|work| work.job.module())
    }

    /// Commands wait behind what was found: it ends as if they came once it is sent, but waits so
    /// long at least.
    pub(crate) fn cut_short(&mut self, least: Micros) {
        if let Some(work) = &mut self.work {
            let reply = work.settings.frame_time(work.exchange.response_len_max());
            let short = (PREEMPT_AFTER - reply).max(TIMEOUT_MIN).max(least);
            work.timeout = work.timeout.min(short);
        }
    }
}

impl Bus {
    /// Takes a command. It ends with exactly one [`Event::Done`].
    ///
    /// # Errors
    /// [`Fault::Closed`], [`Fault::Unsupported`], [`Fault::Overloaded`] or [`Fault::OtherModel`]:
    /// it was not taken and nothing was sent.
    pub fn submit(
        &mut self,
        now: Instant,
        module: ModuleId,
        op: Op,
        terms: Terms,
    ) -> Result<Ticket, Fault> {
        self.now = now;
        if matches!(self.state, State::Closed) {
            return Err(Fault::Closed);
        }
        let state = self.modules.get(module.0).filter(|state| !state.retired);
        let state = state.ok_or(Fault::Unsupported)?;
        if state.is_other_model() && state.plan.enabled && op != Op::Identify {
            return Err(Fault::OtherModel { sent: false });
        }
        let first = match bank_of(&op) {
            Some(bank) => Op::Write(state.module.group(bank)),
            None => op,
        };
        let exchange = state
            .module
            .exchange(&first)
            .map_err(|_| Fault::Unsupported)?;
        if self.is_unsafe(&exchange) {
            return Err(Fault::Unsupported);
        }
        if self.commands.len() >= COMMANDS_MAX {
            return Err(Fault::Overloaded);
        }
        let ticket = Ticket(self.next_ticket);
        self.next_ticket += 1;
        let expires = terms.expires.unwrap_or(now + TIME_TO_LIVE);
        self.commands.push_back(Command::new(
            ticket,
            module,
            op,
            terms.verify,
            (now, expires),
        ));
        // It may have expired on its way to this line, and others may have expired by now.
        self.expire_commands();
        self.preempt_silent(module);
        Ok(ticket)
    }

    /// Takes a raw exchange; one at a time. It ends with one [`Event::Probed`]. False when the line
    /// is closed or has one already.
    pub fn submit_probe(&mut self, now: Instant, probe: Probe) -> bool {
        self.now = now;
        if matches!(self.state, State::Closed) || self.probe.is_some() {
            return false;
        }
        self.probe = Some(probe);
        true
    }

    /// Withdraws a probe that was not sent yet, which then gets no result; false if there is none.
    pub const fn withdraw_probe(&mut self) -> bool {
        self.probe.take().is_some()
    }

    /// A request to a silent module is cut short by a command for another one.
    fn preempt_silent(&mut self, wanted: ModuleId) {
        if let State::Waiting(flight) = &mut self.state
            && flight.job.is_status_check()
            && let Some(module) = flight.job.module()
            && module != wanted
            && let Some(state) = self.modules.get(module.0)
            && !state.is_online()
        {
            let serial = state.module.setup().serial;
            let reply = serial.frame_time(flight.exchange.response_len_max());
            let short = PREEMPT_AFTER.max(state.probe_least() + reply);
            let gives_way = self.now.max(flight.sent + short);
            flight.deadline = flight.deadline.min(gives_way);
        }
    }

    /// Starts the next exchange, if its time has come; returns when to look again.
    // Inlined, it would make each `poll` save all registers.
    #[inline(never)]
    pub(crate) fn start_next(&mut self) -> Option<Instant> {
        if self.probe.is_some() && !self.ghosts.is_empty() {
            self.end_held_probe();
        }
        loop {
            let mut search = Search::default();
            self.search(&mut search);
            let Some(work) = &search.work else {
                return search.again;
            };
            let ready = self.ready_at(work);
            if ready > self.now {
                return Some(search.again.map_or(ready, |again| again.min(ready)));
            }
            self.mark(work);
            if !self.is_unsafe_for(&work.job, &work.exchange) {
                self.settings = work.settings;
                return Some(self.start(&work.job, &work.exchange, work.timeout));
            }
            self.refuse(work.job);
        }
    }

    /// Ends what must not be sent on this line.
    fn refuse(&mut self, job: Job) {
        let fault = Fault::Unsupported;
        match job {
            Job::Command { module, op } => {
                let reads_back = bank_of(&op).is_some();
                self.end_sent_commands(module, |command| command.refused(fault, reads_back));
            }
            Job::ReadBack { module } => self.miss_read_back(module),
            Job::Fence { module, .. } => {
                if let Some(state) = self.modules.get_mut(module.0) {
                    state.refused_fence();
                }
            }
            Job::Probe { .. } => {
                let (outcome, after) = (Probed::Unsafe, Micros::ZERO);
                self.events.push(Event::Probed { outcome, after });
            }
            Job::Poll { module, op } | Job::OnOnline { module, op } => {
                if let Job::OnOnline { .. } = job {
                    self.skip_on_online(module, &op);
                }
                self.events.push(Event::Missed { module, op, fault });
            }
        }
    }

    /// When the silence before this exchange will have been long enough.
    fn ready_at(&self, work: &Work) -> Instant {
        if self.at_rest {
            return self.now;
        }
        let chained = self.last.chain && in_chain(&work.exchange);
        let gap = if chained { Micros::ZERO } else { work.gap };
        let gap = if work.settings == self.settings {
            gap
        } else {
            gap.max(work.settings.t3_5() * 2)
                .max(self.settings.t3_5() * 2)
        };
        self.busy_until + gap
    }

    /// Records that this exchange was started.
    fn mark(&mut self, work: &Work) {
        match work.job {
            Job::Command { module, op } => {
                self.mark_sent(module, &op);
                if let (Op::Configure(_), Some(state)) = (op, self.modules.get_mut(module.0)) {
                    state.invalidate();
                }
            }
            Job::Poll { module, op } => {
                if let Some(state) = self.modules.get_mut(module.0) {
                    state.poll_started(&op, self.now);
                    if state.is_silent() {
                        self.next_silent = module.0 + 1;
                    }
                }
            }
            Job::Probe { .. } => {
                if self.probe.take().is_some_and(|probe| probe.changes) {
                    self.invalidate_all();
                }
            }
            Job::Fence { module, .. } => {
                if self.is_silent(module) {
                    self.next_silent = module.0 + 1;
                }
            }
            Job::OnOnline { .. } | Job::ReadBack { .. } => {}
        }
        self.last = Last {
            probe: matches!(work.job, Job::Probe { .. }),
            urgent: work.urgent,
            chain: in_chain(&work.exchange),
        };
    }

    /// A raw frame may change any of the modules: everything known of them is read again.
    #[cold]
    fn invalidate_all(&mut self) {
        for state in self.modules.iter_mut().filter(|state| !state.retired) {
            state.invalidate();
        }
        self.read_all_again();
    }

    /// All polls are due.
    #[cold]
    pub(crate) fn read_all_again(&mut self) {
        for state in &mut self.modules {
            for poll in &mut state.polls {
                poll.due = self.now;
            }
        }
    }

    /// Marks the commands that a frame carries.
    fn mark_sent(&mut self, module: ModuleId, op: &Op) {
        let mut carried = bank_of(op).map(|bank| bank.mask);
        let queued = |c: &&mut Command| c.module == module && c.stage == Stage::Queued;
        for command in self.commands.iter_mut().filter(queued) {
            let carries = match carried {
                Some(mask) => bank_of(&command.op).is_some() && mask & command.left != 0,
                None => command.op == *op,
            };
            if !carries {
                continue;
            }
            command.stage = Stage::Sent;
            command.evidence.attempts = command.evidence.attempts.saturating_add(1);
            match &mut carried {
                Some(mask) => *mask &= !command.left,
                None => return,
            }
        }
    }

    /// What is sent next.
    fn search(&self, search: &mut Search) {
        let found = if self.polls_have_rivals() {
            self.search_by_priority(search)
        } else {
            self.search_polls(search, false)
        };
        debug_assert_eq!(found, search.work.is_some());
    }

    /// Whether anything but polls waits. Among polls alone the most overdue goes first.
    fn polls_have_rivals(&self) -> bool {
        let has_other_reads = |state: &ModuleState| state.is_silent() || state.has_on_online_ops();
        !self.commands.is_empty()
            || self.probe.is_some()
            || self.modules.iter().any(has_other_reads)
    }

    /// What is sent first when several kinds of requests wait. Silent modules come before polls
    /// that can wait, and before commands for others once they have waited for long: a full line
    /// must not keep a module silent.
    const PRIORITIES: [fn(&Bus, &mut Search) -> bool; 7] = [
        Bus::search_overdue_silent,
        Bus::search_urgent_polls,
        Bus::search_commands,
        Bus::search_probe_in_turn,
        Bus::search_silent,
        |bus, search| bus.search_polls(search, false),
        Bus::search_probe,
    ];

    #[inline(never)]
    fn search_by_priority(&self, search: &mut Search) -> bool {
        Bus::PRIORITIES.iter().any(|kind| kind(self, search))
    }

    /// Polls that can't wait any longer. If commands wait, too, they alternate.
    fn search_urgent_polls(&self, search: &mut Search) -> bool {
        (!self.last.urgent || self.commands.is_empty()) && self.search_polls(search, true)
    }

    /// The probe, unless one was sent last: then the others have their turn first.
    fn search_probe_in_turn(&self, search: &mut Search) -> bool {
        !self.last.probe && self.search_probe(search)
    }

    /// Takes the work unless a ghost forbids it now; then the fence that ends the ghost.
    #[inline]
    pub(crate) fn offer(&self, search: &mut Search, work: Work) -> bool {
        if self.ghosts.is_empty() {
            search.work = Some(work);
            return true;
        }
        self.offer_among_ghosts(search, work)
    }

    #[cold]
    fn offer_among_ghosts(&self, search: &mut Search, mut work: Work) -> bool {
        if let Job::OnOnline {
            module,
            op: Op::Identify,
        } = work.job
        {
            self.ask_as_fence(module, &mut work);
        }
        let blocked_until = match work.job {
            Job::Probe {
                addressee: None, ..
            } => self.ghosts.late_until(&work.exchange, self.now),
            // Commands for a silent module do not wait for what it may never answer.
            Job::Command { module, .. } | Job::ReadBack { module } if self.is_silent(module) => {
                self.ghosts.late_until(&work.exchange, self.now)
            }
            Job::Fence { .. } => self.ghosts.fence_blocked_until(&work.exchange),
            _ => self.ghosts.blocked_until(&work.exchange),
        };
        match blocked_until {
            None => {
                search.work = Some(work);
                true
            }
            Some(until) => {
                search.look_again(until);
                self.offer_fence(search, &work)
            }
        }
    }

    /// If a fence asks for the model, ask again at once instead of waiting until nothing is left
    /// that it could be confused with.
    #[cold]
    fn ask_as_fence(&self, module: ModuleId, work: &mut Work) {
        let state = self.modules.get(module.0);
        if state.is_some_and(|state| state.is_fence(&work.exchange))
            && self.ghosts.in_the_way(&work.exchange).is_some()
        {
            let op = Op::Fence;
            work.job = Job::Fence { module, op };
        }
    }

    pub(crate) fn is_silent(&self, module: ModuleId) -> bool {
        self.modules
            .get(module.0)
            .is_some_and(ModuleState::is_silent)
    }

    /// Takes the fence that this work waits for, if there is one.
    #[cold]
    fn offer_fence(&self, search: &mut Search, blocked: &Work) -> bool {
        let (Some(module), false) = (blocked.job.addressee(), self.ghosts.are_full()) else {
            return false;
        };
        if let Job::Fence { .. } = blocked.job {
            return false;
        }
        match self.fence_for(module, &blocked.exchange) {
            Ok(job) => {
                let asked = job.module().and_then(|id| self.modules.get(id.0));
                let timeout = asked.map_or(blocked.timeout, ModuleState::timeout);
                let work = job.module().and_then(|id| self.work(id, job, timeout));
                let until = work.and_then(|work| self.ghosts.fence_blocked_until(&work.exchange));
                if let Some(until) = until {
                    search.look_again(until);
                    return false;
                }
                search.work = work.map(|work| Work {
                    urgent: blocked.urgent,
                    ..work
                });
                search.work.is_some()
            }
            Err(again) => {
                if let Some(again) = again {
                    search.look_again(again);
                }
                false
            }
        }
    }

    #[inline]
    pub(crate) fn work(&self, id: ModuleId, job: Job, timeout: Micros) -> Option<Work> {
        let module = &self.modules.get(id.0)?.module;
        let exchange = module.exchange(&job.op()).ok()?;
        let (settings, gap) = (module.setup().serial, module.setup().request_gap());
        Some(Work {
            job,
            exchange,
            settings,
            gap,
            timeout,
            urgent: false,
        })
    }

    fn search_commands(&self, search: &mut Search) -> bool {
        for (index, command) in self.commands.iter().enumerate() {
            let module = command.module;
            let Some(state) = self.modules.get(module.0) else {
                continue;
            };
            if command.stage != Stage::Sent && state.is_suspected(self.now) {
                let op = Op::Identify;
                let work = self.work(module, Job::OnOnline { module, op }, state.timeout());
                // If it has to wait for something else, the command does not.
                if work.is_some_and(|work| self.offer(search, work)) {
                    return true;
                }
            }
            let job = match command.stage {
                Stage::Sent => continue,
                _ if let Some(at) = state.identify_first() => {
                    if at > self.now {
                        search.look_again(at);
                        continue;
                    }
                    let op = Op::Identify;
                    Job::OnOnline { module, op }
                }
                Stage::ReadBack(_) => match state.pulse_question() {
                    Some(op) if command.asks_pulses => Job::OnOnline { module, op },
                    _ => Job::ReadBack { module },
                },
                Stage::Queued if self.is_barred(index, command) => continue,
                // It is asked later, or ends with the module's next check.
                Stage::Queued
                    if command.op.is_read()
                        && state.is_silent()
                        && self.asked_wait() > Micros::ZERO =>
                {
                    search.look_again(self.now + self.asked_wait());
                    continue;
                }
                Stage::Queued => self.job_of(index, command, state),
            };
            if let Some(work) = self.work(module, job, state.timeout())
                && self.offer(search, work)
            {
                return true;
            }
        }
        false
    }

    /// The exchange that a waiting command needs. Until it is known whether the adapter echoes,
    /// that is a read: the echo of a write can look like its acknowledgement.
    fn job_of(&self, index: usize, command: &Command, state: &ModuleState) -> Job {
        let module = command.module;
        let first_read = state.polls.first().map(|poll| poll.op);
        match (bank_of(&command.op), first_read) {
            (_, Some(op)) if self.rx.echoes().is_none() && !command.op.is_read() => {
                Job::Poll { module, op }
            }
            (Some(bank), _) => {
                let together = self.gather(index, &state.module);
                // A frame that other modules could take for a command is split into smaller ones.
                let is_unsafe = self.mixed
                    && state
                        .module
                        .exchange(&together)
                        .is_ok_and(|exchange| self.is_unsafe(&exchange));
                let alone = || Op::Write(state.module.group(Bank::new(command.left, bank.on)));
                let op = if is_unsafe { alone() } else { together };
                Job::Command { module, op }
            }
            (None, _) => Job::Command {
                module,
                op: command.op,
            },
        }
    }

    /// Whether an earlier command for the same outputs has not ended yet.
    fn is_barred(&self, index: usize, command: &Command) -> bool {
        self.commands.iter().take(index).any(|earlier| {
            earlier.module == command.module && touched(&earlier.op) & touched(&command.op) != 0
        })
    }

    /// One frame for as many waiting writes to the module as fit, this one included.
    fn gather(&self, index: usize, module: &Module) -> Op {
        let mut want = Bank::default();
        let mut wanted_by = None;
        for (at, command) in self.commands.iter().enumerate().skip(index) {
            let same = *wanted_by.get_or_insert(command.module) == command.module;
            if let Some(bank) = bank_of(&command.op)
                && same
                && command.stage == Stage::Queued
                && !self.is_barred(at, command)
            {
                want = Bank::new(want.mask | command.left, want.on | bank.on & command.left);
            }
        }
        Op::Write(module.group(want))
    }

    /// The most overdue read; with `urgent` only those that can't wait any longer.
    fn search_polls(&self, search: &mut Search, urgent: bool) -> bool {
        let mut best = None;
        for (index, state) in self.modules.iter().enumerate() {
            if !state.plan.enabled || state.is_silent() {
                continue;
            }
            let module = ModuleId(index);
            let mut look = |due: Instant, job: Job| {
                if due > self.now {
                    return search.look_again(due);
                }
                let other_speed = state.module.setup().serial != self.settings;
                let handicap = if other_speed {
                    SPEED_PATIENCE
                } else {
                    Micros::ZERO
                };
                let rank = due + handicap;
                if best.is_none_or(|known| rank < known)
                    && let Some(mut work) = self.work(module, job, state.timeout())
                {
                    work.urgent = urgent;
                    if self.offer(search, work) {
                        best = Some(rank);
                    }
                }
            };
            if state.has_on_online_ops() {
                for (op, at) in state.on_online_ops() {
                    if !urgent || op == Op::Identify {
                        look(at, Job::OnOnline { module, op });
                    }
                }
                if state.claims_other_model() {
                    continue;
                }
            }
            if !urgent && state.tries_fence() {
                look(
                    Instant(0),
                    Job::Fence {
                        module,
                        op: Op::Fence,
                    },
                );
            }
            for poll in &state.polls {
                let due = if urgent {
                    state.urgent_at(poll, self.cycle)
                } else {
                    poll.due
                };
                let op = poll.op;
                look(due, Job::Poll { module, op });
            }
        }
        best.is_some()
    }

    fn search_probe(&self, search: &mut Search) -> bool {
        let Some(probe) = self.probe else {
            return false;
        };
        // The echo of a write can look like its acknowledgement: poll first to find out whether the
        // adapter echoes.
        let polled = |state: &ModuleState| state.plan.enabled && !state.is_silent();
        if probe.changes && self.rx.echoes().is_none() && self.modules.iter().any(polled) {
            return false;
        }
        let work = Work {
            job: Job::Probe {
                clear: probe.clear,
                addressee: self.addressee(&probe),
            },
            exchange: probe.exchange,
            settings: probe.settings,
            gap: probe.gap,
            timeout: probe.timeout,
            urgent: false,
        };
        self.offer(search, work)
    }

    /// Whether modules of another protocol on this line could take the frame for a command.
    fn is_unsafe(&self, exchange: &Exchange<'_>) -> bool {
        let (clear, addressee) = (false, None);
        self.is_unsafe_for(&Job::Probe { clear, addressee }, exchange)
    }

    /// The same for the frame as it is sent for a job.
    #[inline]
    pub(crate) fn is_unsafe_for(&self, job: &Job, exchange: &Exchange<'_>) -> bool {
        self.mixed && self.is_foreign_command(job, exchange)
    }

    #[inline(never)]
    fn is_foreign_command(&self, job: &Job, exchange: &Exchange<'_>) -> bool {
        let own = exchange.protocol();
        let mut frame = railbus_wire::Frame::new();
        write_frame(job, exchange, &mut frame);
        let is_spoken = |other: &Protocol| {
            let mut modules = self.modules.iter();
            modules.any(|state| !state.retired && state.module.setup().protocol == *other)
        };
        let others = Protocol::ALL.into_iter().filter(is_spoken);
        foreign_command(frame.bytes(), own, others).is_some()
    }

    /// Ends commands that have timed out.
    #[inline]
    pub(crate) fn expire_commands(&mut self) {
        let now = self.now;
        if self.next_expiry().is_none_or(|at| at > now) {
            return;
        }
        end_commands(&mut self.commands, &mut self.events, now, |command| {
            let is_up = command.time_is_up_at().is_some_and(|at| at <= now);
            is_up.then(|| command.end_by_time())
        });
    }

    /// When the next waiting command times out.
    #[inline]
    pub(crate) fn next_expiry(&self) -> Option<Instant> {
        if self.commands.is_empty() {
            return None;
        }
        self.first_expiry()
    }

    // On its own, because it is asked at each step, mostly while no command waits.
    #[inline(never)]
    fn first_expiry(&self) -> Option<Instant> {
        self.commands
            .iter()
            .filter_map(Command::time_is_up_at)
            .min()
    }
}

/// Whether frames of this kind may follow each other without a gap [R55 §1.6].
const fn in_chain(exchange: &Exchange<'_>) -> bool {
    matches!(exchange, Exchange::R55(_)) && !exchange.expects_reply()
}
