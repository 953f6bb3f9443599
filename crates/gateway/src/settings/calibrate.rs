//! A calibration as an operation: it asks before each of its two steps, and may be cancelled there.

use super::apply::NOT_TRIED;
use super::drive::{Run, journal, on_loan, open};
use super::settings_request::SettingsRequest;
use railbus_api::ops::{OpBegun, OpInfo};
use railbus_api::problem::{Problem, codes};
use railbus_api::settings::{Calibration, SettingsRun};
use railbus_app::api::{failures, settings as told};
use railbus_app::failure::Failure;
use railbus_app::settings::outcome::{self, hindered};
use railbus_app::settings::target::Target;
use railbus_commission::settings::{Key, Wanted};
use railbus_commission::{Blocker, Calibrated, ChangeOrigin, Job, ProcedureError, calibrate};
use railbus_store::audit::End;
use railbus_words::Code;

/// The steps of a calibration, zero and span.
const STEPS: u64 = 2;

/// A calibration in progress.
struct Work {
    wish: SettingsRequest,
    target: Target,
    job: Job,
    /// The voltage at the inputs in the second step, in hundredths.
    voltage: u16,
    run: Run,
}

/// Starts it, if the module has one.
pub(super) async fn begin(
    wish: SettingsRequest,
    who: String,
    voltage: &str,
) -> Result<OpBegun, Problem> {
    let target = wish.target()?;
    if !target.setup.family.datasheet().is_calibrated() {
        let told = format!("{} ({})", target.name, target.setup.family);
        return Err(Failure::of(wish.lang, Code::SettingFixed)
            .because(told)
            .to_problem());
    }
    let mut wanted = Wanted::default();
    wanted
        .set(&target.setup, &Key::CalibrationVoltage.to_string(), voltage)
        .map_err(|why| outcome::wrong(wish.lang, &target, &why).to_problem())?;
    let voltage = wanted.kept.voltage;
    let voltage = voltage.ok_or_else(|| {
        Problem::new(codes::BAD_REQUEST).with("reason", "\"voltage\" can't be read")
    })?;
    let store = journal(&wish).await?;
    let job = Job {
        change: store.log().next_change(),
        line: target.line.clone(),
        module: target.name.clone(),
        setup: target.setup,
        wanted: Wanted::default(),
        neighbours: target.neighbours.clone(),
        by: ChangeOrigin::Calibrate,
        undoes: None,
    };
    let run = SettingsRun {
        module: wish.module.clone(),
        change: job.change,
        stage: "reading".to_owned(),
        calibration: Some(Calibration::default()),
        ..SettingsRun::default()
    };
    let op = wish.site.ops.begin(OpInfo {
        total: STEPS,
        settings: Some(run),
        ..wish
            .site
            .ops
            .begins_now("calibration", vec![target.line.clone()], who)
    })?;
    let begun = OpBegun { op: op.info().op };
    let run = Run::new(&wish, op, store);
    let work = Work {
        wish,
        target,
        job,
        voltage,
        run,
    };
    tokio::spawn(work.run());
    Ok(begun)
}

/// The result of a calibration for the audit log: a module reports that it did it, and no more.
fn audited(end: &Result<Calibrated, ProcedureError>, has_written: bool) -> End {
    match end {
        Ok(done) => match done.hindered {
            None => End::Reply,
            // The zero may have been stored, and only the span refused.
            Some(Blocker::Refused(_)) => End::Failed {
                name: "refused",
                may_have_acted: done.zero.is_some(),
            },
            Some(Blocker::Stopped) if done.zero.is_some() => End::Reply,
            Some(Blocker::Stopped) => NOT_TRIED,
            Some(Blocker::NotFinished | Blocker::Voltage) => End::unsure("unknown"),
        },
        Err(_) if has_written => End::unsure("unknown"),
        Err(_) => NOT_TRIED,
    }
}

impl Work {
    async fn run(mut self) {
        let end = self.logged().await;
        self.run.end(end);
    }

    /// With its entry in the audit log, and exclusive access to the line.
    async fn logged(&mut self) -> Result<(), Problem> {
        let (site, service) = (self.wish.site.clone(), self.wish.service.clone());
        let op = self.run.op.clone();
        let (module, line) = (self.target.name.clone(), self.target.line.clone());
        let volts = self.voltage;
        let what = format!(
            "calibrate zero, span at {}.{:02} V",
            volts / 100,
            volts % 100
        );
        let work = service.begin_work(&module, what).await;
        let refused = |failure| failures::problem(&service, &module, None, &failure);
        let work = work.map_err(refused)?;
        let mut told = NOT_TRIED;
        let end = on_loan((&site, &op), &service, &line, self.on_line(&mut told)).await;
        work.end(told).await;
        end
    }

    async fn on_line(&mut self, told: &mut End) -> Result<(), Problem> {
        let mut talk = open(&self.target).await?;
        let procedure = calibrate(self.job.clone(), self.voltage);
        let end = self.run.procedure(&mut talk, procedure).await;
        drop(talk);
        *told = audited(&end, self.run.has_written);
        let lang = self.wish.lang;
        let failed =
            |trouble: ProcedureError| outcome::trouble(lang, &self.target, &trouble).to_problem();
        let done = end.map_err(failed)?;
        self.run.op.tell(|info| {
            info.done = u64::from(done.zero.is_some()) + u64::from(done.span.is_some());
            if let Some(run) = &mut info.settings {
                run.calibration = Some(told::calibration(&done));
                run.end = Some(
                    if done.hindered.is_none() {
                        "done"
                    } else {
                        "halfway"
                    }
                    .to_owned(),
                );
            }
        });
        match done.hindered {
            None => Ok(()),
            Some(Blocker::Stopped) => Err(Failure::of(lang, Code::Interrupted).to_problem()),
            Some(why) => Err(hindered(lang, &self.target, why).to_problem()),
        }
    }
}
