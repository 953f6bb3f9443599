//! What a site and its centre say to each other, as `proto/railbus.proto` has it.

mod command;
mod config;

pub use command::*;
pub use config::*;
use railbus_store::outbox::{DroppedEntries, EntryKind, OutboxEntry};

/// Who asks for the session of a site.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Hello {
    /// Which installation of railbus this is.
    #[prost(bytes = "vec", tag = "1")]
    pub installation: Vec<u8>,
    /// Which run of it.
    #[prost(bytes = "vec", tag = "2")]
    pub boot: Vec<u8>,
    /// What its data is numbered by.
    #[prost(string, tag = "3")]
    pub epoch: String,
    /// The number of its newest entry.
    #[prost(uint64, tag = "4")]
    pub newest: u64,
    /// The version of railbus.
    #[prost(string, tag = "5")]
    pub version: String,
    /// Its clock, in milliseconds since 1970.
    #[prost(int64, tag = "6")]
    pub clock_ms: i64,
    /// Until when its key is valid, in seconds since 1970; none where it does not expire.
    #[prost(int64, optional, tag = "7")]
    pub key_expires_s: Option<i64>,
    /// Its own time since it started, in milliseconds.
    #[prost(uint64, tag = "8")]
    pub time_ms: u64,
}

/// The answer to [`Hello`].
#[derive(Clone, PartialEq, prost::Message)]
pub struct Welcome {
    /// A session, or none.
    #[prost(oneof = "HelloAnswer", tags = "1, 2")]
    pub answer: Option<HelloAnswer>,
    /// The clock of the centre, in milliseconds since 1970.
    #[prost(int64, tag = "3")]
    pub clock_ms: i64,
}

/// A session, or none.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum HelloAnswer {
    /// The name of the session.
    #[prost(string, tag = "1")]
    Session(String),
    /// Why there is none.
    #[prost(message, tag = "2")]
    Refusal(FleetRefusal),
}

/// Why something is not done.
#[derive(Clone, PartialEq, prost::Message)]
pub struct FleetRefusal {
    /// A stable code.
    #[prost(string, tag = "1")]
    pub code: String,
    /// In English, for logs.
    #[prost(string, tag = "2")]
    pub reason: String,
}

/// A request for a key of a site, or to renew one.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct KeyRequest {
    /// The signed claims of the invitation, or of the key.
    #[prost(string, tag = "1")]
    pub token: String,
    /// With an invitation: the public key that is to be the site's.
    #[prost(string, tag = "2")]
    pub key: String,
}

/// The answer to [`KeyRequest`].
#[derive(Clone, PartialEq, prost::Message)]
pub struct KeyAnswer {
    /// Claims, or none.
    #[prost(oneof = "KeyResult", tags = "1, 2")]
    pub end: Option<KeyResult>,
    /// The public key of the centre that signs configurations; empty if it has none.
    #[prost(string, tag = "3")]
    pub config_key: String,
}

/// Claims of a site, or none.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum KeyResult {
    /// The signed claims.
    #[prost(string, tag = "1")]
    Token(String),
    /// Why there are none.
    #[prost(message, tag = "2")]
    Refusal(FleetRefusal),
}

/// A document of the centre: the keys that it issued to a site.
#[derive(Clone, PartialEq, prost::Message)]
pub struct SiteKeys {
    /// Those that have not expired.
    #[prost(message, repeated, tag = "1")]
    pub keys: Vec<IssuedKey>,
    /// When all keys of the site were last revoked, in seconds since 1970: invitations of before
    /// count no more.
    #[prost(uint64, tag = "2")]
    pub revoked_s: u64,
}

/// A key that was issued to a site.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct IssuedKey {
    /// The public key.
    #[prost(string, tag = "1")]
    pub key: String,
    /// Until when it is valid, in seconds since 1970.
    #[prost(uint64, tag = "2")]
    pub until_s: u64,
    /// The number of the invitation by which it was asked for; empty if there was none.
    #[prost(string, tag = "3")]
    pub invitation: String,
    /// It was revoked.
    #[prost(bool, tag = "4")]
    pub is_revoked: bool,
}

