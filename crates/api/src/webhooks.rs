//! The types of the API for webhooks.

use super::problem::Problem;
use super::words::{SeverityWord, WebhookState};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// All webhooks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookList {
    /// The version of the API.
    pub schema: u8,
    /// All of them, by name.
    pub webhooks: Vec<WebhookInfo>,
}

/// A configured webhook.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookText {
    /// Where events are sent.
    pub url: String,
    /// The kinds of events sent; all if empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<String>,
    /// The minimum severity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub severity: Option<String>,
    /// Together with `modules`: only events about these are sent; all if empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<String>,
    /// Together with `lines`: only events about these are sent; all if empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modules: Vec<String>,
    /// True by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enabled: Option<bool>,
}

/// A webhook, and its state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookInfo {
    /// Its name.
    pub webhook: String,
    /// Where events are sent.
    pub url: String,
    /// The kinds of events sent; all if empty.
    pub events: Vec<String>,
    /// The minimum severity.
    #[schema(value_type = SeverityWord)]
    pub severity: String,
    /// Together with `modules`: only events about these are sent; all if empty.
    pub lines: Vec<String>,
    /// Together with `lines`: only events about these are sent; all if empty.
    pub modules: Vec<String>,
    /// Whether it is enabled.
    pub enabled: bool,
    /// Whether requests are signed. The secret itself is never shown.
    pub secret: bool,
    /// `off`, `idle` before the first event, `ok`, or `failing` since the last attempt.
    #[schema(value_type = WebhookState)]
    pub state: String,
    /// Number of queued events, including the one being sent.
    pub queue: usize,
    /// Number of events delivered since the daemon started.
    pub delivered: u64,
    /// Number of events given up after all attempts.
    pub failed: u64,
    /// Number of events dropped because the queue was full.
    pub dropped: u64,
    /// Time of the last delivery.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_delivery: Option<String>,
    /// The last error, if there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_error: Option<WebhookError>,
}

/// The last error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookError {
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// The attempt.
    pub tries: u32,
    /// The error.
    pub problem: Problem,
}

/// The result of a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookTest {
    /// The version of the API.
    pub schema: u8,
    /// The ID of the event that was sent.
    pub id: String,
    /// Whether it was delivered.
    pub delivered: bool,
    /// The HTTP status received.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<u16>,
    /// The duration.
    pub took_ms: u64,
    /// The error, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}
