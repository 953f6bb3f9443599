//! A module as a device of the edge node: its metrics, and what of them was told.

use super::payload::{DataType, Metric, MetricValue, PropertyKind};
use railbus_device::{Point, PointKind};
use railbus_site::{PointQuality, PointStatus, PointValue, Rights};
use railbus_store::history::millis;
use std::collections::BTreeMap;
use std::time::SystemTime;

/// The property with the quality of a value. Without it the value is good.
const QUALITY: &str = "Quality";
/// Where the end of the last command stands.
const LAST: [&str; 4] = [
    "Last Command/Metric",
    "Last Command/End",
    "Last Command/Code",
    "Last Command/Time",
];

/// How good a value is, as Sparkplug has it (chapter 6.4.1, `Quality`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MetricQuality {
    /// There is no current value.
    Bad = 0,
    Good = 192,
    /// The value is the last one that was read.
    Stale = 500,
}

/// What is said of a point.
#[derive(Clone, Debug, PartialEq)]
struct Said {
    value: Option<MetricValue>,
    quality: MetricQuality,
}

/// A point, and what was told of it.
#[derive(Debug)]
struct PointMetric {
    status: PointStatus,
    /// Since when it is as it is, in milliseconds since 1970.
    since: u64,
    told: Option<Said>,
    /// The time that was told last: a host that goes by times takes what is older for the past.
    last: u64,
}

/// What a birth says of a metric, besides how it is now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Definition {
    label: String,
    datatype: DataType,
    unit: Option<String>,
    is_read_only: bool,
}

/// How the last command of a device ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LastCommand {
    /// The name of the metric, as it was asked for.
    pub(super) metric: String,
    pub(super) end: &'static str,
    /// Why it was not done; empty if it was.
    pub(super) code: String,
    /// When it ended, in milliseconds since 1970.
    pub(super) time: u64,
}

/// A module.
#[derive(Debug, Default)]
pub(super) struct Device {
    /// It answers.
    pub(super) is_online: bool,
    points: BTreeMap<Point, PointMetric>,
    /// What its birth said, if it is born on the present connection.
    pub(super) born: Option<Vec<Definition>>,
    pub(super) last: Option<LastCommand>,
}

/// A time in milliseconds since 1970.
pub(super) fn wall(time: SystemTime) -> u64 {
    u64::try_from(millis(time)).unwrap_or(0)
}

impl Said {
    fn of(status: &PointStatus) -> Said {
        let (quality, value) = match status.quality {
            PointQuality::Good => (MetricQuality::Good, status.value),
            PointQuality::Stale => (MetricQuality::Stale, status.value),
            PointQuality::Bad(_) => (MetricQuality::Bad, None),
        };
        Said {
            value: value.map(|value| metric_value(value, status)),
            quality,
        }
    }
}

fn metric_value(value: PointValue, status: &PointStatus) -> MetricValue {
    match value {
        PointValue::Bool(on) => MetricValue::Boolean(on),
        PointValue::Number(number) => MetricValue::Long(u64::from(number)),
        // No more digits than the module has.
        PointValue::Analog(value, _) => {
            let decimals = status.range.as_ref().map(|range| range.decimals);
            let rounded = decimals.map(|decimals| format!("{value:.*}", usize::from(decimals)));
            let rounded = rounded.and_then(|text| text.parse().ok());
            MetricValue::Double(rounded.unwrap_or(value))
        }
    }
}

/// The type of the metric of a point.
const fn datatype(kind: PointKind) -> DataType {
    match kind {
        PointKind::Output | PointKind::Input => DataType::Boolean,
        PointKind::Analog => DataType::Double,
        PointKind::Variable => DataType::Int64,
    }
}

/// A metric with its quality, which may be left out where it is good.
pub(super) fn with_quality(metric: Metric, quality: MetricQuality, is_told: bool) -> Metric {
    match quality == MetricQuality::Good && !is_told {
        true => metric,
        false => metric.with(QUALITY, DataType::Int32, PropertyKind::Int(quality as u32)),
    }
}

impl PointMetric {
    /// As it is now, told at this time.
    fn metric(&mut self, now: u64) -> Metric {
        let said = Said::of(&self.status);
        let time = match said.quality {
            MetricQuality::Good => self.status.time.map_or(self.since, wall),
            // When it was read is not when it became so.
            MetricQuality::Stale | MetricQuality::Bad => self.since,
        };
        self.last = time.max(self.last).min(now);
        let metric = Metric::new(&self.status.label, self.last, said.value.clone());
        let before = self.told.replace(said.clone());
        let was_good = before.is_none_or(|before| before.quality == MetricQuality::Good);
        with_quality(metric, said.quality, !was_good)
    }
}

