//! The types of the API, version 1. Fields are only ever added; clients must ignore unknown ones.

use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use utoipa::openapi::schema::SchemaType;
use utoipa::openapi::{ObjectBuilder, RefOr, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// The version of all these types.
pub const SCHEMA: u8 = 1;

/// The site that a daemon serves, reported to its owner only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SiteInfo {
    /// The version of the API.
    pub schema: u8,
    /// The demo: everything is simulated.
    pub demo: bool,
    /// Its configuration file, with links resolved.
    pub config: String,
    /// Its state folder.
    pub state: String,
}

/// A line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LineInfo {
    /// Its name.
    pub line: String,
    /// Its display name, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub name: BTreeMap<String, String>,
    /// Its port, as in the configuration.
    pub port: String,
    /// The state of its port.
    pub state: PortState,
    /// Why it is not up: `missing`, `permission`, `gone`, ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The program that uses the port, if it is busy: `mbusd (812)`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<String>,
    /// Its speed, unless a module says otherwise.
    pub baud: u32,
    /// Its character format, as `8N1`.
    pub format: String,
    /// A device on it transmits continuously.
    #[serde(default)]
    pub babble: bool,
    /// The modules on it, by name.
    pub modules: Vec<String>,
}

/// The state of a line's port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PortState {
    /// It is being opened for the first time.
    Opening,
    /// It is open.
    Up,
    /// It can't be opened, or was lost; opening is retried.
    Absent,
    /// Another program uses it.
    Busy,
    /// It was closed permanently.
    Closed,
}

/// A module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ModuleInfo {
    /// Its name.
    pub module: String,
    /// Its display name, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub name: BTreeMap<String, String>,
    /// Where it is installed; modules are grouped by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area: Option<String>,
    /// The line it is on.
    pub line: String,
    /// Its address.
    pub address: u8,
    /// Its protocol: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// Its model, as in flags and configuration: `eda9060a`, `erc8`, ...
    pub model: String,
    /// Its model, as written by the manufacturer.
    pub title: String,
    /// Its speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Its character format, as `8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Whether its ASCII frames carry a checksum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checksum: Option<bool>,
    /// Its state.
    pub state: ModuleState,
    /// The model or name reported by the module in its place; only if it is another one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub answers_as: Option<String>,
    /// When one of its values was last read, as RFC 3339 in UTC; only if it is not online.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_good: Option<String>,
    /// From the beginning of a request to the end of its reply, smoothed; only while it is online.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rtt_ms: Option<f64>,
    /// Failed exchanges of the last hour.
    pub errors_1h: u32,
    /// Late replies of the last hour.
    pub late_1h: u32,
    /// What was received instead of a valid reply since the last one; only if requests were sent
    /// and it is not online.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<Lost>,
    /// Its outputs in the order of the terminals: `1`, `0`, or `?` if the current state is not
    /// known.
    pub outputs: String,
    /// Its digital inputs, in the same way.
    pub inputs: String,
}

/// The last failed requests to a module since its last good reply, sixteen at most.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Lost {
    /// The requests.
    pub attempts: u8,
    /// How many of them received bytes that are not a valid reply.
    pub garbled: u8,
    /// Number of bytes received in total.
    pub rx_bytes: u16,
    /// Why the first of them are not a valid reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// The state of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModuleState {
    /// It answers.
    Online,
    /// It answered before, but no longer.
    Offline,
    /// It has not answered yet.
    Unheard,
    /// Another model answers in its place.
    OtherModel,
}

