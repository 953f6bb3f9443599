//! What is known of every point, since when, and how good it is.

use crate::Config;
use crate::config::ModuleConfig;
use railbus_bus::Presence;
use railbus_device::{Bank, Family, Observation, Point, PointKind};
use railbus_host::MISSES_SILENT;
use railbus_wire::{Channel, Instant, PulseWidth};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::SystemTime;

/// The value of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// An output is on, or an input is high or open.
    Bool(bool),
    /// An analog value in its unit, and the register it was read from.
    Analog(f64, u16),
    /// An internal variable, 0 to 16 777 215.
    Number(u32),
}

/// How far a value can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Read, and not older than the module's maximum age.
    Good,
    /// Read, but too long ago.
    Stale,
    /// There is no value now; where there is one, it is the last that was read.
    Bad(Reason),
}

/// Why there is no value now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// It was never read.
    NeverRead,
    /// Its module does not answer.
    Offline,
    /// What answers in the place of its module says that it is another model.
    OtherModel,
    /// The port of its line can't be opened, or was lost.
    LineAbsent,
    /// Another program has the port of its line.
    LineBusy,
    /// Its line is borrowed.
    Exclusive,
    /// Its line was closed.
    LineClosed,
}

/// What is known of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointState {
    /// The last value read.
    pub value: Value,
    /// When the request began that read it: the value may be so old.
    pub read: Instant,
    /// The same by the wall clock. It is fixed with the reading: whenever it is printed, and
    /// however that clock is set meanwhile, the same reading has the same time.
    pub time: SystemTime,
}

/// A point got another value.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Its module.
    pub module: String,
    /// Which point.
    pub point: Point,
    /// What it was before, where that is known.
    pub before: Option<Value>,
    /// What it is.
    pub value: Value,
}

/// What is known of a module.
#[derive(Clone, Debug, Default)]
struct ModuleState {
    presence: Presence,
    /// It was heard before its line was lent, and so often it did not answer since that came back.
    missing: Option<u8>,
    points: BTreeMap<Point, PointState>,
    pulse: Option<Pulses>,
    /// What it last said that it is: a model, or the name that it gives itself.
    says: Option<String>,
}

/// Which outputs of a module give pulses, and how long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulses {
    /// Bit n = output n gives pulses.
    pub mask: u8,
    /// The width of all of them.
    pub width: PulseWidth,
}

impl Pulses {
    /// How long a pulse of this output is, where it gives any.
    #[must_use]
    pub fn of(self, point: Point) -> Option<PulseWidth> {
        let gives = point.kind == PointKind::Output
            && u32::from(self.mask)
                .checked_shr(u32::from(point.index))
                .is_some_and(|m| m & 1 == 1);
        gives.then_some(self.width)
    }
}

/// The truth about a site. [`Site::saw`] and [`Site::heard`] are its only writers.
#[derive(Clone, Debug)]
pub struct Site {
    config: Arc<Config>,
    modules: BTreeMap<String, ModuleState>,
    /// Modules whose points may have another quality, or something else that is not a value.
    touched: BTreeSet<String>,
}

impl Site {
    /// A site of which nothing is known yet.
    #[must_use]
    pub fn new(config: impl Into<Arc<Config>>) -> Site {
        let config = config.into();
        let modules = config
            .modules
            .keys()
            .map(|name| (name.clone(), ModuleState::default()))
            .collect();
        let touched = config.modules.keys().cloned().collect();
        Site {
            config,
            modules,
            touched,
        }
    }

    /// Modules of which something other than values changed since this was last called; all of a
    /// new configuration. There are never more than it has.
    pub(crate) fn take_touched(&mut self) -> BTreeSet<String> {
        std::mem::take(&mut self.touched)
    }

    /// A module's points are to be looked at.
    pub(crate) fn touch(&mut self, module: &str) {
        if self.modules.contains_key(module) && !self.touched.contains(module) {
            self.touched.insert(module.to_owned());
        }
    }

    /// Its configuration, which is never changed, only replaced.
    #[must_use]
    pub const fn config(&self) -> &Arc<Config> {
        &self.config
    }

    /// Whether a module is heard.
    #[must_use]
    pub fn presence(&self, module: &str) -> Presence {
        self.modules
            .get(module)
            .map(|state| state.presence)
            .unwrap_or_default()
    }

    /// A module is heard, or no longer.
    pub fn heard(&mut self, module: &str, presence: Presence) {
        if let Some(state) = self.modules.get_mut(module) {
            (state.presence, state.missing) = (presence, None);
            if presence == Presence::OtherModel {
                // What the right one was read to be says nothing of it.
                state.points.clear();
                state.pulse = None;
            }
            self.touch(module);
        }
    }

    /// What answers in the place of a module, where that says that it is another model.
    #[must_use]
    pub fn stranger(&self, module: &str) -> Option<&str> {
        let state = self.modules.get(module)?;
        let says = state.says.as_deref();
        says.filter(|_| state.presence == Presence::OtherModel)
    }

    /// A module did not answer; true when that makes one that was heard before its line was lent
    /// count as silent from now on.
    pub fn missed(&mut self, module: &str) -> bool {
        let state = self.modules.get_mut(module);
        let Some((state, misses)) = state.and_then(|state| state.missing.map(|m| (state, m + 1)))
        else {
            return false;
        };
        state.missing = Some(misses);
        if misses >= MISSES_SILENT {
            (state.presence, state.missing) = (Presence::Silent, None);
            self.touch(module);
        }
        misses >= MISSES_SILENT
    }