/// A site is there.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Beat {
    /// As in [`Hello`].
    #[prost(bytes = "vec", tag = "1")]
    pub boot: Vec<u8>,
    /// Which session it has.
    #[prost(string, tag = "2")]
    pub session: String,
    /// Its own time since it started, in milliseconds.
    #[prost(uint64, tag = "3")]
    pub time_ms: u64,
    /// As in [`Hello`].
    #[prost(string, tag = "4")]
    pub epoch: String,
    /// As in [`Hello`].
    #[prost(uint64, tag = "5")]
    pub newest: u64,
    /// Up to which number the centre has everything.
    #[prost(uint64, tag = "6")]
    pub delivered: u64,
    /// As in [`Hello`].
    #[prost(int64, tag = "7")]
    pub clock_ms: i64,
    /// How long the oldest unacknowledged message has been waiting, in milliseconds.
    #[prost(uint64, tag = "8")]
    pub waits_ms: u64,
    /// As in [`Hello`]: the key may have been renewed since.
    #[prost(int64, optional, tag = "9")]
    pub key_expires_s: Option<i64>,
    /// How far its configuration is; none where it takes none from the centre.
    #[prost(message, optional, tag = "10")]
    pub config: Option<ConfigReport>,
}

/// Entries with consecutive numbers, the oldest first.
#[derive(Clone, PartialEq, prost::Message)]
pub struct DataBatch {
    /// What they are numbered by.
    #[prost(string, tag = "1")]
    pub epoch: String,
    /// The number of the first one.
    #[prost(uint64, tag = "2")]
    pub seq: u64,
    /// What was before them, and is there no longer.
    #[prost(message, optional, tag = "3")]
    pub dropped: Option<Dropped>,
    /// The entries.
    #[prost(message, repeated, tag = "4")]
    pub entries: Vec<DataEntry>,
    /// In which session it was sent.
    #[prost(string, tag = "5")]
    pub session: String,
}

/// Entries are wanted again.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Resend {
    /// What they are numbered by.
    #[prost(string, tag = "1")]
    pub epoch: String,
    /// The number of the first one.
    #[prost(uint64, tag = "2")]
    pub first: u64,
    /// The number of the last one.
    #[prost(uint64, tag = "3")]
    pub last: u64,
}

/// The answer to [`Resend`].
#[derive(Clone, PartialEq, prost::Message)]
pub struct ResendAnswer {
    /// None where they are on their way.
    #[prost(message, optional, tag = "1")]
    pub refusal: Option<FleetRefusal>,
}

/// A request to the API of a site.
#[derive(Clone, PartialEq, prost::Message)]
pub struct ApiRequest {
    /// The method of HTTP.
    #[prost(string, tag = "1")]
    pub method: String,
    /// The path with its query.
    #[prost(string, tag = "2")]
    pub path: String,
    /// The name of the caller at the centre.
    #[prost(string, tag = "3")]
    pub user: String,
    /// As in `Accept-Language`; empty for errors without texts.
    #[prost(string, tag = "4")]
    pub language: String,
}

/// The answer to [`ApiRequest`].
#[derive(Clone, PartialEq, prost::Message)]
pub struct ApiAnswer {
    /// None where the API was asked.
    #[prost(message, optional, tag = "1")]
    pub refusal: Option<FleetRefusal>,
    /// The status of HTTP.
    #[prost(uint32, tag = "2")]
    pub status: u32,
    /// The media type of the body.
    #[prost(string, tag = "3")]
    pub content_type: String,
    /// The body.
    #[prost(bytes = "vec", tag = "4")]
    pub body: Vec<u8>,
    /// How long the site took, in milliseconds.
    #[prost(uint64, tag = "5")]
    pub took_ms: u64,
}

