//! A procedure driven on the port of a line that was taken for it, as an operation that tells how
//! it goes, asks whoever follows it, and can be ended.

use super::wish::Wish;
use crate::config::Asks;
use crate::listen::ended;
use crate::ops::Op;
use crate::routes::Site;
use crate::spoken;
use railbus_api::ops::OpState;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::{failures, settings as told};
use railbus_app::failure::Failure;
use railbus_app::settings::outcome::{not_followed, placed, store_failure};
use railbus_app::settings::talk::{Talk, keep};
use railbus_app::settings::target::Target;
use railbus_commission::{
    Act, Event, Log, Place, Procedure, Progress, Question, Record, State, Step,
};
use railbus_site::Service;
use railbus_site::config::edit;
use railbus_store::journal::Store;
use railbus_words::Code;
use railbus_words::Lang;
use std::pin::pin;
use std::time::Duration;
use tokio::sync::watch;

/// So long somebody may take to answer: meanwhile the line is taken from its polls.
const ANSWER_MAX: Duration = Duration::from_secs(300);

/// A procedure under way.
pub(super) struct Drive {
    lang: Lang,
    pub(super) op: Op,
    stop: watch::Receiver<bool>,
    /// The journal; none while it is at the disk.
    store: Option<Store>,
    is_stopped: bool,
    /// A write was begun: what fails from then on may have acted.
    pub(super) has_written: bool,
}

/// The journal, held for one who changes what modules keep.
pub(super) async fn journal(wish: &Wish) -> Result<Store, Problem> {
    let (state, folder) = (wish.state(), wish.state());
    let store = tokio::task::spawn_blocking(move || Store::open(&state)).await;
    let store = store.map_err(std::io::Error::other).and_then(|store| store);
    store.map_err(|error| store_failure(wish.lang, &folder, &error).to_problem())
}

/// Does something on a line that nobody else has meanwhile. When the loan is over, the operation
/// ends as if somebody had asked for that: where it is safe to stop.
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
    // At the end of the daemon there is nothing to give back.
    let is_ending = *site.stop.borrow();
    match is_ending {
        true => loan.leave(),
        false => site.desk.take_back(loan, service).await,
    }
    end
}

/// The port of a module's line.
pub(super) async fn open(target: &Target) -> Result<Talk, Problem> {
    let talk = Talk::open(&target.port, target.setup.serial).await;
    talk.map_err(|error| {
        Problem::new(codes::LINE_CLOSED)
            .with("line", target.line.as_str())
            .with("port", target.port.to_string())
            .with("reason", error.name())
    })
}

impl Drive {
    pub(super) fn new(wish: &Wish, op: Op, store: Store) -> Drive {
        Drive {
            lang: wish.lang,
            op,
            stop: wish.site.stop.clone(),
            store: Some(store),
            is_stopped: false,
            has_written: false,
        }
    }

    pub(super) fn log(&self) -> Option<&Log> {
        self.store.as_ref().map(Store::log)
    }

    /// The newest record of a change.
    pub(super) fn last_word(&self, change: u64) -> Option<Record> {
        self.log()?.change(change).last().cloned()
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
                Err(problem) => (OpState::Failed, Some(spoken::told(lang, problem))),
            };
            if info.state == OpState::Done {
                (info.done, info.percent) = (info.total, 100.0);
            }
        });
    }

    /// Asks whoever follows the operation. Who ends it, or says nothing for too long, says no.
    async fn ask(&mut self, question: Question) -> bool {
        if self.is_stopped {
            return false;
        }
        let answer = self.op.ask();
        self.op.tell(|info| {
            if let Some(run) = &mut info.settings {
                run.question = Some(told::question(question, ANSWER_MAX));
            }
        });
        let mut stop = self.stop.clone();
        let said = tokio::select! {
            said = answer => said.ok(),
            () = self.op.cancelled() => None,
            () = ended(&mut stop) => None,
            () = tokio::time::sleep(ANSWER_MAX) => None,
        };
        self.is_stopped |= said.is_none();
        self.op.tell(|info| {
            if let Some(run) = &mut info.settings {
                run.question = None;
            }
        });
        said == Some(true)
    }

    /// Runs a procedure to its end, or to where it is safe to stop.
    pub(super) async fn run<T>(&mut self, talk: &mut Talk, mut procedure: Procedure<T>) -> T {
        let mut event = Event::Begin;
        loop {
            let act = match procedure.next(talk.now(), event) {
                Step::Done(end) => {
                    talk.settle().await;
                    return end;
                }
                Step::Do(act) => act,
            };
            event = match act {
                Act::Journal(record) => Event::Kept(self.keep(record).await),
                Act::Ask(ask) => {
                    let asking = talk.ask(&ask);
                    Event::Heard(self.unless_stopped(&mut procedure, asking).await)
                }
                Act::Wait(time) => {
                    let time = Duration::from_micros(time.0);
                    self.unless_stopped(&mut procedure, tokio::time::sleep(time))
                        .await;
                    Event::Over
                }
                Act::Tell(progress) => {
                    self.tell(progress);
                    Event::Over
                }
                Act::Confirm(question) => {
                    let answer = self.ask(question).await;
                    if self.is_stopped {
                        procedure.stop();
                    }
                    Event::Answer(answer)
                }
            };
        }
    }

    /// Does one act; where somebody wants all this to end, the procedure learns it meanwhile.
    async fn unless_stopped<T, A: Future>(
        &mut self,
        procedure: &mut Procedure<T>,
        act: A,
    ) -> A::Output {
        let mut act = pin!(act);
        if !self.is_stopped {
            let mut stop = self.stop.clone();
            tokio::select! {
                end = &mut act => return end,
                () = self.op.cancelled() => {}
                () = ended(&mut stop) => {}
            }
            self.is_stopped = true;
            procedure.stop();
        }
        act.await
    }

    /// Writes a record down; true once it is safe.
    pub(super) async fn keep(&mut self, record: Record) -> bool {
        let Some(mut store) = self.store.take() else {
            return false;
        };
        let kept = tokio::task::spawn_blocking(move || {
            let kept = keep(&mut store, record).is_ok();
            (store, kept)
        });
        let Ok((store, kept)) = kept.await else {
            return false;
        };
        self.store = Some(store);
        kept
    }

    fn tell(&mut self, progress: Progress) {
        self.has_written |= matches!(progress, Progress::Writing(..) | Progress::Calibrating);
        let lang = self.lang;
        self.op.tell(|info| {
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

    /// The configuration's file says where the module is now.
    pub(super) async fn follow(
        &mut self,
        wish: &Wish,
        who: &str,
        place: Place,
        last: Option<Record>,
    ) -> Result<(), Problem> {
        let Wish {
            site,
            service,
            lang,
            module,
            ..
        } = wish;
        let config = service.config();
        let known = config.modules.get(module);
        if known.is_some_and(|known| Place::of(&known.setup) == place) {
            return Ok(());
        }
        let asks = Asks {
            service,
            lang: *lang,
            who,
            seen: None,
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
            // The file is right already: should this fail, a recovery only finds that it is.
            let state = State::Filed;
            self.keep(Record { state, ..last }).await;
        }
        Ok(())
    }
}
