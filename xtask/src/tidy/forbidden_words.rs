//! `forbidden-words`: unfinished code is not committed as if it were finished.

use super::report::Report;
use super::rust::{Source, find_word};
use super::tree::Tree;

/// In code.
const CODE: &[&str] = &["todo!(", "unimplemented!(", "#[ignore", "#[cfg_attr(ignore"];
/// In code and comments.
const ANYWHERE: &[&str] = &["FIXME", "XXX"];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, source) in tree.rust(&["**"]) {
        for (line, word) in words(&source) {
            let next = "finish it, take it out, or open an issue and name that";
            report.add(path, line, format!("`{word}`"), next);
        }
    }
}

fn words(source: &Source<'_>) -> Vec<(usize, &'static str)> {
    let code = source
        .code_lines()
        .flat_map(|(line, text)| hits(line, text, CODE));
    let both = source.code_lines().chain(source.comment_lines());
    let mut found: Vec<_> = code
        .chain(both.flat_map(|(line, text)| hits(line, text, ANYWHERE)))
        .collect();
    found.sort_unstable();
    found
}

fn hits<'a>(
    line: usize,
    text: &'a str,
    words: &'static [&'static str],
) -> impl Iterator<Item = (usize, &'static str)> + use<'a> {
    let found = words.iter().filter(|word| find_word(text, word).is_some());
    found.map(move |word| (line, *word))
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("forbidden-words", check);
        assert_eq!(
            found,
            ["3", "5", "8"].map(|line| format!("crates/wire/src/lib.rs:{line}"))
        );
    }
}
