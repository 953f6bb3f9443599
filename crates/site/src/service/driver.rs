//! The core's driver: one lock, the clock, and what does what the core says.

use super::{Driven, Inner, lock, prepare, promise_file};
use crate::core::{Core, Input, LineId, Now, Output, Reply, RequestId, State};
use railbus_host::{Fault, Line, LineEvent, LineOptions, PortError, RunId, Terms};
use railbus_store::audit::Waiting;
use railbus_wire::{Instant, Micros};
use std::future::poll_fn;
use std::sync::{Arc, MutexGuard, Weak};
use std::task::{Poll, ready};
use std::time::SystemTime;

/// Tells the core of the time when it wants that, and those who have waited for the audit log long
/// enough.
pub(super) async fn tell_time(site: Weak<Inner>) {
    let _goes = Goes(Weak::clone(&site));
    loop {
        let rings = poll_fn(|cx| {
            let Some(inner) = site.upgrade() else {
                return Poll::Ready(Vec::new());
            };
            inner.count("of time");
            let mut driven = inner.driven();
            ready!(driven.alarm.poll(cx));
            Poll::Ready(driven.waits.overdue(inner.now().site))
        });
        let overdue = rings.await;
        let Some(inner) = site.upgrade() else {
            return;
        };
        overdue.iter().for_each(Waiting::give_up);
        inner.count("of time");
        inner.drive(|core, now| core.handle(now, Input::Time));
    }
}

/// If nothing reports the time any more, because the runtime shuts down, nothing in progress keeps
/// the site alive.
struct Goes(Weak<Inner>);

impl Drop for Goes {
    fn drop(&mut self) {
        if let Some(inner) = self.0.upgrade() {
            let site = inner.driven().site.take();
            drop(site);
        }
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
        let mut driven = self.driven();
        let id = driven.core.state(self.now()).lines.get(line)?.open()?;
        driven.lines.get(&id).cloned()
    }

    /// Opens a line whose events the core handles before anyone else. Gives back when its clock
    /// began, in the time of the site.
    pub(super) fn open(
        self: &Arc<Inner>,
        driven: &mut Driven,
        (name, id): (&str, LineId),
        mut config: LineOptions,
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

    /// The core, and what it is driven with. Whoever has this waits for nobody.
    pub(super) fn driven(&self) -> MutexGuard<'_, Driven> {
        self.count("locks");
        lock(&self.driven)
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
        look(self.driven().core.state(self.now()))
    }

    /// Changes what is known, as one step.
    pub(super) fn change<T>(self: &Arc<Inner>, change: impl FnOnce(&mut State) -> T) -> T {
        self.drive(|core, now| core.change(now, change))
    }

