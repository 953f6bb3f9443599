//! Drives a procedure on the port of a line with exclusive access, as an operation: reports its
//! progress, asks its followers, and can be cancelled.

use super::settings_request::SettingsRequest;
use crate::config::Asks;
use crate::listen::ended;
use crate::localize;
use crate::ops::Op;
use crate::site::Site;
use railbus_api::ops::OpState;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::{failures, settings as told};
use railbus_app::failure::Failure;
use railbus_app::settings::drive::{Drive, DriveStep, Journal};
use railbus_app::settings::outcome::{not_followed, placed, store_failure};
use railbus_app::settings::port::SettingsPort;
use railbus_app::settings::target::Target;
use railbus_commission::{BusAddress, JournalRecord, Procedure, Progress, Question, RecordState};
use railbus_site::Service;
use railbus_site::config::edit;
use railbus_store::journal::JournalFile;
use railbus_words::Code;
use railbus_words::Lang;
use std::pin::pin;
use std::time::Duration;
use tokio::sync::watch;

/// How long to wait for an answer: polling is suspended for that time.
const ANSWER_MAX: Duration = Duration::from_secs(300);

/// A procedure as an operation.
pub(super) struct Run {
    lang: Lang,
    pub(super) op: Op,
    stop: watch::Receiver<bool>,
    pub(super) journal: Journal,
    /// A write was started: failures from then on may have acted.
    pub(super) has_written: bool,
}

/// The journal, locked for a change of settings.
pub(super) async fn journal(wish: &SettingsRequest) -> Result<JournalFile, Problem> {
    let (state, folder) = (wish.state(), wish.state());
    let store = tokio::task::spawn_blocking(move || JournalFile::open(&state)).await;
    let store = store.map_err(std::io::Error::other).and_then(|store| store);
    store.map_err(|error| store_failure(wish.lang, &folder, &error).to_problem())
}

/// Does something with exclusive access to a line. When the access is revoked, the operation ends
/// as if it had been cancelled: where it is safe to stop.
pub(super) async fn on_loan<T>(
    (site, op): (&Site, &Op),
    service: &Service,
    line: &str,
    work: impl Future<Output = Result<T, Problem>>,
) -> Result<T, Problem> {
    let loan = service.lend(line).await;
    let loan = loan.map_err(|failure| failures::of_line(service, line, &failure))?;
    let mut work = pin!(work);
    let end = tokio::select! {
        end = &mut work => end,
        () = tokio::time::sleep_until(loan.until()) => {
            op.end_early();
            work.await
        }
    };
    // When the daemon stops, there is nothing to release.
    let is_ending = *site.stop.borrow();
    match is_ending {
        true => loan.leave(),
        false => site.desk.take_back(loan, service).await,
    }
    end
}

/// Opens the port of a module's line.
pub(super) async fn open(target: &Target) -> Result<SettingsPort, Problem> {
    let talk = SettingsPort::open(&target.port, target.setup.serial).await;
    talk.map_err(|error| {
        Problem::new(codes::LINE_CLOSED)
            .with("line", target.line.as_str())
            .with("port", target.port.to_string())
            .with("reason", error.name())
    })
}

impl Run {
    pub(super) fn new(wish: &SettingsRequest, op: Op, store: JournalFile) -> Run {
        Run {
            lang: wish.lang,
            op,
            stop: wish.site.stop.clone(),
            journal: Journal::new(Some(store)),
            has_written: false,
        }
    }

    /// The operation has ended.
    pub(super) fn end(&self, end: Result<(), Problem>) {
        let lang = self.lang;
        self.op.tell(|info| {
            (info.state, info.error) = match end {
                Ok(()) => (OpState::Done, None),
                Err(problem) if problem.code == Code::Interrupted.name() => {
                    (OpState::Cancelled, None)
                }
                Err(problem) => (OpState::Failed, Some(localize::told(lang, problem))),
            };
            if info.state == OpState::Done {
                (info.done, info.percent) = (info.total, 100.0);
            }
        });
    }

