//! What was: samples, events and the log of what was done.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A chart of a point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistoryInfo {
    /// The version of the API.
    pub schema: u8,
    /// The path of the point.
    pub point: String,
    /// From when to when.
    pub from: String,
    /// Until when.
    pub to: String,
    /// The unit of the values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Whether these are all samples.
    pub raw: bool,
    /// Where `raw`: from when on the point had which value. The first may be older than `from`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<SampleInfo>>,
    /// Else: stretches of time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub buckets: Option<Vec<BucketInfo>>,
}

/// From when on a point had which value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SampleInfo {
    /// Milliseconds since 1970.
    pub t: i64,
    /// The value; null where nothing is known.
    pub v: Option<f64>,
    /// How good it is.
    pub q: String,
}

/// A stretch of time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BucketInfo {
    /// When it begins, in milliseconds since 1970.
    pub t: i64,
    /// The least and the greatest value, and the mean over time; null where nothing is known.
    pub min: Option<f64>,
    /// The greatest value.
    pub max: Option<f64>,
    /// The mean over time.
    pub mean: Option<f64>,
    /// How many samples fell into it.
    pub n: u32,
    /// The worst quality in it.
    pub q: String,
}

/// An event.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EventInfo {
    /// Its number; numbers sort by time.
    pub id: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// What kind of event: `write`, `module`, `line`, ...
    pub kind: String,
    /// How much it matters: `info`, `warning`, `error`.
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
    /// Who asked for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub who: Option<String>,
    /// The way it came: `cli`, `http 192.168.1.7`, ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub via: Option<String>,
    /// What was asked of the module: `do0=on do1=off`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub what: Option<String>,
    /// What was known to be before it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<String>,
    /// What was known to be after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after: Option<String>,
    /// How it ended: `readback`, `reply`, `sent`, or what went wrong.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<String>,
    /// What happened: `module_offline`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// More about it, in English.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// Who has seen it, if anybody has said so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acked: Option<AckInfo>,
}

/// Who has seen an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AckInfo {
    /// Who asked for it.
    pub who: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// What was said with it; may be empty.
    pub comment: String,
}

/// An entry of the audit log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AuditInfo {
    /// Its number; numbers sort by time.
    pub id: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// Who asked for it.
    pub who: String,
    /// The way it came: `cli`, `http 192.168.1.7`, ...
    pub via: String,
    /// The module.
    pub module: String,
    /// What was asked of the module: `do0=on do1=off`.
    pub what: String,
    /// What was known to be before it.
    pub before: String,
    /// What was known to be after it.
    pub after: String,
    /// How it ended; null while it is under way.
    pub end: Option<String>,
    /// The hash of its first record.
    pub hash: String,
}

/// A page of events.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EventPage {
    /// The version of the API.
    pub schema: u8,
    /// The newest first.
    pub items: Vec<EventInfo>,
    /// The cursor of the next page; null on the last one.
    pub next: Option<String>,
}

/// A page of the audit log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AuditPage {
    /// The version of the API.
    pub schema: u8,
    /// The newest first.
    pub items: Vec<AuditInfo>,
    /// The cursor of the next page; null on the last one.
    pub next: Option<String>,
}

/// What was found along the chain of the audit log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct VerifiedInfo {
    /// The version of the API.
    pub schema: u8,
    /// The number of the oldest record that is kept.
    pub first: u64,
    /// How many entries and records follow upon each other.
    pub entries: u64,
    /// How many records there are.
    pub records: u64,
    /// Whether all follow upon each other.
    pub ok: bool,
    /// The number of the first record that is not as it was written, or that is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub broken_at: Option<u64>,
}

/// The acknowledgement of an event.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AckRequest {
    /// What was said with it; may be empty.
    #[serde(default)]
    pub comment: String,
}

/// How much is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StorageInfo {
    /// The version of the API.
    pub schema: u8,
    /// The size of the database.
    pub history_bytes: u64,
    /// The size of what is not yet part of it.
    pub wal_bytes: u64,
    /// Of how many points there are samples.
    pub points: u64,
    /// How many samples there are.
    pub samples: u64,
    /// When the oldest sample was.
    pub oldest: Option<String>,
    /// Samples and events that were not kept.
    pub dropped: u64,
    /// There is no room left on the disk.
    pub disk_full: bool,
    /// The last transaction failed.
    pub failing: bool,
    /// The last entry of the audit log could not be written.
    pub audit_failing: bool,
    /// How much is kept at most.
    pub keep_ms: i64,
    /// The size that the database may reach.
    pub max_bytes: u64,
}
