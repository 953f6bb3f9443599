//! A configuration from the centre, tried at a site, without I/O: it is kept only if the site works
//! with it as before, and otherwise the one before comes back, also after a loss of power.
//!
//! Before the file is replaced, both texts are on the disk as a [`TrialRecord`]. It is there until
//! the end of the trial is recorded, so that a start that finds it knows what is left to do
//! ([`recover`]). Every write is one of a whole file. docs/decisions/0063

mod record;

use crate::message::{ConfigPhaseKind, ConfigReport};
use record::interrupted;
pub use record::{
    ManagedRecord, Recovery, TrialEnd, TrialEndKind, TrialRecord, part_hash, recover,
};
use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

/// How long a configuration is tried.
pub const TRIAL: Duration = Duration::from_secs(120);
/// How long it is waited, after a start or a change at the site, until lines and modules are there
/// again. What is not there before a trial is not missing afterwards.
const SETTLES: Duration = Duration::from_secs(60);
/// How long until a write that failed is tried again.
const AGAIN: Duration = Duration::from_secs(5);
/// How often that time is doubled for a configuration that is not in the file: to five minutes.
const LONGER_MAX: u32 = 6;

/// A configuration that the centre wants here. Its signature and its site were checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WantedConfig {
    /// Its version: a later one is higher.
    pub version: u64,
    /// The text of the file, without what only the site itself says.
    pub text: String,
    /// The hash of a text of the site that it may replace although the centre did not make it;
    /// empty if it may replace none.
    pub replaces: Vec<u8>,
    /// The name of who wants it.
    pub user: String,
}

/// A text of the file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ConfigText {
    /// All of it.
    pub text: String,
    /// [`part_hash`] of the part that the centre may say.
    pub hash: Vec<u8>,
}

/// Why something is refused.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrialRefusal {
    /// In English.
    pub reason: String,
    /// The problem as the API has it, in JSON; empty if there is none.
    pub problem: Vec<u8>,
}

/// How the site works.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrialHealth {
    /// The lines that are configured.
    pub lines: BTreeSet<String>,
    /// Those of them whose port is open.
    pub lines_up: BTreeSet<String>,
    /// Those under exclusive access: their state, and that of their modules, is unknown.
    pub lines_lent: BTreeSet<String>,
    /// The modules that are configured and not switched off.
    pub modules: BTreeSet<String>,
    /// Those of them that answer.
    pub modules_online: BTreeSet<String>,
    /// It has a session with the centre.
    pub has_session: bool,
    /// How many parts of the program have panicked since it started.
    pub panics: u64,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrialInput {
    /// The centre wants this configuration.
    Wanted(WantedConfig),
    /// How the site works; said at least every second.
    Health(TrialHealth),
    /// The file, if it was changed here.
    File(ConfigText),
    /// The integration that drives this ends while the site goes on: a trial is taken back.
    Leave,
    /// The result of the last output.
    Done(TrialDone),
}

/// The result of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrialDone {
    /// Done.
    Ok,
    /// It was checked: this is how the file would be.
    Checked(ConfigText),
    /// The configuration is not accepted, for this reason, with line and column if it has them. The
    /// file is as before.
    Refused(TrialRefusal),
    /// The text before is back: the file, whose other part may have been changed meanwhile.
    Back(ConfigText),
    /// It failed for this reason. Whether it was written is not known.
    Failed(String),
    /// The file is another one than the one that was to be replaced, and is left as it is.
    Changed(ConfigText),
}

/// What is to be done, one at a time; each has a result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrialOutput {
    /// Put the second text in the place of that part of the first one, which is the file, that the
    /// centre may say, and check the result.
    Check(String, String),
    /// Store this durably.
    StoreTrial(TrialRecord),
    /// Replace the first text by the second in the file, durably, and apply it.
    Apply(String, String),
    /// Replace what the centre may say in the file, if that is as in the first text, by what the
    /// second one has of it, durably, and apply it: it may come back whatever it says.
    TakeBack(String, String),
    /// Store this durably.
    StoreManaged(ManagedRecord),
    /// Delete the stored [`TrialRecord`], durably.
    RemoveTrial,
}

