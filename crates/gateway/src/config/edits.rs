//! Requests that change the configuration, as edits of its text.

use crate::northbound;
use railbus_api::problem::{Problem, codes};
use railbus_device::{Family, Setup};
use railbus_site::Config;
pub(super) use railbus_site::config::change::Keys;
use railbus_site::config::change::{self, Refused};
use railbus_wire::{Address, SerialSettings};
use serde_json::Value;

/// The most modules that one request adds: more than all lines of a machine have.
const MODULES_MAX: usize = 1_024;

/// The fields of a line or a module, as written to the file.
pub(super) fn read(text: &str, kind: &'static str, name: &str) -> Result<Keys, Problem> {
    change::keys_of(text, &[kind, name]).ok_or_else(|| problem(kind, name, Refused::NotThere))
}

/// Adds a line with its name and port.
pub(super) fn add_line(text: &str, mut keys: Keys) -> Result<String, Problem> {
    let name = name_in(&mut keys, "line")?;
    if known(text).lines.contains_key(&name) {
        return Err(taken("line", &name));
    }
    let keys = in_its_words(keys, &[]);
    change::set(text, &["line", &name], &keys).map_err(|why| problem("line", &name, why))
}

/// Adds modules, as found by a scan. Default values are not written.
pub(super) fn add_modules(text: &str, modules: Vec<Keys>) -> Result<String, Problem> {
    if modules.is_empty() || modules.len() > MODULES_MAX {
        let words = format!("modules: 1 to {MODULES_MAX}");
        return Err(Problem::new(codes::BAD_REQUEST).with("reason", words));
    }
    let mut text = text.to_owned();
    for mut keys in modules {
        let config = known(&text);
        let name = match name_key(&keys) {
            Some(key) => name_in(&mut keys, key)?,
            None => name_for(&config, &keys)?,
        };
        if config.modules.contains_key(&name) {
            return Err(taken("module", &name));
        }
        let line = text_in(&keys, "line").unwrap_or_default();
        let serial = config
            .lines
            .get(line)
            .map_or(SerialSettings::FACTORY, |line| line.serial);
        let keys = in_its_words(keys, &anyway(serial));
        let keys = without_usual_protocol(keys);
        text = change::set(&text, &["module", &name], &keys)
            .map_err(|why| problem("module", &name, why))?;
    }
    Ok(text)
}

/// Changes fields of a line or a module; `rename` gives it another name.
pub(super) fn change(
    text: &str,
    kind: &'static str,
    name: &str,
    mut keys: Keys,
) -> Result<String, Problem> {
    must_be(text, kind, name)?;
    let new = match keys.contains_key("rename") {
        true => Some(name_in(&mut keys, "rename")?),
        false => None,
    };
    let keys = in_its_words(keys, &[]);
    let text = change::set(text, &[kind, name], &keys).map_err(|why| problem(kind, name, why))?;
    match new.filter(|new| new != name) {
        Some(new) => {
            change::rename(&text, kind, name, &new).map_err(|why| problem(kind, &new, why))
        }
        None => Ok(text),
    }
}

/// Changes fields of a point.
pub(super) fn change_point(
    text: &str,
    module: &str,
    label: &str,
    keys: &Keys,
) -> Result<String, Problem> {
    must_be(text, "module", module)?;
    let config = known(text);
    let setup = config.modules.get(module).map(|module| module.setup);
    if setup.is_some_and(|setup| setup.point(label).is_none()) {
        return Err(Problem::new(codes::NO_SUCH_POINT)
            .with("module", module)
            .with("name", label));
    }
    let path = ["module", module, "point", label];
    change::set(text, &path, keys).map_err(|why| problem("module", module, why))
}

/// Removes a line and, if wanted, its modules.
pub(super) fn remove_line(text: &str, line: &str, modules: bool) -> Result<String, Problem> {
    must_be(text, "line", line)?;
    let config = known(text);
    let mut text = text.to_owned();
    if modules {
        for (module, _) in config.modules_of(line) {
            text = remove(&text, "module", module)?;
        }
    }
    remove(&text, "line", line)
}

