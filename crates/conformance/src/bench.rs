//! Runs a case on any kind of module.

use crate::read::{Case, CaseStep};
use railbus_device::Setup;
use railbus_wire::Protocol;
use std::fmt;

/// The surroundings of a module; a loss of power does not change them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outside {
    /// The levels at the digital inputs: bit n = input n is high or open.
    pub levels: u32,
    /// The values at the analog inputs, in hundredths of their unit.
    pub analogs: [i16; 2],
    /// The INIT* pin is grounded.
    pub init: bool,
    /// The DIP switch.
    pub dip: u8,
}

impl Outside {
    /// Nothing is connected; but where the INIT* pin chooses LC-02, it is grounded
    /// [EDA9050 §2.1].
    #[must_use]
    pub fn of(setup: &Setup) -> Outside {
        Outside {
            levels: u32::MAX,
            analogs: [0; 2],
            init: setup.family.datasheet().init_pin && setup.protocol == Protocol::Lc02,
            dip: 0,
        }
    }
}

/// A module on a bench.
pub trait Bench {
    /// Why the bench itself failed.
    type Error: fmt::Display;

    /// Sends bytes after a silence, and returns the reply. Waits patiently for the first `worth`
    /// bytes; bytes that follow shortly after are returned, too.
    ///
    /// # Errors
    /// If the bench fails. Silence is not an error.
    fn ask(&mut self, request: &[u8], worth: usize) -> Result<Vec<u8>, Self::Error>;

    /// The outputs as seen from outside: bit n = output n is on. They may take a moment to reach
    /// `expected`.
    ///
    /// # Errors
    /// As above.
    fn outputs(&mut self, expected: u32) -> Result<u32, Self::Error>;

    /// Changes the surroundings of the module, which has noticed when this returns.
    ///
    /// # Errors
    /// As above.
    fn surround(&mut self, outside: &Outside) -> Result<(), Self::Error>;

    /// Switches the power off and on again.
    ///
    /// # Errors
    /// As above.
    fn power_cycle(&mut self) -> Result<(), Self::Error>;

    /// Lets time pass, and returns what the module sends meanwhile.
    ///
    /// # Errors
    /// As above.
    fn wait(&mut self, millis: u64) -> Result<Vec<u8>, Self::Error>;
}

/// A failed case.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseFailure {
    /// `erc8.txt:12`
    pub place: String,
    /// The case's name.
    pub case: String,
    /// The module.
    pub setup: Setup,
    /// What differs.
    pub what: String,
}

impl fmt::Display for CaseFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Setup {
            family, protocol, ..
        } = self.setup;
        let place = &self.place;
        write!(
            f,
            "{place}: {family} ({protocol:?}): {}: {}",
            self.case, self.what
        )
    }
}

/// Runs a case on one of its modules, which has just been put on the bench.
///
/// # Errors
/// What differs from the case.
pub fn run<B: Bench>(case: &Case, setup: &Setup, bench: &mut B) -> Result<(), CaseFailure> {
    let mut outside = Outside::of(setup);
    for (line, step) in &case.steps {
        perform(step, &mut outside, bench).map_err(|what| failure(case, *line, setup, what))?;
    }
    // Nothing follows the last reply.
    let end = case.steps.last().map_or(case.line, |(line, _)| *line);
    said_nothing(bench, 50).map_err(|what| failure(case, end, setup, what))
}

fn failure(case: &Case, line: usize, setup: &Setup, what: String) -> CaseFailure {
    CaseFailure {
        place: format!("{}:{line}", case.file),
        case: case.name.clone(),
        setup: *setup,
        what,
    }
}

fn perform<B: Bench>(step: &CaseStep, outside: &mut Outside, bench: &mut B) -> Result<(), String> {
    let broken = |error: B::Error| format!("the bench does not work: {error}");
    match step {
        CaseStep::Ask(request, reply) => {
            let answer = bench.ask(request, reply.len()).map_err(broken)?;
            let what = || format!("{} gets {}", Said(request), Said(&answer));
            return (answer == *reply)
                .then_some(())
                .ok_or_else(|| format!("{}, not {}", what(), Said(reply)));
        }
        CaseStep::Outputs(expected) => {
            let outputs = bench.outputs(*expected).map_err(broken)?;
            return (outputs == *expected)
                .then_some(())
                .ok_or_else(|| format!("the outputs are {outputs:X}, not {expected:X}"));
        }
        CaseStep::Power => return bench.power_cycle().map_err(broken),
        CaseStep::Wait(millis) => return said_nothing(bench, *millis),
        CaseStep::Inputs(levels) => outside.levels = *levels,
        CaseStep::Analog(channel, value) => match outside.analogs.get_mut(usize::from(*channel)) {
            Some(analog) => *analog = *value,
            None => return Err(format!("no module has an analog input {channel}")),
        },
        CaseStep::Dip(dip) => outside.dip = *dip,
        CaseStep::Init(grounded) => outside.init = *grounded,
    }
    bench.surround(outside).map_err(broken)
}

fn said_nothing<B: Bench>(bench: &mut B, millis: u64) -> Result<(), String> {
    match bench.wait(millis) {
        Ok(said) if said.is_empty() => Ok(()),
        Ok(said) => Err(format!("unasked, it says {}", Said(&said))),
        Err(error) => Err(format!("the bench does not work: {error}")),
    }
}

/// Bytes in readable form.
struct Said<'a>(&'a [u8]);

impl fmt::Display for Said<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [] => f.write_str("silence"),
            [text @ .., b'\r'] if text.iter().all(|byte| (0x20..0x7F).contains(byte)) => {
                write!(f, "\"{}\"", String::from_utf8_lossy(text))
            }
            bytes => write!(f, "{bytes:02X?}"),
        }
    }
}
