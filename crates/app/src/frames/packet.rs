//! What was heard, as capture files keep it.

use super::words;
use railbus_sniff::capture::{self, Direction};
use railbus_sniff::{Frame, Heard, Role, Verdict};
use railbus_words::Lang;

/// A frame as a capture file keeps it; none of what has no bytes.
pub fn packet(lang: Lang, line: u32, heard: &Heard) -> Option<Vec<u8>> {
    let Heard::Frame(frame) = heard else {
        return None;
    };
    let comment = format!("{}: {}", frame.verdict.name(), words::of(lang, heard));
    let direction = direction(frame);
    Some(capture::packet(
        line,
        frame.at,
        &frame.bytes,
        direction,
        &comment,
    ))
}

/// Whose a frame was. Of a broken one that is a guess, and no reader is to rely on it.
fn direction(frame: &Frame) -> Option<Direction> {
    if let Verdict::Bad(_) = frame.verdict {
        return None;
    }
    match frame.readings.first()?.role? {
        Role::Request => Some(Direction::Out),
        Role::Reply => Some(Direction::In),
    }
}
