//! A missing value is either left out or null, and the document says which: a field that is
//! optional is never null. The types of the web pages rely on this.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

/// Bodies of requests by another name. They may be null: a client need not send null.
const ASKED: [&str; 1] = ["SettingsUndo "];

/// The fields of answers that may be null and are not required.
fn unsaid(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let (mut is_answer, mut attributes) = (false, String::new());
    for line in text.lines().map(str::trim) {
        if let Some(name) = line.strip_prefix("pub struct ") {
            // The JSON of a view is that of the type it stands for, which is looked at.
            let is_other = name.contains("Request") || name.contains("View<");
            is_answer = !is_other && !ASKED.iter().any(|one| name.starts_with(one));
        }
        if line.starts_with("#[") {
            attributes.push_str(line);
        } else if !line.starts_with("///") {
            // Of one that is flattened and none, no field is written at all.
            let is_said = ["Option::is_none", "schema(required", "serde(flatten)"]
                .iter()
                .any(|said| attributes.contains(said));
            if is_answer && line.contains(": Option<") && !is_said {
                found.push(line);
            }
            attributes.clear();
        }
    }
    found
}

#[test]
fn a_field_that_need_not_be_there_is_never_null() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut fields = 0;
    for file in std::fs::read_dir(src).unwrap() {
        let path = file.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let text = text.split("#[cfg(test)]").next().unwrap();
        fields += text.matches(": Option<").count();
        assert_eq!(unsaid(text), Vec::<&str>::new(), "{}", path.display());
    }
    assert!(fields > 80, "{fields} are found");
}

#[test]
fn one_that_is_unsaid_is_found() {
    let good = "pub struct A {
        #[serde(default, skip_serializing_if = \"Option::is_none\")]
        pub a: Option<u8>,
        /// Null where it is not known.
        #[schema(required)]
        pub b: Option<u8>,
        #[serde(flatten)]
        pub c: Option<C>,
    }";
    assert_eq!(unsaid(good), Vec::<&str>::new());
    let bad = format!("{good}\npub struct B {{\n pub a: u8,\n pub b: Option<u8>,\n}}");
    assert_eq!(unsaid(&bad), ["pub b: Option<u8>,"]);
    let asked = "pub struct AskRequest {\n pub b: Option<u8>,\n}";
    assert_eq!(unsaid(asked), Vec::<&str>::new());
}
