//! Ten million bytes of noise: no engine panics, and no output moves unless a judge outside the
//! engine finds a whole frame for the module among them, or the watchdog tripped.

use super::support::with_crc;
use super::{ON, dice, setups};
use railbus_device::{Eeprom, Effect, Engine, Extensions, Input, Output, Setup};
use railbus_wire::{Instant, Micros, Protocol, crc16, sum8};

const SEED: u64 = 0xBE_0001;
/// Bytes in all.
const BYTES: usize = 10_000_000;
const OWN: u8 = 1;

/// Whether a whole frame for the module, or for all, is among the last bytes received. A Modbus
/// frame is everything since the last silence; the others can begin anywhere.
fn holds_a_frame(protocol: Protocol, heard: &[u8]) -> bool {
    let mut windows = (0..heard.len()).map(|at| &heard[at..]);
    match protocol {
        Protocol::Rtu => {
            let own = matches!(heard, [0 | OWN, _, _, _, ..]);
            own && heard.len() <= 256 && crc16(heard) == 0
        }
        Protocol::R55 => windows.any(|rest| match rest {
            [0x55, OWN | 0xF5, ..] if rest.len() >= 8 => sum8(&rest[..7]) == rest[7],
            _ => false,
        }),
        Protocol::Lc02 => windows.any(|rest| {
            let ends = rest.iter().enumerate().filter(|(_, byte)| **byte == 0x0D);
            let mut bodies = ends.filter_map(|(end, _)| rest.get(2..end)?.split_last());
            rest.starts_with(&[0x4C, 0x57, OWN]) && bodies.any(|(sum, body)| *sum == sum8(body))
        }),
        Protocol::Ascii => windows.any(|rest| {
            let end = rest.iter().position(|byte| *byte == 0x0D);
            let line = end.and_then(|end| rest.get(..end)).unwrap_or_default();
            matches!(line, [b'#' | b'$' | b'%' | b'~', b'0', b'1', ..])
        }),
    }
}

/// Almost valid frames, to be damaged.
fn models(protocol: Protocol) -> Vec<Vec<u8>> {
    let summed = |bytes: &[u8]| [bytes, &[sum8(bytes)]].concat();
    match protocol {
        Protocol::Rtu => [
            &[OWN, 5, 0, 60, 0xFF, 0][..],
            &[OWN, 5, 0, 8, 0xFF, 0],
            &[OWN, 5, 0, 0, 0xFF, 0],
            &[OWN, 0x0F, 0, 0, 0, 4, 1, 0x0F],
            &[OWN, 0x10, 0xBE, 4, 0, 1, 2, 0, 1],
            &[OWN, 6, 0xBE, 0, 0, 0],
            &[OWN, 8, 0, 0x0B, 0, 0],
            &[OWN, 0x2B, 0x0E, 2, 0],
            &[2, 5, 0, 60, 0xFF, 0],
            &[0, 5, 0, 8, 0xFF, 0],
        ]
        .map(with_crc)
        .to_vec(),
        Protocol::R55 => [
            [0x55, OWN, 0x12, 0, 0, 0, 1],
            [0x55, OWN, 0x13, 0, 0, 0, 0xFF],
            [0x55, OWN, 0x71, 0, 0, 1, 0xE4],
            [0x55, OWN, 0x21, 0, 3, 0xE8, 1],
            [0x55, 0xF5, 0x33, 0, 0, 0, 0xFF],
            [0x55, 2, 0x12, 0, 0, 0, 1],
        ]
        .map(|frame| summed(&frame))
        .to_vec(),
        Protocol::Lc02 => [
            &[OWN, 4, 0xFF, 0x0F][..],
            &[OWN, 4, 1, 1],
            &[OWN, 3],
            &[2, 4, 0xFF, 0x0F],
        ]
        .map(|body| [&[0x4C, 0x57][..], &summed(body), &[0x0D]].concat())
        .to_vec(),
        Protocol::Ascii => [
            "#01000F\r",
            "#011001\r",
            "~0150101\r",
            "~011\r",
            "~**\r",
            "#02000F\r",
        ]
        .map(|text| text.as_bytes().to_vec())
        .to_vec(),
    }
}

/// A piece of input: random, or a frame with some bytes changed or missing.
fn noise(state: &mut u64, models: &[Vec<u8>]) -> Vec<u8> {
    let any = |state: &mut u64| dice(state, 256) as u8;
    let mut frame = match dice(state, 4) {
        0 => (0..dice(state, 40)).map(|_| any(state)).collect(),
        _ => models[dice(state, models.len() as u64) as usize].clone(),
    };
    // Sometimes it stays whole.
    let spoils = if dice(state, 200) == 0 {
        0
    } else {
        1 + dice(state, 2)
    };
    for _ in 0..spoils {
        let at = dice(state, frame.len() as u64 + 1) as usize;
        match frame.get_mut(at) {
            Some(byte) => match dice(state, 3) {
                0 => *byte ^= 1 << dice(state, 8),
                1 => *byte = any(state),
                _ => frame.truncate(at),
            },
            None => frame.push(any(state)),
        }
    }
    frame
}

