//! Simulated lines, as the API tells of them: the modules themselves, whatever the line told.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `GET /api/v1/sim`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SimLines {
    pub(crate) schema: u8,
    pub(crate) lines: Vec<SimLineInfo>,
}

/// A simulated line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SimLineInfo {
    /// Its name.
    pub(crate) line: String,
    /// Its speed in bits per second.
    pub(crate) baud: u32,
    /// Its characters, as `8N1`.
    pub(crate) format: String,
    /// Its adapter is there.
    pub(crate) plugged: bool,
    /// Characters that were spoilt because two talked at once.
    pub(crate) collisions: u64,
    /// What goes wrong with it and all that hangs on it.
    pub(crate) faults: Vec<SimFaultInfo>,
    /// Its modules; over a WebSocket those that changed.
    pub(crate) modules: Vec<SimModuleInfo>,
}

/// A simulated module, as it really is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SimModuleInfo {
    /// Its name.
    pub(crate) module: String,
    /// Its family, as in the configuration: `eda9060a`.
    pub(crate) model: String,
    /// Its family, as its maker writes it.
    pub(crate) title: String,
    /// The address that it answers to.
    pub(crate) address: u8,
    /// The protocol that it speaks: `rtu`, `ascii`, `lc02`, `r55`.
    pub(crate) protocol: String,
    /// Its speed in bits per second.
    pub(crate) baud: u32,
    /// Its characters, as `8N1`.
    pub(crate) format: String,
    /// Its ASCII frames carry a checksum.
    pub(crate) checksum: bool,
    /// Where its DIP switch stands, if it has one; 0 leaves the address to what it keeps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) dip: Option<u8>,
    /// Whether its INIT* pin is grounded, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) init: Option<bool>,
    /// It has power.
    pub(crate) powered: bool,
    /// Its LED shines.
    pub(crate) lit: bool,
    /// Replies that it gave, also those that a fault kept from the line.
    pub(crate) replies: u64,
    /// Times that it started with its power, but for the first.
    pub(crate) restarts: u64,
    /// What is at its terminals: outputs, inputs, analog inputs.
    pub(crate) points: Vec<SimPointInfo>,
    /// What goes wrong with it.
    pub(crate) faults: Vec<SimFaultInfo>,
}

/// A terminal of a simulated module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SimPointInfo {
    /// As printed at the terminal.
    pub(crate) label: String,
    /// `output`, `input` or `analog`.
    pub(crate) kind: String,
    /// What is there: an output is on, an input high or open, or so much of the unit.
    pub(crate) value: SimValue,
    /// The unit of an analog input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) unit: Option<String>,
    /// The range of an analog input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) range: Option<[f64; 2]>,
    /// Somebody laid this at the input, which moves by itself otherwise.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) by_hand: bool,
    /// The output stays as it is, whatever the module is told.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) stuck: bool,
}

/// On or off, or so much.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub(crate) enum SimValue {
    /// On or high, or not.
    Switch(bool),
    /// So much of the unit.
    Number(f64),
}

/// A fault that stands.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SimFaultInfo {
    /// As it was ordered.
    pub(crate) fault: String,
    /// How long it still lasts, where it ends by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) left_ms: Option<u64>,
    /// How many replies it is still for, where it is for some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) left_replies: Option<u64>,
}

/// `PUT /api/v1/sim/{line}`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SimLineRequest {
    /// false pulls the adapter out, true puts it back. Where it can't be put back, the answer
    /// says that it is out.
    pub(crate) plugged: bool,
}

/// `PUT /api/v1/sim/{line}/{module}`. What is not named stays.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SimModuleRequest {
    /// Whether it has power.
    #[serde(default)]
    pub(crate) powered: Option<bool>,
    /// Where its DIP switch stands.
    #[serde(default)]
    pub(crate) dip: Option<u8>,
    /// Whether its INIT* pin is grounded.
    #[serde(default)]
    pub(crate) init: Option<bool>,
}

/// `PUT /api/v1/sim/{line}/{module}/inputs`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SimInputsRequest {
    /// What lies at inputs from now on, by their labels; null leaves one to itself again.
    #[schema(value_type = BTreeMap<String, serde_json::Value>)]
    pub(crate) set: BTreeMap<String, Option<SimValue>>,
}

/// `POST /api/v1/sim/{line}/line-faults` and `POST /api/v1/sim/{line}/{module}/faults`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SimFaultsRequest {
    /// What goes wrong too, as `mute 10s, stuck k1` or `bad once`.
    pub(crate) faults: String,
}