/// How far the configuration of a site is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ConfigPhase {
    /// The centre has wanted none so far.
    Unmanaged,
    /// This version is kept.
    Current(u64),
    /// This version waits: another one is tried, or the disk refuses.
    Pending(u64, String),
    /// This version is tried.
    Trying(u64),
    /// This version was refused, or tried and taken back.
    Ended(TrialEnd),
    /// The file was changed here since this version was kept.
    LocalChange(u64),
}

/// What is going on. Where there is a time, that is when it is tried again.
#[derive(Clone, Debug, PartialEq, Eq)]
enum TrialStep {
    Idle,
    Checking(WantedConfig),
    /// It failed for this reason, and is checked again.
    Waiting(WantedConfig, String, Duration),
    StoringTrial(TrialRecord, WantedConfig),
    /// How it works before.
    Applying(TrialRecord, WantedConfig, TrialHealth),
    /// Whether it was written is not known: what was before comes back, and it waits.
    Undoing(TrialRecord, WantedConfig, String, Option<Duration>),
    /// Until when, and how it worked before.
    Trying(TrialRecord, Duration, TrialHealth),
    /// The text before is written.
    Restoring(TrialRecord, TrialEnd, Option<Duration>),
    /// The end of the trial is recorded.
    Recording(ManagedRecord, Option<Duration>),
    /// The record of the trial is deleted; then this one waits, for this reason.
    Removing(Option<(WantedConfig, String)>, Option<Duration>),
}

/// The configuration of one site, in one run of it.
#[derive(Debug)]
pub struct ConfigTrial {
    managed: ManagedRecord,
    file: ConfigText,
    /// How the site works, and when that was said.
    health: TrialHealth,
    health_at: Duration,
    /// Since when the file is as it is, as far as that counts for how the site works.
    steady: Option<Duration>,
    step: TrialStep,
    /// A later version that waits.
    next: Option<WantedConfig>,
    /// How often in a row it failed.
    failures: u32,
    outputs: VecDeque<TrialOutput>,
    due: Option<Duration>,
}

impl ConfigTrial {
    /// What is recorded, the file, and a trial that is not over: what drove it has ended, or the
    /// disk refused at the start of the site. It is taken back.
    #[must_use]
    pub fn new(
        managed: ManagedRecord,
        file: ConfigText,
        trial: Option<TrialRecord>,
    ) -> ConfigTrial {
        let at_once = Some(Duration::ZERO);
        let recovery = recover(&file, trial.as_ref(), &managed);
        let step = match (recovery, trial) {
            (Some(Recovery { is_back, managed }), Some(trial)) => match managed.verdict.clone() {
                Some(verdict) if is_back => TrialStep::Restoring(trial, verdict, at_once),
                _ => TrialStep::Recording(managed, at_once),
            },
            _ => TrialStep::Idle,
        };
        ConfigTrial {
            managed,
            file,
            health: TrialHealth::default(),
            health_at: Duration::ZERO,
            steady: None,
            step,
            next: None,
            failures: 0,
            outputs: VecDeque::new(),
            due: at_once,
        }
    }

    /// The report for the centre.
    #[must_use]
    pub fn report(&self) -> ConfigReport {
        let (phase, version, why) = match self.phase() {
            ConfigPhase::Unmanaged => (ConfigPhaseKind::Unmanaged, 0, None),
            ConfigPhase::Current(version) => (ConfigPhaseKind::Current, version, None),
            ConfigPhase::Pending(version, reason) => {
                let reason = TrialRefusal {
                    reason,
                    ..TrialRefusal::default()
                };
                (ConfigPhaseKind::Pending, version, Some(reason))
            }
            ConfigPhase::Trying(version) => (ConfigPhaseKind::Trying, version, None),
            ConfigPhase::LocalChange(version) => (ConfigPhaseKind::LocalChange, version, None),
            ConfigPhase::Ended(end) => {
                let kind = match end.kind() {
                    TrialEndKind::Refused => ConfigPhaseKind::Refused,
                    TrialEndKind::RolledBack => ConfigPhaseKind::RolledBack,
                    TrialEndKind::Interrupted => ConfigPhaseKind::Interrupted,
                    TrialEndKind::Unspecified => ConfigPhaseKind::Unspecified,
                };
                let TrialEnd {
                    version,
                    reason,
                    problem,
                    ..
                } = end;
                (kind, version, Some(TrialRefusal { reason, problem }))
            }
        };
        let TrialRefusal { reason, problem } = why.unwrap_or_default();
        let is_centres = match &self.step {
            TrialStep::Trying(record, ..)
            | TrialStep::Restoring(record, ..)
            | TrialStep::Undoing(record, ..) => self.file.hash == record.after_hash,
            TrialStep::Recording(record, _) => record.is_kept(&self.file),
            _ => self.managed.is_kept(&self.file),
        };
        ConfigReport {
            phase: phase.into(),
            version,
            kept: self.managed.kept,
            hash: self.file.hash.clone(),
            is_local: !is_centres,
            reason,
            problem,
        }
    }

