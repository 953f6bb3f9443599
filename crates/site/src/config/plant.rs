//! The simulation of lines and modules: the tables `[sim]`, `[line.NAME.sim]` and
//! `[module.NAME.sim]`. Only `railbus sim` uses them; the other readers just validate them.

use super::read::{Reader, Section, Value};
use super::{FaultOrder, FaultsOf, Invalid, parse_faults};
use railbus_device::{Applies, Options, Point, PointKind, Setup};
use railbus_wire::Micros;
use std::collections::BTreeMap;
use std::net::SocketAddr;

pub(super) const SIM_KEYS: [&str; 2] = ["seed", "speed"];
pub(super) const LINE_KEYS: [&str; 3] = ["pty", "tcp", "faults"];
pub(super) const MODULE_KEYS: [&str; 14] = [
    "factory",
    "power",
    "dip",
    "init",
    "init_sampled",
    "faults",
    "inputs",
    "turnaround",
    "applies",
    "refuse_aloud",
    "lower_case",
    "answer_bad_frames",
    "insist_on_gap",
    "beyond",
];
/// The keys of a varying input: a digital one has the first three, an analog one the last four.
pub(super) const SIGNAL_KEYS: [&str; 6] = ["low", "after", "every", "from", "to", "soft"];
const POWERS: [(&str, bool); 2] = [("on", true), ("off", false)];
const SAMPLED: [(&str, bool); 2] = [("continuously", false), ("at-power-up", true)];
const APPLIES: [(&str, Applies); 3] = [
    ("after-reply", Applies::AfterReply),
    ("after-restart", Applies::AfterRestart),
    ("address-after-reply", Applies::AddressAfterReply),
];
/// From the end of a request to a simulated module's reply, by default.
const TURNAROUND: Micros = Micros::from_millis(5);

/// The simulation as a whole, of its lines and of its modules.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plant {
    /// The seed of all random numbers.
    pub seed: Option<u64>,
    /// How many times faster than real time the plant runs.
    pub speed: Option<f64>,
    /// The lines with simulation settings, by name.
    pub lines: BTreeMap<String, SimLine>,
    /// All modules, by name.
    pub modules: BTreeMap<String, SimModule>,
}

/// A simulated line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SimLine {
    /// The path of the link to its PTY.
    pub pty: Option<String>,
    /// The address where it is served over TCP as raw bytes.
    pub tcp: Option<SocketAddr>,
    /// Its faults.
    pub faults: Vec<FaultOrder>,
}

/// A simulated module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimModule {
    /// It starts with factory settings instead of those configured.
    pub factory: bool,
    /// It has power at the start.
    pub powered: bool,
    /// The position of its DIP switch; with 0 the address is that of the EEPROM.
    pub dip: u8,
    /// Whether INIT* is grounded; `None` for what its protocol requires.
    pub init: Option<bool>,
    /// INIT* is read at power-up only.
    pub init_at_power_up: bool,
    /// Behaviour that the datasheet leaves open.
    pub options: Options,
    /// Its faults.
    pub faults: Vec<FaultOrder>,
    /// The signals at its inputs.
    pub inputs: BTreeMap<Point, Signal>,
}

impl Default for SimModule {
    fn default() -> SimModule {
        SimModule {
            factory: false,
            powered: true,
            dip: 0,
            init: None,
            init_at_power_up: false,
            options: Options {
                turnaround: TURNAROUND,
                ..Options::default()
            },
            faults: Vec::new(),
            inputs: BTreeMap::new(),
        }
    }
}

/// The signal at an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// A digital level: high or open, or low.
    Level(bool),
    /// A digital level that toggles at this interval, low at the start.
    Toggle(Micros),
    /// A constant at an analog input, in hundredths of the unit.
    Value(i16),
    /// A digital level that is high, with periodic low pulses.
    Blink(Blink),
    /// An analog value in hundredths that goes from the first to the second and back,
    /// periodically.
    Swing(Swing),
}

/// Periodic low pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blink {
    /// Their length.
    pub low: Micros,
    /// When the first begins, counted from the start.
    pub after: Micros,
    /// Their period.
    pub every: Micros,
}

