//! The known state of the site.

use super::Service;
use crate::config::{ModuleConfig, Name, PointConfig, Range};
use crate::core::State;
use crate::{Config, PointQuality, PointValue};
use railbus_device::{Point, PointKind, PulseTiming, Setup};
use railbus_host::{Evidence, LineState, Presence};
use railbus_wire::{Instant, Micros, SerialSettings};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// A line, as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct LineStatus {
    /// Its name.
    pub name: String,
    /// Where it is plugged in.
    pub port: String,
    /// Its speed and character format, unless a module says otherwise.
    pub serial: SerialSettings,
    /// How its port is.
    pub state: LineState,
    /// Something on it never stops sending.
    pub babble: bool,
    /// Its modules.
    pub modules: Vec<String>,
    /// What people call it.
    pub called: Name,
}

/// A module, as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ModuleStatus {
    /// Its name.
    pub name: String,
    /// The line it hangs on.
    pub line: String,
    /// What it is.
    pub setup: Setup,
    /// Whether it answers. No module does while the line is not open.
    pub presence: Presence,
    /// What answers in its place, where that says that it is another model.
    pub stranger: Option<String>,
    /// From the beginning of a request to the end of its reply, smoothed.
    pub rtt: Option<Micros>,
    /// Exchanges that failed within the last hour.
    pub errors: u32,
    /// Replies that came too late within the last hour.
    pub late: u32,
    /// What came instead of a good reply since the last one: of the last few exchanges.
    pub lost: Evidence,
    /// What people call it.
    pub called: Name,
    /// Where it stands.
    pub area: Option<String>,
}

/// A point, as far as it is known.
#[derive(Clone, Debug, PartialEq)]
pub struct PointStatus {
    /// Its module.
    pub module: String,
    /// Which one.
    pub point: Point,
    /// Its label at the terminal.
    pub label: String,
    /// What the configuration says of it.
    pub config: PointConfig,
    /// Its last value.
    pub value: Option<PointValue>,
    /// How far that can be trusted.
    pub quality: PointQuality,
    /// How old it is at most.
    pub age: Option<Micros>,
    /// When the request began that read it, by the clock on the wall as it was then.
    pub time: Option<SystemTime>,
    /// From which age on it is stale; none where it never is.
    pub max_age: Option<Micros>,
    /// The paths of the outputs that must not be on while this one is.
    pub interlock: Vec<String>,
    /// How long it is until something is done to it.
    pub left: Left,
    /// What an analog input measures.
    pub range: Option<Range>,
    /// The width of its pulses, where it is an output that gives some.
    pub pulse: Option<Micros>,
    /// Whether `pulse` is known: a module that stores which outputs give pulses is asked when it
    /// comes online.
    pub is_pulse_known: bool,
}

/// What of a point is not said by the configuration. The fields are those of [`PointStatus`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "they are those of `PointStatus`")]
pub struct PointNow {
    pub point: Point,
    pub value: Option<PointValue>,
    pub quality: PointQuality,
    pub age: Option<Micros>,
    pub time: Option<SystemTime>,
    pub left: Left,
    pub pulse: Option<Micros>,
    pub is_pulse_known: bool,
}

/// How long it is until something is done to an output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Left {
    /// A pulse that is timed here ends.
    pub pulse: Option<Duration>,
    /// Its holder must renew it.
    pub lease: Option<Duration>,
    /// It has been on for as long as it may.
    pub max_on: Option<Duration>,
}

impl Service {
    /// The configuration in force. It does not change; after a reload there is another one.
    #[must_use]
    pub fn config(&self) -> Arc<Config> {
        self.inner.read(|state| Arc::clone(state.site.config()))
    }

    /// All lines.
    #[must_use]
    pub fn lines(&self) -> Vec<LineStatus> {
        self.inner.read(|state| {
            let names = state.site.config().lines.keys();
            names.filter_map(|name| state.line(name)).collect()
        })
    }

    /// A line.
    #[must_use]
    pub fn line(&self, name: &str) -> Option<LineStatus> {
        self.inner.read(|state| state.line(name))
    }

    /// All modules.
    #[must_use]
    pub fn modules(&self) -> Vec<ModuleStatus> {
        self.inner.read(|state| {
            let names = state.site.config().modules.keys();
            let names: Vec<String> = names.cloned().collect();
            let status = names.iter().filter_map(|name| state.module(name));
            status.collect()
        })
    }

    /// A module.
    #[must_use]
    pub fn module(&self, name: &str) -> Option<ModuleStatus> {
        self.inner.read(|state| state.module(name))
    }

    /// The points of a module, outputs first; none where there is no such module.
    #[must_use]
    pub fn points(&self, module: &str) -> Vec<PointStatus> {
        let (config, points) = self.points_now(module);
        let described = config.modules.get(module).into_iter();
        described
            .flat_map(|described| {
                let points = points.iter();
                points.map(|now| PointStatus::of(&config, (module, described), *now))
            })
            .collect()
    }

