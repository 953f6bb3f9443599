//! `facts-tested`: two lists, facts of the datasheets and citations in test functions, must agree.

use std::collections::BTreeSet;

use super::cite::{self, Citation};
use super::report::Report;
use super::sheets::{self, SHEETS};
use super::tree::Tree;

pub(super) fn check(tree: &Tree, report: &mut Report) {
    if !tree.has_folder("crates/device") {
        report.note("crates/device does not exist yet; facts are not compared with tests");
        return;
    }
    let tested = tested(tree);
    for sheet in SHEETS.iter().filter(|sheet| sheet.tested) {
        for fact in sheets::facts(tree, sheet) {
            if !tested.contains(&(sheet.tag, fact.number.to_owned())) {
                let citation = format!("[{} §{}]", sheet.tag, fact.number);
                report.add(
                    sheet.path,
                    fact.line,
                    format!("no test names this fact ({citation})"),
                    format!(
                        "put `// {citation}` above or into the #[test] that would fail, or \
                         {citation} behind the name of a case of vectors/cases"
                    ),
                );
            }
        }
    }
}

/// The lists of cases, which a test runs; the line of a case cites what it shows.
pub(super) const CASES: &str = "vectors/cases/*.txt";

/// Tag and number of every fact that is cited by a test function under a `tests/` folder, or by a
/// case.
fn tested(tree: &Tree) -> BTreeSet<(&'static str, String)> {
    let mut tested = BTreeSet::new();
    let mut add = |line: &str| {
        for citation in cite::in_line(line) {
            if let Citation::Section { sheet, number } = citation {
                tested.insert((sheet.tag, number.to_owned()));
            }
        }
    };
    for (_, source) in tree.rust(&["crates/*/tests/"]) {
        let functions = source.test_functions();
        functions
            .iter()
            .flat_map(|text| text.lines())
            .for_each(&mut add);
    }
    for (_, text) in tree.texts(&[CASES]) {
        text.lines()
            .filter(|line| line.starts_with("case "))
            .for_each(&mut add);
    }
    tested
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("facts-tested", check);
        assert_eq!(
            found,
            ["docs/datasheets/erc8.md:6", "docs/datasheets/erc8.md:7"]
        );
    }
}