    /// Lets the core take a step, and does what it says.
    pub(super) fn drive<T>(self: &Arc<Inner>, step: impl FnOnce(&mut Core, Now) -> T) -> T {
        let mut driven = self.driven();
        let result = step(&mut driven.core, self.now());
        while let Some(output) = driven.core.poll() {
            self.carry_out(&mut driven, output);
        }
        let next = driven.deadline();
        driven.alarm.set(next);
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
                self.count("hand-overs");
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
                self.count("hand-overs");
                self.runtime.spawn(async move {
                    if let Some(line) = line {
                        // Fails where the whole site is being closed.
                        let _ = line.change(change).await;
                    }
                    inner.done(request, Reply::Changed);
                });
            }
            Output::Store { request, store } => {
                self.count("hand-overs");
                self.runtime.spawn(async move {
                    let stored = store.0.await;
                    inner.done(request, Reply::Stored(stored));
                });
            }
            Output::Event(event) => self.tell_event(*event),
            Output::Keep(promises) => match self.folder.clone() {
                None => driven.core.handle(self.now(), Input::Kept(Ok(()))),
                Some(folder) => {
                    self.count("hand-overs");
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
    pub(super) fn count(&self, what: &'static str) {
        *lock(&self.counts).entry(what).or_default() += 1;
    }

    #[cfg(not(test))]
    #[allow(clippy::unused_self)]
    pub(super) const fn count(&self, _what: &'static str) {}

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
    use super::super::entries::tests::hold_up;
    use super::*;
    use crate::config::CLONES;
    use crate::{Config, WriteTerms};
    use railbus_store::audit::{AuditLog, End};
    use std::path::PathBuf;
    use std::sync::atomic::Ordering;
    use std::time::Duration;

    const OVEN: &str = "[module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

    async fn oven(port: &str, more: &str) -> Service {
        let text = format!("[line.main]\nport = \"{port}\"\n{OVEN}{more}");
        let service = Service::start_quiet(Config::parse(&text).unwrap()).unwrap();
        service.opened("main").await.unwrap();
        service
    }

    /// What a write with its read-back costs: how often the core's lock is taken, but for the
    /// events of its line, which are handled under it anyway, and for the time; how often a task
    /// or thread wakes another one; and how many configurations of its module are copied.
    async fn cost_of_a_write(service: &Service) -> (usize, usize, usize) {
        let cost = || {
            let counts = lock(&service.inner.counts);
            let of = |what| counts.get(what).copied().unwrap_or_default();
            let clones = CLONES.load(Ordering::Relaxed);
            let locks = of("locks") - of("of lines") - of("of time");
            (locks, of("hand-overs"), clones)
        };
        let before = cost();
        let (place, terms) = (("oven", "k1"), WriteTerms::default());
        let done = service.write_labelled(place, true, terms).await;
        assert!(done.is_ok(), "{done:?}");
        let after = cost();
        (after.0 - before.0, after.1 - before.1, after.2 - before.2)
    }

    #[tokio::test]
    async fn a_write_takes_the_lock_once_and_once_more_for_its_entry_and_wakes_four() {
        let (port, _boards) = board::start().await;
        let service = oven(&port, "area = \"counted\"\n").await;
        // To the line, and back.
        assert_eq!(cost_of_a_write(&service).await, (1, 2, 0), "without a log");

        let (log, folder) = log_in("cost");
        service.keep_audit(log);
        for _ in 0..3 {
            // To the log, from there to the line, from there to the log, and back.
            assert_eq!(cost_of_a_write(&service).await, (2, 4, 0), "with a log");
        }
        let before = CLONES.load(Ordering::Relaxed);
        assert_eq!(service.config().modules["oven"].clone().line, "main");
        assert_eq!(
            CLONES.load(Ordering::Relaxed),
            before + 1,
            "they are counted"
        );
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }

    /// A log in a folder of its own.
    fn log_in(name: &str) -> (AuditLog, PathBuf) {
        let name = format!("railbus-{name}-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        (AuditLog::open(&folder).unwrap().0, folder)
    }

    /// Who is answered has the end in the log; followers of the events are told no earlier.
    #[tokio::test]
    async fn an_answer_waits_until_the_end_is_written() {
        let (port, _boards) = board::start().await;
        let service = oven(&port, "").await;
        let (log, folder) = log_in("answers");
        service.keep_audit(log.clone());
        let work = service.begin_work("oven", "a test".to_owned());
        let work = work.await.unwrap();
        let mut followed = service.follow_events();
        let goes_on = hold_up(&log);
        let mut ended = std::pin::pin!(work.end(End::Reply));
        let mut event = std::pin::pin!(followed.next());
        tokio::select! {
            biased;
            () = &mut ended => panic!("it was answered before"),
            _ = &mut event => panic!("it was told before"),
            () = std::future::ready(()) => {}
        }
        drop(goes_on);
        ended.await;
        assert!(event.await.unwrap().unwrap().end.is_some());
        let page = log.page(None, 9, Default::default()).await.unwrap();
        let last = page.entries.last().unwrap();
        assert_eq!(last.end.as_deref(), Some(End::Reply.name()));
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }

    /// A caller who asked for a line goes away while the grant waits for the log, behind the end of
    /// a pulse: the line comes back.
    #[tokio::test]
    async fn a_line_that_was_granted_to_a_caller_who_has_gone_comes_back() {
        let (port, _boards) = board::start().await;
        let service = oven(&port, "").await;
        let (log, folder) = log_in("grants");
        service.keep_audit(log.clone());
        let pulse = crate::Pulse {
            width: Some(Micros::from_secs(60)),
            by: crate::By::Host,
            ..crate::Pulse::default()
        };
        service.pulse("oven", board::k(1), pulse).await.unwrap();
        // Each of its records is waited for in vain, for a moment.
        let goes_on = hold_up(&log);
        log.works(false);
        {
            let mut lent = std::pin::pin!(service.lend("main"));
            loop {
                tokio::select! {
                    biased;
                    lent = &mut lent => panic!("granted in time: {lent:?}"),
                    () = tokio::time::sleep(Duration::from_millis(1)) => {}
                }
                let mut driven = service.inner.driven();
                if !driven.core.is_busy() && driven.waits.deadline().is_some() {
                    break;
                }
            }
        }
        drop(goes_on);
        let up = async {
            while service.line("main").unwrap().state != railbus_host::LineState::Up {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        let up = tokio::time::timeout(Duration::from_secs(5), up).await;
        assert!(up.is_ok(), "{:?}", service.line("main"));
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }

    /// A disk that hangs holds up a command for as long as it may and no longer, and is told once.
    #[tokio::test]
    async fn a_log_that_hangs_is_waited_for_in_vain() {
        let (port, _boards) = board::start().await;
        let service = oven(&port, "").await;
        let (log, folder) = log_in("hangs");
        service.keep_audit(log.clone());
        let mut followed = service.follow_events();
        let goes_on = hold_up(&log);
        let set = [(board::k(1), true)];
        let terms = WriteTerms::default();
        log.require(true);
        let begun = std::time::Instant::now();
        let refused = service.write("oven", &set, terms).await;
        assert_eq!(refused, Err(crate::CommandError::NotAudited));
        assert!(begun.elapsed() >= log.patience(), "{:?}", begun.elapsed());
        assert!(log.is_failing());
        log.require(false);
        // Its beginning and its end are not waited for as long any more.
        assert!(log.patience() < Duration::from_secs(1));
        let done = service.write("oven", &set, terms).await.unwrap();
        drop(goes_on);
        // Read by the log's thread, which has written both before. What comes is written again, and
        // waited for as long as on any disk.
        log.page(None, 1, Default::default()).await.unwrap();
        log.require(true);
        let next = service.write("oven", &set, terms).await.unwrap();
        assert!(!log.is_failing());
        let mut told = Vec::new();
        while told.len() < 4 {
            let event = followed.next().await.unwrap().unwrap();
            let of = (event.code.unwrap_or_default(), event.id);
            told.push(if of.0 == "write" { of.1 } else { of.0 });
        }
        assert_eq!(
            told,
            ["audit_fails", &*done.audit, "audit_works", &*next.audit]
        );
        let page = log.page(None, 9, Default::default()).await.unwrap();
        let ends: Vec<_> = page.entries.iter().map(|entry| entry.end.clone()).collect();
        let readback = Some(End::Readback.name().to_owned());
        // Of the refused one and of the one that held it up there is no end.
        assert_eq!(ends, [readback.clone(), readback, None, None]);
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }
}
