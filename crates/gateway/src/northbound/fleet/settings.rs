//! Its settings, and what is wrong with them.

use crate::northbound::broker::settings::text;
use crate::northbound::kind::texts;
use railbus_fleet::NodeAddress;
use railbus_fleet::desired::ConfigVerifier;
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use std::path::PathBuf;

/// The key of the settings with the key of the centre that may say the configuration.
pub(super) const CONFIG_KEY: &str = "config_key";
/// The most servers of a fleet.
const SERVERS_MAX: usize = 16;

/// How the fleet is reached, and with which key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FleetAccess {
    pub(super) servers: Vec<NodeAddress>,
    /// The file with claims and key.
    pub(super) credentials: PathBuf,
    /// Whom to trust; the authorities of this machine if there is none.
    pub(super) ca: Option<PathBuf>,
}

impl FleetAccess {
    pub(super) fn of(settings: &Keys) -> FleetAccess {
        let path = |key| text(settings, key).map(PathBuf::from);
        FleetAccess {
            servers: texts(settings, "servers")
                .filter_map(NodeAddress::parse)
                .collect(),
            credentials: path("credentials").unwrap_or_default(),
            ca: path("ca"),
        }
    }
}

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(name: &str, settings: &Keys, config: &Config) -> Vec<(&'static str, Invalid)> {
    let servers: Vec<_> = texts(settings, "servers").map(NodeAddress::parse).collect();
    if servers.is_empty() || servers.iter().any(Option::is_none) {
        return vec![("servers", Invalid::BadServers)];
    }
    if servers.len() > SERVERS_MAX {
        return vec![("servers", Invalid::TooMany(SERVERS_MAX))];
    }
    let Some(key) = text(settings, CONFIG_KEY).filter(|key| !key.is_empty()) else {
        return Vec::new();
    };
    if ConfigVerifier::new(key).is_err() {
        return vec![(CONFIG_KEY, Invalid::BadConfigKey)];
    }
    // Of two centres neither could know what the other one wants.
    let mut others = config.outlets.iter().filter(|(other, outlet)| {
        let key = text(&outlet.settings, CONFIG_KEY);
        other.as_str() != name && key.is_some_and(|key| !key.is_empty())
    });
    match others.next() {
        Some((other, _)) => vec![(CONFIG_KEY, Invalid::ManagedBy(other.clone()))],
        None => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn one_centre_at_most_says_the_configuration() {
        let signer = railbus_fleet::desired::ConfigSigner::generate();
        let found = |key: &str, other: &str| {
            let keys = json!({ "servers": ["nats1"], "credentials": "c", "config_key": key });
            let other = format!("[outlet.hq]\ntype = \"fleet\"\n[outlet.old]\n{other}");
            let config = Config::parse(&other).unwrap();
            check("hq", keys.as_object().unwrap(), &config)
        };
        let other = format!(
            "type = \"fleet\"\nconfig_key = \"{}\"\n",
            signer.public_key()
        );
        assert_eq!(found(&signer.public_key(), "type = \"fleet\"\n"), []);
        assert_eq!(found("", &other), []);
        assert_eq!(
            found("VKEY", "type = \"fleet\"\n"),
            [(CONFIG_KEY, Invalid::BadConfigKey)]
        );
        let twice = Invalid::ManagedBy("old".to_owned());
        assert_eq!(found(&signer.public_key(), &other), [(CONFIG_KEY, twice)]);
    }

    #[test]
    fn servers_are_hosts_and_at_least_one() {
        let found = |servers: serde_json::Value| {
            let keys = json!({ "servers": servers, "credentials": "plant7.creds" });
            let config = Config::parse("").unwrap();
            check("hq", keys.as_object().unwrap(), &config)
        };
        assert_eq!(found(json!(["nats1", "10.0.0.7:5000"])), []);
        let wrong = [("servers", Invalid::BadServers)];
        for servers in [
            json!([]),
            json!(["nats1", "nats2:0"]),
            json!(["tls://nats1:4222"]),
        ] {
            assert_eq!(found(servers.clone()), wrong, "{servers}");
        }
        let many: Vec<String> = (0..=SERVERS_MAX).map(|at| format!("nats{at}")).collect();
        assert_eq!(
            found(json!(many)),
            [("servers", Invalid::TooMany(SERVERS_MAX))]
        );
    }
}
