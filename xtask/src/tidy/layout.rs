//! `layout`: lines that fit side by side in a review, and no invisible differences.

use super::report::Report;
use super::tree::Tree;

const COLUMNS_MAX: usize = 100;

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, text) in tree.texts(&["**.rs", "**.py", "**.md", "**.toml"]) {
        let code = path.ends_with(".rs") || path.ends_with(".py");
        for (index, line) in text.split('\n').enumerate() {
            let columns = line.chars().count();
            if code && columns > COLUMNS_MAX {
                let what = format!("{columns} columns");
                report.add(path, index + 1, what, format!("break it at {COLUMNS_MAX}"));
            }
            if code && line.contains('\t') {
                report.add(path, index + 1, "a tab", "use spaces, or `\\t` in a string");
            }
            if line.ends_with(char::is_whitespace) {
                report.add(path, index + 1, "blanks at the end", "take them away");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("layout", check);
        assert_eq!(
            found,
            [
                "crates/wire/src/lib.rs:2",
                "crates/wire/src/lib.rs:3",
                "crates/wire/src/lib.rs:4",
                "docs/guide.md:3",
            ]
        );
    }
}