/// A point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PointInfo {
    /// Its path: `pump.do0`.
    pub path: String,
    /// Its module.
    pub module: String,
    /// Its label, as printed at the terminal.
    pub label: String,
    /// Its kind.
    pub kind: Kind,
    /// Its index among the points of its kind, from 0 whatever the label starts with.
    pub index: u8,
    /// Its display name, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub name: BTreeMap<String, String>,
    /// Its last value; null if it was never read.
    #[schema(required, value_type = Option<PointValue>)]
    pub value: Option<Value>,
    /// The register of an analog value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<u16>,
    /// The unit of an analog value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// How many decimals an analog value has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimals: Option<u8>,
    /// The quality of the value.
    pub quality: Quality,
    /// Why it is bad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<Reason>,
    /// The age of the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_ms: Option<u64>,
    /// The age from which on it is stale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_age_ms: Option<u64>,
    /// When the value was read, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// Not shown on the pages by default.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hidden: bool,
    /// It can't be written.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub locked: bool,
    /// Switching it requires confirmation.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    /// Confirmation is by holding the switch.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hold: bool,
    /// Outputs that must not be on at the same time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub interlock: Vec<String>,
    /// Maximum on-time, after which it is switched off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_on_ms: Option<u64>,
    /// Minimum off-time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_off_ms: Option<u64>,
    /// When its maximum on-time ends, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on_until: Option<String>,
    /// When a pulse that the host times ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulse_until: Option<String>,
    /// It is held by a lease, which must be renewed by then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<LeaseInfo>,
    /// After being switched on, it switches off by itself after this time (pulse mode).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulse_ms: Option<u64>,
}

/// The lease of an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseInfo {
    /// Its end unless renewed, as RFC 3339 in UTC.
    pub until: String,
}

/// The kind of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A relay or transistor.
    Output,
    /// A digital input.
    Input,
    /// An analog input.
    Analog,
    /// An internal variable of a 0x55 board.
    Variable,
}

/// The value of a point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// An output is on, or an input is high or open.
    Bool(bool),
    /// An internal variable.
    Number(u32),
    /// An analog value in its unit.
    Analog(f64),
}

/// The quality of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// Read, and not older than the module's maximum age.
    Good,
    /// Read, but too long ago.
    Stale,
    /// There is no current value; if there is a value, it is the last one read.
    Bad,
}

/// Implemented by hand: a whole number matches both number types, which "one of" forbids.
impl PartialSchema for Value {
    fn schema() -> RefOr<Schema> {
        let types = SchemaType::from_iter([Type::Boolean, Type::Number]);
        let about = "on or off, high or low; or a number";
        let schema = ObjectBuilder::new().schema_type(types);
        schema.description(Some(about)).into()
    }
}

impl ToSchema for Value {
    fn name() -> Cow<'static, str> {
        Cow::Borrowed("PointValue")
    }
}

/// The name by which the document refers to it: utoipa takes any `Value` for arbitrary JSON.
pub(crate) type PointValue = Value;

impl Quality {
    /// The name in JSON and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Quality::Good => "good",
            Quality::Stale => "stale",
            Quality::Bad => "bad",
        }
    }
}

/// Why a value is bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// It was never read.
    NeverRead,
    /// Its module does not answer.
    Offline,
    /// Another model answers in the place of its module.
    OtherModel,
    /// The port of its line can't be opened, or was lost.
    LineAbsent,
    /// Another program uses the port of its line.
    LineBusy,
    /// Its line is lent to another program.
    #[serde(rename = "lent")]
    Exclusive,
    /// Its line was closed.
    LineClosed,
    /// A reason unknown to this program.
    #[serde(other)]
    Other,
}

/// `GET /api/v1/lines`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Lines {
    /// The version of the API.
    pub schema: u8,
    /// All lines of the site.
    pub lines: Vec<LineInfo>,
}

/// `GET /api/v1/modules`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Modules {
    /// The version of the API.
    pub schema: u8,
    /// All modules of the site.
    pub modules: Vec<ModuleInfo>,
}

/// `GET /api/v1/points`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Points {
    /// The version of the API.
    pub schema: u8,
    /// The selected points.
    pub points: Vec<PointInfo>,
}

/// `PUT /api/v1/points/{module}/{label}`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WriteRequest {
    /// On or off.
    pub value: bool,
    /// Read the output back and compare, if the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// Only if the output is in this state now.
    #[serde(default, rename = "if", skip_serializing_if = "Option::is_none")]
    pub only_if: Option<bool>,
    /// Use the command without reply (0x55 boards): fastest, but the result can't be known.
    #[serde(default)]
    pub no_reply: bool,
    /// The operation is confirmed, for outputs that require it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    /// It must be sent within this time, from 200 to 60000 ms, or it is not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

