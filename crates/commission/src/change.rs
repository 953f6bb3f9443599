//! Changes settings of one module: read, check, write, look for it, read back, or roll back.

use super::context::{ProcedureContext, Reply};
use super::locate::{find, first_alone};
use super::place::{BusAddress, Found, Kept};
use super::stages::{WriteStep, stages};
use super::{
    ChangeOrigin, JournalRecord, NotWritable, Procedure, ProcedureError, Progress, RecordState,
    Spot, vacant,
};
use crate::settings::{Wanted, differences};
use railbus_device::{Module, Observation, Op, Refusal, SettingWrite, Setup};
use railbus_wire::{Frame, Micros, Protocol, SerialSettings};

/// Pause after a write [EDA §1.7].
const SETTLE: Micros = Micros::from_millis(300);
/// How long to wait for a board to be power-cycled.
const POWER_CYCLE: Micros = Micros::from_secs(60);
/// Interval between attempts to write a board's address.
const ATTEMPT: Micros = Micros::from_millis(500);
/// Timeout of a board's reply during these attempts.
const BOARD_TIMEOUT: Micros = Micros::from_millis(100);
/// A write that was not acknowledged, and is known not to have been carried out, is sent once more.
const WRITES: u8 = 2;

/// Another configured module of the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbour {
    /// Its name.
    pub name: String,
    /// Its protocol.
    pub protocol: Protocol,
    /// Where it answers.
    pub place: BusAddress,
}

/// A change to one module.
#[derive(Clone, Debug)]
pub struct Job {
    /// The number of the change in the journal.
    pub change: u64,
    /// The line it is on.
    pub line: String,
    /// Its name.
    pub module: String,
    /// What it is, and where it answers.
    pub setup: Setup,
    /// The settings it should have.
    pub wanted: Wanted,
    /// The other modules of the line.
    pub neighbours: Vec<Neighbour>,
    /// What requested the change.
    pub by: ChangeOrigin,
    /// The change that this one undoes.
    pub undoes: Option<u64>,
}

/// How a change ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// It already had all these settings: nothing was written.
    Same(Found),
    /// Written, found at its new place and read back equal.
    Done(Found),
    /// Acknowledged, but not in effect yet: the module applies it at its next power-up.
    Pending(Found),
    /// The module is unchanged.
    Unchanged(Found, WriteFailure),
    /// A part was done and rolled back: the module is as before.
    RolledBack(Found, WriteFailure),
    /// A part was done and could not be rolled back: this is where it is and what it has stored.
    Halfway(Found, WriteFailure),
    /// It answers at its old place, and no read shows whether it will apply the new values at its
    /// next power-up: it acknowledged nothing.
    Untold(Found),
    /// It was not found anywhere that it could be; whether two modules answered at once.
    Lost(bool),
}

impl Ended {
    /// Whether the module may have stored what was to be written, or a part of it, although that is
    /// not what was found.
    #[must_use]
    pub const fn may_have_acted(&self) -> bool {
        match self {
            Ended::Halfway(..) | Ended::Untold(_) | Ended::Lost(_) => true,
            // Each of these was read back, or nothing was written; a pending one was acknowledged.
            Ended::Same(_)
            | Ended::Done(_)
            | Ended::Pending(_)
            | Ended::Unchanged(..)
            | Ended::RolledBack(..) => false,
        }
    }

    /// The name in JSON.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Ended::Same(_) => "same",
            Ended::Done(_) => "done",
            Ended::Pending(_) => "pending",
            Ended::Unchanged(..) => "unchanged",
            Ended::RolledBack(..) => "rolled_back",
            Ended::Halfway(..) => "halfway",
            Ended::Untold(_) => "untold",
            Ended::Lost(_) => "lost",
        }
    }

    /// The module, if it was found.
    #[must_use]
    pub const fn found(&self) -> Option<&Found> {
        match self {
            Ended::Same(found)
            | Ended::Done(found)
            | Ended::Pending(found)
            | Ended::Unchanged(found, _)
            | Ended::RolledBack(found, _)
            | Ended::Halfway(found, _)
            | Ended::Untold(found) => Some(found),
            Ended::Lost(_) => None,
        }
    }
}

/// Why a write was not carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteFailure {
    /// The module refused.
    Refused(Refusal),
    /// It did not answer, and did not carry it out.
    Ignored,
    /// It acknowledged, but reads back differently.
    NotVerified,
    /// It was not power-cycled in time, or its DIP switch is not at 0.
    NoPowerCycle,
    /// The user stopped it.
    Stopped,
}

