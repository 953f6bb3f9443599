//! Listeners and capture files, whose bytes both come from elsewhere.
//!
//! Invariants: nothing panics; a listener reports every byte once and in order, whatever the pieces
//! and pauses, in frames of a bounded length, and holds back no more than a frame or two; a capture
//! file is read in steps that lie within it; a recorded frame is read back unchanged.

use railbus_sniff::capture::{self, Direction, ReadStep, Reader};
use railbus_sniff::{Input, Listener, Output, SniffEvent, SniffedFrame};
use railbus_wire::{Instant, Micros, SerialSettings};

/// A line, in pieces whose lengths and pauses come from the bytes themselves.
pub fn listened(data: &[u8]) {
    let mut listener = Listener::new(SerialSettings::FACTORY);
    let mut now = Instant(1_000_000);
    let mut told = Vec::new();
    let mut rest = data;
    while let Some(first) = rest.first() {
        let (piece, after) = rest.split_at(rest.len().min(1 + usize::from(first % 24)));
        now = now + Micros(u64::from(*first) * 97);
        match first % 11 {
            0 => listener.handle(now, Input::Sent(piece)),
            1 => {
                listener.handle(now, Input::Timeout);
                listener.handle(now, Input::Bytes(piece));
            }
            2 => {
                listener.handle(now, Input::Bytes(piece));
                listener.handle(now, Input::Silence);
            }
            _ => listener.handle(now, Input::Bytes(piece)),
        }
        drain(&mut listener, &mut told);
        rest = after;
        let given = data.len() - rest.len();
        assert!(given - told.len() <= 2 * SniffedFrame::LEN_MAX);
    }
    listener.handle(now, Input::Silence);
    drain(&mut listener, &mut told);
    assert_eq!(told, data);
}

fn drain(listener: &mut Listener, told: &mut Vec<u8>) {
    while let Output::Heard(heard) = listener.poll() {
        if let SniffEvent::Frame(frame) = heard {
            assert!(!frame.bytes.is_empty() && frame.bytes.len() <= SniffedFrame::LEN_MAX);
            assert!(frame.end >= frame.at);
            told.extend(frame.bytes);
        }
    }
}

/// A capture file, as it is and after a valid beginning.
pub fn captured(data: &[u8]) {
    read(data);
    let mut file = capture::header("fuzz");
    file.extend(data);
    read(&file);
    let mut file = capture::header("fuzz");
    file.extend(capture::interface("main", "9600 8N1"));
    file.extend(capture::packet(0, Instant(7), data, None, "ok"));
    // A damaged length, option or number somewhere in a valid file.
    if let [at, value, ..] = *data {
        let at = usize::from(at) * file.len() / 256;
        file[at] ^= value;
    }
    read(&file);
}

fn read(mut file: &[u8]) {
    let mut reader = Reader::new();
    while let Ok(step) = reader.next(file) {
        let len = match step {
            ReadStep::More(missing) => {
                assert!(missing > 0);
                return;
            }
            ReadStep::Packet(len, packet) => {
                assert!(packet.line < reader.interfaces().len());
                assert!(packet.bytes.len() <= len);
                len
            }
            ReadStep::Other(len) => len,
        };
        assert!((12..=file.len()).contains(&len));
        file = &file[len..];
    }
}

/// A frame recorded with any comment.
pub fn kept(data: &[u8]) {
    let (comment, bytes) = data.split_at(data.len() / 3);
    let comment = String::from_utf8_lossy(comment);
    let mut file = capture::header("fuzz");
    file.extend(capture::interface(&comment, "9600 8N1"));
    let head = file.len();
    let way = Some(Direction::Out);
    file.extend(capture::packet(0, Instant(1 << 40), bytes, way, &comment));
    let mut reader = Reader::new();
    let mut rest = file.as_slice();
    while rest.len() > file.len() - head {
        match reader.next(rest) {
            Ok(ReadStep::Other(len)) => rest = &rest[len..],
            other => panic!("{other:?}"),
        }
    }
    match reader.next(rest) {
        Ok(ReadStep::Packet(len, packet)) => {
            assert_eq!(len, rest.len());
            assert_eq!((packet.at, packet.bytes), (Instant(1 << 40), bytes));
            assert_eq!(packet.direction, way);
            let said = packet.comment.unwrap_or_default();
            assert!(comment.starts_with(said) && said.is_empty() == comment.is_empty());
        }
        other => panic!("{other:?}"),
    }
}
