//! Which coil or register of a unit is which point.
//!
//! The map of a module that speaks Modbus is what its host asks for; configuration registers are in
//! no map. All others have the uniform one.

use railbus_device::{Module, Op, PointKind, Setup};
use railbus_wire::{Exchange, Protocol, rtu};

/// A space of Modbus; the four are separate [MODBUS §2.9].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Space {
    /// Functions 01, 05, 0F.
    Coils,
    /// Function 02.
    DiscreteInputs,
    /// Functions 03, 06, 10.
    HoldingRegisters,
    /// Function 04.
    InputRegisters,
}

/// What stands in a run of coils or registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// Points of this kind, a bit each.
    Bits(PointKind),
    /// Outputs 15 to 0, then 31 to 16, as bits of words.
    OutputWords,
    /// Analog values as the module has them.
    Raw,
    /// Analog values as signed numbers, times 10 for each of their decimals.
    Scaled,
    /// Analog values as 32-bit floating-point numbers, high word first.
    Floats,
    /// Variables as unsigned 32-bit numbers, high word first.
    Numbers,
    /// What is known of the unit itself: [`STATUS`] and what follows.
    Status,
}

impl Content {
    /// How many registers a value takes, or bits.
    pub(crate) const fn registers(self) -> u16 {
        match self {
            Content::Floats | Content::Numbers => 2,
            Content::Bits(_)
            | Content::OutputWords
            | Content::Raw
            | Content::Scaled
            | Content::Status => 1,
        }
    }
}

/// The first register about the unit itself. From there: quality (0 good, 1 stale, 2 never read, 3
/// offline, 4 line absent, 5 line busy, 6 exclusive access, 7 line closed, 8 other model), age of
/// the oldest value in 100 ms (65535: none), presence (0 unheard, 1 online, 2 silent, 3 other
/// model), round trip in ms; then of the last command its number, end (0 none, 1 read back, 2
/// replied, 3 sent, 4 unknown, 5 failed, 6 under way), error code (301 is E0301) and first coil.
const STATUS: u16 = 64;
/// How many of them there are.
pub(crate) const STATUS_LEN: u16 = 8;

/// Outputs once more, to be read only.
const OUTPUTS_READ: u16 = 100;
const FLOATS: u16 = 16;
const NUMBERS: u16 = 256;

/// Coils or registers with the same kind of content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub(crate) space: Space,
    pub(crate) start: u16,
    pub(crate) count: u16,
    pub(crate) content: Content,
}

/// The coils and registers of a unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct UnitMap(Vec<Run>);

impl UnitMap {
    /// The map of a module: its own if it speaks Modbus, and is not to have the uniform one.
    pub(crate) fn of(setup: &Setup, is_uniform: bool) -> UnitMap {
        let mut runs = match setup.protocol {
            Protocol::Rtu if !is_uniform => own(setup),
            _ => uniform(setup),
        };
        runs.push(Run {
            space: Space::InputRegisters,
            start: STATUS,
            count: STATUS_LEN,
            content: Content::Status,
        });
        UnitMap(runs)
    }

    /// What stands at this address, and at which offset of its run.
    pub(crate) fn find(&self, space: Space, at: u16) -> Option<(Content, u16)> {
        self.0.iter().find_map(|run| {
            let offset = at.checked_sub(run.start)?;
            (run.space == space && offset < run.count).then_some((run.content, offset))
        })
    }

    /// All of it.
    pub(crate) fn runs(&self) -> &[Run] {
        &self.0
    }
}

/// As the module's host asks for it.
fn own(setup: &Setup) -> Vec<Run> {
    let Ok(module) = Module::new(*setup) else {
        return Vec::new();
    };
    let reads = [
        (Op::ReadOutputs, PointKind::Output),
        (Op::ReadInputs, PointKind::Input),
        (Op::ReadAnalogs, PointKind::Analog),
    ];
    let of_read = |(op, kind): (Op, PointKind)| {
        let count = u16::from(setup.count(kind));
        let Exchange::Rtu(exchange) = module.exchange(&op).ok().filter(|_| count > 0)? else {
            return None;
        };
        let (space, start, content) = match exchange.request {
            rtu::Request::ReadCoils(span) => (Space::Coils, span.start(), Content::Bits(kind)),
            rtu::Request::ReadDiscreteInputs(span) => {
                (Space::DiscreteInputs, span.start(), Content::Bits(kind))
            }
            rtu::Request::ReadHoldingRegisters(span) => {
                (Space::HoldingRegisters, span.start(), Content::Raw)
            }
            rtu::Request::ReadInputRegisters(span) => {
                (Space::InputRegisters, span.start(), Content::Raw)
            }
            _ => return None,
        };
        Some(Run {
            space,
            start,
            count,
            content,
        })
    };
    reads.into_iter().filter_map(of_read).collect()
}

