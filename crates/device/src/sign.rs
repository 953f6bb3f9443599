//! What identifies a module: the name it reports, and for modules that report none over Modbus,
//! reads whose outcome the datasheet describes.
//!
//! That a module answers what a family answers proves nothing: many boards have eight coils there.
//! A family is only identified if its *refusals* match, too.

use railbus_wire::rtu::{self, BitSpan, Exception, Request, WordSpan};
use railbus_wire::{Address, Response};

/// A read, and its outcome according to the datasheet.
#[derive(Clone, Copy, Debug)]
pub struct Sign {
    /// The request.
    pub request: Request<'static>,
    /// The expected outcome.
    pub reply: ReadOutcome,
}

/// The outcome of a read.
#[derive(Clone, Copy, Debug)]
pub enum ReadOutcome {
    /// It is answered.
    Answer,
    /// Registers that can be those of a module at that address.
    Registers(fn(Address, &railbus_wire::Words<'_>) -> bool),
    /// A refusal with exactly this exception.
    Refusal(Exception),
    /// No reply.
    Silence,
}

impl Sign {
    /// `count` coils from `start`, and the outcome.
    pub(crate) const fn coils(start: u16, count: u16, reply: ReadOutcome) -> Option<Sign> {
        match BitSpan::new(start, count) {
            Some(span) => Some(Sign {
                request: Request::ReadCoils(span),
                reply,
            }),
            None => None,
        }
    }

    /// The same for discrete inputs.
    pub(crate) const fn inputs(start: u16, count: u16, reply: ReadOutcome) -> Option<Sign> {
        match BitSpan::new(start, count) {
            Some(span) => Some(Sign {
                request: Request::ReadDiscreteInputs(span),
                reply,
            }),
            None => None,
        }
    }

    /// The same for holding registers.
    pub(crate) const fn registers(start: u16, count: u16, reply: ReadOutcome) -> Option<Sign> {
        match WordSpan::new(start, count) {
            Some(span) => Some(Sign {
                request: Request::ReadHoldingRegisters(span),
                reply,
            }),
            None => None,
        }
    }

    /// Whether the result is what the datasheet says; none if the result proves nothing: a reply
    /// may be lost, and exception 08 means a corrupted request [ERC-8 §5.5, EMD-2A2Q §6.7].
    #[must_use]
    pub fn shown_by(&self, address: Address, response: Option<&Response<'_>>) -> Option<bool> {
        let refused = match response {
            Some(Response::Rtu(rtu::Response::Exception(why))) => Some(*why),
            _ => None,
        };
        if refused == Some(Exception::CHECKSUM) {
            return None;
        }
        match (&self.reply, response) {
            (ReadOutcome::Silence, came) => Some(came.is_none()),
            (_, None) => None,
            (ReadOutcome::Refusal(why), _) => Some(refused == Some(*why)),
            (ReadOutcome::Answer, _) => Some(refused.is_none()),
            (ReadOutcome::Registers(fit), Some(Response::Rtu(rtu::Response::Words(words)))) => {
                Some(fit(address, words))
            }
            (ReadOutcome::Registers(_), _) => Some(false),
        }
    }

    /// Whether no superset of the module would show it.
    #[must_use]
    pub const fn is_refusal(&self) -> bool {
        matches!(self.reply, ReadOutcome::Refusal(_))
    }
}

#[cfg(test)]
mod tests {
    use crate::Family;

    #[test]
    fn a_name_is_compared_whole() {
        assert_eq!(Family::of_name(b"9060A"), Some(Family::Eda9060a));
        for other in [&b"9060D"[..], b"9060AD", b"906", b"9050D", b"", b"4060"] {
            assert_eq!(Family::of_name(other), None);
        }
        assert_eq!(Family::of_number(0x235A), Some(Family::Eda9050));
        assert_eq!(Family::of_number(0x6000), None);
    }

    #[test]
    fn only_what_is_refused_proves_a_family() {
        let proven = Family::ALL.map(|family| family.signs().any(|sign| sign.is_refusal()));
        assert_eq!(proven, [false, false, true, false, true]);
        // None of the reads in the tables is out of range.
        for family in Family::ALL {
            assert_eq!(family.signs().count(), family.datasheet().signs.len());
        }
    }
}
