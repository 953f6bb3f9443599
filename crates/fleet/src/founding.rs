//! A new fleet: its keys, accounts and servers.

use crate::certificates::{Authority, Pair};
use crate::claims::{self, Claims};
use crate::creds;
use crate::desired::{ConfigSigner, DesiredError};
use crate::grants::{self, OF_HUB, OF_SITES};
use crate::server_file::{Accounts, server_file};
use nkeys::KeyPair;
use serde_json::{Map, Value};

pub use crate::server_file::NodeAddress;

/// How many servers a fleet may have: with an even number no more may fail than with one less.
pub const NODE_COUNTS: [usize; 3] = [1, 3, 5];

/// The key that signs configurations, below the folder of the fleet. A fleet that was founded
/// before there was one can be given it later.
pub const CONFIG_SIGNING: &str = "hub/config-signing.nk";

/// A file of a new fleet.
#[derive(Clone, PartialEq, Eq)]
pub struct FoundedFile {
    /// Its folder and name, below that of the fleet.
    pub path: String,
    /// What is in it.
    pub text: String,
    /// Only its owner may read it.
    pub is_secret: bool,
}

/// Without what is in it: that can be a key.
impl std::fmt::Debug for FoundedFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FoundedFile")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

/// Why a fleet can't be founded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FoundingError {
    /// So many servers: there can be 1, 3 or 5.
    Count(usize),
    /// Two servers have one address.
    Twice(NodeAddress),
    /// No key can be made, for this reason.
    Key(String),
}

impl std::fmt::Display for FoundingError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FoundingError::Count(count) => write!(f, "{count} servers; there can be 1, 3 or 5"),
            FoundingError::Twice(node) => write!(f, "{node} is named twice"),
            FoundingError::Key(reason) => write!(f, "no key can be made: {reason}"),
        }
    }
}

impl std::error::Error for FoundingError {}

impl From<nkeys::error::Error> for FoundingError {
    fn from(error: nkeys::error::Error) -> FoundingError {
        FoundingError::Key(error.to_string())
    }
}

impl From<DesiredError> for FoundingError {
    fn from(error: DesiredError) -> FoundingError {
        FoundingError::Key(error.to_string())
    }
}

impl From<rcgen::Error> for FoundingError {
    fn from(error: rcgen::Error) -> FoundingError {
        FoundingError::Key(error.to_string())
    }
}

/// An account: its key, and claims without those of what it has of others.
struct Account {
    name: &'static str,
    key: KeyPair,
    claims: Map<String, Value>,
}

impl Account {
    fn new(name: &'static str, has_streams: bool) -> Account {
        Account {
            name,
            key: KeyPair::new_account(),
            claims: claims::account(has_streams),
        }
    }

    /// Its public key, and its claims signed by the operator.
    fn signed(&self, by: &KeyPair, now: u64) -> Result<(String, String), FoundingError> {
        let key = self.key.public_key();
        let claims = Claims {
            subject: &key,
            name: self.name,
            issued: now,
            expires: None,
            nats: Value::Object(self.claims.clone()),
        };
        let signed = claims.sign(by)?;
        Ok((key, signed))
    }

    /// The credentials of a user of this account with these rights, which don't expire.
    fn user(&self, name: &str, rights: Value, now: u64) -> Result<String, FoundingError> {
        let key = KeyPair::new_user();
        let claims = Claims {
            subject: &key.public_key(),
            name,
            issued: now,
            expires: None,
            nats: claims::user(&self.key.public_key(), rights),
        };
        Ok(creds::file(&claims.sign(&self.key)?, &key)?)
    }
}

