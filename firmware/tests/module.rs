//! The loop around the engine, on a board that only exists in this file.

use railbus_device::{Eeprom, Family, Setup};
use railbus_firmware::{Board, Heard, Module, Pinned, Sensed, What};
use railbus_nvm::Record;
use railbus_wire::{Address, Instant, Micros, SerialSettings};
use std::collections::VecDeque;

/// Relay 1 on, and its reply: coil 60, decimal [ERC-8 §2].
const ON: [u8; 8] = [0x01, 0x05, 0x00, 0x3C, 0xFF, 0x00, 0x4C, 0x36];

/// The calls of a board, in order.
#[derive(Debug, PartialEq)]
enum Told {
    Transmit(Vec<u8>),
    Listen,
    Retune(SerialSettings),
    Drive(u32),
    Save(Eeprom),
}

/// A board whose clock is set by the test.
#[derive(Default)]
struct Bench {
    now: u64,
    line: VecDeque<Heard>,
    drained: Option<Instant>,
    sensed: Sensed,
    senses: usize,
    told: Vec<Told>,
}

impl Board for Bench {
    fn now(&self) -> Instant {
        Instant(self.now)
    }
    fn hear(&mut self) -> Option<Heard> {
        self.line.pop_front_if(|heard| heard.at.0 <= self.now)
    }
    fn heard_at(&self) -> Option<Instant> {
        self.line.front().map(|heard| heard.at)
    }
    fn transmit(&mut self, bytes: &[u8]) {
        self.drained = None;
        self.told.push(Told::Transmit(bytes.to_vec()));
    }
    fn drained(&self) -> Option<Instant> {
        self.drained
    }
    fn listen(&mut self) {
        self.told.push(Told::Listen);
    }
    fn retune(&mut self, serial: SerialSettings) {
        self.told.push(Told::Retune(serial));
    }
    fn light(&mut self, _lit: bool) {}
    fn drive(&mut self, outputs: u32) {
        self.told.push(Told::Drive(outputs));
    }
    fn sense(&mut self) -> Sensed {
        self.senses += 1;
        self.sensed
    }
    fn save(&mut self, settings: &Eeprom) {
        self.told.push(Told::Save(*settings));
    }
}

impl Bench {
    /// A started module; the calls so far are cleared.
    fn with(family: Family) -> (Bench, Module) {
        let record = Record::factory(&Setup::new(family, Address(1))).unwrap();
        let mut module = Module::new(&record, Instant(0)).unwrap();
        let mut bench = Bench::default();
        module.start(&mut bench);
        bench.told.clear();
        (bench, module)
    }

    /// These characters are received from `from` on, at 9600 8N1.
    fn says(&mut self, from: u64, bytes: &[u8]) {
        let ends = (1..).map(|count| Instant(from) + SerialSettings::FACTORY.frame_time(count));
        let heard = ends.zip(bytes).map(|(at, byte)| Heard {
            at,
            what: What::Byte(*byte),
        });
        self.line.extend(heard);
    }

    /// Advances the time as the module asks for it, up to `until`.
    fn run(&mut self, module: &mut Module, until: u64) {
        loop {
            match module.step(self) {
                Some(at) if at.0 <= until => self.now = self.now.max(at.0),
                _ => break,
            }
        }
        self.now = until;
    }

    fn replies(&self) -> usize {
        let replies = self
            .told
            .iter()
            .filter(|told| matches!(told, Told::Transmit(_)));
        replies.count()
    }
}

#[test]
fn a_module_starts_with_outputs_off_and_the_line_let_go() {
    let record = Record::factory(&Setup::new(Family::Erc8, Address(1))).unwrap();
    let mut bench = Bench::default();
    Module::new(&record, Instant(0)).unwrap().start(&mut bench);
    let serial = SerialSettings::FACTORY;
    assert_eq!(
        bench.told,
        [Told::Drive(0), Told::Retune(serial), Told::Listen]
    );
}

#[test]
fn the_relay_moves_before_the_reply_and_the_line_is_let_go_after_it() {
    let (mut bench, mut module) = Bench::with(Family::Erc8);
    bench.says(1_000, &ON);
    bench.run(&mut module, 20_000);
    assert_eq!(bench.told, [Told::Drive(1), Told::Transmit(ON.to_vec())]);
    // The last byte goes into the shift register, and takes a character to leave.
    bench.drained = Some(Instant(28_000));
    let left = 28_000 + SerialSettings::FACTORY.frame_time(1).0;
    bench.run(&mut module, left - 1);
    assert_eq!(bench.told.len(), 2, "it is still leaving");
    bench.run(&mut module, left);
    assert_eq!(bench.told.pop(), Some(Told::Listen));
}

