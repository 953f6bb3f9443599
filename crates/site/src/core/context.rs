//! Procedures: what takes more than one step is an `async fn` without a runtime
//! (docs/decisions/0005, 0033). The core polls them one at a time; what a procedure does between
//! two awaits, nothing else comes between.

use super::state::State;
use super::{LineId, OpenAuditEntry, Output};
use crate::CommandError;
use crate::config::Config;
use crate::service::lock;
use railbus_device::Op;
use railbus_host::{Done, Fault, ModuleChanges};
use railbus_store::audit::{End, Note};
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::Poll;

/// A procedure under way.
pub(super) type Procedure = Pin<Box<dyn Future<Output = ()> + Send>>;
/// A number of a procedure, never given twice.
pub(crate) type TaskId = u64;

/// What asked for something outside; the reply carries it back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct RequestId(pub(crate) u64);

/// What was asked for outside the core, done.
#[derive(Debug)]
pub(crate) enum Reply {
    /// The line has ended an op.
    Ran(Result<Done, Fault>),
    /// What is about to be done is written down, or may not be done.
    Begun(Result<OpenAuditEntry, CommandError>),
    /// A line has taken its new modules.
    Changed,
    /// Whether a configuration was written.
    Stored(bool),
}

/// Writes a configuration that is about to come into force; says whether that succeeded.
pub(crate) struct Store(pub(crate) Pin<Box<dyn Future<Output = bool> + Send>>);

impl std::fmt::Debug for Store {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Store")
    }
}

/// Tells a caller how its procedure ended.
pub(crate) struct Tell(pub(crate) Box<dyn FnOnce() + Send>);

impl std::fmt::Debug for Tell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Tell")
    }
}

/// The procedures' part of the state: who is to be polled, and what goes out.
#[derive(Default)]
pub(super) struct Runs {
    /// The procedure that is being polled.
    pub(super) current: TaskId,
    /// The earliest deadline that it has named in this poll.
    pub(super) deadline: Option<Micros>,
    pub(super) ready: VecDeque<TaskId>,
    pub(super) spawned: Vec<(TaskId, Procedure)>,
    pub(super) outputs: VecDeque<Output>,
    newest_task: TaskId,
    newest_request: u64,
    pending: BTreeMap<RequestId, Pending>,
    /// The newest end of a command that each procedure has had written down.
    ends: BTreeMap<TaskId, RequestId>,
    /// The newest of all.
    newest_end: Option<RequestId>,
}

/// A request whose reply has not come yet, or was not taken yet.
#[derive(Debug)]
struct Pending {
    task: TaskId,
    reply: Option<Reply>,
}

impl std::fmt::Debug for Runs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Runs")
            .field("ready", &self.ready)
            .field("pending", &self.pending)
            .finish_non_exhaustive()
    }
}

impl Runs {
    pub(super) fn add(&mut self, procedure: Procedure) -> TaskId {
        self.newest_task += 1;
        self.spawned.push((self.newest_task, procedure));
        self.newest_task
    }

    pub(super) fn wake(&mut self, task: TaskId) {
        if !self.ready.contains(&task) {
            self.ready.push_back(task);
        }
    }

    pub(super) fn answer(&mut self, request: RequestId, reply: Reply) {
        // Who asked may not wait any more.
        if let Some(pending) = self.pending.get_mut(&request) {
            pending.reply = Some(reply);
            let task = pending.task;
            self.wake(task);
        }
    }

    /// A procedure is no more.
    pub(super) fn has_gone(&mut self, task: TaskId) {
        self.ends.remove(&task);
    }

    /// Whoever waits for the current procedure is answered once this end is written down, too.
    fn answers_behind(&mut self, task: TaskId, end: RequestId) {
        let newest = self.ends.entry(task).or_insert(end);
        *newest = end.max(*newest);
    }

    fn next_request(&mut self) -> RequestId {
        self.newest_request += 1;
        RequestId(self.newest_request)
    }

    #[cfg(test)]
    pub(super) fn nothing_is_pending(&self) -> bool {
        self.pending.is_empty() && self.ends.is_empty()
    }

    /// The current procedure is to be polled at this time of the site at the latest.
    fn wakes_at(&mut self, at: Micros) {
        self.deadline = Some(self.deadline.map_or(at, |deadline| deadline.min(at)));
    }
}

/// What a procedure sees of the core. It is only ever used while the core polls the procedure,
/// which lends it the state for as long: the lock is never waited for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Context(Arc<Mutex<Box<State>>>);

