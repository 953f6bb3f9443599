//! What takes its time: scans and changes of settings, as the API tells of them.

use super::problem::Problem;
use super::settings::SettingsRun;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// `POST /api/v1/scans`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ScanRequest {
    /// The lines; may be left out where there is only one.
    #[serde(default)]
    pub lines: Vec<String>,
    /// How far it goes.
    #[serde(default)]
    pub depth: ScanDepth,
    /// Only these: `rtu`, `ascii`, `lc02`, `r55`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocols: Option<Vec<String>>,
    /// Only at these speeds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bauds: Option<Vec<u32>>,
    /// Only these addresses: `1-32,64`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub addresses: Option<String>,
}

/// How far a scan goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScanDepth {
    /// The line's own speed, addresses 1 to 32.
    #[default]
    Quick,
    /// One speed, all addresses.
    Full,
    /// Five speeds, all addresses.
    Deep,
}

/// Something was begun.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct OpBegun {
    /// Its number, for `GET /api/v1/ops/{op}`.
    pub op: String,
}

/// `GET /api/v1/ops`: what runs, and what ended lately; oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Ops {
    /// The version of the API.
    pub schema: u8,
    /// The oldest first.
    pub ops: Vec<OpInfo>,
}

/// Something that takes its time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OpInfo {
    /// Its number.
    pub op: String,
    /// What it is: `scan`, `settings`, `calibration`, `recovery`.
    pub kind: String,
    /// The lines it is on.
    pub lines: Vec<String>,
    /// Who began it.
    pub who: String,
    /// When it began.
    pub started: String,
    /// How it is.
    pub state: OpState,
    /// How much of it is done.
    pub done: u64,
    /// How much there is in all.
    pub total: u64,
    /// The same in percent.
    pub percent: f64,
    /// How many modules were found so far.
    pub found: u64,
    /// How long the rest takes, about.
    pub left_ms: u64,
    /// How long it was thought to take.
    pub estimate_ms: u64,
    /// What was found so far.
    pub result: ScanResult,
    /// What is changed, where settings are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings: Option<SettingsRun>,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}

/// How an operation is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OpState {
    /// It is under way.
    #[default]
    Running,
    /// It came to its end.
    Done,
    /// Somebody ended it before.
    Cancelled,
    /// It could not go on.
    Failed,
}

/// What a scan found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanResult {
    /// Everyone who answered.
    pub modules: Vec<ScanModule>,
    /// Everyone was asked.
    pub complete: bool,
    /// The places at which two modules may be, or somebody whose replies are spoilt.
    pub conflicts: Vec<ScanPlace>,
    /// Modules of the configuration that were asked and did not answer.
    pub missing: Vec<String>,
    /// Lines on which modules were found only by a longer wait: others may be missing.
    pub slow: Vec<String>,
    /// Who was not asked.
    pub left_out: Vec<ScanLeftOut>,
}

/// A module that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanModule {
    /// The line it hangs on.
    pub line: String,
    /// Its address.
    pub address: u8,
    /// The protocol it speaks: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// What the configuration would call its model; none where that is not known.
    pub model: Option<String>,
    /// What it says it is, or is known by.
    pub title: String,
    /// It is known by how it behaves, and refuses; it does not say what it is.
    pub by_behaviour: bool,
    /// The models that it could be, where nothing proves one; `model` is none then.
    pub could_be: Vec<String>,
    /// Its speed.
    pub baud: u32,
    /// Its character format, as `8N1`.
    pub format: String,
    /// Whether its ASCII frames carry a checksum; none in other protocols.
    pub checksum: Option<bool>,
    /// From the end of a request to the beginning of its reply.
    pub rtt_ms: f64,
    /// What its answers amount to: `ok`, `could_be` one of several models, `refused`, `odd` (no
    /// model that is known), `garbled`.
    pub verdict: String,
    /// What it was asked, and what it answered.
    pub evidence: Vec<String>,
    /// Its name in the configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The configuration says that it is another model.
    pub differs: bool,
    /// A free name for it, where it is new and known well enough to be added.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suggest: Option<String>,
}

/// Where something is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanPlace {
    /// The line.
    pub line: String,
    /// The address.
    pub address: u8,
    /// The protocol in which it was heard.
    pub protocol: String,
    /// At which speed.
    pub baud: u32,
}

/// A part of a scan that was not done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanLeftOut {
    /// The line.
    pub line: String,
    /// The protocol.
    pub protocol: String,
    /// At which speed.
    pub baud: u32,
    /// In which format.
    pub format: String,
    /// Who was not asked: `1-32,64`.
    pub addresses: String,
}

/// `POST /api/v1/ops/{op}/answer`: the answer to what an operation asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct OpAnswer {
    /// Go on; otherwise it ends there.
    pub go: bool,
}