/// A module that receives only noise, and its judge.
struct Watched {
    setup: Setup,
    eeprom: Eeprom,
    engine: Engine,
    now: Instant,
    /// What was received since the last silence, or most recently.
    heard: Vec<u8>,
    /// A frame for the module was received since power-up.
    licensed: bool,
    /// How often that was so and outputs moved.
    licences: usize,
    moves: usize,
    trips: usize,
}

impl Watched {
    fn new(setup: Setup, watchdog: u8) -> Watched {
        let eeprom = Eeprom {
            extensions: Extensions {
                watchdog,
                safe: 0b01,
                ..Extensions::NEUTRAL
            },
            ..Eeprom::of(&setup)
        };
        let now = Instant(0);
        Watched {
            setup,
            eeprom,
            engine: Engine::new(&setup, eeprom, ON, now).expect("possible"),
            now,
            heard: Vec::new(),
            licensed: false,
            licences: 0,
            moves: 0,
            trips: 0,
        }
    }

    /// An output was allowed to move; from here on none is.
    fn restart(&mut self) {
        self.licences += usize::from(self.licensed);
        self.licensed = false;
        self.heard.clear();
        self.engine = Engine::new(&self.setup, self.eeprom, ON, self.now).expect("possible");
    }

    fn drain(&mut self) {
        loop {
            let mut sent = false;
            match self.engine.poll() {
                Output::Wait(_) => return,
                Output::Transmit(bytes) => {
                    assert!(!bytes.is_empty() && bytes.len() <= 256);
                    sent = true;
                }
                Output::Effect(Effect::Output { .. }) => {
                    self.moves += 1;
                    let extensions = self.engine.eeprom().extensions;
                    let tripped = extensions.tripped && self.eeprom.extensions.watchdog > 0;
                    let place = format!("{:?} at {:?}, seed {SEED:X}", self.setup, self.now);
                    assert!(self.licensed || tripped, "{place}: {:02X?}", self.heard);
                    assert!(self.licensed || self.engine.outputs() == 0b01, "{place}");
                }
                Output::Effect(_) => {}
            }
            if sent {
                self.now = self.now + Micros::from_millis(20);
                self.engine.handle(self.now, Input::Sent);
            }
        }
    }

    fn happens(&mut self, input: Input<'_>) {
        self.engine.handle(self.now, input);
        self.drain();
    }

    /// Feeds a piece, followed by silence or not.
    fn hears(&mut self, piece: &[u8], silence: Micros) {
        self.now = self.now + self.setup.serial.frame_time(piece.len());
        self.heard.extend(piece);
        // The judge must not miss a frame: the move is licensed before the engine acts.
        self.licensed |= holds_a_frame(self.setup.protocol, &self.heard);
        self.happens(Input::Bytes(piece));
        self.now = self.now + silence;
        self.happens(Input::Timeout);
        let over = match self.setup.protocol {
            Protocol::Rtu => silence >= self.setup.serial.t3_5(),
            _ => self.heard.len() > 300,
        };
        if self.licensed || self.engine.eeprom().extensions.tripped {
            self.trips += usize::from(self.engine.eeprom().extensions.tripped);
            self.now = self.now + Micros::from_millis(50);
            self.happens(Input::Timeout);
            self.restart();
        } else if over {
            let keep = match self.setup.protocol {
                Protocol::Rtu => 0,
                _ => 64,
            };
            self.heard
                .drain(..self.heard.len() - keep.min(self.heard.len()));
        }
    }
}

/// Half of the bytes, shared by all families and protocols.
fn move_nothing(watchdog: u8) {
    let mut state = SEED + u64::from(watchdog);
    let share = BYTES / 2 / setups().count() + 1;
    for setup in setups() {
        let models = models(setup.protocol);
        let mut module = Watched::new(setup, watchdog);
        let mut bytes = 0;
        while bytes < share {
            let piece = noise(&mut state, &models);
            bytes += piece.len();
            let silence = match dice(&mut state, 8) {
                0 => 0,
                1 => dice(&mut state, 4_000),
                2 => dice(&mut state, 400_000),
                _ => dice(&mut state, 12_000),
            };
            module.hears(&piece, Micros(silence));
            match dice(&mut state, 64) {
                0 => module.happens(Input::BadByte),
                1 => module.happens(Input::Overrun),
                _ => {}
            }
        }
        // Both outcomes occurred.
        assert!(module.moves > 0 && module.licences > 0, "{setup:?}");
        assert_eq!(module.trips > 0, watchdog > 0, "{setup:?}");
    }
}

// Ten million bytes in all.

#[test]
fn five_million_bytes_of_noise_move_nothing() {
    move_nothing(0);
}

#[test]
fn five_million_bytes_of_noise_move_only_to_the_safe_values() {
    move_nothing(2);
}
