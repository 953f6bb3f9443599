//! The last reported quality of every point, which changes without a reading, too: values become
//! stale, modules go silent, lines are lost or lent. This is where that is noticed when it happens.

use super::State;
use super::promises::{Key, Why};
use crate::config::Place;
use crate::points::PointState;
use crate::service::Update;
use crate::{PointQuality, PointValue};
use railbus_device::{Point, PointKind};
use railbus_wire::{Instant, Micros, PulseWidth};
use std::collections::{BTreeMap, BTreeSet};

/// The last reported state of a point.
#[derive(Clone, Debug, PartialEq)]
struct Told {
    value: Option<PointValue>,
    quality: PointQuality,
    /// When a pulse, a lease and the longest time end, in the time of the site.
    ends: [Option<Micros>; 3],
    /// None while the module was not asked which outputs give pulses.
    pulse: Option<Option<PulseWidth>>,
}

/// What was last told of the points of a module, in their order.
#[derive(Debug, Default)]
struct ModuleTold {
    points: Vec<Told>,
    /// All of them are good: only another value is news.
    is_good: bool,
    /// When it is to be looked at again at the latest, as in [`Qualities::stale_at`].
    stale_at: Option<Micros>,
}

/// What was last told of all points, and when that may be true no longer.
#[derive(Debug, Default)]
pub(super) struct Qualities {
    told: BTreeMap<String, ModuleTold>,
    /// When the oldest good value of each module becomes too old, unless it is read anew
    /// meanwhile: that is looked at only then.
    stale_at: BTreeSet<(Micros, String)>,
    /// When what is promised of outputs is due.
    ends: Vec<(Key, Micros)>,
}

impl Qualities {
    /// When [`State::settle`] is to be called at the latest.
    pub(super) fn deadline(&self) -> Option<Micros> {
        self.stale_at.first().map(|(at, _)| *at)
    }

    /// Whether all points of a module were good when they were last told.
    pub(super) fn is_good(&self, module: &str) -> bool {
        self.told.get(module).is_some_and(|told| told.is_good)
    }

    fn ends_of(&self, module: &str, point: Point) -> [Option<Micros>; 3] {
        [Why::Pulse, Why::Lease, Why::MaxOn].map(|why| {
            let of_key =
                |(place, of): &Key| *of == why && place.point == point && place.module == module;
            let ends = self.ends.iter().filter(|(key, _)| of_key(key));
            ends.map(|(_, at)| *at).min()
        })
    }
}

impl State {
    /// Tells what has changed by the step that ends, other than values that were read anew.
    pub(super) fn settle(&mut self) {
        for line in self.lines.values_mut() {
            let fault = line.fault();
            if line.told != fault {
                line.told = fault;
                self.rules.wake(self.now.site);
                for module in &line.modules {
                    self.site.touch(module);
                }
            }
        }
        while let Some((at, _)) = self.qualities.stale_at.first()
            && *at <= self.now.site
            && let Some((_, module)) = self.qualities.stale_at.pop_first()
        {
            if let Some(told) = self.qualities.told.get_mut(&module) {
                told.stale_at = None;
            }
            self.site.touch(&module);
        }
        let ends = &mut self.qualities.ends;
        if !self
            .schedule
            .ends()
            .eq(ends.iter().map(|(key, at)| (key, *at)))
        {
            let now = self.schedule.ends().map(|(key, at)| (key.clone(), at));
            let before = std::mem::replace(ends, now.collect());
            for ((place, _), _) in before.iter().chain(ends.iter()) {
                self.site.touch(&place.module);
            }
        }
        for module in self.site.take_touched() {
            self.settle_module(&module);
        }
    }

    /// Compares the points of a module with what was told of them. Of one that is new nothing is
    /// told: it is new with a configuration.
    fn settle_module(&mut self, module: &str) {
        let mut told = self.qualities.told.remove(module).unwrap_or_default();
        if let Some(at) = told.stale_at.take() {
            self.qualities.stale_at.remove(&(at, module.to_owned()));
        }
        let Some(config) = self.site.config().modules.get(module) else {
            return;
        };
        let (setup, max_age) = (config.setup, config.plan.max_age);
        let fault = self.line_fault(&config.line);
        let now = self.line_time(module);
        let began = self.now.site - now.since(Instant(0));
        let pulses = self.site.pulses(module);
        let is_new = told.points.len() != setup.points().count();
        let mut stale_at = None;
        told.is_good = true;
        if is_new {
            told.points.clear();
        }
        for (index, point) in setup.points().enumerate() {
            let (known, quality) = self.site.point(module, point, now);
            let is = Told {
                value: known.map(|known| known.value),
                quality: fault.map_or(quality, PointQuality::Bad),
                ends: self.qualities.ends_of(module, point),
                pulse: pulses
                    .filter(|_| point.kind == PointKind::Output)
                    .map(|pulses| pulses.of(point)),
            };
            told.is_good &= is.quality == PointQuality::Good;
            if is.quality == PointQuality::Good
                && let Some(PointState { read, .. }) = known
            {
                // The first moment at which it is too old.
                let at = began + read.since(Instant(0)) + max_age + Micros(1);
                stale_at = [stale_at, Some(at)].into_iter().flatten().min();
            }
            match told.points.get_mut(index) {
                None => told.points.push(is),
                Some(before) if *before == is => {}
                Some(before) => {
                    let before = std::mem::replace(before, is.clone());
                    let place = Place::new(module, point);
                    self.stream_point(&place);
                    // Another value was told by itself.
                    let is_told = before.value != is.value && is.value.is_some();
                    if before.quality != is.quality && !is_told {
                        self.publish(Update::Quality(place));
                    }
                }
            }
        }
        // One that never comes need not be waited for.
        told.stale_at = stale_at.filter(|at| *at != Micros(u64::MAX));
        if let Some(at) = told.stale_at {
            self.qualities.stale_at.insert((at, module.to_owned()));
        }
        self.qualities.told.insert(module.to_owned(), told);
    }
}