/// A configuration for a site, as it is signed.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct ConfigDocument {
    /// The site.
    #[prost(string, tag = "1")]
    pub site: String,
    /// A later one is higher; the first one is 1.
    #[prost(uint64, tag = "2")]
    pub version: u64,
    /// The whole text of its file.
    #[prost(string, tag = "3")]
    pub text: String,
    /// The name of who wanted it.
    #[prost(string, tag = "4")]
    pub user: String,
    /// When, in milliseconds since 1970.
    #[prost(int64, tag = "5")]
    pub at_ms: i64,
    /// The hash of what the site said when it was wanted: it may replace that although the centre
    /// did not make it. Empty if it may not.
    #[prost(bytes = "vec", tag = "6")]
    pub replaces: Vec<u8>,
}

/// The same with its signature.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct SignedConfig {
    /// A [`ConfigDocument`], encoded.
    #[prost(bytes = "vec", tag = "1")]
    pub document: Vec<u8>,
    /// By Ed25519.
    #[prost(bytes = "vec", tag = "2")]
    pub signature: Vec<u8>,
}

/// Entries that are there no longer.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct Dropped {
    /// How many.
    #[prost(uint64, tag = "1")]
    pub count: u64,
    /// From when, in milliseconds since 1970.
    #[prost(int64, optional, tag = "2")]
    pub from_ms: Option<i64>,
    /// Until when.
    #[prost(int64, tag = "3")]
    pub to_ms: i64,
}

/// A change, or a time in which changes may be missing.
#[derive(Clone, PartialEq, prost::Message)]
pub struct DataEntry {
    /// Since when it is so, in milliseconds since 1970.
    #[prost(int64, tag = "1")]
    pub at_ms: i64,
    /// What is so.
    #[prost(oneof = "DataKind", tags = "2, 3")]
    pub what: Option<DataKind>,
}

/// What an entry says.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum DataKind {
    /// A point is so.
    #[prost(message, tag = "2")]
    Reading(UplinkReading),
    /// Changes may be missing before this.
    #[prost(message, tag = "3")]
    Gap(DataGap),
}

/// Changes may be missing before this.
#[derive(Clone, PartialEq, prost::Message)]
pub struct DataGap {
    /// Since when, in milliseconds since 1970.
    #[prost(int64, optional, tag = "1")]
    pub from_ms: Option<i64>,
    /// `stopped`, `overrun` or `disk`.
    #[prost(string, tag = "2")]
    pub reason: String,
}

/// A point: its value, and how good it is.
#[derive(Clone, PartialEq, prost::Message)]
pub struct UplinkReading {
    /// Module and label.
    #[prost(string, tag = "1")]
    pub path: String,
    /// None where it is not known.
    #[prost(oneof = "UplinkValue", tags = "2, 3, 4, 5")]
    pub value: Option<UplinkValue>,
    /// How good it is.
    #[prost(enumeration = "ReadingQuality", tag = "6")]
    pub quality: i32,
    /// Why it is not good: a word of the API.
    #[prost(string, tag = "7")]
    pub reason: String,
    /// When it was read, in milliseconds since 1970.
    #[prost(int64, optional, tag = "8")]
    pub read_ms: Option<i64>,
}

/// The value of a point.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum UplinkValue {
    /// On, or off.
    #[prost(bool, tag = "2")]
    On(bool),
    /// A whole number.
    #[prost(sint64, tag = "3")]
    Count(i64),
    /// A number.
    #[prost(double, tag = "4")]
    Number(f64),
    /// A text.
    #[prost(string, tag = "5")]
    Text(String),
}

/// How good a value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub enum ReadingQuality {
    /// A value of a newer version.
    Unspecified = 0,
    /// Read, and not older than its limit.
    Good = 1,
    /// It was so.
    Stale = 2,
    /// Not known.
    Bad = 3,
}

/// How every point of a site is after an entry.
#[derive(Clone, PartialEq, prost::Message)]
pub struct SiteState {
    /// Of which session this is.
    #[prost(string, tag = "1")]
    pub session: String,
    /// What entries are numbered by.
    #[prost(string, tag = "2")]
    pub epoch: String,
    /// The number of the entry.
    #[prost(uint64, tag = "3")]
    pub seq: u64,
    /// The points, each with the entry that is true of it.
    #[prost(message, repeated, tag = "4")]
    pub points: Vec<DataEntry>,
}

