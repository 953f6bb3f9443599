//! The same module twice: the engine in virtual time, and the firmware in QEMU.

use crate::World;
use crate::site::said;
use railbus_conformance::{Bench, Outside, Simulated};
use railbus_device::{Options, Setup};
use railbus_qemu::Board;

/// What was done to both, and how often they answered.
#[derive(Clone, Copy, Default)]
pub(super) struct Count {
    pub(super) frames: u64,
    pub(super) replies: u64,
}

/// Two modules that must not come to differ.
pub(super) struct Pair {
    setup: Setup,
    simulated: Simulated,
    board: Board,
    count: Count,
}

impl Pair {
    /// Both fresh from the factory.
    pub(super) fn new(world: &World, setup: Setup, options: Options) -> Result<Pair, String> {
        let board = Board::new(&world.images, &setup, options).map_err(said)?;
        Ok(Pair {
            setup,
            simulated: Simulated::new(setup, options).map_err(said)?,
            board,
            count: Count::default(),
        })
    }

    pub(super) const fn count(&self) -> Count {
        self.count
    }

    /// Sends the same to both: replies and outputs are the same.
    pub(super) fn ask(&mut self, bytes: &[u8]) -> Result<(), String> {
        let Ok(expected) = self.simulated.ask(bytes, 0);
        let answer = self.board.ask(bytes, expected.len()).map_err(said)?;
        self.count.frames += 1;
        self.count.replies += u64::from(!answer.is_empty());
        if answer == expected {
            return self.outputs(&format!("{bytes:02X?}"));
        }
        Err(self.differ(
            &format!("{bytes:02X?}"),
            &format!("says {expected:02X?}"),
            &format!("{answer:02X?}"),
        ))
    }

    /// Lets this time pass for both, in which both send the same, mostly nothing; then their
    /// outputs are the same, within the tolerance for the board.
    pub(super) fn wait(&mut self, millis: u64) -> Result<(), String> {
        let Ok(expected) = self.simulated.wait(millis);
        let said = self.board.wait(millis).map_err(said)?;
        let what = format!("{millis} ms");
        if said == expected {
            return self.outputs(&what);
        }
        Err(self.differ(
            &what,
            &format!("says {expected:02X?}"),
            &format!("{said:02X?}"),
        ))
    }

    /// The same lies at the analog inputs of both.
    pub(super) fn analogs(&mut self, analogs: [i16; 2]) -> Result<(), String> {
        let outside = Outside {
            analogs,
            ..*self.board.outside()
        };
        let Ok(()) = self.simulated.surround(&outside);
        self.board.surround(&outside).map_err(said)
    }

    fn outputs(&mut self, after: &str) -> Result<(), String> {
        let Ok(expected) = self.simulated.outputs(0);
        let shown = self.board.outputs(expected).map_err(said)?;
        if shown == expected {
            return Ok(());
        }
        Err(self.differ(after, &format!("has {expected:X}"), &format!("{shown:X}")))
    }

    fn differ(&self, after: &str, simulator: &str, firmware: &str) -> String {
        let Setup {
            family, protocol, ..
        } = self.setup;
        let number = self.count.frames;
        format!(
            "{family} ({protocol:?}), frame {number}, after {after}: the simulator {simulator}, \
             the firmware {firmware}"
        )
    }
}
