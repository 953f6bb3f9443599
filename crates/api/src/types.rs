//! The values of the API, version 1. Fields are only ever added; readers ignore what they do
//! not know.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use utoipa::openapi::schema::SchemaType;
use utoipa::openapi::{ObjectBuilder, RefOr, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// The version of everything here.
pub const SCHEMA: u8 = 1;

/// Which site a daemon serves, as its owner may know it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SiteInfo {
    /// The version of the API.
    pub schema: u8,
    /// Nothing is real: it is the demo.
    pub demo: bool,
    /// The file of its configuration, without links on the way.
    pub config: String,
    /// The folder of what is remembered of it.
    pub state: String,
}

/// A line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LineInfo {
    /// Its name.
    pub line: String,
    /// What people call it, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub name: BTreeMap<String, String>,
    /// Where it is plugged in, as the configuration says it.
    pub port: String,
    /// How its port is.
    pub state: PortState,
    /// Why it is not up: `missing`, `permission`, `gone`, ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The program that has the port, where it is busy: `mbusd (812)`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<String>,
    /// Its speed, unless a module says otherwise.
    pub baud: u32,
    /// Its character format, as `8N1`.
    pub format: String,
    /// Something on it never stops sending.
    #[serde(default)]
    pub babble: bool,
    /// The modules on it, by name.
    pub modules: Vec<String>,
}

/// How a line's port is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PortState {
    /// It is being opened for the first time.
    Opening,
    /// It is open.
    Up,
    /// It can't be opened, or was lost; it is looked for.
    Absent,
    /// Another program has it.
    Busy,
    /// It was closed for good.
    Closed,
}

/// A module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ModuleInfo {
    /// Its name.
    pub module: String,
    /// What people call it, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub name: BTreeMap<String, String>,
    /// Where it stands; modules are shown together by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area: Option<String>,
    /// The line it hangs on.
    pub line: String,
    /// Its address.
    pub address: u8,
    /// The protocol it speaks: `rtu`, `ascii`, `lc02`, `r55`.
    pub protocol: String,
    /// Its model as flags and configuration name it: `eda9060a`, `erc8`, ...
    pub model: String,
    /// Its model as the maker writes it.
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
    /// Whether it is heard.
    pub state: ModuleState,
    /// What answers in its place says that it is: a model, or a name; only where that is another.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub answers_as: Option<String>,
    /// When a value of it was read last, as RFC 3339 in UTC; only where it is not online now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_good: Option<String>,
    /// From the beginning of a request to the end of its reply, smoothed; only while it is online.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rtt_ms: Option<f64>,
    /// Exchanges that failed within the last hour.
    pub errors_1h: u32,
    /// Replies that came too late within the last hour.
    pub late_1h: u32,
    /// What came instead of a good reply since the last one; only where it was asked and is not
    /// online now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<Lost>,
    /// Its outputs in the order of the terminals: `1`, `0`, or `?` where it is not known how
    /// it is now.
    pub outputs: String,
    /// Its digital inputs, in the same way.
    pub inputs: String,
}

