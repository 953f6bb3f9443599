//! The configuration of a NATS server of the fleet.

use crate::grants::PAYLOAD_MAX;
use crate::is_node_name;
use std::fmt::Write as _;
use std::net::Ipv4Addr;

/// Where clients connect, if nothing else is said.
const PORT: u16 = 4222;
/// The port of the other servers is so much higher than that of clients: 6222.
const ROUTE_OFFSET: u16 = 2000;

/// Where a server of the fleet is reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeAddress {
    host: String,
    port: u16,
}

impl NodeAddress {
    /// Reads `HOST` or `HOST:PORT`: a host name or an IPv4 address, and 1 to 63535.
    #[must_use]
    pub fn parse(text: &str) -> Option<NodeAddress> {
        let (host, port) = match text.split_once(':') {
            Some((host, port)) => {
                let is_number = port.bytes().all(|digit| digit.is_ascii_digit());
                (host, port.parse().ok().filter(|_| is_number)?)
            }
            None => (text, PORT),
        };
        let is_port = port != 0 && port.checked_add(ROUTE_OFFSET).is_some();
        (is_port && is_node_name(host)).then(|| NodeAddress {
            host: host.to_owned(),
            port,
        })
    }

    /// The host.
    #[must_use]
    pub fn host(&self) -> &str {
        &self.host
    }

    /// The port of clients.
    #[must_use]
    pub const fn port(&self) -> u16 {
        self.port
    }

    const fn route_port(&self) -> u16 {
        self.port + ROUTE_OFFSET
    }

    /// On which address it listens: everywhere, but for trials on one machine.
    fn listens_on(&self) -> String {
        let address: Option<Ipv4Addr> = self.host.parse().ok();
        match address.filter(Ipv4Addr::is_loopback) {
            Some(address) => address.to_string(),
            None => Ipv4Addr::UNSPECIFIED.to_string(),
        }
    }
}

impl std::fmt::Display for NodeAddress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

/// What all servers of a fleet have.
pub(crate) struct Accounts<'a> {
    /// The operator's claims.
    pub(crate) operator: &'a str,
    /// The public key of the system account.
    pub(crate) system: &'a str,
    /// The accounts that are there from the start: public key and claims.
    pub(crate) known: &'a [(String, String)],
}

/// The configuration of one of these servers, as a text. It names files beside it: the server is
/// started in its folder.
pub(crate) fn server_file(nodes: &[NodeAddress], own: usize, accounts: &Accounts<'_>) -> String {
    let Some(node) = nodes.get(own) else {
        return String::new();
    };
    let name = own + 1;
    let mut text = format!(
        "# Server {name} of a railbus fleet, written by `railbus fleet init`. Start it in this \
         folder:\n#     nats-server -c nats.conf\n# It needs nats-server 2.11 or newer.\n\n\
         server_name: \"server{name}\"\n\
         listen: \"{listens}:{port}\"\n\
         max_payload: {PAYLOAD_MAX}\n\
         tls {{ cert_file: \"server.pem\", key_file: \"server.key\" }}\n\n\
         operator: \"{}\"\n\
         system_account: \"{}\"\n\
         resolver {{ type: full, dir: \"jwt\", allow_delete: false, interval: \"10s\" }}\n\
         resolver_preload {{\n",
        accounts.operator,
        accounts.system,
        listens = node.listens_on(),
        port = node.port,
    );
    for (key, claims) in accounts.known {
        // Writing to a text does not fail.
        let _ = writeln!(text, "    {key}: \"{claims}\"");
    }
    text += "}\n\n\
         # Every message is on the disk before it is acknowledged.\n\
         jetstream { store_dir: \"jetstream\", sync_interval: always }\n";
    let others = nodes.iter().enumerate().filter(|(at, _)| *at != own);
    let routes: Vec<String> = others
        .map(|(_, node)| format!("\"nats-route://{}:{}\"", node.host, node.route_port()))
        .collect();
    if !routes.is_empty() {
        let _ = write!(
            text,
            "\ncluster {{\n    name: \"railbus\"\n    listen: \"{}:{}\"\n    \
             tls {{ cert_file: \"server.pem\", key_file: \"server.key\", ca_file: \"ca.pem\", \
             verify: true }}\n    routes: [{}]\n}}\n",
            node.listens_on(),
            node.route_port(),
            routes.join(", "),
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_a_host_and_maybe_a_port() {
        let node = |text| NodeAddress::parse(text).map(|node| node.to_string());
        assert_eq!(node("nats1").as_deref(), Some("nats1:4222"));
        assert_eq!(node("10.0.0.7:63535").as_deref(), Some("10.0.0.7:63535"));
        for bad in [
            "", ":4222", "a:", "a:0", "a:63536", "a:+1", "a:1:2", "a b", "[::1]:1", "a:x",
        ] {
            assert_eq!(node(bad), None, "{bad}");
        }
    }

    #[test]
    fn servers_know_each_other_but_not_themselves() {
        let nodes: Vec<_> = ["nats1", "nats2:5000", "127.0.0.2:14222"]
            .iter()
            .map(|node| NodeAddress::parse(node).unwrap())
            .collect();
        let known = [("AX".to_owned(), "claims".to_owned())];
        let accounts = Accounts {
            operator: "op",
            system: "AS",
            known: &known,
        };
        let text = |own| server_file(&nodes, own, &accounts);
        let first = text(0);
        assert!(first.contains("listen: \"0.0.0.0:4222\""), "{first}");
        assert!(first.contains("    AX: \"claims\"\n"), "{first}");
        let routes = "[\"nats-route://nats2:7000\", \"nats-route://127.0.0.2:16222\"]";
        assert!(first.contains(routes), "{first}");
        let third = text(2);
        assert!(third.contains("listen: \"127.0.0.2:14222\""), "{third}");
        assert!(!third.contains("route://127.0.0.2"), "{third}");
        assert_eq!(text(3), "");
        let alone = server_file(&nodes[..1], 0, &accounts);
        assert!(!alone.contains("cluster"), "{alone}");
    }
}
