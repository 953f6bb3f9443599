//! Points, deadlines, turns, safety and commands of a site as one state machine: no lock, no clock,
//! no runtime and no I/O. The driver reports what happened and when ([`Core::handle`]), starts what
//! a caller asks for ([`Core::start`]), carries out what [`Core::poll`] returns, and comes back at
//! [`Core::deadline`]. So everything that may come between two steps can be tried in virtual time,
//! and steps happen in one order only.
//!
//! Work that takes more than one step is a [`context`] procedure.

mod batch;
mod commands;
mod context;
mod disk;
mod exclusive;
mod guard;
mod lease;
mod lines;
mod order;
mod own_pulses;
mod policies;
mod promises;
mod pulse;
mod quality;
mod reload;
mod rules;
mod scene;
mod schedule;
mod state;
mod stream;
#[cfg(test)]
mod tests;
mod timers;
mod turns;
mod within;
mod write;

pub use batch::{BatchDone, BatchTerms, GroupState, Part, PartDone};
pub use commands::{COMMANDS_KEPT, Command};
pub(crate) use context::{Context, Reply, RequestId, Store, TaskId, Tell};
pub use exclusive::LOAN_MAX;
pub(crate) use exclusive::{Exclusive, LoanId};
pub use lease::{LEASE_MAX, LEASE_MIN, LeaseTerms, Leased};
pub(crate) use promises::{Board, Kept, Promise, Why, boards};
pub use pulse::{By, PULSE_MAX, Pulse, PulseDone};
pub use reload::Reloaded;
pub(crate) use rules::RuleNow;
pub(crate) use state::State;
pub use stream::{Batch, News, Picture, PointReading};
pub use within::{WITHIN_MAX, WITHIN_MIN, Within};
pub use write::{ToggleTerms, WriteDone, WriteTerms};

use crate::Config;
use crate::config::Place;
use crate::service::Update;
use context::Procedure;
use railbus_device::Op;
use railbus_host::{LineEvent, ModuleChanges, ModuleId, PortError};
use railbus_store::audit::{End, Note};
use railbus_store::history::Event;
use railbus_wire::Micros;
use schedule::Schedule;
use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::task::Waker;
use std::time::SystemTime;

/// The present time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Now {
    /// Since the start of the site.
    pub(crate) site: Micros,
    /// By the wall clock, which may be set.
    pub(crate) wall: SystemTime,
}

impl Default for Now {
    fn default() -> Now {
        Now {
            site: Micros::ZERO,
            wall: SystemTime::UNIX_EPOCH,
        }
    }
}

/// A line that was opened; reopening it gives another id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct LineId(pub(crate) u64);

/// Where a module is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct At {
    pub(crate) line: LineId,
    pub(crate) module: ModuleId,
}

/// An audit entry whose command is in progress.
#[derive(Clone, Debug)]
pub(crate) struct OpenAuditEntry {
    /// Its number.
    pub(crate) id: String,
    /// The event to report at its end.
    pub(crate) event: Box<Event>,
}

/// What happened.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// Time has passed.
    Time,
    /// A line was opened, and its clock began at this time of the site; or the system refused.
    Opened(&'a str, LineId, Result<Micros, PortError>),
    /// The port of a line that was to be closed is free.
    Closed(LineId),
    /// Something happened on a line, or to it.
    Line(LineId, &'a str, &'a LineEvent),
    /// A request to the driver is done.
    Done(RequestId, Reply),
    /// The scheduled actions are on the disk, or the write failed.
    Kept(Result<(), ErrorKind>),
}

/// What the driver has to do.
#[derive(Debug)]
pub(crate) enum Output {
    /// An op with a module. [`Reply::Ran`] says how it ended.
    Run {
        /// Returned in the reply.
        request: RequestId,
        /// The line and the module there.
        at: At,
        /// The operation.
        op: Op,
        /// Read outputs back.
        verify: bool,
        /// After this time of the site it is no longer sent.
        expires: Micros,
    },
    /// Write an audit entry before acting. [`Reply::Begun`] says whether the command may go on.
    Begin {
        /// Returned in the reply.
        request: RequestId,
        /// The module.
        module: String,
        /// The label of the output, if it is about one.
        label: Option<String>,
        /// Caller and command.
        note: Note,
        /// The known states of the outputs.
        before: String,
    },
    /// Write the end of a command, behind all entries before it.
    End {
        /// Names it in [`Output::Answer`].
        request: RequestId,
        /// The entry that has ended.
        begun: OpenAuditEntry,
        /// The end.
        end: End,
        /// The known states of the outputs.
        after: String,
    },
    /// Answer a caller once an end is written, or can't be in time.
    Answer {
        /// The [`Output::End`].
        after: RequestId,
        /// Does it.
        tell: Tell,
    },
    /// Write the scheduled actions: [`Input::Kept`]. There is one such write at a time.
    Keep(Vec<Kept>),
    /// Open a line as this configuration has it: [`Input::Opened`].
    Open {
        /// Its name.
        line: String,
        /// Its number from now on.
        id: LineId,
        /// The configuration.
        config: Arc<Config>,
    },
    /// Close a line: [`Input::Closed`] once its port is free. Commands in progress end first.
    Close(LineId),
    /// Modules leave a line and join it: [`Reply::Changed`].
    Change {
        /// Returned in the reply.
        request: RequestId,
        /// The line.
        line: LineId,
        /// The modules.
        change: ModuleChanges,
    },
    /// Write a configuration: [`Reply::Stored`].
    Store {
        /// Returned in the reply.
        request: RequestId,
        /// Writes it.
        store: Store,
    },
    /// Report an event.
    Event(Box<Event>),
    /// Notify subscribers at once.
    Publish(Update),
    /// Notify followers of the stream; if there are none, [`Core::is_not_followed`].
    News(News),
}

