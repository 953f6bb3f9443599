//! Replies that may be noise.

use crate::in_flight::InFlight;
use crate::{Bus, shows_order};
use railbus_wire::{Decoded, Exchange};

/// The longest reply that names no module: `>` or `?`, and the end [EDA9060A §4.3].
pub(crate) const NAMELESS_MAX: usize = 2;
/// A driver that is switched on makes a byte before a reply.
const GLITCH_MAX: usize = 1;

impl Bus {
    /// What looked like the reply may be noise, unless it followed late replies at once.
    #[cold]
    pub(crate) fn noise(&mut self, flight: &InFlight) {
        while let Some(met) = self.ghosts.take_reply(self.rx.reply()) {
            self.rx.cut(met.at, met.len);
            self.on_late_reply(met);
            if let (skip, Decoded::Whole { len, value }) =
                flight.exchange.find_response(self.rx.reply())
                && !(len <= NAMELESS_MAX && self.may_be_noise(&flight.exchange, skip))
            {
                let outcome = self.interpret(flight, &value);
                let in_order = shows_order(flight, &value);
                return self.answered(flight, (skip, len), outcome, in_order);
            }
        }
        self.missed(*flight);
    }

    /// Whether a reply of [`NAMELESS_MAX`] bytes, after `skip` others, was found in noise: there it
    /// turns up by chance, and would be taken for the module's answer.
    #[cold]
    pub(crate) fn may_be_noise(&self, exchange: &Exchange<'_>, skip: usize) -> bool {
        let is_nameless = matches!(exchange, Exchange::Ascii(_));
        is_nameless && (skip > GLITCH_MAX || self.rx.is_disturbed())
    }
}
