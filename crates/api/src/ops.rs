//! Operations that take a while: scans and changes of settings.

use super::problem::Problem;
use super::settings::SettingsRun;
use super::words::ScanVerdict;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// `POST /api/v1/scans`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ScanRequest {
    /// The lines; optional if there is only one.
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

/// An operation was started.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct OpBegun {
    /// Its ID, for `GET /api/v1/ops/{op}`.
    pub op: String,
}

/// `GET /api/v1/ops`: running and recent operations, oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Ops {
    /// The version of the API.
    pub schema: u8,
    /// Oldest first.
    pub ops: Vec<OpInfo>,
}

/// An operation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OpInfo {
    /// Its ID.
    pub op: String,
    /// Its kind: `scan`, `settings`, `calibration`, `recovery`.
    pub kind: String,
    /// Its lines.
    pub lines: Vec<String>,
    /// Who started it.
    pub who: String,
    /// When it was started.
    pub started: String,
    /// Its state.
    pub state: OpState,
    /// How much of it is done.
    pub done: u64,
    /// How much there is in all.
    pub total: u64,
    /// The same in percent.
    pub percent: f64,
    /// Number of modules found so far.
    pub found: u64,
    /// Estimated time left.
    pub left_ms: u64,
    /// Estimated duration at the start.
    pub estimate_ms: u64,
    /// What was found so far.
    pub result: ScanResult,
    /// For a change of settings: the change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings: Option<SettingsRun>,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}

/// The state of an operation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OpState {
    /// It is running.
    #[default]
    Running,
    /// It has completed.
    Done,
    /// It was cancelled.
    Cancelled,
    /// It failed.
    Failed,
}

/// The result of a scan.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanResult {
    /// All modules that answered.
    pub modules: Vec<ScanModule>,
    /// The scan is complete.
    pub complete: bool,
    /// Addresses with two modules, or with a module whose replies are corrupted.
    pub conflicts: Vec<ScanPlace>,
    /// Configured modules that did not answer.
    pub missing: Vec<String>,
    /// Lines on which modules were found only after a longer timeout: others may be missing.
    pub slow: Vec<String>,
    /// What was not tried.
    pub left_out: Vec<ScanLeftOut>,
}

/// A module that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanModule {
    /// The line it is on.
    pub line: String,
    /// Its address.
    pub address: u8,
    /// Its protocol: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// Its model as in the configuration; null if not known.
    #[schema(required)]
    pub model: Option<String>,
    /// The name it reports, or by which it was identified.
    pub title: String,
    /// It was identified by its behaviour, refusals included; it does not report its model.
    pub by_behaviour: bool,
    /// The models it could be, if none is proved; `model` is null then.
    pub could_be: Vec<String>,
    /// Its speed.
    pub baud: u32,
    /// Its character format, as `8N1`.
    pub format: String,
    /// Whether its ASCII frames carry a checksum; null in other protocols.
    #[schema(required)]
    pub checksum: Option<bool>,
    /// From the end of a request to the beginning of its reply.
    pub rtt_ms: f64,
    /// The verdict on its replies: `ok`, `could_be` one of several models, `refused`, `odd` (no
    /// known model), `garbled`.
    #[schema(value_type = ScanVerdict)]
    pub verdict: String,
    /// Requests and responses.
    pub evidence: Vec<String>,
    /// Its name in the configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The configuration has another model there.
    pub differs: bool,
    /// A free name for it, if it is new and identified well enough to be added.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suggest: Option<String>,
}

/// The place of a module.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanPlace {
    /// The line.
    pub line: String,
    /// The address.
    pub address: u8,
    /// The protocol in which it answered.
    pub protocol: String,
    /// The speed.
    pub baud: u32,
}

/// A part of a scan that was not tried.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanLeftOut {
    /// The line.
    pub line: String,
    /// The protocol.
    pub protocol: String,
    /// The speed.
    pub baud: u32,
    /// The character format.
    pub format: String,
    /// The addresses: `1-32,64`.
    pub addresses: String,
}

/// `POST /api/v1/ops/{op}/answer`: the answer to a question of an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct OpAnswer {
    /// Continue; otherwise it ends there.
    pub go: bool,
}
