//! What modules keep, as the API tells of it and takes it.

use railbus_commission::{Calibrated, Question};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;
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
    /// What is being done: `reading`, `vacancy`, `writing`, `looking`, `power_cycle`, `filing`,
    /// `calibrating`.
    pub(crate) stage: String,
    /// How long the module may still be switched off and on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) power_left_s: Option<u64>,
    /// What changes.
    pub(crate) changes: Vec<SettingChange>,
    /// How it ended: `done` (read back equal), `same`, `pending`, `unchanged`, `rolled_back`,
    /// `halfway`, `untold`, `lost`; of a recovery also `elsewhere` (neither old nor new),
    /// `in_place`, `moved`, `two` (modules on one address).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) end: Option<String>,
    /// Where the module answers now: `9 (09h), 19200 8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) place: Option<String>,
    /// Where it is being looked for: `9 (09h), 19200 8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) looking: Option<String>,
    /// How two modules on one address are parted, where a recovery found them: `plug`, `pin`,
    /// `boards`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) parting: Option<String>,
    /// What is asked now, to be answered by `POST /api/v1/ops/{op}/answer`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) question: Option<SettingsQuestion>,
    /// Of a calibration: the readings, as far as it came.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) calibration: Option<Calibration>,
}

/// What somebody is asked meanwhile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SettingsQuestion {
    /// `zero`: all inputs are disconnected; `span`: the voltage lies at all of them.
    pub(crate) step: String,
    /// What the inputs read now, in volts or milliamperes as the module is made.
    pub(crate) readings: [f64; 2],
    /// The voltage that must lie at the inputs, in volts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) voltage: Option<f64>,
    /// So long an answer is waited for. Without one it ends there.
    pub(crate) wait_s: u64,
}

/// What the inputs of a module read in the course of a calibration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Calibration {
    /// Before it.
    pub(crate) before: Option<[f64; 2]>,
    /// After the zero step; none where it was not done.
    pub(crate) zero: Option<[f64; 2]>,
    /// After the span step; none where it was not done.
    pub(crate) span: Option<[f64; 2]>,
}

fn values(readings: [u16; 2]) -> [f64; 2] {
    readings.map(|hundredths| f64::from(hundredths) / 100.0)
}

impl SettingsQuestion {
    /// A question of a procedure, and how long it may take to be answered.
    pub(crate) fn of(question: Question, wait: Duration) -> SettingsQuestion {
        let (step, voltage, readings) = match question {
            Question::ZeroReady(readings) => ("zero", None, readings),
            Question::SpanReady(voltage, readings) => ("span", Some(voltage), readings),
        };
        SettingsQuestion {
            step: step.to_owned(),
            readings: values(readings),
            voltage: voltage.map(|hundredths| f64::from(hundredths) / 100.0),
            wait_s: wait.as_secs(),
        }
    }
}

impl Calibration {
    /// How far one came.
    pub(crate) fn of(done: &Calibrated) -> Calibration {
        Calibration {
            before: done.before.map(values),
            zero: done.zero.map(values),
            span: done.span.map(values),
        }
    }
}

/// `POST /api/v1/modules/{module}/settings/calibrate`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct CalibrateRequest {
    /// What lies at all inputs in the second step: `5.00 V`, which it is if not said.
    #[serde(default)]
    pub(crate) voltage: Option<String>,
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