/// A procedure that changes settings of a module.
#[must_use]
pub fn change(job: Job) -> Procedure<Result<Ended, ProcedureError>> {
    Procedure::new(move |context| async move {
        let place = BusAddress::of(&job.setup);
        context.tell(Progress::Reading(place)).await;
        let found = first_alone(&context, &job.setup, place).await?;
        let known = found.kept();
        let wanted = job.wanted.over(&known).ok_or(NotWritable::NotReadable)?;
        let stages = stages(&job.setup, place, &known, &wanted)?;
        let Some(last) = stages.last() else {
            return Ok(Ended::Same(found));
        };
        check_vacancy(&context, &job, place, last.to).await?;
        carry_all(&context, &job, found, &stages).await
    })
}

/// Checks that nothing else answers wherever the module will be on the way.
async fn check_vacancy(
    context: &ProcedureContext,
    job: &Job,
    from: BusAddress,
    to: BusAddress,
) -> Result<(), ProcedureError> {
    let moves = from.address != to.address;
    let mut serials: Vec<SerialSettings> = vec![from.serial, to.serial];
    serials.dedup();
    // At its own address and speed, the module itself answers.
    serials.retain(|serial| moves || *serial != from.serial);
    vacant::check(context, &job.setup, to.address, &serials, &job.neighbours).await
}

/// Carries out one stage after the other; if one fails, those done are rolled back.
pub(crate) async fn carry_all(
    context: &ProcedureContext,
    job: &Job,
    before: Found,
    stages: &[WriteStep],
) -> Result<Ended, ProcedureError> {
    let mut writer = Writer {
        context,
        job,
        steps: stages.len() as u8,
        step: 0,
        places: Vec::new(),
    };
    let mut found = before;
    for stage in stages {
        if context.stopped() && writer.step == 0 {
            return Err(ProcedureError::Stopped);
        }
        match writer.carry(stage, job.by).await? {
            StageEnd::Done(now) => found = now,
            StageEnd::Pending(now) => return Ok(Ended::Pending(now)),
            StageEnd::Untold(now) => return Ok(Ended::Untold(now)),
            StageEnd::Unchanged(now, why) if writer.step == 1 => {
                return Ok(Ended::Unchanged(now, why));
            }
            StageEnd::Unchanged(now, why) | StageEnd::Elsewhere(now, why) => {
                return writer.go_back(now, before, why).await;
            }
            StageEnd::Lost(garbled) => return Ok(Ended::Lost(garbled)),
        }
    }
    Ok(Ended::Done(found))
}

/// How one stage ended.
enum StageEnd {
    Done(Found),
    Pending(Found),
    Unchanged(Found, WriteFailure),
    Untold(Found),
    /// Neither as before nor as requested.
    Elsewhere(Found, WriteFailure),
    Lost(bool),
}

/// Carries out stages, and journals each.
struct Writer<'c> {
    context: &'c ProcedureContext,
    job: &'c Job,
    step: u8,
    steps: u8,
    /// Where the module was, or was moved to, before.
    places: Vec<BusAddress>,
}