/// The state is with the procedures until this is dropped.
pub(super) struct Lent<'a> {
    state: &'a mut Box<State>,
    context: &'a Context,
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        std::mem::swap(self.state, &mut lock(&self.context.0));
    }
}

impl Context {
    /// Lends the state to the procedures, which are polled or dropped meanwhile.
    pub(super) fn lend<'a>(&'a self, state: &'a mut Box<State>) -> Lent<'a> {
        std::mem::swap(state, &mut lock(&self.0));
        Lent {
            state,
            context: self,
        }
    }

    /// Reads or changes the state, as one step.
    pub(crate) fn with<T>(&self, step: impl FnOnce(&mut State) -> T) -> T {
        step(&mut lock(&self.0))
    }

    /// The configuration in force.
    pub(crate) fn config(&self) -> Arc<Config> {
        self.with(|state| Arc::clone(state.site.config()))
    }

    /// The time of the site.
    pub(super) fn now(&self) -> Micros {
        self.with(|state| state.now.site)
    }

    /// Begins another procedure. It goes on whatever becomes of this one.
    pub(super) fn spawn(&self, procedure: impl Future<Output = ()> + Send + 'static) -> TaskId {
        self.with(|state| state.runs.add(Box::pin(procedure)))
    }

    /// The same of one whose end this procedure can wait for.
    pub(super) fn begin<T, F>(&self, procedure: F) -> impl Future<Output = T> + Send + use<T, F>
    where
        T: Send + 'static,
        F: Future<Output = T> + Send + 'static,
    {
        let parent = self.with(|state| state.runs.current);
        let (end, ended) = (Arc::new(Mutex::new(None)), Context::clone(self));
        let told = Arc::clone(&end);
        self.spawn(async move {
            *lock(&told) = Some(procedure.await);
            ended.with(|state| {
                let runs = &mut state.runs;
                // Without a caller that waits, the parent may be gone.
                let is_awaited = Arc::strong_count(&told) > 1;
                let behind = runs.ends.remove(&runs.current).filter(|_| is_awaited);
                if let Some(end) = behind {
                    runs.answers_behind(parent, end);
                }
                runs.wake(parent);
            });
        });
        poll_fn(move |_| match lock(&end).take() {
            Some(end) => Poll::Ready(end),
            None => Poll::Pending,
        })
    }

    /// Waits until `ready` has something. It is asked whenever the procedure is woken: who makes
    /// it so calls [`Runs::wake`], or a deadline was named.
    pub(super) async fn wait<T>(&self, mut ready: impl FnMut(&mut State) -> Option<T>) -> T {
        poll_fn(|_| match self.with(&mut ready) {
            Some(value) => Poll::Ready(value),
            None => Poll::Pending,
        })
        .await
    }

    /// Waits until something is so. Whoever may make it so wakes those who stand in this list.
    pub(super) async fn wait_in(
        &self,
        list: fn(&mut State) -> &mut BTreeSet<TaskId>,
        mut is_so: impl FnMut(&mut State) -> bool,
    ) {
        let task = self.with(|state| state.runs.current);
        let stands = Listed {
            context: self.clone(),
            list,
            task,
        };
        self.wait(|state| {
            let is_so = is_so(state);
            if !is_so {
                (stands.list)(state).insert(task);
            }
            is_so.then_some(())
        })
        .await;
    }

    /// Waits for something until this time of the site, and drops it then.
    pub(super) async fn until<T>(&self, at: Micros, what: impl Future<Output = T>) -> Option<T> {
        let mut what = std::pin::pin!(what);
        poll_fn(|cx| match what.as_mut().poll(cx) {
            Poll::Ready(value) => Poll::Ready(Some(value)),
            Poll::Pending if self.with(|state| state.is_past(at)) => Poll::Ready(None),
            Poll::Pending => Poll::Pending,
        })
        .await
    }

    /// Does several things side by side, to the end of the last.
    pub(super) async fn all<T>(&self, each: impl IntoIterator<Item: Future<Output = T>>) -> Vec<T> {
        let mut each: Vec<_> = each
            .into_iter()
            .map(|future| (Box::pin(future), None))
            .collect();
        poll_fn(|cx| {
            for (future, end) in each.iter_mut().filter(|(_, end)| end.is_none()) {
                if let Poll::Ready(value) = future.as_mut().poll(cx) {
                    *end = Some(value);
                }
            }
            match each.iter().all(|(_, end)| end.is_some()) {
                true => Poll::Ready(()),
                false => Poll::Pending,
            }
        })
        .await;
        each.into_iter().filter_map(|(_, end)| end).collect()
    }

