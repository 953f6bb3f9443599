//! What the broker keeps: for each topic the newest that is to be said.

use super::discovery::Described;
use super::topics::{Facet, Topics};
use railbus_app::api::convert;
use railbus_host::Presence;
use railbus_site::{
    Batch, LineStatus, ModuleStatus, Picture, PointQuality, PointStatus, PointValue,
};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// `online`.
pub(super) const ONLINE: &str = "online";
/// `offline`.
pub(super) const OFFLINE: &str = "offline";
/// A value that is not known, or no longer.
const NOT_KNOWN: &str = "None";
/// Home Assistant is to let an entity go, and to keep what people have set for it: it comes back at
/// another topic.
const MOVES: &[u8] = b"{\"migrate_discovery\":true}";

/// The newest payload of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Newest {
    pub(super) payload: Vec<u8>,
    /// Delivered at least once.
    pub(super) is_sure: bool,
}

/// The newest payload of every topic that the broker keeps.
#[derive(Debug)]
pub(super) struct Told {
    site: String,
    topics: Topics,
    wanted: BTreeMap<String, Newest>,
    /// Topics of earlier names, which are to be cleared.
    old: BTreeSet<String>,
    lines: BTreeMap<String, Value>,
    /// Whether each module answers.
    modules: BTreeMap<String, bool>,
    /// What Home Assistant is told of them.
    described: Described,
    /// What is to be remembered is not what it was.
    is_to_be_kept: bool,
    /// Of the old topics those at which Home Assistant was told in the other form, and whether it
    /// was told that they move.
    moving: BTreeMap<String, bool>,
    moves: Newest,
}

impl Told {
    /// Nothing is known yet. `old` are the topics that an earlier run had.
    pub(super) fn new(site: &str, topics: Topics, mut old: BTreeSet<String>) -> Told {
        old.remove(&topics.bridge_state());
        let described = Described::new(&mut old);
        Told {
            site: site.to_owned(),
            topics,
            wanted: BTreeMap::new(),
            old,
            lines: BTreeMap::new(),
            modules: BTreeMap::new(),
            described,
            is_to_be_kept: false,
            moving: BTreeMap::new(),
            moves: Newest {
                payload: MOVES.to_owned(),
                is_sure: true,
            },
        }
    }

    /// The payload of a topic.
    pub(super) fn newest(&self, topic: &str) -> Option<&Newest> {
        let moves = self.moving.get(topic) == Some(&false);
        moves
            .then_some(&self.moves)
            .or_else(|| self.wanted.get(topic))
    }

    /// Whether a topic is to be cleared.
    pub(super) fn is_old(&self, topic: &str) -> bool {
        self.old.contains(topic)
    }

    /// A topic was cleared. Whether all are now.
    pub(super) fn cleared(&mut self, topic: &str) -> bool {
        self.moving.remove(topic);
        self.old.remove(topic) && self.old.is_empty()
    }

    /// A connection has begun: what was told on another one is told again.
    pub(super) fn begin(&mut self) {
        self.moving
            .values_mut()
            .for_each(|is_told| *is_told = false);
    }

    /// Home Assistant was told that a topic moves. Whether it was told so of all of them now.
    pub(super) fn moves(&mut self, topic: &str) -> bool {
        let is_new = self.moving.get_mut(topic).map(|is_told| *is_told = true);
        is_new.is_some() && self.moving.values().all(|is_told| *is_told)
    }

    /// A topic is to be cleared.
    pub(super) fn forget(&mut self, topic: String) {
        self.old.insert(topic);
    }

    /// Everything is to be cleared.
    pub(super) fn clear(&mut self) -> Vec<String> {
        let all = std::mem::take(&mut self.wanted).into_keys();
        self.old.extend(all);
        self.moving.clear();
        self.old.iter().cloned().collect()
    }

    /// What is still to be cleared.
    pub(super) fn left(&self) -> Vec<String> {
        self.old.iter().cloned().collect()
    }

    /// Whether something is to be told in another form.
    pub(super) fn is_moving(&self) -> bool {
        !self.moving.is_empty()
    }

    /// Whether Home Assistant is told something else at one of these topics.
    pub(super) fn describes(&self, changed: &[String]) -> bool {
        changed.iter().any(|topic| self.topics.describes(topic))
    }