/// A document of the centre: which machine has the session of a site.
#[derive(Clone, PartialEq, prost::Message)]
pub struct SessionLease {
    /// The name of its session.
    #[prost(string, tag = "1")]
    pub session: String,
    /// As in [`Hello`].
    #[prost(bytes = "vec", tag = "2")]
    pub installation: Vec<u8>,
    /// As in [`Hello`].
    #[prost(bytes = "vec", tag = "3")]
    pub boot: Vec<u8>,
    /// Runs that had the session before, the newest last.
    #[prost(message, repeated, tag = "4")]
    pub before: Vec<EarlierRun>,
    /// As in [`Hello`].
    #[prost(string, tag = "5")]
    pub version: String,
    /// When it was given, in milliseconds since 1970.
    #[prost(int64, tag = "6")]
    pub granted_ms: i64,
    /// As in [`Hello`].
    #[prost(int64, optional, tag = "7")]
    pub key_expires_s: Option<i64>,
    /// When the site asked for it, by its own time.
    #[prost(uint64, tag = "8")]
    pub time_ms: u64,
    /// When the site was removed, in milliseconds since 1970; 0 where it was not.
    #[prost(int64, tag = "9")]
    pub removed_ms: i64,
}

impl SessionLease {
    /// Whether it says that the site was removed: no machine has its session.
    #[must_use]
    pub const fn is_removal(&self) -> bool {
        self.removed_ms != 0
    }
}

/// A document of the centre: what people say of a site.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct SiteDocument {
    /// The groups that it is in.
    #[prost(string, repeated, tag = "1")]
    pub groups: Vec<String>,
}

/// A run that had the session of a site before.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct EarlierRun {
    /// As in [`Hello`].
    #[prost(bytes = "vec", tag = "1")]
    pub boot: Vec<u8>,
    /// The name of its last session.
    #[prost(string, tag = "2")]
    pub session: String,
}

impl From<&DroppedEntries> for Dropped {
    fn from(dropped: &DroppedEntries) -> Dropped {
        Dropped {
            count: dropped.count,
            from_ms: dropped.from,
            to_ms: dropped.to,
        }
    }
}

impl From<&OutboxEntry> for DataEntry {
    fn from(entry: &OutboxEntry) -> DataEntry {
        let what = match &entry.what {
            EntryKind::Reading { .. } => reading(entry).map(DataKind::Reading),
            EntryKind::Gap { from, reason } => Some(DataKind::Gap(DataGap {
                from_ms: *from,
                reason: reason.clone(),
            })),
        };
        DataEntry {
            at_ms: entry.at,
            what,
        }
    }
}

/// The reading of an entry; none if it is a gap.
fn reading(entry: &OutboxEntry) -> Option<UplinkReading> {
    let EntryKind::Reading {
        path,
        value,
        quality,
        reason,
        time,
    } = &entry.what
    else {
        return None;
    };
    let quality = match quality.as_str() {
        "good" => ReadingQuality::Good,
        "stale" => ReadingQuality::Stale,
        "bad" => ReadingQuality::Bad,
        // One that an older program wrote.
        _ => ReadingQuality::Unspecified,
    };
    Some(UplinkReading {
        path: path.clone(),
        value: value.as_deref().and_then(point_value),
        quality: quality.into(),
        reason: reason.clone().unwrap_or_default(),
        read_ms: *time,
    })
}

/// A value as the API has it in JSON.
fn point_value(json: &str) -> Option<UplinkValue> {
    match serde_json::from_str(json).ok()? {
        serde_json::Value::Bool(on) => Some(UplinkValue::On(on)),
        serde_json::Value::Number(number) => match number.as_i64() {
            Some(count) => Some(UplinkValue::Count(count)),
            None => number.as_f64().map(UplinkValue::Number),
        },
        serde_json::Value::String(text) => Some(UplinkValue::Text(text)),
        _ => None,
    }
}
