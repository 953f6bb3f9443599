//! Runs a procedure on a real line: sends its requests, writes the journal, informs the user.

use super::borrow::borrow;
use super::texts::ConfigText;
use crate::backend::Borrowed;
use crate::commands::Context;
use crate::commands::place::{Place as At, port_failure};
use crate::commands::stop::Stop;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome::placed;
use railbus_app::settings::talk::{Talk, keep};
use railbus_app::settings::target::Target;
use railbus_commission::{Act, Ask, Event, Heard, Procedure, Progress, Question, Record, Step};
use railbus_host::{EchoMode, LineName, PortError};
use railbus_store::journal::Store;
use railbus_wire::Settings;
use railbus_words::Code;
use std::io::{BufRead, IsTerminal, Write};
use std::time::Duration;
use tokio::time::Instant as Moment;

/// A line that this command has to itself.
pub(super) struct Driver<'c> {
    context: &'c Context,
    talk: Talk,
    stop: Stop,
    store: Option<Store>,
    told: Option<Progress>,
    /// Confirms every question without asking.
    yes: bool,
    /// Dropped after the port, so that the daemon finds the port free.
    _borrowed: Option<Borrowed>,
}

impl<'c> Driver<'c> {
    /// Opens the line of a module.
    pub(super) async fn open(
        context: &'c Context,
        target: &Target,
        store: Option<Store>,
    ) -> Result<Driver<'c>, Failure> {
        let settings = target.setup.serial;
        Driver::open_line(context, &target.line, &target.port, settings, store).await
    }

    /// Opens a line.
    pub(super) async fn open_line(
        context: &'c Context,
        line: &str,
        port: &LineName,
        settings: Settings,
        store: Option<Store>,
    ) -> Result<Driver<'c>, Failure> {
        let at = At {
            line: line.to_owned(),
            port: port.clone(),
            settings,
            echo: EchoMode::Auto,
        };
        let mut stop = Stop::new(context)?;
        let borrowed = borrow(context, &at.port).await?;
        if let Some(borrowed) = &borrowed {
            stop.when(borrowed.over());
        }
        let talk = Talk::open(port, settings).await.map_err(|error| {
            let failure = port_failure(context, &at, &error);
            match error {
                PortError::Busy { .. } => failure.because(context.lang.get(ConfigText::Daemon)),
                _ => failure,
            }
        })?;
        Ok(Driver {
            context,
            talk,
            stop,
            store,
            told: None,
            yes: false,
            _borrowed: borrowed,
        })
    }

    /// Stops asking: every question is confirmed.
    pub(super) const fn assume_yes(&mut self, yes: bool) {
        self.yes = yes;
    }

    /// Whether the port can follow a module from these settings to those.
    pub(super) fn follows(&self, from: Settings, to: Settings) -> bool {
        self.talk.follows(from, to)
    }

    /// The number of the next change.
    pub(super) fn next_change(&self) -> u64 {
        self.store
            .as_ref()
            .map_or(1, |store| store.log().next_change())
    }

    /// The journal.
    pub(super) const fn store(&mut self) -> Option<&mut Store> {
        self.store.as_mut()
    }

    /// Runs a procedure to its end. After Ctrl-C it ends where that is safe.
    pub(super) async fn run<T>(&mut self, mut procedure: Procedure<T>) -> T {
        let mut event = Event::Begin;
        loop {
            match procedure.next(self.talk.now(), event) {
                Step::Done(end) => {
                    self.told = None;
                    self.talk.settle().await;
                    return end;
                }
                Step::Do(act) => event = self.act(act, &procedure).await,
            }
        }
    }

    async fn act<T>(&mut self, act: Act, procedure: &Procedure<T>) -> Event {
        match act {
            Act::Journal(record) => Event::Kept(self.keep(record).is_ok()),
            Act::Ask(ask) => Event::Heard(self.ask(&ask, procedure).await),
            Act::Wait(time) => {
                let end = Moment::now() + Duration::from_micros(time.0);
                while Moment::now() < end {
                    tokio::select! {
                        () = tokio::time::sleep_until(end) => {}
                        () = self.stop.requested() => procedure.stop(),
                    }
                }
                Event::Over
            }
            Act::Tell(progress) => {
                self.tell(progress);
                Event::Over
            }
            Act::Confirm(question) => {
                let text = asked(self.context, question);
                if self.yes {
                    self.context.note(&text);
                    return Event::Answer(true);
                }
                Event::Answer(self.confirm(&text, procedure).await)
            }
        }
    }

    /// Writes a record to the journal.
    pub(super) fn keep(&mut self, record: Record) -> std::io::Result<()> {
        match &mut self.store {
            Some(store) => keep(store, record),
            None => Err(std::io::ErrorKind::NotFound.into()),
        }
    }

    async fn ask<T>(&mut self, ask: &Ask, procedure: &Procedure<T>) -> Heard {
        let mut asking = std::pin::pin!(self.talk.ask(ask));
        loop {
            tokio::select! {
                heard = &mut asking => return heard,
                () = self.stop.requested() => procedure.stop(),
            }
        }
    }

    fn tell(&mut self, progress: Progress) {
        if self.told == Some(progress) {
            return;
        }
        let first = self.told.is_none_or(|told| kind(told) != kind(progress));
        self.told = Some(progress);
        let every = match progress {
            Progress::PowerCycle(left) => left % 10 == 0,
            Progress::Looking(_) => true,
            _ => false,
        };
        if first || every {
            self.context.note(&worded(self.context, progress));
        }
    }

    async fn confirm<T>(&mut self, question: &str, procedure: &Procedure<T>) -> bool {
        tokio::select! {
            answer = ask_user(question) => answer,
            () = self.stop.requested() => {
                procedure.stop();
                false
            }
        }
    }

    /// Asks the user; false unless the answer is yes.
    pub(super) async fn agreed(&mut self, question: &str) -> bool {
        tokio::select! {
            answer = ask_user(question) => answer,
            () = self.stop.requested() => false,
        }
    }
}

