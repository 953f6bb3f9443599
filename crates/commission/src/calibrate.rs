//! Calibration of analog inputs and factory reset, step by step.

use super::change::{carry_all, untold};
use super::context::{ProcedureContext, Reply};
use super::locate::{find, first_alone};
use super::place::{BusAddress, Found, Kept};
use super::stages::{WriteStep, applied, stages};
use super::{
    Ended, Job, JournalRecord, NotWritable, Procedure, ProcedureError, Progress, Question,
    RecordState, Spot, vacant,
};
use railbus_device::{Module, Observation, Op, Refusal, SettingWrite, Setup};
use railbus_wire::{Frame, Micros};

/// How long a calibration may take [EMD-2A2Q §5.5].
const PATIENCE: Micros = Micros::from_secs(10);
/// Interval between reads of the command register.
const LOOK_AGAIN: Micros = Micros::from_millis(500);

/// How far a calibration got.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Calibrated {
    /// The readings before, in hundredths.
    pub before: Option<[u16; 2]>,
    /// The readings after the zero step, if it was done.
    pub zero: Option<[u16; 2]>,
    /// The readings after the span step, if it was done.
    pub span: Option<[u16; 2]>,
    /// Why it stopped early, if it did.
    pub hindered: Option<Blocker>,
}

/// Why a calibration stopped early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blocker {
    /// The user stopped it.
    Stopped,
    /// The module refused.
    Refused(Refusal),
    /// The command bit did not return to 0 within 10 s, or the module stopped answering.
    NotFinished,
    /// The calibration voltage could not be set.
    Voltage,
}

/// A procedure for a calibration: zero with all inputs disconnected, then span with a voltage, in
/// hundredths, at all of them. The user may stop it before either step.
#[must_use]
pub fn calibrate(job: Job, voltage: u16) -> Procedure<Result<Calibrated, ProcedureError>> {
    Procedure::new(move |context| async move {
        let place = BusAddress::of(&job.setup);
        let found = first_calibrated(&context, &job, place).await?;
        let mut done = Calibrated {
            before: found.analogs,
            zero: None,
            span: None,
            hindered: None,
        };
        let ready = Question::ZeroReady(found.analogs.unwrap_or_default());
        if !context.confirm(ready).await {
            done.hindered = Some(Blocker::Stopped);
            return Ok(done);
        }
        let mut step = Steps {
            context: &context,
            job: &job,
            found,
            step: 0,
        };
        match step.carry(SettingWrite::CalibrateZero).await? {
            Ok(now) => done.zero = now.analogs,
            Err(why) => {
                return Ok(Calibrated {
                    hindered: Some(why),
                    ..done
                });
            }
        }
        let now = step.read().await?.ok_or(ProcedureError::NoReply(place))?;
        let readings = now.analogs.unwrap_or_default();
        if !context
            .confirm(Question::SpanReady(voltage, readings))
            .await
        {
            done.hindered = Some(Blocker::Stopped);
            return Ok(done);
        }
        let kept = step.found.kept();
        let wanted = Kept {
            voltage: Some(voltage),
            ..Kept::default()
        };
        let first = stages(&job.setup, place, &kept, &wanted)?;
        if !first.is_empty() {
            match carry_all(&context, &job, step.found, &first).await? {
                Ended::Done(now) => step.found = now,
                _ => {
                    return Ok(Calibrated {
                        hindered: Some(Blocker::Voltage),
                        ..done
                    });
                }
            }
        }
        match step.carry(SettingWrite::CalibrateSpan).await? {
            Ok(now) => done.span = now.analogs,
            Err(why) => done.hindered = Some(why),
        }
        Ok(done)
    })
}

