//! A configuration from the centre, tried at a site, without I/O: it is kept only if the site works
//! with it as before, and otherwise the one before comes back, also after a loss of power.
//!
//! Before the file is replaced, both texts are on the disk as a [`TrialRecord`]. It is there until
//! the end of the trial is recorded, so that a start that finds it knows what is left to do
//! ([`recover`]). Every write is one of a whole file. docs/decisions/0063

mod record;

pub use record::{ManagedRecord, Recovery, TrialEnd, TrialEndKind, TrialRecord, recover};
use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

/// How long a configuration is tried.
pub const TRIAL: Duration = Duration::from_secs(120);
/// How long until a write that failed is tried again.
const AGAIN: Duration = Duration::from_secs(5);

/// A configuration that the centre wants here. Its signature and its site were checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WantedConfig {
    /// Its version: a later one is higher.
    pub version: u64,
    /// The whole text of the file.
    pub text: String,
}

/// How the site works.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrialHealth {
    /// The lines that are configured.
    pub lines: BTreeSet<String>,
    /// Those of them whose port is open.
    pub lines_up: BTreeSet<String>,
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
    /// The text of the file, if it was changed here.
    File(String),
    /// The result of the last output.
    Done(TrialDone),
}

/// The result of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrialDone {
    /// Done.
    Ok,
    /// The configuration is not accepted, for this reason, with line and column if it has them. The
    /// file is as before.
    Refused(String),
    /// The disk refuses, for this reason. The file is as before.
    Failed(String),
    /// The file has another text than the one that was to be replaced, and is left as it is.
    Changed(String),
}

/// What is to be done, one at a time; each has a result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrialOutput {
    /// Check this text, as it would stand in the file, against the one that is there.
    Check(String),
    /// Store this durably.
    StoreTrial(TrialRecord),
    /// Replace the first text by the second in the file, durably, and apply it.
    Apply(String, String),
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

/// What is going on.
#[derive(Clone, Debug, PartialEq, Eq)]
enum TrialStep {
    Idle,
    Checking(WantedConfig),
    /// The disk refuses it, for this reason; until when.
    Waiting(WantedConfig, String, Duration),
    StoringTrial(TrialRecord),
    Applying(TrialRecord, TrialHealth),
    /// Until when, and how it worked before.
    Trying(TrialRecord, Duration, TrialHealth),
    /// The text before is written; or when that is tried again.
    Restoring(TrialRecord, TrialEnd, Option<Duration>),
    /// The end of the trial is recorded; or when that is tried again.
    Recording(ManagedRecord, Option<Duration>),
    /// The record of the trial is deleted; or when that is tried again.
    Removing(Option<Duration>),
}

/// The configuration of one site, in one run of it.
#[derive(Debug)]
pub struct ConfigTrial {
    managed: ManagedRecord,
    /// The text of the file.
    file: String,
    /// How the site works, and when that was said.
    health: TrialHealth,
    health_at: Duration,
    step: TrialStep,
    /// A later version that waits.
    next: Option<WantedConfig>,
    /// One that the disk did not take, for this reason.
    failed: Option<(WantedConfig, String)>,
    outputs: VecDeque<TrialOutput>,
    due: Option<Duration>,
}

impl ConfigTrial {
    /// After [`recover`]: what is recorded, and the text of the file.
    #[must_use]
    pub const fn new(managed: ManagedRecord, file: String) -> ConfigTrial {
        ConfigTrial {
            managed,
            file,
            health: TrialHealth {
                lines: BTreeSet::new(),
                lines_up: BTreeSet::new(),
                modules: BTreeSet::new(),
                modules_online: BTreeSet::new(),
                has_session: false,
                panics: 0,
            },
            health_at: Duration::ZERO,
            step: TrialStep::Idle,
            next: None,
            failed: None,
            outputs: VecDeque::new(),
            due: None,
        }
    }

