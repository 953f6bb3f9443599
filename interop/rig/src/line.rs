//! The simulated line on a real clock.

use crate::describe::Description;
use railbus_device::{Eeprom, Effect, SetupError};
use railbus_sim::{Act, Chunks, Input, Output, SlotId, VirtualLine, VirtualLineConfig};
use railbus_wire::{Character, Instant, Micros, SerialSettings};
use std::time::Duration;

/// A change of an output: when in microseconds, which one, and whether it is on now.
type Change = (u64, u8, bool);

/// How long after a request a module may still begin to answer it.
const ANSWER: Micros = Micros::from_millis(300);

/// A line whose clock is the real one plus the time that was skipped.
pub struct Served {
    line: VirtualLine,
    started: std::time::Instant,
    skipped: Micros,
    changes: Vec<(SlotId, Change)>,
    /// What the host has received and the driver has not fetched yet.
    heard: Vec<u8>,
    /// How many bytes the host has received since it last sent.
    said: usize,
    /// When no module can begin to answer the last request any more.
    settled: Instant,
    /// The host's character format.
    pub character: Character,
}

impl Served {
    /// A line with these modules, powered up now.
    ///
    /// # Errors
    /// If a module can't be as described.
    pub fn new(modules: Vec<Description>) -> Result<Served, SetupError> {
        let mut line = VirtualLine::new(VirtualLineConfig {
            chunks: Chunks::Single,
            ..VirtualLineConfig::default()
        });
        for module in modules {
            let Description {
                name,
                setup,
                eeprom,
                options,
            } = module;
            line.add(Instant(0), &name, &setup, eeprom, options)?;
        }
        Ok(Served {
            line,
            started: std::time::Instant::now(),
            skipped: Micros::ZERO,
            changes: Vec::new(),
            heard: Vec::new(),
            said: 0,
            settled: Instant(0),
            character: Character::N1,
        })
    }

    fn now(&self) -> Instant {
        let passed = u64::try_from(self.started.elapsed().as_micros()).unwrap_or(u64::MAX);
        Instant(passed) + self.skipped
    }

    /// Does everything that is due, and returns how long nothing will be.
    pub fn run(&mut self) -> Option<Duration> {
        let now = self.now();
        self.line.handle(now, Input::Timeout);
        loop {
            match self.line.poll() {
                Output::Heard { bytes, .. } => {
                    self.said += bytes.len();
                    self.heard.extend_from_slice(bytes);
                }
                Output::Effect {
                    at,
                    module,
                    effect: Effect::Output { channel, on },
                } => self.changes.push((module, (at.0, channel, on))),
                Output::Effect { .. } => {}
                Output::Wait(at) => return at.map(|at| Duration::from_micros(at.since(now).0)),
            }
        }
    }

    /// Takes what the host has received since the last call.
    pub fn take_heard(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.heard)
    }

    /// The host sends.
    pub fn send(&mut self, bytes: &[u8], settings: SerialSettings) {
        let now = self.now();
        self.said = 0;
        self.settled = now + settings.frame_time(bytes.len()) + ANSWER;
        self.line.handle(now, Input::Send { bytes, settings });
    }

    /// How many bytes come in reply to what the host sent last. The time that modules may still
    /// take to begin is skipped, so silence need not be decided by a clock.
    pub fn silence(&mut self) -> usize {
        self.skip(self.settled.since(self.now()));
        self.said
    }

    /// Operates a module, and carries it out.
    pub fn act(&mut self, module: SlotId, act: Act) {
        self.line.handle(self.now(), Input::Act(module, act));
        self.run();
    }

    /// Skips time, with everything that happens in it.
    pub fn skip(&mut self, time: Micros) {
        self.run();
        self.skipped = Micros(self.skipped.0 + time.0);
        self.run();
    }

    /// The module of that name.
    pub fn find(&self, name: &str) -> Option<SlotId> {
        let mut modules = self.line.modules();
        modules.find(|module| self.line.name(*module) == name)
    }

    /// The real state of a module's outputs: bit n = output n is on.
    pub fn outputs(&self, module: SlotId) -> u32 {
        self.line.engine(module).outputs()
    }

    /// The settings that a module has stored.
    pub fn eeprom(&self, module: SlotId) -> Eeprom {
        *self.line.engine(module).eeprom()
    }

    /// The changes of a module's outputs since the last call.
    pub fn take_changes(&mut self, module: SlotId) -> Vec<Change> {
        let of_module = self.changes.extract_if(.., |(whose, _)| *whose == module);
        of_module.map(|(_, change)| change).collect()
    }
}
