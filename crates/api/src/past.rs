//! The past: samples, events and the audit log.

use super::types::Quality;
use super::words::{EventKindWord, SeverityWord};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A chart of a point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistoryInfo {
    /// The version of the API.
    pub schema: u8,
    /// The path of the point.
    pub point: String,
    /// Start.
    pub from: String,
    /// End.
    pub to: String,
    /// The unit of the values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Whether these are all samples.
    pub raw: bool,
    /// If `raw`: the samples. The first may be older than `from`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<SampleInfo>>,
    /// Otherwise: buckets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub buckets: Option<Vec<BucketInfo>>,
}

/// The value of a point from a time on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SampleInfo {
    /// Milliseconds since 1970.
    pub t: i64,
    /// The value; null if unknown.
    #[schema(required)]
    pub v: Option<f64>,
    /// Its quality.
    #[schema(value_type = Quality)]
    pub q: String,
}

/// A bucket.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BucketInfo {
    /// When it begins, in milliseconds since 1970.
    pub t: i64,
    /// Minimum, maximum and mean over time; null if unknown.
    #[schema(required)]
    pub min: Option<f64>,
    /// The maximum.
    #[schema(required)]
    pub max: Option<f64>,
    /// The mean over time.
    #[schema(required)]
    pub mean: Option<f64>,
    /// Number of samples in it.
    pub n: u32,
    /// The worst quality in it.
    #[schema(value_type = Quality)]
    pub q: String,
}

/// An event.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EventInfo {
    /// Its ID; IDs sort by time.
    pub id: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// What kind of event: `write`, `module`, `line`, ...
    #[schema(value_type = EventKindWord)]
    pub kind: String,
    /// Its severity: `info`, `warning`, `error`.
    #[schema(value_type = SeverityWord)]
    pub severity: String,
    /// The module.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub module: Option<String>,
    /// The path of a point: `pump.do0`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<String>,
    /// The line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<String>,
    /// Who requested it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub who: Option<String>,
    /// How the request came in: `cli`, `http 192.168.1.7`, ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub via: Option<String>,
    /// The command to the module: `do0=on do1=off`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub what: Option<String>,
    /// The known state before it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<String>,
    /// The known state after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after: Option<String>,
    /// Its result: `readback`, `reply`, `sent`, or the name of the error.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<String>,
    /// The event itself: `module_offline`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// Details, in English.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// Its acknowledgement, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acked: Option<AckInfo>,
}

/// The acknowledgement of an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AckInfo {
    /// Who acknowledged it.
    pub who: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// The comment; may be empty.
    pub comment: String,
}

/// An entry of the audit log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AuditInfo {
    /// Its ID; IDs sort by time.
    pub id: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// Who requested it.
    pub who: String,
    /// How the request came in: `cli`, `http 192.168.1.7`, ...
    pub via: String,
    /// The module.
    pub module: String,
    /// The command to the module: `do0=on do1=off`.
    pub what: String,
    /// The known state before it.
    pub before: String,
    /// The known state after it.
    pub after: String,
    /// Its result; null while it is in progress.
    #[schema(required)]
    pub end: Option<String>,
    /// The hash of its first record.
    pub hash: String,
}

/// A page of events.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EventPage {
    /// The version of the API.
    pub schema: u8,
    /// Newest first.
    pub items: Vec<EventInfo>,
    /// The cursor of the next page; null on the last one.
    #[schema(required)]
    pub next: Option<String>,
}

/// A page of the audit log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AuditPage {
    /// The version of the API.
    pub schema: u8,
    /// Newest first.
    pub items: Vec<AuditInfo>,
    /// The cursor of the next page; null on the last one.
    #[schema(required)]
    pub next: Option<String>,
}

/// The result of verifying the audit log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct VerifiedInfo {
    /// The version of the API.
    pub schema: u8,
    /// The number of the oldest record kept.
    pub first: u64,
    /// The number of consecutive entries.
    pub entries: u64,
    /// The number of consecutive records.
    pub records: u64,
    /// Whether the chain is intact.
    pub ok: bool,
    /// The number of the first record that was changed or is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub broken_at: Option<u64>,
}

/// To acknowledge an event.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AckRequest {
    /// A comment; may be empty.
    #[serde(default)]
    pub comment: String,
}

/// Size and state of the history.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StorageInfo {
    /// The version of the API.
    pub schema: u8,
    /// The size of the database.
    pub history_bytes: u64,
    /// The size of the write-ahead log.
    pub wal_bytes: u64,
    /// Number of points with samples.
    pub points: u64,
    /// How many samples there are.
    pub samples: u64,
    /// The time of the oldest sample.
    #[schema(required)]
    pub oldest: Option<String>,
    /// Samples and events that were dropped.
    pub dropped: u64,
    /// The disk is full.
    pub disk_full: bool,
    /// The last transaction failed.
    pub failing: bool,
    /// The last entry of the audit log could not be written.
    pub audit_failing: bool,
    /// The maximum age.
    pub keep_ms: i64,
    /// The maximum size of the database.
    pub max_bytes: u64,
}
