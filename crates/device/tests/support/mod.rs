//! A module on a bench: bytes in, bytes out, and time that the test controls.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

use railbus_device::{
    Eeprom, Effect, Engine, Input, Module, Observation, Op, Options, Output, Setup,
};
use railbus_wire::{Frame, Instant, Micros, Protocol, crc16, sum8};

/// One module in virtual time, with everything it did at its terminals.
pub struct Bench {
    pub engine: Engine,
    pub setup: Setup,
    pub options: Options,
    pub now: Instant,
    /// Every effect so far, with its time.
    pub effects: Vec<(Instant, Effect)>,
}

impl Bench {
    /// A module fresh from the factory, but for what `setup` says.
    pub fn new(setup: Setup) -> Bench {
        Bench::with(setup, Eeprom::of(&setup), Options::default())
    }

    /// A module with these settings and switches.
    pub fn with(setup: Setup, eeprom: Eeprom, options: Options) -> Bench {
        let now = Instant(1_000_000);
        let engine = Engine::new(&setup, eeprom, options, now).expect("a possible module");
        let mut bench = Bench {
            engine,
            setup,
            options,
            now,
            effects: Vec::new(),
        };
        assert_eq!(bench.spoken(), None, "a module says nothing at power-up");
        bench
    }

    /// Power off and on again; time continues.
    pub fn power_cycle(&mut self) {
        let eeprom = *self.engine.eeprom();
        self.engine = Engine::new(&self.setup, eeprom, self.options, self.now).expect("as before");
        assert_eq!(self.spoken(), None, "a module says nothing at power-up");
    }

    /// Lets time pass; an unsolicited transmission is an error.
    pub fn wait(&mut self, millis: u64) {
        assert_eq!(self.run_until(self.now + Micros::from_millis(millis)), None);
    }

    /// Sends bytes at the module's speed, after a silence of 50 ms, and gives back what it
    /// answers within 300 ms.
    pub fn ask(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        self.wait(50);
        self.send(bytes);
        self.run_until(self.now + Micros::from_millis(300))
    }

    /// The bytes of a text in hexadecimal, sent as [`Bench::ask`] does.
    pub fn ask_hex(&mut self, text: &str) -> Option<Vec<u8>> {
        self.ask(&hex(text))
    }

    /// A Modbus request without its CRC, sent as [`Bench::ask`] does; the reply without its CRC.
    pub fn ask_rtu(&mut self, text: &str) -> Option<Vec<u8>> {
        let reply = self.ask(&with_crc(&hex(text)))?;
        assert_eq!(crc16(&reply), 0, "a reply has a right CRC");
        Some(reply[..reply.len() - 2].to_vec())
    }

    /// An ASCII request without its CR; the reply without its CR.
    pub fn ask_text(&mut self, text: &str) -> Option<String> {
        let reply = self.ask(format!("{text}\r").as_bytes())?;
        let reply = String::from_utf8(reply).expect("ASCII");
        Some(reply.strip_suffix('\r').expect("a CR ends it").to_owned())
    }

    /// A 0x55 request without its start and sum; the reply without start and sum.
    pub fn ask_r55(&mut self, text: &str) -> Option<Vec<u8>> {
        let mut frame = vec![0x55];
        frame.extend(hex(text));
        frame.push(sum8(&frame));
        let reply = self.ask(&frame)?;
        assert_eq!(
            (reply.len(), reply[0], reply[7]),
            (8, 0x22, sum8(&reply[..7]))
        );
        Some(reply[1..7].to_vec())
    }

    /// The module as a host sees it that knows the settings in force.
    pub fn host(&self) -> Module {
        let active = self.engine.active();
        Module::new(Setup {
            address: active.address,
            serial: active.serial,
            checksum: active.checksum && self.setup.protocol == Protocol::Ascii,
            ..self.setup
        })
        .expect("a possible module")
    }

    /// Sends a host's request; returns the decoded reply.
    pub fn op(&mut self, op: Op) -> Option<Observation> {
        let host = self.host();
        let frame = request(&host, &op).expect("the model has a command for it");
        let reply = self.ask(&frame)?;
        Some(seen(&host, &op, &reply))
    }

    /// Sends a request that must have no reply and no effect.
    pub fn ignores(&mut self, bytes: &[u8]) {
        let reply = self.ask_unchanged(bytes);
        assert_eq!(reply, None, "{bytes:02X?} is ignored");
    }

    /// Sends a Modbus request, without its CRC, that must be answered with this exception and have
    /// no effect [MODBUS §3.7].
    pub fn refuses(&mut self, text: &str, code: u8) {
        let request = hex(text);
        let exception = with_crc(&[request[0], request[1] | 0x80, code]);
        let reply = self.ask_unchanged(&with_crc(&request));
        assert_eq!(reply, Some(exception), "{text} gives exception {code:02X}");
    }

