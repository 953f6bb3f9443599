//! MQTT discovery of Home Assistant: descriptions of the modules, from which it makes devices and
//! entities. A module is a device, and a point one entity or several.
//!
//! A message of the form `device` has all entities of a module. Home Assistant removes an entity
//! only if the message says so: [`Described`] remembers all that were ever published.
//!
//! The same for a Home Assistant that is to have it in its own configuration: `by_hand`.

mod by_hand;

use super::told::{OFFLINE, ONLINE};
use super::topics::{Facet, Topics};
use crate::northbound::offered::home_class;
use railbus_device::{Family, Point, PointKind};
use railbus_site::config::{Name, Range};
use railbus_site::{Picture, PointStatus, Rights};
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

pub(super) use by_hand::by_hand;

/// Between a topic and an entity of it, where they are remembered. No topic has it.
pub(super) const MARK: char = '#';
/// After Home Assistant has started, all descriptions are published again within this time.
const SPREAD_MS: u64 = 5_000;
/// The kinds of entities.
const SWITCH: &str = "switch";
const BUTTON: &str = "button";
const BINARY: &str = "binary_sensor";
const SENSOR: &str = "sensor";

/// The form of the messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// A message for each module.
    Device,
    /// A message for each entity, as older versions and other programs want it.
    Component,
}

/// What the descriptions depend on besides the modules.
#[derive(Clone, Debug)]
pub(super) struct Discovery {
    form: Form,
    /// Where its topics begin.
    prefix: String,
    /// The site, as part of what identifies its modules.
    site: String,
    /// Names are in Chinese, where there are any.
    is_zh: bool,
    /// Which outputs may be switched.
    rights: Rights,
    /// The time from a start of Home Assistant until all is published again.
    spread: Duration,
}

/// An entity of a module.
#[derive(Debug)]
struct Entity {
    kind: &'static str,
    /// Which one of its module: the label of a point, or that and a word.
    key: String,
    config: Map<String, Value>,
}

/// What is known of a module.
#[derive(Debug)]
struct Known {
    called: Name,
    family: Family,
    area: Option<String>,
    points: BTreeMap<Point, PointStatus>,
    /// Where it is published.
    topics: BTreeSet<String>,
}

/// The modules as they are published, and all entities that ever were.
#[derive(Debug, Default)]
pub(super) struct Described {
    modules: BTreeMap<String, Known>,
    /// By the topic of a module its entities as `switch/k1`, and whether each is still one.
    told: BTreeMap<String, BTreeMap<String, bool>>,
}

impl Discovery {
    /// For the points below `<base>/<site>`; the topics of the descriptions begin with this prefix.
    pub(super) fn new(
        form: Form,
        prefix: &str,
        (base, site): (Option<&str>, &str),
        is_zh: bool,
        rights: Rights,
    ) -> Discovery {
        let hash = Sha256::new()
            .chain_update(base.unwrap_or_default())
            .chain_update("/")
            .chain_update(site)
            .finalize();
        let number = u64::from(u16::from_be_bytes([hash[4], hash[5]]));
        Discovery {
            form,
            prefix: prefix.to_owned(),
            site: site_id(base, site, &hash[..4]),
            is_zh,
            rights,
            spread: Duration::from_millis(number * SPREAD_MS / u64::from(u16::MAX)),
        }
    }

    /// Where Home Assistant says that it is there.
    pub(super) fn status(&self) -> String {
        format!("{}/status", self.prefix)
    }

    /// The time from that until all is published again: 0 to 5 s, not the same for every site.
    pub(super) const fn spread(&self) -> Duration {
        self.spread
    }

    /// Whether a topic is that of a description.
    pub(super) fn has(&self, topic: &str) -> bool {
        let rest = topic.strip_prefix(&self.prefix);
        rest.is_some_and(|rest| rest.starts_with('/') && rest.ends_with("/config"))
    }

    /// A module for Home Assistant. No other one has this, of no site.
    fn module(&self, name: &str) -> String {
        format!("railbus_{}_{name}", self.site)
    }

    fn device_topic(&self, module: &str) -> String {
        format!("{}/device/{}/config", self.prefix, self.module(module))
    }

    fn entity_topic(&self, module: &str, kind: &str, key: &str) -> String {
        let module = self.module(module);
        format!("{}/{kind}/{module}/{key}/config", self.prefix)
    }

    fn name<'n>(&self, name: &'n Name) -> Option<&'n str> {
        let (own, other) = match self.is_zh {
            true => (&name.zh, &name.en),
            false => (&name.en, &name.zh),
        };
        own.as_deref().or(other.as_deref())
    }
}

