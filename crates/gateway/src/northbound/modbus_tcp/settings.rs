//! Its settings: where it listens, who may connect, and which module is which unit.

use super::LISTEN;
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, SocketAddr};

/// The units of modules; 0 and 255 are the gateway itself [MODBUS §1.8].
const UNIT_MAX: u8 = 247;

/// Addresses from which clients may connect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Network {
    base: IpAddr,
    bits: u8,
}

impl Network {
    /// `192.168.1.0/24`, or an address alone.
    pub(super) fn parse(text: &str) -> Option<Network> {
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
    pub(super) fn contains(self, address: IpAddr) -> bool {
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

/// Where it listens; none if that is not an address.
pub(super) fn listen(settings: &Keys) -> Option<SocketAddr> {
    let text = settings.get("listen").and_then(|value| value.as_str());
    text.unwrap_or(LISTEN).parse().ok()
}

/// The texts of a list among the settings.
fn texts<'s>(settings: &'s Keys, key: &str) -> impl Iterator<Item = &'s str> {
    let list = settings.get(key).and_then(|value| value.as_array());
    list.into_iter().flatten().filter_map(|item| item.as_str())
}

/// The networks from which clients may connect, besides this machine.
pub(super) fn allowed(settings: &Keys) -> Vec<Network> {
    texts(settings, "allow")
        .filter_map(Network::parse)
        .collect()
}

/// Which module is which unit.
#[derive(Debug, Default, PartialEq)]
pub(super) struct UnitNames {
    /// The modules by their units. Where two have the same, neither is one.
    pub(super) by_unit: BTreeMap<u8, String>,
    /// What is wrong with it.
    pub(super) problems: Vec<Invalid>,
}

/// Which module is which unit.
pub(super) fn units(settings: &Keys, config: &Config) -> UnitNames {
    let of = |key| texts(settings, key).collect::<Vec<_>>();
    let chosen: BTreeSet<&str> = of("modules").into_iter().collect();
    let mut names = UnitNames::default();
    let mut given = BTreeMap::new();
    for text in of("units") {
        match given_unit(text, config) {
            Ok((module, unit)) => {
                if given.insert(module, unit).is_some() {
                    names.problems.push(Invalid::NamedTwice);
                }
            }
            Err(why) => names.problems.push(why),
        }
    }
    let mut taken = BTreeSet::new();
    for (name, module) in &config.modules {
        if !chosen.is_empty() && !chosen.contains(name.as_str()) {
            continue;
        }
        let unit = given.get(name.as_str()).copied();
        let unit = unit.unwrap_or(module.setup.address.0);
        if !(1..=UNIT_MAX).contains(&unit) {
            names.problems.push(Invalid::NeedsUnit(name.clone()));
        } else if let Some(other) = names.by_unit.insert(unit, name.clone()) {
            let both = [other, name.clone()];
            names.problems.push(Invalid::UnitTaken(unit, both));
            taken.insert(unit);
        }
    }
    names.by_unit.retain(|unit, _| !taken.contains(unit));
    names
}

/// A module and its unit, as `pump=4`.
fn given_unit<'t>(text: &'t str, config: &Config) -> Result<(&'t str, u8), Invalid> {
    let (module, unit) = text.split_once('=').ok_or(Invalid::BadUnit)?;
    let module = module.trim();
    let unit: u8 = unit.trim().parse().map_err(|_| Invalid::BadUnit)?;
    if !(1..=UNIT_MAX).contains(&unit) {
        return Err(Invalid::BadUnit);
    }
    match config.modules.contains_key(module) {
        true => Ok((module, unit)),
        false => Err(Invalid::NoSuchModule),
    }
}

/// Whether all modules have the same map.
pub(super) fn is_uniform(settings: &Keys) -> bool {
    settings.get("map").and_then(|value| value.as_str()) == Some("uniform")
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

    #[test]
    fn a_unit_is_an_address_unless_it_is_said() {
        let units = |settings| {
            let names = units(&keys(settings), &config());
            match names.problems.is_empty() {
                true => Ok(names.by_unit),
                false => Err((
                    names.by_unit.into_keys().collect::<Vec<u8>>(),
                    names.problems,
                )),
            }
        };
        let taken = Invalid::UnitTaken(3, ["oven".to_owned(), "pump".to_owned()]);
        let neither = units(json!({"units": ["tank=9"]}));
        assert_eq!(neither, Err((vec![9], vec![taken])), "the others go on");
        let needs = Invalid::NeedsUnit("tank".to_owned());
        let without = units(json!({"units": ["pump = 4"]}));
        assert_eq!(without, Err((vec![3, 4], vec![needs])));
        let all = units(json!({"units": ["pump = 4", "tank=247"]})).unwrap();
        let named: Vec<(u8, &str)> = all.iter().map(|(unit, name)| (*unit, &**name)).collect();
        assert_eq!(named, [(3, "oven"), (4, "pump"), (247, "tank")]);
        let one = units(json!({"modules": ["pump"]})).unwrap();
        assert_eq!(one.len(), 1);
        for (wrong, why) in [
            ("pump", Invalid::BadUnit),
            ("pump=0", Invalid::BadUnit),
            ("pump=248", Invalid::BadUnit),
            ("pump=four", Invalid::BadUnit),
            ("pmup=4", Invalid::NoSuchModule),
        ] {
            let found = units(json!({"units": [wrong, "tank=5"], "modules": ["oven"]}));
            assert_eq!(found, Err((vec![3], vec![why])), "{wrong}");
        }
        let twice = units(json!({"units": ["pump=4", "pump=5", "tank=6"]}));
        assert_eq!(twice.unwrap_err().1, [Invalid::NamedTwice]);
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
