//! Frames as stored in capture files.

use super::words;
use railbus_sniff::capture::{self, Direction};
use railbus_sniff::{FrameRole, FrameVerdict, SniffEvent, SniffedFrame};
use railbus_words::Lang;

/// A frame as stored in a capture file; `None` for events without bytes.
pub fn packet(lang: Lang, line: u32, heard: &SniffEvent) -> Option<Vec<u8>> {
    let SniffEvent::Frame(frame) = heard else {
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

/// The sender of a frame. For a broken one this is a guess, on which no reader should rely.
fn direction(frame: &SniffedFrame) -> Option<Direction> {
    if let FrameVerdict::Bad(_) = frame.verdict {
        return None;
    }
    match frame.readings.first()?.role? {
        FrameRole::Request => Some(Direction::Out),
        FrameRole::Reply => Some(Direction::In),
    }
}
