//! A module's place on the line: the engine, and what stays when its power goes.

use crate::Faults;
use crate::talk::NEVER;
use railbus_device::{Eeprom, Engine, Input, Options, Setup, SetupError};
use railbus_wire::{Address, Instant, Micros, Protocol};

/// Which module of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ModuleId(pub(crate) usize);

impl ModuleId {
    /// Its place among the modules of the line, from 0, in the order they were added.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0
    }
}

/// What a person does at a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Act {
    /// Brings the digital inputs to these levels: bit n = input n is high or open.
    Levels(u32),
    /// Lays so many hundredths at an analog input.
    Analog(u8, i16),
    /// Grounds the INIT* pin, or opens it.
    Init(bool),
    /// Sets the DIP switch.
    Dip(u8),
    /// Cuts the power or brings it back.
    Power(Power),
    /// Writes the EEPROM out of band, as the maker's software does, and restarts the module.
    Rewrite(Eeprom),
    /// Restarts the module with the settings it left the factory with.
    FactoryReset,
    /// Makes the module send garbage for a time.
    Babble(Micros),
    /// These outputs no longer do what the module is told, and no others: bit n = output n. They
    /// stay as they are, but drop with the power.
    Stuck(u32),
}

/// What is done to a module's power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// It goes away; outputs drop at once.
    Off,
    /// It comes back; the module starts with what its EEPROM kept.
    On,
    /// It goes away and comes back at once.
    Cycle,
}

/// What a module did since it was added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Replies, also those that a fault kept from the line.
    pub replies: u64,
    /// Writes to its EEPROM over the line.
    pub saves: u64,
    /// Times that it started with its power, but for the first.
    pub restarts: u64,
}

/// A module's place on the line.
#[derive(Clone, Debug)]
pub(crate) struct Slot {
    pub(crate) name: String,
    pub(crate) engine: Engine,
    pub(crate) powered: bool,
    /// When the engine last heard anything: it is never told of an earlier moment.
    pub(crate) clock: Instant,
    /// When the reply being sent will have left.
    pub(crate) sent_at: Instant,
    /// When chance cuts the power or brings it back.
    pub(crate) power_at: Instant,
    /// What was set for this module alone.
    pub(crate) own_faults: Faults,
    /// That together with the line's.
    pub(crate) faults: Faults,
    pub(crate) counts: Counts,
    /// Its LED shines.
    pub(crate) lit: bool,
    setup: Setup,
    options: Options,
    panel: Panel,
}

/// What lies at a module from outside; it stays when the power goes.
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
            counts: Counts::default(),
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

    /// Tells the engine what happened.
    pub(crate) fn handle(&mut self, at: Instant, input: Input<'_>) {
        self.clock = self.clock.max(at);
        self.engine.handle(self.clock, input);
    }

    /// Starts the engine anew with these settings. Without power it stays as it is then, with
    /// all outputs off.
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

    /// Where its DIP switch stands.
    pub(crate) const fn dip(&self) -> u8 {
        self.panel.dip
    }

    /// Whether its INIT* pin is grounded.
    pub(crate) const fn init_grounded(&self) -> bool {
        self.panel.init_grounded
    }

    /// The settings of the factory.
    pub(crate) fn factory(&self) -> Eeprom {
        Eeprom::of(&Setup::new(self.setup.family, Address(1)))
    }

    /// Changes what lies at the module; nothing but an [`Act`] of that kind does anything.
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

    /// Whether these characters begin a request to this module, or to all.
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
            // A pin of the EDA9050 chooses between the two.
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
