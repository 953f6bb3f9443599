//! The core's driver: one lock, the clock, and what does what the core says.

use super::{Driven, Inner, lock, prepare, promise_file};
use crate::core::{Core, Input, LineId, Now, Output, Reply, RequestId, State};
use railbus_host::{Fault, Line, LineConfig, LineEvent, PortError, RunId, Terms};
use railbus_store::audit::Waiting;
use railbus_wire::{Instant, Micros};
use std::sync::{Arc, Weak};
use std::time::{Duration, SystemTime};
use tokio::sync::Notify;

/// Tells the core of the time when it wants that.
pub(super) async fn tell_time(site: Weak<Inner>, alarm: Arc<Notify>) {
    let _goes = Goes(Weak::clone(&site));
    let mut next = None;
    loop {
        tokio::select! {
            () = alarm.notified() => {}
            () = sleep_until(next) => {}
        }
        let Some(inner) = site.upgrade() else {
            return;
        };
        inner.count("of time");
        inner.drive(|core, now| core.handle(now, Input::Time));
        let overdue = lock(&inner.driven).waits.overdue(inner.now().site);
        overdue.iter().for_each(Waiting::give_up);
        let mut driven = lock(&inner.driven);
        driven.alarm_at = driven.deadline();
        next = driven
            .alarm_at
            .map(|at| inner.start + Duration::from_micros(at.0));
    }
}

/// If nothing reports the time any more, because the runtime shuts down, nothing in progress keeps
/// the site alive.
struct Goes(Weak<Inner>);

impl Drop for Goes {
    fn drop(&mut self) {
        if let Some(inner) = self.0.upgrade() {
            let site = lock(&inner.driven).site.take();
            drop(site);
        }
    }
}

async fn sleep_until(at: Option<tokio::time::Instant>) {
    match at {
        Some(at) => tokio::time::sleep_until(at).await,
        None => std::future::pending().await,
    }
}

/// What an event of a line is to the core.
fn input<'a>(id: LineId, line: &'a str, event: &'a LineEvent) -> Input<'a> {
    match event {
        LineEvent::Ended(run, end) => Input::Done(RequestId(run.0), Reply::Ran(*end)),
        event => Input::Line(id, line, event),
    }
}

impl Driven {
    /// When the core has to be told of the time, or somebody has waited for the audit log long
    /// enough.
    fn deadline(&mut self) -> Option<Micros> {
        let times = [self.core.deadline(), self.waits.deadline()];
        times.into_iter().flatten().min()
    }
}

impl Inner {
    /// The line's handle, where it is open.
    pub(super) fn handle(&self, line: &str) -> Option<Line> {
        let mut driven = lock(&self.driven);
        let id = driven.core.state(self.now()).lines.get(line)?.open()?;
        driven.lines.get(&id).cloned()
    }

    /// Opens a line whose events the core handles before anyone else. Gives back when its clock
    /// began, in the time of the site.
    pub(super) fn open(
        self: &Arc<Inner>,
        driven: &mut Driven,
        (name, id): (&str, LineId),
        mut config: LineConfig,
    ) -> Result<Micros, PortError> {
        let (inner, line) = (Arc::downgrade(self), name.to_owned());
        config.observer = Some(Box::new(move |events| {
            // The task outlives the site only while it closes its port.
            let Some(inner) = inner.upgrade() else {
                return;
            };
            inner.count("of lines");
            // With one lock: a command ends with the reading it rests on.
            inner.drive(|core, now| {
                for event in events {
                    core.handle(now, input(id, &line, event));
                }
            });
        }));
        let _entered = self.runtime.enter();
        let opened = Line::open(config)?;
        // In this order: a reading never seems newer than it is.
        let began = self.now().site - opened.now().since(Instant(0));
        driven.lines.insert(id, opened);
        Ok(began)
    }

    pub(super) fn now(&self) -> Now {
        let passed = self.start.elapsed().as_micros();
        Now {
            site: Micros(u64::try_from(passed).unwrap_or(u64::MAX)),
            wall: SystemTime::now(),
        }
    }

    /// Looks at what is known.
    pub(super) fn read<T>(&self, look: impl FnOnce(&mut State) -> T) -> T {
        look(lock(&self.driven).core.state(self.now()))
    }

    /// Changes what is known, as one step.
    pub(super) fn change<T>(self: &Arc<Inner>, change: impl FnOnce(&mut State) -> T) -> T {
        self.drive(|core, now| core.change(now, change))
    }

    /// Lets the core take a step, and does what it says.
    pub(super) fn drive<T>(self: &Arc<Inner>, step: impl FnOnce(&mut Core, Now) -> T) -> T {
        self.count("steps");
        let mut driven = lock(&self.driven);
        let result = step(&mut driven.core, self.now());
        while let Some(output) = driven.core.poll() {
            self.carry_out(&mut driven, output);
        }
        let next = driven.deadline();
        if let Some(at) = next
            && driven.alarm_at.is_none_or(|alarm_at| at < alarm_at)
        {
            driven.alarm_at = next;
            self.alarm.notify_one();
        }
        driven.site = driven.core.is_busy().then(|| Arc::clone(self));
        result
    }

