//! Changes single tables of a configuration file's text: comments, blank lines and everything else
//! stay as written. The caller checks whether the result is a valid configuration.

use serde_json::{Map, Value as Json};
use toml_edit::{Array, DocumentMut, InlineTable, Item, Key, Table, TableLike, Value, value};

/// Why a text was not changed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The text is no TOML, or there is something else where a table should be.
    Text,
    /// There is no such table.
    NotThere,
    /// The name is taken.
    Taken,
    /// The value of this key can't be written in TOML.
    Value(String),
}

/// Keys with their values, as they come in a request.
pub type Keys = Map<String, Json>;

/// The keys that a reader looks for first.
const FIRST: [&str; 13] = [
    "port", "line", "model", "address", "protocol", "name", "when", "for", "then", "point", "set",
    "pulse", "time",
];

/// The keys of a table as written, with those of its subtables; `None` if there is no such table.
#[must_use]
pub fn keys_of(text: &str, path: &[&str]) -> Option<Keys> {
    let document: DocumentMut = text.parse().ok()?;
    let mut at = document.as_item();
    for word in path {
        at = at.as_table_like()?.get(word)?;
    }
    at.as_table_like().map(read_keys)
}

fn read_keys(table: &dyn TableLike) -> Keys {
    let read = |(key, item): (&str, &Item)| Some((key.to_owned(), read_item(item)?));
    table.iter().filter_map(read).collect()
}

fn read_item(item: &Item) -> Option<Json> {
    match item {
        Item::None => None,
        Item::Value(value) => Some(read_value(value)),
        Item::Table(table) => Some(Json::Object(read_keys(table))),
        Item::ArrayOfTables(tables) => {
            let tables = tables.iter().map(|table| Json::Object(read_keys(table)));
            Some(tables.collect())
        }
    }
}

fn read_value(value: &Value) -> Json {
    match value {
        Value::String(text) => text.value().as_str().into(),
        Value::Integer(number) => (*number.value()).into(),
        Value::Float(number) => (*number.value()).into(),
        Value::Boolean(is) => (*is.value()).into(),
        Value::Datetime(time) => time.value().to_string().into(),
        Value::Array(list) => list.iter().map(read_value).collect(),
        Value::InlineTable(table) => Json::Object(read_keys(table)),
    }
}

/// Sets keys of a table, which is created if missing. A key with null is removed. Times can be
/// given in milliseconds: `max_age_ms = 500` sets `max_age = "500ms"`.
///
/// # Errors
/// [`Refused`].
pub fn set(text: &str, path: &[&str], keys: &Keys) -> Result<String, Refused> {
    changed(text, |document| {
        let mut at = document.as_item_mut();
        for (depth, word) in path.iter().enumerate() {
            at = child(at, word, new_table(path, depth)).ok_or(Refused::Text)?;
        }
        set_keys(at.as_table_like_mut().ok_or(Refused::Text)?, keys)
    })
}

/// As [`set`], and removes all other keys.
///
/// # Errors
/// [`Refused`].
pub fn put(text: &str, path: &[&str], keys: &Keys) -> Result<String, Refused> {
    let wanted: Vec<String> = keys
        .iter()
        .map(|(key, json)| written_key(key, json).0)
        .collect();
    let kept = changed(text, |document| {
        let Some(at) = find(document, path) else {
            return Ok(());
        };
        let table = at.as_table_like_mut().ok_or(Refused::Text)?;
        let old: Vec<String> = table.iter().map(|(key, _)| key.to_owned()).collect();
        for key in old.iter().filter(|key| !wanted.contains(key)) {
            table.remove(key);
        }
        Ok(())
    })?;
    set(&kept, path, keys)
}

/// Removes a table.
///
/// # Errors
/// [`Refused`].
pub fn remove(text: &str, path: &[&str]) -> Result<String, Refused> {
    changed(text, |document| {
        let (name, above) = path.split_last().ok_or(Refused::NotThere)?;
        let above = find(document, above).and_then(Item::as_table_like_mut);
        let gone = above.and_then(|table| table.remove(name));
        gone.map(|_| ()).ok_or(Refused::NotThere)
    })
}

