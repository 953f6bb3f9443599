//! The values of the API, version 1. Fields are only ever added; readers ignore what they do
//! not know.

use railbus_host::Evidence;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use utoipa::openapi::schema::SchemaType;
use utoipa::openapi::{ObjectBuilder, RefOr, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// The version of everything here.
pub(crate) const SCHEMA: u8 = 1;

/// Which site a daemon serves, as its owner may know it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct SiteInfo {
    pub(crate) schema: u8,
    /// Nothing is real: it is the demo.
    pub(crate) demo: bool,
    /// The file of its configuration, without links on the way.
    pub(crate) config: String,
    /// The folder of what is remembered of it.
    pub(crate) state: String,
}

/// A line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct LineInfo {
    /// Its name.
    pub(crate) line: String,
    /// What people call it, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) name: BTreeMap<String, String>,
    /// Where it is plugged in, as the configuration says it.
    pub(crate) port: String,
    /// How its port is.
    pub(crate) state: PortState,
    /// Why it is not up: `missing`, `permission`, `gone`, ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reason: Option<String>,
    /// The program that has the port, where it is busy: `mbusd (812)`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) holder: Option<String>,
    /// Its speed, unless a module says otherwise.
    pub(crate) baud: u32,
    /// Its character format, as `8N1`.
    pub(crate) format: String,
    /// Something on it never stops sending.
    #[serde(default)]
    pub(crate) babble: bool,
    /// The modules on it, by name.
    pub(crate) modules: Vec<String>,
}

/// How a line's port is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PortState {
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
pub(crate) struct ModuleInfo {
    /// Its name.
    pub(crate) module: String,
    /// What people call it, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) name: BTreeMap<String, String>,
    /// Where it stands; modules are shown together by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) area: Option<String>,
    /// The line it hangs on.
    pub(crate) line: String,
    /// Its address.
    pub(crate) address: u8,
    /// The protocol it speaks: `rtu`, `ascii`, `lc02`, `r55`.
    pub(crate) protocol: String,
    /// Its model as flags and configuration name it: `eda9060a`, `erc8`, ...
    pub(crate) model: String,
    /// Its model as the maker writes it.
    pub(crate) title: String,
    /// Its speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) baud: Option<u32>,
    /// Its character format, as `8N1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) format: Option<String>,
    /// Whether its ASCII frames carry a checksum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) checksum: Option<bool>,
    /// Whether it is heard.
    pub(crate) state: ModuleState,
    /// What answers in its place says that it is: a model, or a name; only where that is another.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) answers_as: Option<String>,
    /// When a value of it was read last, as RFC 3339 in UTC; only where it is not online now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) last_good: Option<String>,
    /// From the beginning of a request to the end of its reply, smoothed; only while it is online.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rtt_ms: Option<f64>,
    /// Exchanges that failed within the last hour.
    pub(crate) errors_1h: u32,
    /// Replies that came too late within the last hour.
    pub(crate) late_1h: u32,
    /// What came instead of a good reply since the last one; only where it was asked and is not
    /// online now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) lost: Option<Lost>,
    /// Its outputs in the order of the terminals: `1`, `0`, or `?` where it is not known how
    /// it is now.
    pub(crate) outputs: String,
    /// Its digital inputs, in the same way.
    pub(crate) inputs: String,
}

/// The last failed requests to a module since its last good reply, sixteen at most.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Lost {
    /// The requests.
    pub(crate) attempts: u8,
    /// After how many of them something came that is no reply.
    pub(crate) garbled: u8,
    /// How many bytes came in all.
    pub(crate) rx_bytes: u16,
    /// Why the first of them are no reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) why: Option<String>,
}

impl From<Evidence> for Lost {
    fn from(met: Evidence) -> Lost {
        Lost {
            attempts: met.attempts,
            garbled: met.garbled,
            rx_bytes: met.bytes,
            why: met.why.map(|why| why.to_string()),
        }
    }
}

