//! Where a kind listens, and who may connect: networks, as its settings name them.

use super::kind::texts;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use std::net::{IpAddr, SocketAddr};

/// Addresses from which clients may connect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Network {
    base: IpAddr,
    bits: u8,
}

impl Network {
    /// `192.168.1.0/24`, or an address alone.
    pub(crate) fn parse(text: &str) -> Option<Network> {
        let (base, bits) = match text.split_once('/') {
            Some((base, bits)) => (base, Some(bits)),
            None => (text, None),
        };
        let base: IpAddr = base.parse().ok()?;
        let most = match base {
            IpAddr::V4(_) => 32,
            IpAddr::V6(_) => 128,
        };
        let bits = match bits {
            Some(bits) => bits.parse().ok().filter(|bits| *bits <= most)?,
            None => most,
        };
        Some(Network { base, bits })
    }

    /// Whether this address is in it.
    pub(crate) fn contains(self, address: IpAddr) -> bool {
        match (self.base, address.to_canonical()) {
            (IpAddr::V4(base), IpAddr::V4(one)) => {
                let differ = base.to_bits() ^ one.to_bits();
                differ.leading_zeros() >= u32::from(self.bits)
            }
            (IpAddr::V6(base), IpAddr::V6(one)) => {
                let differ = base.to_bits() ^ one.to_bits();
                differ.leading_zeros() >= u32::from(self.bits)
            }
            _ => false,
        }
    }
}

/// The networks from which clients may connect, besides this machine.
pub(crate) fn allowed(settings: &Keys) -> Vec<Network> {
    texts(settings, "allow")
        .filter_map(Network::parse)
        .collect()
}

/// Where a kind listens, by its settings or as usual; none if that is not an address.
pub(crate) fn listen(settings: &Keys, usual: SocketAddr) -> Option<SocketAddr> {
    let text = settings.get("listen").and_then(|value| value.as_str());
    text.map_or(Some(usual), |text| text.parse().ok())
}

/// What is wrong with where it listens and who may connect. Other machines are only let in where
/// networks are named, or clients show who they are (`is_guarded`).
pub(crate) fn check(
    settings: &Keys,
    usual: SocketAddr,
    is_guarded: bool,
) -> Vec<(&'static str, Invalid)> {
    let mut found = Vec::new();
    match listen(settings, usual) {
        None => found.push(("listen", Invalid::BadListen)),
        Some(at) if !is_guarded && !at.ip().is_loopback() && allowed(settings).is_empty() => {
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

    #[test]
    fn a_network_has_its_addresses_and_no_others() {
        let within = |network: &str, address: &str| {
            Network::parse(network).map(|network| network.contains(address.parse().unwrap()))
        };
        assert_eq!(within("192.168.1.0/24", "192.168.1.255"), Some(true));
        assert_eq!(within("192.168.1.0/24", "192.168.2.0"), Some(false));
        assert_eq!(within("192.168.1.7", "192.168.1.7"), Some(true));
        assert_eq!(within("192.168.1.7", "192.168.1.6"), Some(false));
        assert_eq!(within("0.0.0.0/0", "8.8.8.8"), Some(true));
        assert_eq!(within("0.0.0.0/0", "2001:db8::1"), Some(false));
        assert_eq!(within("10.0.0.0/8", "::ffff:10.1.2.3"), Some(true));
        assert_eq!(within("2001:db8::/32", "2001:db8::1"), Some(true));
        assert_eq!(within("2001:db8::/32", "2001:db9::1"), Some(false));
        for wrong in ["", "10.0.0.0/33", "10.0.0/8", "::/129", "host", "10.0.0.0/"] {
            assert_eq!(Network::parse(wrong), None, "{wrong}");
        }
    }
}
