//! Its settings: where it listens, and what is wrong with them.

use crate::northbound::kind::texts;
use crate::northbound::network::{Network, allowed};
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use std::net::SocketAddr;

/// Where it listens if nothing else is said.
const LISTEN: &str = "127.0.0.1:1503";

/// Where it listens; none if that is not an address.
pub(super) fn listen(settings: &Keys) -> Option<SocketAddr> {
    let text = settings.get("listen").and_then(|value| value.as_str());
    text.unwrap_or(LISTEN).parse().ok()
}

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(settings: &Keys, _: &Config) -> Vec<(&'static str, Invalid)> {
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
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn it_listens_to_other_machines_only_if_it_is_said_which() {
        let check = |settings: serde_json::Value| {
            let settings = settings.as_object().cloned().unwrap();
            check(&settings, &Config::default())
        };
        assert_eq!(check(json!({})), []);
        assert_eq!(check(json!({"listen": "[::1]:502"})), []);
        let open = json!({"listen": "0.0.0.0:502"});
        assert_eq!(check(open), [("listen", Invalid::Unguarded)]);
        let said = json!({"listen": "0.0.0.0:502", "allow": ["10.0.0.0/8"]});
        assert_eq!(check(said), []);
        let wrong = check(json!({"listen": "502", "allow": ["x"]}));
        let both = [
            ("listen", Invalid::BadListen),
            ("allow", Invalid::BadNetwork),
        ];
        assert_eq!(wrong, both);
    }
}