/// Renames a line or a module, and every reference to it.
///
/// # Errors
/// [`Refused`].
pub fn rename(text: &str, kind: &str, old: &str, new: &str) -> Result<String, Refused> {
    changed(text, |document| {
        let tables = find(document, &[kind]).ok_or(Refused::NotThere)?;
        if tables
            .as_table_like()
            .is_some_and(|tables| tables.contains_key(new))
        {
            return Err(Refused::Taken);
        }
        match tables {
            Item::Table(tables) => {
                let (_, item) = tables.remove_entry(old).ok_or(Refused::NotThere)?;
                tables.insert_formatted(&Key::new(new), item);
            }
            Item::Value(Value::InlineTable(tables)) => {
                let (_, item) = tables.remove_entry(old).ok_or(Refused::NotThere)?;
                tables.insert(new, item);
            }
            _ => return Err(Refused::Text),
        }
        name_anew(document.as_item_mut(), kind, old, new);
        Ok(())
    })
}

fn changed(
    text: &str,
    change: impl FnOnce(&mut DocumentMut) -> Result<(), Refused>,
) -> Result<String, Refused> {
    let mut document: DocumentMut = text.parse().map_err(|_| Refused::Text)?;
    // Otherwise the comments at the end would come after what is added there.
    let end = document.trailing().as_str().unwrap_or_default().to_owned();
    document.set_trailing("");
    let before = document.to_string();
    change(&mut document)?;
    let after = document.to_string();
    let added = after
        .strip_prefix(&before)
        .filter(|added| !added.is_empty());
    Ok(match added {
        Some(added) if end.is_empty() || end.ends_with('\n') => before + &end + added,
        Some(added) => before + &end + "\n" + added,
        None => after + &end,
    })
}

fn find<'d>(document: &'d mut DocumentMut, path: &[&str]) -> Option<&'d mut Item> {
    let mut at = document.as_item_mut();
    for word in path {
        at = below(at, word)?;
    }
    Some(at)
}

/// A new table as it is usually written: `[module.pump]` and `[module.pump.point]` have headers,
/// the settings of a point are `do0.name = …`.
fn new_table(path: &[&str], depth: usize) -> Table {
    let mut table = Table::new();
    match depth {
        0 => table.set_implicit(true),
        1 | 2 => table.decor_mut().set_prefix("\n"),
        _ => table.set_dotted(true),
    }
    if path.len() == 1 {
        table.set_implicit(false);
    }
    table
}

fn child<'i>(parent: &'i mut Item, key: &str, new: Table) -> Option<&'i mut Item> {
    match parent {
        Item::Table(table) => Some(table.entry(key).or_insert(Item::Table(new))),
        Item::Value(Value::InlineTable(table)) => {
            if !table.contains_key(key) {
                table.insert(key, new.into_inline_table().into());
            }
            TableLike::get_mut(table, key)
        }
        _ => None,
    }
}

/// In the usual order: the keys looked for first come first.
fn in_order(keys: &Keys) -> Vec<(&String, &Json)> {
    let place = |key: &str| {
        let key = key.strip_suffix("_ms").unwrap_or(key);
        FIRST.iter().position(|first| *first == key)
    };
    let mut keys: Vec<_> = keys.iter().collect();
    keys.sort_by_key(|(key, _)| place(key).unwrap_or(FIRST.len()));
    keys
}

fn set_keys(table: &mut dyn TableLike, keys: &Keys) -> Result<(), Refused> {
    for (key, json) in in_order(keys) {
        let (key, wanted) = written_key(key, json);
        let Some(wanted) = wanted.map_err(|()| Refused::Value(key.clone()))? else {
            table.remove(&key);
            continue;
        };
        match table.get_mut(&key) {
            Some(Item::Value(old)) => {
                let decor = old.decor().clone();
                *old = wanted;
                *old.decor_mut() = decor;
            }
            // A table with its own header, or a dotted one, becomes an inline value.
            Some(_) => {
                table.remove(&key);
                table.insert(&key, value(wanted));
            }
            None => {
                table.insert(&key, value(wanted));
            }
        }
    }
    Ok(())
}

