//! Where webhooks may lead. Who may say where events go could otherwise have the daemon ask what
//! listens on its own machine, or beside it where no other machine is let in.

use railbus_api::problem::{Problem, codes};
use railbus_site::Config;
use railbus_site::paths::matches;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, UdpSocket};

/// The host and the port of an address of a webhook; none of what is no such address.
pub(super) fn place(url: &str) -> Option<(String, u16)> {
    let url: hyper::Uri = url.parse().ok()?;
    let usual = match url.scheme_str()? {
        "https" => 443,
        _ => 80,
    };
    let host = url.host()?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    Some((host.to_owned(), url.port_u16().unwrap_or(usual)))
}

/// Refuses new receivers on this machine or its link that the owner does not allow.
pub(super) fn may_lead(old: &Config, new: &Config) -> Result<(), Problem> {
    let places: Vec<_> = old.webhooks.values().map(|hook| place(&hook.url)).collect();
    for hook in new.webhooks.values() {
        let place = place(&hook.url);
        if places.contains(&place) {
            continue;
        }
        // The address behind a name is checked when something is sent there.
        let inner = place.and_then(|(host, port)| {
            let address = literal(&host).filter(|address| is_inner(*address))?;
            Some((host, port, address))
        });
        if let Some((host, port, address)) = inner
            && !is_allowed(&new.allowed.webhooks, (&host, port), address)
        {
            return Err(refused(&host, port));
        }
    }
    Ok(())
}

/// The address, if the host is written as one: no name resolution is involved.
pub(super) fn literal(host: &str) -> Option<IpAddr> {
    match host.eq_ignore_ascii_case("localhost") {
        true => Some(Ipv4Addr::LOCALHOST.into()),
        false => host.parse().ok(),
    }
}

/// Whether the owner allows a receiver, by the name under which it stands or by its address.
pub(super) fn is_allowed(allowed: &[String], (host, port): (&str, u16), address: IpAddr) -> bool {
    let names = [host.to_ascii_lowercase(), address.to_string()];
    let fits = |pattern: &String, name: &str| {
        let name = if name.contains(':') {
            format!("[{name}]")
        } else {
            name.to_owned()
        };
        [name.clone(), format!("{name}:{port}")]
            .iter()
            .any(|name| matches(pattern.as_bytes(), name.as_bytes()))
    };
    allowed
        .iter()
        .any(|pattern| names.iter().any(|name| fits(pattern, name)))
}

/// Why an event is not sent there.
pub(super) fn refused(host: &str, port: u16) -> Problem {
    let host = if host.contains(':') {
        format!("[{host}]")
    } else {
        host.to_owned()
    };
    Problem::new(codes::HOOK_TARGET).with("name", format!("{host}:{port}"))
}

/// Whether an address is loopback, link-local or unspecified. Private networks (10/8 and the like)
/// are not: receivers stand there.
pub(super) fn is_inner(address: IpAddr) -> bool {
    let address = address.to_canonical();
    let is_special = match address {
        IpAddr::V4(v4) => is_special(v4),
        IpAddr::V6(v6) => {
            v6.is_loopback()
                || v6.is_unspecified()
                || v6.is_multicast()
                || v6.is_unicast_link_local()
                || embedded(v6).is_some_and(is_special)
        }
    };
    is_special || is_own(address)
}

fn is_special(v4: Ipv4Addr) -> bool {
    v4.is_loopback()
        || v4.is_link_local()
        || v4.is_multicast()
        || v4.is_broadcast()
        || v4.octets()[0] == 0
}

/// The address of IPv4 to which a translator or a tunnel carries what is sent here: 64:ff9b::/96
/// and 2002::/16.
fn embedded(v6: Ipv6Addr) -> Option<Ipv4Addr> {
    let bits = v6.to_bits();
    let v4 = |shift: u32| Ipv4Addr::from_bits((bits >> shift) as u32);
    match v6.segments() {
        [0x64, 0xff9b, 0, 0, 0, 0, ..] => Some(v4(0)),
        [0x2002, ..] => Some(v4(80)),
        _ => None,
    }
}

/// Whether an address is one of this machine's own: to such a one the system sends from itself.
/// Nothing is sent to find out.
fn is_own(address: IpAddr) -> bool {
    let any: IpAddr = match address {
        IpAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let from = UdpSocket::bind((any, 0)).and_then(|socket| {
        socket.connect((address, 9))?;
        socket.local_addr()
    });
    from.is_ok_and(|from| from.ip() == address)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_of_this_machine_or_its_link_is_known_in_every_form() {
        for inner in [
            "127.0.0.1",
            "127.9.9.9",
            "0.0.0.0",
            "169.254.169.254",
            "224.0.0.1",
            "255.255.255.255",
            "::1",
            "::",
            "fe80::1",
            "ff02::1",
            "::ffff:127.0.0.1",
            "::ffff:169.254.169.254",
            "64:ff9b::7f00:1",
            "2002:7f00:1::",
        ] {
            assert!(is_inner(inner.parse().unwrap()), "{inner}");
        }
        for outer in [
            "192.0.2.7",
            "198.51.100.1",
            "2001:db8::7",
            "64:ff9b::c000:207",
        ] {
            assert!(!is_inner(outer.parse().unwrap()), "{outer}");
        }
    }

    #[test]
    fn the_owner_allows_by_name_or_address() {
        let allows = |pattern: &str, host: &str, port, address: &str| {
            is_allowed(
                &[pattern.to_owned()],
                (host, port),
                address.parse().unwrap(),
            )
        };
        assert!(allows("127.0.0.1", "127.0.0.1", 80, "127.0.0.1"));
        assert!(allows("127.0.0.1:1880", "localhost", 1880, "127.0.0.1"));
        assert!(allows(
            "LOCALHOST".to_lowercase().as_str(),
            "LocalHost",
            80,
            "127.0.0.1"
        ));
        assert!(allows("[::1]:*", "::1", 80, "::1"));
        assert!(!allows("127.0.0.1:1880", "127.0.0.1", 80, "127.0.0.1"));
        assert!(!allows("node", "node.example", 80, "127.0.0.1"));
    }

    #[test]
    fn an_address_is_taken_apart_as_it_is_asked() {
        let place = |url| place(url).unwrap();
        assert_eq!(place("http://a/x"), ("a".to_owned(), 80));
        assert_eq!(place("https://[fe80::1]:8/x"), ("fe80::1".to_owned(), 8));
        assert_eq!(literal("LocalHost"), literal("127.0.0.1"));
        assert_eq!(literal("example.com"), None);
    }
}