/// A site as letters, digits and hyphens. One that has something else, or that looks as if it had,
/// has a hash in it, so that no two are the same.
fn site_id(base: Option<&str>, site: &str, hash: &[u8]) -> String {
    let fits = |char: char| match char {
        char if char.is_ascii_alphanumeric() => char,
        _ => '-',
    };
    let plain: String = site.chars().map(fits).collect();
    let tail = plain.rsplit_once('-').map_or("", |(_, tail)| tail);
    let looks_so = tail.len() == 2 * hash.len() && tail.bytes().all(|b| b.is_ascii_hexdigit());
    if base.is_none() && plain == site && !looks_so {
        return plain;
    }
    let hash: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("{plain}-{hash}")
}

impl Described {
    /// What an earlier run remembered is taken out of what it left.
    pub(super) fn new(old: &mut BTreeSet<String>) -> Described {
        let mut described = Described::default();
        old.retain(|line| {
            let Some((topic, entity)) = line.split_once(MARK) else {
                return true;
            };
            let (entity, is_one) = match entity.strip_suffix(MARK) {
                Some(entity) => (entity, false),
                None => (entity, true),
            };
            let told = described.told.entry(topic.to_owned()).or_default();
            told.insert(entity.to_owned(), is_one);
            false
        });
        described
    }

    /// What the next run has to know.
    pub(super) fn remembered(&self) -> impl Iterator<Item = String> {
        self.told.iter().flat_map(|(topic, entities)| {
            let line = move |(entity, is_one): (&String, &bool)| match is_one {
                true => format!("{topic}{MARK}{entity}"),
                false => format!("{topic}{MARK}{entity}{MARK}"),
            };
            entities.iter().map(line)
        })
    }

    /// Takes the state of the site; returns all messages by their topics. `is_told`: whether
    /// something was published at a topic.
    pub(super) fn picture(
        &mut self,
        topics: &Topics,
        picture: &Picture,
        is_told: impl Fn(&str) -> bool,
    ) -> Vec<(String, String)> {
        self.modules.clear();
        let Some(discovery) = topics.discovery() else {
            self.told.clear();
            return Vec::new();
        };
        for status in picture
            .modules
            .iter()
            .filter(|status| topics.has(&status.name))
        {
            let known = Known {
                called: status.called.clone(),
                family: status.setup.family,
                area: status.area.clone(),
                points: BTreeMap::new(),
                topics: BTreeSet::new(),
            };
            self.modules.insert(status.name.clone(), known);
        }
        for status in &picture.points {
            if let Some(known) = self.modules.get_mut(&status.module) {
                known.points.insert(status.point, status.clone());
            }
        }
        let names: Vec<String> = self.modules.keys().cloned().collect();
        let messages = names
            .iter()
            .flat_map(|name| self.messages(topics, name, &is_told).0);
        let messages: Vec<(String, String)> = messages.collect();
        let is_one = |topic: &String| match discovery.form {
            Form::Device => messages.iter().any(|(told, _)| told == topic),
            Form::Component => false,
        };
        self.told.retain(|topic, _| is_one(topic));
        messages
    }

