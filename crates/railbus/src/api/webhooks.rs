//! Webhooks, as the API tells of them.

use super::problem::Problem;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// All webhooks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct WebhookList {
    pub(crate) schema: u8,
    pub(crate) webhooks: Vec<WebhookInfo>,
}

/// A webhook as the configuration has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct WebhookText {
    /// Where events are sent.
    pub(crate) url: String,
    /// The kinds of events that are sent; all of them where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) events: Vec<String>,
    /// Nothing that matters less is sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) severity: Option<String>,
    /// With `modules`: only what is about one of these is sent. Everything where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) lines: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) modules: Vec<String>,
    /// True where it is not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) enabled: Option<bool>,
}

/// A webhook, and how it does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct WebhookInfo {
    /// Its name.
    pub(crate) webhook: String,
    pub(crate) url: String,
    /// The kinds of events that are sent; all of them where there are none.
    pub(crate) events: Vec<String>,
    pub(crate) severity: String,
    pub(crate) lines: Vec<String>,
    pub(crate) modules: Vec<String>,
    pub(crate) enabled: bool,
    /// Whether what it sends is signed. The secret itself is never told.
    pub(crate) secret: bool,
    /// `off`, `idle` before the first event, `ok`, or `failing` since the last try.
    pub(crate) state: String,
    /// How many events wait, with the one that is being sent.
    pub(crate) queue: usize,
    /// How many events were taken by the receiver, since the daemon began.
    pub(crate) delivered: u64,
    /// How many were not, after all tries.
    pub(crate) failed: u64,
    /// How many were dropped because too many waited.
    pub(crate) dropped: u64,
    /// When the last event was taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) last_delivery: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) last_error: Option<WebhookError>,
}

/// What went wrong the last time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct WebhookError {
    pub(crate) at: String,
    /// At which try of the event.
    pub(crate) tries: u32,
    pub(crate) problem: Problem,
}

/// What came of a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct WebhookTest {
    pub(crate) schema: u8,
    /// The number of the event that was sent.
    pub(crate) id: String,
    /// Whether the receiver took it.
    pub(crate) delivered: bool,
    /// The HTTP status that came back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) status: Option<u16>,
    pub(crate) took_ms: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) error: Option<Problem>,
}
