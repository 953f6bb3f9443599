//! Our own answers, received by ourselves: two-wire adapters that listen while they send.
//!
//! The answer to a write of one output is its request once more, so an echo can look exactly like
//! the next request. Taken for one it would switch, be answered, and echo again.

use super::framing::Received;
use railbus_wire::{Instant, Micros, SerialSettings};

/// While it is not known whether there are echoes: what looks like one and comes later than this
/// after the answer is a request.
const LATEST: Micros = Micros::from_millis(500);
/// After so many answers in a row without an echo it is not known any more that there are any;
/// after as many again it is known that there are none.
const MISSES_MAX: u8 = 3;

/// What is known of the adapter. Only what can't be a request shows that it echoes, and only other
/// requests instead of echoes that it does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Habit {
    /// Nothing; how many times in a row there was no echo.
    Unknown(u8),
    /// It echoes; how many times in a row it did not.
    Echoes(u8),
    /// It does not.
    Silent,
}

impl Default for Habit {
    fn default() -> Habit {
        Habit::Unknown(0)
    }
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
            Habit::Echoes(_) => Habit::Unknown(0),
            Habit::Unknown(misses) if misses + 1 < MISSES_MAX => Habit::Unknown(misses + 1),
            Habit::Unknown(_) | Habit::Silent => Habit::Silent,
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
        let mut places = received.bytes().windows(len);
        let Some(at) = places.position(|bytes| bytes == sent.bytes) else {
            return;
        };
        let end = at + len;
        // A master that repeats its request begins when the answer and a silence are over.
        let repeated = serial.frame_time(2 * len) + serial.t3_5();
        let is_early = is_wire && heard.since(sent.at) < repeated;
        // The master asks something else: whatever it was, it is over.
        let is_followed = end < received.bytes().len();
        let is_recent = heard.since(sent.at + serial.frame_time(len)) <= LATEST;
        let is_certain = !sent.is_request || is_early;
        self.sent = None;
        let is_echo = match self.habit {
            _ if is_certain => {
                self.habit = Habit::Echoes(0);
                true
            }
            // However late: this machine may have had no time for it.
            Habit::Echoes(_) => true,
            // A request that is lost so is repeated by its master. An echo that is taken for a
            // request would switch, be answered, and echo again.
            Habit::Unknown(_) => is_recent || is_followed,
            Habit::Silent => is_followed,
        };
        if is_echo {
            received.take_off(end);
        }
    }
}
