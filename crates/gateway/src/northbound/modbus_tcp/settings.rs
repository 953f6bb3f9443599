//! Its settings: where it listens, and what is wrong with them.

use super::LISTEN;
use crate::northbound::kind::texts;
use crate::northbound::modbus::units::units;
use crate::northbound::network::{Network, allowed};
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use std::net::SocketAddr;

/// Where it listens; none if that is not an address.
pub(super) fn listen(settings: &Keys) -> Option<SocketAddr> {
    let text = settings.get("listen").and_then(|value| value.as_str());
    text.map_or(Some(LISTEN), |text| text.parse().ok())
}

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(settings: &Keys, config: &Config) -> Vec<(&'static str, Invalid)> {
    let mut found = Vec::new();
    match listen(settings) {
        None => found.push(("listen", Invalid::BadListen)),
        Some(at) if !at.ip().is_loopback() && allowed(settings).is_empty() => {
            found.push(("listen", Invalid::Unguarded));
        }
        Some(_) => {}
    }
    if texts(settings, "allow").any(|text| Network::parse(text).is_none()) {
        found.push(("allow", Invalid::BadNetwork));
    }
    let problems = units(settings, config).problems.into_iter();
    found.extend(problems.map(|why| ("units", why)));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn keys(value: serde_json::Value) -> Keys {
        value.as_object().cloned().unwrap()
    }

    fn config() -> Config {
        let module = |name: &str, line: &str, more: &str| {
            format!("[module.{name}]\nline = \"{line}\"\n{more}\n")
        };
        let text = [
            "[line.a]\nport = \"/dev/ttyS8\"\n[line.b]\nport = \"/dev/ttyS9\"\n".to_owned(),
            module("oven", "a", "model = \"erc8\"\naddress = 3"),
            module("pump", "b", "model = \"erc8\"\naddress = 3"),
            module("tank", "b", "model = \"eda9060a\"\naddress = 0"),
        ];
        Config::parse(&text.concat()).unwrap()
    }

    #[test]
    fn it_listens_to_other_machines_only_if_it_is_said_which() {
        let check = |mut settings: serde_json::Value| {
            settings["units"] = json!(["pump=4", "tank=5"]);
            check(&keys(settings), &config())
        };
        assert_eq!(check(json!({})), []);
        assert_eq!(check(json!({"listen": "[::1]:502"})), []);
        let open = json!({"listen": "0.0.0.0:502"});
        assert_eq!(check(open), [("listen", Invalid::Unguarded)]);
        let said = json!({"listen": "0.0.0.0:502", "allow": ["10.0.0.0/8"]});
        assert_eq!(check(said), []);
        let wrong = json!({"listen": "502", "allow": ["10.0.0.0/8", "x"]});
        let found = check(wrong);
        assert_eq!(
            found,
            [
                ("listen", Invalid::BadListen),
                ("allow", Invalid::BadNetwork)
            ]
        );
    }
}
