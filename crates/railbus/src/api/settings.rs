//! What modules keep, as the API tells of it and takes it.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `GET /api/v1/modules/{module}/settings`: what a module keeps, as it says now.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Settings {
    pub(crate) schema: u8,
    /// The module.
    pub(crate) module: String,
    /// The mark of these values, for `If-Match`.
    pub(crate) etag: String,
    /// All its settings.
    pub(crate) settings: Vec<Setting>,
    /// A change of this module whose end is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) open: Option<u64>,
}

/// One setting of a module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Setting {
    /// Its name: `address`, `do3.mode`.
    pub(crate) setting: String,
    /// What it is; none where that is not known.
    pub(crate) value: Option<String>,
    /// What it may be, for people: `1-32`.
    pub(crate) range: String,
    /// The words it may be; none where it is a number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) words: Vec<String>,
    /// The least that a number may be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) min: Option<f64>,
    /// The most that a number may be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max: Option<f64>,
    /// The unit of a number: `s`, `V`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) unit: Option<String>,
    /// A command changes it.
    pub(crate) writable: bool,
    /// When a change acts, or what hinders it: `written`, `at_power_up`, `makers_software`,
    /// `init_pin`, `in_ascii`, `fixed`.
    pub(crate) access: String,
    /// Who says the value: `module`, `place` where it is plain from where it answers, `unknown`.
    pub(crate) source: String,
}

/// `PATCH /api/v1/modules/{module}/settings?dry_run=1`: what would be written. Nothing was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SettingsPlan {
    pub(crate) schema: u8,
    /// The module.
    pub(crate) module: String,
    /// The mark of the values there are.
    pub(crate) etag: String,
    /// What would change.
    pub(crate) changes: Vec<SettingChange>,
    /// The frames that would be sent, in this order.
    pub(crate) frames: Vec<SettingFrame>,
    /// What the change does to the line.
    pub(crate) warnings: Vec<String>,
    /// The module must be switched off and on meanwhile.
    pub(crate) power_cycle: bool,
}

/// A setting that changes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SettingChange {
    pub(crate) setting: String,
    /// What it is; `?` where that is not known.
    pub(crate) before: String,
    /// What it becomes.
    pub(crate) after: String,
}

/// A frame that would be sent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SettingFrame {
    /// As the manual prints it.
    pub(crate) frame: String,
    /// What it says.
    pub(crate) meaning: String,
}

/// A change of settings under way, or as it ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SettingsRun {
    /// The module.
    pub(crate) module: String,
    /// The number of the change in the journal; 0 where nothing had to be written.
    pub(crate) change: u64,
    /// What is being done: `reading`, `vacancy`, `writing`, `looking`, `power_cycle`, `filing`.
    pub(crate) stage: String,
    /// How long the module may still be switched off and on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) power_left_s: Option<u64>,
    /// What changes.
    pub(crate) changes: Vec<SettingChange>,
    /// How it ended: `done` (read back equal), `same`, `pending`, `unchanged`, `rolled_back`,
    /// `halfway`, `untold`, `lost`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) end: Option<String>,
    /// Where the module answers now: `9 (09h), 19200 8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) place: Option<String>,
}

/// `GET /api/v1/modules/{module}/settings/log`: the changes of a module, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SettingsLog {
    pub(crate) schema: u8,
    pub(crate) changes: Vec<LoggedChange>,
}

/// A change in the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct LoggedChange {
    /// Its number.
    pub(crate) change: u64,
    /// When it ended, or was begun.
    pub(crate) at: String,
    /// How it stands: `done`, `filed` where the configuration followed it, `intent` while its end
    /// is not known, `pending`, `unchanged`, `elsewhere`, `lost`, `untold`.
    pub(crate) state: String,
    /// Whose wish it was: `set`, `undo`, `restore`, `apply`, `calibrate`, ...
    pub(crate) by: String,
    /// The change that it takes back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) undoes: Option<u64>,
    /// A part of it was taken back.
    pub(crate) rolled_back: bool,
    /// It can be taken back.
    pub(crate) undoable: bool,
    /// Each setting: what it was, and what it became.
    pub(crate) set: BTreeMap<String, [String; 2]>,
}

/// `POST /api/v1/modules/{module}/settings/undo`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SettingsUndo {
    /// The change; the last one of the module if not said.
    #[serde(default)]
    pub(crate) change: Option<u64>,
}

/// `GET /api/v1/modules/{module}/registers`: what a module says of itself, byte for byte.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Registers {
    pub(crate) schema: u8,
    /// The module.
    pub(crate) module: String,
    /// The protocol it speaks. Only over `rtu` there are registers; elsewhere there are replies.
    pub(crate) protocol: String,
    /// What it was asked, and what it said.
    pub(crate) reads: Vec<RegisterRead>,
}

/// One read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct RegisterRead {
    /// What was sent, in hexadecimal digits.
    pub(crate) sent: String,
    /// What that asks.
    pub(crate) meaning: String,
    /// What came back, in hexadecimal digits; empty where nothing did.
    pub(crate) bytes: String,
    /// What that says; none where it is no reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) says: Option<String>,
    /// From the end of the request to the end of what came back.
    pub(crate) after_ms: f64,
    /// Coil by coil, register by register.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) cells: Vec<Cell>,
}

/// A coil or a register.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = RegisterCell)]
pub(crate) struct Cell {
    /// `coil`, `discrete`, `holding`.
    pub(crate) kind: String,
    /// Its number, as frames count: from 0.
    pub(crate) at: u16,
    /// What it is: the label of a point, or what its data sheet says.
    pub(crate) name: String,
    /// The fact of the data sheet, as `docs/datasheets` counts them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) fact: Option<String>,
    /// Its 16 bits, or 0 or 1.
    pub(crate) value: u16,
}
