//! Who may connect to a kind that listens: networks, as its settings name them.

use super::kind::texts;
use railbus_site::config::change::Keys;
use std::net::IpAddr;

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
