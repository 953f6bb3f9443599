//! Frames on the line, for programs.

use super::facts::Facts;
use super::words;
use jiff::Timestamp;
use railbus_sniff::{FrameRole, Reading, SniffEvent};
use railbus_wire::{Instant, Micros};
use railbus_words::Lang;
use railbus_words::{hex, time};
use serde_json::{Value, json};

/// When it was received.
pub fn at(heard: &SniffEvent) -> Instant {
    match heard {
        SniffEvent::Frame(frame) => frame.at,
        SniffEvent::Missing(missing) => missing.at,
    }
}

/// A timestamp for programs.
pub fn rfc3339(at: Instant) -> String {
    time::rfc3339(timestamp(at))
}

/// The timestamp on a line whose clock started in 1970.
pub fn timestamp(at: Instant) -> Timestamp {
    let micros = i64::try_from(at.0).unwrap_or(i64::MAX);
    Timestamp::from_microsecond(micros).unwrap_or(Timestamp::MAX)
}

/// A frame or other event, for programs.
pub fn as_json(lang: Lang, line: &str, heard: &SniffEvent, facts: &Facts<'_>) -> Value {
    let millis = |time: Option<Micros>| time.map(|time| time.0 as f64 / 1_000.0);
    let mut json = json!({
        "event": "frame",
        "time": time::rfc3339(timestamp(at(heard))),
        "line": line,
        "role": role(facts.role),
        "protocol": facts.protocols.first().map(|protocol| protocol.name()),
        "address": facts.address,
        "module": facts.module,
        "meaning": words::of(lang, heard),
        "after_ms": millis(facts.after),
    });
    let rest = match heard {
        SniffEvent::Missing(missing) => json!({
            "event": "no_reply",
            "verdict": "missing",
            "bytes": hex::spaced(missing.asked.bytes()),
        }),
        SniffEvent::Frame(frame) => json!({
            "verdict": frame.verdict.name(),
            "bytes": hex::spaced(&frame.bytes),
            "gap_ms": millis(frame.gap),
            "late": frame.late,
            "asked": frame.asked.as_ref().map(|asked| hex::spaced(asked.bytes())),
            "readings": frame.readings.iter().map(reading).collect::<Vec<_>>(),
        }),
    };
    if let (Some(json), Value::Object(rest)) = (json.as_object_mut(), rest) {
        json.extend(rest);
    }
    json
}

fn role(role: Option<FrameRole>) -> Option<&'static str> {
    role.map(|role| match role {
        FrameRole::Request => "request",
        FrameRole::Reply => "reply",
    })
}

fn reading(reading: &Reading) -> Value {
    json!({
        "protocol": reading.protocol.name(),
        "role": role(reading.role),
        "address": reading.address.map(|address| address.0),
    })
}