impl Writer<'_> {
    /// Writes, and checks the result. The intent is in the journal before the first byte is sent.
    async fn carry(
        &mut self,
        stage: &WriteStep,
        by: ChangeOrigin,
    ) -> Result<StageEnd, ProcedureError> {
        self.step += 1;
        self.steps = self.steps.max(self.step);
        let intent = self.record(stage, by, RecordState::Intent);
        self.context.journal(intent.clone()).await?;
        self.context
            .tell(Progress::Writing(self.step, self.steps))
            .await;
        let sheet = self.job.setup.family.datasheet();
        let end = if sheet.needs_power_cycle() {
            self.write_board(stage).await?
        } else {
            self.write(stage).await?
        };
        let (state, found) = match &end {
            StageEnd::Done(found) => (RecordState::Done, Some(found)),
            StageEnd::Pending(found) => (RecordState::Pending, Some(found)),
            StageEnd::Unchanged(found, _) => (RecordState::Unchanged, Some(found)),
            StageEnd::Untold(found) => (RecordState::Untold, Some(found)),
            StageEnd::Elsewhere(found, _) => (RecordState::Elsewhere, Some(found)),
            StageEnd::Lost(_) => (RecordState::Lost, None),
        };
        self.context.journal(intent.ended(state, found)).await?;
        self.places.extend([stage.from, stage.to]);
        Ok(end)
    }

    fn record(&self, stage: &WriteStep, by: ChangeOrigin, state: RecordState) -> JournalRecord {
        let job = self.job;
        let set = differences(&job.setup, &stage.before, &stage.after);
        let module = Module::new(stage.from.setup(&job.setup));
        let mut frame = Frame::new();
        if let Ok(exchange) = module.map_err(|_| ()).and_then(|module| {
            module
                .exchange(&Op::Configure(stage.change))
                .map_err(|_| ())
        }) {
            exchange.encode(&mut frame);
        }
        JournalRecord {
            step: self.step,
            steps: self.steps,
            state,
            from: Spot::of(stage.from),
            to: Spot::of(stage.to),
            set: set
                .into_iter()
                .map(|(key, old, new)| (key.to_string(), [old, new]))
                .chain(untold(stage.change))
                .collect(),
            frame: frame
                .bytes()
                .iter()
                .map(|byte| format!("{byte:02X}"))
                .collect(),
            by,
            undoes: job.undoes,
            ..JournalRecord::of(job.change, &job.line, &job.module, &job.setup)
        }
    }

    async fn write(&self, stage: &WriteStep) -> Result<StageEnd, ProcedureError> {
        let module = Module::new(stage.from.setup(&self.job.setup)).map_err(NotWritable::Setup)?;
        let op = Op::Configure(stage.change);
        let mut end = StageEnd::Lost(false);
        for _ in 0..WRITES {
            let reply = self.context.op(&module, &op).await?;
            self.context.wait(SETTLE).await;
            let places = candidates(stage.to, stage.from, &self.places);
            let (found, garbled) = find(self.context, &self.job.setup, &places, 3).await?;
            end = match found {
                Some(found) => judge(stage, &reply, found),
                None => StageEnd::Lost(garbled),
            };
            // It was read since, and is unchanged: writing again is not writing blindly.
            if !matches!(
                end,
                StageEnd::Unchanged(_, WriteFailure::Ignored) | StageEnd::Untold(_)
            ) {
                break;
            }
        }
        Ok(end)
    }

    /// A board accepts its address only within 10 s of power-up: the user power-cycles it meanwhile
    /// [R55 §4.6, §4.8].
    async fn write_board(&self, stage: &WriteStep) -> Result<StageEnd, ProcedureError> {
        let board = Module::new(stage.from.setup(&self.job.setup)).map_err(NotWritable::Setup)?;
        let there = Module::new(stage.to.setup(&self.job.setup)).map_err(NotWritable::Setup)?;
        let context = self.context;
        let end = context.now() + POWER_CYCLE;
        let mut why = WriteFailure::NoPowerCycle;
        let mut acknowledged = false;
        while context.now() < end {
            if context.stopped() {
                why = WriteFailure::Stopped;
                break;
            }
            let attempt = context.now();
            context
                .tell(Progress::PowerCycle(
                    end.since(attempt).0.div_ceil(1_000_000),
                ))
                .await;
            // The same frame is repeated: which one is answered does not matter.
            context.forget_ghosts();
            let write = Op::Configure(stage.change);
            let reply = context.op_within(&board, &write, BOARD_TIMEOUT).await?;
            acknowledged |= matches!(reply, Reply::Said(Observation::Done));
            let state = context
                .op_within(&there, &Op::ReadOutputs, BOARD_TIMEOUT)
                .await?;
            if acknowledged || matches!(state, Reply::Said(Observation::Channels { .. })) {
                break;
            }
            let spent = context.now().since(attempt);
            context
                .wait(Micros(ATTEMPT.0.saturating_sub(spent.0)))
                .await;
        }
        let (found, garbled) = find(context, &self.job.setup, &[stage.to, stage.from], 3).await?;
        Ok(match found {
            Some(found) if found.place == stage.to => StageEnd::Done(found),
            Some(found) if acknowledged => StageEnd::Pending(found),
            Some(found) => StageEnd::Unchanged(found, why),
            None => StageEnd::Lost(garbled),
        })
    }

    /// Writes back the previous settings, as far as the module accepts them.
    async fn go_back(
        mut self,
        now: Found,
        before: Found,
        why: WriteFailure,
    ) -> Result<Ended, ProcedureError> {
        let old = before.kept();
        let back = stages(&self.job.setup, now.place, &now.kept(), &old)?;
        let mut found = now;
        for stage in &back {
            match self.carry(stage, ChangeOrigin::Rollback).await? {
                StageEnd::Done(now) => found = now,
                StageEnd::Lost(garbled) => return Ok(Ended::Lost(garbled)),
                StageEnd::Pending(now)
                | StageEnd::Unchanged(now, _)
                | StageEnd::Untold(now)
                | StageEnd::Elsewhere(now, _) => return Ok(Ended::Halfway(now, why)),
            }
        }
        Ok(Ended::RolledBack(found, why))
    }
}