/// A procedure that resets a module to factory settings, and looks for it where they lead
/// [EMD-2A2Q §5.8].
#[must_use]
pub fn restore_factory(job: Job) -> Procedure<Result<Ended, ProcedureError>> {
    Procedure::new(move |context| async move {
        let place = BusAddress::of(&job.setup);
        let found = first_calibrated(&context, &job, place).await?;
        let before = found.kept();
        let after = applied(&job.setup, SettingWrite::Restore, before);
        let to = BusAddress::of(&Setup::factory(job.setup.family));
        if to != place {
            let serials = [to.serial];
            vacant::check(&context, &job.setup, to.address, &serials, &job.neighbours).await?;
        }
        let stage = WriteStep {
            change: SettingWrite::Restore,
            before,
            from: place,
            after,
            to,
        };
        carry_all(&context, &job, found, &[stage]).await
    })
}

/// The first look at a module that can be calibrated: only such a one can be reset, too.
async fn first_calibrated(
    context: &ProcedureContext,
    job: &Job,
    place: BusAddress,
) -> Result<Found, ProcedureError> {
    if !job.setup.family.datasheet().is_calibrated() {
        return Err(NotWritable::NoCommand.into());
    }
    context.tell(Progress::Reading(place)).await;
    first_alone(context, &job.setup, place).await
}

/// The steps of a calibration, each of them journaled.
struct Steps<'c> {
    context: &'c ProcedureContext,
    job: &'c Job,
    found: Found,
    step: u8,
}

impl Steps<'_> {
    /// Writes one command bit, and waits until it is 0 again [EMD-2A2Q §5.1, §5.7].
    async fn carry(
        &mut self,
        change: SettingWrite,
    ) -> Result<Result<Found, Blocker>, ProcedureError> {
        self.step += 1;
        let here = self.found.place.setup(&self.job.setup);
        let module = Module::new(here).map_err(NotWritable::Setup)?;
        let op = Op::Configure(change);
        let intent = self.record(&module, change);
        self.context.journal(intent.clone()).await?;
        self.context.tell(Progress::Calibrating).await;
        let reply = self.context.op(&module, &op).await?;
        if let Reply::Said(Observation::Refused(refusal)) = reply {
            self.context
                .journal(intent.ended(RecordState::Unchanged, Some(&self.found)))
                .await?;
            return Ok(Err(Blocker::Refused(refusal)));
        }
        let acknowledged = matches!(reply, Reply::Said(Observation::Done));
        let end = self.context.now() + PATIENCE;
        let mut seen = false;
        while self.context.now() < end {
            self.context.wait(LOOK_AGAIN).await;
            let Some(found) = self.read().await? else {
                continue;
            };
            seen |= found.busy;
            if !found.busy {
                self.found = found;
                // Neither acknowledged nor seen in progress: whether it was received is not known.
                let known = acknowledged || seen;
                let state = if known {
                    RecordState::Done
                } else {
                    RecordState::Untold
                };
                self.context
                    .journal(intent.ended(state, Some(&found)))
                    .await?;
                return Ok(if known {
                    Ok(found)
                } else {
                    Err(Blocker::NotFinished)
                });
            }
        }
        self.context
            .journal(intent.ended(RecordState::Untold, Some(&self.found)))
            .await?;
        Ok(Err(Blocker::NotFinished))
    }

    async fn read(&self) -> Result<Option<Found>, ProcedureError> {
        let places = [self.found.place];
        Ok(find(self.context, &self.job.setup, &places, 3).await?.0)
    }

    fn record(&self, module: &Module, change: SettingWrite) -> JournalRecord {
        let mut frame = Frame::new();
        if let Ok(exchange) = module.exchange(&Op::Configure(change)) {
            exchange.encode(&mut frame);
        }
        let here = Spot::of(self.found.place);
        JournalRecord {
            step: self.step,
            steps: 2,
            from: here.clone(),
            to: here,
            set: untold(change).into_iter().collect(),
            frame: frame
                .bytes()
                .iter()
                .map(|byte| format!("{byte:02X}"))
                .collect(),
            by: self.job.by,
            ..JournalRecord::of(
                self.job.change,
                &self.job.line,
                &self.job.module,
                &self.job.setup,
            )
        }
    }
}