    /// How far it is.
    #[must_use]
    pub fn phase(&self) -> ConfigPhase {
        match &self.step {
            TrialStep::Checking(wanted) => ConfigPhase::Pending(wanted.version, String::new()),
            TrialStep::Waiting(wanted, why, _) => ConfigPhase::Pending(wanted.version, why.clone()),
            TrialStep::StoringTrial(record)
            | TrialStep::Applying(record, _)
            | TrialStep::Trying(record, ..)
            | TrialStep::Restoring(record, ..) => ConfigPhase::Trying(record.version),
            TrialStep::Idle | TrialStep::Recording(..) | TrialStep::Removing(_) => {
                match &self.failed {
                    Some((wanted, why)) => ConfigPhase::Pending(wanted.version, why.clone()),
                    None => self.managed.phase(&self.file),
                }
            }
        }
    }

    /// The text of the file, as far as it is known here.
    #[must_use]
    pub fn file(&self) -> &str {
        &self.file
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
            TrialInput::Health(health) => (self.health, self.health_at) = (health, now),
            TrialInput::File(text) => self.file = text,
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
            TrialStep::Recording(record, _) => record.newest(),
            TrialStep::Idle | TrialStep::Removing(_) => {
                self.failed.as_ref().map_or(0, |(wanted, _)| wanted.version)
            }
            TrialStep::Checking(wanted) | TrialStep::Waiting(wanted, ..) => wanted.version,
            TrialStep::StoringTrial(record)
            | TrialStep::Applying(record, _)
            | TrialStep::Trying(record, ..)
            | TrialStep::Restoring(record, ..) => record.version,
        }
    }

    /// Does what is due; when something is next.
    fn step(&mut self, now: Duration) -> Option<Duration> {
        match &mut self.step {
            // A later version takes the place of one that could not be written.
            TrialStep::Idle | TrialStep::Waiting(..) if self.next.is_some() => {
                let wanted = self.next.take()?;
                self.check(wanted);
                None
            }
            TrialStep::Waiting(wanted, _, due) if *due <= now => {
                let wanted = wanted.clone();
                self.check(wanted);
                None
            }
            TrialStep::Waiting(_, _, due) => Some(*due),
            TrialStep::Trying(record, until, before) => {
                let panicked = self.health.panics > before.panics;
                // Not by what was said before: the machine may have been suspended since.
                if !panicked && self.health_at < *until {
                    return None;
                }
                let (record, before) = (record.clone(), before.clone());
                self.judge(record, &before);
                None
            }
            TrialStep::Restoring(record, _, again) if again.is_some_and(|due| due <= now) => {
                *again = None;
                let (from, to) = (record.after.clone(), record.before.clone());
                self.outputs.push_back(TrialOutput::Apply(from, to));
                None
            }
            TrialStep::Recording(record, again) if again.is_some_and(|due| due <= now) => {
                *again = None;
                let record = record.clone();
                self.outputs.push_back(TrialOutput::StoreManaged(record));
                None
            }
            TrialStep::Removing(again) if again.is_some_and(|due| due <= now) => {
                *again = None;
                self.outputs.push_back(TrialOutput::RemoveTrial);
                None
            }
            TrialStep::Restoring(_, _, again)
            | TrialStep::Recording(_, again)
            | TrialStep::Removing(again) => *again,
            _ => None,
        }
    }

    fn check(&mut self, wanted: WantedConfig) {
        self.outputs
            .push_back(TrialOutput::Check(wanted.text.clone()));
        self.step = TrialStep::Checking(wanted);
    }

    /// The time of a trial is over, or something panicked.
    fn judge(&mut self, record: TrialRecord, before: &TrialHealth) {
        match fault(before, &self.health) {
            None => self.record(self.managed.kept(record.version, &record.after)),
            Some(why) => self.take_back(record, why),
        }
    }

    fn take_back(&mut self, record: TrialRecord, why: String) {
        let verdict = TrialEnd {
            version: record.version,
            kind: TrialEndKind::RolledBack.into(),
            reason: why,
        };
        let (from, to) = (record.after.clone(), record.before.clone());
        self.outputs.push_back(TrialOutput::Apply(from, to));
        self.step = TrialStep::Restoring(record, verdict, None);
    }

    fn record(&mut self, record: ManagedRecord) {
        self.outputs
            .push_back(TrialOutput::StoreManaged(record.clone()));
        self.step = TrialStep::Recording(record, None);
    }

    fn refuse(&mut self, version: u64, reason: String) {
        let kind = TrialEndKind::Refused.into();
        let verdict = TrialEnd {
            version,
            kind,
            reason,
        };
        self.record(self.managed.with(verdict));
    }

    fn done(&mut self, now: Duration, done: TrialDone) {
        let step = std::mem::replace(&mut self.step, TrialStep::Idle);
        match (step, done) {
            (TrialStep::Checking(wanted), TrialDone::Ok) => {
                // It is so already: there is nothing to try.
                if wanted.text == self.file {
                    return self.record(self.managed.kept(wanted.version, &wanted.text));
                }
                let record = TrialRecord {
                    version: wanted.version,
                    before: self.file.clone(),
                    after: wanted.text,
                };
                self.outputs
                    .push_back(TrialOutput::StoreTrial(record.clone()));
                self.step = TrialStep::StoringTrial(record);
            }
            (TrialStep::Checking(wanted), TrialDone::Refused(why)) => {
                self.refuse(wanted.version, why);
            }
            (TrialStep::Checking(wanted), TrialDone::Changed(text)) => {
                self.file = text;
                self.check(wanted);
            }
            (TrialStep::Checking(wanted), TrialDone::Failed(why)) => {
                self.step = TrialStep::Waiting(wanted, why, now + AGAIN);
            }
            (TrialStep::StoringTrial(record), TrialDone::Ok) => {
                let (from, to) = (record.before.clone(), record.after.clone());
                self.outputs.push_back(TrialOutput::Apply(from, to));
                self.step = TrialStep::Applying(record, self.health.clone());
            }
            (TrialStep::StoringTrial(record), TrialDone::Failed(why)) => {
                let TrialRecord { version, after, .. } = record;
                let wanted = WantedConfig {
                    version,
                    text: after,
                };
                self.step = TrialStep::Waiting(wanted, why, now + AGAIN);
            }
            (TrialStep::Applying(record, before), TrialDone::Ok) => {
                self.file.clone_from(&record.after);
                self.step = TrialStep::Trying(record, now + TRIAL, before);
            }
            (TrialStep::Applying(record, _), TrialDone::Refused(why)) => {
                self.refuse(record.version, why);
            }
            // Somebody changed it here meanwhile: it is checked against that.
            (TrialStep::Applying(record, _), TrialDone::Changed(text)) => {
                self.file = text;
                self.again(record, String::new());
            }
            (TrialStep::Applying(record, _), TrialDone::Failed(why)) => self.again(record, why),
            (TrialStep::Restoring(record, verdict, None), TrialDone::Ok) => {
                self.file = record.before;
                self.record(self.managed.with(verdict));
            }
            // Somebody changed it here: that is what counts.
            (TrialStep::Restoring(_, verdict, None), TrialDone::Changed(text)) => {
                self.file = text;
                self.record(self.managed.with(verdict));
            }
            (
                TrialStep::Restoring(record, verdict, None),
                TrialDone::Failed(_) | TrialDone::Refused(_),
            ) => self.step = TrialStep::Restoring(record, verdict, Some(now + AGAIN)),
            (TrialStep::Recording(record, None), TrialDone::Ok) => {
                self.managed = record;
                self.outputs.push_back(TrialOutput::RemoveTrial);
                self.step = TrialStep::Removing(None);
            }
            (TrialStep::Recording(record, None), _) => {
                self.step = TrialStep::Recording(record, Some(now + AGAIN));
            }
            (TrialStep::Removing(None), TrialDone::Ok) => {
                if let Some((wanted, why)) = self.failed.take() {
                    self.step = TrialStep::Waiting(wanted, why, now + AGAIN);
                }
            }
            (TrialStep::Removing(None), _) => {
                self.step = TrialStep::Removing(Some(now + AGAIN));
            }
            // A result that nothing waits for.
            (step, _) => self.step = step,
        }
    }

    /// It was not written: it waits, without the record of its trial.
    fn again(&mut self, record: TrialRecord, why: String) {
        let TrialRecord { version, after, .. } = record;
        let wanted = WantedConfig {
            version,
            text: after,
        };
        self.failed = Some((wanted, why));
        self.outputs.push_back(TrialOutput::RemoveTrial);
        self.step = TrialStep::Removing(None);
    }
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
