//! The simulated module in virtual time.

use crate::{Bench, Outside};
use railbus_device::{Eeprom, Engine, Input, Options, Output, Setup, SetupError};
use railbus_wire::{Instant, Micros};
use std::convert::Infallible;

/// A simulated module on a bench.
#[derive(Debug)]
pub struct Simulated {
    setup: Setup,
    options: Options,
    engine: Engine,
    now: Instant,
    outside: Outside,
    /// Set by effects only, like a relay's terminals.
    outputs: u32,
    /// What it has sent and was not returned yet.
    said: Vec<u8>,
}

impl Simulated {
    /// A module in its factory state, except for `setup` and `options`.
    ///
    /// # Errors
    /// If there can't be such a module.
    pub fn new(setup: Setup, options: Options) -> Result<Simulated, SetupError> {
        let now = Instant(1_000_000);
        let engine = Engine::new(&setup, Eeprom::of(&setup), options, now)?;
        Ok(Simulated {
            setup,
            options,
            engine,
            now,
            outside: Outside::of(&setup),
            outputs: 0,
            said: Vec::new(),
        })
    }

    /// Runs the module up to a moment, and until a reply begun by then is complete.
    fn run_until(&mut self, end: Instant) {
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
                    self.said.extend(bytes);
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
                    return;
                }
            }
        }
    }

    fn run_for(&mut self, millis: u64) {
        self.run_until(self.now + Micros::from_millis(millis));
    }
}

impl Bench for Simulated {
    type Error = Infallible;

    fn ask(&mut self, request: &[u8], _: usize) -> Result<Vec<u8>, Infallible> {
        self.run_for(50);
        for byte in request {
            let character = self.engine.active().serial.frame_time(1);
            self.run_until(self.now + character);
            self.engine.handle(self.now, Input::Bytes(&[*byte]));
        }
        self.run_for(300);
        Ok(std::mem::take(&mut self.said))
    }

    fn outputs(&mut self, _: u32) -> Result<u32, Infallible> {
        self.run_until(self.now);
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
        // The setup was valid the first time.
        if let Ok(engine) = Engine::new(&self.setup, eeprom, self.options, self.now) {
            self.engine = engine;
        }
        self.outputs = 0;
        let outside = self.outside;
        self.surround(&outside)
    }

    fn wait(&mut self, millis: u64) -> Result<Vec<u8>, Infallible> {
        self.run_for(millis);
        Ok(std::mem::take(&mut self.said))
    }
}
