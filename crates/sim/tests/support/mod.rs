//! A host that sends requests, waits, and records what it receives.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

use railbus_device::{Eeprom, Effect, Family, Options, Setup};
use railbus_sim::{Act, Input, Output, SlotId, VirtualLine, VirtualLineConfig};
use railbus_wire::{Address, Instant, Micros, SerialSettings};

/// A line, its host, and everything that happened so far.
pub struct Bench {
    pub line: VirtualLine,
    pub now: Instant,
    /// What the host heard: when the last character ended, and the characters.
    pub heard: Vec<(Instant, Vec<u8>)>,
    /// What the modules did, but for their LEDs.
    pub effects: Vec<(Instant, SlotId, Effect)>,
}

impl Bench {
    /// A line with nothing on it; its time begins at 0.
    pub fn new(config: VirtualLineConfig) -> Bench {
        Bench {
            line: VirtualLine::new(config),
            now: Instant(0),
            heard: Vec::new(),
            effects: Vec::new(),
        }
    }

    /// A line with one ERC-8 at address 1, named `oven`, whose time stands at 100 ms.
    pub fn with_oven(config: VirtualLineConfig) -> (Bench, SlotId) {
        let mut bench = Bench::new(config);
        let oven = bench.add("oven", Setup::new(Family::Erc8, Address(1)));
        bench.wait(100);
        (bench, oven)
    }

    /// Adds a module fresh from the factory, but for what the setup says.
    pub fn add(&mut self, name: &str, setup: Setup) -> SlotId {
        self.add_with(name, setup, Options::default())
    }

    pub fn add_with(&mut self, name: &str, setup: Setup, options: Options) -> SlotId {
        let id = self
            .line
            .add(self.now, name, &setup, Eeprom::of(&setup), options)
            .expect("a possible module");
        self.drain();
        id
    }

    /// Begins to send, at 9600 8N1.
    pub fn send(&mut self, bytes: &[u8]) {
        self.send_at(bytes, SerialSettings::FACTORY);
    }

    pub fn send_at(&mut self, bytes: &[u8], settings: SerialSettings) {
        let input = Input::Send { bytes, settings };
        self.line.handle(self.now, input);
        self.drain();
    }

    pub fn act(&mut self, module: SlotId, act: Act) {
        self.line.handle(self.now, Input::Act(module, act));
        self.drain();
    }

    /// Sends, waits 300 ms, and returns all that was received meanwhile.
    pub fn ask(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.heard.clear();
        self.send(bytes);
        self.wait(300);
        self.heard_bytes()
    }

    pub fn ask_hex(&mut self, text: &str) -> String {
        show(&self.ask(&hex(text)))
    }

    /// All bytes heard, one piece after another.
    pub fn heard_bytes(&self) -> Vec<u8> {
        let pieces = self.heard.iter();
        pieces.flat_map(|(_, bytes)| bytes.clone()).collect()
    }

    pub fn wait(&mut self, millis: u64) {
        self.run_until(self.now + Micros::from_millis(millis));
    }

    /// Lets time pass, from deadline to deadline.
    pub fn run_until(&mut self, end: Instant) {
        while let Some(at) = self.drain() {
            if at > end {
                break;
            }
            assert!(at > self.now, "a deadline lies ahead");
            self.now = at;
            self.line.handle(at, Input::Timeout);
        }
        self.now = self.now.max(end);
        self.line.handle(self.now, Input::Timeout);
        self.drain();
    }

    /// Drains all outputs; returns the deadline.
    fn drain(&mut self) -> Option<Instant> {
        loop {
            match self.line.poll() {
                Output::Heard { at, bytes } => self.heard.push((at, bytes.to_vec())),
                Output::Effect {
                    effect: Effect::Led(_),
                    ..
                } => {}
                Output::Effect { at, module, effect } => self.effects.push((at, module, effect)),
                Output::Wait(at) => return at,
            }
        }
    }
}

/// Bytes of hexadecimal text; blanks do not matter.
pub fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u32> = text.chars().filter_map(|c| c.to_digit(16)).collect();
    let pairs = digits.chunks(2);
    pairs.map(|pair| (pair[0] << 4 | pair[1]) as u8).collect()
}

/// Bytes as hexadecimal text.
pub fn show(bytes: &[u8]) -> String {
    let pairs: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    pairs.join(" ")
}
