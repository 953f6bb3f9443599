//! The settings of every outlet at a broker: which one, and how it is reached.

use super::level;
use crate::northbound::kind::ENABLED;
use railbus_site::Config;
use railbus_site::config::change::Keys;
use railbus_site::config::{Invalid, OutletTable};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// The ports of brokers, without and with TLS.
const PORT: u16 = 1883;
const PORT_TLS: u16 = 8883;
/// The broker, if none is named.
const HOST: &str = "127.0.0.1";

/// Which versions of the protocol are spoken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Spoken {
    /// 5, and 3.1.1 with a broker that refuses that.
    Auto,
    Five,
    ThreeOne,
}

/// A broker, and how it is reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Broker {
    pub(crate) host: String,
    pub(crate) port: u16,
    pub(crate) is_tls: bool,
    /// Whom to trust; the authorities of this machine if there is none.
    pub(crate) ca: Option<PathBuf>,
    /// The client's own certificate and its key.
    pub(crate) own: Option<(PathBuf, PathBuf)>,
    pub(crate) username: Option<String>,
    pub(crate) client_id: String,
    pub(crate) spoken: Spoken,
}

/// A text among settings; none where it is left out, or empty.
pub(crate) fn text<'s>(settings: &'s Keys, key: &str) -> Option<&'s str> {
    let text = settings.get(key).and_then(|value| value.as_str());
    text.filter(|text| !text.is_empty())
}

/// A list of names among settings.
pub(crate) fn names(settings: &Keys, key: &str) -> BTreeSet<String> {
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
    /// As an outlet of this name has it, at a site that is called so at the broker.
    pub(crate) fn of(settings: &Keys, site: &str, outlet: &str) -> Broker {
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
        let id = || format!("railbus-{}-{outlet}", level(site));
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

/// What is wrong with these settings beyond their shapes.
pub(crate) fn check(settings: &Keys) -> Vec<(&'static str, Invalid)> {
    let pairs = [("cert", "key"), ("key", "cert")].into_iter();
    let is_alone = |(key, other): &(&str, &str)| {
        text(settings, key).is_some() && text(settings, other).is_none()
    };
    let alone = pairs.filter(is_alone);
    alone
        .map(|(key, other)| (key, Invalid::MissingKey(other)))
        .collect()
}

/// The enabled outlets of a kind that are at the same place as one with these settings, with that
/// one itself: two would speak in one name, and each command would be carried out by both.
pub(crate) fn same<'c, P: PartialEq>(
    kind: &'static str,
    settings: &Keys,
    config: &'c Config,
    place: impl Fn(&Keys) -> P,
) -> impl Iterator<Item = &'c str> {
    let own = place(settings);
    let is_same = move |other: &OutletTable| {
        other.kind == kind && is_enabled(&other.settings) && place(&other.settings) == own
    };
    let others = config.outlets.iter();
    others.filter_map(move |(name, other)| is_same(other).then_some(name.as_str()))
}

/// What is wrong with the outlet of this name if another one is at the same place: of two, the
/// second one is told.
pub(crate) fn taken<'c>(
    name: &str,
    settings: &Keys,
    mut same: impl Iterator<Item = &'c str>,
) -> Option<Invalid> {
    let other = same.find(|other| is_enabled(settings) && *other < name)?;
    Some(Invalid::TopicsTaken(other.to_owned()))
}

fn is_enabled(settings: &Keys) -> bool {
    settings.get(ENABLED) != Some(&false.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn broker(value: serde_json::Value) -> Broker {
        let keys = value.as_object().cloned().unwrap();
        Broker::of(&keys, "North wing", "scada")
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
}
