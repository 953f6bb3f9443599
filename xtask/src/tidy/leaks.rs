//! `leaks`: details of the machine on which a text was written help no reader.

use super::report::Report;
use super::tree::Tree;

/// Folders of development machines. In pieces, or they would be found here.
const WORDS: &[&str] = &[
    concat!("/wo", "rk/"),
    concat!("/ro", "ot/"),
    concat!("/home", "/"),
    concat!("../sha", "red"),
    concat!("/Use", "rs/"),
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    check_words(tree, report, WORDS);
}

fn check_words(tree: &Tree, report: &mut Report, words: &[&str]) {
    for (path, text) in tree.texts(&["**"]) {
        for (index, line) in text.lines().enumerate() {
            if let Some(word) = words.iter().find(|word| line.contains(*word)) {
                let what = format!("`{word}` is a path of somebody's machine");
                report.add(
                    path,
                    index + 1,
                    what,
                    "write a path from the repository's root",
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixture() {
        let check = |tree: &Tree, report: &mut Report| check_words(tree, report, &["/machine/"]);
        assert_eq!(crate::tidy::found("leaks", check), ["docs/guide.md:3"]);
    }

    #[test]
    fn the_words_are_whole() {
        assert!(
            WORDS
                .iter()
                .all(|word| word.contains('/') && word.len() >= 6)
        );
    }
}
