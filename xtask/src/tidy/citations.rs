//! `citations`: the reader of a constant must be able to look up where it comes from.

use super::cite::{self, Citation};
use super::facts_tested::CASES;
use super::report::Report;
use super::sheets;
use super::tree::Tree;

/// Code that cites. This tool's own sources are full of examples of citations.
const WHERE: &[&str] = &["crates/", "firmware/", "fuzz/", "bench/"];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, source) in tree.rust(WHERE) {
        for (line, text) in source.lines() {
            for citation in cite::in_line(text) {
                resolve(tree, report, (path, line), &citation);
            }
        }
    }
    for (path, text) in tree.texts(&[CASES]) {
        for (line, text) in (1..).zip(text.lines()) {
            for citation in cite::in_line(text) {
                resolve(tree, report, (path, line), &citation);
            }
        }
    }
}

fn resolve(tree: &Tree, report: &mut Report, (path, line): (&str, usize), citation: &Citation<'_>) {
    match citation {
        Citation::Broken { text, why } => {
            let tags: Vec<_> = sheets::SHEETS.iter().map(|sheet| sheet.tag).collect();
            let next = format!(
                "write `[ERC-8 §2.1]` or `[ERC-8 §2.1, §2.4]`, tags: {}",
                tags.join(", ")
            );
            report.add(path, line, format!("`{text}` {why}"), next);
        }
        Citation::Section { sheet, number } => {
            if !sheets::has(tree, sheet, number) {
                let what = format!("{} has no §{number}", sheet.path);
                report.add(
                    path,
                    line,
                    what,
                    "correct the number, or add the fact to the page",
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
        let found = crate::tidy::found("citations", check);
        let lines = ["4", "6", "6", "8", "11"].map(|line| format!("crates/wire/src/lib.rs:{line}"));
        let case = String::from("vectors/cases/erc8.txt:2");
        assert_eq!(found, [&lines[..], &[case]].concat());
    }
}
