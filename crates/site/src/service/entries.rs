//! The audit entries of commands: written down before anything is sent, and ended before the caller
//! is answered.
//!
//! The log's thread calls the core itself when an entry is durable. What is handed to the log is
//! handed to it under the core's lock, so the log has it in the order of the core's steps; and
//! nothing waits for the log's thread under that lock, for which it may wait itself.

use super::{Driven, Inner};
use crate::CommandError;
use crate::core::{Input, OpenAuditEntry, Reply, RequestId, Tell};
use railbus_store::audit::{AuditLog, End, Entry, NotWritten, Note, Waiting};
use railbus_store::history::{Event, EventKind, Severity};
use railbus_wire::Micros;
use std::collections::VecDeque;
use std::sync::Arc;

/// Who waits for the log, in the order in which the log was handed what they wait for.
#[derive(Debug, Default)]
pub(super) struct Waits(VecDeque<Wait>);

#[derive(Debug)]
struct Wait {
    request: RequestId,
    /// It is waited for until this time of the site, which is never earlier than that of one
    /// before.
    until: Micros,
    waiting: Waiting,
}

impl Waits {
    fn add(&mut self, (log, now): (&AuditLog, Micros), request: RequestId, waiting: Waiting) {
        let patience = u64::try_from(log.patience().as_micros()).unwrap_or(u64::MAX);
        let last = self.0.back().map_or(now, |wait| wait.until);
        self.0.push_back(Wait {
            request,
            until: (now + Micros(patience)).max(last),
            waiting,
        });
    }

    /// When somebody has waited long enough, if anybody waits.
    pub(super) fn deadline(&mut self) -> Option<Micros> {
        while self.0.front().is_some_and(|wait| wait.waiting.is_over()) {
            self.0.pop_front();
        }
        Some(self.0.front()?.until)
    }

    /// Those who have waited long enough. They give up without the core's lock, which they take.
    pub(super) fn overdue(&self, now: Micros) -> Vec<Waiting> {
        let overdue = self.0.iter().take_while(|wait| wait.until <= now);
        overdue.map(|wait| wait.waiting.clone()).collect()
    }
}

impl Inner {
    /// Writes down what is about to be done with a module, or the output of this label, and how
    /// its outputs are known to be now.
    pub(super) fn begin(
        self: &Arc<Inner>,
        driven: &mut Driven,
        request: RequestId,
        (module, label): (String, Option<String>),
        (note, before): (Note, String),
    ) {
        let now = self.now();
        let id = self.audit.next_id(now.wall);
        let mut event = Event::new(EventKind::Write, Severity::Info, "write").module(&module);
        event = event.by(&note.origin).what(&note.what);
        event.before = Some(before.clone()).filter(|text| !text.is_empty());
        if let Some(label) = label {
            event = event.point(&label);
        }
        event.id.clone_from(&id);
        let event = Box::new(event);
        let begun = OpenAuditEntry {
            id: id.clone(),
            event,
        };
        let entry = Entry {
            id,
            at: now.wall,
            origin: note.origin,
            module,
            what: note.what,
            end: None,
        };
        self.audit.begin(entry.clone());
        let Some(log) = self.audit.log() else {
            let may_go_on = self.audit.without_log();
            let begun = may_go_on
                .map(|()| begun)
                .map_err(|_| CommandError::NotAudited);
            return driven
                .core
                .handle(now, Input::Done(request, Reply::Begun(begun)));
        };
        let inner = Arc::clone(self);
        let then = move |written| {
            // The clock of the runtime, which a test may have stopped.
            let _entered = inner.runtime.enter();
            inner.drive(|core, now| {
                let begun = inner.written(written).map(|()| begun);
                core.handle(now, Input::Done(request, Reply::Begun(begun)));
            });
        };
        self.count("hand-overs");
        let waiting = log.begin(entry, before, Box::new(then));
        driven.waits.add((log, now.site), request, waiting);
    }

