//! Its settings: where its topics begin, and whom it tells what.

use super::discovery::{Discovery, Form};
use super::topics::{Topics, is_base};
use crate::northbound::broker::level;
use crate::northbound::broker::settings::{self, Broker, names, text};
use crate::northbound::outlet;
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use std::collections::BTreeSet;

/// Where the topics begin.
const BASE: &str = "railbus";
/// Where the topics of discovery begin.
const DISCOVERY: &str = "homeassistant";

/// What the site is called in topics.
fn site_of<'s>(settings: &'s Keys, site: &'s str) -> &'s str {
    text(settings, "site").unwrap_or(site)
}

/// The broker of an outlet of this name at this site.
pub(super) fn broker(settings: &Keys, site: &str, outlet: &str) -> Broker {
    Broker::of(settings, site_of(settings, site), outlet)
}

/// Its topics at this site.
pub(super) fn topics(settings: &Keys, site: &str) -> Topics {
    let base = text(settings, "base").unwrap_or(BASE);
    let discovery = form(settings).map(|form| described(settings, site, form));
    Topics::new(base, site_of(settings, site), names(settings, "modules")).with(discovery)
}

/// Home Assistant discovery in this form.
pub(super) fn described(settings: &Keys, site: &str, form: Form) -> Discovery {
    let prefix = text(settings, "discovery_prefix").unwrap_or(DISCOVERY);
    let is_zh = text(settings, "discovery_names") == Some("zh");
    let base = text(settings, "base").filter(|base| *base != BASE);
    let site = level(site_of(settings, site));
    Discovery::new(form, prefix, (base, &site), is_zh, outlet::rights(settings))
}

/// The form of Home Assistant discovery, if it is on.
fn form(settings: &Keys) -> Option<Form> {
    match text(settings, "discovery") {
        Some("device") => Some(Form::Device),
        Some("component") => Some(Form::Component),
        _ => None,
    }
}

/// The kinds of events that are told; empty for all.
pub(super) fn events(settings: &Keys) -> BTreeSet<String> {
    names(settings, "events")
}

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(name: &str, settings: &Keys, config: &Config) -> Vec<(&'static str, Invalid)> {
    let mut found = Vec::new();
    for key in ["base", "discovery_prefix"] {
        if text(settings, key).is_some_and(|base| !is_base(base)) {
            found.push((key, Invalid::BadTopic));
        }
    }
    if text(settings, "site").is_some_and(|site| level(site) != site) {
        found.push(("site", Invalid::BadTopic));
    }
    found.extend(settings::check(settings));
    let taken = settings::taken(name, settings, same(settings, config));
    found.extend(taken.map(|taken| ("base", taken)));
    found
}

/// The enabled outlets that have the same topics at the same broker, with that of these settings
/// itself.
pub(super) fn same<'c>(settings: &Keys, config: &'c Config) -> impl Iterator<Item = &'c str> {
    settings::same(super::KIND.name, settings, config, |settings| {
        let broker = broker(settings, "", "");
        let base = text(settings, "base").unwrap_or(BASE).to_owned();
        let site = text(settings, "site").map(str::to_owned);
        (broker.host.to_lowercase(), broker.port, base, site)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn keys(value: serde_json::Value) -> Keys {
        value.as_object().cloned().unwrap()
    }

    fn client_of(value: serde_json::Value) -> String {
        broker(&keys(value), "North wing", "scada").client_id
    }

    #[test]
    fn every_outlet_is_a_client_of_its_own() {
        assert_eq!(client_of(json!({})), "railbus-North_wing-scada");
        let named = json!({"site": "west"});
        assert_eq!(client_of(named), "railbus-west-scada");
        let named = json!({"client_id": "c7"});
        assert_eq!(client_of(named), "c7");
    }

    #[test]
    fn what_is_no_topic_is_refused() {
        let config = Config::default();
        let found = |value| {
            let found = check("scada", &keys(value), &config).into_iter();
            found.map(|(key, _)| key).collect::<Vec<_>>()
        };
        assert_eq!(found(json!({"base": "a/b", "site": "c"})), [""; 0]);
        assert_eq!(found(json!({"base": "a/#"})), ["base"]);
        assert_eq!(found(json!({"site": "a/b"})), ["site"]);
        assert_eq!(found(json!({"discovery_prefix": "ha/2"})), [""; 0]);
        assert_eq!(
            found(json!({"discovery_prefix": "ha/"})),
            ["discovery_prefix"]
        );
        assert_eq!(found(json!({"cert": "/a.pem"})), ["cert"]);
        assert_eq!(found(json!({"key": "/a.pem"})), ["key"]);
        assert_eq!(found(json!({"cert": "/a", "key": "/b"})), [""; 0]);
    }

    #[test]
    fn no_two_outlets_have_the_same_topics_at_one_broker() {
        let found = |second: &str| {
            let first = "[outlet.a]\ntype = \"mqtt\"\nsite = \"west\"\n";
            let text = format!("{first}[outlet.b]\ntype = \"mqtt\"\n{second}");
            let config = Config::parse(&text).unwrap();
            let of = |name: &str| check(name, &config.outlets[name].settings, &config);
            assert_eq!(of("a"), [], "one of them is told");
            of("b")
        };
        let taken = [("base", Invalid::TopicsTaken("a".to_owned()))];
        assert_eq!(found("site = \"west\""), taken);
        let spelled = "site = \"west\"\nbase = \"railbus\"\nhost = \"127.0.0.1\"\nport = 1883";
        assert_eq!(found(spelled), taken);
        for other in [
            "enabled = false",
            "base = \"b\"",
            "host = \"::1\"",
            "port = 1884",
        ] {
            assert_eq!(found(&format!("site = \"west\"\n{other}")), [], "{other}");
        }
        assert_eq!(found(""), []);
    }
}
