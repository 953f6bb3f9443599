//! What is on the disk about a configuration from the centre, and what a start makes of it.

use super::{ConfigPhase, ConfigText};
use sha2::{Digest as _, Sha256};

/// A trial that is not over. It is on the disk before the file is changed.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct TrialRecord {
    /// The version that is tried.
    #[prost(uint64, tag = "1")]
    pub version: u64,
    /// The text of the file before.
    #[prost(string, tag = "2")]
    pub before: String,
    /// Its text now, or soon.
    #[prost(string, tag = "3")]
    pub after: String,
    /// [`part_hash`] of what the centre may say in the text before.
    #[prost(bytes = "vec", tag = "4")]
    pub before_hash: Vec<u8>,
    /// The same of the text now.
    #[prost(bytes = "vec", tag = "5")]
    pub after_hash: Vec<u8>,
}

/// What became of the configurations that the centre wanted so far.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct ManagedRecord {
    /// The version that was kept last; 0 if none was.
    #[prost(uint64, tag = "1")]
    pub kept: u64,
    /// [`part_hash`] of what it says.
    #[prost(bytes = "vec", tag = "2")]
    pub hash: Vec<u8>,
    /// What became of a later one, if it was not kept.
    #[prost(message, optional, tag = "3")]
    pub verdict: Option<TrialEnd>,
    /// The key of the centre, as the settings have it. What another one wanted counts no more.
    #[prost(string, tag = "4")]
    pub key: String,
}

/// Why a version was not kept.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct TrialEnd {
    /// The version.
    #[prost(uint64, tag = "1")]
    pub version: u64,
    /// How it ended.
    #[prost(enumeration = "TrialEndKind", tag = "2")]
    pub kind: i32,
    /// Why, in English.
    #[prost(string, tag = "3")]
    pub reason: String,
    /// The problem as the API has it, in JSON; empty if there is none.
    #[prost(bytes = "vec", tag = "4")]
    pub problem: Vec<u8>,
}

/// How a version ended that was not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum TrialEndKind {
    /// One of a newer version of railbus.
    Unspecified = 0,
    /// It was never applied.
    Refused = 1,
    /// It was tried, and the text before came back.
    RolledBack = 2,
    /// The file was changed at the site while it was tried.
    Interrupted = 3,
}

impl ManagedRecord {
    /// The latest version of which the end is known.
    pub(super) fn newest(&self) -> u64 {
        let other = self.verdict.as_ref().map_or(0, |verdict| verdict.version);
        self.kept.max(other)
    }

    /// The same, and this version is kept.
    pub(super) fn kept(&self, version: u64, hash: Vec<u8>) -> ManagedRecord {
        ManagedRecord {
            kept: version,
            hash,
            verdict: None,
            key: self.key.clone(),
        }
    }

    /// The record for a centre with this key. One that has none yet is of the first trial, which
    /// was left.
    #[must_use]
    pub fn of(self, key: &str) -> ManagedRecord {
        let is_its = self.key.is_empty() || self.key == key;
        let kept = if is_its {
            self
        } else {
            ManagedRecord::default()
        };
        ManagedRecord {
            key: key.to_owned(),
            ..kept
        }
    }

    /// Whether the file says what was kept last.
    pub(super) fn is_kept(&self, file: &ConfigText) -> bool {
        self.kept > 0 && self.hash == file.hash
    }

    /// Whether a text of the centre may take the place of the file: that is the centre's, or is the
    /// one that was looked at there, of this hash, or is that of a new site and says nothing.
    pub(super) fn may_be_replaced(&self, file: &ConfigText, seen: &[u8]) -> bool {
        let is_new = self.kept == 0 && file.hash == part_hash("");
        self.is_kept(file) || file.hash == seen || is_new
    }

    /// The same, and this one was not.
    pub(super) fn with(&self, verdict: TrialEnd) -> ManagedRecord {
        ManagedRecord {
            verdict: Some(verdict),
            ..self.clone()
        }
    }

    /// How far it is, where the file has this text.
    pub(super) fn phase(&self, file: &ConfigText) -> ConfigPhase {
        match &self.verdict {
            Some(verdict) => ConfigPhase::Ended(verdict.clone()),
            None if self.kept == 0 => ConfigPhase::Unmanaged,
            None if self.is_kept(file) => ConfigPhase::Current(self.kept),
            None => ConfigPhase::LocalChange(self.kept),
        }
    }
}

/// The hash of a part of the file.
#[must_use]
pub fn part_hash(part: &str) -> Vec<u8> {
    Sha256::digest(part.as_bytes()).to_vec()
}

/// What is to be done at the start, in this order, before the file is used: what the centre may say
/// in it is replaced by that of the text before, the record stored, and the record of the trial
/// deleted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovery {
    /// The text before comes back.
    pub is_back: bool,
    /// What is to be stored, and counts from now on.
    pub managed: ManagedRecord,
}

/// What a start finds: the file, a trial that was not over, and what is recorded. None if there was
/// no trial.
#[must_use]
pub fn recover(
    file: &ConfigText,
    trial: Option<&TrialRecord>,
    managed: &ManagedRecord,
) -> Option<Recovery> {
    let trial = trial?;
    let as_it_is = |managed: ManagedRecord| {
        Some(Recovery {
            is_back: false,
            managed,
        })
    };
    // Its end is recorded: only the record of the trial was left. Or it was not written yet, or is
    // written no longer: the centre may want it again.
    if managed.newest() >= trial.version || file.hash == trial.before_hash {
        return as_it_is(managed.clone());
    }
    // It was changed at the site: the change is kept.
    if file.hash != trial.after_hash {
        return as_it_is(managed.with(interrupted(trial.version)));
    }
    let verdict = TrialEnd {
        version: trial.version,
        kind: TrialEndKind::RolledBack.into(),
        reason: "the site was restarted while it was tried".to_owned(),
        problem: Vec::new(),
    };
    Some(Recovery {
        is_back: true,
        managed: managed.with(verdict),
    })
}

/// The end of a version that was changed at the site while it was tried.
pub(super) fn interrupted(version: u64) -> TrialEnd {
    TrialEnd {
        version,
        kind: TrialEndKind::Interrupted.into(),
        reason: "the configuration was changed at the site while it was tried".to_owned(),
        problem: Vec::new(),
    }
}
