//! The reading of every point, with its time and quality.

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
pub enum PointValue {
    /// An output is on, or an input is high or open.
    Bool(bool),
    /// An analog value in its unit, and the register it was read from.
    Analog(f64, u16),
    /// An internal variable, 0 to 16 777 215.
    Number(u32),
}

/// How far a value can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointQuality {
    /// Read, and not older than the module's maximum age.
    Good,
    /// Read, but older than that; or it was commanded since and not read back, or its module was
    /// silent since.
    Stale,
    /// There is no current value; if there is one at all, it is the last that was read.
    Bad(BadReason),
}

/// Why there is no current value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadReason {
    /// It was never read.
    NeverRead,
    /// Its module does not answer.
    Offline,
    /// The module at this address reports another model.
    OtherModel,
    /// The port of its line can't be opened, or was lost.
    LineAbsent,
    /// Another program has the port of its line.
    LineBusy,
    /// Its line is under exclusive access.
    Exclusive,
    /// Its line was closed.
    LineClosed,
}

/// The last reading of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointState {
    /// The last value read.
    pub value: PointValue,
    /// When the request that read it began: the value may be as old as that.
    pub read: Instant,
    /// The same on the wall clock. It is fixed with the reading: whenever it is printed, and even
    /// if that clock is set meanwhile, the same reading has the same time.
    pub time: SystemTime,
}

/// The value of a point changed.
#[derive(Clone, Debug, PartialEq)]
pub struct PointChange {
    /// Its module.
    pub module: String,
    /// Which point.
    pub point: Point,
    /// The previous value, if known.
    pub before: Option<PointValue>,
    /// The new value.
    pub value: PointValue,
}

/// What is known of a module.
#[derive(Clone, Debug, Default)]
struct ModuleState {
    presence: Presence,
    /// It answered before exclusive access to its line began; the number of misses since that
    /// ended.
    missing: Option<u8>,
    points: BTreeMap<Point, PointState>,
    /// Points that may be otherwise by now, though their values are not old: commanded since, and
    /// not read back, or not read since the module was silent.
    doubted: BTreeSet<Point>,
    pulse: Option<Pulses>,
    /// The model it last reported, or the name it gives itself.
    says: Option<String>,
}

impl ModuleState {
    /// Whatever it does while it is silent.
    fn doubt_all(&mut self) {
        self.doubted = self.points.keys().copied().collect();
    }
}

/// Which outputs of a module give pulses, and the width.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulses {
    /// Bit n = output n gives pulses.
    pub mask: u8,
    /// The width of all of them.
    pub width: PulseWidth,
}

impl Pulses {
    /// The pulse width of this output, if it gives any.
    #[must_use]
    pub fn of(self, point: Point) -> Option<PulseWidth> {
        let gives = point.kind == PointKind::Output
            && u32::from(self.mask)
                .checked_shr(u32::from(point.index))
                .is_some_and(|m| m & 1 == 1);
        gives.then_some(self.width)
    }
}

/// The readings of a site. Values come from [`Site::saw`] and presence from [`Site::heard`] only.
#[derive(Clone, Debug)]
pub struct Site {
    config: Arc<Config>,
    modules: BTreeMap<String, ModuleState>,
    /// Modules whose points may have another quality, or of which anything other than a value
    /// changed.
    touched: BTreeSet<String>,
}

impl Site {
    /// A site without any readings.
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

    /// Modules of which something other than values changed since the last call; all of a new
    /// configuration. There are never more than it has.
    pub(crate) fn take_touched(&mut self) -> BTreeSet<String> {
        std::mem::take(&mut self.touched)
    }

    /// Marks a module's points to be looked at.
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

    /// Whether a module answers.
    #[must_use]
    pub fn presence(&self, module: &str) -> Presence {
        self.modules
            .get(module)
            .map(|state| state.presence)
            .unwrap_or_default()
    }

    /// A module's presence changed.
    pub fn heard(&mut self, module: &str, presence: Presence) {
        if let Some(state) = self.modules.get_mut(module) {
            (state.presence, state.missing) = (presence, None);
            if presence == Presence::Silent {
                state.doubt_all();
            }
            if presence == Presence::OtherModel {
                // Values of the right model say nothing about another.
                state.points.clear();
                state.pulse = None;
            }
            self.touch(module);
        }
    }

    /// The model reported by a module at this address, if it is the wrong one.
    #[must_use]
    pub fn stranger(&self, module: &str) -> Option<&str> {
        let state = self.modules.get(module)?;
        let says = state.says.as_deref();
        says.filter(|_| state.presence == Presence::OtherModel)
    }

