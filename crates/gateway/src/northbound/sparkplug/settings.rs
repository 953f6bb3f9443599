//! Its settings: who the edge node is, and for whom.

use super::topics::Topics;
use crate::northbound::broker::level;
use crate::northbound::broker::settings::{self, Broker, names, text};
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;

/// The group, if none is named.
const GROUP: &str = "railbus";
/// What stands in the place of a group in the topics of hosts.
const STATE: &str = "STATE";

/// The broker of an outlet of this name at this site.
pub(super) fn broker(settings: &Keys, site: &str, outlet: &str) -> Broker {
    Broker::of(settings, site, outlet)
}

/// Who the edge node of this site is.
pub(super) fn topics(settings: &Keys, site: &str) -> Topics {
    Topics {
        group: text(settings, "group").unwrap_or(GROUP).to_owned(),
        node: text(settings, "node").map_or_else(|| level(site), str::to_owned),
        host: text(settings, "primary_host").map(str::to_owned),
        modules: names(settings, "modules"),
    }
}

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(name: &str, keys: &Keys, config: &Config) -> Vec<(&'static str, Invalid)> {
    let mut found = Vec::new();
    for key in ["group", "node", "primary_host"] {
        if text(keys, key).is_some_and(|id| level(id) != id) {
            found.push((key, Invalid::BadTopic));
        }
    }
    if text(keys, "group") == Some(STATE) {
        found.push(("group", Invalid::BadTopic));
    }
    found.extend(settings::check(keys));
    let taken = settings::taken(name, keys, same(keys, config));
    found.extend(taken.map(|taken| ("node", taken)));
    found
}

/// The enabled outlets that are the same edge node at the same broker, with that of these settings
/// itself.
fn same<'c>(settings: &Keys, config: &'c Config) -> impl Iterator<Item = &'c str> {
    settings::same(super::KIND.name, settings, config, |settings| {
        let broker = broker(settings, "", "");
        let group = text(settings, "group").unwrap_or(GROUP).to_owned();
        let node = text(settings, "node").map(str::to_owned);
        (broker.host.to_lowercase(), broker.port, group, node)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn keys(value: serde_json::Value) -> Keys {
        value.as_object().cloned().unwrap()
    }

    #[test]
    fn the_node_is_the_site_unless_it_is_named() {
        let of = |value| {
            let topics = topics(&keys(value), "North wing/2");
            (topics.group, topics.node, topics.host)
        };
        let railbus = || GROUP.to_owned();
        assert_eq!(of(json!({})), (railbus(), "North_wing_2".to_owned(), None));
        let named = json!({"group": "g", "node": "n", "primary_host": "h"});
        let all = ("g".to_owned(), "n".to_owned(), Some("h".to_owned()));
        assert_eq!(of(named), all);
    }

    #[test]
    fn what_is_no_id_is_refused() {
        let config = Config::default();
        let found = |value| {
            let found = check("scada", &keys(value), &config).into_iter();
            found.map(|(key, _)| key).collect::<Vec<_>>()
        };
        assert_eq!(
            found(json!({"group": "a", "node": "b", "primary_host": "c"})),
            [""; 0]
        );
        for key in ["group", "node", "primary_host"] {
            for wrong in ["a/b", "+", "a#", "$a"] {
                assert_eq!(found(json!({ key: wrong })), [key], "{wrong}");
            }
        }
        assert_eq!(found(json!({"group": "STATE"})), ["group"]);
        assert_eq!(found(json!({"cert": "/a.pem"})), ["cert"]);
    }

    #[test]
    fn no_two_outlets_are_the_same_node() {
        let found = |second: &str| {
            let first = "[outlet.a]\ntype = \"sparkplug\"\nnode = \"west\"\n";
            let text = format!("{first}[outlet.b]\ntype = \"sparkplug\"\n{second}");
            let config = Config::parse(&text).unwrap();
            let of = |name: &str| check(name, &config.outlets[name].settings, &config);
            assert_eq!(of("a"), [], "one of them is told");
            of("b")
        };
        let taken = [("node", Invalid::TopicsTaken("a".to_owned()))];
        assert_eq!(found("node = \"west\""), taken);
        assert_eq!(
            found("node = \"west\"\ngroup = \"railbus\"\nport = 1883"),
            taken
        );
        for other in ["enabled = false", "group = \"g\"", "port = 1884"] {
            assert_eq!(found(&format!("node = \"west\"\n{other}")), [], "{other}");
        }
        assert_eq!(found("node = \"east\""), []);
    }
}