/// A value that goes up and down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Swing {
    /// The value it starts from, in hundredths.
    pub from: i16,
    /// The value at which it turns back, in hundredths.
    pub to: i16,
    /// The period.
    pub every: Micros,
    /// Smooth turns instead of a triangle's corners.
    pub soft: bool,
}

impl<'t> Reader<'t> {
    /// `[sim]`.
    pub(super) fn sim(&mut self, value: &Value<'t>, plant: &mut Plant) -> Option<()> {
        let table = self.table(value, "sim")?;
        let section = Section::of("sim".to_owned(), value, table);
        self.check_keys(&section, &SIM_KEYS);
        plant.seed = self
            .optional(&section, "seed", |reader, value, path| {
                reader.integer_in(value, path, 0, i64::MAX)
            })?
            .map(i64::unsigned_abs);
        plant.speed = self.optional(&section, "speed", |reader, value, path| {
            let speed = reader.number(value, path)?;
            if !(0.01..=1_000.0).contains(&speed) {
                reader.problem(value.span(), path, Invalid::WrongType("0.01 … 1000"));
                return None;
            }
            Some(speed)
        })?;
        Some(())
    }

    /// `[line.NAME.sim]`.
    pub(super) fn sim_line(&mut self, line: &Section<'_, 't>) -> Option<SimLine> {
        let section = self.sim_section(line)?;
        self.check_keys(&section, &LINE_KEYS);
        let tcp = self.optional(&section, "tcp", |reader, value, path| {
            let address = reader.string(value, path)?.parse().ok();
            if address.is_none() {
                reader.problem(value.span(), path, Invalid::WrongType("\"127.0.0.1:4001\""));
            }
            address
        });
        Some(SimLine {
            pty: self.optional(&section, "pty", Self::string)?,
            tcp: tcp?,
            faults: self.faults(&section, FaultsOf::Line)?,
        })
    }

    /// `[module.NAME.sim]`.
    pub(super) fn sim_module(
        &mut self,
        module: &Section<'_, 't>,
        setup: &Setup,
    ) -> Option<SimModule> {
        let standard = SimModule::default();
        let Some(section) = self.sim_section(module) else {
            return Some(standard);
        };
        self.check_keys(&section, &MODULE_KEYS);
        let dip = self.optional(&section, "dip", |reader, value, path| {
            reader.integer_in(value, path, 0, 255)
        });
        let init = self.optional(&section, "init", Self::truth);
        let options = self.options(&section, standard.options);
        let faults = self.faults(&section, FaultsOf::Module(setup));
        let inputs = self.inputs(&section, setup);
        let powered = self.one_of(&section, "power", &POWERS)?;
        let init_at_power_up = self.one_of(&section, "init_sampled", &SAMPLED)?;
        Some(SimModule {
            factory: self.boolean(&section, "factory")?,
            powered: powered.unwrap_or(true),
            dip: dip?.unwrap_or(0) as u8,
            init: init?,
            init_at_power_up: init_at_power_up.unwrap_or(false),
            options: options?,
            faults: faults?,
            inputs: inputs?,
        })
    }

