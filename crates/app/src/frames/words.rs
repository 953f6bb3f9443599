//! Frames on the line, in words.

use super::texts::FrameText;
use super::{decodings, meaning};
use railbus_sniff::{Asked, Flaw, FrameRole, FrameVerdict, Reading, SniffEvent, SniffedFrame};
use railbus_wire::{Micros, Protocol};
use railbus_words::Lang;

/// The meaning of a frame; if it can be decoded in several ways, each of them.
pub fn of(lang: Lang, heard: &SniffEvent) -> String {
    match heard {
        SniffEvent::Missing(missing) => {
            let time = millis(missing.after);
            lang.fill(FrameText::NoReplyIn, &[("time", &time)])
        }
        SniffEvent::Frame(frame) => of_frame(lang, frame),
    }
}

/// Milliseconds with one decimal.
pub fn millis(time: Micros) -> String {
    format!("{:.1}", time.0 as f64 / 1_000.0)
}

fn of_frame(lang: Lang, frame: &SniffedFrame) -> String {
    let Some((best, others)) = frame.readings.split_first() else {
        return lang.fill(FrameText::NoProtocol, &[("count", &frame.bytes.len())]);
    };
    let mut text = match frame.verdict {
        FrameVerdict::Bad(flaw) => flawed(lang, frame, best, flaw),
        FrameVerdict::Good | FrameVerdict::Refused | FrameVerdict::Unknown => {
            said(lang, frame, best)
        }
    };
    if frame.late {
        text += lang.get(FrameText::Late);
    }
    for other in others {
        let (protocol, meaning) = (other.protocol, said(lang, frame, other));
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("protocol", &protocol), ("meaning", &meaning)];
        text += &lang.fill(FrameText::OrElse, values);
    }
    text
}

/// The meaning of a valid frame in one of its readings.
fn said(lang: Lang, frame: &SniffedFrame, reading: &Reading) -> String {
    let bytes = frame.bytes.as_slice();
    if reading.role == Some(FrameRole::Request) {
        if let Some(asked) = reading.request(bytes) {
            return meaning::request(lang, &asked);
        }
        return not_known(lang, reading, bytes);
    }
    let asked = frame.asked.as_ref();
    let asked = asked.filter(|asked| asked.protocol() == reading.protocol);
    if let Some(exchange) = asked.and_then(Asked::exchange) {
        if let Some(reply) = exchange.decode_response(bytes).whole() {
            return meaning::response(lang, &exchange, &reply.response);
        }
        if frame.verdict == FrameVerdict::Refused {
            return lang.fill(FrameText::BareException, &[("code", &hex(bytes.get(2..3)))]);
        }
    }
    let supposed = railbus_sniff::replies(bytes);
    let fits =
        |(asked, ..): &&(railbus_wire::Exchange<'_>, _, _)| asked.protocol() == reading.protocol;
    match supposed.iter().find(fits) {
        Some((asked, response, _)) => meaning::response(lang, asked, response),
        None => not_known(lang, reading, bytes),
    }
}

fn not_known(lang: Lang, reading: &Reading, bytes: &[u8]) -> String {
    let at = match reading.protocol {
        Protocol::Rtu => 1,
        Protocol::R55 => 2,
        Protocol::Lc02 => 3,
        Protocol::Ascii => return lang.get(FrameText::UnknownCommand).to_owned(),
    };
    let code = hex(bytes.get(at..at + 1));
    lang.fill(FrameText::UnknownFunction, &[("code", &code)])
}

fn hex(bytes: Option<&[u8]>) -> String {
    railbus_words::hex::spaced(bytes.unwrap_or_default())
}

fn flawed(lang: Lang, frame: &SniffedFrame, reading: &Reading, flaw: Flaw) -> String {
    let count = frame.bytes.len();
    match flaw {
        Flaw::Checksum => match decodings::wrong_check(reading.protocol, &frame.bytes) {
            Some((is, should)) => {
                let values: &[(&str, &dyn std::fmt::Display)] = &[("is", &is), ("should", &should)];
                lang.fill(FrameText::WrongChecksum, values)
            }
            None => lang.get(FrameText::NoChecksum).to_owned(),
        },
        Flaw::Short => lang.fill(FrameText::CutShort, &[("count", &count)]),
        Flaw::Form => lang.get(FrameText::NotAsAsked).to_owned(),
        Flaw::Foreign => lang.fill(FrameText::NoProtocol, &[("count", &count)]),
    }
}