impl WriteRequest {
    /// On or off, verified.
    pub const fn to(value: bool) -> WriteRequest {
        WriteRequest {
            value,
            verify: true,
            only_if: None,
            no_reply: false,
            confirm: false,
            within_ms: None,
        }
    }
}

const fn yes() -> bool {
    true
}

/// The result of switching an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Written {
    /// Its state now; null if it can't be known.
    #[schema(required)]
    pub value: Option<bool>,
    /// Its state before, if known.
    #[schema(required)]
    pub before: Option<bool>,
    /// How far the result is confirmed.
    pub confirmed: Confirmed,
    /// From submitting the command to the last byte of its own reply.
    pub took_ms: u64,
    /// The ID of its entry in the audit log.
    pub audit: String,
    /// A toggle made of a read and a write: another client may switch it in between.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub read_then_set: bool,
}

/// How far the result of a command is confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Confirmed {
    /// Read back, and as commanded.
    Readback,
    /// The module acknowledged.
    Reply,
    /// Sent; it has no reply, so the result can't be known.
    Sent,
}

/// `GET /api/v1/commands/{id}`: a recent command.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CommandInfo {
    /// Its ID, which is that of its entry in the audit log.
    pub id: String,
    /// Its module.
    pub module: String,
    /// The command: `do0=on do1=off`, `pulse k1 500ms by host`.
    pub what: String,
    /// Who requested it.
    pub who: String,
    /// From where.
    pub via: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// Its result: `readback`, `reply`, `sent`, or the name of the error; null while it is in
    /// progress.
    #[schema(required)]
    pub end: Option<String>,
}

/// `PUT /api/v1/modules/{module}/outputs`: several outputs of a module at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutputsRequest {
    /// The outputs by label.
    pub set: BTreeMap<String, bool>,
    /// Read the outputs back and compare, if the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// Use the command without reply.
    #[serde(default)]
    pub no_reply: bool,
    /// The operation is confirmed, for outputs that require it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    /// It must be sent within this time, from 200 to 60000 ms, or it is not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

/// The result of switching several outputs of a module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutputsWritten {
    /// The results by label.
    pub set: BTreeMap<String, OutputWritten>,
    /// How far the result is confirmed.
    pub confirmed: Confirmed,
    /// From submitting the command to the last byte of its own reply.
    pub took_ms: u64,
    /// The ID of its entry in the audit log.
    pub audit: String,
}

/// The result for one of several outputs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutputWritten {
    /// Its state now; null if it can't be known.
    #[schema(required)]
    pub value: Option<bool>,
    /// Its state before, if known.
    #[schema(required)]
    pub before: Option<bool>,
}

/// `POST /api/v1/points/{module}/{label}/toggle`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ToggleRequest {
    /// Use the board's own command, which is never repeated; otherwise read first, then set.
    #[serde(default)]
    pub raw: bool,
    /// The operation is confirmed, for outputs that require it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    /// It must be sent within this time, from 200 to 60000 ms, or it is not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

/// `POST /api/v1/points/{module}/{label}/pulse`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PulseRequest {
    /// The width; by default the module's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms: Option<u64>,
    /// What times it.
    #[serde(default)]
    pub by: Timekeeper,
    /// Off first, and on after the time, instead of the reverse.
    #[serde(default)]
    pub off: bool,
    /// The operation is confirmed, for outputs that require it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    /// It must be sent within this time, from 200 to 60000 ms, or it is not sent; 5000 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ms: Option<u64>,
}

/// What times a pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Timekeeper {
    /// The module if it can, otherwise the host.
    #[default]
    Auto,
    /// The module.
    Device,
    /// The host.
    Host,
}

