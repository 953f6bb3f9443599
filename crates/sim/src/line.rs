//! The line: processes events in the order of virtual time.

mod hearing;
mod power;
mod talking;

use crate::random::Random;
use crate::slot::Slot;
use crate::talk::{NEVER, State, Talk, Talker};
use crate::{Act, Faults, Injected, ModuleCounts, SlotId, Trace, TraceDirection};
use railbus_device::{Eeprom, Effect, Engine, Options, Setup, SetupError};
use railbus_wire::{Instant, Micros, SerialSettings};
use std::collections::VecDeque;

/// How much the host may have queued to send; more is dropped.
const BACKLOG_MAX: Micros = Micros::from_secs(60);

/// The configuration of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualLineConfig {
    /// The seed of everything random.
    pub seed: u64,
    /// The faults.
    pub faults: Faults,
    /// The host receives what it sends, as with adapters whose receiver stays on.
    pub echo: bool,
    /// In which pieces characters are delivered.
    pub chunks: Chunks,
    /// How many entries the trace keeps; 0 disables it, at no cost.
    pub trace: usize,
}

impl Default for VirtualLineConfig {
    /// No faults, no echo, whole frames, no trace.
    fn default() -> VirtualLineConfig {
        VirtualLineConfig {
            seed: 0,
            faults: Faults::NONE,
            echo: false,
            chunks: Chunks::Whole,
            trace: 0,
        }
    }
}

/// In which pieces characters are delivered to receivers. A character is never delivered before it
/// has ended, nor held back when anything may depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Chunks {
    /// As many as possible, up to a whole frame.
    #[default]
    Whole,
    /// One by one.
    Single,
    /// A random number each time.
    Random,
}

/// An input of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// The host sends now, or as soon as everything before has been sent. It receives with these
    /// settings from now on.
    Send {
        /// The characters.
        bytes: &'a [u8],
        /// Speed and character format.
        settings: SerialSettings,
    },
    /// An action at a module.
    Act(SlotId, Act),
    /// The deadline of [`Output::Wait`] has come.
    Timeout,
}

/// An output of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output<'a> {
    /// The host receives these characters.
    Heard {
        /// When the last of them ended: now, unless the driver is late.
        at: Instant,
        /// The characters; a corrupted one is received as a random byte.
        bytes: &'a [u8],
    },
    /// An effect of a module.
    Effect {
        /// When.
        at: Instant,
        /// Which module.
        module: SlotId,
        /// What.
        effect: Effect,
    },
    /// Nothing more to do until the deadline, or until something happens.
    Wait(Option<Instant>),
}

/// An output for the driver; received characters are in [`VirtualLine::heard`].
#[derive(Clone, Copy, Debug)]
enum Outgoing {
    Heard {
        at: Instant,
        from: usize,
        to: usize,
    },
    Effect {
        at: Instant,
        module: SlotId,
        effect: Effect,
    },
}

/// A half-duplex line in virtual time.
#[derive(Clone, Debug)]
pub struct VirtualLine {
    config: VirtualLineConfig,
    /// The driver's last moment; what was due by then happens in [`VirtualLine::poll`].
    now: Instant,
    slots: Vec<Slot>,
    /// When each module is woken, in one place so that scanning them is fast.
    wakes: Vec<Instant>,
    talks: Vec<Talk>,
    /// Finished talks, kept to reuse their memory.
    spare: Vec<Talk>,
    acts: VecDeque<(Instant, SlotId, Act)>,
    noise_at: Instant,
    host_settings: SerialSettings,
    host_free_at: Instant,
    outbox: VecDeque<Outgoing>,
    heard: Vec<u8>,
    scratch: Vec<u8>,
    random: Random,
    injected: Injected,
    collisions: u64,
    trace: Option<Trace>,
}

impl VirtualLine {
    /// A line without modules.
    #[must_use]
    pub fn new(config: VirtualLineConfig) -> VirtualLine {
        let mut line = VirtualLine {
            config,
            now: Instant(0),
            slots: Vec::new(),
            wakes: Vec::new(),
            talks: Vec::new(),
            spare: Vec::new(),
            acts: VecDeque::new(),
            noise_at: NEVER,
            host_settings: SerialSettings::FACTORY,
            host_free_at: Instant(0),
            outbox: VecDeque::new(),
            heard: Vec::new(),
            scratch: Vec::new(),
            random: Random::new(config.seed),
            injected: Injected::default(),
            collisions: 0,
            trace: (config.trace > 0).then(|| Trace::new(config.trace)),
        };
        line.set_faults(config.faults);
        line
    }

