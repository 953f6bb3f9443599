//! The modules, and what the wire does to their replies.

use crate::dice::Dice;
use crate::place::Who;
use railbus_device::{
    Bank, Eeprom, Engine, Input as Told, Module, Op, Options, Output as Does, Setup,
};
use railbus_wire::{Frame, Instant, Micros, crc16};

/// The levels at the inputs of the right module, and of another one.
pub(crate) const LEVELS: [u32; 2] = [1, 2];
/// Only the right module ever has this output on, and no command switches it.
pub(crate) const MARK: u32 = 8;

/// What the wire does to replies, and what it let through.
pub(crate) struct Wire {
    pub(crate) dice: Dice,
    /// This many of a thousand frames are lost.
    pub(crate) loss: u64,
    pub(crate) in_place: Vec<Who>,
    pub(crate) renames: bool,
    /// Which module was received, and when its reply ends.
    pub(crate) heard: Vec<(usize, Instant)>,
    /// The places where something was lost.
    pub(crate) lost: Vec<usize>,
    /// How many names were garbled.
    pub(crate) spoilt: u8,
}

impl Wire {
    pub(crate) fn carry(
        &mut self,
        player: usize,
        end: Instant,
        mut bytes: Vec<u8>,
    ) -> Option<Vec<u8>> {
        let is_there = self.in_place[player / 2] as usize == player % 2;
        if !is_there {
            return None;
        }
        if self.dice.chance(self.loss) {
            self.lost.push(player / 2);
            return None;
        }
        if self.renames && player % 2 == Who::Other as usize {
            rename(&mut bytes);
        }
        if self.loss > 0 && self.dice.chance(SPOILT) && self.spoil(&mut bytes) {
            self.lost.push(player / 2);
        }
        self.heard.push((player, end));
        Some(bytes)
    }

    /// In ASCII a garbled name shows only in not being repeated.
    fn spoil(&mut self, reply: &mut [u8]) -> bool {
        let is_name = matches!(reply, [b'!', _, _, b'9', b'0', b'5' | b'6', b'0', b'\r']);
        if is_name {
            self.spoilt = (self.spoilt + 1) % 8;
            reply[6] = b'1' + self.spoilt;
        }
        is_name
    }
}

/// This many of a thousand names are garbled where anything is lost.
const SPOILT: u64 = 100;

/// Over Modbus an EDA9050 does not identify itself. So the other model there is one that answers
/// like an EDA9060A and reports another number.
pub(crate) fn rename(reply: &mut [u8]) {
    let body = reply.len() - 2;
    let number = (3..body - 1).find(|at| reply[1] == 3 && reply[*at..at + 2] == [0x90, 0x60]);
    if let Some(at) = number {
        reply[at + 1] = 0x55;
        let sum = crc16(&reply[..body]).to_le_bytes();
        reply[body..].copy_from_slice(&sum);
    }
}

/// A module on a bench: its inputs at these levels, and the mark on or not.
pub(crate) fn engine(setup: &Setup, who: Who, turnaround: Micros) -> Engine {
    let options = Options {
        turnaround,
        ..Options::default()
    };
    let engine = Engine::new(setup, Eeprom::of(setup), options, Instant(0));
    let mut engine = engine.expect("a possible module");
    engine.handle(Instant(0), Told::Levels(LEVELS[who as usize]));
    if who == Who::Right {
        let module = Module::new(*setup).expect("a possible module");
        let op = Op::Write(module.group(Bank::new(MARK, MARK)));
        let mut frame = Frame::new();
        let exchange = module.exchange(&op).expect("a possible command");
        exchange.encode(&mut frame);
        let mut now = Instant(100_000);
        engine.handle(now, Told::Bytes(frame.bytes()));
        loop {
            match engine.poll() {
                Does::Transmit(_) => {
                    engine.handle(now, Told::Sent);
                    break;
                }
                Does::Effect(_) => {}
                Does::Wait(until) => {
                    now = until.expect("it answers");
                    engine.handle(now, Told::Timeout);
                }
            }
        }
        assert_eq!(engine.outputs(), MARK);
    }
    engine
}
