//! Rules: actions that are executed automatically when a condition has held for some time.

use super::control::is_named;
use super::problem::Invalid;
use super::read::{Reader, Section, Value};
use super::{Config, Name, Place, SAFETY_MAX};
use crate::PULSE_MAX;
use railbus_device::{PointKind, PulseTiming};
use railbus_wire::Micros;
use std::ops::Range as Span;
use toml::de::DeTable;

/// The maximum number of rules of a site.
pub const RULES_MAX: usize = 64;
/// The maximum number of actions of a rule.
pub const ACTIONS_MAX: usize = 8;
/// The maximum length of a notification, in characters.
pub const NOTICE_MAX: usize = 200;

pub(super) const RULE_KEYS: [&str; 5] = ["name", "when", "for", "then", "armed"];
pub(super) const WHEN_KEYS: [&str; 10] = [
    "point",
    "is",
    "above",
    "below",
    "hysteresis",
    "unit",
    "time",
    "days",
    "module_offline",
    "line_offline",
];
pub(super) const ACTION_KEYS: [&str; 5] = ["set", "to", "pulse", "width", "notify"];

const DAYS: [(&str, u8); 7] = [
    ("mon", 0),
    ("tue", 1),
    ("wed", 2),
    ("thu", 3),
    ("fri", 4),
    ("sat", 5),
    ("sun", 6),
];

/// A rule.
#[derive(Clone, Debug, PartialEq)]
pub struct Rule {
    /// Its display name.
    pub name: Name,
    /// Its condition.
    pub when: When,
    /// How long the condition must hold without interruption.
    pub hold: Micros,
    /// Its actions, executed in order.
    pub then: Vec<Action>,
    /// It is in force; otherwise it is configured only.
    pub armed: bool,
}

impl Rule {
    /// Whether two rules have the same condition, hold time and actions, whatever their names and
    /// whether or not they are armed.
    #[must_use]
    pub fn acts_as(&self, other: &Rule) -> bool {
        (&self.when, self.hold, &self.then) == (&other.when, other.hold, &other.then)
    }
}

/// The condition of a rule.
#[derive(Clone, Debug, PartialEq)]
pub enum When {
    /// An output is on or off, an input high or low.
    Switch(Place, bool),
    /// An analog input or a variable is on one side of a limit.
    Analog(Place, Limit),
    /// At a time of day.
    Clock(Clock),
    /// A module does not answer.
    ModuleOffline(String),
    /// A line has no port.
    LineOffline(String),
}

impl When {
    /// Whether it depends on the clock only.
    #[must_use]
    pub const fn is_clock(&self) -> bool {
        matches!(self, When::Clock(_))
    }

    /// The point it is about.
    #[must_use]
    pub const fn place(&self) -> Option<&Place> {
        match self {
            When::Switch(place, _) | When::Analog(place, _) => Some(place),
            When::Clock(_) | When::ModuleOffline(_) | When::LineOffline(_) => None,
        }
    }
}

/// A limit of a value, in the unit of its point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// The condition holds above the limit; otherwise below.
    pub above: bool,
    /// The limit itself, at which the condition does not hold.
    pub value: f64,
    /// How far a value must come back past the limit before the condition ends.
    pub hysteresis: f64,
}

/// A time of day, in the time zone of the machine that the site runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// 0 to 23.
    pub hour: u8,
    /// 0 to 59.
    pub minute: u8,
    /// The days: bit 0 is Monday, bit 6 Sunday. At least one.
    pub days: u8,
}

impl Clock {
    /// Every day of the week.
    pub const DAILY: u8 = 0x7F;

    /// Its days as they are written; empty for every day.
    #[must_use]
    pub fn days(self) -> Vec<&'static str> {
        let is_on = |(_, bit): &&(&str, u8)| self.days != Clock::DAILY && self.days >> bit & 1 == 1;
        DAYS.iter().filter(is_on).map(|(name, _)| *name).collect()
    }
}

