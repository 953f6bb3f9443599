//! `files-size`: a file that is too long to keep in mind is several files.

use super::report::Report;
use super::tree::{Tree, matches};

const LINES_MAX: usize = 700;

/// Files that may be longer, and why.
const ALLOWED: &[(&str, &str)] = &[];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    check_lines(tree, report, LINES_MAX);
}

fn check_lines(tree: &Tree, report: &mut Report, lines_max: usize) {
    for (path, text) in tree.texts(&["**.rs"]) {
        let lines = text.lines().count();
        if lines > lines_max && !ALLOWED.iter().any(|(pattern, _)| matches(pattern, path)) {
            report.add(
                path,
                lines_max + 1,
                format!("{lines} lines, {lines_max} are allowed"),
                "split it where its parts would have names of their own",
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixture() {
        let check = |tree: &Tree, report: &mut Report| check_lines(tree, report, 4);
        assert_eq!(
            crate::tidy::found("files-size", check),
            ["crates/wire/src/long.rs:5"]
        );
    }
}
