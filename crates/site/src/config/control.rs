//! Groups, scenes, and the safety settings of outputs.

use super::problem::Invalid;
use super::read::{Reader, Section, Value};
use super::{Config, Place};
use railbus_device::{Point, PointKind};
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range as Span;
use toml::de::{DeTable, DeValue};

/// The maximum number of members of a group, and of steps of a scene.
pub const MEMBERS_MAX: usize = 256;
/// The maximum sum of a scene's pauses.
pub const SCENE_MAX: Micros = Micros::from_secs(300);
/// The maximum of `max_on` and `min_off`.
pub const SAFETY_MAX: Micros = Micros::from_secs(7 * 24 * 3_600);

pub(super) const GROUP_KEYS: [&str; 2] = ["name", "members"];
pub(super) const SCENE_KEYS: [&str; 2] = ["name", "steps"];
pub(super) const STEP_KEYS: [&str; 3] = ["set", "to", "wait"];
const POLICIES: [(&str, Policy); 3] = [
    ("hold", Policy::Hold),
    ("off", Policy::Off),
    ("on", Policy::On),
];

/// A display name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Name {
    /// In English.
    pub en: Option<String>,
    /// In Chinese.
    pub zh: Option<String>,
}

/// Outputs that are switched together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Group {
    /// Its display name.
    pub name: Name,
    /// Its outputs, in the order given.
    pub members: Vec<Place>,
}

/// Steps that are executed in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Scene {
    /// Its display name.
    pub name: Name,
    /// Its steps.
    pub steps: Vec<Step>,
}

/// A step of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Switches an output.
    Set(Place, bool),
    /// Waits.
    Wait(Micros),
}

/// How a person must confirm switching an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Confirm {
    /// With a dialog.
    Ask,
    /// By pressing and holding the switch.
    Hold,
}

/// What is done with an output when a connection is lost or comes back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// It stays as it is.
    #[default]
    Hold,
    /// It is switched off.
    Off,
    /// It is switched on.
    On,
}

impl Policy {
    /// The state to switch the output to.
    #[must_use]
    pub const fn state(self) -> Option<bool> {
        match self {
            Policy::Hold => None,
            Policy::Off => Some(false),
            Policy::On => Some(true),
        }
    }
}

/// The safety settings of an output.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Safety {
    /// Switching must be confirmed.
    pub confirm: Option<Confirm>,
    /// Outputs that must not be on while this one is. It is mutual.
    pub interlock: BTreeSet<Place>,
    /// It is switched off after being on for this time.
    pub max_on: Option<Micros>,
    /// Once off, it stays off for at least this time.
    pub min_off: Option<Micros>,
    /// When the site is closed.
    pub on_exit: Policy,
    /// When the holder of its lease is lost; if not given, the lease ends in the opposite state.
    pub on_offline: Option<Policy>,
    /// When its module answers again.
    pub on_return: Policy,
}

impl Safety {
    /// The keys of a point that apply to outputs only.
    pub(super) const KEYS: [&'static str; 7] = [
        "confirm",
        "interlock",
        "max_on",
        "min_off",
        "on_exit",
        "on_offline",
        "on_return",
    ];
}

/// A reference to an output, to be resolved when all modules are known.
pub(super) struct Pending {
    path: String,
    span: Span<usize>,
    of: Place,
    other: String,
}

impl<'t> Reader<'t> {
    /// Reads a point's safety settings. Interlocks are resolved later.
    pub(super) fn safety(&mut self, section: &Section<'_, 't>, of: Place) -> Option<Safety> {
        if of.point.kind != PointKind::Output {
            for key in Safety::KEYS {
                if let Some(value) = section.table.get(key) {
                    let path = format!("{}.{key}", section.path);
                    self.problem(value.span(), &path, Invalid::NotAnOutput);
                }
            }
            return Some(Safety::default());
        }
        self.interlock(section, of)?;
        Some(Safety {
            confirm: self.optional(section, "confirm", Self::confirm)?.flatten(),
            interlock: BTreeSet::new(),
            max_on: self.limit(section, "max_on")?,
            min_off: self.limit(section, "min_off")?,
            on_exit: self.policy(section, "on_exit")?.unwrap_or_default(),
            on_offline: self.policy(section, "on_offline")?,
            on_return: self.policy(section, "on_return")?.unwrap_or_default(),
        })
    }