    /// Runs a procedure to its end, or to where it is safe to stop.
    pub(super) async fn procedure<T>(
        &mut self,
        talk: &mut SettingsPort,
        procedure: Procedure<T>,
    ) -> T {
        let mut drive = Drive::new(talk, &mut self.journal, procedure);
        loop {
            match drive.next(stopped(&self.op, &self.stop)).await {
                DriveStep::Done(end) => return end,
                DriveStep::Tell(progress) => {
                    self.has_written |=
                        matches!(progress, Progress::Writing(..) | Progress::Calibrating);
                    tell(&self.op, self.lang, progress);
                }
                DriveStep::Confirm(question) => match ask(&self.op, &self.stop, question).await {
                    Some(answer) => drive.answer(answer),
                    None => drive.stop(),
                },
            }
        }
    }

    /// Updates the module's place in the configuration file.
    pub(super) async fn follow(
        &mut self,
        wish: &SettingsRequest,
        who: &str,
        place: BusAddress,
        last: Option<JournalRecord>,
    ) -> Result<(), Problem> {
        let SettingsRequest {
            site,
            service,
            lang,
            module,
            ..
        } = wish;
        let config = service.config();
        let known = config.modules.get(module);
        if known.is_some_and(|known| BusAddress::of(&known.setup) == place) {
            return Ok(());
        }
        let asks = Asks {
            service,
            lang: *lang,
            who,
            seen: None,
            is_fact: true,
        };
        let moved = |text: &str| {
            let moved = edit::moved(text, module, place);
            moved.ok_or_else(|| Problem::new(codes::NOT_EDITABLE))
        };
        if let Err(problem) = site.desk.change(&asks, moved).await {
            let why = Failure::of_problem(*lang, &problem);
            let why = std::iter::once(why.message().to_owned()).chain(why.why().iter().cloned());
            let why = why.collect::<Vec<_>>().join(" · ");
            let file = site.desk.file();
            return Err(not_followed(*lang, file, module, place, &why).to_problem());
        }
        if let Some(last) = last {
            // The file is right already: if this fails, a recovery will only confirm that.
            let state = RecordState::Filed;
            self.journal.keep(JournalRecord { state, ..last }).await;
        }
        Ok(())
    }
}

/// Resolves when the operation is cancelled, or the daemon stops.
async fn stopped(op: &Op, stop: &watch::Receiver<bool>) {
    let mut stop = stop.clone();
    tokio::select! {
        () = op.cancelled() => {}
        () = ended(&mut stop) => {}
    }
}

/// Asks the followers of the operation. `None` if it is cancelled, or on timeout.
async fn ask(op: &Op, stop: &watch::Receiver<bool>, question: Question) -> Option<bool> {
    let answer = op.ask();
    op.tell(|info| {
        if let Some(run) = &mut info.settings {
            run.question = Some(told::question(question, ANSWER_MAX));
        }
    });
    let said = tokio::select! {
        said = answer => said.ok(),
        () = stopped(op, stop) => None,
        () = tokio::time::sleep(ANSWER_MAX) => None,
    };
    op.tell(|info| {
        if let Some(run) = &mut info.settings {
            run.question = None;
        }
    });
    said
}

fn tell(op: &Op, lang: Lang, progress: Progress) {
    op.tell(|info| {
        let Some(run) = &mut info.settings else {
            return;
        };
        run.power_left_s = None;
        run.looking = match progress {
            Progress::Looking(place) => Some(placed(lang, place)),
            _ => None,
        };
        let stage = match progress {
            Progress::Reading(_) => "reading",
            Progress::Vacancy(_) => "vacancy",
            Progress::Looking(_) => "looking",
            Progress::Calibrating => "calibrating",
            Progress::Writing(step, steps) => {
                (info.done, info.total) = (u64::from(step) - 1, u64::from(steps));
                info.percent = 100.0 * f64::from(step - 1) / f64::from(steps.max(1));
                "writing"
            }
            Progress::PowerCycle(left) => {
                run.power_left_s = Some(left);
                "power_cycle"
            }
        };
        stage.clone_into(&mut run.stage);
    });
}
