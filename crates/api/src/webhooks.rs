//! Webhooks, as the API tells of them.

use super::problem::Problem;
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

/// A webhook as the configuration has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookText {
    /// Where events are sent.
    pub url: String,
    /// The kinds of events that are sent; all of them where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<String>,
    /// Nothing that matters less is sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub severity: Option<String>,
    /// With `modules`: only what is about one of these is sent. Everything where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<String>,
    /// With `lines`: only what is about one of these is sent. Everything where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modules: Vec<String>,
    /// True where it is not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enabled: Option<bool>,
}

/// A webhook, and how it does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookInfo {
    /// Its name.
    pub webhook: String,
    /// Where events are sent.
    pub url: String,
    /// The kinds of events that are sent; all of them where there are none.
    pub events: Vec<String>,
    /// Nothing that matters less is sent.
    pub severity: String,
    /// With `modules`: only what is about one of these is sent. Everything where there are none.
    pub lines: Vec<String>,
    /// With `lines`: only what is about one of these is sent. Everything where there are none.
    pub modules: Vec<String>,
    /// Whether it sends anything.
    pub enabled: bool,
    /// Whether what it sends is signed. The secret itself is never told.
    pub secret: bool,
    /// `off`, `idle` before the first event, `ok`, or `failing` since the last try.
    pub state: String,
    /// How many events wait, with the one that is being sent.
    pub queue: usize,
    /// How many events were taken by the receiver, since the daemon began.
    pub delivered: u64,
    /// How many were not, after all tries.
    pub failed: u64,
    /// How many were dropped because too many waited.
    pub dropped: u64,
    /// When the last event was taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_delivery: Option<String>,
    /// What went wrong the last time, if anything did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_error: Option<WebhookError>,
}

/// What went wrong the last time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookError {
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// At which try of the event.
    pub tries: u32,
    /// What went wrong.
    pub problem: Problem,
}

/// What came of a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookTest {
    /// The version of the API.
    pub schema: u8,
    /// The number of the event that was sent.
    pub id: String,
    /// Whether the receiver took it.
    pub delivered: bool,
    /// The HTTP status that came back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<u16>,
    /// How long it took.
    pub took_ms: u64,
    /// What went wrong, if anything did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}
