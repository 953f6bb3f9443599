//! A change of settings as an operation: takes exclusive access to the line, drives the procedure
//! on its port, updates the configuration, and releases the line.

use super::drive::{Run, journal, on_loan, open};
use super::settings_request::{Plan, SettingsRequest};
use railbus_api::ops::{OpBegun, OpInfo};
use railbus_api::problem::Problem;
use railbus_api::settings::SettingsRun;
use railbus_app::api::failures;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome::{self, placed};
use railbus_commission::{Ended, Job, ProcedureError, WriteFailure, change};
use railbus_store::audit::End;
use railbus_words::Code;

/// A change in progress.
struct Apply {
    wish: SettingsRequest,
    plan: Plan,
    who: String,
    run: Run,
    /// The number of the change.
    change: u64,
    /// How it ended, for the audit log.
    audited: End,
}

/// Starts it, if nothing prevents it.
pub(super) async fn begin(
    wish: SettingsRequest,
    who: String,
    plan: Plan,
) -> Result<OpBegun, Problem> {
    let store = journal(&wish).await?;
    let change = match plan.stages.is_empty() {
        true => 0,
        false => store.log().next_change(),
    };
    let op = wish.site.ops.begin(info(&wish, &who, &plan, change))?;
    let begun = OpBegun { op: op.info().op };
    let run = Run::new(&wish, op, store);
    let carry = Apply {
        wish,
        plan,
        who,
        run,
        change,
        audited: NOT_TRIED,
    };
    tokio::spawn(carry.run());
    Ok(begun)
}

/// Only what was read back counts as done, and only what was never written as not tried.
const fn audited(end: &Result<Ended, ProcedureError>, has_written: bool) -> End {
    match end {
        Ok(Ended::Same(_) | Ended::Done(_)) => End::Readback,
        Ok(Ended::Pending(_)) => End::Reply,
        // The port or the journal failed, possibly after a write was sent.
        Err(_) if has_written => End::unsure("unknown"),
        Err(_) => NOT_TRIED,
        Ok(ended) => End::Failed {
            name: match ended {
                Ended::Unchanged(_, WriteFailure::Refused(_)) => "refused",
                Ended::Unchanged(..) => "not_verified",
                Ended::RolledBack(..) => "undone",
                Ended::Halfway(..) => "not_undone",
                _ => "unknown",
            },
            may_have_acted: ended.may_have_acted(),
        },
    }
}

/// Nothing was written.
pub(super) const NOT_TRIED: End = End::not_done("not_tried");

fn info(wish: &SettingsRequest, who: &str, plan: &Plan, change: u64) -> OpInfo {
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

impl Apply {
    async fn run(mut self) {
        let end = match self.plan.stages.is_empty() {
            true => {
                self.found(&Ended::Same(self.plan.found));
                Ok(())
            }
            false => self.logged().await,
        };
        self.run.end(end);
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
        let (site, service) = (self.wish.site.clone(), self.wish.service.clone());
        let op = self.run.op.clone();
        let line = self.plan.target.line.clone();
        let end = on_loan((&site, &op), &service, &line, self.on_line()).await;
        work.end(self.audited).await;
        end
    }

    async fn on_line(&mut self) -> Result<(), Problem> {
        let target = self.plan.target.clone();
        let lang = self.wish.lang;
        let mut talk = open(&target).await?;
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
        let end = self.run.procedure(&mut talk, change(job)).await;
        drop(talk);
        self.audited = audited(&end, self.run.has_written);
        let failed =
            |trouble: ProcedureError| outcome::trouble(lang, &target, &trouble).to_problem();
        let end = end.map_err(failed)?;
        self.found(&end);
        if let Ended::Done(found) | Ended::Halfway(found, _) = &end {
            let last = self.run.journal.last(self.change);
            let who = self.who.clone();
            self.run.follow(&self.wish, &who, found.place, last).await?;
        }
        let told = outcome::ended(lang, &target, self.change, &end);
        told.map_err(|failure| failure.to_problem())
    }

    /// Reports how it ended.
    fn found(&self, end: &Ended) {
        let place = end.found().map(|found| placed(self.wish.lang, found.place));
        self.run.op.tell(|info| {
            if let Some(run) = &mut info.settings {
                run.end = Some(end.name().to_owned());
                run.place = place;
                run.power_left_s = None;
                run.looking = None;
            }
        });
    }
}
