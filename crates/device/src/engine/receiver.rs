//! Assembles characters into frames.

use railbus_wire::{Address, Decoded, FRAME_MAX, Frame, Instant, Micros, Protocol, ascii};

/// The part of a frame received so far.
#[derive(Clone, Debug)]
pub(super) struct Receiver {
    heard: Frame,
    /// More was received than fits: no frame of this protocol is that long.
    overflow: bool,
    bad_byte: bool,
    /// The frame began too soon after earlier traffic.
    too_early: bool,
    /// When the last character ended, whoever sent it.
    pub(super) last: Instant,
}

/// The frame that a silence has ended.
pub(super) struct Ended {
    /// It began late enough and is not too long.
    pub(super) heard_rightly: bool,
    /// It is longer than any frame.
    pub(super) too_long: bool,
    /// One of its characters had a wrong stop bit or parity.
    pub(super) bad_byte: bool,
}

impl Receiver {
    pub(super) const fn new(now: Instant) -> Receiver {
        Receiver {
            heard: Frame::new(),
            overflow: false,
            bad_byte: false,
            too_early: false,
            last: now,
        }
    }

    pub(super) fn has_frame(&self) -> bool {
        !self.heard.bytes().is_empty() || self.bad_byte
    }

    pub(super) fn frame(&self) -> &[u8] {
        self.heard.bytes()
    }

    /// Characters of this duration begin a frame, unless one is open: was the gap kept? An open
    /// frame may be bytes of another protocol, so a gap that was kept counts in any case.
    pub(super) fn begin(&mut self, now: Instant, took: Micros, gap: Micros) {
        let kept = self.silence_before(now, took) >= gap;
        if kept || !self.has_frame() {
            self.too_early = !kept;
        }
    }

    /// How long the line was silent before characters of this duration that end now.
    pub(super) fn silence_before(&self, now: Instant, took: Micros) -> Micros {
        now.since(self.last) - took
    }

    pub(super) fn push(&mut self, byte: u8) {
        // After a bad character the position in the frame is unknown.
        if !self.bad_byte && !self.heard.extend(&[byte]) {
            self.overflow = true;
        }
    }

    /// Takes a character of the ASCII protocol; returns a request, or the address of a bad one,
    /// when the character ends one [EDA §2.8, §2.9].
    pub(super) fn push_ascii(
        &mut self,
        byte: u8,
        rules: ascii::DecodeRules,
    ) -> Option<Result<ascii::Exchange, Option<Address>>> {
        match byte {
            b'$' | b'%' | b'#' | b'@' | b'~' => self.heard.clear(),
            b'\n' => return None,
            _ if self.heard.bytes().is_empty() => return None,
            _ => {}
        }
        self.push(byte);
        let decoded = ascii::Exchange::decode_request(self.heard.bytes(), rules);
        let result = match decoded {
            Decoded::Partial { .. } => return None,
            Decoded::Whole { value, .. } => Ok(value),
            Decoded::Malformed(_) => Err(ascii::address_of(self.heard.bytes(), rules)),
        };
        let heard_rightly = !self.too_early;
        self.clear();
        heard_rightly.then_some(result)
    }

    /// Removes the first frame from the received bytes, dropping one character after another until
    /// one decodes [R55 §1.8].
    pub(super) fn take<T>(&mut self, decode: impl Fn(&[u8]) -> Decoded<T>) -> Option<T> {
        loop {
            let heard = self.heard.bytes();
            if heard.is_empty() {
                return None;
            }
            match decode(heard) {
                Decoded::Partial { .. } if heard.len() < FRAME_MAX => return None,
                Decoded::Whole { len, value } => {
                    self.heard.drop_front(len);
                    if !self.too_early {
                        return Some(value);
                    }
                }
                Decoded::Partial { .. } | Decoded::Malformed(_) => self.heard.drop_front(1),
            }
        }
    }

    pub(super) fn bad_byte(&mut self, protocol: Protocol, now: Instant) {
        self.last = now;
        match protocol {
            Protocol::Rtu => self.bad_byte = true,
            Protocol::Ascii | Protocol::Lc02 | Protocol::R55 => self.clear(),
        }
    }

    pub(super) fn line_was_busy(&mut self, now: Instant) {
        self.clear();
        self.last = now;
    }

    pub(super) const fn end_frame(&self) -> Ended {
        Ended {
            heard_rightly: !self.overflow && !self.too_early,
            too_long: self.overflow,
            bad_byte: self.bad_byte,
        }
    }

    pub(super) fn clear(&mut self) {
        self.heard.clear();
        self.overflow = false;
        self.bad_byte = false;
    }
}
