//! The engine in virtual time.

use crate::{Bench, Outside};
use railbus_device::{Eeprom, Engine, Input, Options, Output, Setup, SetupError};
use railbus_wire::{Instant, Micros};
use std::convert::Infallible;

/// A simulated module on a bench.
#[derive(Debug)]
pub struct Simulated {
    setup: Setup,
    engine: Engine,
    now: Instant,
    outside: Outside,
    /// Shown to the world by effects, as a relay's terminals are.
    outputs: u32,
}

impl Simulated {
    /// A module fresh from the factory, but for what `setup` says.
    ///
    /// # Errors
    /// Where there can be no such module.
    pub fn new(setup: Setup) -> Result<Simulated, SetupError> {
        let now = Instant(1_000_000);
        let engine = Engine::new(&setup, Eeprom::of(&setup), Options::default(), now)?;
        Ok(Simulated {
            setup,
            engine,
            now,
            outside: Outside::of(&setup),
            outputs: 0,
        })
    }

    /// Runs the module up to a moment; what it says in that time, or has begun to say.
    fn run_until(&mut self, end: Instant) -> Vec<u8> {
        let mut said = Vec::new();
        loop {
            match self.engine.poll() {
                Output::Effect(railbus_device::Effect::Output { channel, on }) => {
                    let bit = 1 << channel;
                    self.outputs = if on {
                        self.outputs | bit
                    } else {
                        self.outputs & !bit
                    };
                }
                Output::Effect(_) => {}
                Output::Transmit(bytes) => {
                    said.extend(bytes);
                    let count = bytes.len();
                    self.now = self.now + self.engine.active().serial.frame_time(count);
                    self.engine.handle(self.now, Input::Sent);
                }
                Output::Wait(Some(at)) if at <= end => {
                    self.now = self.now.max(at);
                    self.engine.handle(self.now, Input::Timeout);
                }
                Output::Wait(_) => {
                    self.now = self.now.max(end);
                    return said;
                }
            }
        }
    }

    fn run_for(&mut self, millis: u64) -> Vec<u8> {
        self.run_until(self.now + Micros::from_millis(millis))
    }
}

impl Bench for Simulated {
    type Error = Infallible;

    fn ask(&mut self, request: &[u8], _: usize) -> Result<Vec<u8>, Infallible> {
        let mut said = self.run_for(50);
        for byte in request {
            let character = self.engine.active().serial.frame_time(1);
            said.extend(self.run_until(self.now + character));
            self.engine.handle(self.now, Input::Bytes(&[*byte]));
        }
        said.extend(self.run_for(300));
        Ok(said)
    }

    fn outputs(&mut self, _: u32) -> Result<u32, Infallible> {
        Ok(self.outputs)
    }

    fn surround(&mut self, outside: &Outside) -> Result<(), Infallible> {
        self.outside = *outside;
        let analogs = (0..).zip(outside.analogs);
        let inputs = [
            Input::Levels(outside.levels),
            Input::Init(outside.init),
            Input::Dip(outside.dip),
        ];
        let analogs = analogs.map(|(channel, value)| Input::Analog(channel, value));
        for input in inputs.into_iter().chain(analogs) {
            self.engine.handle(self.now, input);
        }
        Ok(())
    }

    fn power_cycle(&mut self) -> Result<(), Infallible> {
        let eeprom = *self.engine.eeprom();
        // The description was good enough for the first time.
        if let Ok(engine) = Engine::new(&self.setup, eeprom, Options::default(), self.now) {
            self.engine = engine;
        }
        self.outputs = 0;
        let outside = self.outside;
        self.surround(&outside)
    }

    fn wait(&mut self, millis: u64) -> Result<Vec<u8>, Infallible> {
        Ok(self.run_for(millis))
    }
}
