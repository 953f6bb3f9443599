//! The types of the API for rules.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `GET /api/v1/rules`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Rules {
    /// The version of the API.
    pub schema: u8,
    /// The time zone of all times of day: the machine's.
    pub time_zone: String,
    /// All rules, by name.
    pub rules: Vec<RuleInfo>,
}

/// A rule, and its state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RuleInfo {
    /// Its name in the configuration.
    pub rule: String,
    /// Its display name, by language.
    pub name: BTreeMap<String, String>,
    /// Its condition.
    pub when: WhenText,
    /// How long its condition must hold.
    pub for_ms: u64,
    /// Its actions, in this order.
    pub then: Vec<ActionText>,
    /// Whether it is enabled.
    pub armed: bool,
    /// Whether it was tested on the history as it is now.
    pub tried: bool,
    /// Its state.
    pub state: RuleState,
    /// When it will trigger if nothing changes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub due: Option<String>,
    /// When it last triggered since the daemon started.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last: Option<String>,
    /// How often it has triggered since then.
    pub count: u64,
}

/// The state of a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RuleState {
    /// It is disabled.
    Disarmed,
    /// The value is not known.
    Unknown,
    /// The condition does not hold.
    Waiting,
    /// The condition holds, but not yet for long enough.
    Holding,
    /// It has triggered, and its condition still holds.
    Acted,
    /// It triggered too often, and is stopped until it is enabled again.
    Stopped,
}

/// The definition of a rule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = RuleText)]
pub struct RuleText {
    /// Its display name: one text, or one for each language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub name: Option<Value>,
    /// Its condition.
    pub when: WhenText,
    /// How long its condition must hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_ms: Option<u64>,
    /// Its actions, one to eight.
    pub then: Vec<ActionText>,
}

/// The condition of a rule: a `point` that `is` in a state, or is `above` or `below` a value; a
/// `time` of day; or a module or a line that is offline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WhenText {
    /// The path of a point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<String>,
    /// On or off, high or low.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub is: Option<bool>,
    /// In the unit of the point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub above: Option<f64>,
    /// In the unit of the point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub below: Option<f64>,
    /// How far a value must come back before the condition ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hysteresis: Option<f64>,
    /// The unit of the point: checked if given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// `06:30`, in the time zone of the machine.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// `mon` to `sun`; every day by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub days: Option<Vec<String>>,
    /// A module that is offline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub module_offline: Option<String>,
    /// A line that is offline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line_offline: Option<String>,
}

/// An action of a rule: `set` an output `to` a state, give a `pulse`, or `notify`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ActionText {
    /// The path of an output.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set: Option<String>,
    /// The state to switch it to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to: Option<bool>,
    /// The path of an output.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulse: Option<String>,
    /// The width of the pulse; required if the module has no width of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_ms: Option<u64>,
    /// A text to be reported as an event.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub notify: Option<String>,
}

/// The part of the history on which a rule is tested.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TryRequest {
    /// The last hours, 1 to 168; 24 by default.
    pub hours: Option<u64>,
    /// Start, as RFC 3339; at most 168 hours before `until`.
    #[schema(value_type = Option<String>)]
    pub since: Option<Timestamp>,
    /// End, as RFC 3339; now by default.
    #[schema(value_type = Option<String>)]
    pub until: Option<Timestamp>,
    /// The rule, if it is not one of the configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rule: Option<RuleText>,
    /// Its future name in the configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
}

/// When a rule would have triggered, had it been enabled, without effect on anything else.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TriedInfo {
    /// The version of the API.
    pub schema: u8,
    /// Start of the tested period.
    pub since: String,
    /// End of the tested period.
    pub until: String,
    /// When it would have triggered: the first 500 times.
    pub acts: Vec<String>,
    /// How often.
    pub count: usize,
    /// When it would have been stopped for triggering too often.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// For how long the value was not known.
    pub unknown_ms: u64,
    /// There was too much data: the test ends before the end of the requested period.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub cut: bool,
}