    fn sim_section<'r>(&mut self, of: &Section<'r, 't>) -> Option<Section<'r, 't>> {
        let value = of.table.get("sim")?;
        let path = format!("{}.sim", of.path);
        let table = self.table(value, &path)?;
        Some(Section::of(path, value, table))
    }

    fn options(&mut self, section: &Section<'_, 't>, standard: Options) -> Option<Options> {
        let turnaround = self.duration(section, "turnaround")?;
        let applies = self.one_of(section, "applies", &APPLIES)?;
        Some(Options {
            turnaround: turnaround.unwrap_or(standard.turnaround),
            applies: applies.unwrap_or_default(),
            refuse_aloud: self.boolean(section, "refuse_aloud")?,
            lower_case: self.boolean(section, "lower_case")?,
            answer_bad_frames: self.boolean(section, "answer_bad_frames")?,
            insist_on_gap: self.boolean(section, "insist_on_gap")?,
            extensions: self.boolean(section, "beyond")?,
        })
    }

    fn faults(&mut self, section: &Section<'_, 't>, of: FaultsOf<'_>) -> Option<Vec<FaultOrder>> {
        let faults = self.optional(section, "faults", |reader, value, path| {
            let text = reader.string(value, path)?;
            let faults = parse_faults(&text, of);
            faults
                .map_err(|why| reader.problem(value.span(), path, Invalid::BadFault(why)))
                .ok()
        })?;
        Some(faults.unwrap_or_default())
    }

    fn inputs(
        &mut self,
        section: &Section<'_, 't>,
        setup: &Setup,
    ) -> Option<BTreeMap<Point, Signal>> {
        let mut inputs = BTreeMap::new();
        let Some(value) = section.table.get("inputs") else {
            return Some(inputs);
        };
        let path = format!("{}.inputs", section.path);
        for (label, value) in self.table(value, &path)? {
            let path = format!("{path}.{}", label.get_ref());
            let point = setup.point(label.get_ref());
            match point.map(|point| (point, point.kind)) {
                Some((point, PointKind::Input)) => {
                    inputs.insert(point, self.digital(value, &path)?);
                }
                Some((point, PointKind::Analog)) => {
                    inputs.insert(point, self.analog(value, &path)?);
                }
                Some(_) => {
                    self.problem(label.span(), &path, Invalid::NotAnInput);
                    return None;
                }
                None => {
                    self.problem(label.span(), &path, Invalid::NoSuchPoint);
                    return None;
                }
            }
        }
        Some(inputs)
    }

    /// `1`, `true`, `{ every = "10s" }` or `{ low = "3s", after = "6s", every = "42s" }`.
    fn digital(&mut self, value: &Value<'t>, path: &str) -> Option<Signal> {
        if value.get_ref().as_integer().is_some() {
            let level = self.integer_in(value, path, 0, 1)?;
            return Some(Signal::Level(level == 1));
        }
        if value.get_ref().as_table().is_none() {
            return self.truth(value, path).map(Signal::Level);
        }
        let section = Section::of(path.to_owned(), value, self.table(value, path)?);
        self.check_keys(&section, &SIGNAL_KEYS[..3]);
        let every = self.every(&section)?;
        let low = self.duration(&section, "low")?;
        let after = self.duration(&section, "after")?;
        Some(match (low, after) {
            (None, None) => Signal::Toggle(every),
            (low, after) => Signal::Blink(Blink {
                low: low.unwrap_or(Micros(every.0 / 2)),
                after: after.unwrap_or(Micros::ZERO),
                every,
            }),
        })
    }

    /// `8.71` or `{ from = 1.2, to = 8.8, every = "4m" }`, which may be `soft = true`.
    fn analog(&mut self, value: &Value<'t>, path: &str) -> Option<Signal> {
        if value.get_ref().as_table().is_none() {
            return self.hundredths(value, path).map(Signal::Value);
        }
        let section = Section::of(path.to_owned(), value, self.table(value, path)?);
        self.check_keys(&section, &SIGNAL_KEYS[2..]);
        let from = self.required(&section, "from", Self::hundredths);
        let to = self.required(&section, "to", Self::hundredths);
        let every = self.every(&section);
        Some(Signal::Swing(Swing {
            from: from?,
            to: to?,
            every: every?,
            soft: self.boolean(&section, "soft")?,
        }))
    }

    fn every(&mut self, section: &Section<'_, 't>) -> Option<Micros> {
        self.required(section, "every", |_, _, _| Some(()))?;
        let every = self.duration(section, "every")??;
        if every < Micros::from_millis(100) {
            let path = format!("{}.every", section.path);
            self.problem(section.place_of("every"), &path, Invalid::BadDuration);
            return None;
        }
        Some(every)
    }

    fn hundredths(&mut self, value: &Value<'t>, path: &str) -> Option<i16> {
        let hundredths = (self.number(value, path)? * 100.0).round();
        if !(-32_768.0..=32_767.0).contains(&hundredths) {
            self.problem(value.span(), path, Invalid::OutOfRange(-327, 327));
            return None;
        }
        Some(hundredths as i16)
    }
}