impl Device {
    /// A point is like this since this time. Whether that is something else than what was told.
    pub(super) fn point(&mut self, status: &PointStatus, at: SystemTime) -> bool {
        let said = Said::of(status);
        match self.points.get_mut(&status.point) {
            Some(known) => {
                if Said::of(&known.status) != said {
                    known.since = wall(at);
                }
                known.status = status.clone();
                known.told.as_ref() != Some(&said)
            }
            None => {
                let point = PointMetric {
                    status: status.clone(),
                    since: wall(at),
                    told: None,
                    last: 0,
                };
                self.points.insert(status.point, point);
                true
            }
        }
    }

    /// Forgets the points that it no longer has.
    pub(super) fn keep(&mut self, has: impl Fn(Point) -> bool) {
        self.points.retain(|point, _| has(*point));
    }

    /// The point of this label.
    pub(super) fn find(&self, label: &str) -> Option<&PointStatus> {
        let mut all = self.points.values().map(|point| &point.status);
        all.find(|status| status.label == label)
    }

    /// What a birth says besides the values.
    pub(super) fn definitions(&self, rights: &Rights) -> Vec<Definition> {
        let definition = |point: &PointMetric| {
            let status = &point.status;
            let may = rights.may_switch(&status.module, &status.label).is_ok();
            let is_output = status.point.kind == PointKind::Output;
            // Nothing in a command could confirm it.
            let is_held_back = status.config.locked || status.config.safety.confirm.is_some();
            Definition {
                label: status.label.clone(),
                datatype: datatype(status.point.kind),
                unit: status.range.as_ref().map(|range| range.unit.clone()),
                is_read_only: !is_output || !may || is_held_back,
            }
        };
        self.points.values().map(definition).collect()
    }

    /// The metrics of its birth. It is born now.
    pub(super) fn birth(&mut self, rights: &Rights, now: u64) -> Vec<Metric> {
        let definitions = self.definitions(rights);
        let mut metrics = Vec::new();
        for (point, definition) in self.points.values_mut().zip(&definitions) {
            point.told = None;
            let mut metric = point.metric(now).of_type(definition.datatype);
            let is_read_only = PropertyKind::Boolean(definition.is_read_only);
            metric = metric.with("readOnly", DataType::Boolean, is_read_only);
            if let Some(unit) = &definition.unit {
                let unit = PropertyKind::Text(unit.clone());
                metric = metric.with("engUnit", DataType::Text, unit);
            }
            metrics.push(metric);
        }
        metrics.extend(
            self.last_command(now)
                .map(|(metric, of)| metric.of_type(of)),
        );
        self.born = Some(definitions);
        metrics
    }

    /// The metric of a point as it is now.
    pub(super) fn metric(&mut self, point: Point, now: u64) -> Option<Metric> {
        let point = self.points.get_mut(&point)?;
        Some(point.metric(now))
    }

    /// The answer to a command: the metric as it is now, and how the command ended.
    pub(super) fn answer(&mut self, last: LastCommand, now: u64) -> Vec<Metric> {
        let its = self.points.values_mut();
        let mut its = its.filter(|point| point.status.label == last.metric);
        let metric = its.next().map(|point| point.metric(now));
        self.last = Some(last);
        let last = self.last_command(now).map(|(metric, _)| metric);
        metric.into_iter().chain(last).collect()
    }

    fn last_command(&self, now: u64) -> [(Metric, DataType); 4] {
        let last = self.last.as_ref();
        let text = |text: &str| MetricValue::Text(text.to_owned());
        let values = [
            (last.map(|last| text(&last.metric)), DataType::Text),
            (last.map(|last| text(last.end)), DataType::Text),
            (last.map(|last| text(&last.code)), DataType::Text),
            (
                last.map(|last| MetricValue::Long(last.time)),
                DataType::DateTime,
            ),
        ];
        let time = last.map_or(now, |last| last.time.min(now));
        let mut names = LAST.into_iter();
        values.map(|(value, of)| {
            (
                Metric::new(names.next().unwrap_or_default(), time, value),
                of,
            )
        })
    }

    /// The clock was set back: the times that were told are none to go by.
    pub(super) fn set_back(&mut self) {
        self.points.values_mut().for_each(|point| point.last = 0);
    }

    /// A connection has ended, or it is said to be dead.
    pub(super) fn unborn(&mut self) {
        self.born = None;
    }

    /// The type of the metric of this label.
    pub(super) fn datatype(&self, label: &str) -> Option<DataType> {
        self.find(label).map(|status| datatype(status.point.kind))
    }
}