/// A suspended procedure.
struct Task {
    procedure: Procedure,
    /// When it has to be polled at the latest.
    deadline: Option<Micros>,
}

/// The state machine of a site.
pub(crate) struct Core {
    state: Box<State>,
    context: Context,
    tasks: BTreeMap<TaskId, Task>,
    deadlines: BTreeSet<(Micros, TaskId)>,
}

impl std::fmt::Debug for Core {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Core")
            .field("state", &self.state)
            .field("tasks", &self.tasks.len())
            .finish_non_exhaustive()
    }
}

impl Drop for Core {
    /// Dropped procedures release what they hold.
    fn drop(&mut self) {
        let _lent = self.context.lend(&mut self.state);
        self.tasks.clear();
    }
}

impl Core {
    /// A site of which nothing is known yet but its scheduled actions. Its lines are opened by
    /// [`State::line_opens`] and [`Input::Opened`].
    pub(crate) fn new(now: Now, config: Config, polls: bool, kept: Vec<Kept>) -> Core {
        let boards = boards(&config);
        let mut state = Box::new(State::new(config, polls));
        state.now = now;
        state.schedule = Schedule::new(kept, boards, now);
        Core {
            state,
            context: Context::default(),
            tasks: BTreeMap::new(),
            deadlines: BTreeSet::new(),
        }
    }

    /// Resumes scheduled actions, once the lines are open or being opened.
    pub(crate) fn take_up(&mut self, now: Now) {
        self.step(now, |context| context.take_up());
    }

    /// Handles an input.
    pub(crate) fn handle(&mut self, now: Now, input: Input<'_>) {
        match input {
            Input::Time => {}
            Input::Opened(line, id, opened) => self.state.line_opened(line, id, opened),
            Input::Closed(line) => self.state.line_closed(line),
            Input::Line(id, line, event) => {
                self.state.now = now;
                self.state.observe(id, line, event);
                return self.step(now, observed);
            }
            Input::Done(request, reply) => self.state.runs.answer(request, reply),
            Input::Kept(end) => self.state.schedule.written(end, now.site),
        }
        self.step(now, |_| {});
    }

    /// Starts a procedure; `end` gets its result, in this step or by [`Output::Answer`]. It runs to
    /// its end even if the caller goes away.
    pub(crate) fn start<T, F>(
        &mut self,
        now: Now,
        procedure: impl FnOnce(Context) -> F,
        end: impl FnOnce(T) + Send + 'static,
    ) -> TaskId
    where
        T: Send + 'static,
        F: Future<Output = T> + Send + 'static,
    {
        self.step(now, |context| {
            let procedure = procedure(context.clone());
            let answers = context.clone();
            context.spawn(async move {
                let value = procedure.await;
                answers.answer(move || end(value));
            })
        })
    }

    /// Changes the state from outside, as one step.
    pub(crate) fn change<T>(&mut self, now: Now, change: impl FnOnce(&mut State) -> T) -> T {
        self.step(now, |context| context.with(change))
    }

    /// Cancels a procedure, unless it has ended.
    pub(crate) fn cancel(&mut self, now: Now, task: TaskId) {
        let gone = self.tasks.remove(&task);
        self.step(now, |context| {
            drop(gone);
            context.with(|state| state.runs.has_gone(task));
        });
    }

    /// The next thing to do, if any.
    pub(crate) fn poll(&mut self) -> Option<Output> {
        self.state.runs.outputs.pop_front()
    }

