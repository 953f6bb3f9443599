//! YAML in blocks. Keys are ours; every text is quoted, whatever is in it.

use super::quote::quoted;
use serde_json::{Map, Value};

/// Keys that say what something is: they come first.
const FIRST: [&str; 5] = ["alert", "job_name", "name", "unique_id", "type"];

/// A document.
pub(super) fn yaml(value: &Value) -> String {
    let mut text = String::new();
    block(value, 0, &mut text);
    text
}

/// Writes a value whose lines begin so many characters to the right.
fn block(value: &Value, indent: usize, text: &mut String) {
    let margin = " ".repeat(indent);
    match value {
        Value::Object(keys) if !keys.is_empty() => {
            for (key, value) in in_order(keys) {
                *text += &format!("{margin}{key}:");
                after(value, indent, text);
            }
        }
        Value::Array(items) if !items.is_empty() => {
            for item in items {
                let mut lines = String::new();
                block(item, indent + 2, &mut lines);
                // The mark stands where the first line is indented.
                *text += &format!("{margin}- {}", &lines[indent + 2..]);
            }
        }
        _ => *text += &format!("{margin}{}\n", scalar(value)),
    }
}

/// Writes what follows a key.
fn after(value: &Value, indent: usize, text: &mut String) {
    match value {
        Value::Object(keys) if !keys.is_empty() => {
            text.push('\n');
            block(value, indent + 2, text);
        }
        Value::Array(items) if !items.is_empty() => {
            text.push('\n');
            block(value, indent + 2, text);
        }
        _ => *text += &format!(" {}\n", scalar(value)),
    }
}

fn in_order(keys: &Map<String, Value>) -> impl Iterator<Item = (&String, &Value)> {
    let first = FIRST.into_iter().filter_map(|key| keys.get_key_value(key));
    let others = keys
        .iter()
        .filter(|(key, _)| !FIRST.contains(&key.as_str()));
    first.chain(others)
}

fn scalar(value: &Value) -> String {
    match value {
        Value::String(text) => quoted(text),
        Value::Number(number) => match number.as_f64().filter(|_| number.is_f64()) {
            // Without an exponent, which not every reader takes for one.
            Some(number) => number.to_string(),
            None => number.to_string(),
        },
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    #[test]
    fn what_something_is_comes_first() {
        let value = json!({
            "list": [{ "b": 1, "name": "x", "a": { "c": [true, "y"] } }, "z", []],
            "empty": {},
        });
        let text = "empty: {}\nlist:\n  - name: \"x\"\n    a:\n      c:\n        - true\n        \
                    - \"y\"\n    b: 1\n  - \"z\"\n  - []\n";
        assert_eq!(yaml(&value), text);
    }

    fn values() -> impl Strategy<Value = Value> {
        let leaf = prop_oneof![
            any::<bool>().prop_map(Value::from),
            any::<i32>().prop_map(Value::from),
            (-1e6..1e6).prop_map(Value::from),
            any::<String>().prop_map(Value::from),
        ];
        leaf.prop_recursive(4, 32, 4, |inner| {
            prop_oneof![
                prop::collection::vec(inner.clone(), 0..4).prop_map(Value::from),
                prop::collection::btree_map("[a-z]{1,8}", inner, 0..4)
                    .prop_map(|keys| keys.into_iter().collect::<Map<_, _>>().into()),
            ]
        })
    }

    proptest! {
        #[test]
        fn every_value_is_itself_again(value in values()) {
            // A key can be a word of YAML: ours are none.
            let value = keyed(value);
            let parsed: Value = serde_yaml_ng::from_str(&yaml(&value)).unwrap();
            prop_assert_eq!(whole(parsed), whole(value));
        }
    }

    fn keyed(value: Value) -> Value {
        match value {
            Value::Object(keys) => {
                let each = |(key, value)| (format!("{key}_"), keyed(value));
                keys.into_iter().map(each).collect()
            }
            Value::Array(items) => items.into_iter().map(keyed).collect(),
            other => other,
        }
    }

    /// A number is one number, however it is written.
    fn whole(value: Value) -> Value {
        match value {
            Value::Object(keys) => keys.into_iter().map(|(k, v)| (k, whole(v))).collect(),
            Value::Array(items) => items.into_iter().map(whole).collect(),
            Value::Number(number) => json!(number.as_f64()),
            other => other,
        }
    }
}
