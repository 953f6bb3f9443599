//! The driver of a settings procedure: sends its requests on a port, lets time pass and keeps its
//! journal. Progress and questions are its caller's: a terminal, or an operation of the gateway.

use super::port::SettingsPort;
use jiff::Timestamp;
use railbus_commission::{
    DriverAction, Event, JournalRecord, Log, Procedure, ProcedureStep, Progress, Question,
};
use railbus_store::journal::JournalFile;
use railbus_words::time;
use std::pin::pin;
use std::time::Duration;

/// The journal of changed settings, as a procedure needs it: none for a procedure that only reads.
#[derive(Debug, Default)]
pub struct Journal(Option<JournalFile>);

impl Journal {
    /// Takes an open journal.
    #[must_use]
    pub const fn new(store: Option<JournalFile>) -> Journal {
        Journal(store)
    }

    /// Its content.
    #[must_use]
    pub fn log(&self) -> Option<&Log> {
        self.0.as_ref().map(JournalFile::log)
    }

    /// The number of the next change.
    #[must_use]
    pub fn next_change(&self) -> u64 {
        self.log().map_or(1, Log::next_change)
    }

    /// The newest record of a change.
    #[must_use]
    pub fn last(&self, change: u64) -> Option<JournalRecord> {
        self.log()?.change(change).last().cloned()
    }

    /// Writes a record, with the time; true once it is durable. False without a journal.
    pub async fn keep(&mut self, mut record: JournalRecord) -> bool {
        let Some(mut store) = self.0.take() else {
            return false;
        };
        record.at = time::rfc3339(Timestamp::now());
        let kept = tokio::task::spawn_blocking(move || {
            let kept = store.append(record).is_ok();
            (store, kept)
        });
        let Ok((store, kept)) = kept.await else {
            return false;
        };
        self.0 = Some(store);
        kept
    }
}

/// What the caller has to do before the procedure goes on.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "one at a time")]
pub enum DriveStep<T> {
    /// Show the progress.
    Tell(Progress),
    /// Ask the user, and report the answer with [`Drive::answer`]. No answer is a no.
    Confirm(Question),
    /// The procedure has ended, and no late reply can arrive any more.
    Done(T),
}

/// A running procedure.
#[derive(Debug)]
pub struct Drive<'d, T> {
    talk: &'d mut SettingsPort,
    journal: &'d mut Journal,
    procedure: Procedure<T>,
    /// The result of the last action.
    event: Event,
}

impl<'d, T> Drive<'d, T> {
    /// Drives a procedure that has not started.
    pub const fn new(
        talk: &'d mut SettingsPort,
        journal: &'d mut Journal,
        procedure: Procedure<T>,
    ) -> Drive<'d, T> {
        Drive {
            talk,
            journal,
            procedure,
            event: Event::Begin,
        }
    }

    /// Runs the procedure until its caller has something to do. Once `stop` resolves, the procedure
    /// ends where that is safe.
    pub async fn next(&mut self, stop: impl Future<Output = ()>) -> DriveStep<T> {
        let mut stop = pin!(stop);
        let mut is_stopped = false;
        loop {
            let event = std::mem::replace(&mut self.event, Event::Over);
            let act = match self.procedure.next(self.talk.now(), event) {
                ProcedureStep::Do(DriverAction::Tell(progress)) => {
                    return DriveStep::Tell(progress);
                }
                ProcedureStep::Do(DriverAction::Confirm(question)) => {
                    self.event = Event::Answer(false);
                    return DriveStep::Confirm(question);
                }
                ProcedureStep::Do(act) => act,
                ProcedureStep::Done(end) => {
                    self.talk.settle().await;
                    return DriveStep::Done(end);
                }
            };
            let mut work = pin!(work(self.talk, self.journal, act));
            self.event = loop {
                tokio::select! {
                    biased;
                    event = &mut work => break event,
                    () = &mut stop, if !is_stopped => {
                        is_stopped = true;
                        self.procedure.stop();
                    }
                }
            };
        }
    }

    /// The user's answer to the question asked last.
    pub fn answer(&mut self, yes: bool) {
        self.event = Event::Answer(yes);
    }

    /// The procedure ends where that is safe.
    pub fn stop(&self) {
        self.procedure.stop();
    }
}

/// Carries out an action that needs no user.
async fn work(talk: &mut SettingsPort, journal: &mut Journal, act: DriverAction) -> Event {
    match act {
        DriverAction::Journal(record) => Event::Kept(journal.keep(record).await),
        DriverAction::Ask(ask) => Event::Heard(talk.ask(&ask).await),
        DriverAction::Wait(time) => {
            let end = tokio::time::Instant::now() + Duration::from_micros(time.0);
            tokio::time::sleep_until(end).await;
            Event::Over
        }
        DriverAction::Tell(_) | DriverAction::Confirm(_) => Event::Over,
    }
}