/// The start of a pulse. One timed by the host ends later, whether or not a client waits for it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Pulsed {
    /// The state during the pulse.
    pub value: bool,
    /// Its state before, if known.
    #[schema(required)]
    pub before: Option<bool>,
    /// What times it; never `auto`.
    pub by: Timekeeper,
    /// Its width; null if only the module knows.
    #[schema(required)]
    pub ms: Option<u64>,
    /// How far its start is confirmed.
    pub confirmed: Confirmed,
    /// From submitting the command to the last byte of its own reply.
    pub took_ms: u64,
    /// The ID of its entry in the audit log.
    pub audit: String,
}

/// The kind of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// A valid reply, or a refusal.
    Answered,
    /// Bytes that are not a valid reply.
    Garbled,
    /// No reply.
    Silent,
    /// Not sent: another module on the line could take it for a command.
    Unsafe,
}

/// The events of a site: `GET /api/v1/watch`, one per line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "ev", rename_all = "snake_case")]
pub enum WatchEvent {
    /// A point: each one once at the beginning, then whenever its value or quality changes.
    Point {
        /// The point.
        #[serde(flatten)]
        point: PointInfo,
        /// Its value before, if known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schema(value_type = Option<PointValue>)]
        before: Option<Value>,
    },
    /// A module came online or went offline.
    Module {
        /// The module.
        #[serde(flatten)]
        module: ModuleInfo,
    },
    /// The state of a line's port changed.
    Line {
        /// The line.
        #[serde(flatten)]
        line: LineInfo,
    },
    /// This client was too slow: events before the next one are missing.
    Gap {
        /// How many.
        dropped: u64,
    },
}

/// The traffic on a line: `GET /api/v1/frames/stream?line=main`, one event per line of text. Bytes
/// as sent and received; decoding them is up to the reader.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "ev", rename_all = "snake_case")]
pub enum FrameEvent {
    /// The observed line, at the beginning.
    Line {
        /// The line.
        #[serde(flatten)]
        line: LineInfo,
    },
    /// A frame was written to the port.
    Sent {
        /// When, in microseconds since 1970.
        at_us: u64,
        /// Its speed.
        baud: u32,
        /// Its character format: `8N1`.
        format: String,
        /// In hexadecimal.
        bytes: String,
    },
    /// Bytes were received.
    Heard {
        /// When, in microseconds since 1970.
        at_us: u64,
        /// In hexadecimal.
        bytes: String,
    },
    /// This client was too slow: events before the next one are missing.
    Gap {
        /// How many.
        dropped: u64,
    },
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Bool(on) => on.fmt(f),
            Value::Number(number) => number.fmt(f),
            Value::Analog(value) => value.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exclusive_access_keeps_its_word() {
        let word = serde_json::to_value(Reason::Exclusive).unwrap();
        assert_eq!(word, "lent");
        let schema = serde_json::to_string(&Reason::schema()).unwrap();
        assert!(schema.contains("\"lent\""), "{schema}");
    }

    #[test]
    fn a_write_is_short_to_ask_for() {
        let asked: WriteRequest = serde_json::from_str(r#"{"value":true}"#).unwrap();
        assert_eq!(asked, WriteRequest::to(true));
        let asked: WriteRequest = serde_json::from_str(r#"{"value":false,"if":true}"#).unwrap();
        assert_eq!(asked.only_if, Some(true));
        let asked: PulseRequest = serde_json::from_str("{}").unwrap();
        assert_eq!(asked, PulseRequest::default());
    }

    #[test]
    fn values_come_back_as_they_went() {
        for value in [Value::Bool(true), Value::Number(7), Value::Analog(5.0)] {
            let text = serde_json::to_string(&value).unwrap();
            assert_eq!(
                serde_json::from_str::<Value>(&text).unwrap(),
                value,
                "{text}"
            );
        }
    }

    #[test]
    fn an_event_says_what_it_is() {
        let text = serde_json::to_string(&WatchEvent::Gap { dropped: 3 }).unwrap();
        assert_eq!(text, r#"{"ev":"gap","dropped":3}"#);
    }
}
