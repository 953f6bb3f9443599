//! `families`: what differs between families is data of `device`, which all others read. And the
//! recipe in `CONTRIBUTING.md` names every file that a new family needs.

use super::report::Report;
use super::rust::Source;
use super::tree::{Tree, matches};

/// Where families are told apart.
const HOME: &str = "crates/device/";

/// Files that may name a family outside `device`, and why. None of them decides anything by it.
const ALLOWED: &[(&str, &str)] = &[("crates/sim/src/demo.rs", "the modules of the demo line")];

/// Its default features are the names of all families.
const FEATURES: &str = "crates/device/Cargo.toml";

const RECIPE: &str = "CONTRIBUTING.md";
const HEADING: &str = "## Adding a family";
/// Stands in the recipe for the name of a family.
const PLACEHOLDER: &str = "<family>";

/// What names families to try them or to describe them, and need not name all.
const NOT_IN_RECIPE: &[&str] = &[
    "**.md",
    "docs/**",
    "interop/**",
    "vectors/**",
    "**/tests/**",
    "**/tests.rs",
    "**/examples/**",
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, source) in tree.rust(&["crates/*/src/"]) {
        let allowed = ALLOWED.iter().any(|(pattern, _)| matches(pattern, path));
        if path.starts_with(HOME) || allowed {
            continue;
        }
        for (line, code) in source.shipped_lines() {
            if names_variant(code) {
                report.add(
                    path,
                    line,
                    "names a family",
                    "put what differs into the `Datasheet` of the family, and read it here",
                );
            }
        }
    }
    check_recipe(tree, report);
}

/// Whether the line names one family, as `Family::Erc8`; `Family::ALL` names none.
fn names_variant(code: &str) -> bool {
    code.match_indices("Family::").any(|(at, found)| {
        let mut rest = code[at + found.len()..].chars();
        let starts = rest.next().is_some_and(char::is_uppercase);
        let is_own = !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        is_own && starts && rest.next().is_some_and(|c| !c.is_uppercase())
    })
}

/// Every file that names all families must be in the recipe, and what the recipe names must exist.
fn check_recipe(tree: &Tree, report: &mut Report) {
    let families = families(tree);
    let recipe = recipe(tree);
    if families.is_empty() || recipe.is_empty() {
        report.add(
            RECIPE,
            1,
            format!("no recipe `{HEADING}`, or no default features in {FEATURES}"),
            "name the files that a new family needs",
        );
        return;
    }
    for (path, text) in tree.texts(&["**"]) {
        let tries = NOT_IN_RECIPE.iter().any(|pattern| matches(pattern, path));
        let is_named = recipe.iter().any(|(_, named)| path == *named);
        if !tries && !is_named && names_all(path, text, &families) {
            report.add(
                path,
                1,
                format!("names every family, and is not in the recipe of {RECIPE}"),
                "name it there, or read the families from crates/device",
            );
        }
    }
    for (line, named) in recipe {
        let mut needed = families.iter().map(|name| named.replace(PLACEHOLDER, name));
        if let Some(missing) = needed.find(|path| !exists(tree, path)) {
            report.add(
                RECIPE,
                line,
                format!("there is no {missing}"),
                "name the file that a new family needs instead",
            );
        }
    }
}

/// The names of all families, as in flags and configuration.
fn families(tree: &Tree) -> Vec<&str> {
    let text = tree.text(FEATURES).unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with("default = ["));
    let names = line.unwrap_or_default().split('"').skip(1).step_by(2);
    names.collect()
}

/// The paths in the recipe, with their lines: whatever has a `/` between two backticks.
fn recipe(tree: &Tree) -> Vec<(usize, &str)> {
    let text = tree.text(RECIPE).unwrap_or_default();
    let mut inside = false;
    let mut paths = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.starts_with("## ") {
            inside = line.starts_with(HEADING);
        }
        if inside {
            let quoted = line.split('`').skip(1).step_by(2);
            let named = quoted.filter(|word| word.contains('/') && !word.contains(' '));
            paths.extend(named.map(|path| (index + 1, path)));
        }
    }
    paths
}

/// Whether the file, its comments and tests aside, names all of them.
fn names_all(path: &str, text: &str, families: &[&str]) -> bool {
    let shipped = if path.ends_with(".rs") {
        let source = Source::parse(text);
        let comments = source.comment_lines();
        let lines = text.split('\n').zip(comments);
        let mut start = 0;
        let mut kept = String::new();
        for (line, (_, comment)) in lines {
            if source.is_shipped(start) {
                let code = line.len() - comment.trim_start().len();
                kept.push_str(line.get(..code).unwrap_or(line));
                kept.push('\n');
            }
            start += line.len() + 1;
        }
        kept
    } else {
        text.to_owned()
    };
    let shipped = shipped.to_lowercase().replace('-', "");
    families.iter().all(|name| shipped.contains(name))
}

fn exists(tree: &Tree, path: &str) -> bool {
    match path.strip_suffix('/') {
        Some(folder) => tree.has_folder(folder),
        None => tree.text(path).is_some() || tree.has_folder(path),
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    /// A family is named in `site`; a file names all of them and is not in the recipe; and the
    /// recipe names what is not there.
    #[test]
    fn fixture() {
        assert_eq!(
            crate::tidy::found("families", check),
            [
                "crates/site/src/lib.rs:5",
                "firmware/Cargo.toml:1",
                "CONTRIBUTING.md:6",
            ]
        );
    }
}
