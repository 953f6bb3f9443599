//! What modules keep, as the API tells of it and takes it.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `GET /api/v1/modules/{module}/settings`: what a module keeps, as it says now.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Settings {
    /// The version of the API.
    pub schema: u8,
    /// The module.
    pub module: String,
    /// The mark of these values, for `If-Match`.
    pub etag: String,
    /// All its settings.
    pub settings: Vec<Setting>,
    /// A change of this module whose end is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub open: Option<u64>,
}

/// One setting of a module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Setting {
    /// Its name: `address`, `do3.mode`.
    pub setting: String,
    /// What it is; none where that is not known.
    pub value: Option<String>,
    /// What it may be, for people: `1-32`.
    pub range: String,
    /// The words it may be; none where it is a number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub words: Vec<String>,
    /// The least that a number may be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// The most that a number may be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// The unit of a number: `s`, `V`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// A command changes it.
    pub writable: bool,
    /// When a change acts, or what hinders it: `written`, `at_power_up`, `makers_software`,
    /// `init_pin`, `in_ascii`, `fixed`.
    pub access: String,
    /// Who says the value: `module`, `place` where it is plain from where it answers, `unknown`.
    pub source: String,
}

/// `PATCH /api/v1/modules/{module}/settings?dry_run=1`: what would be written. Nothing was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsPlan {
    /// The version of the API.
    pub schema: u8,
    /// The module.
    pub module: String,
    /// The mark of the values there are.
    pub etag: String,
    /// What would change.
    pub changes: Vec<SettingChange>,
    /// The frames that would be sent, in this order.
    pub frames: Vec<SettingFrame>,
    /// What the change does to the line.
    pub warnings: Vec<String>,
    /// The module must be switched off and on meanwhile.
    pub power_cycle: bool,
}

/// A setting that changes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SettingChange {
    /// Its name: `address`, `do3.mode`.
    pub setting: String,
    /// What it is; `?` where that is not known.
    pub before: String,
    /// What it becomes.
    pub after: String,
}

/// A frame that would be sent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SettingFrame {
    /// As the manual prints it.
    pub frame: String,
    /// What it says.
    pub meaning: String,
}

/// A change of settings under way, or as it ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsRun {
    /// The module.
    pub module: String,
    /// The number of the change in the journal; 0 where nothing had to be written.
    pub change: u64,
    /// What is being done: `reading`, `vacancy`, `writing`, `looking`, `power_cycle`, `filing`,
    /// `calibrating`.
    pub stage: String,
    /// How long the module may still be switched off and on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power_left_s: Option<u64>,
    /// What changes.
    pub changes: Vec<SettingChange>,
    /// How it ended: `done` (read back equal), `same`, `pending`, `unchanged`, `rolled_back`,
    /// `halfway`, `untold`, `lost`; of a recovery also `elsewhere` (neither old nor new),
    /// `in_place`, `moved`, `two` (modules on one address).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<String>,
    /// Where the module answers now: `9 (09h), 19200 8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// Where it is being looked for: `9 (09h), 19200 8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub looking: Option<String>,
    /// How two modules on one address are parted, where a recovery found them: `plug`, `pin`,
    /// `boards`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parting: Option<String>,
    /// What is asked now, to be answered by `POST /api/v1/ops/{op}/answer`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub question: Option<SettingsQuestion>,
    /// Of a calibration: the readings, as far as it came.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

/// What somebody is asked meanwhile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsQuestion {
    /// `zero`: all inputs are disconnected; `span`: the voltage lies at all of them.
    pub step: String,
    /// What the inputs read now, in volts or milliamperes as the module is made.
    pub readings: [f64; 2],
    /// The voltage that must lie at the inputs, in volts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voltage: Option<f64>,
    /// So long an answer is waited for. Without one it ends there.
    pub wait_s: u64,
}

/// What the inputs of a module read in the course of a calibration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Calibration {
    /// Before it.
    pub before: Option<[f64; 2]>,
    /// After the zero step; none where it was not done.
    pub zero: Option<[f64; 2]>,
    /// After the span step; none where it was not done.
    pub span: Option<[f64; 2]>,
}

/// `POST /api/v1/modules/{module}/settings/calibrate`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrateRequest {
    /// What lies at all inputs in the second step: `5.00 V`, which it is if not said.
    #[serde(default)]
    pub voltage: Option<String>,
}

/// `GET /api/v1/modules/{module}/settings/log`: the changes of a module, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SettingsLog {
    /// The version of the API.
    pub schema: u8,
    /// The newest first.
    pub changes: Vec<LoggedChange>,
}

/// A change in the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LoggedChange {
    /// Its number.
    pub change: u64,
    /// When it ended, or was begun.
    pub at: String,
    /// How it stands: `done`, `filed` where the configuration followed it, `intent` while its end
    /// is not known, `pending`, `unchanged`, `elsewhere`, `lost`, `untold`.
    pub state: String,
    /// Whose wish it was: `set`, `undo`, `restore`, `apply`, `calibrate`, ...
    pub by: String,
    /// The change that it takes back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undoes: Option<u64>,
    /// A part of it was taken back.
    pub rolled_back: bool,
    /// It can be taken back.
    pub undoable: bool,
    /// Each setting: what it was, and what it became.
    pub set: BTreeMap<String, [String; 2]>,
}

/// `POST /api/v1/modules/{module}/settings/undo`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SettingsUndo {
    /// The change; the last one of the module if not said.
    #[serde(default)]
    pub change: Option<u64>,
}

/// `GET /api/v1/modules/{module}/registers`: what a module says of itself, byte for byte.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Registers {
    /// The version of the API.
    pub schema: u8,
    /// The module.
    pub module: String,
    /// The protocol it speaks. Only over `rtu` there are registers; elsewhere there are replies.
    pub protocol: String,
    /// What it was asked, and what it said.
    pub reads: Vec<RegisterRead>,
}

/// One read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegisterRead {
    /// What was sent, in hexadecimal digits.
    pub sent: String,
    /// What that asks.
    pub meaning: String,
    /// What came back, in hexadecimal digits; empty where nothing did.
    pub bytes: String,
    /// What that says; none where it is no reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub says: Option<String>,
    /// From the end of the request to the end of what came back.
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
    /// Its number, as frames count: from 0.
    pub at: u16,
    /// What it is: the label of a point, or what its data sheet says.
    pub name: String,
    /// The fact of the data sheet, as `docs/datasheets` counts them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fact: Option<String>,
    /// Its 16 bits, or 0 or 1.
    pub value: u16,
}