    async fn ask(&self, output: impl FnOnce(RequestId) -> Output) -> Option<Reply> {
        let asked = self.with(|state| {
            let runs = &mut state.runs;
            let request = runs.next_request();
            let pending = Pending {
                task: runs.current,
                reply: None,
            };
            runs.pending.insert(request, pending);
            runs.outputs.push_back(output(request));
            request
        });
        let asked = Asked(self.clone(), asked);
        self.wait(|state| state.runs.pending.get_mut(&asked.1)?.reply.take())
            .await
            .into()
    }

    /// Does an op with a module at its place on its line, where that is open.
    pub(super) async fn run_at(
        &self,
        at: super::At,
        op: Op,
        verify: bool,
        expires: Micros,
    ) -> Result<Done, Fault> {
        let run = |request| Output::Run {
            request,
            at,
            op,
            verify,
            expires,
        };
        match self.ask(run).await {
            Some(Reply::Ran(end)) => end,
            _ => Err(Fault::Unknown),
        }
    }

    /// Writes down what is about to be done. It is durable when this returns.
    pub(crate) async fn journal(
        &self,
        module: String,
        label: Option<String>,
        note: Note,
        before: String,
    ) -> Result<OpenAuditEntry, CommandError> {
        let begin = |request| Output::Begin {
            request,
            module,
            label,
            note,
            before,
        };
        match self.ask(begin).await {
            Some(Reply::Begun(begun)) => begun,
            _ => Err(CommandError::NotAudited),
        }
    }

    /// Modules leave a line and join it.
    pub(super) async fn change_modules(&self, line: LineId, change: ModuleChanges) {
        let change = |request| Output::Change {
            request,
            line,
            change,
        };
        let _ = self.ask(change).await;
    }

    /// Has a configuration written; says whether that succeeded.
    pub(super) async fn store(&self, store: Store) -> bool {
        let stored = self.ask(|request| Output::Store { request, store }).await;
        matches!(stored, Some(Reply::Stored(true)))
    }

    /// Has it written down how it ended. This does not wait for that: whoever waits for this
    /// procedure does, see [`Context::answer`].
    pub(crate) fn journal_end(&self, begun: OpenAuditEntry, end: End, after: String) {
        self.with(|state| {
            let runs = &mut state.runs;
            let request = runs.next_request();
            runs.newest_end = Some(request);
            runs.answers_behind(runs.current, request);
            runs.outputs.push_back(Output::End {
                request,
                begun,
                end,
                after,
            });
        });
    }

    /// Whoever waits for this procedure waits for all ends that are being written down, whoever
    /// had that done.
    pub(super) fn answer_behind_all(&self) {
        self.with(|state| {
            let runs = &mut state.runs;
            if let Some(newest) = runs.newest_end {
                runs.answers_behind(runs.current, newest);
            }
        });
    }

    /// Tells whoever waits for this procedure that it has ended: at once, or behind the end of its
    /// last command.
    pub(super) fn answer(&self, tell: impl FnOnce() + Send + 'static) {
        let after = self.with(|state| state.runs.ends.remove(&state.runs.current));
        match after {
            None => tell(),
            Some(after) => self.with(|state| {
                let tell = Tell(Box::new(tell));
                state.runs.outputs.push_back(Output::Answer { after, tell });
            }),
        }
    }
}

impl State {
    /// Whether this time of the site has come; if not, the current procedure is polled then.
    pub(super) fn is_past(&mut self, at: Micros) -> bool {
        let is_past = self.now.site >= at;
        if !is_past {
            self.runs.wakes_at(at);
        }
        is_past
    }
}

/// Somebody may stand in a list, until this is dropped.
struct Listed {
    context: Context,
    list: fn(&mut State) -> &mut BTreeSet<TaskId>,
    task: TaskId,
}

impl Drop for Listed {
    fn drop(&mut self) {
        self.context
            .with(|state| (self.list)(state).remove(&self.task));
    }
}

/// A request that is waited for, until this is dropped.
struct Asked(Context, RequestId);

impl Drop for Asked {
    fn drop(&mut self) {
        self.0.with(|state| state.runs.pending.remove(&self.1));
    }
}