    /// A module said something that was true at `read` or later, which was `time` by the clock on
    /// the wall; gives back what is new in it.
    pub fn saw(
        &mut self,
        module: &str,
        seen: &Observation,
        read: Instant,
        time: SystemTime,
    ) -> Vec<Change> {
        let Some(config) = self.config.modules.get(module) else {
            return Vec::new();
        };
        let Some(state) = self.modules.get_mut(module) else {
            return Vec::new();
        };
        if let Observation::Pulse { mask, width } = *seen {
            state.pulse = Some(Pulses { mask, width });
            self.touched.insert(module.to_owned());
        }
        if let Some(says) = model_of(seen) {
            state.says = Some(says);
        }
        let mut changes = Vec::new();
        for (point, value) in values(config, seen) {
            let before = state.points.insert(point, PointState { value, read, time });
            let before = before.map(|before| before.value);
            if before != Some(value) {
                changes.push(Change {
                    module: module.to_owned(),
                    point,
                    before,
                    value,
                });
            }
        }
        changes
    }

    /// Which outputs of a module give pulses, where it was asked.
    #[must_use]
    pub fn pulses(&self, module: &str) -> Option<Pulses> {
        self.modules.get(module)?.pulse
    }

    /// Takes another configuration. Of the modules that `keep` names, what is known stays known.
    pub fn reconfigure(&mut self, config: impl Into<Arc<Config>>, keep: impl Fn(&str) -> bool) {
        let mut known = std::mem::take(&mut self.modules);
        *self = Site::new(config);
        for (name, state) in &mut self.modules {
            if keep(name)
                && let Some(kept) = known.remove(name)
            {
                *state = kept;
            }
        }
    }

    /// What was known of these modules is not known any more.
    pub fn forget(&mut self, of: impl Fn(&str) -> bool) {
        for (name, state) in self.modules.iter_mut().filter(|(name, _)| of(name)) {
            self.touched.insert(name.clone());
            let was_heard = state.presence != Presence::Unheard || state.missing.is_some();
            *state = ModuleState {
                missing: was_heard.then_some(0),
                ..ModuleState::default()
            };
        }
    }

    /// The values of these modules' points are not known any more; whether they are heard still is.
    pub fn doubt(&mut self, of: impl Fn(&str) -> bool) {
        for (name, state) in self.modules.iter_mut().filter(|(name, _)| of(name)) {
            self.touched.insert(name.clone());
            state.points.clear();
            state.pulse = None;
        }
    }

    /// What is known of a point, and how good that is now.
    #[must_use]
    pub fn point(&self, module: &str, point: Point, now: Instant) -> (Option<PointState>, Quality) {
        let known = self
            .modules
            .get(module)
            .and_then(|state| state.points.get(&point))
            .copied();
        let max_age = self
            .config
            .modules
            .get(module)
            .map(|config| config.plan.max_age);
        let quality = match (known, self.presence(module), max_age) {
            (_, Presence::OtherModel, Some(_)) => Quality::Bad(Reason::OtherModel),
            (None, Presence::Silent, Some(_)) => Quality::Bad(Reason::Offline),
            (None, ..) | (_, _, None) => Quality::Bad(Reason::NeverRead),
            (Some(_), Presence::Silent | Presence::Unheard, _) => Quality::Bad(Reason::Offline),
            (Some(state), Presence::Online, Some(max_age)) if now.since(state.read) > max_age => {
                Quality::Stale
            }
            (Some(_), Presence::Online, Some(_)) => Quality::Good,
        };
        (known, quality)
    }
}

/// The model that a module says it is, or the name that it gives itself, where no family has that.
fn model_of(seen: &Observation) -> Option<String> {
    let (family, said) = match seen {
        Observation::Name(name) => (Family::of_name(name.bytes()), name.as_str().to_owned()),
        Observation::Model(number) => (Family::of_number(*number), format!("{number:04X}")),
        _ => return None,
    };
    Some(family.map_or(said, |family| family.to_string()))
}

/// The points that a reply tells of.
fn values(config: &ModuleConfig, seen: &Observation) -> Vec<(Point, Value)> {
    let bank = |kind, bank: Bank| {
        (0..config.setup.count(kind)).filter_map(move |index| {
            let state = bank.get(Channel::new(index)?)?;
            Some((Point { kind, index }, Value::Bool(state)))
        })
    };
    match *seen {
        Observation::Channels { outputs, inputs } => bank(PointKind::Output, outputs)
            .chain(bank(PointKind::Input, inputs))
            .collect(),
        Observation::Analogs(registers) => (0..)
            .zip(registers)
            .map(|(index, register)| {
                let point = Point {
                    kind: PointKind::Analog,
                    index,
                };
                let value = config.range_of(point).value(register);
                (point, Value::Analog(value, register))
            })
            .collect(),
        Observation::Variable(index, value) => {
            vec![(
                Point {
                    kind: PointKind::Variable,
                    index,
                },
                Value::Number(value.get()),
            )]
        }
        _ => Vec::new(),
    }
}