    /// How far it is.
    #[must_use]
    pub fn phase(&self) -> ConfigPhase {
        match &self.step {
            // Not in force yet, as far as that is known.
            TrialStep::Checking(wanted)
            | TrialStep::StoringTrial(_, wanted)
            | TrialStep::Applying(_, wanted, _) => {
                ConfigPhase::Pending(wanted.version, String::new())
            }
            TrialStep::Waiting(wanted, why, _)
            | TrialStep::Undoing(_, wanted, why, _)
            | TrialStep::Removing(Some((wanted, why)), _) => {
                ConfigPhase::Pending(wanted.version, why.clone())
            }
            TrialStep::Trying(record, ..) | TrialStep::Restoring(record, ..) => {
                ConfigPhase::Trying(record.version)
            }
            // Until that is recorded, a restart takes it back.
            TrialStep::Recording(record, _) if record.kept > self.managed.kept => {
                ConfigPhase::Trying(record.kept)
            }
            TrialStep::Recording(record, _) => record.phase(&self.file),
            TrialStep::Idle | TrialStep::Removing(None, _) => match &self.next {
                Some(wanted) => ConfigPhase::Pending(wanted.version, String::new()),
                None => self.managed.phase(&self.file),
            },
        }
    }

    /// Who wants what is checked or applied.
    #[must_use]
    pub fn user(&self) -> &str {
        match &self.step {
            TrialStep::Checking(wanted)
            | TrialStep::Waiting(wanted, ..)
            | TrialStep::StoringTrial(_, wanted)
            | TrialStep::Applying(_, wanted, _)
            | TrialStep::Undoing(_, wanted, ..) => &wanted.user,
            TrialStep::Idle
            | TrialStep::Trying(..)
            | TrialStep::Restoring(..)
            | TrialStep::Recording(..)
            | TrialStep::Removing(..) => "",
        }
    }

    /// The file, as far as it is known here.
    #[must_use]
    pub const fn file(&self) -> &ConfigText {
        &self.file
    }

    /// Whether something is going on that depends on how the site works.
    #[must_use]
    pub const fn needs_health(&self) -> bool {
        match self.step {
            TrialStep::StoringTrial(..)
            | TrialStep::Applying(..)
            | TrialStep::Trying(..)
            | TrialStep::Waiting(..) => true,
            TrialStep::Idle => self.next.is_some(),
            TrialStep::Checking(_)
            | TrialStep::Undoing(..)
            | TrialStep::Restoring(..)
            | TrialStep::Recording(..)
            | TrialStep::Removing(..) => false,
        }
    }

    /// Something happened, at this time since the start.
    pub fn handle(&mut self, now: Duration, input: TrialInput) {
        self.due = Some(now);
        match input {
            TrialInput::Wanted(wanted) => {
                let newest = self.next.as_ref().map_or(0, |next| next.version);
                if wanted.version > newest.max(self.under_way()).max(self.managed.newest()) {
                    self.next = Some(wanted);
                }
            }
            TrialInput::Health(health) => {
                (self.health, self.health_at) = (health, now);
                self.steady.get_or_insert(now);
            }
            TrialInput::File(file) => self.is_now(now, file),
            TrialInput::Leave => {
                self.next = None;
                if let TrialStep::Trying(record, ..) = &self.step {
                    let why = "the integration was ended while it was tried";
                    self.take_back(record.clone(), why.to_owned());
                }
            }
            TrialInput::Done(done) => self.done(now, done),
        }
    }

