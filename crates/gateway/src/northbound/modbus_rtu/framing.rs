//! Which of the bytes on a line are frames.
//!
//! A frame ends with a silence. Adapters pass bytes on in pieces, so what looks like a silence may
//! be none, and what looks like one frame may be several: whoever shares the line with us speaks,
//! too. What has a right CRC and the length of its function is a frame.

use railbus_wire::{FRAME_MAX, Instant, Micros, crc16};

/// After so long a pause, bytes belong to nothing that came before: longer than the 16 ms for
/// which adapters keep bytes back.
pub(super) const PIECES_MAX: Micros = Micros::from_millis(20);
/// How much is kept that makes no sense yet.
const KEPT_MAX: usize = 2 * FRAME_MAX;
/// How many silences are kept among it.
const STARTS_MAX: usize = 16;
/// How many bytes before a frame may be the noise of a line that turned round.
const STRAY_MAX: usize = 2;
/// The shortest frame: address, function and CRC.
const SHORTEST: usize = 4;

/// What was received and made no sense yet.
#[derive(Debug, Default)]
pub(super) struct Received {
    bytes: Vec<u8>,
    /// Where in it something begins after a silence.
    starts: Vec<usize>,
    /// When the last byte was received.
    heard: Instant,
    /// Too much came without a silence.
    is_flood: bool,
}

impl Received {
    /// When the last byte was received.
    pub(super) const fn heard(&self) -> Instant {
        self.heard
    }

    /// The bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Appends what was just received; `silence` is what ends a frame. Whether something before it
    /// made no sense and is given up.
    pub(super) fn push(&mut self, now: Instant, bytes: &[u8], silence: Micros) -> bool {
        let pause = now.since(self.heard);
        self.heard = now;
        let mut was_noise = false;
        if pause >= silence {
            self.is_flood = false;
            if pause >= PIECES_MAX.max(silence) || self.starts.len() >= STARTS_MAX {
                was_noise = !self.bytes.is_empty();
                self.clear();
            }
        }
        if self.is_flood {
            return was_noise;
        }
        if self.bytes.len() + bytes.len() > KEPT_MAX {
            self.clear();
            self.is_flood = true;
            return true;
        }
        if pause >= silence || self.bytes.is_empty() {
            self.starts.push(self.bytes.len());
        }
        self.bytes.extend_from_slice(bytes);
        was_noise
    }

    /// Forgets all of it.
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.starts.clear();
    }

    /// Forgets the first bytes.
    pub(super) fn take_off(&mut self, count: usize) {
        self.bytes.drain(..count.min(self.bytes.len()));
        let mut starts = vec![0];
        let rest = self.starts.iter().filter(|start| **start > count);
        starts.extend(rest.map(|start| start - count));
        starts.retain(|start| *start < self.bytes.len());
        self.starts = starts;
    }

    /// The last frame, if what was received ends with one: others may stand before it.
    pub(super) fn last_frame(&self) -> Option<&[u8]> {
        self.starts.iter().find_map(|start| {
            let mut rest = self.bytes.get(*start..)?;
            for _ in 0..=STRAY_MAX {
                if let Some(frame) = last_of(rest) {
                    return Some(frame);
                }
                rest = match rest {
                    [0x00 | 0xFF, rest @ ..] => rest,
                    _ => return None,
                };
            }
            None
        })
    }
}

/// The last of the frames that these bytes are, one behind the other; none if they are not.
fn last_of(mut bytes: &[u8]) -> Option<&[u8]> {
    loop {
        if is_frame(bytes) {
            return Some(bytes);
        }
        let lengths = [request_len(bytes), reply_len(bytes)];
        let mut cuts = lengths.into_iter().flatten();
        let cut = cuts.find(|len| bytes.get(..*len).is_some_and(is_frame))?;
        bytes = bytes.get(cut..)?;
    }
}

/// Whether this is a frame: its length is possible, and its CRC is right.
fn is_frame(bytes: &[u8]) -> bool {
    (SHORTEST..=FRAME_MAX).contains(&bytes.len()) && crc16(bytes) == 0
}

/// How long a request is, with address and CRC; none if its function does not say, or it is not
/// there so far.
pub(super) fn request_len(bytes: &[u8]) -> Option<usize> {
    let long = |at: usize, more: usize| bytes.get(at).map(|count| more + usize::from(*count));
    match bytes.get(1)? {
        0x01..=0x06 | 0x08 => Some(8),
        0x07 | 0x0B | 0x0C | 0x11 => Some(4),
        0x0F | 0x10 => long(6, 9),
        0x16 => Some(10),
        0x17 => long(10, 13),
        0x2B => Some(7),
        _ => None,
    }
}

/// The same for a reply.
fn reply_len(bytes: &[u8]) -> Option<usize> {
    match bytes.get(1)? {
        0x01..=0x04 | 0x0C | 0x11 | 0x17 => bytes.get(2).map(|count| 5 + usize::from(*count)),
        0x05 | 0x06 | 0x08 | 0x0B | 0x0F | 0x10 => Some(8),
        0x07 | 0x80.. => Some(5),
        0x16 => Some(10),
        _ => None,
    }
}
