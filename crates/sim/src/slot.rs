//! A module on the line: its engine, and what survives a loss of power.

use crate::Faults;
use crate::talk::NEVER;
use railbus_device::{Eeprom, Engine, Input, Options, Setup, SetupError};
use railbus_wire::{Address, Instant, Micros, Protocol};

/// The number of a module on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SlotId(pub(crate) usize);

impl SlotId {
    /// Its index among the modules of the line, from 0, in the order they were added.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0
    }
}

/// An action at a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Act {
    /// Sets the levels at the digital inputs: bit n = input n is high or open.
    Levels(u32),
    /// Sets an analog input, in hundredths.
    Analog(u8, i16),
    /// Grounds or opens the INIT* pin.
    Init(bool),
    /// Sets the DIP switch.
    Dip(u8),
    /// Switches the power.
    Power(Power),
    /// Writes the EEPROM directly, as the maker's software does, and restarts the module.
    Rewrite(Eeprom),
    /// Restarts the module with its factory settings.
    FactoryReset,
    /// Makes the module send garbage for a time.
    Babble(Micros),
    /// These outputs, and no others, ignore all commands: bit n = output n. They keep their state,
    /// but drop with the power.
    Stuck(u32),
}

/// A change of a module's power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// Off; outputs drop at once.
    Off,
    /// On; the module starts with the settings in its EEPROM.
    On,
    /// Off and on again.
    Cycle,
}

/// Counts for a module since it was added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModuleCounts {
    /// Replies, including those suppressed by a fault.
    pub replies: u64,
    /// Writes to its EEPROM over the line.
    pub saves: u64,
    /// Starts after the first.
    pub restarts: u64,
}

/// A module on the line.
#[derive(Clone, Debug)]
pub(crate) struct Slot {
    pub(crate) name: String,
    pub(crate) engine: Engine,
    pub(crate) powered: bool,
    /// When the engine last received anything: it is never passed an earlier moment.
    pub(crate) clock: Instant,
    /// When the current reply will have been sent.
    pub(crate) sent_at: Instant,
    /// When the power is next switched at random.
    pub(crate) power_at: Instant,
    /// The faults set for this module alone.
    pub(crate) own_faults: Faults,
    /// Combined with those of the line.
    pub(crate) faults: Faults,
    pub(crate) counts: ModuleCounts,
    /// Its LED is on.
    pub(crate) lit: bool,
    setup: Setup,
    options: Options,
    panel: Panel,
}

/// The surroundings of a module; they survive a loss of power.
#[derive(Clone, Copy, Debug)]
struct Panel {
    levels: u32,
    analogs: [i16; 2],
    init_grounded: bool,
    dip: u8,
    stuck: u32,
}

impl Slot {
    pub(crate) fn new(
        now: Instant,
        name: &str,
        setup: &Setup,
        eeprom: Eeprom,
        options: Options,
    ) -> Result<Slot, SetupError> {
        Ok(Slot {
            name: name.to_owned(),
            engine: Engine::new(setup, eeprom, options, now)?,
            powered: true,
            clock: now,
            sent_at: NEVER,
            power_at: NEVER,
            own_faults: Faults::NONE,
            faults: Faults::NONE,
            counts: ModuleCounts::default(),
            lit: false,
            setup: *setup,
            options,
            panel: Panel {
                levels: setup.input_mask(),
                analogs: [0; 2],
                init_grounded: setup.protocol == Protocol::Lc02,
                dip: 0,
                stuck: 0,
            },
        })
    }

    /// Passes an input to the engine.
    pub(crate) fn handle(&mut self, at: Instant, input: Input<'_>) {
        self.clock = self.clock.max(at);
        self.engine.handle(self.clock, input);
    }

    /// Restarts the engine with these settings. Without power it then stays in that state, with all
    /// outputs off.
    pub(crate) fn restart(&mut self, at: Instant, eeprom: Eeprom) {
        self.clock = self.clock.max(at);
        self.sent_at = NEVER;
        // The setup was checked when the module was added.
        if let Ok(engine) = Engine::new(&self.setup, eeprom, self.options, self.clock) {
            self.engine = engine;
        }
        let Panel {
            levels,
            analogs: [first, second],
            init_grounded,
            dip,
            stuck,
        } = self.panel;
        self.handle(at, Input::Levels(levels));
        self.handle(at, Input::Analog(0, first));
        self.handle(at, Input::Analog(1, second));
        self.handle(at, Input::Init(init_grounded));
        self.handle(at, Input::Dip(dip));
        self.handle(at, Input::Stuck(stuck));
    }

    /// The position of its DIP switch.
    pub(crate) const fn dip(&self) -> u8 {
        self.panel.dip
    }

    /// Whether its INIT* pin is grounded.
    pub(crate) const fn init_grounded(&self) -> bool {
        self.panel.init_grounded
    }

    /// The factory settings.
    pub(crate) fn factory(&self) -> Eeprom {
        Eeprom::of(&Setup::factory(self.setup.family))
    }

    /// Applies an action to the surroundings; other actions are ignored.
    pub(crate) fn touch(&mut self, act: Act) -> Option<Input<'static>> {
        let panel = &mut self.panel;
        match act {
            Act::Levels(levels) => {
                panel.levels = levels;
                Some(Input::Levels(levels))
            }
            Act::Analog(channel, value) => {
                *panel.analogs.get_mut(usize::from(channel))? = value;
                Some(Input::Analog(channel, value))
            }
            Act::Init(grounded) => {
                panel.init_grounded = grounded;
                Some(Input::Init(grounded))
            }
            Act::Dip(dip) => {
                panel.dip = dip;
                Some(Input::Dip(dip))
            }
            Act::Stuck(mask) => {
                panel.stuck = mask;
                Some(Input::Stuck(mask))
            }
            Act::Power(_) | Act::Rewrite(_) | Act::FactoryReset | Act::Babble(_) => None,
        }
    }

    /// Whether these characters begin a request to this module, or a broadcast.
    pub(crate) fn is_addressed(&self, bytes: &[u8]) -> bool {
        let Address(own) = self.engine.active().address;
        let digit = |at: usize| char::from(*bytes.get(at)?).to_digit(16);
        match self.engine.active().protocol {
            Protocol::Rtu => matches!(bytes.first(), Some(to) if [own, 0].contains(to)),
            Protocol::R55 => {
                let own = if self.panel.dip == 0 {
                    own
                } else {
                    self.panel.dip
                };
                matches!(bytes.get(1), Some(to) if [own, 245].contains(to))
            }
            // A pin of the EDA9050 selects one of the two.
            Protocol::Lc02 | Protocol::Ascii if bytes.first() == Some(&b'L') => {
                bytes.get(2) == Some(&own)
            }
            Protocol::Lc02 | Protocol::Ascii => {
                let address = digit(1).zip(digit(2)).map(|(high, low)| high << 4 | low);
                address == Some(own.into())
            }
        }
    }
}