/// A key and its value as the configuration writes them; no value if the key is to be removed.
fn written_key(key: &str, json: &Json) -> (String, Result<Option<Value>, ()>) {
    match (key.strip_suffix("_ms"), json) {
        (Some(short), Json::Null) => (short.to_owned(), Ok(None)),
        (Some(short), Json::Number(number)) => {
            let text = number.as_u64().map(|ms| match ms % 1_000 {
                0 => Value::from(format!("{}s", ms / 1_000)),
                _ => Value::from(format!("{ms}ms")),
            });
            (short.to_owned(), text.map(Some).ok_or(()))
        }
        _ => (key.to_owned(), written(json)),
    }
}

/// A value as the configuration writes it. An empty table is left out.
fn written(json: &Json) -> Result<Option<Value>, ()> {
    Ok(Some(match json {
        Json::Null => return Ok(None),
        Json::Bool(truth) => Value::from(*truth),
        Json::String(text) => Value::from(text.as_str()),
        Json::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(whole), _) => Value::from(whole),
            (None, Some(real)) if !number.is_u64() => Value::from(real),
            _ => return Err(()),
        },
        Json::Array(items) => {
            let mut array = Array::new();
            for item in items {
                array.push(written(item)?.ok_or(())?);
            }
            Value::Array(array)
        }
        Json::Object(keys) => {
            let mut table = InlineTable::new();
            for (key, json) in in_order(keys) {
                let (key, item) = written_key(key, json);
                if let Some(item) = item? {
                    table.insert(key, item);
                }
            }
            if table.is_empty() {
                return Ok(None);
            }
            Value::InlineTable(table)
        }
    }))
}

/// Replaces the name of a line or a module in every reference: alone, or before the label of a
/// point.
fn name_anew(root: &mut Item, kind: &str, old: &str, new: &str) {
    let alone = |text: &str| (text == old).then(|| new.to_owned());
    let before = format!("{old}.");
    let with_point = |text: &str| {
        let label = text.strip_prefix(&before)?;
        (!label.contains(char::is_whitespace)).then(|| format!("{new}.{label}"))
    };
    let offline = format!("{kind}_offline");
    each_of(root, "rule", &["when", &offline], &alone);
    match kind {
        "line" => {
            each_of(root, "module", &["line"], &alone);
            for table in ["webhook", "outlet"] {
                each_of(root, table, &["lines"], &alone);
            }
        }
        _ => {
            for table in ["webhook", "outlet"] {
                each_of(root, table, &["modules"], &alone);
            }
            let before_unit = |text: &str| {
                let (name, unit) = text.split_once('=')?;
                (name.trim() == old).then(|| format!("{new}={unit}"))
            };
            each_of(root, "outlet", &["units"], &before_unit);
            each_of(root, "outlet", &["write"], &alone);
            each_of(root, "outlet", &["write"], &with_point);
            each_of(root, "module", &["point"], &with_point);
            for table in ["group", "scene", "rule"] {
                each_of(root, table, &[], &with_point);
            }
        }
    }
}

/// Every text under this path in each of the tables `[table.x]`.
fn each_of(root: &mut Item, table: &str, way: &[&str], renamed: &impl Fn(&str) -> Option<String>) {
    let tables = below(root, table).and_then(Item::as_table_like_mut);
    for (_, one) in tables.into_iter().flat_map(|tables| tables.iter_mut()) {
        if let Some(found) = way.iter().try_fold(one, |at, key| below(at, key)) {
            each_text(found, renamed);
        }
    }
}

/// The value of a key. Indexing the item instead would insert the key.
fn below<'i>(item: &'i mut Item, key: &str) -> Option<&'i mut Item> {
    item.as_table_like_mut()?.get_mut(key)
}

