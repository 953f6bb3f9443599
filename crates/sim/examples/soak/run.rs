//! One line, its master and its judge, in virtual time.

use crate::dice::Dice;
use crate::oracle::{OnceOnly, Oracle, Told, ToldEnd, Verdicts};
use crate::plants::{Plant, Stalls};
use railbus_bus as bus;
use railbus_device::{Bank, Effect, Family, Module, Observation, Op};
use railbus_sim as sim;
use railbus_sim::DurationRange;
use railbus_wire::{Channel, Instant, Micros, Protocol, r55};

/// The parameters of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Script {
    /// The length in virtual time.
    pub(crate) time: Micros,
    /// The mean pause between commands.
    pub(crate) command_every: Micros,
    /// The mean pause between changes at the modules' inputs.
    pub(crate) change_every: Micros,
    /// From one poll of a point to the next.
    pub(crate) poll_every: Micros,
    /// Off only to check that the judge would detect it.
    pub(crate) ghosts: bool,
    /// The run ends at the first wrong thing, so that the trace ends there.
    pub(crate) stop_at_wrong: bool,
}

/// The result of a run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Report {
    /// Requests sent.
    pub(crate) exchanges: u64,
    /// Faults injected.
    pub(crate) faults: u64,
    /// Virtual time, in microseconds.
    pub(crate) time: u64,
    /// What the judge found.
    pub(crate) verdicts: Verdicts,
    /// The first thing found to be wrong.
    pub(crate) first_wrong: Option<String>,
    /// The seed that was run then.
    pub(crate) wrong_seed: u64,
    /// What happened before it, where a trace was asked for.
    pub(crate) trace: String,
    /// Late replies that were recognised as such.
    pub(crate) late: u64,
}

impl Report {
    /// Adds another run's.
    pub(crate) fn add(&mut self, other: &Report) {
        self.exchanges += other.exchanges;
        self.faults += other.faults;
        self.time += other.time;
        self.late += other.late;
        self.verdicts.add(&other.verdicts);
    }
}

struct Run {
    now: Instant,
    bus: bus::Bus,
    line: sim::VirtualLine,
    ids: Vec<sim::SlotId>,
    setups: Vec<railbus_device::Setup>,
    oracle: Oracle,
    dice: Dice,
    report: Report,
    stalls: Option<Stalls>,
    /// Until when all received bytes are held back.
    stalled_until: Instant,
    next_stall: Instant,
    held_back: Vec<u8>,
    /// Garbled characters when the current request began.
    spoilt_at_request: u64,
    next_command: Instant,
    next_change: Instant,
}

/// Runs a line for as long as the script says.
pub(crate) fn run(plant: &Plant, seed: u64, script: &Script) -> Report {
    let mut run = Run::new(plant, seed, script);
    let end = Instant(script.time.0);
    run.bus.handle(run.now, bus::Input::Opened);
    while run.now < end && !(script.stop_at_wrong && run.oracle.first_wrong.is_some()) {
        run.step(script);
    }
    run.finish(script)
}

impl Run {
    fn new(plant: &Plant, seed: u64, script: &Script) -> Run {
        let now = Instant(0);
        let config = bus::Config {
            ghosts: script.ghosts,
            ..bus::Config::default()
        };
        let mut bus = bus::Bus::new(config);
        let mut line = sim::VirtualLine::new(plant.line);
        let mut oracle = Oracle::default();
        let (mut ids, mut setups) = (Vec::new(), Vec::new());
        for (index, fitted) in plant.modules.iter().enumerate() {
            let name = format!("m{index}");
            let id = line
                .add(now, &name, &fitted.setup, fitted.eeprom, fitted.options)
                .expect("plants are possible");
            if fitted.dead {
                line.set_module_faults(id, sim::Faults::MUTE);
            }
            let plan = bus::Plan {
                interval: script.poll_every,
                ..bus::Plan::default()
            };
            bus.add(
                Module::new(fitted.setup).expect("plants are possible"),
                plan,
            );
            let toggled = if fitted.setup.family == Family::R55 {
                1 << 7
            } else {
                0
            };
            let pulsed = u32::from(fitted.eeprom.pulse_mask);
            oracle.add(fitted.setup.input_mask(), OnceOnly { pulsed, toggled });
            ids.push(id);
            setups.push(fitted.setup);
        }
        Run {
            now,
            bus,
            line,
            ids,
            setups,
            oracle,
            dice: Dice::new(seed.wrapping_mul(0x2545_F491_4F6C_DD1D)),
            report: Report::default(),
            stalls: plant.stalls,
            stalled_until: now,
            next_stall: Instant(if plant.stalls.is_some() { 0 } else { u64::MAX }),
            held_back: Vec::new(),
            spoilt_at_request: 0,
            next_command: Instant(1_000_000),
            next_change: Instant(0),
        }
    }