/// The last failed requests to a module since its last good reply, sixteen at most.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Lost {
    /// The requests.
    pub attempts: u8,
    /// After how many of them something came that is no reply.
    pub garbled: u8,
    /// How many bytes came in all.
    pub rx_bytes: u16,
    /// Why the first of them are no reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// Whether a module is heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModuleState {
    /// It answers.
    Online,
    /// It answered before and does not now.
    Offline,
    /// It was not heard yet.
    Unheard,
    /// What answers in its place says that it is another model.
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
    /// What it is.
    pub kind: Kind,
    /// Its number among the points of its kind, from 0 whatever the label counts from.
    pub index: u8,
    /// What people call it, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub name: BTreeMap<String, String>,
    /// Its last value; none where it was never read.
    pub value: Option<Value>,
    /// The register that an analog value was read from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<u16>,
    /// The unit of an analog value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// How many decimals an analog value has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimals: Option<u8>,
    /// How far the value can be trusted.
    pub quality: Quality,
    /// Why it is bad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<Reason>,
    /// How long ago the value was read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_ms: Option<u64>,
    /// From which age on it is stale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_age_ms: Option<u64>,
    /// When the value was read, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// It is of no interest: pages leave it out unless they are asked for it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hidden: bool,
    /// It must not be written.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub locked: bool,
    /// To be switched, it wants to be told that this is meant.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    /// That is said by holding the switch.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hold: bool,
    /// The outputs that must not be on while this one is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub interlock: Vec<String>,
    /// It is switched off when it has been on for so long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_on_ms: Option<u64>,
    /// Once off, it stays so for so long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_off_ms: Option<u64>,
    /// When it is switched off because it was on for so long, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on_until: Option<String>,
    /// When a pulse that the host times ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulse_until: Option<String>,
    /// Somebody holds it, and must say so again by then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<LeaseInfo>,
    /// Switched on, it goes off by itself after this time (pulse mode).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulse_ms: Option<u64>,
}

/// Somebody holds an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseInfo {
    /// Until when, unless that is said again; as RFC 3339 in UTC.
    pub until: String,
}

/// What a point is.
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

/// How far a value can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// Read, and not older than the module's maximum age.
    Good,
    /// Read, but too long ago.
    Stale,
    /// There is no value now; where there is one, it is the last that was read.
    Bad,
}

/// Said by hand: a whole number is both of the numbers, which "one of" forbids.
impl PartialSchema for Value {
    fn schema() -> RefOr<Schema> {
        let types = SchemaType::from_iter([Type::Boolean, Type::Number]);
        let about = "on or off, high or low; or a number";
        let schema = ObjectBuilder::new().schema_type(types);
        schema.description(Some(about)).into()
    }
}

impl ToSchema for Value {}

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
    /// What answers in the place of its module says that it is another model.
    OtherModel,
    /// The port of its line can't be opened, or was lost.
    LineAbsent,
    /// Another program has the port of its line.
    LineBusy,
    /// Somebody has borrowed its line.
    #[serde(rename = "lent")]
    Exclusive,
    /// Its line was closed.
    LineClosed,
    /// One that this program does not know yet.
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
    /// All points that were asked for.
    pub points: Vec<PointInfo>,
}

/// `PUT /api/v1/points/{module}/{label}`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WriteRequest {
    /// On or off.
    pub value: bool,
    /// Read the output back and compare, where the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// Only where the output is in this state now.
    #[serde(default, rename = "if", skip_serializing_if = "Option::is_none")]
    pub only_if: Option<bool>,
    /// In the form that no module answers (0x55 boards): fastest, and nobody can know.
    #[serde(default)]
    pub no_reply: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
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
        }
    }
}

const fn yes() -> bool {
    true
}

/// How an output was written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Written {
    /// What it is now; none where nobody can know.
    pub value: Option<bool>,
    /// What it was before, where that was known.
    pub before: Option<bool>,
    /// How far that is certain.
    pub confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub took_ms: u64,
    /// Its number in the list of what was done.
    pub audit: String,
    /// A toggle that was made of a read and a write: another writer may come between.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub read_then_set: bool,
}

/// How far it is certain that a command was carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Confirmed {
    /// Read again afterwards, and as commanded.
    Readback,
    /// The module acknowledged.
    Reply,
    /// Sent; nobody answers it, so nobody can know.
    Sent,
}

/// `GET /api/v1/commands/{id}`: a command that was given lately.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CommandInfo {
    /// Its number, which is that of its entry in the list of what was done.
    pub id: String,
    /// The module it was given to.
    pub module: String,
    /// What was asked: `do0=on do1=off`, `pulse k1 500ms by host`.
    pub what: String,
    /// Who asked for it.
    pub who: String,
    /// From where.
    pub via: String,
    /// When, as RFC 3339 in UTC.
    pub at: String,
    /// How it ended: `readback`, `reply`, `sent`, or the name of what went wrong; none while it
    /// is under way.
    pub end: Option<String>,
}