    fn confirm(&mut self, value: &Value<'t>, path: &str) -> Option<Option<Confirm>> {
        match value.get_ref() {
            DeValue::Boolean(asks) => Some(asks.then_some(Confirm::Ask)),
            DeValue::String(word) if word == "hold" => Some(Some(Confirm::Hold)),
            _ => {
                let choices = vec!["true", "false", "\"hold\""];
                self.problem(value.span(), path, Invalid::NotOneOf(choices));
                None
            }
        }
    }

    fn policy(&mut self, section: &Section<'_, 't>, key: &str) -> Option<Option<Policy>> {
        self.one_of(section, key, &POLICIES)
    }

    fn limit(&mut self, section: &Section<'_, 't>, key: &str) -> Option<Option<Micros>> {
        let found = self.duration(section, key)?;
        if let Some(time) = found
            && (time.0 == 0 || time > SAFETY_MAX)
        {
            let path = format!("{}.{key}", section.path);
            self.problem(section.place_of(key), &path, Invalid::TooLong(SAFETY_MAX));
            return None;
        }
        Some(found)
    }

    fn interlock(&mut self, section: &Section<'_, 't>, of: Place) -> Option<()> {
        let Some(value) = section.table.get("interlock") else {
            return Some(());
        };
        let path = format!("{}.interlock", section.path);
        for (span, other) in self.members(value, &path)? {
            self.pending.push(Pending {
                path: path.clone(),
                span,
                of: of.clone(),
                other,
            });
        }
        Some(())
    }

