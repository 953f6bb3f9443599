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

/// Names that are still defined more than once, and how often. The list only becomes shorter.
const KNOWN: &[(&str, usize)] = &[
    ("Calibration", 2),
    ("Change", 2),
    ("Confirmed", 2),
    ("Engine", 2),
    ("Events", 2),
    ("Failure", 2),
    ("Fault", 2),
    ("Frame", 2),
    ("Heard", 2),
    ("Keeper", 2),
    ("Kind", 3),
    ("Line", 2),
    ("LineConfig", 3),
    ("ModuleId", 2),
    ("Past", 2),
    ("Problem", 2),
    ("Quality", 2),
    ("Reason", 2),
    ("Settings", 2),
    ("Value", 2),
];

/// Where a public type is defined.
struct Definition<'a> {
    path: &'a str,
    line: usize,
}

pub(super) fn check(tree: &Tree, report: &mut Report) {
    check_names(tree, report, KNOWN);
}

fn check_names(tree: &Tree, report: &mut Report, known: &[(&str, usize)]) {
    let names = definitions(tree);
    for (name, definitions) in &names {
        let known = known.iter().find(|(known, _)| known == name);
        let allowed = known.map_or(1, |(_, count)| *count);
        if definitions.len() <= allowed {
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
    for (name, count) in known {
        let found = names.get(*name).map_or(0, Vec::len);
        if found < *count {
            report.add(
                "xtask/src/tidy/unique_names.rs",
                1,
                format!("KNOWN allows {count} types called `{name}`, there are {found}"),
                "lower the number, or take the line out where one is left",
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

    /// A duplicate name, one with more definitions than known, and one that is known as a duplicate
    /// and no longer is.
    #[test]
    fn fixture() {
        let known = [("Place", 2), ("Known", 2), ("Gone", 2)];
        let check = |tree: &Tree, report: &mut Report| check_names(tree, report, &known);
        assert_eq!(
            crate::tidy::found("unique-names", check),
            [
                "crates/bus/src/lib.rs:3",
                "crates/host/src/lib.rs:3",
                "crates/bus/src/lib.rs:6",
                "crates/host/src/lib.rs:6",
                "crates/site/src/lib.rs:2",
                "xtask/src/tidy/unique_names.rs:1",
            ]
        );
    }
}