/// `PUT /api/v1/modules/{module}/outputs`: several outputs of a module at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutputsRequest {
    /// The outputs by label.
    pub set: BTreeMap<String, bool>,
    /// Read them back and compare, where the module can.
    #[serde(default = "yes")]
    pub verify: bool,
    /// In the form that no module answers.
    #[serde(default)]
    pub no_reply: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
}

/// How several outputs were written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutputsWritten {
    /// Each of them by label.
    pub set: BTreeMap<String, OutputWritten>,
    /// How far that is certain.
    pub confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub took_ms: u64,
    /// Its number in the list of what was done.
    pub audit: String,
}

/// How one of several outputs was written.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutputWritten {
    /// What it is now; none where nobody can know.
    pub value: Option<bool>,
    /// What it was before, where that was known.
    pub before: Option<bool>,
}

/// `POST /api/v1/points/{module}/{label}/toggle`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ToggleRequest {
    /// By the board's own command, which is never repeated; else read first, then set.
    #[serde(default)]
    pub raw: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
}

/// `POST /api/v1/points/{module}/{label}/pulse`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PulseRequest {
    /// How long; none is the module's own width.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms: Option<u64>,
    /// Who keeps the time.
    #[serde(default)]
    pub by: Timekeeper,
    /// Release first and pull in after the time, instead of the reverse.
    #[serde(default)]
    pub off: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
}

/// Who keeps the time of a pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Timekeeper {
    /// The module where it can, else the host.
    #[default]
    Auto,
    /// The module.
    Device,
    /// The host.
    Host,
}

/// How a pulse was begun. One that the host times ends later, whoever waits for it or not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Pulsed {
    /// The state during the pulse.
    pub value: bool,
    /// What it was before, where that was known.
    pub before: Option<bool>,
    /// Who keeps the time; never `auto`.
    pub by: Timekeeper,
    /// How long it is; none where only the module knows.
    pub ms: Option<u64>,
    /// How far it is certain that it began.
    pub confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub took_ms: u64,
    /// Its number in the list of what was done.
    pub audit: String,
}

/// What came back, in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// A good reply, or a refusal.
    Answered,
    /// Bytes that are no good reply.
    Garbled,
    /// Nothing.
    Silent,
    /// Not sent: another module on the line could take it for a command.
    Unsafe,
}

/// What happens on a site: `GET /api/v1/watch`, one to a line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "ev", rename_all = "snake_case")]
pub enum WatchEvent {
    /// A point, as it is: once for each at the beginning, then whenever its value or quality
    /// changes.
    Point {
        /// The point.
        #[serde(flatten)]
        point: PointInfo,
        /// What it was before, where that was known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        before: Option<Value>,
    },
    /// A module is heard, or no longer.
    Module {
        /// The module.
        #[serde(flatten)]
        module: ModuleInfo,
    },
    /// A line's port changed.
    Line {
        /// The line.
        #[serde(flatten)]
        line: LineInfo,
    },
    /// This watcher was too slow: so many events before the next one are lost to it.
    Gap {
        /// How many.
        dropped: u64,
    },
}

/// What passes on a line: `GET /api/v1/frames/stream?line=main`, one to a line of text. Bytes as
/// the line sends and receives them; what they are is for who reads them to find out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "ev", rename_all = "snake_case")]
pub enum FrameEvent {
    /// The line that is looked at, at the beginning.
    Line {
        /// The line.
        #[serde(flatten)]
        line: LineInfo,
    },
    /// A frame was handed to the port.
    Sent {
        /// When, in microseconds since 1970.
        at_us: u64,
        /// The speed at which it leaves.
        baud: u32,
        /// In which format: `8N1`.
        format: String,
        /// In hexadecimal digits.
        bytes: String,
    },
    /// Bytes came from the port.
    Heard {
        /// When, in microseconds since 1970.
        at_us: u64,
        /// In hexadecimal digits.
        bytes: String,
    },
    /// This reader was too slow: so many events before the next one are lost to it.
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
