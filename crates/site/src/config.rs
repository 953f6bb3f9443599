//! The configuration of a site: its lines, their modules, and what the points are called.
//!
//! A configuration is accepted whole or refused whole: all problems are found in one pass, each
//! with its line and column, and nothing is applied partly.

pub mod add;
pub mod change;
mod control;
mod desired;
pub mod edit;
mod faults;
pub mod keeper;
mod keys;
pub mod layers;
mod lint;
mod outlet;
mod owner;
pub mod part;
mod past;
mod plant;
mod problem;
mod ranges;
mod read;
mod rules;
mod units;
mod values;
mod webhook;

pub use control::{
    Confirm, Group, MEMBERS_MAX, Name, Policy, SAFETY_MAX, SCENE_MAX, Safety, Scene, Step,
};
pub use faults::{
    FAULTS, FaultError, FaultOrder, FaultsOf, InjectedFault, Millionths, Noise, parse_faults,
};
pub use keys::{SCHEMA, TABLES};
pub use lint::{Unwise, Warning, lint, load_percent, wire_time};
pub use outlet::{OUTLET_TYPE, OUTLETS_MAX, OutletTable};
pub use owner::Allowed;
pub use past::PastLimits;
pub use plant::{Blink, Plant, Signal, SimLine, SimModule, Swing};
pub use problem::{ConfigProblem, Invalid};
pub use read::{is_slug, place_of, resembles};
pub use rules::{ACTIONS_MAX, Action, Clock, Limit, NOTICE_MAX, RULES_MAX, Rule, When};
pub use units::{Range, Standard};
pub use webhook::{URL_MAX, WEBHOOKS_MAX, Webhook, is_url};

use railbus_bus::{EchoMode, Plan};
use railbus_commission::settings::Wanted;
use railbus_device::{Point, PointKind, Setup};
use railbus_wire::{Micros, SerialSettings};
use std::collections::{BTreeMap, BTreeSet};

/// A whole site.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// Its lines, by name.
    pub lines: BTreeMap<String, LineConfig>,
    /// Its modules, by name.
    pub modules: BTreeMap<String, ModuleConfig>,
    /// Groups of outputs switched together, by name.
    pub groups: BTreeMap<String, Group>,
    /// Scenes, by name.
    pub scenes: BTreeMap<String, Scene>,
    /// Rules, by name.
    pub rules: BTreeMap<String, Rule>,
    /// Webhooks, by name.
    pub webhooks: BTreeMap<String, Webhook>,
    /// Integrations that publish the site, by name.
    pub outlets: BTreeMap<String, OutletTable>,
    /// Its simulation.
    pub plant: Plant,
    /// How much history and audit log is kept.
    pub past: PastLimits,
    /// Ports and receivers that the owner allows beyond the defaults.
    pub allowed: Allowed,
}

/// A point of the site.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Its module.
    pub module: String,
    /// Which of its points.
    pub point: Point,
}

/// A line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineConfig {
    /// Its port: `/dev/…`, `pty:…`, `tcp:host:port`, `mbtcp:host:port`.
    pub port: String,
    /// The speed and character format of its modules, unless one says otherwise.
    pub serial: SerialSettings,
    /// Whether the adapter echoes.
    pub echo: EchoMode,
    /// Its display name.
    pub name: Name,
}

/// A module.
#[derive(Debug, PartialEq)]
#[cfg_attr(not(test), derive(Clone))]
pub struct ModuleConfig {
    /// The line it is connected to.
    pub line: String,
    /// Its model and serial settings.
    pub setup: Setup,
    /// How often it is polled, and whether it is asked for its model.
    pub plan: Plan,
    /// What its analog inputs measure.
    pub range: Range,
    /// Settings of single points.
    pub points: BTreeMap<Point, PointConfig>,
    /// The settings it should have besides address, speed, parity and checksum.
    pub settings: Wanted,
    /// Its display name.
    pub name: Name,
    /// Its location: pages group modules by it.
    pub area: Option<String>,
}

/// How many modules were copied whose area says that they are counted.
#[cfg(test)]
pub(crate) static CLONES: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);

#[cfg(test)]
impl Clone for ModuleConfig {
    fn clone(&self) -> ModuleConfig {
        if self.area.as_deref() == Some("counted") {
            CLONES.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        }
        ModuleConfig {
            line: self.line.clone(),
            setup: self.setup,
            plan: self.plan,
            range: self.range.clone(),
            points: self.points.clone(),
            settings: self.settings.clone(),
            name: self.name.clone(),
            area: self.area.clone(),
        }
    }
}

