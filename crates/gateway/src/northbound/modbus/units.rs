//! Which module is which unit, by the settings.

use crate::northbound::kind::texts;
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use std::collections::{BTreeMap, BTreeSet};

/// The units of modules; 0 and 255 are the gateway itself [MODBUS §1.8].
const UNIT_MAX: u8 = 247;

/// Which module is which unit.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct UnitNames {
    /// The modules by their units. Where two have the same, neither is one.
    pub(crate) by_unit: BTreeMap<u8, String>,
    /// What is wrong with it.
    pub(crate) problems: Vec<Invalid>,
}

/// Which module is which unit.
pub(crate) fn units(settings: &Keys, config: &Config) -> UnitNames {
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
pub(crate) fn is_uniform(settings: &Keys) -> bool {
    settings.get("map").and_then(|value| value.as_str()) == Some("uniform")
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
}