    /// What is to be done at this time since the start.
    pub fn poll(&mut self, now: Duration) -> Option<TrialOutput> {
        if self.outputs.is_empty() && self.due.is_some_and(|due| due <= now) {
            self.due = self.step(now);
        }
        self.outputs.pop_front()
    }

    /// When it goes on by itself.
    #[must_use]
    pub const fn deadline(&self) -> Option<Duration> {
        self.due
    }

    /// The version that is under way.
    fn under_way(&self) -> u64 {
        match &self.step {
            TrialStep::Idle | TrialStep::Removing(None, _) => 0,
            TrialStep::Recording(record, _) => record.newest(),
            TrialStep::Checking(wanted)
            | TrialStep::Waiting(wanted, ..)
            | TrialStep::Removing(Some((wanted, _)), _) => wanted.version,
            TrialStep::StoringTrial(record, _)
            | TrialStep::Applying(record, ..)
            | TrialStep::Undoing(record, ..)
            | TrialStep::Trying(record, ..)
            | TrialStep::Restoring(record, ..) => record.version,
        }
    }

    /// The file is this one now. How the site works is to be seen again.
    fn is_now(&mut self, now: Duration, file: ConfigText) {
        if self.file != file {
            self.steady = Some(now);
        }
        self.file = file;
    }

    /// Does what is due; when something is next.
    fn step(&mut self, now: Duration) -> Option<Duration> {
        let settles = self.settles_at(now);
        match &mut self.step {
            // A later version takes the place of one that failed.
            TrialStep::Idle | TrialStep::Waiting(..) if self.next.is_some() => {
                if settles.is_some() {
                    return settles;
                }
                let wanted = self.next.take()?;
                self.failures = 0;
                self.check(wanted);
                None
            }
            TrialStep::Waiting(wanted, _, due) if *due <= now => {
                if settles.is_some() {
                    return settles;
                }
                let wanted = wanted.clone();
                self.check(wanted);
                None
            }
            TrialStep::Waiting(_, _, due) => Some(*due),
            // What was changed here during the trial stays; it was not proven.
            TrialStep::Trying(record, ..) if self.file.hash != record.after_hash => {
                let verdict = interrupted(record.version);
                self.record(self.managed.with(verdict));
                None
            }
            TrialStep::Trying(record, until, before) => {
                let panicked = self.health.panics > before.panics;
                // Not by what was said before: the machine may have been suspended since.
                let is_over = self.health_at >= *until && self.health.lines_lent.is_empty();
                if !panicked && !is_over {
                    return None;
                }
                let (record, before) = (record.clone(), before.clone());
                self.judge(record, &before);
                None
            }
            TrialStep::Restoring(record, _, again) | TrialStep::Undoing(record, _, _, again)
                if is_due(*again, now) =>
            {
                *again = None;
                let (from, to) = (record.after.clone(), record.before.clone());
                self.outputs.push_back(TrialOutput::TakeBack(from, to));
                None
            }
            TrialStep::Recording(record, again) if is_due(*again, now) => {
                *again = None;
                let record = record.clone();
                self.outputs.push_back(TrialOutput::StoreManaged(record));
                None
            }
            TrialStep::Removing(_, again) if is_due(*again, now) => {
                *again = None;
                self.outputs.push_back(TrialOutput::RemoveTrial);
                None
            }
            TrialStep::Restoring(_, _, again)
            | TrialStep::Undoing(_, _, _, again)
            | TrialStep::Recording(_, again)
            | TrialStep::Removing(_, again) => *again,
            _ => None,
        }
    }

    /// When the site works as it did before, at the latest; none if it does. A line
    /// under exclusive access can't be judged.
    fn settles_at(&self, now: Duration) -> Option<Duration> {
        let TrialHealth {
            lines,
            lines_up,
            lines_lent,
            modules,
            modules_online,
            ..
        } = &self.health;
        let is_whole = lines.is_subset(lines_up) && modules.is_subset(modules_online);
        match self.steady {
            _ if !lines_lent.is_empty() => Some(now + AGAIN),
            Some(steady) => Some(steady + SETTLES).filter(|at| !is_whole && now < *at),
            // Nothing was said of it yet.
            None => Some(now + AGAIN),
        }
    }

