//! What is wrong with its settings.

use super::LISTEN;
use crate::northbound::network;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(settings: &Keys) -> Vec<(&'static str, Invalid)> {
    network::check(settings, LISTEN, false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn it_listens_to_other_machines_only_if_it_is_said_which() {
        let check = |settings: serde_json::Value| {
            let settings = settings.as_object().cloned().unwrap();
            check(&settings)
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
