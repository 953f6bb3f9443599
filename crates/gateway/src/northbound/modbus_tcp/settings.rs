//! Its settings: where it listens, and what is wrong with them.

use super::{LISTEN, roles};
use crate::northbound::kind::texts;
use crate::northbound::modbus::units::units;
use crate::northbound::network;
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;

/// The files of TLS: certificate, its key, and who issues the certificates of clients.
pub(super) const FILES: [&str; 3] = ["tls_cert", "tls_key", "client_ca"];
/// What the roles of clients may switch.
pub(super) const ROLES: &str = "roles";

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(settings: &Keys, config: &Config) -> Vec<(&'static str, Invalid)> {
    let mut found = Vec::new();
    let is_secure = FILES.iter().any(|key| settings.contains_key(*key));
    if is_secure || texts(settings, ROLES).next().is_some() {
        let absent = FILES.into_iter().filter(|key| !settings.contains_key(*key));
        found.extend(absent.map(|key| (key, Invalid::MissingKey(key))));
    }
    if is_secure && texts(settings, "write").next().is_some() {
        found.push(("write", Invalid::RolesOnly));
    }
    if texts(settings, ROLES).any(|text| roles::entry(text).is_none()) {
        found.push((ROLES, Invalid::BadRole));
    }
    // Certificates are a guard.
    found.extend(network::check(settings, LISTEN, is_secure));
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
        let secure = json!({
            "listen": "0.0.0.0:802", "tls_cert": "/c", "tls_key": "/k", "client_ca": "/a"
        });
        assert_eq!(check(secure), []);
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

    #[test]
    fn rights_are_those_of_roles_where_there_is_tls() {
        let check = |settings: serde_json::Value| {
            let mut all = json!({"units": ["pump=4", "tank=5"]});
            let more = settings.as_object().cloned().unwrap();
            all.as_object_mut().unwrap().extend(more);
            check(&keys(all), &config())
        };
        let missing = |key| (key, Invalid::MissingKey(key));
        let half = check(json!({"tls_cert": "/c", "client_ca": "/a"}));
        assert_eq!(half, [missing("tls_key")]);
        let without = check(json!({"roles": ["operator=pump.*"]}));
        assert_eq!(without, FILES.map(missing));
        let both = check(json!({
            "tls_cert": "/c", "tls_key": "/k", "client_ca": "/a", "write": ["oven"],
            "roles": ["operator=pump.*", "operator"]
        }));
        assert_eq!(
            both,
            [("write", Invalid::RolesOnly), (ROLES, Invalid::BadRole)]
        );
    }
}