    fn ask_unchanged(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        let state = |bench: &Bench| {
            let engine = &bench.engine;
            (engine.outputs(), *engine.eeprom(), *engine.active())
        };
        let led = |(_, effect): &(Instant, Effect)| matches!(effect, Effect::Led(_));
        let (before, told) = (state(self), self.effects.len());
        let reply = self.ask(bytes);
        assert_eq!(state(self), before, "{bytes:02X?} changes nothing");
        let quiet = self.effects[told..].iter().all(led);
        assert!(quiet, "{bytes:02X?} has no effect");
        reply
    }

    /// What the module did at its terminals since the last call, except for the LED.
    pub fn did(&mut self) -> Vec<(Instant, Effect)> {
        let mut effects = std::mem::take(&mut self.effects);
        effects.retain(|(_, effect)| !matches!(effect, Effect::Led(_)));
        effects
    }

    /// Bytes go out one after another at the module's speed; answers wait.
    pub fn send(&mut self, bytes: &[u8]) {
        let character = self.engine.active().serial.frame_time(1);
        for &byte in bytes {
            let end = self.now + character;
            assert_eq!(self.run_until(end), None, "it talks while it is talked to");
            self.engine.handle(end, Input::Bytes(&[byte]));
        }
    }

    /// Something happens now.
    pub fn input(&mut self, input: Input<'_>) {
        self.engine.handle(self.now, input);
        assert_eq!(self.spoken(), None, "nothing but a request is answered");
    }

    /// Runs the module up to a moment; the first reply, once it has left, ends the wait for
    /// more but not the time.
    pub fn run_until(&mut self, end: Instant) -> Option<Vec<u8>> {
        let mut reply = None;
        loop {
            let next = match self.drain() {
                Some(Drained::Reply(bytes)) => {
                    assert!(reply.is_none(), "one request, one reply");
                    let leaves = self.now + self.engine.active().serial.frame_time(bytes.len());
                    self.now = leaves;
                    self.engine.handle(leaves, Input::Sent);
                    reply = Some(bytes);
                    continue;
                }
                Some(Drained::Wait(at)) => at,
                None => {
                    self.now = self.now.max(end);
                    return reply;
                }
            };
            if next > end {
                self.now = self.now.max(end);
                return reply;
            }
            self.now = next.max(self.now);
            self.engine.handle(self.now, Input::Timeout);
        }
    }

    /// What the module begins to send right now.
    fn spoken(&mut self) -> Option<Vec<u8>> {
        match self.drain() {
            Some(Drained::Reply(bytes)) => Some(bytes),
            Some(Drained::Wait(_)) | None => None,
        }
    }

    fn drain(&mut self) -> Option<Drained> {
        loop {
            match self.engine.poll() {
                Output::Effect(effect) => self.effects.push((self.now, effect)),
                Output::Transmit(bytes) => return Some(Drained::Reply(bytes.to_vec())),
                Output::Wait(Some(at)) => return Some(Drained::Wait(at)),
                Output::Wait(None) => return None,
            }
        }
    }
}

#[derive(Debug, PartialEq)]
enum Drained {
    Reply(Vec<u8>),
    Wait(Instant),
}

/// The request frame of an op, where the model has one for it.
pub fn request(module: &Module, op: &Op) -> Option<Vec<u8>> {
    let mut frame = Frame::new();
    module.exchange(op).ok()?.encode(&mut frame);
    Some(frame.bytes().to_vec())
}

/// What the host makes of a whole reply to an op.
pub fn seen(module: &Module, op: &Op, reply: &[u8]) -> Observation {
    let exchange = module.exchange(op).expect("an op of this model");
    let reply = exchange.decode_response(reply).whole();
    module.interpret(op, &reply.expect("a reply to this op").response)
}

/// Bytes of hexadecimal text; blanks do not matter.
pub fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text
        .chars()
        .filter_map(|c| c.to_digit(16))
        .map(|digit| digit as u8)
        .collect();
    digits
        .chunks(2)
        .map(|pair| pair[0] << 4 | pair[1])
        .collect()
}

/// An LC-02 request of these bytes, from address to data.
pub fn lc02(text: &str) -> Vec<u8> {
    let body = hex(text);
    let mut frame = vec![0x4C, 0x57];
    frame.extend(&body);
    frame.extend([sum8(&body), 0x0D]);
    frame
}

/// An ASCII frame with its checksum and CR.
pub fn sealed(text: &str) -> Vec<u8> {
    format!("{text}{:02X}\r", sum8(text.as_bytes())).into_bytes()
}

/// Bytes and their CRC.
pub fn with_crc(bytes: &[u8]) -> Vec<u8> {
    let mut frame = bytes.to_vec();
    frame.extend(crc16(bytes).to_le_bytes());
    frame
}