    /// When [`Input::Time`] has to be reported at the latest, in the time of the site.
    pub(crate) fn deadline(&self) -> Option<Micros> {
        let task = self.deadlines.first().map(|(at, _)| *at);
        let disk = self.state.schedule.writes_again_at();
        let quality = self.state.qualities.deadline();
        let stream = self.state.stream.deadline();
        let rules = self.state.rules_deadline();
        let all = [task, disk, quality, stream, rules];
        all.into_iter().flatten().min()
    }

    /// Whether anything is in progress.
    pub(crate) fn is_busy(&self) -> bool {
        !self.tasks.is_empty()
    }

    /// The whole state, as of this time.
    pub(crate) fn state(&mut self, now: Now) -> &mut State {
        self.state.now = now;
        &mut self.state
    }

    /// A snapshot for a new follower of the stream. Changes up to the next step are included.
    pub(crate) fn follow(&mut self, now: Now) -> Arc<Picture> {
        self.step(now, |_| {});
        self.state.begin_to_follow()
    }

    /// The stream has no followers any more.
    pub(crate) fn is_not_followed(&mut self) {
        self.state.stream.end();
    }

    /// Sends pending updates of the stream.
    pub(crate) fn finish_stream(&mut self, now: Now) {
        self.step(now, |_| {});
        self.state.stream_rest();
    }

    /// A recent command.
    pub(crate) fn command(&self, id: &str) -> Option<&Command> {
        self.state.commands.find(id)
    }

    fn step<T>(&mut self, now: Now, step: impl FnOnce(&Context) -> T) -> T {
        self.state.now = now;
        let result = {
            let _lent = self.context.lend(&mut self.state);
            step(&self.context)
        };
        while let Some((at, task)) = self.deadlines.first().copied()
            && at <= now.site
        {
            self.deadlines.pop_first();
            self.state.runs.wake(task);
        }
        self.run();
        self.state.settle();
        // What an act does in this step may concern other rules. None acts twice in a step.
        while self.fire_rules() {
            self.run();
            self.state.settle();
        }
        self.state.stream_out();
        result
    }

    /// Begins the actions of the rules that act now; says whether there are any.
    fn fire_rules(&mut self) -> bool {
        let firings = self.state.rules_due();
        let is_any = !firings.is_empty();
        for firing in firings {
            let acts = self.context.clone().act(firing);
            self.state.runs.add(Box::pin(acts));
        }
        is_any
    }

    /// Polls all procedures that can go on, in the order in which they became ready, until none
    /// can.
    fn run(&mut self) {
        loop {
            let state = &mut self.state;
            let woken = std::mem::take(&mut state.turns.woken);
            let woken = woken
                .into_iter()
                .chain(std::mem::take(&mut state.schedule.woken));
            for task in woken {
                state.runs.wake(task);
            }
            for (number, procedure) in std::mem::take(&mut state.runs.spawned) {
                let deadline = None;
                let task = Task {
                    procedure,
                    deadline,
                };
                self.tasks.insert(number, task);
                state.runs.wake(number);
            }
            if let Some(task) = state.runs.ready.pop_front() {
                self.poll_task(task);
            } else if let Some(promises) = state.schedule.next_write(state.now) {
                state.runs.outputs.push_back(Output::Keep(promises));
            } else {
                return;
            }
        }
    }

    fn poll_task(&mut self, number: TaskId) {
        let Some(mut task) = self.tasks.remove(&number) else {
            return;
        };
        if let Some(deadline) = task.deadline.take() {
            self.deadlines.remove(&(deadline, number));
        }
        self.state.runs.current = number;
        self.state.runs.deadline = None;
        let waits = {
            let _lent = self.context.lend(&mut self.state);
            let poll = || {
                let mut noop = std::task::Context::from_waker(Waker::noop());
                task.procedure.as_mut().poll(&mut noop).is_pending()
            };
            // A procedure that panics, which standard error reports, does not affect others. What
            // it holds is released while the state is lent.
            let waits = catch_unwind(AssertUnwindSafe(poll)).unwrap_or(false);
            waits.then_some(task)
        };
        let Some(mut task) = waits else {
            return self.state.runs.has_gone(number);
        };
        task.deadline = self.state.runs.deadline.take();
        if let Some(deadline) = task.deadline {
            self.deadlines.insert((deadline, number));
        }
        self.tasks.insert(number, task);
    }
}

/// After an event: starts or ends scheduled actions of outputs that it has shown in another state,
/// and applies the policies of modules that answer again.
fn observed(context: &Context) {
    let (changed, returned) = context.with(|state| {
        let changed = std::mem::take(&mut state.changed);
        (changed, std::mem::take(&mut state.returned))
    });
    for change in changed {
        context.watch_on(&change);
        let place = Place::new(&change.module, change.point);
        context.with(|state| state.keep_off_of([&place]));
    }
    for module in returned {
        context.spawn(context.clone().returned(module));
    }
}
