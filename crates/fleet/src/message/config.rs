//! What a site says of its configuration.

use super::FleetRefusal;
use prost::Message as _;

/// The longest report, in bytes: the centre has one of each site in memory.
const REPORT_MAX: usize = 8 << 10;
/// The longest reason in one, in bytes, and the longest problem.
const REASON_MAX: usize = 1 << 10;
const PROBLEM_MAX: usize = 4 << 10;

/// How far the configuration of a site is.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct ConfigReport {
    /// How far.
    #[prost(enumeration = "ConfigPhaseKind", tag = "1")]
    pub phase: i32,
    /// Of which version this is said; 0 of none.
    #[prost(uint64, tag = "2")]
    pub version: u64,
    /// The version that was kept last; 0 if none was.
    #[prost(uint64, tag = "3")]
    pub kept: u64,
    /// The SHA-256 of what the file says, without what only the site itself says.
    #[prost(bytes = "vec", tag = "4")]
    pub hash: Vec<u8>,
    /// That is neither what was kept last nor what is tried.
    #[prost(bool, tag = "5")]
    pub is_local: bool,
    /// Why it is so, in English; empty if there is nothing to say.
    #[prost(string, tag = "6")]
    pub reason: String,
    /// The problem as the API of the site has it, in JSON; empty if there is none.
    #[prost(bytes = "vec", tag = "7")]
    pub problem: Vec<u8>,
}

impl ConfigReport {
    /// The same, short enough to be sent.
    #[must_use]
    pub fn shortened(mut self) -> ConfigReport {
        // Half a problem could not be read.
        if self.problem.len() > PROBLEM_MAX {
            self.problem.clear();
        }
        if let Some((end, _)) = self.reason.char_indices().find(|(at, _)| *at > REASON_MAX) {
            self.reason.truncate(end);
        }
        self
    }

    /// Whether it is not longer than any that is sent.
    pub(crate) fn is_short(&self) -> bool {
        self.encoded_len() <= REPORT_MAX
    }
}

/// How far a configuration is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ConfigPhaseKind {
    /// One of a newer version of railbus.
    Unspecified = 0,
    /// The centre has wanted none so far.
    Unmanaged = 1,
    /// It is kept.
    Current = 2,
    /// It waits: another one is tried, or the disk refuses.
    Pending = 3,
    /// It is tried.
    Trying = 4,
    /// It was never applied.
    Refused = 5,
    /// It was tried, and the text before came back.
    RolledBack = 6,
    /// The file was changed at the site since it was kept.
    LocalChange = 7,
    /// The file was changed at the site while it was tried.
    Interrupted = 8,
}

/// The answer where the centre asks for the configuration of a site.
#[derive(Clone, PartialEq, prost::Message)]
pub struct ConfigAnswer {
    /// None where there is one.
    #[prost(message, optional, tag = "1")]
    pub refusal: Option<FleetRefusal>,
    /// What the file says, without what only the site itself says.
    #[prost(string, tag = "2")]
    pub text: String,
    /// Its SHA-256.
    #[prost(bytes = "vec", tag = "3")]
    pub hash: Vec<u8>,
}