/// Every text below an item except display names.
fn each_text(item: &mut Item, renamed: &impl Fn(&str) -> Option<String>) {
    match item {
        Item::Value(value) => each_value(value, renamed),
        Item::Table(table) => {
            let items = table.iter_mut().filter(|(key, _)| *key != "name");
            items.for_each(|(_, item)| each_text(item, renamed));
        }
        Item::ArrayOfTables(tables) => {
            let items = tables.iter_mut().flat_map(|table| table.iter_mut());
            items.for_each(|(_, item)| each_text(item, renamed));
        }
        Item::None => {}
    }
}

fn each_value(value: &mut Value, renamed: &impl Fn(&str) -> Option<String>) {
    match value {
        Value::String(text) => {
            if let Some(new) = renamed(text.value()) {
                let decor = text.decor().clone();
                *value = Value::from(new);
                *value.decor_mut() = decor;
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| each_value(item, renamed)),
        Value::InlineTable(table) => {
            let items = table.iter_mut().filter(|(key, _)| *key != "name");
            items.for_each(|(_, item)| each_value(item, renamed));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::super::Config;
    use super::*;
    use serde_json::json;

    const TEXT: &str = "# our site\n[line.main] # the only one\nport = \"/dev/ttyUSB0\"\n\n\
        # in the cellar\n[module.pump]\nline = \"main\" # short\nmodel = \"eda9060a\"\n\
        address = 1    # DIP has none\n\n[module.pump.point]\n\
        do0.name = { en = \"Pump 1\", zh = \"一号水泵\" } # new\n\n\
        [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

    fn keys(json: Json) -> Keys {
        json.as_object().cloned().unwrap()
    }

    #[test]
    fn only_what_is_set_changes() {
        let text = set(
            TEXT,
            &["module", "pump"],
            &keys(json!({"address": 9, "max_age_ms": 500})),
        );
        let wanted = TEXT
            .replace("address = 1    #", "address = 9    #")
            .replace("none\n", "none\nmax_age = \"500ms\"\n");
        assert_eq!(text.as_deref(), Ok(wanted.as_str()));
        assert!(Config::parse(&wanted).is_ok());
        let back = set(
            &wanted,
            &["module", "pump"],
            &keys(json!({"address": 1, "max_age": null})),
        );
        assert_eq!(back.as_deref(), Ok(TEXT));
    }

    #[test]
    fn a_point_gets_a_name_and_a_lock() {
        let path = ["module", "pump", "point", "do0"];
        let named = json!({"name": {"en": "Well", "zh": null}, "locked": true});
        let text = set(TEXT, &path, &keys(named)).unwrap();
        let new = "do0.name = { en = \"Well\" } # new\ndo0.locked = true\n";
        assert!(text.contains(new), "{text}");
        let other = ["module", "oven", "point", "k1"];
        let text = set(&text, &other, &keys(json!({"name": "Heater"}))).unwrap();
        assert!(
            text.ends_with("\n[module.oven.point]\nk1.name = \"Heater\"\n"),
            "{text}"
        );
        let config = Config::parse(&text).unwrap();
        assert_eq!(config.modules["oven"].points.len(), 1);
        let text = set(&text, &other, &keys(json!({"name": {}}))).unwrap();
        assert!(!text.contains("Heater"), "{text}");
        assert!(Config::parse(&text).is_ok());
    }

    #[test]
    fn what_is_new_is_written_with_a_head() {
        let line = keys(json!({"port": "/dev/ttyUSB1"}));
        let text = set(TEXT, &["line", "yard"], &line).unwrap();
        let new = "\"/dev/ttyUSB0\"\n\n[line.yard]\nport = \"/dev/ttyUSB1\"\n\n# in";
        assert!(text.contains(new), "{text}");
        assert_eq!(Config::parse(&text).unwrap().lines.len(), 2);
        let ended = "[line.main]\nport = \"/dev/ttyUSB0\"\n# the end";
        let text = set(ended, &["line", "yard"], &line).unwrap();
        let new = "\n\n[line.yard]\nport = \"/dev/ttyUSB1\"\n";
        assert_eq!(text, format!("{ended}{new}"));
        let text = set("", &["line", "yard"], &line).unwrap();
        assert_eq!(text.trim_start(), "[line.yard]\nport = \"/dev/ttyUSB1\"\n");
    }

    #[test]
    fn a_table_goes_and_the_rest_stays() {
        let text = remove(TEXT, &["module", "pump"]).unwrap();
        assert!(
            !text.contains("pump") && text.contains("# our site"),
            "{text}"
        );
        assert_eq!(Config::parse(&text).unwrap().modules.len(), 1);
        assert_eq!(remove(TEXT, &["module", "tank"]), Err(Refused::NotThere));
        assert_eq!(remove("", &["module", "tank"]), Err(Refused::NotThere));
        assert_eq!(remove("[line", &["line", "a"]), Err(Refused::Text));
    }

    #[test]
    fn a_new_name_holds_wherever_it_is_named() {
        let text = rename(TEXT, "line", "main", "south").unwrap();
        let config = Config::parse(&text).unwrap();
        assert!(config.modules.values().all(|module| module.line == "south"));
        assert!(text.contains("line = \"south\" # short"), "{text}");
        let more = format!(
            "{TEXT}\n[group.night]\nmembers = [\"pump.do0\", \"oven.k1\"]\nname = \"pump.do0\"\n"
        );
        let text = rename(&more, "module", "pump", "well").unwrap();
        let wanted = more
            .replace("[module.pump", "[module.well")
            .replace("[\"pump.do0\"", "[\"well.do0\"");
        assert_eq!(text, wanted);
        assert_eq!(rename(TEXT, "module", "pump", "oven"), Err(Refused::Taken));
        assert_eq!(
            rename(TEXT, "module", "tank", "well"),
            Err(Refused::NotThere)
        );
    }

    #[test]
    fn a_table_is_put_whole() {
        let night = json!({"members": ["oven.k1"], "name": {"en": "Night"}});
        let text = put(TEXT, &["group", "night"], &keys(night)).unwrap();
        let new = "\n[group.night]\nname = { en = \"Night\" }\nmembers = [\"oven.k1\"]\n";
        assert!(text.ends_with(new), "{text}");
        let less = json!({"members": ["oven.k2"]});
        let text = put(&text, &["group", "night"], &keys(less)).unwrap();
        assert!(
            text.ends_with("\n[group.night]\nmembers = [\"oven.k2\"]\n"),
            "{text}"
        );
    }

    #[test]
    fn tables_in_one_line_are_changed_there() {
        let text = "line.main = { port = \"/dev/ttyUSB0\" }\n\
            module = { oven = { line = \"main\", model = \"erc8\", address = 3 } }\n";
        let path = ["module", "oven", "point", "k1"];
        let text = set(text, &path, &keys(json!({"locked": true}))).unwrap();
        let config = Config::parse(&text).unwrap();
        assert!(
            config.modules["oven"]
                .points
                .values()
                .all(|point| point.locked),
            "{text}"
        );
    }

    #[test]
    fn keys_are_read_as_they_can_be_set() {
        let text = "[module.oven]\naddress = 0x03\nname = { zh = \"烘箱\" }\n\
            [module.oven.point]\nk1.interlock = [\"oven.k2\"]\nk2 = { locked = true }\n";
        let read = keys_of(text, &["module", "oven"]).unwrap();
        let expected = json!({
            "address": 3, "name": {"zh": "烘箱"},
            "point": {"k1": {"interlock": ["oven.k2"]}, "k2": {"locked": true}},
        });
        assert_eq!(Json::Object(read), expected);
        assert_eq!(keys_of(text, &["module", "gate"]), None);
        assert_eq!(keys_of(text, &["module", "oven", "address"]), None);
    }

    #[test]
    fn what_can_not_be_written_is_refused() {
        let path = ["module", "oven"];
        for wrong in [
            json!({"a": u64::MAX}),
            json!({"a_ms": -1}),
            json!({"a": [null]}),
        ] {
            let refused = set(TEXT, &path, &keys(wrong));
            assert_eq!(refused, Err(Refused::Value("a".to_owned())));
        }
        let port = ["line", "main", "port"];
        assert_eq!(set(TEXT, &port, &keys(json!({"a": 1}))), Err(Refused::Text));
    }
}
