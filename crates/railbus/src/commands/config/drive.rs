//! Runs a procedure on a line that this command has to itself, for a user at a terminal.

use super::borrow::borrow;
use super::texts::ConfigText;
use crate::backend::Borrowed;
use crate::commands::Context;
use crate::commands::place::{Place as At, port_failure};
use crate::commands::stop::Stop;
use railbus_app::failure::Failure;
use railbus_app::settings::drive::{Drive, DriveStep, Journal};
use railbus_app::settings::outcome::placed;
use railbus_app::settings::port::SettingsPort;
use railbus_app::settings::target::Target;
use railbus_commission::{Procedure, Progress, Question};
use railbus_host::{EchoMode, LineName, PortError};
use railbus_store::journal::JournalFile;
use railbus_wire::SerialSettings;
use railbus_words::Code;
use std::io::{BufRead, IsTerminal, Write};

/// A line that this command has to itself.
pub(super) struct Driver<'c> {
    context: &'c Context,
    talk: SettingsPort,
    stop: Stop,
    pub(super) journal: Journal,
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
        store: Option<JournalFile>,
    ) -> Result<Driver<'c>, Failure> {
        let settings = target.setup.serial;
        Driver::open_line(context, &target.line, &target.port, settings, store).await
    }

    /// Opens a line.
    pub(super) async fn open_line(
        context: &'c Context,
        line: &str,
        port: &LineName,
        settings: SerialSettings,
        store: Option<JournalFile>,
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
        let talk = SettingsPort::open(port, settings).await.map_err(|error| {
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
            journal: Journal::new(store),
            yes: false,
            _borrowed: borrowed,
        })
    }

    /// Stops asking: every question is confirmed.
    pub(super) const fn assume_yes(&mut self, yes: bool) {
        self.yes = yes;
    }

    /// Whether the port can follow a module from these settings to those.
    pub(super) fn follows(&self, from: SerialSettings, to: SerialSettings) -> bool {
        self.talk.follows(from, to)
    }

    /// Runs a procedure to its end. After Ctrl-C it ends where that is safe.
    pub(super) async fn run<T>(&mut self, procedure: Procedure<T>) -> T {
        let mut drive = Drive::new(&mut self.talk, &mut self.journal, procedure);
        let mut told = None;
        loop {
            match drive.next(self.stop.requested()).await {
                DriveStep::Done(end) => return end,
                DriveStep::Tell(progress) => tell(self.context, &mut told, progress),
                DriveStep::Confirm(question) => {
                    let text = asked(self.context, question);
                    if self.yes {
                        self.context.note(&text);
                        drive.answer(true);
                        continue;
                    }
                    match self.stop.or(ask_user(&text)).await {
                        Some(answer) => drive.answer(answer),
                        None => drive.stop(),
                    }
                }
            }
        }
    }

    /// Asks the user; false unless the answer is yes.
    pub(super) async fn agreed(&mut self, question: &str) -> bool {
        self.stop.or(ask_user(question)).await == Some(true)
    }
}

/// Shows the progress, unless it was shown before.
fn tell(context: &Context, told: &mut Option<Progress>, progress: Progress) {
    if *told == Some(progress) {
        return;
    }
    let first = told.is_none_or(|told| kind(told) != kind(progress));
    *told = Some(progress);
    let every = match progress {
        Progress::PowerCycle(left) => left % 10 == 0,
        Progress::Looking(_) => true,
        _ => false,
    };
    if first || every {
        context.note(&worded(context, progress));
    }
}

/// Whether there is a terminal to ask at.
pub(super) fn can_ask() -> bool {
    std::io::stdin().is_terminal()
}

/// Fails if there is no terminal to ask at.
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