#[test]
fn silence_is_only_believed_when_all_that_was_heard_is_told() {
    let (mut bench, mut module) = Bench::with(Family::Erc8);
    bench.says(1_000, &ON);
    // The loop only makes a pass long after the frame and its silence.
    bench.now = 50_000;
    bench.run(&mut module, 60_000);
    assert_eq!(bench.replies(), 1);
}

#[test]
fn a_frame_with_a_lost_or_bad_character_moves_nothing_and_is_counted() {
    for what in [What::Lost, What::Bad] {
        let (mut bench, mut module) = Bench::with(Family::Erc8);
        bench.says(1_000, &ON);
        bench.line[3].what = what;
        bench.run(&mut module, 100_000);
        assert_eq!(bench.told, []);
        let counts = module.counts();
        let (lost, bad) = (what == What::Lost, what == What::Bad);
        assert_eq!((counts.lost, counts.bad), (lost.into(), bad.into()));
        assert_eq!(counts.heard, 8);
    }
}

#[test]
fn a_transmitter_that_stalls_gives_the_line_back() {
    let (mut bench, mut module) = Bench::with(Family::Erc8);
    bench.says(1_000, &ON);
    bench.run(&mut module, 20_000);
    bench.run(&mut module, 1_000_000);
    assert_eq!(bench.told.pop(), Some(Told::Listen));
    assert_eq!(module.counts().stalled, 1);
    // And it receives again.
    bench.says(1_100_000, &ON);
    bench.run(&mut module, 1_150_000);
    assert_eq!(bench.replies(), 2);
}

#[test]
fn what_comes_while_it_talks_waits_until_it_listens() {
    let (mut bench, mut module) = Bench::with(Family::Erc8);
    bench.says(1_000, &ON);
    bench.run(&mut module, 20_000);
    // QEMU's host has the reply at once, and sends the next request before the reply could have
    // ended.
    bench.says(21_000, &ON);
    bench.drained = Some(Instant(22_000));
    bench.run(&mut module, 60_000);
    assert_eq!(bench.replies(), 2);
}

#[test]
fn settings_are_kept_before_the_reply_and_hold_after_it() {
    let (mut bench, mut module) = Bench::with(Family::Erc8);
    // Register 1 = 2: 19200 baud [ERC-8 §4].
    bench.says(1_000, &[0x01, 0x06, 0x00, 0x01, 0x00, 0x02, 0x59, 0xCB]);
    bench.run(&mut module, 20_000);
    assert!(
        matches!(bench.told[..], [Told::Save(_), Told::Transmit(_)]),
        "{:?}",
        bench.told
    );
    bench.drained = Some(Instant(28_000));
    bench.run(&mut module, 40_000);
    let Some(Told::Retune(serial)) = bench.told.pop() else {
        panic!("it still speaks as before");
    };
    assert_eq!(serial.baud.rate(), 19200);
}

#[test]
fn inputs_are_read_when_somebody_begins_to_ask() {
    let (mut bench, mut module) = Bench::with(Family::Eda9050);
    bench.run(&mut module, 10_000_000);
    assert_eq!(bench.senses, 1, "at the start, and never on a silent line");
    bench.sensed.panel = Some(Pinned {
        levels: 0b0101_0101,
        dip: 0,
        init_grounded: false,
    });
    bench.says(10_000_000, b"$016\r");
    bench.run(&mut module, 10_040_000);
    assert_eq!(bench.told, [Told::Transmit(b"!005500\r".to_vec())]);
    assert_eq!(bench.senses, 2, "its five characters take 5 ms");
}

#[test]
fn outputs_of_a_chip_that_is_not_there_read_off() {
    let (mut bench, mut module) = Bench::with(Family::Erc8);
    bench.sensed.stuck = 0xFFFF;
    bench.says(10_000, &ON);
    bench.run(&mut module, 100_000);
    assert_eq!(module.engine().outputs(), 0);
}

#[test]
fn a_silent_module_sleeps_until_its_next_deadline() {
    let (mut bench, mut module) = Bench::with(Family::Erc8);
    assert_eq!(module.step(&mut bench), None);
    let (mut bench, mut module) = Bench::with(Family::Eda9060a);
    let blink = module.step(&mut bench);
    assert_eq!(
        blink,
        Some(Instant(0) + Micros::from_millis(500)),
        "its LED"
    );
}
