//! The lines that are run: what hangs on them, and what goes wrong. All from one seed.

use crate::dice::Dice;
use railbus_device::{Eeprom, Family, Layout, Options, Setup};
use railbus_sim::{Chance, Chunks, DurationRange, Faults, VirtualLineConfig};
use railbus_wire::{Address, Baud, Character, Micros, Protocol, PulseWidth, SerialSettings};

/// A line to run.
#[derive(Clone, Debug)]
pub(crate) struct Plant {
    /// What it is like.
    pub(crate) line: VirtualLineConfig,
    /// Whether replies are held back.
    pub(crate) stalls: Option<Stalls>,
    /// Its modules.
    pub(crate) modules: Vec<Fitted>,
}

/// The adapter or the network holds back all that modules say, and then hands it over at once, in
/// order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stalls {
    /// The mean time from the end of one to the beginning of the next.
    pub(crate) every: Micros,
    /// How long one lasts.
    pub(crate) time: DurationRange,
}

/// A module of a line.
#[derive(Clone, Debug)]
pub(crate) struct Fitted {
    /// What it is.
    pub(crate) setup: Setup,
    /// How it is set.
    pub(crate) eeprom: Eeprom,
    /// What it does where datasheets leave it open.
    pub(crate) options: Options,
    /// It never answers.
    pub(crate) dead: bool,
}