    /// Whether a command may go on that was written down, or could not be. Asked within a step of
    /// the core: that the log works or fails is told in the order in which it came to be.
    fn written(&self, written: Result<(), NotWritten>) -> Result<(), CommandError> {
        let Some(log) = self.audit.log() else {
            return written.map_err(|NotWritten| CommandError::NotAudited);
        };
        if log.works(written.is_ok()) {
            self.tell_event(match written {
                Ok(()) => Event::new(EventKind::System, Severity::Info, "audit_works"),
                Err(NotWritten) => Event::new(EventKind::System, Severity::Error, "audit_fails"),
            });
        }
        match written {
            Err(NotWritten) if log.is_required() => Err(CommandError::NotAudited),
            _ => Ok(()),
        }
    }

    /// Writes down how it ended, and how the outputs are known to be after it.
    pub(super) fn end(
        self: &Arc<Inner>,
        driven: &mut Driven,
        request: RequestId,
        begun: OpenAuditEntry,
        (end, after): (End, String),
    ) {
        let OpenAuditEntry { id, mut event } = begun;
        self.audit.end(&id, end);
        event.after = Some(after.clone()).filter(|text| !text.is_empty());
        event.end = Some(end.name().to_owned());
        if !end.is_done() {
            event.severity = Severity::Warning;
        }
        let Some(log) = self.audit.log() else {
            return self.tell_event(*event);
        };
        let inner = Arc::clone(self);
        // What could not be written is counted in the log itself.
        let then = move |_| inner.tell_event(*event);
        self.count("hand-overs");
        let waiting = log.end(&id, end, after, Box::new(then));
        driven.waits.add((log, self.now().site), request, waiting);
    }

    /// Answers a caller behind the end of its command.
    pub(super) fn answer(driven: &Driven, after: RequestId, Tell(tell): Tell) {
        let each = &driven.waits.0;
        let wait = each.binary_search_by_key(&after, |wait| wait.request);
        match wait.ok().and_then(|at| each.get(at)) {
            Some(wait) => {
                if let Err(then) = wait.waiting.also(Box::new(|_| tell())) {
                    then(Ok(()));
                }
            }
            None => tell(),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use railbus_store::audit::Origin;
    use std::sync::mpsc;
    use std::time::SystemTime;

    /// The thread of a log does nothing from now on until this is dropped.
    pub(in crate::service) fn hold_up(log: &AuditLog) -> mpsc::Sender<()> {
        let (goes_on, waits) = mpsc::channel::<()>();
        let (holds, is_held) = mpsc::channel();
        let entry = Entry {
            id: String::new(),
            at: SystemTime::now(),
            origin: Origin::program("test"),
            module: String::new(),
            what: String::new(),
            end: None,
        };
        let then = Box::new(move |_| {
            let _ = holds.send(());
            let _ = waits.recv();
        });
        let _ = log.begin(entry, String::new(), then);
        let _ = is_held.recv();
        goes_on
    }

    /// The log begins to fail between two records: the second is not given up before the first.
    #[test]
    fn who_waits_for_a_later_record_gives_up_no_earlier() {
        let folder = std::env::temp_dir().join(format!("railbus-waits-{}", std::process::id()));
        let (log, _) = AuditLog::open(&folder).unwrap();
        let goes_on = hold_up(&log);
        let mut waits = Waits::default();
        for request in [1, 2] {
            let waiting = log.end("", End::Reply, String::new(), Box::new(|_| {}));
            waits.add((&log, Micros::ZERO), RequestId(request), waiting);
            log.works(false);
        }
        let overdue = |millis| waits.overdue(Micros::from_millis(millis)).len();
        assert_eq!([20, 999, 1_000].map(overdue), [0, 0, 2]);
        assert_eq!(waits.deadline(), Some(Micros::from_secs(1)));
        drop(goes_on);
        let _ = std::fs::remove_dir_all(folder);
    }
}