pub(crate) fn remove(text: &str, kind: &'static str, name: &str) -> Result<String, Problem> {
    must_be(text, kind, name)?;
    change::remove(text, &[kind, name]).map_err(|why| problem(kind, name, why))
}

/// Writes a whole group, scene, rule or outlet.
pub(crate) fn put(
    text: &str,
    kind: &'static str,
    name: &str,
    keys: &Keys,
) -> Result<String, Problem> {
    change::put(text, &[kind, name], keys).map_err(|why| problem(kind, name, why))
}

/// The parsed text; empty if it has errors, which are reported when the change is checked.
fn known(text: &str) -> Config {
    Config::parse(text).unwrap_or_default()
}

fn must_be(text: &str, kind: &'static str, name: &str) -> Result<(), Problem> {
    // Errors in the text are reported when the change is checked.
    match Config::parse(text).is_err() || change::keys_of(text, &[kind, name]).is_some() {
        true => Ok(()),
        false => Err(problem(kind, name, Refused::NotThere)),
    }
}

/// The key of a new module that holds its id. `name` if it is a text and `module` is missing;
/// otherwise `name` is the display name.
fn name_key(keys: &Keys) -> Option<&'static str> {
    match (keys.contains_key("module"), keys.get("name")) {
        (true, _) => Some("module"),
        (false, None | Some(Value::Object(_))) => None,
        (false, Some(_)) => Some("name"),
    }
}

/// Takes the id out of the fields.
fn name_in(keys: &mut Keys, key: &str) -> Result<String, Problem> {
    match keys.remove(key) {
        Some(Value::String(name)) => Ok(name),
        _ => Err(Problem::new(codes::BAD_REQUEST).with("reason", format!("{key}: a text"))),
    }
}

/// An unused name: `erc8_3`, `erc8_3_2`.
fn name_for(config: &Config, keys: &Keys) -> Result<String, Problem> {
    let family = text_in(keys, "model").and_then(Family::from_name);
    let address = keys.get("address").and_then(Value::as_u64);
    let address = address.and_then(|address| u8::try_from(address).ok());
    let (Some(family), Some(address)) = (family, address) else {
        let words = "name, or model and address, are needed";
        return Err(Problem::new(codes::BAD_REQUEST).with("reason", words));
    };
    let setup = Setup::new(family, Address(address));
    Ok(railbus_site::config::add::free_name(config, &[], &setup))
}

fn text_in<'k>(keys: &'k Keys, key: &str) -> Option<&'k str> {
    keys.get(key)?.as_str()
}

