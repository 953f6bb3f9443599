//! Frames of one's own, as the API takes them and tells of them.

use super::types::Outcome;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// `POST /api/v1/lines/{line}/send`: a frame of one's own. It is sent once.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SendRequest {
    /// The protocol that it is of: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// The request in hexadecimal digits; an ASCII frame may stand as it is, `$016`, without its
    /// end.
    pub bytes: String,
    /// The checksum and the end are missing: add them.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub complete: bool,
    /// What it may do, said by who means it: each of the words of `needs`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub confirm: Vec<String>,
    /// How long to wait for the reply to begin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timeout_ms: Option<u64>,
    /// The speed; the module's or the line's own if not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// The character format, as `8N1`; the module's or the line's own if not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// The silence before it; 20 ms or more if not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_us: Option<u64>,
    /// A lone CR goes before it, which ends what an ASCII module has half read. Reads only.
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
    /// The protocol that it is of.
    pub protocol: String,
    /// The whole frame, in hexadecimal digits.
    pub bytes: String,
    /// What it asks for, in words.
    pub meaning: String,
    /// What it may do: `read` nothing, `output` switch outputs, `settings` change what a module
    /// keeps, `broadcast` whatever it does, with all modules at once.
    pub risk: String,
    /// Somebody answers it.
    pub answered: bool,
    /// The modules of the configuration that it may change.
    pub modules: Vec<String>,
    /// What it may do, in plain words.
    pub may: Vec<String>,
    /// What the configuration says of outputs, and it does not heed.
    pub overrides: Vec<Override>,
    /// The words that `confirm` must hold, or it is not sent: that of `risk`, and `override`.
    pub needs: Vec<String>,
}

/// What is said of an output, and not heeded by a frame of one's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Override {
    /// The output: `oven.k1`.
    pub point: String,
    /// `locked`, `confirm`, `interlock`, `max_on`, `min_off`.
    pub rules: Vec<String>,
}

/// What came back to a frame of one's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SendAnswer {
    /// The version of the API.
    pub schema: u8,
    /// The line it went to.
    pub line: String,
    /// What was sent, in hexadecimal digits.
    pub sent: String,
    /// What it asked for, in words.
    pub meaning: String,
    /// What came back, in hexadecimal digits.
    pub bytes: String,
    /// In one word.
    pub outcome: Outcome,
    /// What the reply says, in words; none where there is no good one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub says: Option<String>,
    /// The module answered no.
    pub refused: bool,
    /// From the end of the request to the end of what came back.
    pub after_ms: f64,
    /// Replies to earlier frames that nobody waited for any more.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub late: Vec<LateAnswer>,
    /// Its number in the audit log; none of a read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<String>,
}

/// A reply that came too late.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LateAnswer {
    /// The protocol of what was sent: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// What was sent, in hexadecimal digits.
    pub sent: String,
    /// From the end of the request to the end of the reply.
    pub after_ms: f64,
    /// It had been answered before.
    pub again: bool,
}