/// Something drawn by dice, and what it is called.
type Named<T> = (&'static str, fn(&mut Dice) -> T);

/// What goes wrong on a line, by name: the rows of the table.
pub(crate) const CAMPAIGNS: [Named<Faults>; 10] = [
    ("nothing", |_| Faults::NONE),
    ("lost requests and replies", |dice| Faults {
        lose_request: dice.percent(1, 6),
        lose_reply: dice.percent(1, 6),
        ..Faults::NONE
    }),
    ("late replies", |dice| Faults {
        late: dice.percent(2, 15),
        late_by: DurationRange::millis(20, 450),
        ..Faults::NONE
    }),
    // Of the adapter or the network: see [`Stalls`].
    ("replies held back", |_| Faults::NONE),
    ("duplicated replies", |dice| Faults {
        again: dice.percent(30, 90),
        again_after: DurationRange::millis(0, 60),
        ..Faults::NONE
    }),
    ("replies in pieces", |dice| Faults {
        pieces: dice.percent(10, 60),
        pause: DurationRange::millis(1, 25),
        ..Faults::NONE
    }),
    ("glitches and noise", |dice| Faults {
        glitch_before: dice.percent(2, 30),
        glitch_after: dice.percent(2, 30),
        noise_every: Some(Micros::from_millis(dice.between(300, 3000))),
        ..Faults::NONE
    }),
    ("bit flips and lost characters", |dice| Faults {
        flip: Chance::per_million(dice.between(500, 5000) as u32),
        lose_character: Chance::per_million(dice.between(100, 1000) as u32),
        ..Faults::NONE
    }),
    ("power cuts and babble", |dice| Faults {
        cut_every: Some(Micros::from_secs(dice.between(5, 60))),
        cut_for: DurationRange::millis(50, 3000),
        babble: Chance::per_million(dice.between(500, 5000) as u32),
        babble_for: DurationRange::millis(10, 400),
        ..Faults::NONE
    }),
    ("all of it", |dice| Faults {
        lose_request: dice.percent(0, 3),
        lose_reply: dice.percent(0, 3),
        late: dice.percent(1, 6),
        late_by: DurationRange::millis(20, 450),
        pieces: dice.percent(1, 10),
        pause: DurationRange::millis(1, 25),
        glitch_before: dice.percent(0, 5),
        glitch_after: dice.percent(0, 5),
        noise_every: Some(Micros::from_secs(dice.between(1, 20))),
        flip: Chance::per_million(dice.between(10, 300) as u32),
        lose_character: Chance::per_million(dice.between(10, 300) as u32),
        cut_every: Some(Micros::from_secs(dice.between(30, 300))),
        cut_for: DurationRange::millis(50, 3000),
        babble: Chance::per_million(dice.between(10, 500) as u32),
        babble_for: DurationRange::millis(10, 400),
        ..Faults::NONE
    }),
];

/// What hangs on a line, by name: the columns of the table.
pub(crate) const LINES: [Named<Vec<Fitted>>; 6] = [
    ("rtu", |dice| {
        let count = dice.between(2, 6);
        (0..count).map(|n| rtu(dice, 1 + n as u8)).collect()
    }),
    ("ascii", |dice| {
        // One of two is dead: the reply of neither carries its address.
        let mut modules: Vec<Fitted> = (1..=2)
            .map(|n| eda(dice, n, Protocol::Ascii, false))
            .collect();
        modules[dice.between(0, 1) as usize].dead = dice.one_in(2);
        modules
    }),
    ("ascii with checksum", |dice| {
        (1..=3)
            .map(|n| eda(dice, n, Protocol::Ascii, true))
            .collect()
    }),
    ("lc02", |dice| {
        (1..=3)
            .map(|n| eda(dice, n, Protocol::Lc02, false))
            .collect()
    }),
    ("r55", |dice| (1..=3).map(|n| r55(dice, n)).collect()),
    ("mixed", |dice| {
        let mut modules = vec![
            eda(dice, 1, Protocol::Ascii, false),
            eda(dice, 2, Protocol::Lc02, false),
            rtu(dice, 3),
            r55(dice, 4),
            fitted(Setup::new(Family::Emd2a2q, Address(5)), dice),
        ];
        let odd = dice.between(0, 4) as usize;
        modules[odd].dead = dice.one_in(4);
        if dice.one_in(3) {
            let serial = SerialSettings {
                baud: Baud::B19200,
                character: Character::N1,
            };
            for index in [0, 2, 4] {
                let module = &mut modules[index];
                module.setup.serial = serial;
                module.eeprom.serial = serial;
            }
        }
        modules
    }),
];

/// The line of a seed: these modules under these faults.
pub(crate) fn plant(line: usize, campaign: usize, seed: u64) -> Plant {
    let mut dice = Dice::new(seed ^ (line as u64) << 40 ^ (campaign as u64) << 50);
    let modules = LINES[line].1(&mut dice);
    let faults = CAMPAIGNS[campaign].1(&mut dice);
    let line = VirtualLineConfig {
        seed: dice.next(),
        faults,
        echo: seed.is_multiple_of(2),
        chunks: if seed.is_multiple_of(3) {
            Chunks::Random
        } else {
            Chunks::Whole
        },
        trace: 0,
    };
    let stalls = (CAMPAIGNS[campaign].0 == "replies held back").then(|| Stalls {
        every: Micros::from_millis(dice.between(300, 5000)),
        time: DurationRange::millis(20, 5000),
    });
    Plant {
        line,
        stalls,
        modules,
    }
}

fn fitted(setup: Setup, dice: &mut Dice) -> Fitted {
    let options = Options {
        turnaround: Micros(dice.between(200, 9000)),
        insist_on_gap: true,
        ..Options::default()
    };
    Fitted {
        setup,
        eeprom: Eeprom::of(&setup),
        options,
        dead: false,
    }
}

fn rtu(dice: &mut Dice, address: u8) -> Fitted {
    let families = [
        Family::Erc8,
        Family::Emd2a2q,
        Family::Eda9060a,
        Family::Eda9050,
    ];
    let family = families[dice.between(0, 3) as usize];
    let setup = Setup {
        protocol: Protocol::Rtu,
        ..Setup::new(family, Address(address))
    };
    pulsing(fitted(setup, dice))
}

fn eda(dice: &mut Dice, address: u8, protocol: Protocol, checksum: bool) -> Fitted {
    let family = if dice.one_in(2) {
        Family::Eda9060a
    } else {
        Family::Eda9050
    };
    let setup = Setup {
        protocol,
        checksum,
        ..Setup::new(family, Address(address))
    };
    pulsing(fitted(setup, dice))
}

/// Output 0 of an EDA9060A gives pulses of 0.1 s.
fn pulsing(mut module: Fitted) -> Fitted {
    if module.setup.family == Family::Eda9060a {
        module.eeprom.pulse_mask = 1;
        module.eeprom.pulse_width = PulseWidth::from_tenths(1).unwrap_or(PulseWidth::DEFAULT);
    }
    module
}

fn r55(dice: &mut Dice, address: u8) -> Fitted {
    let mut setup = Setup {
        outputs: 8,
        ..Setup::new(Family::R55, Address(address))
    };
    if dice.one_in(3) {
        setup = Setup {
            layout: Layout::Mixed,
            inputs: 8,
            ..setup
        };
    }
    fitted(setup, dice)
}

impl Dice {
    fn percent(&mut self, from: u64, to: u64) -> Chance {
        Chance::percent(self.between(from, to) as u32)
    }
}