/// The settings of a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointConfig {
    /// Its display name in English.
    pub name_en: Option<String>,
    /// Its display name in Chinese.
    pub name_zh: Option<String>,
    /// Pages hide it unless asked to show it.
    pub hidden: bool,
    /// What an analog input measures, where that differs from its module's range.
    pub range: Option<Range>,
    /// It can't be written.
    pub locked: bool,
    /// Its safety settings.
    pub safety: Safety,
}

/// The plan of a module that is not polled.
const fn unpolled(identify: bool) -> Plan {
    Plan {
        identify,
        ..Plan::NEVER
    }
}

impl ModuleConfig {
    /// The plan its line uses. A module that is not polled is still asked for its model if
    /// configured so.
    #[must_use]
    pub const fn plan_where(&self, polls: bool) -> Plan {
        if polls {
            self.plan
        } else {
            unpolled(self.plan.identify)
        }
    }

    /// From which age on its values are stale; none where they never are.
    #[must_use]
    pub fn max_age(&self) -> Option<Micros> {
        self.plan.enabled.then_some(self.plan.max_age)
    }

    /// What a point measures, if it is an analog input.
    #[must_use]
    pub fn range_shown(&self, point: Point) -> Option<&Range> {
        (point.kind == PointKind::Analog).then(|| self.range_of(point))
    }

    /// What an analog input measures.
    #[must_use]
    pub fn range_of(&self, point: Point) -> &Range {
        let own = self.points.get(&point);
        own.and_then(|own| own.range.as_ref())
            .unwrap_or(&self.range)
    }
}

impl Config {
    /// Reads a configuration.
    ///
    /// # Errors
    /// Every problem found, in the order of the text.
    pub fn parse(text: &str) -> Result<Config, Vec<ConfigProblem>> {
        read::read(text)
    }

    /// The safety settings of an output.
    #[must_use]
    pub fn safety(&self, place: &Place) -> Option<&Safety> {
        let module = self.modules.get(&place.module)?;
        module.points.get(&place.point).map(|point| &point.safety)
    }

    /// The name of a point: `pump.do0`.
    #[must_use]
    pub fn path(&self, place: &Place) -> String {
        let label = self.modules.get(&place.module).map(|module| {
            let (letters, number) = module.setup.label(place.point);
            format!("{letters}{number}")
        });
        format!("{}.{}", place.module, label.unwrap_or_default())
    }

    /// The tables that differ from another configuration's, as `module.pump`.
    #[must_use]
    pub fn differences(&self, other: &Config) -> Vec<String> {
        let mut found = Vec::new();
        differing("line", &self.lines, &other.lines, &mut found);
        differing("module", &self.modules, &other.modules, &mut found);
        differing("group", &self.groups, &other.groups, &mut found);
        differing("scene", &self.scenes, &other.scenes, &mut found);
        differing("webhook", &self.webhooks, &other.webhooks, &mut found);
        differing("outlet", &self.outlets, &other.outlets, &mut found);
        let rest = [
            ("ports", self.allowed.ports != other.allowed.ports),
            ("webhooks", self.allowed.webhooks != other.allowed.webhooks),
            ("sim", self.plant != other.plant),
            ("history", self.past.history != other.past.history),
            (
                "audit",
                (self.past.audit_required, self.past.audit_bytes)
                    != (other.past.audit_required, other.past.audit_bytes),
            ),
        ];
        let rest = rest.into_iter().filter(|(_, differs)| *differs);
        found.extend(rest.map(|(name, _)| name.to_owned()));
        found
    }

    /// The modules of a line in the order of their names, which is that of their indices on the
    /// line.
    pub fn modules_of(&self, line: &str) -> impl Iterator<Item = (&String, &ModuleConfig)> {
        let of_line = move |(_, module): &(&String, &ModuleConfig)| module.line == line;
        self.modules.iter().filter(of_line)
    }
}

/// Adds the tables of a kind that are in one only, or differ.
fn differing<T: PartialEq>(
    kind: &str,
    one: &BTreeMap<String, T>,
    other: &BTreeMap<String, T>,
    found: &mut Vec<String>,
) {
    let names: BTreeSet<&String> = one.keys().chain(other.keys()).collect();
    let names = names.into_iter();
    let names = names.filter(|name| one.get(*name) != other.get(*name));
    found.extend(names.map(|name| format!("{kind}.{name}")));
}