    /// The topics of the other form at which an earlier run left something. Of single entities only
    /// those that this form has, too: the others are to be removed.
    pub(super) fn moving<'o>(
        &self,
        topics: &Topics,
        old: &'o BTreeSet<String>,
    ) -> impl Iterator<Item = &'o String> {
        let mut moving = Vec::new();
        for module in self.modules.keys() {
            let Some(discovery) = topics.discovery() else {
                break;
            };
            let of_device = discovery.device_topic(module);
            match discovery.form {
                Form::Component => moving.push(of_device),
                Form::Device => {
                    let told = self.told.get(&of_device).into_iter().flatten();
                    let are = told.filter(|(_, is_one)| **is_one);
                    let are = are.filter_map(|(entity, _)| entity.split_once('/'));
                    moving.extend(are.map(|(kind, key)| discovery.entity_topic(module, kind, key)));
                }
            }
        }
        moving.into_iter().filter_map(|topic| old.get(&topic))
    }

    /// Takes the state of a point; returns whether the description of its module may change.
    pub(super) fn point(&mut self, status: &PointStatus) -> bool {
        let known = self.modules.get_mut(&status.module);
        let before = known.and_then(|known| known.points.get_mut(&status.point));
        let Some(before) = before.filter(|before| before.label == status.label) else {
            return false;
        };
        let is = |status: &PointStatus| (status.is_pulse_known, status.pulse.is_some());
        let is_other = is(before) != is(status);
        (before.is_pulse_known, before.pulse) = (status.is_pulse_known, status.pulse);
        is_other
    }

    /// The messages of a module now, and the topics that it has no longer.
    pub(super) fn messages(
        &mut self,
        topics: &Topics,
        module: &str,
        is_told: impl Fn(&str) -> bool,
    ) -> (Vec<(String, String)>, Vec<String>) {
        let (Some(discovery), Some(known)) = (topics.discovery(), self.modules.get_mut(module))
        else {
            return (Vec::new(), Vec::new());
        };
        let of_device = discovery.device_topic(module);
        let told = self.told.get(&of_device);
        let was = |kind: &str, key: &str| {
            let entity = format!("{kind}/{key}");
            let was_one = told.and_then(|told| told.get(&entity)) == Some(&true);
            was_one || is_told(&discovery.entity_topic(module, kind, key))
        };
        let tell = Tell {
            discovery,
            topics,
            module,
        };
        let entities = tell.entities(known, was);
        let messages: Vec<(String, String)> = match discovery.form {
            Form::Component => {
                let shared = tell.shared(known);
                let message = |entity: Entity| {
                    let topic = discovery.entity_topic(module, entity.kind, &entity.key);
                    // What is said of the entity itself comes first.
                    let mut payload = shared.clone();
                    payload.extend(entity.config);
                    (topic, Value::Object(payload).to_string())
                };
                entities.into_iter().map(message).collect()
            }
            Form::Device => {
                let told = self.told.entry(of_device.clone()).or_default();
                told.values_mut().for_each(|is_one| *is_one = false);
                let mut all = Map::new();
                for mut entity in entities {
                    told.insert(format!("{}/{}", entity.kind, entity.key), true);
                    entity.config.insert("p".to_owned(), entity.kind.into());
                    all.insert(entity.key, Value::Object(entity.config));
                }
                for (entity, _) in told.iter().filter(|(_, is_one)| !**is_one) {
                    if let Some((kind, key)) = entity.split_once('/') {
                        // Only its kind: it is removed.
                        all.entry(key).or_insert_with(|| json!({ "p": kind }));
                    }
                }
                let mut payload = tell.shared(known);
                payload.insert("cmps".to_owned(), Value::Object(all));
                vec![(of_device, Value::Object(payload).to_string())]
            }
        };
        let now: BTreeSet<String> = messages.iter().map(|(topic, _)| topic.clone()).collect();
        let before = std::mem::replace(&mut known.topics, now);
        let gone = before.difference(&known.topics).cloned().collect();
        (messages, gone)
    }
}

/// What a command to an output is, for Home Assistant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Means {
    /// None: it is only shown.
    Nothing,
    /// On or off.
    Set,
    /// A pulse of its module.
    Pulse,
}

/// Who tells of a module.
struct Tell<'t> {
    discovery: &'t Discovery,
    topics: &'t Topics,
    module: &'t str,
}