    fn check(&mut self, wanted: WantedConfig) {
        let (file, text) = (self.file.text.clone(), wanted.text.clone());
        self.outputs.push_back(TrialOutput::Check(file, text));
        self.step = TrialStep::Checking(wanted);
    }

    /// It waits until it is tried again: twice as long after each time.
    fn waits(&mut self, now: Duration, wanted: WantedConfig, why: String) {
        let wait = AGAIN * (1 << self.failures.min(LONGER_MAX));
        self.failures = self.failures.saturating_add(1);
        self.step = TrialStep::Waiting(wanted, why, now + wait);
    }

    /// The time of a trial is over, or something panicked.
    fn judge(&mut self, record: TrialRecord, before: &TrialHealth) {
        match fault(before, &self.health) {
            None => self.record(self.managed.kept(record.version, record.after_hash)),
            Some(why) => self.take_back(record, why),
        }
    }

    fn take_back(&mut self, record: TrialRecord, why: String) {
        let verdict = TrialEnd {
            version: record.version,
            kind: TrialEndKind::RolledBack.into(),
            reason: why,
            problem: Vec::new(),
        };
        let (from, to) = (record.after.clone(), record.before.clone());
        self.outputs.push_back(TrialOutput::TakeBack(from, to));
        self.step = TrialStep::Restoring(record, verdict, None);
    }

    fn record(&mut self, record: ManagedRecord) {
        self.outputs
            .push_back(TrialOutput::StoreManaged(record.clone()));
        self.step = TrialStep::Recording(record, None);
    }

    fn refuse(&mut self, version: u64, why: TrialRefusal) {
        let TrialRefusal { reason, problem } = why;
        let verdict = TrialEnd {
            version,
            kind: TrialEndKind::Refused.into(),
            reason,
            problem,
        };
        self.record(self.managed.with(verdict));
    }

    /// It is not in the file: the record of its trial is deleted, and it waits.
    fn again(&mut self, wanted: WantedConfig, why: String) {
        self.outputs.push_back(TrialOutput::RemoveTrial);
        self.step = TrialStep::Removing(Some((wanted, why)), None);
    }