    /// Begins what the core says; nothing here waits.
    fn carry_out(self: &Arc<Inner>, driven: &mut Driven, output: Output) {
        let inner = Arc::clone(self);
        match output {
            // Fails if there are no subscribers, which does not matter.
            Output::Publish(update) => _ = self.updates.send(update),
            Output::News(news) => {
                if self.news.send(news).is_err() {
                    driven.core.is_not_followed();
                }
            }
            Output::Run {
                request,
                at,
                op,
                verify,
                expires,
            } => {
                let Some(line) = driven.lines.get(&at.line).cloned() else {
                    let closed = Reply::Ran(Err(Fault::Closed));
                    let input = Input::Done(request, closed);
                    return driven.core.handle(self.now(), input);
                };
                let left = expires - self.now().site;
                let expires = Some(line.now() + left);
                let terms = Terms { verify, expires };
                let run = RunId(request.0);
                if let Err(fault) = line.submit(run, at.module, op, terms) {
                    let input = Input::Done(request, Reply::Ran(Err(fault)));
                    driven.core.handle(self.now(), input);
                }
            }
            Output::Begin {
                request,
                module,
                label,
                note,
                before,
            } => self.begin(driven, request, (module, label), (note, before)),
            Output::End {
                request,
                begun,
                end,
                after,
            } => self.end(driven, request, begun, (end, after)),
            Output::Answer { after, tell } => Inner::answer(driven, after, tell),
            Output::Open { line, id, config } => {
                // A configuration that was read has no line that can't be.
                let prepared = prepare(&config, &line, self.polls).map_err(|_| PortError::Refused);
                let opened = prepared.and_then(|config| self.open(driven, (&line, id), config));
                let input = Input::Opened(&line, id, opened);
                driven.core.handle(self.now(), input);
            }
            Output::Close(id) => self.close(driven.lines.remove(&id), id),
            Output::Change {
                request,
                line,
                change,
            } => {
                let line = driven.lines.get(&line).cloned();
                self.runtime.spawn(async move {
                    if let Some(line) = line {
                        // Fails where the whole site is being closed.
                        let _ = line.change(change).await;
                    }
                    inner.done(request, Reply::Changed);
                });
            }
            Output::Store { request, store } => {
                self.runtime.spawn(async move {
                    let stored = store.0.await;
                    inner.done(request, Reply::Stored(stored));
                });
            }
            Output::Event(event) => self.tell_event(*event),
            Output::Keep(promises) => match self.folder.clone() {
                None => driven.core.handle(self.now(), Input::Kept(Ok(()))),
                Some(folder) => {
                    _ = self.runtime.spawn(async move {
                        let write = move || promise_file::write(&folder, &promises);
                        let end = tokio::task::spawn_blocking(write).await;
                        let end = end.unwrap_or_else(|why| Err(std::io::Error::other(why)));
                        let end = end.map_err(|why| why.kind());
                        inner.drive(|core, now| core.handle(now, Input::Kept(end)));
                    })
                }
            },
        }
    }

    /// Closes the port of a line, whose commands in progress get a second to end.
    fn close(self: &Arc<Inner>, line: Option<Line>, id: LineId) {
        let inner = Arc::clone(self);
        self.runtime.spawn(async move {
            if let Some(line) = line {
                line.close().await;
            }
            inner.drive(|core, now| core.handle(now, Input::Closed(id)));
        });
    }

    /// Counts what a command costs, for the tests.
    #[cfg(test)]
    fn count(&self, what: &'static str) {
        *lock(&self.counts).entry(what).or_default() += 1;
    }

    #[cfg(not(test))]
    #[allow(clippy::unused_self)]
    const fn count(&self, _what: &'static str) {}

    fn done(self: &Arc<Inner>, request: RequestId, reply: Reply) {
        self.drive(|core, now| core.handle(now, Input::Done(request, reply)));
    }
}

#[cfg(test)]
#[path = "../../tests/service/board.rs"]
#[allow(dead_code)]
mod board;

#[cfg(test)]
mod tests {
    use super::super::Service;
    use super::*;
    use crate::{Config, WriteTerms};
    use railbus_store::audit::AuditLog;

    /// A write with its read-back: the steps of the core, each with one lock, but for those that
    /// the events of its line take anyway; and the tasks that wait for something meanwhile.
    async fn cost_of_a_write(service: &Service) -> (usize, usize) {
        let cost = || {
            let counts = lock(&service.inner.counts);
            let of = |what| counts.get(what).copied().unwrap_or_default();
            (of("steps") - of("of lines") - of("of time"), of("tasks"))
        };
        let before = cost();
        let set = [(board::k(1), true)];
        let done = service.write("oven", &set, WriteTerms::default()).await;
        assert!(done.is_ok(), "{done:?}");
        let after = cost();
        (after.0 - before.0, after.1 - before.1)
    }

    #[tokio::test]
    async fn a_write_takes_a_step_to_begin_one_for_each_entry_and_none_for_its_end() {
        let (port, _boards) = board::start().await;
        let text = format!(
            "[line.main]\nport = \"{port}\"\n\
             [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n"
        );
        let service = Service::start_quiet(Config::parse(&text).unwrap()).unwrap();
        service.opened("main").await.unwrap();
        assert_eq!(cost_of_a_write(&service).await, (1, 0), "without a log");

        let folder = std::env::temp_dir().join(format!("railbus-cost-{}", std::process::id()));
        let (log, _) = AuditLog::open(&folder).unwrap();
        service.keep_audit(log);
        let (steps, tasks) = cost_of_a_write(&service).await;
        // Fewer where the log has written a record before it is looked at.
        assert!(steps <= 3 && tasks <= 2, "with a log: {steps}, {tasks}");
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }
}
