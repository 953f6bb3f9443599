//! Our own answers, received by ourselves: two-wire adapters that listen while they send.
//!
//! The answer to a write of one output is its request once more, so an echo can look exactly like
//! the next request. Taken for one it would switch, be answered, and echo again.

use super::framing::Received;
use railbus_wire::{Instant, Micros, SerialSettings};

/// Later than this after an answer was sent, nothing is its echo.
const LATEST: Micros = Micros::from_millis(500);
/// While it is not known whether there are echoes: what may be one or a request, and comes earlier
/// than this, is an echo.
const DOUBTFUL: Micros = Micros::from_millis(100);
/// After so many answers without an echo it is not known any more that there are any.
const MISSES_MAX: u8 = 3;

/// What is known of the adapter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Habit {
    /// Nothing.
    #[default]
    Unknown,
    /// Nothing, and what may have been a request was taken for an echo.
    Doubted,
    /// It echoes; how many times in a row it did not.
    Echoes(u8),
    /// It does not.
    Silent,
}

/// What may still be heard of our own answers.
#[derive(Debug, Default)]
pub(super) struct Echo {
    habit: Habit,
    sent: Option<Sent>,
}

#[derive(Debug)]
struct Sent {
    bytes: Vec<u8>,
    at: Instant,
    /// It is its request once more.
    is_request: bool,
}

impl Echo {
    /// An answer to this request is sent.
    pub(super) fn sent(&mut self, now: Instant, bytes: &[u8], request: &[u8]) {
        self.sent = Some(Sent {
            bytes: bytes.to_vec(),
            at: now,
            is_request: bytes == request,
        });
    }

    /// Something else came instead of an echo.
    pub(super) fn missed(&mut self) {
        if self.sent.take().is_none() {
            return;
        }
        self.habit = match self.habit {
            Habit::Echoes(misses) if misses + 1 < MISSES_MAX => Habit::Echoes(misses + 1),
            Habit::Echoes(_) => Habit::Unknown,
            Habit::Unknown | Habit::Doubted | Habit::Silent => Habit::Silent,
        };
    }

    /// Takes the echo of the last answer off what was received before a silence. `is_wire`: bytes
    /// take their time on the port, so that nothing comes earlier than it can.
    pub(super) fn take_off(
        &mut self,
        received: &mut Received,
        serial: SerialSettings,
        is_wire: bool,
    ) {
        let Some(sent) = &self.sent else {
            return;
        };
        let (len, heard) = (sent.bytes.len(), received.heard());
        let age = heard.since(sent.at + serial.frame_time(len));
        if age > LATEST {
            return self.missed();
        }
        let mut places = received.bytes().windows(len);
        let Some(at) = places.position(|bytes| bytes == sent.bytes) else {
            return;
        };
        let end = at + len;
        // A master that repeats its request begins when the answer and a silence are over.
        let repeated = serial.frame_time(2 * len) + serial.t3_5();
        let is_early = is_wire && heard.since(sent.at) < repeated;
        // Nothing follows a request before it is answered.
        let is_followed = end < received.bytes().len();
        let is_certain = !sent.is_request || is_early || is_followed;
        self.habit = match self.habit {
            _ if is_certain => Habit::Echoes(0),
            Habit::Echoes(_) => Habit::Echoes(0),
            Habit::Unknown if age <= DOUBTFUL => Habit::Doubted,
            Habit::Unknown | Habit::Doubted | Habit::Silent => return self.missed(),
        };
        self.sent = None;
        received.take_off(end);
    }
}
