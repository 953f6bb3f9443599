//! `lints`: every crate takes the workspace's lint table, and the core may not panic.

use super::manifest;
use super::report::Report;
use super::rust::Source;
use super::tree::Tree;

/// Crates that run where nothing restarts them.
const CORE: &[&str] = &[
    "crates/wire/src/lib.rs",
    "crates/device/src/lib.rs",
    "crates/bus/src/lib.rs",
];

/// What they deny, because each can panic on input.
const DENIED: &[&str] = &[
    "clippy::unwrap_used",
    "clippy::expect_used",
    "clippy::panic",
    "clippy::indexing_slicing",
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, text) in tree.texts(&["crates/*/Cargo.toml", "xtask/Cargo.toml"]) {
        let taken = manifest::entries(text)
            .iter()
            .any(|entry| entry.path == ["lints", "workspace"] && entry.value == "true");
        if !taken {
            let what = "does not take the workspace's lints";
            report.add(path, 1, what, "add `[lints]` with `workspace = true`");
        }
    }
    for (path, source) in tree.rust(CORE) {
        let denied = denied(&source);
        for lint in DENIED
            .iter()
            .filter(|lint| !denied.contains(&lint.to_string()))
        {
            let what = format!("does not deny {lint}");
            report.add(path, 1, what, "add it to the `#![deny(...)]` at the top");
        }
    }
}

/// Every lint named in an inner `deny` or `forbid`.
fn denied(source: &Source<'_>) -> Vec<String> {
    let openings = ["#![deny(", "#![forbid("];
    let code = source.code();
    openings
        .iter()
        .flat_map(|opening| code.match_indices(opening))
        .flat_map(|(at, opening)| code[at + opening.len()..].split(')').next())
        .flat_map(|list| list.split(','))
        .map(|lint| lint.trim().to_owned())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("lints", check);
        assert_eq!(
            found,
            ["crates/wire/Cargo.toml:1", "crates/wire/src/lib.rs:1"]
        );
    }
}
