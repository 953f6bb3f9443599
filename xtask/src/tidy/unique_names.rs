//! `unique-names`: the name of a public type is unique in the workspace. If two types share a name,
//! every import raises the question which one is meant.

use std::collections::BTreeMap;

use super::report::Report;
use super::rust::Source;
use super::tree::Tree;

/// Names that every crate may define: its module path says which one is meant.
const ANYWHERE: &[&str] = &["Config", "Error", "Event", "Input", "Output"];

/// Types that each protocol of `wire` has under the same name: `rtu::Request`, `ascii::Request`.
/// Together they count as one definition.
const PER_PROTOCOL: &[&str] = &["Exchange", "Request", "Response"];
const PROTOCOLS: &str = "crates/wire/src/";

/// A program: no crate imports from it.
const BINARY: &str = "crates/railbus/";

/// Where a public type is defined.
struct Definition<'a> {
    path: &'a str,
    line: usize,
}

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (name, definitions) in &definitions(tree) {
        if definitions.len() == 1 {
            continue;
        }
        for definition in definitions {
            let others = definitions
                .iter()
                .filter(|other| other.path != definition.path);
            let others: Vec<_> = others.map(|other| other.path).collect();
            report.add(
                definition.path,
                definition.line,
                format!("`{name}` is also defined in {}", others.join(", ")),
                "name it after what only this one is",
            );
        }
    }
}

/// The public types of the library crates by their names.
fn definitions(tree: &Tree) -> BTreeMap<String, Vec<Definition<'_>>> {
    let mut names: BTreeMap<String, Vec<Definition<'_>>> = BTreeMap::new();
    for (path, source) in tree.rust(&["crates/*/src/"]) {
        if path.starts_with(BINARY) {
            continue;
        }
        for (line, name) in types(&source) {
            let of_name = names.entry(name.clone()).or_default();
            let is_shared = PER_PROTOCOL.contains(&name.as_str()) && path.starts_with(PROTOCOLS);
            let is_counted = |known: &Definition<'_>| known.path.starts_with(PROTOCOLS);
            if !(is_shared && of_name.iter().any(is_counted)) {
                of_name.push(Definition { path, line });
            }
        }
    }
    names.retain(|name, _| !ANYWHERE.contains(&name.as_str()));
    names
}

/// The lines that define public types, with their names.
fn types(source: &Source<'_>) -> Vec<(usize, String)> {
    let lines = source.shipped_lines();
    lines
        .filter_map(|(line, code)| {
            let (kind, rest) = code.trim_start().strip_prefix("pub ")?.split_once(' ')?;
            if !["struct", "enum", "trait", "type"].contains(&kind) {
                return None;
            }
            let name = rest
                .split(|c: char| !c.is_alphanumeric() && c != '_')
                .next()?;
            Some((line, name.to_owned()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names that two crates have, and one that three have.
    #[test]
    fn fixture() {
        assert_eq!(
            crate::tidy::found("unique-names", check),
            [
                "crates/bus/src/lib.rs:5",
                "crates/host/src/lib.rs:2",
                "crates/bus/src/lib.rs:3",
                "crates/host/src/lib.rs:3",
                "crates/bus/src/lib.rs:6",
                "crates/host/src/lib.rs:6",
                "crates/site/src/lib.rs:2",
            ]
        );
    }
}
