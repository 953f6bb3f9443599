//! The published schemas, and whether what a command printed is as they say.

use crate::site::{Ran, Site};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// The published schema of a name.
fn published(site: &Site, name: &str) -> Value {
    let text = site.run(&format!("schema {name}")).out;
    serde_json::from_str(&text).expect("JSON")
}

/// The same, ready to judge documents.
pub(crate) fn schema(site: &Site, name: &str) -> jsonschema::Validator {
    jsonschema::validator_for(&published(site, name)).expect("a schema")
}

/// Every document of stdout fits the command's schema, and stderr ends with an error that fits,
/// or holds none. Returns the documents.
#[track_caller]
pub(crate) fn keeps_to(site: &Site, line: &str, ran: &Ran) -> Vec<Value> {
    let names: Vec<String> = site
        .run("schema -o value")
        .out
        .lines()
        .map(str::to_owned)
        .collect();
    let of_schema = |word: &&str| names.iter().any(|name| name == word);
    let verb = line.split(' ').find(of_schema).expect("a command");
    let valid = schema(site, verb);
    let mut documents = Vec::new();
    for document in serde_json::Deserializer::from_str(&ran.out).into_iter::<Value>() {
        let document = document.unwrap_or_else(|error| panic!("{line}: {error}: {ran:?}"));
        let errors: Vec<String> = valid
            .iter_errors(&document)
            .map(|error| error.to_string())
            .collect();
        assert!(errors.is_empty(), "{line}: {errors:?}: {document}");
        documents.push(document);
    }
    if ran.code == 0 {
        assert!(!documents.is_empty(), "{line}: {ran:?}");
        return documents;
    }
    let told: Value = serde_json::from_str(ran.err.lines().last().unwrap_or_default())
        .unwrap_or_else(|error| panic!("{line}: {error}: {ran:?}"));
    assert!(schema(site, "error").is_valid(&told), "{line}: {told}");
    assert_eq!(told["error"]["exit"], ran.code, "{line}: {told}");
    documents
}

/// The forms of a schema that has several, and which of them have been seen.
pub(crate) struct Forms {
    all: Vec<(String, jsonschema::Validator)>,
    seen: BTreeSet<usize>,
}

impl Forms {
    pub(crate) fn of(site: &Site, name: &str) -> Forms {
        let whole = published(site, name);
        let forms = whole["oneOf"].as_array().expect("more than one").iter();
        let parts = whole.get("$defs").cloned().unwrap_or_else(|| json!({}));
        let sound = |form: &Value| {
            let alone = json!({ "$defs": parts, "allOf": [form] });
            let valid = jsonschema::validator_for(&alone).expect("a schema");
            (form.to_string(), valid)
        };
        Forms {
            all: forms.map(sound).collect(),
            seen: BTreeSet::new(),
        }
    }

    pub(crate) fn see(&mut self, documents: &[Value]) {
        for document in documents {
            let fits = |(_, valid): &(String, jsonschema::Validator)| valid.is_valid(document);
            self.seen.extend(self.all.iter().position(fits));
        }
    }

    /// A published form that is never printed is an empty promise.
    #[track_caller]
    pub(crate) fn all_seen(&self) {
        for (index, (form, _)) in self.all.iter().enumerate() {
            assert!(self.seen.contains(&index), "never printed: {form}");
        }
    }
}
