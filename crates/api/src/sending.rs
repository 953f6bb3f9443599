//! The types of the API for raw frames.

use super::types::Outcome;
use super::words::{SendNeed, SendRisk};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// `POST /api/v1/lines/{line}/send`: a raw frame. It is sent once.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SendRequest {
    /// Its protocol: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// The request in hexadecimal; an ASCII frame may be given as text, `$016`, without its
    /// terminator.
    pub bytes: String,
    /// Append checksum and terminator.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub complete: bool,
    /// Confirmation of what it may do: each of the words of `needs`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub confirm: Vec<String>,
    /// Timeout of the reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timeout_ms: Option<u64>,
    /// The speed; by default that of the module or line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// The character format, as `8N1`; by default that of the module or line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// The gap before it; by default at least 20 ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_us: Option<u64>,
    /// Send a lone CR first, which clears a partial command in an ASCII module. Reads only.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub clear: bool,
}

/// `POST /api/v1/lines/{line}/send?dry_run=1`: what a frame is and may do. Nothing was sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SendPlan {
    /// The version of the API.
    pub schema: u8,
    /// The line.
    pub line: String,
    /// Its protocol.
    pub protocol: String,
    /// The whole frame, in hexadecimal.
    pub bytes: String,
    /// Its meaning, in words.
    pub meaning: String,
    /// What it may do: `read` nothing, `output` switch outputs, `settings` change stored settings,
    /// `broadcast` whatever it does, in all modules at once.
    #[schema(value_type = SendRisk)]
    pub risk: String,
    /// It has a reply.
    pub answered: bool,
    /// The configured modules that it may affect.
    pub modules: Vec<String>,
    /// What it may do, in plain words.
    pub may: Vec<String>,
    /// Restrictions of the configuration that it bypasses.
    pub overrides: Vec<Override>,
    /// The words that `confirm` must contain: that of `risk`, and `override`.
    #[schema(value_type = Vec<SendNeed>)]
    pub needs: Vec<String>,
}

/// A restriction of an output that a raw frame bypasses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Override {
    /// The output: `oven.k1`.
    pub point: String,
    /// `locked`, `confirm`, `interlock`, `max_on`, `min_off`.
    pub rules: Vec<String>,
}

/// The result of a raw frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SendAnswer {
    /// The version of the API.
    pub schema: u8,
    /// The line it was sent on.
    pub line: String,
    /// What was sent, in hexadecimal.
    pub sent: String,
    /// Its meaning, in words.
    pub meaning: String,
    /// The bytes received, in hexadecimal.
    pub bytes: String,
    /// The kind of result.
    pub outcome: Outcome,
    /// The meaning of the reply, in words; absent if there is no valid one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub says: Option<String>,
    /// The module refused.
    pub refused: bool,
    /// From the end of the request to the end of the bytes received.
    pub after_ms: f64,
    /// Late replies to earlier frames.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub late: Vec<LateAnswer>,
    /// The ID in the audit log; null for a read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<String>,
}

/// A late reply.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LateAnswer {
    /// The protocol of the request: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// The request, in hexadecimal.
    pub sent: String,
    /// From the end of the request to the end of the reply.
    pub after_ms: f64,
    /// The request had already been answered.
    pub again: bool,
}