    /// The same without what the configuration says of them, and the configuration.
    #[must_use]
    pub fn points_now(&self, module: &str) -> (Arc<Config>, Vec<PointNow>) {
        self.inner.read(|state| {
            let config = Arc::clone(state.site.config());
            let described = config.modules.get(module);
            let points = described.map(|described| state.points_now(module, described));
            let points = points.unwrap_or_default();
            (config, points)
        })
    }

    /// A point.
    #[must_use]
    pub fn point(&self, module: &str, point: Point) -> Option<PointStatus> {
        self.inner.read(|state| state.point_of(module, point))
    }
}

/// The modules of a line by name; those that left have none.
fn named(modules: &[String]) -> Vec<String> {
    let mut named: Vec<String> = modules.to_vec();
    named.retain(|module| !module.is_empty());
    named.sort();
    named
}

impl State {
    /// A point, where there is one.
    pub(crate) fn point_of(&self, module: &str, point: Point) -> Option<PointStatus> {
        let described = self.site.config().modules.get(module)?;
        if point.index >= described.setup.count(point.kind) {
            return None;
        }
        let now = self.point_now((module, described), point, self.line_time(module));
        let config = self.site.config();
        Some(PointStatus::of(config, (module, described), now))
    }

    pub(crate) fn line(&self, name: &str) -> Option<LineStatus> {
        let config = self.site.config().lines.get(name)?;
        let now = self.lines.get(name)?;
        Some(LineStatus {
            name: name.to_owned(),
            port: config.port.clone(),
            serial: config.serial,
            state: now.state.clone(),
            babble: now.babble,
            modules: named(&now.modules),
            called: config.name.clone(),
        })
    }

    pub(crate) fn module(&mut self, name: &str) -> Option<ModuleStatus> {
        let presence = match self.site.presence(name) {
            Presence::Online | Presence::OtherModel if !self.is_up(name) => Presence::Silent,
            presence => presence,
        };
        let stranger = self.site.stranger(name);
        let stranger = stranger.filter(|_| presence == Presence::OtherModel);
        let stranger = stranger.map(str::to_owned);
        let config = self.site.config().modules.get(name)?;
        let (line, setup) = (config.line.clone(), config.setup);
        let (called, area) = (config.name.clone(), config.area.clone());
        let now = self.now.site;
        let health = self.health.entry(name.to_owned()).or_default();
        Some(ModuleStatus {
            name: name.to_owned(),
            line,
            setup,
            presence,
            stranger,
            rtt: health.rtt(),
            errors: health.errors.total(now),
            late: health.late.total(now),
            lost: health.lost(),
            called,
            area,
        })
    }

    fn points_now(&self, module: &str, described: &ModuleConfig) -> Vec<PointNow> {
        let now = self.line_time(module);
        let points = described.setup.points();
        points
            .map(|point| self.point_now((module, described), point, now))
            .collect()
    }

    fn point_now(
        &self,
        (module, described): (&str, &ModuleConfig),
        point: Point,
        now: Instant,
    ) -> PointNow {
        let (known, quality) = self.site.point(module, point, now);
        let fault = self.line_fault(&described.line);
        let pulses = self.site.pulses(module);
        let pulse = pulses.and_then(|pulses| pulses.of(point));
        let is_stored = described.setup.family.datasheet().pulses == PulseTiming::Stored;
        PointNow {
            point,
            value: known.map(|known| known.value),
            quality: fault.map_or(quality, PointQuality::Bad),
            age: known.map(|known| now.since(known.read)),
            time: known.map(|known| known.time),
            left: self.left(module, point),
            pulse: pulse.map(|width| Micros::from_millis(u64::from(width.tenths()) * 100)),
            is_pulse_known: pulses.is_some() || !is_stored || point.kind != PointKind::Output,
        }
    }
}

impl PointStatus {
    /// What is known of a point of this module, and what the configuration says of it.
    #[must_use]
    pub fn of(
        config: &Config,
        (module, described): (&str, &ModuleConfig),
        now: PointNow,
    ) -> PointStatus {
        let PointNow {
            point,
            value,
            quality,
            age,
            time,
            left,
            pulse,
            is_pulse_known,
        } = now;
        let (letters, number) = described.setup.label(point);
        let own = described.points.get(&point).cloned().unwrap_or_default();
        let interlock = own.safety.interlock.iter();
        PointStatus {
            interlock: interlock.map(|other| config.path(other)).collect(),
            module: module.to_owned(),
            point,
            label: format!("{letters}{number}"),
            config: own,
            value,
            quality,
            age,
            time,
            max_age: described.max_age(),
            range: described.range_shown(point).cloned(),
            left,
            pulse,
            is_pulse_known,
        }
    }
}
