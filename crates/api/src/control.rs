//! The values of the API that are about several outputs, or about what is done to them later.

use super::problem::Problem;
use super::types::Confirmed;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `POST /api/v1/batch`: several outputs of any modules.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BatchRequest {
    /// The outputs, each named once.
    pub set: Vec<BatchItem>,
    /// Where one fails, what was done is taken back.
    #[serde(default)]
    pub all_or_nothing: bool,
    /// Read them back and compare, where the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default)]
    pub confirm: bool,
}

const fn yes() -> bool {
    true
}

/// One output of several.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct BatchItem {
    /// Its path: `oven.k1`.
    pub path: String,
    /// On or off.
    pub value: bool,
}

/// What came of several outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BatchAnswer {
    /// The version of the API.
    pub schema: u8,
    /// Each of them, in the order asked.
    pub results: Vec<BatchResult>,
    /// One failed, and all that was done was taken back.
    pub undone: bool,
}

/// What came of one output of several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BatchResult {
    /// Its path.
    pub path: String,
    /// What it is now; none where nobody can know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<bool>,
    /// What it was before, where that was known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<bool>,
    /// How far that is certain; none where it was not switched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirmed: Option<Confirmed>,
    /// From handing the command in to the last byte of its own reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub took_ms: Option<u64>,
    /// Its number in the list of what was done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<String>,
    /// Why it was not switched, or is not any more.
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
    /// The group's name in commands.
    pub group: String,
    /// What people call it, by language.
    pub name: BTreeMap<String, String>,
    /// The paths of its outputs.
    pub members: Vec<String>,
    /// In how many frames it is switched.
    pub frames: usize,
}

/// `POST /api/v1/groups/{group}/set`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct GroupRequest {
    /// On, off, or the other way round.
    pub value: GroupValue,
    /// Where one fails, what was done is taken back.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub all_or_nothing: bool,
    /// Read them back and compare, where the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
}

/// What a group is brought into.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum GroupValue {
    /// All of it on, or all of it off.
    Set(bool),
    /// Another word.
    Word(GroupWord),
}

/// A word for what a group is brought into.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroupWord {
    /// Off where any of it is on or may be, else on.
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

/// Steps that are done one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SceneInfo {
    /// The scene's name in commands.
    pub scene: String,
    /// What people call it, by language.
    pub name: BTreeMap<String, String>,
    /// What it does.
    pub steps: Vec<StepInfo>,
}

/// A step of a scene: an output and its state, or a pause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum StepInfo {
    /// An output is brought into a state.
    Set {
        /// The path of the output.
        path: String,
        /// On or off.
        value: bool,
    },
    /// Nothing happens for so long.
    Wait {
        /// For so long.
        wait_ms: u64,
    },
}

/// `POST /api/v1/scenes/{scene}/run`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SceneRequest {
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default)]
    pub confirm: bool,
}

/// `PUT /api/v1/points/{module}/{label}/lease`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LeaseRequest {
    /// On or off.
    pub value: bool,
    /// How long it is held unless that is said again: 200 ms to an hour.
    pub ttl_ms: u64,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default)]
    pub confirm: bool,
}

/// How an output is held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseAnswer {
    /// What it is now; none where nobody can know.
    pub value: Option<bool>,
    /// Until when it is held, as RFC 3339 in UTC; none where it is not any more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<String>,
    /// It was held already, and nothing was sent.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub renewed: bool,
    /// What it was before, where that was known and it was switched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<bool>,
    /// How far that is certain, where it was switched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirmed: Option<Confirmed>,
    /// The number in the list of what was done, where it was switched.
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