    /// A module did not answer. True if a module that answered before exclusive access to its line
    /// counts as silent from now on.
    pub fn missed(&mut self, module: &str) -> bool {
        let state = self.modules.get_mut(module);
        let Some((state, misses)) = state.and_then(|state| state.missing.map(|m| (state, m + 1)))
        else {
            return false;
        };
        state.missing = Some(misses);
        if misses >= MISSES_SILENT {
            (state.presence, state.missing) = (Presence::Silent, None);
            state.doubt_all();
            self.touch(module);
        }
        misses >= MISSES_SILENT
    }

    /// Applies an observation that was true at `read` or later, which was `time` on the wall clock;
    /// returns what changed.
    pub fn saw(
        &mut self,
        module: &str,
        seen: &Observation,
        read: Instant,
        time: SystemTime,
    ) -> Vec<PointChange> {
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
            if state.doubted.remove(&point) && !self.touched.contains(module) {
                self.touched.insert(module.to_owned());
            }
            let before = state.points.insert(point, PointState { value, read, time });
            let before = before.map(|before| before.value);
            if before != Some(value) {
                changes.push(PointChange {
                    module: module.to_owned(),
                    point,
                    before,
                    value,
                });
            }
        }
        changes
    }

    /// Which outputs of a module give pulses, if it was asked.
    #[must_use]
    pub fn pulses(&self, module: &str) -> Option<Pulses> {
        self.modules.get(module)?.pulse
    }

    /// Replaces the configuration. The state of the modules that `keep` selects is kept.
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

    /// Drops the whole state of these modules.
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

    /// These points of a module may be otherwise by now: they are stale until they are read.
    pub(crate) fn doubt_points(&mut self, module: &str, points: &[Point]) {
        if let Some(state) = self.modules.get_mut(module) {
            state.doubted.extend(points);
            self.touch(module);
        }
    }

    /// Drops the values of these modules' points; their presence stays.
    pub fn doubt(&mut self, of: impl Fn(&str) -> bool) {
        for (name, state) in self.modules.iter_mut().filter(|(name, _)| of(name)) {
            self.touched.insert(name.clone());
            state.points.clear();
            state.pulse = None;
        }
    }

    /// The last reading of a point, and its quality now.
    #[must_use]
    pub fn point(
        &self,
        module: &str,
        point: Point,
        now: Instant,
    ) -> (Option<PointState>, PointQuality) {
        let (known, quality) = self.point_by_age(module, point, now);
        let state = self.modules.get(module);
        let is_doubted = state.is_some_and(|state| state.doubted.contains(&point));
        match quality {
            PointQuality::Good if is_doubted => (known, PointQuality::Stale),
            quality => (known, quality),
        }
    }

    /// The same, whether or not it may be otherwise since a command or a silence.
    pub(crate) fn point_by_age(
        &self,
        module: &str,
        point: Point,
        now: Instant,
    ) -> (Option<PointState>, PointQuality) {
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
            (_, Presence::OtherModel, Some(_)) => PointQuality::Bad(BadReason::OtherModel),
            (None, Presence::Silent, Some(_)) => PointQuality::Bad(BadReason::Offline),
            (None, ..) | (_, _, None) => PointQuality::Bad(BadReason::NeverRead),
            (Some(_), Presence::Silent | Presence::Unheard, _) => {
                PointQuality::Bad(BadReason::Offline)
            }
            (Some(state), Presence::Online, Some(max_age)) if now.since(state.read) > max_age => {
                PointQuality::Stale
            }
            (Some(_), Presence::Online, Some(_)) => PointQuality::Good,
        };
        (known, quality)
    }
}

/// The model that a module reports, or the name it gives itself if no family has it.
fn model_of(seen: &Observation) -> Option<String> {
    let (family, said) = match seen {
        Observation::Name(name) => (Family::of_name(name.bytes()), name.as_str().to_owned()),
        Observation::Model(number) => (Family::of_number(*number), format!("{number:04X}")),
        _ => return None,
    };
    Some(family.map_or(said, |family| family.to_string()))
}

/// The points in a reply.
fn values(config: &ModuleConfig, seen: &Observation) -> Vec<(Point, PointValue)> {
    let bank = |kind, bank: Bank| {
        (0..config.setup.count(kind)).filter_map(move |index| {
            let state = bank.get(Channel::new(index)?)?;
            Some((Point { kind, index }, PointValue::Bool(state)))
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
                (point, PointValue::Analog(value, register))
            })
            .collect(),
        Observation::Variable(index, value) => {
            vec![(
                Point {
                    kind: PointKind::Variable,
                    index,
                },
                PointValue::Number(value.get()),
            )]
        }
        _ => Vec::new(),
    }
}
