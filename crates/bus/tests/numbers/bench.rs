//! Several modules on a line in virtual time, and what is measured of them.

use crate::support::{Drive, Happening, millis};
use railbus_bus::{
    Bus, Config, Confirmation, Event, Fault, Input, ModuleId, Plan, Presence, Terms, Ticket,
};
use railbus_device::{Bank, Eeprom, Engine, Family, Module, Op, Options, Setup};
use railbus_wire::{Address, Channel, Instant, Micros, Protocol, SerialSettings};
use std::collections::{BTreeMap, HashMap};

/// Several modules, polled, and what is measured of them.
pub(crate) struct Bench {
    pub(crate) drive: Drive,
    pub(crate) modules: Vec<Module>,
    /// The last good reading of each op of each module: when it was requested.
    pub(crate) asked: HashMap<(usize, Op), Instant>,
    /// The greatest age of a reading before it was replaced.
    pub(crate) oldest: Micros,
    /// Since when ages count.
    pub(crate) count_from: Instant,
    pub(crate) tickets: BTreeMap<Ticket, usize>,
    pub(crate) latencies: Vec<Micros>,
    pub(crate) ends: BTreeMap<String, usize>,
    pub(crate) presence: Vec<(Instant, usize, Presence)>,
    pub(crate) requests: usize,
    pub(crate) too_early: usize,
    /// The time spent on unanswered requests to each module, including the gap.
    pub(crate) spent: Vec<Micros>,
    pub(crate) last_request: Instant,
    pub(crate) last_settings: Option<SerialSettings>,
    pub(crate) random: u64,
}

impl Bench {
    pub(crate) fn new(setups: &[Setup], plan: Plan, turnaround: Micros) -> Bench {
        let mut bus = Bus::new(Config::default());
        let modules: Vec<Module> = setups
            .iter()
            .map(|setup| Module::new(*setup).expect("a possible module"))
            .collect();
        for module in &modules {
            bus.add(module.clone(), plan);
        }
        let mut drive = Drive::new(bus);
        for setup in setups {
            drive.play(engine(setup, turnaround));
        }
        let spent = vec![Micros::ZERO; setups.len()];
        let mut bench = Bench {
            drive,
            modules,
            asked: HashMap::new(),
            oldest: Micros::ZERO,
            count_from: Instant(0),
            tickets: BTreeMap::new(),
            latencies: Vec::new(),
            ends: BTreeMap::new(),
            presence: Vec::new(),
            requests: 0,
            too_early: 0,
            spent,
            last_request: Instant(0),
            last_settings: None,
            random: 0x9E37_79B9_7F4A_7C15,
        };
        bench.drive.input(Input::Opened);
        bench
    }

    /// The reference line, with this many modules of the EDA kind.
    pub(crate) fn reference() -> Bench {
        Bench::new(&reference_setups(), Plan::default(), millis(5))
    }

    pub(crate) fn now(&self) -> Instant {
        self.drive.now
    }

