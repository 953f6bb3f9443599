//! Its settings: which broker, how it is reached, and where its topics begin.

use super::discovery::{Discovery, Form};
use super::topics::{Topics, is_base, level};
use crate::northbound::kind::ENABLED;
use crate::northbound::outlet;
use railbus_site::Config;
use railbus_site::config::change::Keys;
use railbus_site::config::{Invalid, OutletTable};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// The ports of brokers, without and with TLS.
const PORT: u16 = 1883;
const PORT_TLS: u16 = 8883;
/// Where the topics begin.
const BASE: &str = "railbus";
/// Where the topics of discovery begin.
const DISCOVERY: &str = "homeassistant";
/// The broker, if none is named.
const HOST: &str = "127.0.0.1";

/// Which versions of the protocol are spoken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Spoken {
    /// 5, and 3.1.1 with a broker that refuses that.
    Auto,
    Five,
    ThreeOne,
}

/// A broker, and how it is reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Broker {
    pub(super) host: String,
    pub(super) port: u16,
    pub(super) is_tls: bool,
    /// Whom to trust; the authorities of this machine if there is none.
    pub(super) ca: Option<PathBuf>,
    /// The client's own certificate and its key.
    pub(super) own: Option<(PathBuf, PathBuf)>,
    pub(super) username: Option<String>,
    pub(super) client_id: String,
    pub(super) spoken: Spoken,
}

fn text<'s>(settings: &'s Keys, key: &str) -> Option<&'s str> {
    let text = settings.get(key).and_then(|value| value.as_str());
    text.filter(|text| !text.is_empty())
}

fn names(settings: &Keys, key: &str) -> BTreeSet<String> {
    let list = settings.get(key).and_then(|value| value.as_array());
    let names = list.into_iter().flatten();
    names
        .filter_map(|name| name.as_str().map(str::to_owned))
        .collect()
}

/// Whether a host is this machine, by how it is written.
fn is_here(host: &str) -> bool {
    let address: Option<std::net::IpAddr> = host.parse().ok();
    host.eq_ignore_ascii_case("localhost") || address.is_some_and(|address| address.is_loopback())
}

impl Broker {
    /// As an outlet of this name at this site has it.
    pub(super) fn of(settings: &Keys, site: &str, outlet: &str) -> Broker {
        let host = text(settings, "host").unwrap_or(HOST).to_owned();
        let is_tls = match text(settings, "tls") {
            Some("on") => true,
            Some("off") => false,
            _ => !is_here(&host),
        };
        let port = settings.get("port").and_then(|port| port.as_i64());
        let port = port.and_then(|port| u16::try_from(port).ok());
        let usual = if is_tls { PORT_TLS } else { PORT };
        let path = |key| text(settings, key).map(PathBuf::from);
        let id = || format!("railbus-{}-{outlet}", level(site_of(settings, site)));
        Broker {
            port: port.filter(|port| *port != 0).unwrap_or(usual),
            is_tls,
            ca: path("ca"),
            own: path("cert").zip(path("key")),
            username: text(settings, "username").map(str::to_owned),
            client_id: text(settings, "client_id").map_or_else(id, str::to_owned),
            spoken: match text(settings, "version") {
                Some("5") => Spoken::Five,
                Some("3.1.1") => Spoken::ThreeOne,
                _ => Spoken::Auto,
            },
            host,
        }
    }
}

/// What the site is called in topics.
fn site_of<'s>(settings: &'s Keys, site: &'s str) -> &'s str {
    text(settings, "site").unwrap_or(site)
}

/// Its topics at this site.
pub(super) fn topics(settings: &Keys, site: &str) -> Topics {
    let base = text(settings, "base").unwrap_or(BASE);
    let site = site_of(settings, site);
    let discovery = form(settings).map(|form| {
        let prefix = text(settings, "discovery_prefix").unwrap_or(DISCOVERY);
        let is_zh = text(settings, "discovery_names") == Some("zh");
        let base = Some(base).filter(|base| *base != BASE);
        let rights = outlet::rights(settings);
        Discovery::new(form, prefix, (base, &level(site)), is_zh, rights)
    });
    Topics::new(base, site, names(settings, "modules")).with(discovery)
}

/// How Home Assistant is told of the modules, if it is.
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
    for (key, other) in [("cert", "key"), ("key", "cert")] {
        if text(settings, key).is_some() && text(settings, other).is_none() {
            found.push((key, Invalid::MissingKey(other)));
        }
    }
    let mut others = same(settings, config);
    // Of two, the second one is told.
    if let Some(other) = others.find(|other| is_enabled(settings) && *other < name) {
        found.push(("base", Invalid::TopicsTaken(other.to_owned())));
    }
    found
}

fn is_enabled(settings: &Keys) -> bool {
    settings.get(ENABLED) != Some(&false.into())
}

/// The enabled outlets that have the same topics at the same broker, with that of these settings
/// itself. Two would speak in one name, and each command would be carried out by both.
pub(super) fn same<'c>(settings: &Keys, config: &'c Config) -> impl Iterator<Item = &'c str> {
    let place = |settings: &Keys| {
        let broker = Broker::of(settings, "", "");
        let base = text(settings, "base").unwrap_or(BASE).to_owned();
        let site = text(settings, "site").map(str::to_owned);
        (broker.host.to_lowercase(), broker.port, base, site)
    };
    let own = place(settings);
    let is_same = move |other: &OutletTable| {
        other.kind == super::KIND.name
            && is_enabled(&other.settings)
            && place(&other.settings) == own
    };
    let others = config.outlets.iter();
    others.filter_map(move |(name, other)| is_same(other).then_some(name.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn keys(value: serde_json::Value) -> Keys {
        value.as_object().cloned().unwrap()
    }

    fn broker(value: serde_json::Value) -> Broker {
        Broker::of(&keys(value), "North wing", "scada")
    }

    #[test]
    fn beyond_this_machine_there_is_tls_unless_it_is_switched_off() {
        let reached = |value| {
            let broker = broker(value);
            (broker.is_tls, broker.port)
        };
        assert_eq!(reached(json!({})), (false, 1883));
        assert_eq!(reached(json!({"host": "::1"})), (false, 1883));
        assert_eq!(reached(json!({"host": "LocalHost"})), (false, 1883));
        assert_eq!(reached(json!({"host": "broker"})), (true, 8883));
        assert_eq!(reached(json!({"host": "10.0.0.7"})), (true, 8883));
        let open = json!({"host": "10.0.0.7", "tls": "off"});
        assert_eq!(reached(open), (false, 1883));
        assert_eq!(reached(json!({"tls": "on", "port": 8000})), (true, 8000));
    }

    #[test]
    fn every_outlet_is_a_client_of_its_own() {
        assert_eq!(broker(json!({})).client_id, "railbus-North_wing-scada");
        let named = json!({"site": "west"});
        assert_eq!(broker(named).client_id, "railbus-west-scada");
        let named = json!({"client_id": "c7"});
        assert_eq!(broker(named).client_id, "c7");
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
