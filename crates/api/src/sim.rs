//! The types of the API for simulated lines: the true state of the modules, whatever was read over
//! the line.

use super::types::Kind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `GET /api/v1/sim`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimLines {
    /// The version of the API.
    pub schema: u8,
    /// The simulated lines.
    pub lines: Vec<SimLineInfo>,
}

/// A simulated line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimLineInfo {
    /// Its name.
    pub line: String,
    /// Its speed in bits per second.
    pub baud: u32,
    /// Its character format, as `8N1`.
    pub format: String,
    /// Its adapter is plugged in.
    pub plugged: bool,
    /// Characters corrupted by collisions.
    pub collisions: u64,
    /// The active faults of the line and everything on it.
    pub faults: Vec<SimFaultInfo>,
    /// Its modules; over a WebSocket those that changed.
    pub modules: Vec<SimModuleInfo>,
}

/// A simulated module, in its true state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimModuleInfo {
    /// Its name.
    pub module: String,
    /// Its family, as in the configuration: `eda9060a`.
    pub model: String,
    /// Its family, as written by the manufacturer.
    pub title: String,
    /// The address that it answers to.
    pub address: u8,
    /// The protocol: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// Its speed in bits per second.
    pub baud: u32,
    /// Its character format, as `8N1`.
    pub format: String,
    /// Its ASCII frames carry a checksum.
    pub checksum: bool,
    /// The position of its DIP switch, if it has one; 0: the stored address is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dip: Option<u8>,
    /// Whether its INIT* pin is grounded, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub init: Option<bool>,
    /// It is powered.
    pub powered: bool,
    /// Its LED is lit.
    pub lit: bool,
    /// Replies sent, including those suppressed by a fault.
    pub replies: u64,
    /// Number of restarts.
    pub restarts: u64,
    /// The state of its terminals: outputs, inputs, analog inputs.
    pub points: Vec<SimPointInfo>,
    /// Its active faults.
    pub faults: Vec<SimFaultInfo>,
}

/// A terminal of a simulated module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimPointInfo {
    /// As printed at the terminal.
    pub label: String,
    /// `output`, `input` or `analog`.
    #[schema(value_type = Kind)]
    pub kind: String,
    /// Its state: whether an output is on, whether an input is high or open, or an analog value.
    pub value: SimValue,
    /// The unit of an analog input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The range of an analog input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 2, max_items = 2)]
    pub range: Option<[f64; 2]>,
    /// Set manually; otherwise this input changes automatically.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub by_hand: bool,
    /// The output is stuck: it ignores commands.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stuck: bool,
}

/// On or off, or an analog value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum SimValue {
    /// On or high, or not.
    Switch(bool),
    /// A value in the unit.
    Number(f64),
}

/// An active fault.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SimFaultInfo {
    /// As specified.
    pub fault: String,
    /// Time left, if it ends by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_ms: Option<u64>,
    /// Number of replies left, if it is limited.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_replies: Option<u64>,
}

/// `PUT /api/v1/sim/{line}`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimLineRequest {
    /// false unplugs the adapter, true plugs it in again. If that fails, the answer says that it is
    /// unplugged.
    pub plugged: bool,
}

/// `PUT /api/v1/sim/{line}/{module}`. Whatever is not given stays as it is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimModuleRequest {
    /// Whether it is powered.
    #[serde(default)]
    pub powered: Option<bool>,
    /// The position of its DIP switch.
    #[serde(default)]
    pub dip: Option<u8>,
    /// Whether its INIT* pin is grounded.
    #[serde(default)]
    pub init: Option<bool>,
}

/// `PUT /api/v1/sim/{line}/{module}/inputs`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimInputsRequest {
    /// The values of inputs, by their labels; null releases an input.
    #[schema(value_type = BTreeMap<String, serde_json::Value>)]
    pub set: BTreeMap<String, Option<SimValue>>,
}

/// `POST /api/v1/sim/{line}/line-faults` and `POST /api/v1/sim/{line}/{module}/faults`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimFaultsRequest {
    /// Faults to add, such as `mute 10s, stuck k1` or `bad once`.
    pub faults: String,
}
