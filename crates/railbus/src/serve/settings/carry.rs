//! A change of settings as an operation: the line is taken, the procedure is driven on its port,
//! the configuration follows the module, and the line is given back.

use super::wish::{Plan, Wish};
use crate::api::failures;
use crate::api::ops::{OpBegun, OpInfo, OpState};
use crate::api::problem::{Problem, codes};
use crate::api::settings::SettingsRun;
use crate::commands::config::file::not_followed;
use crate::commands::config::ground::store_failure;
use crate::commands::config::outcome::{self, placed};
use crate::commands::config::talk::{Talk, keep};
use crate::failure::{Code, Failure};
use crate::serve::config::Asks;
use crate::serve::listen::ended;
use crate::serve::ops::Op;
use crate::serve::spoken;
use railbus_host::PortError;
use railbus_site::commission::{
    Act, Ended, Event, Job, Place, Procedure, Progress, Record, State, Step, Store, Trouble, Why,
    change,
};
use railbus_site::config::edit;
use std::pin::pin;
use std::time::Duration;

/// A change under way.
struct Carry {
    wish: Wish,
    plan: Plan,
    who: String,
    op: Op,
    /// The number of the change.
    change: u64,
    /// The journal; none while it is at the disk.
    store: Option<Store>,
    is_stopped: bool,
    /// A write was begun: what fails from then on may have acted.
    has_written: bool,
    /// How it ended, as the audit log tells it.
    audited: &'static str,
}

/// Begins it, where nothing stands in its way.
pub(super) async fn begin(wish: Wish, who: String, plan: Plan) -> Result<OpBegun, Problem> {
    let state = wish.state();
    let folder = state.clone();
    let store = tokio::task::spawn_blocking(move || Store::open(&state)).await;
    let store = store.map_err(std::io::Error::other).and_then(|store| store);
    let store = store.map_err(|error| store_failure(wish.lang, &folder, &error).to_problem())?;
    let change = match plan.stages.is_empty() {
        true => 0,
        false => store.log().next_change(),
    };
    let op = wish.site.ops.begin(info(&wish, &who, &plan, change))?;
    let begun = OpBegun { op: op.info().op };
    let carry = Carry {
        wish,
        plan,
        who,
        op,
        change,
        store: Some(store),
        is_stopped: false,
        has_written: false,
        audited: "not_tried",
    };
    tokio::spawn(carry.run());
    Ok(begun)
}

/// Only what was read back is told as done, and only what was never written as not tried.
const fn audited(end: &Result<Ended, Trouble>, has_written: bool) -> &'static str {
    match end {
        Ok(Ended::Same(_) | Ended::Done(_)) => "readback",
        Ok(Ended::Pending(_)) => "reply",
        Ok(Ended::Unchanged(_, Why::Refused(_))) => "refused",
        Ok(Ended::Unchanged(..)) => "not_verified",
        Ok(Ended::RolledBack(..)) => "undone",
        Ok(Ended::Halfway(..)) => "not_undone",
        Ok(Ended::Untold(_) | Ended::Lost(_)) => "unknown",
        // The port was lost, or the journal, and maybe behind a write that went out.
        Err(_) if has_written => "unknown",
        Err(_) => "not_tried",
    }
}

fn info(wish: &Wish, who: &str, plan: &Plan, change: u64) -> OpInfo {
    let lines = vec![plan.target.line.clone()];
    OpInfo {
        total: u64::try_from(plan.stages.len()).unwrap_or_default(),
        settings: Some(SettingsRun {
            module: wish.module.clone(),
            change,
            stage: "reading".to_owned(),
            changes: plan.changes(),
            ..SettingsRun::default()
        }),
        ..wish.site.ops.begins_now("settings", lines, who.to_owned())
    }
}