    fn done(&mut self, now: Duration, done: TrialDone) {
        let step = std::mem::replace(&mut self.step, TrialStep::Idle);
        match (step, done) {
            (TrialStep::Checking(wanted), TrialDone::Checked(after)) => self.checked(wanted, after),
            (TrialStep::Checking(wanted), TrialDone::Refused(why)) => {
                self.refuse(wanted.version, why);
            }
            (TrialStep::Checking(wanted), TrialDone::Changed(file)) => {
                self.is_now(now, file);
                // It may have to settle first.
                self.step = TrialStep::Waiting(wanted, String::new(), now);
            }
            (
                TrialStep::Checking(wanted) | TrialStep::StoringTrial(_, wanted),
                TrialDone::Failed(why),
            ) => self.waits(now, wanted, why),
            (TrialStep::StoringTrial(record, wanted), TrialDone::Ok) => {
                let (from, to) = (record.before.clone(), record.after.clone());
                self.outputs.push_back(TrialOutput::Apply(from, to));
                self.step = TrialStep::Applying(record, wanted, self.health.clone());
            }
            (TrialStep::Applying(record, _, before), TrialDone::Ok) => {
                self.file = ConfigText {
                    text: record.after.clone(),
                    hash: record.after_hash.clone(),
                };
                self.step = TrialStep::Trying(record, now + TRIAL, before);
            }
            (TrialStep::Applying(_, wanted, _), TrialDone::Refused(why)) => {
                self.refuse(wanted.version, why);
            }
            // Somebody changed it here meanwhile: it is checked against that.
            (TrialStep::Applying(_, wanted, _), TrialDone::Changed(file)) => {
                self.is_now(now, file);
                self.again(wanted, String::new());
            }
            (TrialStep::Applying(record, wanted, _), TrialDone::Failed(why)) => {
                let (from, to) = (record.after.clone(), record.before.clone());
                self.outputs.push_back(TrialOutput::TakeBack(from, to));
                self.step = TrialStep::Undoing(record, wanted, why, None);
            }
            (
                TrialStep::Undoing(_, wanted, why, None),
                TrialDone::Back(file) | TrialDone::Changed(file),
            ) => {
                self.is_now(now, file);
                self.again(wanted, why);
            }
            (TrialStep::Undoing(record, wanted, why, None), _) => {
                self.step = TrialStep::Undoing(record, wanted, why, Some(now + AGAIN));
            }
            (TrialStep::Restoring(_, verdict, None), TrialDone::Back(file)) => {
                self.is_now(now, file);
                self.record(self.managed.with(verdict));
            }
            // It is back already, or was changed at the site: the change is kept.
            (TrialStep::Restoring(record, verdict, None), TrialDone::Changed(file)) => {
                let is_back = file.hash == record.before_hash;
                self.is_now(now, file);
                self.record(self.managed.with(match is_back {
                    true => verdict,
                    false => interrupted(record.version),
                }));
            }
            (TrialStep::Restoring(record, verdict, None), _) => {
                self.step = TrialStep::Restoring(record, verdict, Some(now + AGAIN));
            }
            (TrialStep::Recording(record, None), TrialDone::Ok) => {
                self.managed = record;
                self.outputs.push_back(TrialOutput::RemoveTrial);
                self.step = TrialStep::Removing(None, None);
            }
            (TrialStep::Recording(record, None), _) => {
                self.step = TrialStep::Recording(record, Some(now + AGAIN));
            }
            (TrialStep::Removing(waits, None), TrialDone::Ok) => {
                if let Some((wanted, why)) = waits {
                    self.waits(now, wanted, why);
                }
            }
            (TrialStep::Removing(waits, None), _) => {
                self.step = TrialStep::Removing(waits, Some(now + AGAIN));
            }
            // A result that nothing waits for.
            (step, _) => self.step = step,
        }
    }

    /// The file would be this one.
    fn checked(&mut self, wanted: WantedConfig, after: ConfigText) {
        // It is so already: there is nothing to try. A version whose trial was left has its end.
        if after.hash == self.file.hash {
            return self.record(self.managed.kept(wanted.version, after.hash));
        }
        if !self.managed.may_be_replaced(&self.file, &wanted.replaces) {
            let reason = "the configuration was changed at the site".to_owned();
            let problem = Vec::new();
            return self.refuse(wanted.version, TrialRefusal { reason, problem });
        }
        let record = TrialRecord {
            version: wanted.version,
            before: self.file.text.clone(),
            after: after.text,
            before_hash: self.file.hash.clone(),
            after_hash: after.hash,
        };
        self.outputs
            .push_back(TrialOutput::StoreTrial(record.clone()));
        self.step = TrialStep::StoringTrial(record, wanted);
    }
}

/// Whether it is to be tried again by now.
fn is_due(again: Option<Duration>, now: Duration) -> bool {
    again.is_some_and(|due| due <= now)
}

/// What works no longer as it did before; none if all does.
fn fault(before: &TrialHealth, now: &TrialHealth) -> Option<String> {
    if now.panics > before.panics {
        return Some("a part of the program panicked".to_owned());
    }
    // What is not configured any more is not missing.
    let lost = |were: &BTreeSet<String>, are: &BTreeSet<String>, known: &BTreeSet<String>| {
        let mut gone = were.iter().filter(|name| known.contains(*name));
        gone.find(|name| !are.contains(*name)).cloned()
    };
    if let Some(line) = lost(&before.lines_up, &now.lines_up, &now.lines) {
        return Some(format!("line {line} is not open any more"));
    }
    if let Some(module) = lost(&before.modules_online, &now.modules_online, &now.modules) {
        return Some(format!("module {module} does not answer any more"));
    }
    (!now.has_session).then(|| "there is no session with the centre".to_owned())
}

#[cfg(test)]
mod tests;