/// Whether a module is heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ModuleState {
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
pub(crate) struct PointInfo {
    /// Its path: `pump.do0`.
    pub(crate) path: String,
    /// Its module.
    pub(crate) module: String,
    /// Its label, as printed at the terminal.
    pub(crate) label: String,
    /// What it is.
    pub(crate) kind: Kind,
    /// Its number among the points of its kind, from 0 whatever the label counts from.
    pub(crate) index: u8,
    /// What people call it, by language.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) name: BTreeMap<String, String>,
    /// Its last value; none where it was never read.
    pub(crate) value: Option<Value>,
    /// The register that an analog value was read from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) raw: Option<u16>,
    /// The unit of an analog value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) unit: Option<String>,
    /// How many decimals an analog value has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) decimals: Option<u8>,
    /// How far the value can be trusted.
    pub(crate) quality: Quality,
    /// Why it is bad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reason: Option<Reason>,
    /// How long ago the value was read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) age_ms: Option<u64>,
    /// From which age on it is stale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_age_ms: Option<u64>,
    /// When the value was read, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) time: Option<String>,
    /// It is of no interest: pages leave it out unless they are asked for it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) hidden: bool,
    /// It must not be written.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) locked: bool,
    /// To be switched, it wants to be told that this is meant.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) confirm: bool,
    /// That is said by holding the switch.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) hold: bool,
    /// The outputs that must not be on while this one is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) interlock: Vec<String>,
    /// It is switched off when it has been on for so long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_on_ms: Option<u64>,
    /// Once off, it stays so for so long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) min_off_ms: Option<u64>,
    /// When it is switched off because it was on for so long, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) on_until: Option<String>,
    /// When a pulse that the host times ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) pulse_until: Option<String>,
    /// Somebody holds it, and must say so again by then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) lease: Option<LeaseInfo>,
    /// Switched on, it goes off by itself after this time (pulse mode).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) pulse_ms: Option<u64>,
}

/// Somebody holds an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct LeaseInfo {
    /// Until when, unless that is said again; as RFC 3339 in UTC.
    pub(crate) until: String,
}

/// What a point is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
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
pub(crate) enum Value {
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
pub(crate) enum Quality {
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
    pub(crate) const fn name(self) -> &'static str {
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
pub(crate) enum Reason {
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
    Lent,
    /// Its line was closed.
    LineClosed,
    /// One that this program does not know yet.
    #[serde(other)]
    Other,
}

/// `GET /api/v1/lines`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Lines {
    pub(crate) schema: u8,
    pub(crate) lines: Vec<LineInfo>,
}

/// `GET /api/v1/modules`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Modules {
    pub(crate) schema: u8,
    pub(crate) modules: Vec<ModuleInfo>,
}

/// `GET /api/v1/points`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Points {
    pub(crate) schema: u8,
    pub(crate) points: Vec<PointInfo>,
}

/// `PUT /api/v1/points/{module}/{label}`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct WriteRequest {
    /// On or off.
    pub(crate) value: bool,
    /// Read the output back and compare, where the module can.
    #[serde(default = "yes")]
    pub(crate) verify: bool,
    /// Only where the output is in this state now.
    #[serde(default, rename = "if", skip_serializing_if = "Option::is_none")]
    pub(crate) only_if: Option<bool>,
    /// In the form that no module answers (0x55 boards): fastest, and nobody can know.
    #[serde(default)]
    pub(crate) no_reply: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) confirm: bool,
}

