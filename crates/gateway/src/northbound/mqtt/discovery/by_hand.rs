//! The entities for a Home Assistant that is not told of them: as its own configuration has them.

use super::{Discovery, Known, Tell, Topics, object};
use railbus_site::config::ModuleConfig;
use railbus_site::{BadReason, Config, Left, PointNow, PointQuality, PointStatus};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};

/// What is shorter in a message than in a configuration.
const LONG: [(&str, &str); 7] = [
    ("avty", "availability"),
    ("avty_mode", "availability_mode"),
    ("dev", "device"),
    ("ids", "identifiers"),
    ("mdl", "model"),
    ("sa", "suggested_area"),
    ("t", "topic"),
];
/// What a configuration can't say, or not in every version.
const NOT_SAID: [&str; 2] = ["default_entity_id", "o"];

/// Every entity, with its kind. An output is a switch unless the configuration says otherwise: it
/// does not know which ones give pulses.
pub(in crate::northbound::mqtt) fn by_hand(
    topics: &Topics,
    discovery: &Discovery,
    config: &Config,
) -> Vec<(&'static str, Map<String, Value>)> {
    let told = config.modules.iter().filter(|(name, _)| topics.has(name));
    let of_module = |(name, module): (&String, &ModuleConfig)| {
        let tell = Tell {
            discovery,
            topics,
            module: name,
        };
        let known = known(config, (name, module));
        let shared = tell.shared(&known);
        let whole = move |entity: super::Entity| {
            let mut all = shared.clone();
            all.extend(entity.config);
            (entity.kind, object(in_full(Value::Object(all))))
        };
        let entities = tell.entities(&known, |_, _| false);
        entities.into_iter().map(whole).collect::<Vec<_>>()
    };
    told.flat_map(of_module).collect()
}

/// A module of which nothing but the configuration is known.
fn known(config: &Config, (name, module): (&str, &ModuleConfig)) -> Known {
    let status = |point| {
        let now = PointNow {
            point,
            value: None,
            quality: PointQuality::Bad(BadReason::NeverRead),
            age: None,
            time: None,
            left: Left::default(),
            pulse: None,
            is_pulse_known: true,
        };
        (point, PointStatus::of(config, (name, module), now))
    };
    Known {
        called: module.name.clone(),
        family: module.setup.family,
        area: module.area.clone(),
        points: module
            .setup
            .points()
            .map(status)
            .collect::<BTreeMap<_, _>>(),
        topics: BTreeSet::new(),
    }
}

/// The same with the long names of its keys.
fn in_full(value: Value) -> Value {
    let long = |key: String| {
        let found = LONG.into_iter().find(|(short, _)| *short == key);
        found.map_or(key, |(_, long)| long.to_owned())
    };
    match value {
        Value::Object(keys) => {
            let said = keys
                .into_iter()
                .filter(|(key, _)| !NOT_SAID.contains(&key.as_str()));
            said.map(|(key, value)| (long(key), in_full(value)))
                .collect()
        }
        Value::Array(items) => items.into_iter().map(in_full).collect(),
        other => other,
    }
}
