//! `core-purity`: the core runs in firmware and in virtual time, so it uses no clock, no thread, no
//! socket, and below `bus` no heap. The compiler enforces most of this; the check covers what a
//! `std` crate or an `extern crate` would allow.

use super::report::Report;
use super::rust::find_word;
use super::tree::Tree;

/// What the sources of one crate must and must not contain.
struct Rule {
    name: &'static str,
    /// Inner attributes of `lib.rs`.
    attributes: &'static [&'static str],
    /// Words that shipped code must not contain, grouped by reason.
    words: &'static [&'static [&'static str]],
}

const STD: &[&str] = &["std::", "extern crate std"];
const HEAP: &[&str] = &["alloc::", "extern crate alloc"];
const CLOCK: &[&str] = &["Instant::now", "SystemTime", "std::time"];
const IO: &[&str] = &[
    "TcpListener",
    "TcpStream",
    "UdpSocket",
    "UnixStream",
    "std::fs",
    "std::io",
    "std::net",
    "std::process",
    "std::thread",
    "thread::spawn",
    "tokio",
];
const NO_STD: &[&str] = &["#![no_std]", "#![forbid(unsafe_code)]"];

const RULES: &[Rule] = &[
    Rule {
        name: "wire",
        attributes: NO_STD,
        words: &[STD, HEAP, CLOCK, IO],
    },
    Rule {
        name: "device",
        attributes: NO_STD,
        words: &[STD, HEAP, CLOCK, IO],
    },
    Rule {
        name: "nvm",
        attributes: NO_STD,
        words: &[STD, HEAP, CLOCK, IO],
    },
    Rule {
        name: "bus",
        attributes: NO_STD,
        words: &[STD, CLOCK, IO],
    },
    Rule {
        name: "sim",
        attributes: &["#![forbid(unsafe_code)]"],
        words: &[CLOCK, IO],
    },
    Rule {
        name: "sniff",
        attributes: &["#![forbid(unsafe_code)]"],
        words: &[CLOCK, IO],
    },
    Rule {
        name: "commission",
        attributes: &["#![forbid(unsafe_code)]"],
        words: &[CLOCK, IO],
    },
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for rule in RULES
        .iter()
        .filter(|rule| tree.has_folder(&format!("crates/{}", rule.name)))
    {
        attributes(tree, report, rule);
        words(tree, report, rule);
    }
}

fn attributes(tree: &Tree, report: &mut Report, rule: &Rule) {
    let lib = format!("crates/{}/src/lib.rs", rule.name);
    let text = tree.text(&lib).unwrap_or_default();
    for attribute in rule.attributes {
        if !text.lines().any(|line| line.trim_end() == *attribute) {
            let what = format!("`{attribute}` is missing");
            report.add(
                &lib,
                1,
                what,
                "put it on a line of its own above the modules",
            );
        }
    }
}

fn words(tree: &Tree, report: &mut Report, rule: &Rule) {
    for (path, source) in tree.rust(&[&format!("crates/{}/src/", rule.name)]) {
        for (line, code) in source.shipped_lines() {
            let words = || rule.words.iter().copied().flatten();
            if let Some(word) = words().find(|word| find_word(code, word).is_some()) {
                report.add(
                    path,
                    line,
                    format!("crates/{} must not use `{word}`", rule.name),
                    "take time and bytes as arguments; if only tests need it, use #[cfg(test)]",
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("core-purity", check);
        assert_eq!(
            found,
            [
                "crates/wire/src/lib.rs:1",
                "crates/wire/src/lib.rs:4",
                "crates/wire/src/lib.rs:7",
                "crates/bus/src/lib.rs:6",
                "crates/sim/src/lib.rs:4",
                "crates/commission/src/lib.rs:5",
            ]
        );
    }
}
