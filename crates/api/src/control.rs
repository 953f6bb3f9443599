//! The types of the API for several outputs at once, and for scheduled actions.

use super::problem::Problem;
use super::types::Confirmed;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `POST /api/v1/batch`: several outputs of any modules.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BatchRequest {
    /// The outputs, each only once.
    pub set: Vec<BatchItem>,
    /// If one fails, the others are switched back.
    #[serde(default)]
    pub all_or_nothing: bool,
    /// Read the outputs back and compare, if the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// The operation is confirmed, for outputs that require it.
    #[serde(default)]
    pub confirm: bool,
    /// It must be sent within this time, from 200 to 60000 ms, or it is not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

const fn yes() -> bool {
    true
}

/// One of several outputs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct BatchItem {
    /// Its path: `oven.k1`.
    pub path: String,
    /// On or off.
    pub value: bool,
}

/// The result of switching several outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BatchAnswer {
    /// The version of the API.
    pub schema: u8,
    /// The results, in the order requested.
    pub results: Vec<BatchResult>,
    /// One failed, and all others were switched back.
    pub undone: bool,
}

/// The result for one of several outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BatchResult {
    /// Its path.
    pub path: String,
    /// Its state now; absent if it can't be known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<bool>,
    /// Its state before, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<bool>,
    /// How far the result is confirmed; absent if it was not switched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirmed: Option<Confirmed>,
    /// From submitting the command to the last byte of its own reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub took_ms: Option<u64>,
    /// The ID of its entry in the audit log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<String>,
    /// Why it was not switched, or was switched back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}

/// `GET /api/v1/groups`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Groups {
    /// The version of the API.
    pub schema: u8,
    /// All groups, by name.
    pub groups: Vec<GroupInfo>,
}

/// Outputs that are switched together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct GroupInfo {
    /// The group's name in the configuration.
    pub group: String,
    /// Its display name, by language.
    pub name: BTreeMap<String, String>,
    /// The paths of its outputs.
    pub members: Vec<String>,
    /// The number of frames needed to switch it.
    pub frames: usize,
}

/// `POST /api/v1/groups/{group}/set`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct GroupRequest {
    /// On, off, or toggle.
    pub value: GroupValue,
    /// If one fails, the others are switched back.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub all_or_nothing: bool,
    /// Read the outputs back and compare, if the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// The operation is confirmed, for outputs that require it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    /// It must be sent within this time, from 200 to 60000 ms, or it is not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

/// The target state of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum GroupValue {
    /// All of it on, or all of it off.
    Set(bool),
    /// Another word.
    Word(GroupWord),
}

/// The other target states of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroupWord {
    /// Off if any output is on or may be, otherwise on.
    Toggle,
}

/// `GET /api/v1/scenes`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Scenes {
    /// The version of the API.
    pub schema: u8,
    /// All scenes, by name.
    pub scenes: Vec<SceneInfo>,
}

/// Steps that are carried out one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SceneInfo {
    /// The scene's name in the configuration.
    pub scene: String,
    /// Its display name, by language.
    pub name: BTreeMap<String, String>,
    /// Its steps.
    pub steps: Vec<StepInfo>,
}

/// A step of a scene: an output and its state, or a pause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum StepInfo {
    /// An output is switched.
    Set {
        /// The path of the output.
        path: String,
        /// On or off.
        value: bool,
    },
    /// A pause.
    Wait {
        /// Its duration.
        wait_ms: u64,
    },
}

/// `POST /api/v1/scenes/{scene}/run`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SceneRequest {
    /// The operation is confirmed, for outputs that require it.
    #[serde(default)]
    pub confirm: bool,
    /// Each step must be sent within this time from when it comes, from 200 to 60000 ms, or it is
    /// not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

/// `PUT /api/v1/points/{module}/{label}/lease`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LeaseRequest {
    /// On or off.
    pub value: bool,
    /// How long it is held unless renewed: 200 ms to one hour.
    pub ttl_ms: u64,
    /// The operation is confirmed, for outputs that require it.
    #[serde(default)]
    pub confirm: bool,
    /// It must be sent within this time, from 200 to 60000 ms, or it is not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

/// The lease of an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseAnswer {
    /// Its state now; null if it can't be known.
    #[schema(required)]
    pub value: Option<bool>,
    /// Until when it is held, as RFC 3339 in UTC; absent if it is no longer held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<String>,
    /// The lease was renewed, and nothing was sent.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub renewed: bool,
    /// Its state before, if known and if it was switched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<bool>,
    /// How far the result is confirmed, if it was switched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirmed: Option<Confirmed>,
    /// The ID of the entry in the audit log, if it was switched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_is_switched_by_a_state_or_a_word() {
        let asked = |text: &str| serde_json::from_str::<GroupRequest>(text).map(|g| g.value);
        assert_eq!(asked(r#"{"value":true}"#).unwrap(), GroupValue::Set(true));
        let toggle = GroupValue::Word(GroupWord::Toggle);
        assert_eq!(asked(r#"{"value":"toggle"}"#).unwrap(), toggle);
        assert!(asked(r#"{"value":"maybe"}"#).is_err());
        assert!(asked(r#"{"value":1}"#).is_err());
    }
}