impl WriteRequest {
    /// On or off, verified.
    pub(crate) const fn to(value: bool) -> WriteRequest {
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
pub(crate) struct Written {
    /// What it is now; none where nobody can know.
    pub(crate) value: Option<bool>,
    /// What it was before, where that was known.
    pub(crate) before: Option<bool>,
    /// How far that is certain.
    pub(crate) confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub(crate) took_ms: u64,
    /// Its number in the list of what was done.
    pub(crate) audit: String,
    /// A toggle that was made of a read and a write: another writer may come between.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) read_then_set: bool,
}

/// How far it is certain that a command was carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Confirmed {
    /// Read again afterwards, and as commanded.
    Readback,
    /// The module acknowledged.
    Reply,
    /// Sent; nobody answers it, so nobody can know.
    Sent,
}

/// `GET /api/v1/commands/{id}`: a command that was given lately.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub(crate) struct CommandInfo {
    /// Its number, which is that of its entry in the list of what was done.
    pub(crate) id: String,
    /// The module it was given to.
    pub(crate) module: String,
    /// What was asked: `do0=on do1=off`, `pulse k1 500ms by host`.
    pub(crate) what: String,
    /// Who asked for it.
    pub(crate) who: String,
    /// From where.
    pub(crate) via: String,
    /// When, as RFC 3339 in UTC.
    pub(crate) at: String,
    /// How it ended: `readback`, `reply`, `sent`, or the name of what went wrong; none while it
    /// is under way.
    pub(crate) end: Option<String>,
}

/// `PUT /api/v1/modules/{module}/outputs`: several outputs of a module at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct OutputsRequest {
    /// The outputs by label.
    pub(crate) set: BTreeMap<String, bool>,
    /// Read them back and compare, where the module can.
    #[serde(default = "yes")]
    pub(crate) verify: bool,
    /// In the form that no module answers.
    #[serde(default)]
    pub(crate) no_reply: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) confirm: bool,
}

/// How several outputs were written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct OutputsWritten {
    /// Each of them by label.
    pub(crate) set: BTreeMap<String, OutputWritten>,
    /// How far that is certain.
    pub(crate) confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub(crate) took_ms: u64,
    /// Its number in the list of what was done.
    pub(crate) audit: String,
}

/// How one of several outputs was written.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct OutputWritten {
    /// What it is now; none where nobody can know.
    pub(crate) value: Option<bool>,
    /// What it was before, where that was known.
    pub(crate) before: Option<bool>,
}

/// `POST /api/v1/points/{module}/{label}/toggle`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct ToggleRequest {
    /// By the board's own command, which is never repeated; else read first, then set.
    #[serde(default)]
    pub(crate) raw: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) confirm: bool,
}

/// `POST /api/v1/points/{module}/{label}/pulse`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct PulseRequest {
    /// How long; none is the module's own width.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) ms: Option<u64>,
    /// Who keeps the time.
    #[serde(default)]
    pub(crate) by: Timekeeper,
    /// Release first and pull in after the time, instead of the reverse.
    #[serde(default)]
    pub(crate) off: bool,
    /// Who asks means it, also where an output wants that to be said.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) confirm: bool,
}

/// Who keeps the time of a pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Timekeeper {
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
pub(crate) struct Pulsed {
    /// The state during the pulse.
    pub(crate) value: bool,
    /// What it was before, where that was known.
    pub(crate) before: Option<bool>,
    /// Who keeps the time; never `auto`.
    pub(crate) by: Timekeeper,
    /// How long it is; none where only the module knows.
    pub(crate) ms: Option<u64>,
    /// How far it is certain that it began.
    pub(crate) confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub(crate) took_ms: u64,
    /// Its number in the list of what was done.
    pub(crate) audit: String,
}

/// What came back, in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Outcome {
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
pub(crate) enum WatchEvent {
    /// A point, as it is: once for each at the beginning, then whenever its value or quality
    /// changes.
    Point {
        #[serde(flatten)]
        point: PointInfo,
        /// What it was before, where that was known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        before: Option<Value>,
    },
    /// A module is heard, or no longer.
    Module {
        #[serde(flatten)]
        module: ModuleInfo,
    },
    /// A line's port changed.
    Line {
        #[serde(flatten)]
        line: LineInfo,
    },
    /// This watcher was too slow: so many events before the next one are lost to it.
    Gap { dropped: u64 },
}

/// What passes on a line: `GET /api/v1/frames/stream?line=main`, one to a line of text. Bytes as
/// the line sends and receives them; what they are is for who reads them to find out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "ev", rename_all = "snake_case")]
pub(crate) enum FrameEvent {
    /// The line that is looked at, at the beginning.
    Line {
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
    Gap { dropped: u64 },
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