    /// Every topic that is one of Home Assistant's, after those from which they have moved: once it
    /// knows the new ones, it warns of what still comes from the others.
    pub(super) fn described(&self) -> Vec<String> {
        let all = self.wanted.keys();
        let its = all.filter(|topic| self.topics.describes(topic));
        self.moving.keys().chain(its).cloned().collect()
    }

    /// Whether what is to be remembered may not be what it was when this was last called.
    pub(super) fn is_to_be_kept(&mut self) -> bool {
        std::mem::take(&mut self.is_to_be_kept)
    }

    /// Every topic that the broker may have something at, and what was told at it.
    pub(super) fn kept(&self) -> Vec<String> {
        let own = std::iter::once(self.topics.bridge_state());
        let all = own.chain(self.wanted.keys().cloned());
        let all = all.chain(self.old.iter().cloned());
        all.chain(self.described.remembered()).collect()
    }

    /// All topics in the order in which they are told: what there is, values, what Home Assistant
    /// is told, and then which modules answer. While something moves, Home Assistant is told that,
    /// and the rest later.
    pub(super) fn all(&self) -> Vec<String> {
        let info = self.topics.bridge_info();
        let is_module = |topic: &str| topic.ends_with("/availability");
        let is_described = |topic: &&String| self.topics.describes(topic);
        let points = self.wanted.keys().filter(|topic| !is_described(topic));
        let points = points.filter(|topic| **topic != info && !is_module(topic));
        let described = self.wanted.keys().filter(is_described);
        let described = described.filter(|_| self.moving.is_empty());
        let described = described.chain(self.moving.keys());
        let modules = self.wanted.keys().filter(|topic| is_module(topic));
        let all = std::iter::once(&info).chain(points).chain(described);
        all.chain(modules).chain(&self.old).cloned().collect()
    }

    /// How everything is. Gives back the topics that are to be told.
    pub(super) fn picture(&mut self, picture: &Picture) -> Vec<String> {
        let before = std::mem::take(&mut self.wanted);
        self.modules.clear();
        self.lines.clear();
        self.lines(&picture.lines);
        let mut changed = Vec::new();
        self.modules(&picture.modules, &mut changed);
        for status in &picture.points {
            self.point(status, &mut changed);
        }
        let info = self.info(picture);
        self.put(
            self.topics.bridge_info(),
            info.to_string(),
            true,
            &mut changed,
        );
        let is_told = |topic: &str| before.contains_key(topic) || self.old.contains(topic);
        let messages = self.described.picture(&self.topics, picture, is_told);
        for (topic, payload) in messages {
            self.put(topic, payload, true, &mut changed);
        }
        self.is_to_be_kept = true;
        changed.retain(|topic| before.get(topic) != self.wanted.get(topic));
        for topic in before.into_keys() {
            if !self.wanted.contains_key(&topic) {
                changed.push(topic.clone());
                self.old.insert(topic);
            }
        }
        let wanted = &self.wanted;
        self.old.retain(|topic| !wanted.contains_key(topic));
        let before = std::mem::take(&mut self.moving);
        let moving = self.described.moving(&self.topics, &self.old);
        let moving = moving.map(|topic| (topic.clone(), before.get(topic) == Some(&true)));
        self.moving = moving.collect();
        changed
    }

    /// What changed. Gives back the topics that are to be told.
    pub(super) fn batch(&mut self, batch: &Batch) -> Vec<String> {
        let mut changed = Vec::new();
        self.lines(&batch.lines);
        let mut described = BTreeSet::new();
        for reading in &batch.points {
            self.point(&reading.status, &mut changed);
            if self.described.point(&reading.status) {
                described.insert(&reading.status.module);
            }
        }
        self.modules(&batch.modules, &mut changed);
        self.modules(&batch.figures, &mut changed);
        for module in described {
            self.describe(module, &mut changed);
        }
        changed
    }

    /// Home Assistant is told of a module anew.
    fn describe(&mut self, module: &str, changed: &mut Vec<String>) {
        let (wanted, old) = (&self.wanted, &self.old);
        let is_told = |topic: &str| wanted.contains_key(topic) || old.contains(topic);
        let (messages, gone) = self.described.messages(&self.topics, module, is_told);
        for topic in gone {
            self.wanted.remove(&topic);
            self.old.insert(topic.clone());
            changed.push(topic);
        }
        for (topic, payload) in messages {
            self.old.remove(&topic);
            self.put(topic, payload, true, changed);
        }
        self.is_to_be_kept = true;
    }