    /// Adds a module that is powered up now.
    ///
    /// # Errors
    /// If the setup is not possible for the family.
    pub fn add(
        &mut self,
        now: Instant,
        name: &str,
        setup: &Setup,
        eeprom: Eeprom,
        options: Options,
    ) -> Result<SlotId, SetupError> {
        let id = SlotId(self.slots.len());
        self.slots
            .push(Slot::new(now, name, setup, eeprom, options)?);
        self.wakes.push(now);
        self.set_module_faults(id, Faults::NONE);
        Ok(id)
    }

    /// Passes in what happened, and when. Time never runs backwards.
    pub fn handle(&mut self, now: Instant, input: Input<'_>) {
        self.now = self.now.max(now);
        match input {
            Input::Send { bytes, settings } => self.send(bytes, settings),
            Input::Act(module, act) => self.acts.push_back((self.now, module, act)),
            Input::Timeout => {}
        }
    }

    /// The next output; [`Output::Wait`] when there is nothing more.
    pub fn poll(&mut self) -> Output<'_> {
        while self.outbox.is_empty() {
            self.heard.clear();
            let due = self.next_due();
            if due > self.now {
                return Output::Wait((due != NEVER).then_some(due));
            }
            self.run(due);
        }
        match self.outbox.pop_front() {
            Some(Outgoing::Heard { at, from, to }) => Output::Heard {
                at,
                bytes: self.heard.get(from..to).unwrap_or_default(),
            },
            Some(Outgoing::Effect { at, module, effect }) => Output::Effect { at, module, effect },
            None => Output::Wait(None),
        }
    }

    /// Sets the faults of the line and all its modules.
    pub fn set_faults(&mut self, faults: Faults) {
        self.config.faults = faults;
        self.noise_at = match faults.noise_every {
            Some(mean) => self.now + self.random.around(mean),
            None => NEVER,
        };
        for index in 0..self.slots.len() {
            let own = self.slots[index].own_faults;
            self.set_module_faults(SlotId(index), own);
        }
    }

    /// Sets the faults of one module, in addition to those of the line.
    pub fn set_module_faults(&mut self, module: SlotId, faults: Faults) {
        let slot = &mut self.slots[module.0];
        slot.own_faults = faults;
        slot.faults = faults.on(self.config.faults);
        if slot.powered {
            self.plan_power_cut(module, self.now);
        }
    }

    /// Sets whether the host receives what it sends.
    pub const fn set_echo(&mut self, echo: bool) {
        self.config.echo = echo;
    }

    /// Puts garbage on the line for a time.
    pub fn babble(&mut self, time: Micros) {
        self.talk_garbage(Talker::Noise, self.host_settings, self.now, time);
    }

    /// Ends the garbage of a module or, if none is given, of the line.
    pub fn hush(&mut self, module: Option<SlotId>) {
        let who = module.map_or(Talker::Noise, Talker::Module);
        for talk in &mut self.talks {
            if talk.who == who && talk.babble_until.is_some() {
                talk.end_early(self.now);
            }
        }
    }

    /// All modules, in the order they were added.
    pub fn modules(&self) -> impl Iterator<Item = SlotId> + use<> {
        (0..self.slots.len()).map(SlotId)
    }

    /// The name of a module.
    #[must_use]
    pub fn name(&self, module: SlotId) -> &str {
        &self.slots[module.0].name
    }

    /// The module, valid when [`VirtualLine::poll`] has returned `Wait`. Without power it is in the
    /// state in which it would start.
    #[must_use]
    pub fn engine(&self, module: SlotId) -> &Engine {
        &self.slots[module.0].engine
    }

    /// Whether the module has power.
    #[must_use]
    pub fn is_powered(&self, module: SlotId) -> bool {
        self.slots[module.0].powered
    }

    /// Whether the module's LED is on.
    #[must_use]
    pub fn is_lit(&self, module: SlotId) -> bool {
        self.slots[module.0].powered && self.slots[module.0].lit
    }

    /// The position of the module's DIP switch; 0 means that the address comes from the EEPROM.
    #[must_use]
    pub fn dip(&self, module: SlotId) -> u8 {
        self.slots[module.0].dip()
    }

    /// Whether the module's INIT* pin is grounded.
    #[must_use]
    pub fn init_grounded(&self, module: SlotId) -> bool {
        self.slots[module.0].init_grounded()
    }

    /// Counts for the module so far.
    #[must_use]
    pub fn counts(&self, module: SlotId) -> ModuleCounts {
        self.slots[module.0].counts
    }

    /// The powered modules that take these characters for the beginning of a request to them, or of
    /// a broadcast.
    pub fn addressed<'a>(&'a self, bytes: &'a [u8]) -> impl Iterator<Item = SlotId> + 'a {
        let is_meant = |slot: &Slot| slot.powered && slot.is_addressed(bytes);
        let slots = self.slots.iter().enumerate();
        slots.filter_map(move |(index, slot)| is_meant(slot).then_some(SlotId(index)))
    }

    /// When the host will have sent everything in its queue.
    #[must_use]
    pub const fn host_free_at(&self) -> Instant {
        self.host_free_at
    }

    /// Counts of faults so far.
    #[must_use]
    pub const fn injected(&self) -> &Injected {
        &self.injected
    }

    /// How many characters were corrupted by collisions so far.
    #[must_use]
    pub const fn collisions(&self) -> u64 {
        self.collisions
    }

    /// The trace, if it is enabled.
    #[must_use]
    pub const fn trace(&self) -> Option<&Trace> {
        self.trace.as_ref()
    }

    /// The trace, to take entries out of it.
    pub const fn trace_mut(&mut self) -> Option<&mut Trace> {
        self.trace.as_mut()
    }

    fn next_due(&self) -> Instant {
        let talks = self.talks.iter().map(|talk| talk.due);
        let wakes = self.wakes.iter().copied();
        let act = self.acts.front().map_or(NEVER, |(at, ..)| *at);
        let first = act.min(self.noise_at);
        talks.chain(wakes).fold(first, Ord::min)
    }

    /// Processes everything due at one moment. Characters end before others begin, so that a talk
    /// does not collide with one that begins where it ends; and a module that is woken has received
    /// everything up to that moment.
    fn run(&mut self, at: Instant) {
        self.hand_out_chunks(at);
        self.start_talks(at);
        while let Some((_, module, act)) = self.acts.pop_front_if(|(due, ..)| *due <= at) {
            self.act(at, module, act);
        }
        if self.noise_at <= at {
            self.make_noise(at);
        }
        if self.wakes.iter().any(|wake| *wake <= at) {
            self.hand_out_ended(at);
            self.wake_modules(at);
        }
        self.forget_old_talks();
    }

    fn wake_modules(&mut self, at: Instant) {
        for index in 0..self.slots.len() {
            if self.wakes[index] <= at {
                self.wake(SlotId(index), at);
            }
        }
    }

    /// Drops talks that can't have collided with a running one.
    fn forget_old_talks(&mut self) {
        if self.talks.iter().all(|talk| talk.state != State::Over) {
            return;
        }
        let running = self
            .talks
            .iter()
            .filter(|talk| talk.state == State::Running);
        let oldest = running.map(|talk| talk.end_of(talk.next)).min();
        let mut index = 0;
        while let Some(talk) = self.talks.get(index) {
            let is_old = oldest.is_none_or(|oldest| talk.end() <= oldest);
            if talk.state == State::Over && is_old {
                self.spare.push(self.talks.swap_remove(index));
            } else {
                index += 1;
            }
        }
    }

    fn note(
        &mut self,
        at: Instant,
        who: Talker,
        direction: TraceDirection,
        event: &'static str,
        bytes: &[u8],
    ) {
        self.note_number(at, who, direction, event, None, bytes);
    }

    fn note_number(
        &mut self,
        at: Instant,
        who: Talker,
        direction: TraceDirection,
        event: &'static str,
        number: Option<u64>,
        bytes: &[u8],
    ) {
        if let Some(trace) = &mut self.trace {
            let who = match who {
                Talker::Host => "host",
                Talker::Noise => "line",
                Talker::Module(module) => &self.slots[module.0].name,
            };
            trace.add(at, who, direction, event, number, bytes);
        }
    }
}