    /// Does everything that is due now, then advances to the next moment.
    fn step(&mut self, script: &Script) {
        if self.next_change <= self.now {
            self.next_change = self.now + self.around(script.change_every);
            self.change_inputs();
        }
        if self.next_command <= self.now {
            self.next_command = self.now + self.around(script.command_every);
            self.command();
        }
        if self.next_stall <= self.now {
            self.stall();
        }
        if self.stalled_until <= self.now && !self.held_back.is_empty() {
            let bytes = core::mem::take(&mut self.held_back);
            self.bus.handle(self.now, bus::Input::Bytes(&bytes));
        }
        let bus_wakes = self.drain_bus();
        let line_wakes = self.drain_line();
        let Some(line_wakes) = line_wakes else { return };
        let mut own = self.next_change.min(self.next_command).min(self.next_stall);
        if !self.held_back.is_empty() {
            own = own.min(self.stalled_until);
        }
        let bus_wakes = bus_wakes.unwrap_or(own);
        self.now = line_wakes.min(bus_wakes).min(own).max(self.now);
        if line_wakes <= self.now {
            self.line.handle(self.now, sim::Input::Timeout);
        } else if bus_wakes <= self.now {
            self.bus.handle(self.now, bus::Input::Timeout);
        }
    }

    /// Holds back all received bytes for a time.
    fn stall(&mut self) {
        let Some(stalls) = self.stalls else { return };
        let DurationRange { from, to } = stalls.time;
        self.stalled_until = self.now + Micros(self.dice.between(from.0, to.0));
        self.next_stall = self.stalled_until + self.around(stalls.every);
        self.report.faults += 1;
    }

    fn around(&mut self, mean: Micros) -> Micros {
        Micros(self.dice.between(mean.0 / 4, mean.0 * 7 / 4).max(1))
    }

    fn spoilt(&self) -> u64 {
        spoilt(self.line.injected(), self.line.collisions())
    }

    /// Runs until the line master waits; returns its deadline.
    fn drain_bus(&mut self) -> Option<Instant> {
        loop {
            match self.bus.poll() {
                bus::Output::Transmit { bytes, settings } => {
                    // What spoils the request itself counts too.
                    let injected = self.line.injected();
                    self.spoilt_at_request = spoilt(injected, self.line.collisions());
                    let send = sim::Input::Send { bytes, settings };
                    self.line.handle(self.now, send);
                    self.report.exchanges += 1;
                }
                bus::Output::Event(event) => self.judge(event),
                bus::Output::Wait(at) => return at,
            }
        }
    }

    /// Runs until the line waits (then returns its deadline), or something was received.
    fn drain_line(&mut self) -> Option<Instant> {
        loop {
            match self.line.poll() {
                sim::Output::Heard { at, bytes } if at < self.stalled_until => {
                    self.held_back.extend_from_slice(bytes);
                }
                sim::Output::Heard { at, bytes } => {
                    self.bus.handle(at.max(self.now), bus::Input::Bytes(bytes));
                    return None;
                }
                sim::Output::Effect { at, module, effect } => {
                    if let Effect::Output { channel, on } = effect {
                        let spoilt = self.spoilt() > self.spoilt_at_request;
                        let index = module.index();
                        match self.line.is_powered(module) {
                            true => self.oracle.output(at.0, index, (channel, on), spoilt),
                            false => self.oracle.lost_power(at.0, index, channel),
                        }
                    }
                }
                sim::Output::Wait(at) => return Some(at.unwrap_or(Instant(u64::MAX))),
            }
        }
    }

    fn judge(&mut self, event: bus::Event) {
        let spoilt = self.spoilt();
        match event {
            bus::Event::Seen {
                module,
                seen,
                asked,
                heard,
                ..
            } => {
                let spoilt = spoilt > self.spoilt_at_request;
                self.judge_seen(module.0, seen, (asked.0, heard.0), spoilt);
            }
            bus::Event::Done { ticket, end, .. } => {
                let end = match end {
                    Ok(_) => ToldEnd::Done,
                    Err(fault) if fault.may_have_acted() => ToldEnd::Unknown,
                    Err(_) => ToldEnd::NotDone,
                };
                self.oracle.ended(ticket.0, end, self.now.0, spoilt);
            }
            bus::Event::Late { .. } => self.report.late += 1,
            _ => {}
        }
    }