/// An action of a rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Switches an output.
    Set(Place, bool),
    /// Pulses an output, with this width or the module's own.
    Pulse(Place, Option<Micros>),
    /// Reports a text as an event.
    Notify(String),
}

/// What is known while the rules are read.
type Known<'k, 't> = (&'k DeTable<'t>, &'k Config);

impl<'t> Reader<'t> {
    /// The tables `[rule.name]`.
    pub(super) fn rules(&mut self, value: &Value<'t>, root: &DeTable<'t>, config: &mut Config) {
        let count = value.get_ref().as_table().map_or(0, |rules| rules.len());
        if count > RULES_MAX {
            self.problem(value.span(), "rule", Invalid::TooMany(RULES_MAX));
            return;
        }
        let mut read = Vec::with_capacity(count);
        self.named(value, "rule", |reader, name, section| {
            if let Some(rule) = reader.rule((root, config), &section) {
                read.push((name, rule));
            }
        });
        config.rules.extend(read);
    }

    fn rule(&mut self, known: Known<'_, 't>, section: &Section<'_, 't>) -> Option<Rule> {
        self.check_keys(section, &RULE_KEYS);
        let name = self.name(section);
        let when = self.required(section, "when", |reader, value, path| {
            reader.when(known, value, path)
        });
        let hold = self.duration(section, "for");
        let then = self.required(section, "then", |reader, value, path| {
            reader.actions(known, value, path)
        });
        let armed = self.boolean(section, "armed")?;
        let (when, hold) = (when?, hold?.unwrap_or_default());
        let at = section.place_of("for");
        let path = format!("{}.for", section.path);
        if matches!(when, When::Clock(_)) && hold != Micros(0) {
            self.problem(at, &path, Invalid::BadCondition);
            return None;
        }
        if hold > SAFETY_MAX {
            self.problem(at, &path, Invalid::TooLong(SAFETY_MAX));
            return None;
        }
        Some(Rule {
            name: name?,
            when,
            hold,
            then: then?,
            armed,
        })
    }

    fn when(&mut self, known: Known<'_, 't>, value: &Value<'t>, path: &str) -> Option<When> {
        let table = self.table(value, path)?;
        let section = Section::of(path.to_owned(), value, table);
        self.only_keys(&section, &WHEN_KEYS)?;
        let has = |key: &str| table.contains_key(key);
        let mains = ["point", "time", "module_offline", "line_offline"];
        let mut named = mains.into_iter().filter(|key| has(key));
        let of_main: &[&str] = match (named.next(), named.next()) {
            (Some("point"), None) => &["is", "above", "below", "hysteresis", "unit"],
            (Some("time"), None) => &["days"],
            (Some(_), None) => &[],
            _ => {
                self.problem(value.span(), path, Invalid::BadCondition);
                return None;
            }
        };
        let is_odd = |key: &&str| !mains.contains(key) && !of_main.contains(key) && has(key);
        if WHEN_KEYS.iter().any(is_odd) {
            self.problem(value.span(), path, Invalid::BadCondition);
            return None;
        }
        if has("point") {
            return self.point_is(known, value, &section);
        }
        if has("time") {
            return self.clock(&section).map(When::Clock);
        }
        let module = self.optional(&section, "module_offline", Self::string)?;
        let line = self.optional(&section, "line_offline", Self::string)?;
        match (module, line) {
            (Some(module), _) if is_named(known.0, "module", &module) => {
                Some(When::ModuleOffline(module))
            }
            (None, Some(line)) if is_named(known.0, "line", &line) => Some(When::LineOffline(line)),
            (Some(_), _) => {
                let at = section.place_of("module_offline");
                self.problem(at, path, Invalid::NoSuchModule);
                None
            }
            (None, _) => {
                let at = section.place_of("line_offline");
                self.problem(at, path, Invalid::NoSuchLine);
                None
            }
        }
    }

    /// Where a key is misspelt, the missing one is not reported as well.
    fn only_keys(&mut self, section: &Section<'_, 't>, known: &[&'static str]) -> Option<()> {
        self.check_keys(section, known);
        let mut keys = section.table.keys();
        keys.all(|key| known.contains(&key.get_ref().as_ref()))
            .then_some(())
    }

    fn point_is(
        &mut self,
        (root, config): Known<'_, 't>,
        value: &Value<'t>,
        section: &Section<'_, 't>,
    ) -> Option<When> {
        let name = self.required(section, "point", Self::string)?;
        let at = section.place_of("point");
        let place = self.place(root, config, (&at, &section.path), &name)?;
        let is = self.optional(section, "is", Self::truth)?;
        let above = self.optional(section, "above", Self::finite)?;
        let below = self.optional(section, "below", Self::finite)?;
        let hysteresis = self.optional(section, "hysteresis", Self::finite)?;
        let is_switch = matches!(place.point.kind, PointKind::Output | PointKind::Input);
        match (is, above, below) {
            (Some(is), None, None) if is_switch && hysteresis.is_none() => {
                self.unit(config, section, &place)?;
                Some(When::Switch(place, is))
            }
            (None, Some(value), None) | (None, None, Some(value)) if !is_switch => {
                self.unit(config, section, &place)?;
                let limit = Limit {
                    above: above.is_some(),
                    value,
                    hysteresis: hysteresis.unwrap_or_default(),
                };
                Some(When::Analog(place, limit))
            }
            _ => {
                self.problem(value.span(), &section.path, Invalid::BadCondition);
                None
            }
        }
    }

    /// A unit is optional; if given, it must be the point's.
    fn unit(&mut self, config: &Config, section: &Section<'_, 't>, place: &Place) -> Option<()> {
        let Some(said) = self.optional(section, "unit", Self::string)? else {
            return Some(());
        };
        let module = config.modules.get(&place.module)?;
        let unit = match place.point.kind {
            PointKind::Analog => module.range_of(place.point).unit.as_str(),
            _ => "",
        };
        if said != unit {
            let kind = Invalid::OtherUnit(unit.to_owned());
            self.problem(section.place_of("unit"), &section.path, kind);
            return None;
        }
        Some(())
    }

    /// A number that values can be compared with; a hysteresis is not negative.
    fn finite(&mut self, value: &Value<'t>, path: &str) -> Option<f64> {
        let number = self.number(value, path)?;
        if !number.is_finite() || path.ends_with(".hysteresis") && number < 0.0 {
            self.problem(value.span(), path, Invalid::BadCondition);
            return None;
        }
        Some(number)
    }

    fn clock(&mut self, section: &Section<'_, 't>) -> Option<Clock> {
        let (hour, minute) = self.required(section, "time", |reader, value, path| {
            let time = value.get_ref().as_str().and_then(time_of_day);
            if time.is_none() {
                reader.problem(value.span(), path, Invalid::BadTime);
            }
            time
        })?;
        let days = self.optional(section, "days", Self::days)?;
        Some(Clock {
            hour,
            minute,
            days: days.unwrap_or(Clock::DAILY),
        })
    }

    fn days(&mut self, value: &Value<'t>, path: &str) -> Option<u8> {
        let names = DAYS.map(|(name, _)| name).to_vec();
        let Some(list) = value.get_ref().as_array().filter(|list| !list.is_empty()) else {
            self.problem(value.span(), path, Invalid::NotOneOf(names));
            return None;
        };
        let mut days = 0;
        for each in list.iter() {
            let said = each.get_ref().as_str();
            let Some((_, bit)) = DAYS.iter().find(|(name, _)| said == Some(*name)) else {
                self.problem(each.span(), path, Invalid::NotOneOf(names));
                return None;
            };
            days |= 1 << bit;
        }
        Some(days)
    }

    fn actions(
        &mut self,
        known: Known<'_, 't>,
        value: &Value<'t>,
        path: &str,
    ) -> Option<Vec<Action>> {
        let Some(list) = value.get_ref().as_array() else {
            self.problem(value.span(), path, Invalid::WrongType("list of actions"));
            return None;
        };
        if list.is_empty() {
            self.problem(value.span(), path, Invalid::BadAction);
            return None;
        }
        if list.len() > ACTIONS_MAX {
            self.problem(value.span(), path, Invalid::TooMany(ACTIONS_MAX));
            return None;
        }
        let actions: Vec<_> = list
            .iter()
            .map(|each| self.action(known, each, path))
            .collect();
        actions.into_iter().collect()
    }

    fn action(&mut self, known: Known<'_, 't>, value: &Value<'t>, path: &str) -> Option<Action> {
        let table = self.table(value, path)?;
        let section = Section::of(path.to_owned(), value, table);
        self.only_keys(&section, &ACTION_KEYS)?;
        let set = self.optional(&section, "set", Self::string)?;
        let to = self.optional(&section, "to", Self::truth)?;
        let pulse = self.optional(&section, "pulse", Self::string)?;
        let width = self.duration(&section, "width")?;
        let notify = self.optional(&section, "notify", Self::string)?;
        match (set, to, pulse, width, notify) {
            (Some(name), Some(to), None, None, None) => {
                let at = section.place_of("set");
                let place = self.switched(known, (&at, path), &name)?;
                Some(Action::Set(place, to))
            }
            (None, None, Some(name), width, None) => {
                let at = section.place_of("pulse");
                let place = self.switched(known, (&at, path), &name)?;
                self.pulse(known.1, &section, place, width)
            }
            (None, None, None, None, Some(text)) => {
                if text.trim().is_empty() || text.chars().count() > NOTICE_MAX {
                    let at = section.place_of("notify");
                    self.problem(at, path, Invalid::BadText(NOTICE_MAX));
                    return None;
                }
                Some(Action::Notify(text))
            }
            _ => {
                self.problem(value.span(), path, Invalid::BadAction);
                None
            }
        }
    }

    /// An output that can be switched without confirmation by a person.
    fn switched(
        &mut self,
        (root, config): Known<'_, 't>,
        (span, path): (&Span<usize>, &str),
        name: &str,
    ) -> Option<Place> {
        let place = self.output(root, config, (span, path), name)?;
        let asks = config.safety(&place).and_then(|safety| safety.confirm);
        if asks.is_some() {
            self.problem(span.clone(), path, Invalid::NeedsPerson);
            return None;
        }
        Some(place)
    }

    /// Only modules that time pulses themselves have a width of their own.
    fn pulse(
        &mut self,
        config: &Config,
        section: &Section<'_, 't>,
        place: Place,
        width: Option<Micros>,
    ) -> Option<Action> {
        let family = config.modules.get(&place.module)?.setup.family;
        let (at, path) = (section.place_of("width"), &section.path);
        match width {
            None if family.datasheet().pulses != PulseTiming::Stored => {
                self.problem(at, path, Invalid::MissingKey("width"));
                None
            }
            Some(width) if width.0 == 0 || width > PULSE_MAX => {
                self.problem(at, path, Invalid::TooLong(PULSE_MAX));
                None
            }
            width => Some(Action::Pulse(place, width)),
        }
    }
}

/// `06:30`.
fn time_of_day(text: &str) -> Option<(u8, u8)> {
    let (hour, minute) = text.split_once(':')?;
    let two = |digits: &str, most: u8| {
        let is_number = digits.len() == 2 && digits.bytes().all(|digit| digit.is_ascii_digit());
        let number: u8 = is_number.then(|| digits.parse().ok())??;
        (number <= most).then_some(number)
    };
    Some((two(hour, 23)?, two(minute, 59)?))
}
