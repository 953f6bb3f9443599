//! The settings that a module should have, from `[module.NAME.settings]`: `plan` compares them and
//! `apply` writes them. Address, speed, parity and checksum are among the module's own keys.

use super::Invalid;
use super::read::{Reader, Section, Value};
use railbus_commission::settings::{Key, Wanted, Wrong, settings};
use railbus_device::Setup;
use toml::de::DeValue;

/// The settings in this table.
const fn is_here(key: Key) -> bool {
    matches!(
        key,
        Key::Mode(_) | Key::PulseWidth | Key::CalibrationVoltage
    )
}

/// Reads the table, if there is one.
pub(super) fn read<'t>(
    reader: &mut Reader<'t>,
    section: &Section<'_, 't>,
    setup: &Setup,
) -> Wanted {
    let mut wanted = Wanted::default();
    let path = format!("{}.settings", section.path);
    let Some(value) = section.table.get("settings") else {
        return wanted;
    };
    let Some(table) = reader.table(value, &path) else {
        return wanted;
    };
    for (key, value) in table {
        let name = key.get_ref().to_string();
        match value.get_ref() {
            // `do3.mode` is a table `do3` with a key `mode`.
            DeValue::Table(inner) => {
                for (rest, value) in inner {
                    let name = format!("{name}.{}", rest.get_ref());
                    one(reader, &mut wanted, setup, &path, &name, rest.span(), value);
                }
            }
            _ => one(reader, &mut wanted, setup, &path, &name, key.span(), value),
        }
    }
    wanted
}

fn one<'t>(
    reader: &mut Reader<'t>,
    wanted: &mut Wanted,
    setup: &Setup,
    path: &str,
    name: &str,
    at: std::ops::Range<usize>,
    value: &Value<'t>,
) {
    let path = format!("{path}.{name}");
    let known: Vec<Key> = settings(setup)
        .into_iter()
        .map(|(key, _)| key)
        .filter(|key| is_here(*key))
        .collect();
    if !known.iter().any(|key| key.to_string() == name) {
        let known = known.iter().map(Key::to_string).collect();
        reader.problem(at, &path, Invalid::NoSuchSetting(known));
        return;
    }
    let Some(text) = value.get_ref().as_str() else {
        reader.problem(value.span(), &path, Invalid::WrongType("text in quotes"));
        return;
    };
    if let Err(Wrong::Value(_, _, possible)) = wanted.set(setup, name, text) {
        reader.problem(value.span(), &path, Invalid::BadSetting(possible));
    }
}
