//! `deny-named`: every direct dependency is listed in `deny.toml` with its purpose and licence, and
//! no other package is. The lines are comments, which cargo-deny ignores:
//!
//! `# dep: clap — command line — MIT OR Apache-2.0`

use std::collections::BTreeMap;

use super::manifest;
use super::report::Report;
use super::tree::Tree;

const DENY: &str = "deny.toml";

pub(super) fn check(tree: &Tree, report: &mut Report) {
    let used = used(tree);
    let mut named = Vec::new();
    for (index, line) in tree.text(DENY).unwrap_or_default().lines().enumerate() {
        let Some(entry) = line.strip_prefix("# dep: ") else {
            continue;
        };
        let parts: Vec<&str> = entry.split(" — ").collect();
        let name = parts[0];
        if parts.len() != 3 || parts.iter().any(|part| part.trim().is_empty()) {
            let next = "write `# dep: name — what for — licence`";
            report.add(
                DENY,
                index + 1,
                format!("`{name}` is not fully described"),
                next,
            );
        } else if !used.contains_key(name) {
            let next = "take the line away";
            report.add(
                DENY,
                index + 1,
                format!("no Cargo.toml asks for `{name}`"),
                next,
            );
        }
        named.push(name);
    }
    for (package, (path, line)) in used
        .iter()
        .filter(|(name, _)| !named.contains(&name.as_str()))
    {
        let what = format!("`{package}` is not named in {DENY}");
        let next = format!("add `# dep: {package} — what for — licence` there");
        report.add(path, *line, what, next);
    }
}

/// Every third-party package, and where it is first used.
fn used(tree: &Tree) -> BTreeMap<String, (&str, usize)> {
    let mut used = BTreeMap::new();
    for (path, text) in tree.texts(&["Cargo.toml", "**/Cargo.toml"]) {
        for dependency in manifest::dependencies(text) {
            if !dependency.package.starts_with("railbus") {
                used.entry(dependency.package)
                    .or_insert((path, dependency.line));
            }
        }
    }
    used
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("deny-named", check);
        assert_eq!(
            found,
            ["deny.toml:2", "deny.toml:3", "crates/host/Cargo.toml:6"]
        );
    }
}
