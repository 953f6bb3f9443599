//! The driver of a line in virtual time, exactly as the real one does it, and modules that answer.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

use railbus_bus::{Bus, Event, Input, Output};
use railbus_device::{Engine, Input as Told, Output as Does};
use railbus_wire::{Instant, Micros, SerialSettings};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// What happened next.
#[derive(Debug)]
pub enum Happening {
    /// The line sent a frame, from now until `end`.
    Frame {
        bytes: Vec<u8>,
        settings: SerialSettings,
        end: Instant,
    },
    /// The line heard these bytes.
    Heard(Vec<u8>),
    /// The line reported an event.
    Told(Event),
}

/// A module, simulated by the engine that the firmware has too.
pub struct Player {
    pub engine: Engine,
    /// Whether it has power.
    pub alive: bool,
    wakes: Option<Instant>,
}

/// What the line will have received, if anything, where this station has sent these bytes by then.
pub type Way = Box<dyn FnMut(usize, Instant, Vec<u8>) -> Option<Vec<u8>>>;

/// A line, its driver, and everything at the other end of the wire.
pub struct Drive {
    pub bus: Bus,
    pub now: Instant,
    pub players: Vec<Player>,
    /// The adapter echoes.
    pub echoes: bool,
    /// What happens to the modules' replies on their way.
    pub way: Option<Way>,
    /// The end of the last transmission, known to the test only.
    pub busy_until: Instant,
    arrivals: BinaryHeap<Reverse<(Instant, u64, Vec<u8>)>>,
    count: u64,
    deadline: Option<Instant>,
    drained: bool,
}

impl Drive {
    pub fn new(bus: Bus) -> Drive {
        Drive {
            bus,
            now: Instant(0),
            players: Vec::new(),
            echoes: false,
            way: None,
            busy_until: Instant(0),
            arrivals: BinaryHeap::new(),
            count: 0,
            deadline: None,
            drained: false,
        }
    }

    pub fn play(&mut self, engine: Engine) {
        self.players.push(Player {
            engine,
            alive: true,
            wakes: None,
        });
    }

    /// Feeds an input to the line now; the driver drains it afterwards.
    pub fn input(&mut self, input: Input<'_>) {
        self.bus.handle(self.now, input);
        self.drained = false;
    }

    /// After a call of the line other than [`Drive::input`].
    pub fn touched(&mut self) {
        self.drained = false;
    }

    /// These bytes will have been received at that moment.
    pub fn hear_at(&mut self, at: Instant, bytes: &[u8]) {
        self.count += 1;
        self.arrivals
            .push(Reverse((at, self.count, bytes.to_vec())));
    }

    /// A frame that ends then reaches the modules.
    pub fn ask_players(&mut self, end: Instant, bytes: &[u8]) {
        for index in 0..self.players.len() {
            if self.players[index].alive {
                self.ask_player(index, end, bytes);
            }
        }
    }

    /// It reaches this one.
    pub fn ask_player(&mut self, index: usize, end: Instant, bytes: &[u8]) {
        self.players[index].engine.handle(end, Told::Bytes(bytes));
        self.drain_player(index, end);
    }

    fn drain_player(&mut self, index: usize, at: Instant) {
        let mut talked = None;
        let player = &mut self.players[index];
        let serial = player.engine.active().serial;
        loop {
            match player.engine.poll() {
                Does::Transmit(bytes) => {
                    let bytes = bytes.to_vec();
                    let end = at + serial.frame_time(bytes.len());
                    player.engine.handle(end, Told::Sent);
                    talked = Some((end, bytes));
                }
                Does::Effect(_) => {}
                Does::Wait(until) => {
                    player.wakes = until;
                    break;
                }
            }
        }
        let heard = talked.and_then(|(end, bytes)| match &mut self.way {
            Some(way) => Some((end, way(index, end, bytes)?)),
            None => Some((end, bytes)),
        });
        if let Some((end, bytes)) = heard {
            self.hear_at(end, &bytes);
        }
    }

    /// What happens next, until that moment; `None` when it has come.
    pub fn step(&mut self, until: Instant) -> Option<Happening> {
        loop {
            if !self.drained {
                match self.bus.poll() {
                    Output::Transmit { bytes, settings } => {
                        let end = self.now + settings.frame_time(bytes.len());
                        let bytes = bytes.to_vec();
                        self.busy_until = self.busy_until.max(end);
                        if self.echoes {
                            self.hear_at(end, &bytes);
                        }
                        return Some(Happening::Frame {
                            bytes,
                            settings,
                            end,
                        });
                    }
                    Output::Event(event) => return Some(Happening::Told(event)),
                    Output::Wait(at) => {
                        self.deadline = at;
                        self.drained = true;
                    }
                }
            }
            let heard = self.arrivals.peek().map(|Reverse((at, ..))| *at);
            let player = (0..self.players.len())
                .filter(|index| self.players[*index].alive)
                .filter_map(|index| Some((self.players[index].wakes?, index)))
                .min();
            let woken = player.map(|(at, _)| at);
            let next = [heard, woken, self.deadline].into_iter().flatten().min();
            let Some(next) = next.filter(|next| *next <= until) else {
                self.now = until;
                return None;
            };
            self.now = self.now.max(next);
            if heard == Some(next)
                && let Some(Reverse((_, _, bytes))) = self.arrivals.pop()
            {
                self.busy_until = self.busy_until.max(self.now);
                self.input(Input::Bytes(&bytes));
                return Some(Happening::Heard(bytes));
            }
            match player {
                Some((at, index)) if at == next => {
                    self.players[index].wakes = None;
                    self.players[index].engine.handle(at, Told::Timeout);
                    self.drain_player(index, at);
                }
                _ => self.input(Input::Timeout),
            }
        }
    }
}

/// This many milliseconds.
pub const fn millis(count: u64) -> Micros {
    Micros::from_millis(count)
}
