//! Rules, as the API tells them.

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
    /// The time zone of all times of day: that of the machine.
    pub time_zone: String,
    /// All rules, by name.
    pub rules: Vec<RuleInfo>,
}

/// A rule, and how it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RuleInfo {
    /// Its name in the configuration.
    pub rule: String,
    /// What people call it, by language.
    pub name: BTreeMap<String, String>,
    /// Its condition.
    pub when: WhenText,
    /// For how long its condition must hold.
    pub for_ms: u64,
    /// What it does, in this order.
    pub then: Vec<ActionText>,
    /// Whether it acts.
    pub armed: bool,
    /// Whether it was tried against the history as it is now.
    pub tried: bool,
    /// Where it is.
    pub state: RuleState,
    /// When it acts if nothing changes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub due: Option<String>,
    /// When it last acted since the daemon began.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last: Option<String>,
    /// How often it did.
    pub count: u64,
}

/// Where a rule is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RuleState {
    /// It does not act.
    Disarmed,
    /// What it waits for is not known.
    Unknown,
    /// It waits.
    Waiting,
    /// Its condition holds, and not yet for long enough.
    Holding,
    /// It has acted, and its condition has not ceased since.
    Acted,
    /// It acted too often, and does so no more until it is armed anew.
    Stopped,
}

/// A rule as somebody writes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = RuleText)]
pub struct RuleText {
    /// What people call it: one text, or one for each language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub name: Option<Value>,
    /// Its condition.
    pub when: WhenText,
    /// For how long its condition must hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_ms: Option<u64>,
    /// What it does, one to eight things.
    pub then: Vec<ActionText>,
}

/// What a rule waits for: a `point` that `is`, or is `above` or `below` a value; a `time` of day;
/// or a module or a line that is offline.
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
    /// How far a value must come back before it counts as back.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hysteresis: Option<f64>,
    /// The unit of the point: where it is said it is checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// `06:30`, in the time zone of the machine.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// `mon` to `sun`; all where nothing is said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub days: Option<Vec<String>>,
    /// A module that is offline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub module_offline: Option<String>,
    /// A line that is offline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line_offline: Option<String>,
}

/// What a rule does: `set` an output `to` a state, give a `pulse`, or `notify`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ActionText {
    /// The path of an output.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set: Option<String>,
    /// The state that it is set to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to: Option<bool>,
    /// The path of an output.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulse: Option<String>,
    /// How long the pulse is; needed where the module has no width of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_ms: Option<u64>,
    /// A text that is told as an event.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub notify: Option<String>,
}

/// Which part of the past a rule is tried against.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TryRequest {
    /// The last so many hours, 1 to 168; 24 where nothing is said.
    pub hours: Option<u64>,
    /// Since when, as RFC 3339; at most 168 hours before `until`.
    #[schema(value_type = Option<String>)]
    pub since: Option<Timestamp>,
    /// Until when, as RFC 3339; now where nothing is said.
    #[schema(value_type = Option<String>)]
    pub until: Option<Timestamp>,
    /// The rule, where none of the configuration is meant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rule: Option<RuleText>,
    /// Under which name it is to stand in the configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
}

/// When a rule would have acted, had it been armed and nothing else come of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TriedInfo {
    /// The version of the API.
    pub schema: u8,
    /// From when on was looked at.
    pub since: String,
    /// Until when was looked at.
    pub until: String,
    /// When it would have acted: the first 500 times.
    pub acts: Vec<String>,
    /// How often.
    pub count: usize,
    /// When it would have been stopped for acting too often.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// For how long nothing was known that it could go by.
    pub unknown_ms: u64,
    /// There was more than is looked at at once: it ends before what was asked for.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub cut: bool,
}
