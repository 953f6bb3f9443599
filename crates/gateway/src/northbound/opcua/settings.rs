//! Its settings, and what is wrong with them.

use super::LISTEN;
use crate::northbound::broker::settings::text;
use crate::northbound::kind::texts;
use crate::northbound::network;
use railbus_opcua::Thumbprint;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use railbus_words::Lang;
use std::net::SocketAddr;

/// What is wrong with its settings beyond their shapes. Certificates are a guard.
pub(super) fn check(settings: &Keys) -> Vec<(&'static str, Invalid)> {
    let mut found = network::check(settings, LISTEN, true);
    if texts(settings, "trusted").any(|text| Thumbprint::parse(text).is_none()) {
        found.push(("trusted", Invalid::BadThumbprint));
    }
    found
}

/// Where it listens.
pub(super) fn listen(settings: &Keys) -> SocketAddr {
    // Nothing else passes the check of a configuration.
    network::listen(settings, LISTEN).unwrap_or(LISTEN)
}

/// The host of the endpoint URL that clients get.
pub(super) fn host(settings: &Keys, at: SocketAddr) -> String {
    let machine = || {
        let name = rustix::system::uname();
        let name = name.nodename().to_str().unwrap_or_default();
        match name {
            "" => "localhost".to_owned(),
            name => name.to_owned(),
        }
    };
    match (text(settings, "host"), at.ip()) {
        (Some(host), _) => host.to_owned(),
        (None, ip) if ip.is_unspecified() => machine(),
        (None, std::net::IpAddr::V6(ip)) => format!("[{ip}]"),
        (None, ip) => ip.to_string(),
    }
}

/// The clients that are trusted.
pub(super) fn trusted(settings: &Keys) -> Vec<Thumbprint> {
    texts(settings, "trusted")
        .filter_map(Thumbprint::parse)
        .collect()
}

/// The language of names.
pub(super) fn lang(settings: &Keys) -> Lang {
    match text(settings, "language") {
        Some("zh") => Lang::Zh,
        _ => Lang::En,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn keys(value: serde_json::Value) -> Keys {
        value.as_object().cloned().unwrap()
    }

    #[test]
    fn a_thumbprint_is_taken_as_clients_show_it() {
        let digits = "AB:CD:".repeat(10);
        let shown = digits.trim_end_matches(':');
        assert_eq!(check(&keys(json!({"trusted": [shown]}))), []);
        let wrong = check(&keys(json!({"trusted": [shown, "abcd"]})));
        assert_eq!(wrong, [("trusted", Invalid::BadThumbprint)]);
        let spaced = shown.replace(':', " ").to_lowercase();
        assert_eq!(Thumbprint::parse(shown), Thumbprint::parse(&spaced));
    }

    #[test]
    fn clients_are_told_an_address_that_they_can_use() {
        let at = |text: &str| {
            let settings = keys(json!({"listen": text}));
            host(&settings, listen(&settings))
        };
        assert_eq!(at("127.0.0.1:4840"), "127.0.0.1");
        assert_eq!(at("[::1]:4840"), "[::1]");
        assert_ne!(at("0.0.0.0:4840"), "0.0.0.0");
        let said = keys(json!({"listen": "0.0.0.0:4840", "host": "plant.example"}));
        assert_eq!(host(&said, listen(&said)), "plant.example");
    }
}