impl Tell<'_> {
    /// What is said of all entities of a module.
    fn shared(&self, known: &Known) -> Map<String, Value> {
        let name = self.discovery.name(&known.called);
        let mut device = json!({
            "ids": [self.discovery.module(self.module)],
            "name": name.unwrap_or(self.module),
            "mdl": known.family.to_string(),
        });
        if let Some(area) = &known.area {
            device["sa"] = area.as_str().into();
        }
        let availability = [
            self.topics.bridge_state(),
            self.topics.availability(self.module),
        ];
        let shared = json!({
            "dev": device,
            "o": {
                "name": "railbus",
                "sw": env!("CARGO_PKG_VERSION"),
                "url": env!("CARGO_PKG_REPOSITORY"),
            },
            "avty": availability.map(|topic| json!({ "t": topic })),
            "avty_mode": "all",
        });
        object(shared)
    }

    /// Its entities. `was` is whether one of this kind and key was told.
    fn entities(&self, known: &Known, was: impl Fn(&str, &str) -> bool) -> Vec<Entity> {
        // That it does not answer is known as long as the gateway is there. Home Assistant has a
        // name for this in every language.
        let connection = json!({
            "state_topic": self.topics.availability(self.module),
            "payload_on": ONLINE,
            "payload_off": OFFLINE,
            "device_class": "connectivity",
            "entity_category": "diagnostic",
            "avty": [{ "t": self.topics.bridge_state() }],
        });
        let mut all = vec![self.entity(BINARY, "connection".to_owned(), connection)];
        for status in known.points.values().filter(|status| !status.config.hidden) {
            match status.point.kind {
                PointKind::Output => self.output(status, &was, &mut all),
                PointKind::Input => all.push(self.seen(status, status.label.clone())),
                PointKind::Analog | PointKind::Variable => all.push(self.measured(status)),
            }
        }
        all
    }

    fn output(
        &self,
        status: &PointStatus,
        was: impl Fn(&str, &str) -> bool,
        all: &mut Vec<Entity>,
    ) {
        let (label, has_confirm) = (&status.label, status.config.safety.confirm.is_some());
        let key = |word: &str| format!("{label}_{word}");
        let button = |word: &str, payload: String| {
            let mut config = object(json!({
                "name": format!("{} {}", self.name(status), word.to_ascii_uppercase()),
                "payload_press": payload,
            }));
            config.extend(self.commanded(label));
            self.entity(BUTTON, key(word), Value::Object(config))
        };
        let confirmed = |word: &str| json!({ "value": word, "confirm": true }).to_string();
        match self.means(status, was) {
            Means::Set if !has_confirm => {
                let mut config = object(json!({
                    "payload_on": "ON",
                    "payload_off": "OFF",
                    "optimistic": false,
                }));
                config.extend(self.read(status));
                config.extend(self.commanded(label));
                all.push(self.entity(SWITCH, label.clone(), Value::Object(config)));
            }
            Means::Set => {
                all.push(self.seen(status, key("state")));
                all.push(button("on", confirmed("ON")));
                all.push(button("off", confirmed("OFF")));
            }
            Means::Pulse => {
                all.push(self.seen(status, key("state")));
                let payload = match has_confirm {
                    true => confirmed("PULSE"),
                    false => "PULSE".to_owned(),
                };
                all.push(button("pulse", payload));
            }
            Means::Nothing => all.push(self.seen(status, key("state"))),
        }
    }

    /// While it is not known whether an output gives pulses, it stays what it was.
    fn means(&self, status: &PointStatus, was: impl Fn(&str, &str) -> bool) -> Means {
        let label = &status.label;
        let may = self.discovery.rights.may_switch(&status.module, label);
        if may.is_err() || status.config.locked {
            return Means::Nothing;
        }
        let was_button = |word: &str| was(BUTTON, &format!("{label}_{word}"));
        match status.is_pulse_known {
            true if status.pulse.is_some() => Means::Pulse,
            true => Means::Set,
            false if was_button("pulse") => Means::Pulse,
            false if was(SWITCH, label) || was_button("on") => Means::Set,
            false => Means::Nothing,
        }
    }

    /// A state that is only shown.
    fn seen(&self, status: &PointStatus, key: String) -> Entity {
        let mut config = object(json!({ "payload_on": "ON", "payload_off": "OFF" }));
        config.extend(self.read(status));
        self.entity(BINARY, key, Value::Object(config))
    }

    /// A number. All of these say how many decimals it has: without that and without a unit, Home
    /// Assistant would take `None` for a text.
    fn measured(&self, status: &PointStatus) -> Entity {
        let mut config = self.read(status);
        let decimals = status.range.as_ref().map_or(0, |range| range.decimals);
        config.insert("suggested_display_precision".to_owned(), decimals.into());
        if let Some(Range { unit, .. }) = &status.range {
            config.insert("state_class".to_owned(), "measurement".into());
            let (class, unit) = home_class(unit);
            if let Some(class) = class {
                config.insert("device_class".to_owned(), class.into());
            }
            if !unit.is_empty() {
                config.insert("unit_of_measurement".to_owned(), unit.into());
            }
        }
        self.entity(SENSOR, status.label.clone(), Value::Object(config))
    }

    fn name(&self, status: &PointStatus) -> String {
        let name = Name {
            en: status.config.name_en.clone(),
            zh: status.config.name_zh.clone(),
        };
        self.discovery
            .name(&name)
            .unwrap_or(&status.label)
            .to_owned()
    }

    /// Where a point is read.
    fn read(&self, status: &PointStatus) -> Map<String, Value> {
        let topic = |facet| self.topics.point(self.module, &status.label, facet);
        object(json!({
            "name": self.name(status),
            "state_topic": topic(Facet::State),
            "json_attributes_topic": topic(Facet::Attr),
        }))
    }

    /// Where an output is commanded.
    fn commanded(&self, label: &str) -> Map<String, Value> {
        object(json!({
            "command_topic": self.topics.set(self.module, label),
            "retain": false,
        }))
    }

    fn entity(&self, kind: &'static str, key: String, config: Value) -> Entity {
        let id = format!("{}_{key}", self.discovery.module(self.module));
        let mut config = object(config);
        let called = id.to_lowercase().replace('-', "_");
        config.insert(
            "default_entity_id".to_owned(),
            format!("{kind}.{called}").into(),
        );
        config.insert("unique_id".to_owned(), id.into());
        config.insert("qos".to_owned(), 1.into());
        Entity { kind, key, config }
    }
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(object) => object,
        _ => Map::new(),
    }
}

#[cfg(test)]
mod tests;
