//! Simulated lines, as the API tells of them: the modules themselves, whatever the line told.

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
    /// Its characters, as `8N1`.
    pub format: String,
    /// Its adapter is there.
    pub plugged: bool,
    /// Characters that were spoilt because two talked at once.
    pub collisions: u64,
    /// What goes wrong with it and all that hangs on it.
    pub faults: Vec<SimFaultInfo>,
    /// Its modules; over a WebSocket those that changed.
    pub modules: Vec<SimModuleInfo>,
}

/// A simulated module, as it really is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimModuleInfo {
    /// Its name.
    pub module: String,
    /// Its family, as in the configuration: `eda9060a`.
    pub model: String,
    /// Its family, as its maker writes it.
    pub title: String,
    /// The address that it answers to.
    pub address: u8,
    /// The protocol that it speaks: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// Its speed in bits per second.
    pub baud: u32,
    /// Its characters, as `8N1`.
    pub format: String,
    /// Its ASCII frames carry a checksum.
    pub checksum: bool,
    /// Where its DIP switch stands, if it has one; 0 leaves the address to what it keeps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dip: Option<u8>,
    /// Whether its INIT* pin is grounded, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub init: Option<bool>,
    /// It has power.
    pub powered: bool,
    /// Its LED shines.
    pub lit: bool,
    /// Replies that it gave, also those that a fault kept from the line.
    pub replies: u64,
    /// Times that it started with its power, but for the first.
    pub restarts: u64,
    /// What is at its terminals: outputs, inputs, analog inputs.
    pub points: Vec<SimPointInfo>,
    /// What goes wrong with it.
    pub faults: Vec<SimFaultInfo>,
}

/// A terminal of a simulated module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimPointInfo {
    /// As printed at the terminal.
    pub label: String,
    /// `output`, `input` or `analog`.
    pub kind: String,
    /// What is there: an output is on, an input high or open, or so much of the unit.
    pub value: SimValue,
    /// The unit of an analog input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The range of an analog input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Somebody laid this at the input, which moves by itself otherwise.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub by_hand: bool,
    /// The output stays as it is, whatever the module is told.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stuck: bool,
}

/// On or off, or so much.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum SimValue {
    /// On or high, or not.
    Switch(bool),
    /// So much of the unit.
    Number(f64),
}

/// A fault that stands.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SimFaultInfo {
    /// As it was ordered.
    pub fault: String,
    /// How long it still lasts, where it ends by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_ms: Option<u64>,
    /// How many replies it is still for, where it is for some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_replies: Option<u64>,
}

/// `PUT /api/v1/sim/{line}`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimLineRequest {
    /// false pulls the adapter out, true puts it back. Where it can't be put back, the answer
    /// says that it is out.
    pub plugged: bool,
}

/// `PUT /api/v1/sim/{line}/{module}`. What is not named stays.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimModuleRequest {
    /// Whether it has power.
    #[serde(default)]
    pub powered: Option<bool>,
    /// Where its DIP switch stands.
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
    /// What lies at inputs from now on, by their labels; null leaves one to itself again.
    #[schema(value_type = BTreeMap<String, serde_json::Value>)]
    pub set: BTreeMap<String, Option<SimValue>>,
}

/// `POST /api/v1/sim/{line}/line-faults` and `POST /api/v1/sim/{line}/{module}/faults`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimFaultsRequest {
    /// What goes wrong too, as `mute 10s, stuck k1` or `bad once`.
    pub faults: String,
}