impl Carry {
    async fn run(mut self) {
        let end = match self.plan.stages.is_empty() {
            true => {
                self.found(&Ended::Same(self.plan.found));
                Ok(())
            }
            false => self.logged().await,
        };
        let lang = self.wish.lang;
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

    /// With its entry in the audit log.
    async fn logged(&mut self) -> Result<(), Problem> {
        let changes = self.plan.changes().into_iter();
        let changes = changes.map(|one| format!("{}={}", one.setting, one.after));
        let what = format!("settings {}", changes.collect::<Vec<_>>().join(" "));
        let service = &self.wish.service;
        let work = service.begin_work(&self.wish.module, what).await;
        let refused = |failure| failures::problem(service, &self.wish.module, None, &failure);
        let work = work.map_err(refused)?;
        let end = self.on_loan().await;
        work.end(self.audited).await;
        end
    }

    /// With the line for itself.
    async fn on_loan(&mut self) -> Result<(), Problem> {
        let (site, service) = (self.wish.site.clone(), self.wish.service.clone());
        let line = self.plan.target.line.clone();
        let loan = service.lend(&line).await;
        let loan = loan.map_err(|failure| failures::of_line(&service, &line, &failure))?;
        let end = self.on_line().await;
        // At the end of the daemon there is nothing to give back.
        if !*site.stop.borrow() {
            site.desk.take_back(loan, &service).await;
        }
        end
    }

    async fn on_line(&mut self) -> Result<(), Problem> {
        let target = self.plan.target.clone();
        let lang = self.wish.lang;
        let mut talk = Talk::open(&target.port, target.setup.serial)
            .await
            .map_err(|error| self.closed(&error))?;
        let mut serials = self.plan.stages.iter().map(|stage| stage.to.serial);
        if serials.any(|serial| !talk.follows(target.setup.serial, serial)) {
            let failure = Failure::of(lang, Code::PortSpeed);
            return Err(failure.because(&target.port).to_problem());
        }
        let job = Job {
            change: self.change,
            line: target.line.clone(),
            module: target.name.clone(),
            setup: target.setup,
            wanted: self.plan.wanted.clone(),
            neighbours: target.neighbours.clone(),
            by: self.plan.by,
            undoes: self.plan.undoes,
        };
        let end = self.drive(&mut talk, change(job)).await;
        drop(talk);
        self.audited = audited(&end, self.has_written);
        let failed = |trouble: Trouble| outcome::trouble(lang, &target, &trouble).to_problem();
        let end = end.map_err(failed)?;
        self.found(&end);
        if let Ended::Done(found) | Ended::Halfway(found, _) = &end {
            self.follow(found.place).await?;
        }
        let told = outcome::ended(lang, &target, self.change, &end);
        told.map_err(|failure| failure.to_problem())
    }

    fn closed(&self, error: &PortError) -> Problem {
        Problem::new(codes::LINE_CLOSED)
            .with("line", self.plan.target.line.as_str())
            .with("port", self.plan.target.port.to_string())
            .with("reason", error.name())
    }

    /// Says how it ended.
    fn found(&self, end: &Ended) {
        let place = end.found().map(|found| placed(self.wish.lang, found.place));
        self.op.tell(|info| {
            if let Some(run) = &mut info.settings {
                run.end = Some(end.name().to_owned());
                run.place = place;
                run.power_left_s = None;
            }
        });
    }

    /// Runs a procedure to its end, or to where it is safe to stop.
    async fn drive<T>(&mut self, talk: &mut Talk, mut procedure: Procedure<T>) -> T {
        let mut event = Event::Begin;
        loop {
            let act = match procedure.next(talk.now(), event) {
                Step::Done(end) => return end,
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
                // A change of settings asks nobody: who asked for it has seen the frames.
                Act::Confirm(_) => Event::Answer(false),
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
            let mut stop = self.wish.site.stop.clone();
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
    async fn keep(&mut self, record: Record) -> bool {
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
        self.has_written |= matches!(progress, Progress::Writing(..));
        self.op.tell(|info| {
            let Some(run) = &mut info.settings else {
                return;
            };
            run.power_left_s = None;
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
    async fn follow(&mut self, place: Place) -> Result<(), Problem> {
        let Wish {
            site,
            service,
            lang,
            module,
            ..
        } = &self.wish;
        let config = service.config();
        let known = config.modules.get(module);
        if known.is_some_and(|known| Place::of(&known.setup) == place) {
            return Ok(());
        }
        let asks = Asks {
            service,
            lang: *lang,
            who: &self.who,
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
        let store = self.store.as_ref();
        let last = store.and_then(|store| store.log().change(self.change).last().cloned());
        if let Some(last) = last {
            // The file is right already: should this fail, a recovery only finds that it is.
            let state = State::Filed;
            self.keep(Record { state, ..last }).await;
        }
        Ok(())
    }
}