/// The defaults of a module on a line.
fn anyway(serial: SerialSettings) -> [(&'static str, Value); 3] {
    [
        ("baud", serial.baud.rate().into()),
        ("format", serial.character.to_string().into()),
        ("checksum", false.into()),
    ]
}

/// As the configuration has it: parity is a part of the character format.
fn in_its_words(mut keys: Keys, anyway: &[(&str, Value)]) -> Keys {
    if let Some(parity) = keys.remove("parity") {
        let format = match parity.as_str() {
            Some("none") => "8N1".into(),
            Some("even") => "8E1".into(),
            Some("odd") => "8O1".into(),
            _ => parity,
        };
        keys.entry("format").or_insert(format);
    }
    keys.retain(|key, value| {
        !anyway
            .iter()
            .any(|(known, usual)| known == key && value == usual)
    });
    keys
}

fn without_usual_protocol(mut keys: Keys) -> Keys {
    let usual = text_in(&keys, "model").and_then(Family::from_name);
    let usual = usual.and_then(|family| family.profile().protocols.first());
    if usual.is_some_and(|usual| text_in(&keys, "protocol") == Some(usual.name())) {
        keys.remove("protocol");
    }
    keys
}

fn taken(kind: &str, name: &str) -> Problem {
    Problem::new(codes::ALREADY_THERE)
        .with("kind", kind)
        .with("name", name)
}

fn problem(kind: &'static str, name: &str, why: Refused) -> Problem {
    let problem = match why {
        Refused::NotThere => Problem::new(match kind {
            "line" => codes::NO_SUCH_LINE,
            "module" => codes::NO_SUCH_MODULE,
            "group" => codes::NO_SUCH_GROUP,
            "scene" => codes::NO_SUCH_SCENE,
            "rule" => codes::NO_SUCH_RULE,
            table => northbound::missing_in(table).unwrap_or(codes::NO_SUCH_PAGE),
        }),
        Refused::Taken => return taken(kind, name),
        Refused::Text => Problem::new(codes::NOT_EDITABLE),
        Refused::Value(key) => Problem::new(codes::BAD_REQUEST)
            .with("reason", format!("{key}: this value can't be written")),
    };
    problem.with("name", name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const TEXT: &str = "# ours\n[line.main]\nport = \"/dev/ttyUSB0\"\nbaud = 19200\n";

    fn keys(json: Value) -> Keys {
        json.as_object().cloned().unwrap()
    }

    #[test]
    fn what_holds_anyway_is_not_written() {
        let found = json!({
            "name": "oven", "line": "main", "model": "erc8", "address": 3, "protocol": "rtu",
            "baud": 19_200, "parity": "none", "checksum": false,
        });
        let text = add_modules(TEXT, vec![keys(found)]).unwrap();
        let new = "\n[module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
        assert_eq!(text, format!("{TEXT}{new}"));
        let other = json!({"line": "main", "model": "erc8", "address": 4, "baud": 9_600});
        let text = add_modules(&text, vec![keys(other)]).unwrap();
        assert!(
            text.contains("[module.erc8_4]\n") && text.contains("baud = 9600"),
            "{text}"
        );
        assert!(Config::parse(&text).is_ok(), "{text}");
    }

    #[test]
    fn a_module_is_added_with_what_people_call_it() {
        let found = json!({
            "module": "oven", "name": {"en": "Oven", "zh": "烘箱"}, "area": "Hall 2",
            "line": "main", "model": "erc8", "address": 3, "baud": 19_200,
        });
        let nameless =
            json!({"name": {"zh": "水池"}, "line": "main", "model": "erc8", "address": 4});
        let text = add_modules(TEXT, vec![keys(found), keys(nameless)]).unwrap();
        let config = Config::parse(&text).unwrap();
        let oven = &config.modules["oven"];
        assert_eq!(oven.name.zh.as_deref(), Some("烘箱"), "{text}");
        assert_eq!(oven.area.as_deref(), Some("Hall 2"));
        assert_eq!(config.modules["erc8_4"].name.zh.as_deref(), Some("水池"));
    }

    #[test]
    fn what_is_not_there_or_taken_is_told() {
        let code = |end: Result<String, Problem>| end.unwrap_err().code;
        let line = keys(json!({"line": "main", "port": "/dev/ttyUSB1"}));
        assert_eq!(code(add_line(TEXT, line)), codes::ALREADY_THERE.code);
        assert_eq!(
            code(remove(TEXT, "module", "oven")),
            codes::NO_SUCH_MODULE.code
        );
        assert_eq!(
            code(remove_line(TEXT, "yard", true)),
            codes::NO_SUCH_LINE.code
        );
        assert_eq!(code(remove(TEXT, "group", "x")), codes::NO_SUCH_GROUP.code);
        assert_eq!(code(remove(TEXT, "scene", "x")), codes::NO_SUCH_SCENE.code);
        assert_eq!(code(add_modules(TEXT, Vec::new())), codes::BAD_REQUEST.code);
        let nameless = keys(json!({"line": "main"}));
        assert_eq!(
            code(add_modules(TEXT, vec![nameless])),
            codes::BAD_REQUEST.code
        );
    }

    #[test]
    fn a_line_goes_with_its_modules() {
        let found = keys(json!({"line": "main", "model": "erc8", "address": 3}));
        let text = add_modules(TEXT, vec![found]).unwrap();
        let left = remove_line(&text, "main", false).unwrap();
        assert!(Config::parse(&left).is_err(), "a module without its line");
        let left = remove_line(&text, "main", true).unwrap();
        assert_eq!(Config::parse(&left).unwrap(), Config::default());
    }
}
