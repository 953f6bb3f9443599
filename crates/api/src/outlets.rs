//! The types of the API for integrations: outlets, and their kinds.

use super::problem::Problem;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A text in both languages.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct BothLanguages {
    /// In English.
    pub en: String,
    /// In Simplified Chinese.
    pub zh: String,
}

/// `GET /api/v1/outlet-kinds`: every kind of integration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutletKinds {
    /// The version of the API.
    pub schema: u8,
    /// All of them.
    pub kinds: Vec<OutletKindInfo>,
}

/// A kind of integration, and its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutletKindInfo {
    /// Its name: `webhook`.
    pub kind: String,
    /// What it is called.
    pub title: BothLanguages,
    /// What it is for.
    pub about: BothLanguages,
    /// What is to be known at the other side, a paragraph each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<BothLanguages>,
    /// Whether its integrations have a table of addresses: `…/map`.
    #[serde(default)]
    pub has_map: bool,
    /// Its settings, in the order of a form. Besides these each has `enabled`, true by default.
    pub fields: Vec<OutletField>,
}

/// A setting of an integration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutletField {
    /// Its key.
    pub key: String,
    /// What it is called.
    pub title: BothLanguages,
    /// What is to be known of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<BothLanguages>,
    /// What it can be.
    pub r#type: OutletFieldType,
    /// Whether it must be there.
    pub required: bool,
    /// The least number, or the least length in bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<i64>,
    /// The greatest number, or the greatest length in bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<i64>,
    /// What holds if it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub default: Option<serde_json::Value>,
    /// The words that it can be.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub choices: Vec<OutletChoice>,
}

/// What a setting of an integration can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutletFieldType {
    /// A text.
    Text,
    /// An address with `http` or `https`.
    Url,
    /// True or false.
    Flag,
    /// A whole number.
    Number,
    /// One of the choices.
    Choice,
    /// A list of choices; empty for all of them.
    Choices,
    /// A list of texts, as the hint says.
    Texts,
    /// The name of a line.
    Line,
    /// A list of lines; empty for all of them.
    Lines,
    /// A list of modules; empty for all of them.
    Modules,
    /// A list of selectors of points, such as `oven.*`.
    Points,
    /// A text that is set by its own route and never shown.
    Secret,
}

/// A word that a setting can be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct OutletChoice {
    /// The word in the configuration.
    pub value: String,
    /// What it is called.
    pub title: BothLanguages,
}

/// `GET /api/v1/outlets`: every integration of the configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutletList {
    /// The version of the API.
    pub schema: u8,
    /// All of them, by kind and name.
    pub outlets: Vec<OutletInfo>,
}

/// An integration, and how it does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutletInfo {
    /// Its kind.
    pub kind: String,
    /// Its name.
    pub outlet: String,
    /// Whether it is enabled.
    pub enabled: bool,
    /// Its state.
    pub state: OutletState,
    /// Since when it has been in this state, as RFC 3339 in UTC.
    pub since: String,
    /// How many times in a row it has failed.
    pub failures: u32,
    /// When it is tried again, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retry_at: Option<String>,
    /// Its settings, by the keys of its kind's fields.
    #[schema(value_type = Object)]
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// Whether it has a secret. The secret itself is never shown.
    pub secret: bool,
    /// What was delivered since the daemon started.
    pub sent: u64,
    /// What was refused, or given up after all attempts.
    pub failed: u64,
    /// What was dropped because too much waited.
    pub dropped: u64,
    /// What waits now, including what is being sent.
    pub queue: usize,
    /// How many clients are connected to it, for kinds that listen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clients: Option<usize>,
    /// When it last delivered something, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_success: Option<String>,
    /// Its last failure, if there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_error: Option<OutletError>,
}

/// The state of an integration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutletState {
    /// It has been started.
    Starting,
    /// It works.
    Running,
    /// It failed, and tries again: see `last_error` and `retry_at`.
    Waiting,
    /// It does not run.
    Stopped,
}

impl OutletState {
    /// As it is written.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            OutletState::Starting => "starting",
            OutletState::Running => "running",
            OutletState::Waiting => "waiting",
            OutletState::Stopped => "stopped",
        }
    }
}

/// A failure of an integration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutletError {
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// The attempt.
    pub tries: u32,
    /// The error, its likely causes and what to do.
    pub problem: Problem,
}

/// `GET /api/v1/outlets/{kind}/{outlet}/map`: where each point stands at the other side. With
/// `format=csv` the same as a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct OutletMap {
    /// The version of the API.
    pub schema: u8,
    /// What the columns are called.
    pub columns: Vec<BothLanguages>,
    /// The rows, a cell for each column, in the language of the request.
    pub rows: Vec<Vec<String>>,
}

/// What came of an invitation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct OutletJoined {
    /// The version of the API.
    pub schema: u8,
    /// The name of the integration.
    pub outlet: String,
    /// What this site is called at the other side.
    pub called: String,
    /// Until when that is valid, as RFC 3339 in UTC; left out where it does not end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<String>,
}

/// The result of a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutletTest {
    /// The version of the API.
    pub schema: u8,
    /// Whether it worked.
    pub ok: bool,
    /// What the other side answered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub answer: Option<String>,
    /// The duration.
    pub took_ms: u64,
    /// The error, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}
