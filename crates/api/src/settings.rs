//! The types of the API for module settings.

use super::words::{
    CalibrationStep, ChangeState, Parting, SettingAccess, SettingSource, SettingsStage,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `GET /api/v1/modules/{module}/settings`: the settings of a module, read now.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Settings {
    /// The version of the API.
    pub schema: u8,
    /// The module.
    pub module: String,
    /// The ETag of these values, for `If-Match`.
    pub etag: String,
    /// All its settings.
    pub settings: Vec<Setting>,
    /// A change of this module whose result is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub open: Option<u64>,
}

/// One setting of a module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Setting {
    /// Its name: `address`, `do3.mode`.
    pub setting: String,
    /// Its value; null if not known.
    #[schema(required)]
    pub value: Option<String>,
    /// Its possible values, for people: `1-32`.
    pub range: String,
    /// Its possible words; absent if it is a number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub words: Vec<String>,
    /// The minimum, if it is a number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// The maximum, if it is a number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// The unit, if it is a number: `s`, `V`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Whether a command can change it.
    pub writable: bool,
    /// When a change takes effect, or what prevents it: `written`, `at_power_up`,
    /// `makers_software`, `init_pin`, `in_ascii`, `fixed`.
    #[schema(value_type = SettingAccess)]
    pub access: String,
    /// Where the value comes from: `module`, `place` if it follows from where it answers,
    /// `unknown`.
    #[schema(value_type = SettingSource)]
    pub source: String,
}

/// `PATCH /api/v1/modules/{module}/settings?dry_run=1`: what would be written. Nothing was sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsPlan {
    /// The version of the API.
    pub schema: u8,
    /// The module.
    pub module: String,
    /// The ETag of the current values.
    pub etag: String,
    /// What would change.
    pub changes: Vec<SettingChange>,
    /// The frames that would be sent, in this order.
    pub frames: Vec<SettingFrame>,
    /// What the change means for the line.
    pub warnings: Vec<String>,
    /// The module must be power-cycled meanwhile.
    pub power_cycle: bool,
}

/// A setting that changes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SettingChange {
    /// Its name: `address`, `do3.mode`.
    pub setting: String,
    /// Its old value; `?` if not known.
    pub before: String,
    /// Its new value.
    pub after: String,
}

/// A frame that would be sent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SettingFrame {
    /// As in the manual.
    pub frame: String,
    /// Its meaning.
    pub meaning: String,
}

/// A change of settings, in progress or completed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsRun {
    /// The module.
    pub module: String,
    /// The number of the change in the journal; 0 if nothing had to be written.
    pub change: u64,
    /// The current step: `reading`, `vacancy`, `writing`, `looking`, `power_cycle`,
    /// `calibrating`.
    #[schema(value_type = SettingsStage)]
    pub stage: String,
    /// Time left to power-cycle the module.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power_left_s: Option<u64>,
    /// What changes.
    pub changes: Vec<SettingChange>,
    /// The result: `done` (verified by read-back), `same`, `pending`, `unchanged`, `rolled_back`,
    /// `halfway`, `untold`, `lost`; of a recovery also `elsewhere` (neither old nor new),
    /// `in_place`, `moved`, `two` (modules at one address).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<String>,
    /// Where the module answers now: `9 (09h), 19200 8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// Where it is being searched for: `9 (09h), 19200 8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub looking: Option<String>,
    /// How to separate two modules at one address, if a recovery found them: `plug`, `pin`,
    /// `boards`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Parting>)]
    pub parting: Option<String>,
    /// The current question, to be answered by `POST /api/v1/ops/{op}/answer`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub question: Option<SettingsQuestion>,
    /// For a calibration: the readings so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

/// A question of an operation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsQuestion {
    /// `zero`: are all inputs disconnected; `span`: is the voltage applied to all of them.
    #[schema(value_type = CalibrationStep)]
    pub step: String,
    /// The current readings of the inputs, in volts or milliamperes, depending on the module.
    #[schema(min_items = 2, max_items = 2)]
    pub readings: [f64; 2],
    /// The voltage to be applied to the inputs, in volts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voltage: Option<f64>,
    /// Timeout of the answer. Without one the operation ends there.
    pub wait_s: u64,
}

/// The readings of a module during a calibration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Calibration {
    /// Before it.
    #[schema(required, min_items = 2, max_items = 2)]
    pub before: Option<[f64; 2]>,
    /// After the zero step; null if it was not done.
    #[schema(required, min_items = 2, max_items = 2)]
    pub zero: Option<[f64; 2]>,
    /// After the span step; null if it was not done.
    #[schema(required, min_items = 2, max_items = 2)]
    pub span: Option<[f64; 2]>,
}

/// `POST /api/v1/modules/{module}/settings/calibrate`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrateRequest {
    /// The voltage applied to all inputs in the second step; default `5.00 V`.
    #[serde(default)]
    pub voltage: Option<String>,
}

/// `GET /api/v1/modules/{module}/settings/log`: the changes of a module, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsLog {
    /// The version of the API.
    pub schema: u8,
    /// Newest first.
    pub changes: Vec<LoggedChange>,
}

/// A change in the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LoggedChange {
    /// Its number.
    pub change: u64,
    /// When it ended, or was started.
    pub at: String,
    /// Its state: `done`, `filed` if the configuration was updated, `intent` while its result is
    /// not known, `pending`, `unchanged`, `elsewhere`, `lost`, `untold`.
    #[schema(value_type = ChangeState)]
    pub state: String,
    /// The kind of change: `set`, `undo`, `restore`, `apply`, `calibrate`, ...
    pub by: String,
    /// The change that it undoes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undoes: Option<u64>,
    /// A part of it was rolled back.
    pub rolled_back: bool,
    /// It can be undone.
    pub undoable: bool,
    /// Each setting: its old and its new value.
    pub set: BTreeMap<String, [String; 2]>,
}

/// `POST /api/v1/modules/{module}/settings/undo`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SettingsUndo {
    /// The change; by default the last one of the module.
    #[serde(default)]
    pub change: Option<u64>,
}

/// `GET /api/v1/modules/{module}/registers`: everything a module reports, byte by byte.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Registers {
    /// The version of the API.
    pub schema: u8,
    /// The module.
    pub module: String,
    /// Its protocol. There are registers only with `rtu`; otherwise there are replies.
    pub protocol: String,
    /// The reads.
    pub reads: Vec<RegisterRead>,
}

/// One read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegisterRead {
    /// The request, in hexadecimal.
    pub sent: String,
    /// The meaning of the request.
    pub meaning: String,
    /// The bytes received, in hexadecimal; empty if there were none.
    pub bytes: String,
    /// The meaning of the reply; absent if it is not a valid reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub says: Option<String>,
    /// From the end of the request to the end of the bytes received.
    pub after_ms: f64,
    /// Coil by coil, register by register.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cells: Vec<Cell>,
}

/// A coil or a register.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = RegisterCell)]
pub struct Cell {
    /// `coil`, `discrete`, `holding`.
    pub kind: String,
    /// Its number in frames, from 0.
    pub at: u16,
    /// Its meaning: the label of a point, or its name in the datasheet.
    pub name: String,
    /// The fact of the datasheet, as numbered in `docs/datasheets`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fact: Option<String>,
    /// Its 16 bits, or 0 or 1.
    pub value: u16,
}