    /// How it goes.
    pub(super) fn health(&self) -> Map<String, Value> {
        let online = self
            .modules
            .values()
            .filter(|is_online| **is_online)
            .count();
        let health = json!({
            "lines": self.lines,
            "modules": { ONLINE: online, OFFLINE: self.modules.len() - online },
        });
        match health {
            Value::Object(health) => health,
            _ => Map::new(),
        }
    }

    fn put(&mut self, topic: String, payload: String, is_sure: bool, changed: &mut Vec<String>) {
        let payload = payload.into_bytes();
        let newest = Newest { payload, is_sure };
        if self.wanted.get(&topic) != Some(&newest) {
            self.wanted.insert(topic.clone(), newest);
            changed.push(topic);
        }
    }

    fn lines(&mut self, lines: &[LineStatus]) {
        for line in lines {
            let info = convert::line(line.clone());
            self.lines.insert(info.line, json!(info.state));
        }
    }

    fn modules(&mut self, modules: &[ModuleStatus], changed: &mut Vec<String>) {
        for module in modules {
            if !self.topics.has(&module.name) {
                continue;
            }
            let is_online = module.presence == Presence::Online;
            self.modules.insert(module.name.clone(), is_online);
            let word = if is_online { ONLINE } else { OFFLINE };
            let topic = self.topics.availability(&module.name);
            self.put(topic, word.to_owned(), true, changed);
        }
    }

    fn point(&mut self, status: &PointStatus, changed: &mut Vec<String>) {
        if !self.topics.has(&status.module) {
            return;
        }
        let topic = |facet| self.topics.point(&status.module, &status.label, facet);
        let (state, attr) = (topic(Facet::State), topic(Facet::Attr));
        self.put(state, said(status), true, changed);
        self.put(attr, attributes(status).to_string(), false, changed);
    }

    /// What there is.
    fn info(&self, picture: &Picture) -> Value {
        let modules = picture.modules.iter();
        let modules = modules.filter(|module| self.topics.has(&module.name));
        let points = |module: &str| {
            let its = picture.points.iter();
            let its = its.filter(|status| status.module == module);
            its.map(about).collect::<Vec<_>>()
        };
        let modules: Map<String, Value> = modules
            .map(|module| {
                let info = json!({
                    "line": module.line,
                    "model": module.setup.family.name(),
                    "area": module.area,
                    "points": points(&module.name),
                });
                (module.name.clone(), info)
            })
            .collect();
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "site": self.site,
            "modules": modules,
            "groups": picture.config.groups.keys().collect::<Vec<_>>(),
            "scenes": picture.config.scenes.keys().collect::<Vec<_>>(),
        })
    }
}

/// What a point is.
fn about(status: &PointStatus) -> Value {
    let info = convert::point(status.clone());
    let mut about = json!({ "label": info.label, "kind": info.kind });
    if let Value::Object(about) = &mut about {
        if let Some(unit) = info.unit {
            about.insert("unit".to_owned(), unit.into());
        }
        if !info.name.is_empty() {
            about.insert("name".to_owned(), json!(info.name));
        }
    }
    about
}

/// The value of a point, as text. One that is not good is not told.
fn said(status: &PointStatus) -> String {
    let value = status
        .value
        .filter(|_| status.quality == PointQuality::Good);
    match value {
        None => NOT_KNOWN.to_owned(),
        Some(PointValue::Bool(true)) => "ON".to_owned(),
        Some(PointValue::Bool(false)) => "OFF".to_owned(),
        Some(PointValue::Number(number)) => number.to_string(),
        Some(PointValue::Analog(value, _)) => match &status.range {
            Some(range) => format!("{value:.*}", usize::from(range.decimals)),
            None => value.to_string(),
        },
    }
}

/// How good the value is, and when it was read.
fn attributes(status: &PointStatus) -> Value {
    let info = convert::point(status.clone());
    let mut attributes = Map::new();
    attributes.insert("quality".to_owned(), json!(info.quality));
    if let Some(reason) = info.reason {
        attributes.insert("reason".to_owned(), json!(reason));
    }
    attributes.insert("time".to_owned(), json!(info.time));
    attributes.insert("max_age_ms".to_owned(), json!(info.max_age_ms));
    Value::Object(attributes)
}