    /// A list of names with their positions, given what to call such a list and its maximum length.
    pub(super) fn names(
        &mut self,
        value: &Value<'t>,
        path: &str,
        (kind, most): (&'static str, usize),
    ) -> Option<Vec<(Span<usize>, String)>> {
        let Some(list) = value.get_ref().as_array() else {
            self.problem(value.span(), path, Invalid::WrongType(kind));
            return None;
        };
        if list.len() > most {
            self.problem(value.span(), path, Invalid::TooMany(most));
            return None;
        }
        let mut names = Vec::with_capacity(list.len());
        for each in list.iter() {
            names.push((each.span(), self.string(each, path)?));
        }
        Some(names)
    }

    /// A list of points.
    fn members(&mut self, value: &Value<'t>, path: &str) -> Option<Vec<(Span<usize>, String)>> {
        self.names(value, path, ("list of points", MEMBERS_MAX))
    }

    /// Reads everything that refers to outputs of modules, when these are known.
    pub(super) fn control(&mut self, root: &DeTable<'t>, config: &mut Config) {
        for pending in std::mem::take(&mut self.pending) {
            let found = self.output(root, config, (&pending.span, &pending.path), &pending.other);
            match found {
                Some(other) if other == pending.of => {
                    self.problem(pending.span, &pending.path, Invalid::InterlockSelf);
                }
                Some(other) => exclude(config, &pending.of, &other),
                None => {}
            }
        }
        if let Some(groups) = root.get("group") {
            let mut read = BTreeMap::new();
            self.named(groups, "group", |reader, name, section| {
                if let Some(group) = reader.group(root, config, &section) {
                    read.insert(name, group);
                }
            });
            config.groups = read;
        }
        if let Some(scenes) = root.get("scene") {
            let mut read = BTreeMap::new();
            self.named(scenes, "scene", |reader, name, section| {
                if let Some(scene) = reader.scene(root, config, &section) {
                    read.insert(name, scene);
                }
            });
            config.scenes = read;
        }
        if let Some(rules) = root.get("rule") {
            self.rules(rules, root, config);
        }
    }

    fn group(
        &mut self,
        root: &DeTable<'t>,
        config: &Config,
        section: &Section<'_, 't>,
    ) -> Option<Group> {
        self.check_keys(section, &GROUP_KEYS);
        let name = self.name(section)?;
        let named = self.required(section, "members", Self::members)?;
        let path = format!("{}.members", section.path);
        let mut members = Vec::with_capacity(named.len());
        for (span, other) in named {
            let Some(place) = self.output(root, config, (&span, &path), &other) else {
                continue;
            };
            if members.contains(&place) {
                self.problem(span, &path, Invalid::NamedTwice);
            } else {
                members.push(place);
            }
        }
        Some(Group { name, members })
    }

    fn scene(
        &mut self,
        root: &DeTable<'t>,
        config: &Config,
        section: &Section<'_, 't>,
    ) -> Option<Scene> {
        self.check_keys(section, &SCENE_KEYS);
        let name = self.name(section)?;
        let path = format!("{}.steps", section.path);
        let Some(value) = section.table.get("steps") else {
            self.problem(
                section.place_of("steps"),
                &section.path,
                Invalid::MissingKey("steps"),
            );
            return None;
        };
        let Some(list) = value.get_ref().as_array() else {
            self.problem(value.span(), &path, Invalid::WrongType("list of steps"));
            return None;
        };
        if list.len() > MEMBERS_MAX {
            self.problem(value.span(), &path, Invalid::TooMany(MEMBERS_MAX));
            return None;
        }
        let mut steps = Vec::with_capacity(list.len());
        for each in list.iter() {
            steps.push(self.step(root, config, each, &path)?);
        }
        let waits = steps.iter().map(|step| match step {
            Step::Wait(time) => time.0,
            Step::Set(..) => 0,
        });
        if waits.fold(0, u64::saturating_add) > SCENE_MAX.0 {
            self.problem(value.span(), &path, Invalid::TooLong(SCENE_MAX));
            return None;
        }
        Some(Scene { name, steps })
    }

    fn step(
        &mut self,
        root: &DeTable<'t>,
        config: &Config,
        value: &Value<'t>,
        path: &str,
    ) -> Option<Step> {
        let table = self.table(value, path)?;
        let section = Section::of(path.to_owned(), value, table);
        self.check_keys(&section, &STEP_KEYS);
        let set = self.optional(&section, "set", Self::string)?;
        let to = self.optional(&section, "to", Self::truth)?;
        match (set, to, self.duration(&section, "wait")?) {
            (Some(name), Some(to), None) => {
                let span = section.place_of("set");
                let place = self.output(root, config, (&span, path), &name)?;
                Some(Step::Set(place, to))
            }
            (None, None, Some(time)) => Some(Step::Wait(time)),
            _ => {
                self.problem(value.span(), path, Invalid::BadStep);
                None
            }
        }
    }

    /// Resolves the name of an output, such as `oven.k1`.
    pub(super) fn output(
        &mut self,
        root: &DeTable<'t>,
        config: &Config,
        (span, path): (&Span<usize>, &str),
        name: &str,
    ) -> Option<Place> {
        let place = self.place(root, config, (span, path), name)?;
        if place.point.kind != PointKind::Output {
            self.problem(span.clone(), path, Invalid::NotAnOutput);
            return None;
        }
        Some(place)
    }

    /// Resolves the name of a point, such as `oven.k1`. Says nothing about a module that could not
    /// be read: its own problem is already reported.
    pub(super) fn place(
        &mut self,
        root: &DeTable<'t>,
        config: &Config,
        (span, path): (&Span<usize>, &str),
        name: &str,
    ) -> Option<Place> {
        let (module, label) = name.split_once('.').unwrap_or((name, ""));
        let known = config.modules.get(module);
        let point = known.and_then(|known| known.setup.point(label));
        if point.is_none() && (known.is_some() || !is_named(root, "module", module)) {
            self.problem(span.clone(), path, Invalid::NoSuchPath);
        }
        point.map(|point| Place::new(module, point))
    }
}

/// Whether the text has a table of this kind and name, valid or not.
pub(super) fn is_named(root: &DeTable<'_>, kind: &str, name: &str) -> bool {
    let all = root.get(kind).and_then(|all| all.get_ref().as_table());
    all.is_some_and(|all| all.contains_key(name))
}

/// An interlock is mutual, no matter which of the two outputs names the other.
fn exclude(config: &mut Config, one: &Place, other: &Place) {
    for (of, excluded) in [(one, other), (other, one)] {
        if let Some(module) = config.modules.get_mut(&of.module) {
            let point = module.points.entry(of.point).or_default();
            point.safety.interlock.insert(excluded.clone());
        }
    }
}

impl Place {
    /// A point by its module's name.
    #[must_use]
    pub fn new(module: &str, point: Point) -> Place {
        Place {
            module: module.to_owned(),
            point,
        }
    }
}
