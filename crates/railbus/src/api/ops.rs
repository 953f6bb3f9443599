//! What takes its time: scans and changes of settings, as the API tells of them.

use super::problem::Problem;
use super::settings::SettingsRun;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// `POST /api/v1/scans`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ScanRequest {
    /// The lines; may be left out where there is only one.
    #[serde(default)]
    pub(crate) lines: Vec<String>,
    /// How far it goes.
    #[serde(default)]
    pub(crate) depth: ScanDepth,
    /// Only these: `rtu`, `ascii`, `lc02`, `r55`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) protocols: Option<Vec<String>>,
    /// Only at these speeds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) bauds: Option<Vec<u32>>,
    /// Only these addresses: `1-32,64`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) addresses: Option<String>,
}

/// How far a scan goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ScanDepth {
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
pub(crate) struct OpBegun {
    /// Its number, for `GET /api/v1/ops/{op}`.
    pub(crate) op: String,
}

/// `GET /api/v1/ops`: what runs, and what ended lately; oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Ops {
    pub(crate) schema: u8,
    pub(crate) ops: Vec<OpInfo>,
}

/// Something that takes its time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct OpInfo {
    /// Its number.
    pub(crate) op: String,
    /// What it is: `scan`, `settings`, `calibration`, `recovery`.
    pub(crate) kind: String,
    /// The lines it is on.
    pub(crate) lines: Vec<String>,
    /// Who began it.
    pub(crate) who: String,
    /// When it began.
    pub(crate) started: String,
    /// How it is.
    pub(crate) state: OpState,
    /// How much of it is done.
    pub(crate) done: u64,
    /// How much there is in all.
    pub(crate) total: u64,
    /// The same in percent.
    pub(crate) percent: f64,
    /// How many modules were found so far.
    pub(crate) found: u64,
    /// How long the rest takes, about.
    pub(crate) left_ms: u64,
    /// How long it was thought to take.
    pub(crate) estimate_ms: u64,
    /// What was found so far.
    pub(crate) result: ScanResult,
    /// What is changed, where settings are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) settings: Option<SettingsRun>,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) error: Option<Problem>,
}

/// How an operation is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum OpState {
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
pub(crate) struct ScanResult {
    /// Everyone who answered.
    pub(crate) modules: Vec<ScanModule>,
    /// Everyone was asked.
    pub(crate) complete: bool,
    /// The places at which two modules may be, or somebody whose replies are spoilt.
    pub(crate) conflicts: Vec<ScanPlace>,
    /// Modules of the configuration that were asked and did not answer.
    pub(crate) missing: Vec<String>,
    /// Lines on which modules were found only by a longer wait: others may be missing.
    pub(crate) slow: Vec<String>,
    /// Who was not asked.
    pub(crate) left_out: Vec<ScanLeftOut>,
}

/// A module that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct ScanModule {
    /// The line it hangs on.
    pub(crate) line: String,
    /// Its address.
    pub(crate) address: u8,
    /// The protocol it speaks: `rtu`, `ascii`, `lc02`, `r55`.
    pub(crate) protocol: String,
    /// What the configuration would call its model; none where that is not known.
    pub(crate) model: Option<String>,
    /// What it says it is, or is known by.
    pub(crate) title: String,
    /// It is known by how it behaves, and refuses; it does not say what it is.
    pub(crate) by_behaviour: bool,
    /// The models that it could be, where nothing proves one; `model` is none then.
    pub(crate) could_be: Vec<String>,
    /// Its speed.
    pub(crate) baud: u32,
    /// Its character format, as `8N1`.
    pub(crate) format: String,
    /// Whether its ASCII frames carry a checksum; none in other protocols.
    pub(crate) checksum: Option<bool>,
    /// From the end of a request to the beginning of its reply.
    pub(crate) rtt_ms: f64,
    /// What its answers amount to: `ok`, `could_be` one of several models, `refused`, `odd` (no
    /// model that is known), `garbled`.
    pub(crate) verdict: String,
    /// What it was asked, and what it answered.
    pub(crate) evidence: Vec<String>,
    /// Its name in the configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) name: Option<String>,
    /// The configuration says that it is another model.
    pub(crate) differs: bool,
    /// A free name for it, where it is new and known well enough to be added.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) suggest: Option<String>,
}

/// Where something is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub(crate) struct ScanPlace {
    /// The line.
    pub(crate) line: String,
    /// The address.
    pub(crate) address: u8,
    /// The protocol in which it was heard.
    pub(crate) protocol: String,
    /// At which speed.
    pub(crate) baud: u32,
}

/// A part of a scan that was not done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub(crate) struct ScanLeftOut {
    /// The line.
    pub(crate) line: String,
    /// The protocol.
    pub(crate) protocol: String,
    /// At which speed.
    pub(crate) baud: u32,
    /// In which format.
    pub(crate) format: String,
    /// Who was not asked: `1-32,64`.
    pub(crate) addresses: String,
}

/// `POST /api/v1/ops/{op}/answer`: the answer to what an operation asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct OpAnswer {
    /// Go on; otherwise it ends there.
    pub(crate) go: bool,
}