/// Whether there is a terminal to ask at.
pub(super) fn can_ask() -> bool {
    std::io::stdin().is_terminal()
}

/// Fails if there is nobody to ask.
pub(super) fn must_ask(context: &Context) -> Result<(), Failure> {
    if can_ask() {
        return Ok(());
    }
    Err(Failure::of(context.lang, Code::NeedsAnswer))
}

/// Reads the user's answer in the background: reading blocks.
async fn ask_user(question: &str) -> bool {
    let _ = write!(std::io::stderr(), "{question} ");
    let (sender, answer) = tokio::sync::oneshot::channel();
    // Not a task of the runtime, which would wait for it when it shuts down.
    std::thread::spawn(move || {
        let mut line = String::new();
        let read = std::io::stdin().lock().read_line(&mut line);
        let _ = sender.send(read.map(|_| line));
    });
    let line = answer.await.ok().and_then(Result::ok).unwrap_or_default();
    matches!(
        line.trim().to_lowercase().as_str(),
        "y" | "yes" | "是" | "好"
    )
}

const fn kind(progress: Progress) -> u8 {
    match progress {
        Progress::Reading(_) => 0,
        Progress::Vacancy(_) => 1,
        Progress::Writing(step, _) => 10 + step,
        Progress::Looking(_) => 2,
        Progress::PowerCycle(_) => 3,
        Progress::Calibrating => 4,
    }
}

fn worded(context: &Context, progress: Progress) -> String {
    let lang = context.lang;
    match progress {
        Progress::Reading(place) => {
            lang.fill(ConfigText::Reading, &[("place", &placed(lang, place))])
        }
        Progress::Vacancy(place) => lang.fill(ConfigText::Vacancy, &[("address", &place.address)]),
        Progress::Writing(step, steps) => {
            lang.fill(ConfigText::Writing, &[("step", &step), ("steps", &steps)])
        }
        Progress::Looking(place) => {
            lang.fill(ConfigText::Looking, &[("place", &placed(lang, place))])
        }
        Progress::PowerCycle(left) => lang.fill(ConfigText::PowerCycle, &[("left", &left)]),
        Progress::Calibrating => lang.get(ConfigText::Calibrating).to_owned(),
    }
}

fn asked(context: &Context, question: Question) -> String {
    let volts = |hundredths: u16| format!("{}.{:02}", hundredths / 100, hundredths % 100);
    let lang = context.lang;
    match question {
        Question::ZeroReady([first, second]) => lang.fill(
            ConfigText::ZeroReady,
            &[("first", &volts(first)), ("second", &volts(second))],
        ),
        Question::SpanReady(voltage, [first, second]) => lang.fill(
            ConfigText::SpanReady,
            &[
                ("voltage", &volts(voltage)),
                ("first", &volts(first)),
                ("second", &volts(second)),
            ],
        ),
    }
}