/// Founds a fleet on these servers, at this time in seconds since 1970.
///
/// - `offline/`: the keys that found it, needed for another server or another centre, and to revoke
///   a site. They belong away from every machine of the fleet.
/// - `hub/`: what the centre needs to admit sites. Whoever steals it can impersonate and command
///   every site.
/// - `server1/` and so on: what each server needs, with its configuration.
///
/// # Errors
/// [`FoundingError`].
pub fn found(nodes: &[NodeAddress], now: u64) -> Result<Vec<FoundedFile>, FoundingError> {
    if !NODE_COUNTS.contains(&nodes.len()) {
        return Err(FoundingError::Count(nodes.len()));
    }
    let is_twice = |(at, node): &(usize, &NodeAddress)| nodes.iter().take(*at).any(|n| n == *node);
    if let Some((_, node)) = nodes.iter().enumerate().find(is_twice) {
        return Err(FoundingError::Twice(node.clone()));
    }
    let (operator, operator_signing) = (KeyPair::new_operator(), KeyPair::new_operator());
    let (site_signing, join_signing) = (KeyPair::new_account(), KeyPair::new_account());
    let system = Account::new("SYS", false);
    let mut sites = Account::new("SITES", false);
    let mut hub = Account::new("HUB", true);
    let (sites_key, hub_key) = (sites.key.public_key(), hub.key.public_key());
    let claim = |account: &mut Account, key: &str, value: Value| {
        account.claims.insert(key.to_owned(), value);
    };
    claim(&mut hub, "exports", claims::exports(OF_HUB));
    claim(&mut sites, "imports", claims::imports(&hub_key, OF_HUB));
    claim(&mut sites, "exports", claims::exports(OF_SITES));
    claim(&mut hub, "imports", claims::imports(&sites_key, OF_SITES));
    let signing_keys = vec![
        claims::scoped_key(&site_signing.public_key(), "site", grants::site()),
        claims::scoped_key(&join_signing.public_key(), "join", grants::invited()),
    ];
    claim(&mut sites, "signing_keys", Value::Array(signing_keys));

    let system_key = system.key.public_key();
    let operator_claims = Claims {
        subject: &operator.public_key(),
        name: "railbus fleet",
        issued: now,
        expires: None,
        nats: claims::operator(&system_key, &operator_signing.public_key()),
    };
    let operator_claims = operator_claims.sign(&operator)?;
    let known = [&system, &sites, &hub]
        .map(|account| account.signed(&operator_signing, now))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;

    let config_signing = ConfigSigner::generate();
    let authority = Authority::new(now)?;
    let Pair {
        certificate: ca,
        key: ca_key,
    } = authority.own();
    let mut files = vec![
        secret("offline/operator.nk", line(&operator)?),
        secret("offline/system-account.nk", line(&system.key)?),
        secret("offline/sites-account.nk", line(&sites.key)?),
        secret("offline/hub-account.nk", line(&hub.key)?),
        secret("offline/ca.key", ca_key),
        secret("offline/operator-signing.nk", line(&operator_signing)?),
        secret("hub/site-signing.nk", line(&site_signing)?),
        secret("hub/join-signing.nk", line(&join_signing)?),
        secret(CONFIG_SIGNING, format!("{}\n", config_signing.seed()?)),
        secret("hub/hub.creds", hub.user("hub", grants::hub(), now)?),
        secret(
            "hub/system.creds",
            system.user("hub", grants::system(), now)?,
        ),
        public("hub/sites-account.pub", format!("{sites_key}\n")),
        public("hub/servers", addresses(nodes)),
        public("hub/ca.pem", ca.clone()),
    ];
    let accounts = Accounts {
        operator: &operator_claims,
        system: &system_key,
        known: &known,
    };
    for (at, node) in nodes.iter().enumerate() {
        let pair = authority.server(node.host())?;
        let path = |name: &str| format!("server{}/{name}", at + 1);
        files.extend([
            public(&path("nats.conf"), server_file(nodes, at, &accounts)),
            public(&path("server.pem"), pair.certificate),
            secret(&path("server.key"), pair.key),
            public(&path("ca.pem"), ca.clone()),
        ]);
    }
    Ok(files)
}

/// The servers, an address a line.
fn addresses(nodes: &[NodeAddress]) -> String {
    nodes.iter().map(|node| format!("{node}\n")).collect()
}

fn line(key: &KeyPair) -> Result<String, FoundingError> {
    Ok(format!("{}\n", key.seed()?))
}

fn secret(path: &str, text: String) -> FoundedFile {
    FoundedFile {
        path: path.to_owned(),
        text,
        is_secret: true,
    }
}

fn public(path: &str, text: String) -> FoundedFile {
    FoundedFile {
        is_secret: false,
        ..secret(path, text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes(texts: &[&str]) -> Vec<NodeAddress> {
        let parse = |text: &&str| NodeAddress::parse(text).unwrap();
        texts.iter().map(parse).collect()
    }

    #[test]
    fn every_secret_is_marked_as_one_and_in_one_place() {
        let files = found(&nodes(&["a", "b", "c"]), 1_700_000_000).unwrap();
        let is_secret = |text: &str| {
            let seeds = ["SO", "SA", "SU", "SV"];
            let has_seed = text
                .lines()
                .any(|line| line.len() == 58 && seeds.iter().any(|seed| line.starts_with(seed)));
            has_seed || text.contains("PRIVATE KEY")
        };
        for file in &files {
            assert_eq!(is_secret(&file.text), file.is_secret, "{}", file.path);
            assert!(!format!("{file:?}").contains(&file.text), "{}", file.path);
        }
        let mut texts: Vec<_> = files.iter().filter(|file| file.is_secret).collect();
        texts.sort_by_key(|file| file.text.clone());
        texts.dedup_by_key(|file| file.text.clone());
        assert_eq!(texts.len(), 14);
        let secrets = |folder: &str| {
            let its = texts.iter().filter(|file| file.path.starts_with(folder));
            its.count()
        };
        assert_eq!(["offline/", "hub/", "server"].map(secrets), [6, 5, 3]);
    }

    #[test]
    fn a_fleet_has_an_odd_number_of_servers() {
        let end = |texts: &[&str]| found(&nodes(texts), 0).map(|files| files.len());
        assert!(end(&["a"]).is_ok());
        assert!(end(&["a", "b", "c", "d", "e"]).is_ok());
        assert_eq!(end(&[]), Err(FoundingError::Count(0)));
        assert_eq!(end(&["a", "b"]), Err(FoundingError::Count(2)));
        let twice = FoundingError::Twice(NodeAddress::parse("a:4222").unwrap());
        assert_eq!(end(&["a", "b", "a:4222"]), Err(twice));
    }
}
