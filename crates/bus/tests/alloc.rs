//! Polling allocates nothing once it has started: the line's memory is allocated at the start.
#![allow(
    unsafe_code,
    reason = "a global allocator can't be written without; it only counts"
)]

use railbus_bus::{Bus, Config, Event, Input, ModuleId, Output, Plan, Terms};
use railbus_device::{Bank, Eeprom, Engine, Family, Module, Op, Options, Setup};
use railbus_device::{Input as Told, Output as Does};
use railbus_wire::{Address, Channel, Instant, Protocol};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: everything is left to the system's allocator; the count is a plain thread-local cell
// that itself needs no memory.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are passed on as they are.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn allocations() -> usize {
    ALLOCATIONS.with(Cell::get)
}

/// A line with one module, driven without any memory of the driver's own.
struct Line {
    bus: Bus,
    engine: Engine,
    now: Instant,
    /// The reply under way: when it will have come in.
    reply: ([u8; 256], usize),
    heard_at: Option<Instant>,
    wakes: Option<Instant>,
    seen: usize,
    done: usize,
}

impl Line {
    fn new(setup: Setup) -> Line {
        let mut bus = Bus::new(Config::default());
        bus.add(Module::new(setup).expect("possible"), Plan::default());
        // One more that never answers, so that misses and ghosts occur as well.
        let dead = Setup {
            address: Address(30),
            ..setup
        };
        bus.add(Module::new(dead).expect("possible"), Plan::default());
        let engine = Engine::new(&setup, Eeprom::of(&setup), Options::default(), Instant(0));
        let mut line = Line {
            bus,
            engine: engine.expect("possible"),
            now: Instant(0),
            reply: ([0; 256], 0),
            heard_at: None,
            wakes: None,
            seen: 0,
            done: 0,
        };
        line.bus.handle(line.now, Input::Opened);
        line
    }

    fn run_until(&mut self, until: Instant) {
        while self.now < until {
            let mut asked_at = None;
            let deadline = loop {
                match self.bus.poll() {
                    Output::Transmit { bytes, settings } => {
                        let end = self.now + settings.frame_time(bytes.len());
                        self.engine.handle(end, Told::Bytes(bytes));
                        asked_at = Some(end);
                    }
                    Output::Event(Event::Seen { .. }) => self.seen += 1,
                    Output::Event(Event::Done { end, .. }) => {
                        assert!(end.is_ok(), "{end:?}");
                        self.done += 1;
                    }
                    Output::Event(_) => {}
                    Output::Wait(at) => break at,
                }
            };
            if let Some(end) = asked_at {
                self.drain_engine(end);
            }
            let next = [deadline, self.heard_at, self.wakes];
            let next = next.into_iter().flatten().min().unwrap_or(until);
            self.now = self.now.max(next.min(until));
            if self.heard_at.is_some_and(|at| at <= self.now) {
                self.heard_at = None;
                let (bytes, len) = &self.reply;
                self.bus.handle(self.now, Input::Bytes(&bytes[..*len]));
            } else if self.wakes.is_some_and(|at| at <= self.now) {
                self.engine.handle(self.now, Told::Timeout);
                self.drain_engine(self.now);
            } else {
                self.bus.handle(self.now, Input::Timeout);
            }
        }
    }

    fn drain_engine(&mut self, at: Instant) {
        let serial = self.engine.active().serial;
        loop {
            match self.engine.poll() {
                Does::Transmit(bytes) => {
                    self.reply.0[..bytes.len()].copy_from_slice(bytes);
                    self.reply.1 = bytes.len();
                    let end = at + serial.frame_time(bytes.len());
                    self.heard_at = Some(end);
                    self.engine.handle(end, Told::Sent);
                }
                Does::Effect(_) => {}
                Does::Wait(at) => {
                    self.wakes = at;
                    break;
                }
            }
        }
    }
}

/// Rule 2: no allocation after the start. In each protocol, with a dead module on the line, for a
/// thousand seconds of polls and two thousand commands.
#[test]
fn nothing_is_allocated_once_the_line_is_under_way() {
    let families = [
        (Family::Eda9060a, Protocol::Rtu),
        (Family::Eda9050, Protocol::Ascii),
        (Family::Eda9050, Protocol::Lc02),
        (Family::R55, Protocol::R55),
    ];
    for (family, protocol) in families {
        let mut line = Line::new(Setup {
            protocol,
            ..Setup::new(family, Address(1))
        });
        line.run_until(Instant(10_000_000));
        let (before, seen, done) = (allocations(), line.seen, line.done);
        for turn in 0..2000u64 {
            let channel = Channel::new((turn % 4) as u8).expect("a channel");
            let op = Op::Write(Bank::one(channel, turn % 8 < 4));
            let taken = line.bus.submit(line.now, ModuleId(0), op, Terms::default());
            assert!(taken.is_ok());
            line.run_until(Instant(10_000_000 + (turn + 1) * 500_000));
        }
        let (allocated, polls) = (allocations() - before, line.seen - seen);
        assert!(polls > 5000, "{protocol}: only {polls} readings");
        assert_eq!(line.done - done, 2000, "{protocol}");
        assert_eq!(allocated, 0, "{protocol}: {polls} readings");
    }
}