    /// A number below `below`, the same in every run.
    pub(crate) fn random(&mut self, below: u64) -> u64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random % below
    }

    /// A module takes so long from now on. It begins anew with that.
    pub(crate) fn takes(&mut self, module: usize, turnaround: Micros) {
        let setup = *self.modules[module].setup();
        self.drive.players[module].engine = engine(&setup, turnaround);
    }

    /// Switches the power of a module.
    pub(crate) fn power(&mut self, module: usize, on: bool) {
        self.drive.players[module].alive = on;
    }

    pub(crate) fn submit(&mut self, module: usize, op: Op, terms: Terms) {
        let now = self.now();
        let ticket = self
            .drive
            .bus
            .submit(now, ModuleId(module), op, terms)
            .expect("taken");
        self.drive.touched();
        self.tickets.insert(ticket, module);
    }

    /// Switches any output on or off.
    pub(crate) fn switch(&mut self, module: usize) {
        let outputs = u64::from(self.modules[module].setup().outputs);
        let channel = Channel::new(self.random(outputs) as u8).expect("a channel");
        let on = self.random(2) == 1;
        self.submit(module, Op::Write(Bank::one(channel, on)), Terms::default());
    }

    /// Keeps eight commands waiting for the modules from this one on.
    pub(crate) fn flood(&mut self, first: usize, until: Instant) {
        while self.now() < until {
            while self.tickets.len() < 8 {
                let module = first + self.random((self.modules.len() - first) as u64) as usize;
                self.switch(module);
            }
            self.run_until_one_ends(until);
        }
    }

    /// Switches a module from this one on, again and again with a pause.
    pub(crate) fn switch_now_and_then(&mut self, first: usize, until: Instant) {
        while self.now() < until {
            let module = first + self.random((self.modules.len() - first) as u64) as usize;
            self.switch(module);
            while !self.tickets.is_empty() && self.run_until_one_ends(until).is_some() {}
            self.run_until(until.min(self.now() + millis(30)));
        }
    }

    pub(crate) fn run_for(&mut self, span: Micros) {
        self.run_until(self.now() + span);
    }

    pub(crate) fn run_until(&mut self, until: Instant) {
        while self.run_until_one_ends(until).is_some() {}
    }

    /// Runs until a command has ended; its module, and how.
    pub(crate) fn run_until_one_ends(&mut self, until: Instant) -> Option<(usize, &'static str)> {
        let mut busy_until = self.drive.busy_until;
        while let Some(happening) = self.drive.step(until) {
            match happening {
                Happening::Frame {
                    bytes,
                    settings,
                    end,
                } => {
                    self.note_request(&bytes, settings, busy_until);
                    self.drive.ask_players(end, &bytes);
                }
                Happening::Heard(_) => {}
                Happening::Told(event) => {
                    let end = match event {
                        Event::Done { ticket, end, .. } => Some((self.tickets[&ticket], name(end))),
                        _ => None,
                    };
                    self.note(event);
                    if end.is_some() {
                        return end;
                    }
                }
            }
            busy_until = self.drive.busy_until;
        }
        None
    }

    /// The module that a frame is for; addresses differ on these lines.
    pub(crate) fn addressee(&self, frame: &[u8]) -> usize {
        let found = self.modules.iter().position(|module| {
            let setup = module.setup();
            let address = setup.address.0;
            match setup.protocol {
                Protocol::Rtu => frame[0] == address,
                Protocol::R55 => frame[..2] == [0x55, address],
                Protocol::Lc02 => frame[..3] == [0x4C, 0x57, address],
                Protocol::Ascii => {
                    let digits = format!("{address:02X}");
                    matches!(frame[0], b'$' | b'#' | b'@' | b'%')
                        && frame[1..3] == *digits.as_bytes()
                }
            }
        });
        found.expect("a module's address")
    }

    pub(crate) fn note_request(
        &mut self,
        frame: &[u8],
        settings: SerialSettings,
        busy_until: Instant,
    ) {
        let now = self.now();
        let module = self.addressee(frame);
        let gap = self.modules[module].setup().request_gap();
        let switched = self.last_settings.is_some_and(|last| last != settings);
        let gap = match self.last_settings {
            Some(last) if switched => gap.max(last.t3_5() * 2).max(settings.t3_5() * 2),
            _ => gap,
        };
        self.requests += 1;
        if now < busy_until + gap {
            self.too_early += 1;
        }
        self.last_request = now;
        self.last_settings = Some(settings);
    }

    pub(crate) fn note(&mut self, event: Event) {
        match event {
            Event::Seen {
                module,
                op,
                asked,
                heard,
                ..
            } => {
                let last = self.asked.insert((module.0, op), asked);
                if let Some(last) = last
                    && self.count_from <= last
                {
                    self.oldest = self.oldest.max(heard.since(last));
                }
            }
            Event::Done { ticket, end, took } => {
                self.tickets.remove(&ticket).expect("ends once");
                *self.ends.entry(name(end).to_owned()).or_default() += 1;
                self.latencies.push(took);
            }
            Event::Presence { module, presence } => {
                self.presence.push((self.now(), module.0, presence));
            }
            Event::Missed { module, .. } => {
                let gap = self.modules[module.0].setup().request_gap();
                let took = self.now().since(self.last_request);
                self.spent[module.0] += took + gap;
            }
            _ => {}
        }
    }

    /// The age of the oldest reading of a running module, now and in the past.
    pub(crate) fn oldest(&self, alive: impl Fn(usize) -> bool) -> Micros {
        let present = self
            .asked
            .iter()
            .filter(|((module, op), _)| alive(*module) && self.polls(*module, op))
            .map(|(_, asked)| self.now().since(*asked));
        present.fold(self.oldest, Micros::max)
    }

    pub(crate) fn polls(&self, module: usize, op: &Op) -> bool {
        self.modules[module].full_poll().any(|poll| poll == *op)
    }

    pub(crate) fn forget(&mut self) {
        self.latencies.clear();
        self.ends.clear();
        self.oldest = Micros::ZERO;
        self.count_from = self.now();
        self.spent.fill(Micros::ZERO);
    }

    /// The p99 and the maximum latency of commands.
    pub(crate) fn p99(&mut self) -> (Micros, Micros) {
        self.latencies.sort();
        let at = self.latencies.len() * 99 / 100;
        (self.latencies[at], self.latencies[self.latencies.len() - 1])
    }
}

fn engine(setup: &Setup, turnaround: Micros) -> Engine {
    // The module detects the end of a frame itself, after t3.5.
    let recognises = match setup.protocol {
        Protocol::Rtu => setup.serial.t3_5(),
        _ => Micros::ZERO,
    };
    let options = Options {
        turnaround: turnaround - recognises,
        insist_on_gap: true,
        ..Options::default()
    };
    let engine = Engine::new(setup, Eeprom::of(setup), options, Instant(0));
    engine.expect("a possible module")
}

/// How a command ended, in one word.
const fn name(end: Result<Confirmation, Fault>) -> &'static str {
    match end {
        Ok(Confirmation::Readback) => "readback",
        Ok(Confirmation::Reply) => "reply",
        Ok(Confirmation::Sent) => "sent",
        Err(fault) => fault.name(),
    }
}

/// Three EDA9060A and two EDA9050, whose gap is that of Modbus.
pub(crate) fn reference_setups() -> Vec<Setup> {
    (1..=5)
        .map(|address| Setup {
            protocol: Protocol::Rtu,
            ..Setup::new(
                if address <= 3 {
                    Family::Eda9060a
                } else {
                    Family::Eda9050
                },
                Address(address),
            )
        })
        .collect()
}
