//! The configuration of a site: its lines, their modules, and what the points are called.
//!
//! A configuration is read whole or refused whole: every problem is found in one go, each with
//! its line and column, and nothing is half taken.

pub mod add;
pub mod change;
mod control;
mod desired;
pub mod edit;
mod faults;
pub mod keeper;
mod keys;
mod lint;
mod owner;
mod past;
mod plant;
mod problem;
mod ranges;
mod read;
mod rules;
mod units;
mod webhook;

pub use control::{
    Confirm, Group, MEMBERS_MAX, Name, Policy, SAFETY_MAX, SCENE_MAX, Safety, Scene, Step,
};
pub use faults::{
    FAULTS, Fault, FaultError, FaultOrder, FaultsOf, Millionths, Noise, parse_faults,
};
pub use keys::{SCHEMA, TABLES};
pub use lint::{Unwise, Warning, lint, load_percent, wire_time};
pub use owner::Allowed;
pub use past::Past;
pub use plant::{Blink, Plant, Signal, SimLine, SimModule, Swing};
pub use problem::{Kind, Problem};
pub use read::{place_of, resembles};
pub use rules::{ACTIONS_MAX, Action, Clock, Limit, NOTICE_MAX, RULES_MAX, Rule, When};
pub use units::{Range, Standard};
pub use webhook::{URL_MAX, WEBHOOKS_MAX, Webhook};

use railbus_bus::{EchoMode, Plan};
use railbus_commission::settings::Wanted;
use railbus_device::{Point, Setup};
use railbus_wire::Settings;
use std::collections::{BTreeMap, BTreeSet};

/// A whole site.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// Its lines, by name.
    pub lines: BTreeMap<String, LineConfig>,
    /// Its modules, by name.
    pub modules: BTreeMap<String, ModuleConfig>,
    /// Outputs that are switched together, by the group's name.
    pub groups: BTreeMap<String, Group>,
    /// What is done step by step, by the scene's name.
    pub scenes: BTreeMap<String, Scene>,
    /// What is done by itself, by the rule's name.
    pub rules: BTreeMap<String, Rule>,
    /// Who is told of events over HTTP, by the webhook's name.
    pub webhooks: BTreeMap<String, Webhook>,
    /// What is said of their simulation.
    pub plant: Plant,
    /// How much of the past is kept.
    pub past: Past,
    /// Where it may lead, by its owner's word.
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
    /// Where it is plugged in: `/dev/…`, `pty:…`, `tcp:host:port`, `mbtcp:host:port`.
    pub port: String,
    /// The speed and character format of its modules, unless one says otherwise.
    pub serial: Settings,
    /// Whether the adapter echoes.
    pub echo: EchoMode,
    /// What people call it.
    pub name: Name,
}

/// A module.
#[derive(Clone, Debug, PartialEq)]
pub struct ModuleConfig {
    /// The line it hangs on.
    pub line: String,
    /// What it is.
    pub setup: Setup,
    /// How often it is read, and whether it is asked for its model.
    pub plan: Plan,
    /// What its analog inputs measure.
    pub range: Range,
    /// What is said of single points.
    pub points: BTreeMap<Point, PointConfig>,
    /// What it is to keep besides address, speed, parity and checksum.
    pub settings: Wanted,
    /// What people call it.
    pub name: Name,
    /// Where it stands: modules are shown together by it.
    pub area: Option<String>,
}

/// What is said of a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointConfig {
    /// Its name in English.
    pub name_en: Option<String>,
    /// Its name in Chinese.
    pub name_zh: Option<String>,
    /// It is of no interest: pages leave it out unless they are asked for it.
    pub hidden: bool,
    /// What an analog input measures, where that is not its module's range.
    pub range: Option<Range>,
    /// It must not be written.
    pub locked: bool,
    /// What makes switching it safe.
    pub safety: Safety,
}

/// How a line treats a module that nobody polls.
const fn unpolled(identify: bool) -> Plan {
    Plan {
        identify,
        ..Plan::NEVER
    }
}

impl ModuleConfig {
    /// How its line treats it. Where nobody polls, it is not read, but it is as true as ever
    /// whether it is to be asked for its model.
    #[must_use]
    pub const fn plan_where(&self, polls: bool) -> Plan {
        if polls {
            self.plan
        } else {
            unpolled(self.plan.identify)
        }
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
    pub fn parse(text: &str) -> Result<Config, Vec<Problem>> {
        read::read(text)
    }

    /// What is said of the safety of an output.
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

    /// The tables that another configuration has otherwise, as `module.pump`.
    #[must_use]
    pub fn differences(&self, other: &Config) -> Vec<String> {
        let mut found = Vec::new();
        differing("line", &self.lines, &other.lines, &mut found);
        differing("module", &self.modules, &other.modules, &mut found);
        differing("group", &self.groups, &other.groups, &mut found);
        differing("scene", &self.scenes, &other.scenes, &mut found);
        differing("webhook", &self.webhooks, &other.webhooks, &mut found);
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

    /// The modules of a line, in the order of their names: their numbers on the line count so.
    pub fn modules_of(&self, line: &str) -> impl Iterator<Item = (&String, &ModuleConfig)> {
        let of_line = move |(_, module): &(&String, &ModuleConfig)| module.line == line;
        self.modules.iter().filter(of_line)
    }
}

/// Adds the tables of a kind that are not in both, or not the same.
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
