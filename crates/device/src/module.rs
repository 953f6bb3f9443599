//! A module as the host sees it: ops become exchanges, replies become observations.

use crate::{Bank, Family, Observation, Op, Refusal, Setup, SetupError, Unsupported};
use crate::{eda, emd2a2q, erc8, modbus, r55};
use railbus_wire::{Exchange, Protocol, Response, ascii, rtu};

/// A module on a line, seen from the host.
#[derive(Clone, Debug)]
pub struct Module {
    setup: Setup,
    /// Which outputs give pulses; unknown until the module has been asked.
    pulse_mask: Option<u8>,
}

impl Module {
    /// A module with this setup.
    ///
    /// # Errors
    /// If the setup is not possible for the family.
    pub fn new(setup: Setup) -> Result<Module, SetupError> {
        setup.check()?;
        let pulse_mask = match setup.family {
            Family::Eda9060a => None,
            Family::Eda9050 | Family::Erc8 | Family::R55 | Family::Emd2a2q => Some(0),
        };
        Ok(Module { setup, pulse_mask })
    }

    /// Its setup.
    #[must_use]
    pub const fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The single exchange for an op.
    ///
    /// # Errors
    /// [`Unsupported`] if the model has no single frame for it, or not in this protocol.
    pub fn exchange(&self, op: &Op) -> Result<Exchange<'static>, Unsupported> {
        let setup = &self.setup;
        match (setup.family, op) {
            (_, Op::Write(bank) | Op::WriteSilent(bank))
                if bank.mask == 0 || bank.mask & !setup.output_mask() != 0 =>
            {
                None
            }
            (Family::Eda9060a | Family::Eda9050, _) => eda::exchange(setup, op),
            (Family::Erc8, _) => erc8::exchange(setup, op),
            (Family::Emd2a2q, _) => emd2a2q::exchange(setup, op),
            (Family::R55, _) => r55::exchange(setup, op),
        }
        .ok_or(Unsupported)
    }

    /// Decodes the reply to an op into channel terms.
    #[must_use]
    pub fn interpret(&self, op: &Op, response: &Response<'_>) -> Observation {
        let seen = match (response, self.setup.family) {
            (Response::Rtu(rtu::Response::Exception(why)), _) => {
                Some(Observation::Refused(Refusal::Exception(*why)))
            }
            (Response::Ascii(ascii::Response::Invalid), _) => {
                Some(Observation::Refused(Refusal::Invalid))
            }
            (Response::Ascii(ascii::Response::Ignored), _) => {
                Some(Observation::Refused(Refusal::WatchdogTripped))
            }
            // Only the fact that it answered matters.
            _ if matches!(op, Op::Fence) => Some(Observation::Done),
            (_, Family::Eda9060a | Family::Eda9050) => eda::interpret(&self.setup, op, response),
            (_, Family::Erc8) => erc8::interpret(op, response),
            (_, Family::Emd2a2q) => emd2a2q::interpret(op, response),
            (_, Family::R55) => r55::interpret(&self.setup, op, response),
        };
        seen.unwrap_or(Observation::Unexpected)
    }

    /// Whether the answer to [`Op::Identify`] fits this model. A module that does not name its
    /// model is never contradicted.
    #[must_use]
    pub fn recognises(&self, seen: &Observation) -> bool {
        match self.setup.family {
            Family::Eda9060a | Family::Eda9050 => eda::recognises(&self.setup, seen),
            Family::Erc8 | Family::R55 | Family::Emd2a2q => true,
        }
    }

    /// Whether [`Op::Identify`] can show that another model answers.
    #[must_use]
    pub fn can_be_contradicted(&self) -> bool {
        let says_so = matches!(self.setup.family, Family::Eda9060a | Family::Eda9050);
        says_so && self.exchange(&Op::Identify).is_ok()
    }

    /// Remembers what affects later ops.
    pub fn learn(&mut self, seen: &Observation) {
        if let Observation::Pulse { mask, .. } = seen {
            self.pulse_mask = Some(*mask);
        }
    }

    /// Whether doing the op twice is the same as doing it once. Toggles and jogs are not, nor is
    /// switching on an output that gives pulses: the second command extends the pulse
    /// [EDA9060A §3.7].
    #[must_use]
    pub fn repeatable(&self, op: &Op) -> bool {
        match op {
            Op::Write(bank) | Op::WriteSilent(bank) => {
                bank.on & u32::from(self.pulse_mask.unwrap_or(u8::MAX)) == 0
            }
            Op::Toggle(_) | Op::Jog { .. } | Op::Configure(_) => false,
            Op::WriteVariable(..) => true,
            read => read.is_read(),
        }
    }

    /// Which outputs give pulses; none as long as the module has not reported it.
    #[must_use]
    pub fn pulses(&self) -> Option<u32> {
        let mask = self.pulse_mask.map(u32::from);
        mask.map(|mask| mask & self.setup.output_mask())
    }

    /// The ops that read everything once.
    pub fn full_poll(&self) -> impl Iterator<Item = Op> + use<> {
        let setup = self.setup;
        let one_frame = matches!(
            setup.protocol,
            Protocol::Ascii | Protocol::Lc02 | Protocol::R55
        );
        let outputs = setup.outputs > 0 || one_frame;
        let inputs = setup.inputs > 0 && !one_frame;
        let channels = [
            outputs.then_some(Op::ReadOutputs),
            inputs.then_some(Op::ReadInputs),
            (setup.family.profile().analogs > 0).then_some(Op::ReadAnalogs),
        ];
        channels
            .into_iter()
            .flatten()
            .chain((0..setup.variables).map(Op::ReadVariable))
    }

    /// The op to run once whenever the module comes online, because its reaction to commands may
    /// have been changed. None if that can't change.
    #[must_use]
    pub const fn on_online_op(&self) -> Option<Op> {
        match self.setup.family {
            Family::Eda9060a => Some(Op::ReadPulse),
            Family::Eda9050 | Family::Erc8 | Family::R55 | Family::Emd2a2q => None,
        }
    }

    /// As much of these states as one frame can carry. Never empty unless the bank is.
    #[must_use]
    pub fn group(&self, want: Bank) -> Bank {
        match self.setup.family {
            Family::Eda9060a | Family::Eda9050 => eda::group(&self.setup, want),
            Family::Erc8 | Family::Emd2a2q => modbus::run_of(want),
            Family::R55 => r55::group(&self.setup, want),
        }
    }

    /// The op that reads back what an op changed, if there is one.
    #[must_use]
    pub const fn read_back(&self, op: &Op) -> Option<Op> {
        match op {
            Op::Write(_) | Op::WriteSilent(_) | Op::Toggle(_) | Op::Jog { .. } => {
                Some(Op::ReadOutputs)
            }
            Op::WriteVariable(index, _) => Some(Op::ReadVariable(*index)),
            _ => None,
        }
    }
}