/// The same for all.
fn uniform(setup: &Setup) -> Vec<Run> {
    let count = |kind| u16::from(setup.count(kind));
    let (outputs, inputs) = (count(PointKind::Output), count(PointKind::Input));
    let (analogs, variables) = (count(PointKind::Analog), count(PointKind::Variable));
    let words = match outputs {
        0 => 0,
        _ => 2,
    };
    let all = [
        (Space::Coils, 0, outputs, Content::Bits(PointKind::Output)),
        (
            Space::DiscreteInputs,
            0,
            inputs,
            Content::Bits(PointKind::Input),
        ),
        (
            Space::DiscreteInputs,
            OUTPUTS_READ,
            outputs,
            Content::Bits(PointKind::Output),
        ),
        (Space::HoldingRegisters, 0, words, Content::OutputWords),
        (Space::InputRegisters, 0, analogs, Content::Scaled),
        (Space::InputRegisters, FLOATS, 2 * analogs, Content::Floats),
        (
            Space::InputRegisters,
            NUMBERS,
            2 * variables,
            Content::Numbers,
        ),
    ];
    let each = all.map(|(space, start, count, content)| Run {
        space,
        start,
        count,
        content,
    });
    each.into_iter().filter(|run| run.count > 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Family;
    use railbus_wire::Address;

    fn map(
        family: Family,
        protocol: Protocol,
        is_uniform: bool,
    ) -> Vec<(Space, u16, u16, Content)> {
        let setup = Setup {
            protocol,
            ..Setup::new(family, Address(3))
        };
        let map = UnitMap::of(&setup, is_uniform);
        let runs = map.runs().iter();
        runs.filter(|run| run.content != Content::Status)
            .map(|run| (run.space, run.start, run.count, run.content))
            .collect()
    }

    const OUTPUTS: Content = Content::Bits(PointKind::Output);
    const INPUTS: Content = Content::Bits(PointKind::Input);

    /// [ERC-8 §2.1] [EMD-2A2Q §2.1]
    #[test]
    fn a_module_that_speaks_modbus_keeps_the_map_of_its_datasheet() {
        let own = |family| map(family, Protocol::Rtu, false);
        assert_eq!(own(Family::Erc8), [(Space::Coils, 60, 8, OUTPUTS)]);
        assert_eq!(
            own(Family::Emd2a2q),
            [
                (Space::Coils, 8, 2, OUTPUTS),
                (Space::HoldingRegisters, 6, 2, Content::Raw),
            ]
        );
        for (family, outputs, inputs) in [(Family::Eda9060a, 4, 4), (Family::Eda9050, 8, 7)] {
            assert_eq!(
                own(family),
                [
                    (Space::Coils, 0, outputs, OUTPUTS),
                    (Space::DiscreteInputs, 0, inputs, INPUTS),
                ]
            );
        }
    }

    #[test]
    fn all_others_have_the_uniform_one() {
        let ascii = map(Family::Eda9060a, Protocol::Ascii, false);
        assert_eq!(
            ascii,
            [
                (Space::Coils, 0, 4, OUTPUTS),
                (Space::DiscreteInputs, 0, 4, INPUTS),
                (Space::DiscreteInputs, 100, 4, OUTPUTS),
                (Space::HoldingRegisters, 0, 2, Content::OutputWords),
            ]
        );
        let emd = map(Family::Emd2a2q, Protocol::Rtu, true);
        assert_eq!(
            emd,
            [
                (Space::Coils, 0, 2, OUTPUTS),
                (Space::DiscreteInputs, 100, 2, OUTPUTS),
                (Space::HoldingRegisters, 0, 2, Content::OutputWords),
                (Space::InputRegisters, 0, 2, Content::Scaled),
                (Space::InputRegisters, 16, 4, Content::Floats),
            ]
        );
    }

    #[test]
    fn every_unit_says_how_it_is() {
        for family in Family::ALL {
            let map = UnitMap::of(&Setup::new(family, Address(1)), false);
            let find = |at| map.find(Space::InputRegisters, at);
            assert_eq!(find(63), None, "{family}");
            assert_eq!(find(64), Some((Content::Status, 0)), "{family}");
            assert_eq!(find(71), Some((Content::Status, 7)), "{family}");
            assert_eq!(find(72), None, "{family}");
            assert_eq!(map.find(Space::HoldingRegisters, 64), None, "{family}");
        }
    }
}