    fn judge_seen(
        &mut self,
        module: usize,
        seen: Observation,
        (from, to): (u64, u64),
        spoilt: bool,
    ) {
        let mut told = |told| self.oracle.told(module, told, from, to, spoilt);
        match seen {
            Observation::Channels { outputs, inputs } => {
                if outputs.mask != 0 {
                    told(Told::Outputs {
                        mask: outputs.mask,
                        on: outputs.on,
                    });
                }
                if inputs.mask != 0 {
                    told(Told::Inputs {
                        mask: inputs.mask,
                        on: inputs.on,
                    });
                }
            }
            Observation::Analogs(values) => {
                for (channel, value) in values.into_iter().enumerate() {
                    told(Told::Analog { channel, value });
                }
            }
            _ => {}
        }
    }

    /// Changes all modules' inputs: each gets its own nonce.
    fn change_inputs(&mut self) {
        for (index, id) in self.ids.iter().enumerate() {
            let setup = &self.setups[index];
            let nonce = self.dice.next();
            if setup.inputs > 0 {
                let levels = nonce as u32 & setup.input_mask();
                self.line
                    .handle(self.now, sim::Input::Act(*id, sim::Act::Levels(levels)));
                self.oracle.inputs(self.now.0, index, levels);
            }
            for channel in 0..setup.family.profile().analogs {
                let value = (nonce >> (16 * channel) & 0x3FF) as i16;
                let act = sim::Act::Analog(channel, value);
                self.line.handle(self.now, sim::Input::Act(*id, act));
                self.oracle
                    .analog(self.now.0, index, channel.into(), value as u16);
            }
        }
    }

    fn command(&mut self) {
        let index = self.dice.between(0, self.setups.len() as u64 - 1) as usize;
        let setup = self.setups[index];
        if setup.outputs == 0 {
            return;
        }
        let (op, wish) = self.choose(&setup);
        let spoilt = self.spoilt();
        let module = bus::ModuleId(index);
        if let Ok(ticket) = self.bus.submit(self.now, module, op, bus::Terms::default()) {
            self.oracle
                .commanded(ticket.0, index, wish, self.now.0, spoilt);
        }
    }

    /// An op, and the outputs and states it wants.
    fn choose(&mut self, setup: &railbus_device::Setup) -> (Op, (u32, u32)) {
        let last = u64::from(setup.outputs) - 1;
        if setup.protocol == Protocol::R55 {
            match self.dice.between(0, 9) {
                0 | 1 => return (Op::Toggle(1 << 7), (0, 0)),
                2 => {
                    let channel = self.dice.between(0, 6) as u8;
                    let channel = Channel::new(channel).expect("there are seven");
                    let millis = r55::U24::new(self.dice.between(50, 2000) as u32);
                    let millis = millis.expect("it fits");
                    let jog = Op::Jog {
                        channel,
                        close: true,
                        millis,
                    };
                    return (jog, (channel.mask(), channel.mask()));
                }
                _ => {}
            }
        }
        // Output 8 of a board is only toggled.
        let last = if setup.family == Family::R55 {
            last.min(6)
        } else {
            last
        };
        let channel = Channel::new(self.dice.between(0, last) as u8).expect("at most 32");
        let bank = match self.dice.between(0, 4) {
            0 if setup.family != Family::R55 => {
                Bank::new(setup.output_mask(), self.dice.next() as u32)
            }
            _ => Bank::one(channel, self.dice.one_in(2)),
        };
        let pulsed = if setup.family == Family::Eda9060a {
            1
        } else {
            0
        };
        // A 0 written to a pulse output does nothing, so nothing is wanted of it.
        let wanted = bank.mask & !(pulsed & !bank.on);
        (Op::Write(bank), (wanted, bank.on))
    }

    /// No more commands; pending ones come to their end.
    fn finish(mut self, script: &Script) -> Report {
        self.report.trace = self
            .line
            .trace()
            .map(ToString::to_string)
            .unwrap_or_default();
        // A command is sent within five seconds, and read back within five more.
        let end = self.now + Micros::from_secs(12);
        (self.next_command, self.next_change) = (end, end);
        while self.now < end {
            self.step(script);
        }
        self.oracle.close();
        self.report.time = self.now.0;
        self.report.faults += self.line.injected().total();
        self.report.verdicts = self.oracle.verdicts;
        self.report.first_wrong = self.oracle.first_wrong.take();
        self.report
    }
}

/// How many characters were garbled so far, by any fault.
const fn spoilt(injected: &sim::Injected, collisions: u64) -> u64 {
    collisions
        + injected.flips
        + injected.lost_characters
        + injected.babble
        + injected.noise
        + injected.glitches
}