/// What a write changes that no read shows.
pub(crate) fn untold(change: SettingWrite) -> Option<(String, [String; 2])> {
    let (name, new) = match change {
        SettingWrite::CalibrateZero => ("zero", "calibrated"),
        SettingWrite::CalibrateSpan => ("span", "calibrated"),
        SettingWrite::Restore => ("calibration", "factory"),
        _ => return None,
    };
    Some((name.to_owned(), ["?".to_owned(), new.to_owned()]))
}

/// Where the module may be after a write, the likeliest first: at the new place, at the old one,
/// and wherever only a part of this change, or of an earlier write, is in effect (choice 01).
pub(crate) fn candidates(
    to: BusAddress,
    from: BusAddress,
    earlier: &[BusAddress],
) -> Vec<BusAddress> {
    let known: Vec<BusAddress> = [to, from]
        .into_iter()
        .chain(earlier.iter().copied())
        .collect();
    let mut places = Vec::new();
    let mut add = |place: BusAddress| {
        if !places.contains(&place) {
            places.push(place);
        }
    };
    known.iter().copied().for_each(&mut add);
    for address in known.iter().map(|place| place.address) {
        for serial in known.iter().map(|place| place.serial) {
            for checksum in known.iter().map(|place| place.checksum) {
                add(BusAddress {
                    address,
                    serial,
                    checksum,
                });
            }
        }
    }
    places
}

/// What a module that was found says about a write.
fn judge(stage: &WriteStep, reply: &Reply, found: Found) -> StageEnd {
    if is_done(stage, &found) {
        return StageEnd::Done(found);
    }
    let why = match reply {
        Reply::Said(Observation::Refused(refusal)) => WriteFailure::Refused(*refusal),
        Reply::Said(_) => WriteFailure::NotVerified,
        Reply::Silent | Reply::Garbled => WriteFailure::Ignored,
    };
    let (new, old) = evidence(stage, &found.told);
    let acknowledged = matches!(reply, Reply::Said(Observation::Done));
    let moves = stage.from != stage.to && found.place != stage.to;
    let refused = matches!(why, WriteFailure::Refused(_));
    match (new, old) {
        (true, false) if moves => StageEnd::Pending(found),
        // It reports nothing of what was written. Whatever it acknowledged, or shows in part, it
        // has.
        (false, false) if moves && (acknowledged || found.place != stage.from) => {
            StageEnd::Pending(found)
        }
        (false, false) if moves && !refused => StageEnd::Untold(found),
        _ if found.place == stage.from && !new => StageEnd::Unchanged(found, why),
        _ => StageEnd::Elsewhere(found, why),
    }
}

/// Whether the module matches the stage: at the right place, and in all that it reports.
pub(crate) fn is_done(stage: &WriteStep, found: &Found) -> bool {
    let told_what_matters = (stage.after.pulse == stage.before.pulse || found.told.pulse.is_some())
        && (stage.after.voltage == stage.before.voltage || found.told.voltage.is_some());
    found.place == stage.to && found.told.agrees(&stage.after) && told_what_matters
}

/// Whether any of the differing settings that the module reports is as after, or as before.
pub(crate) fn evidence(stage: &WriteStep, told: &Kept) -> (bool, bool) {
    fn of<T: PartialEq>(told: Option<T>, before: Option<T>, after: Option<T>) -> (bool, bool) {
        let differs = before != after && told.is_some();
        (differs && told == after, differs && told == before)
    }
    let (before, after) = (stage.before, stage.after);
    let all = [
        of(told.address, before.address, after.address),
        of(told.baud, before.baud, after.baud),
        of(told.character, before.character, after.character),
        of(told.checksum, before.checksum, after.checksum),
        of(told.pulse, before.pulse, after.pulse),
        of(told.voltage, before.voltage, after.voltage),
    ];
    (
        all.iter().any(|(new, _)| *new),
        all.iter().any(|(_, old)| *old),
    )
}
