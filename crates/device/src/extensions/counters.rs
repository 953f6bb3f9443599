//! The eight diagnostic counters of the Modbus standard.

use crate::engine::DeviceState;
use railbus_wire::rtu::diagnosis;
use railbus_wire::{Address, Frame, Instant};

/// Counts since power-up, or since they were cleared. A counter stays at FFFF [BEYOND §4.4].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counters {
    /// Frames with a correct CRC, for any module.
    pub(crate) messages: u16,
    /// Corrupted frames.
    pub(crate) errors: u16,
    /// Exception replies.
    pub(crate) exceptions: u16,
    /// Frames for this module, and broadcasts.
    pub(crate) own: u16,
    /// Those of them without a reply.
    pub(crate) unanswered: u16,
    /// Characters that the driver lost.
    pub(crate) overruns: u16,
}

impl Counters {
    /// The counter of a sub-function. No request is ever refused as too early or busy, so two of
    /// the eight stay 0.
    pub(super) const fn get(&self, sub: u16) -> u16 {
        match sub.wrapping_sub(diagnosis::FIRST_COUNTER) {
            0 => self.messages,
            1 => self.errors,
            2 => self.exceptions,
            3 => self.own,
            4 => self.unanswered,
            7 => self.overruns,
            _ => 0,
        }
    }
}

impl DeviceState {
    /// A frame with a correct CRC was received. Returns whether it is for this module or a
    /// broadcast: then the host is alive.
    pub(crate) fn begin_message(&mut self, now: Instant, address: Address) -> bool {
        count(&mut self.counters.messages);
        let own = self.hears(address);
        if own {
            count(&mut self.counters.own);
            self.feed(now);
        }
        own
    }

    /// The reply to it [BEYOND §4.3].
    pub(crate) fn end_message(&mut self, own: bool, reply: &Frame) {
        match reply.bytes() {
            [] if own => count(&mut self.counters.unanswered),
            [_, code, ..] if code & 0x80 != 0 => count(&mut self.counters.exceptions),
            _ => {}
        }
    }

    /// Counts a corrupted frame, if `so`.
    pub(crate) const fn count_error(&mut self, so: bool) {
        if so {
            count(&mut self.counters.errors);
        }
    }
}

/// One more.
pub(crate) const fn count(counter: &mut u16) {
    *counter = counter.saturating_add(1);
}
