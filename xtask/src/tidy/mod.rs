//! `cargo xtask tidy`: invariants of the whole tree that no compiler checks.
//!
//! A check is a function that reads a [`Tree`] and adds to a [`Report`]; [`CHECKS`] lists them.
//! Each has a small tree under `xtask/fixtures/<name>/` in which it must find something, and a unit
//! test that says which lines: a check that can't fail checks nothing.

mod citations;
mod cite;
mod core_purity;
mod deny_named;
mod deps_point_down;
mod facts_form;
mod facts_tested;
mod families;
mod files_size;
mod forbidden_words;
mod generated;
mod layout;
mod leaks;
mod lints;
mod manifest;
mod ports;
mod report;
mod rust;
mod sheets;
mod sleep;
mod tree;
mod unique_names;
mod unsafe_code;
mod vectors_used;

use std::path::Path;

use crate::run::{Error, Result};
use report::Report;
use tree::Tree;

/// One invariant.
struct Check {
    /// The name of the rule in findings, and of its fixture.
    name: &'static str,
    run: fn(&Tree, &mut Report),
}

const CHECKS: &[Check] = &[
    Check {
        name: "core-purity",
        run: core_purity::check,
    },
    Check {
        name: "deps-point-down",
        run: deps_point_down::check,
    },
    Check {
        name: "unsafe",
        run: unsafe_code::check,
    },
    Check {
        name: "facts-form",
        run: facts_form::check,
    },
    Check {
        name: "citations",
        run: citations::check,
    },
    Check {
        name: "facts-tested",
        run: facts_tested::check,
    },
    Check {
        name: "vectors-used",
        run: vectors_used::check,
    },
    Check {
        name: "layout",
        run: layout::check,
    },
    Check {
        name: "leaks",
        run: leaks::check,
    },
    Check {
        name: "forbidden-words",
        run: forbidden_words::check,
    },
    Check {
        name: "generated",
        run: generated::check,
    },
    Check {
        name: "sleep",
        run: sleep::check,
    },
    Check {
        name: "lints",
        run: lints::check,
    },
    Check {
        name: "files-size",
        run: files_size::check,
    },
    Check {
        name: "deny-named",
        run: deny_named::check,
    },
    Check {
        name: "unique-names",
        run: unique_names::check,
    },
    Check {
        name: "families",
        run: families::check,
    },
    Check {
        name: "ports",
        run: ports::check,
    },
];

/// Runs every check over the files that git knows, and prints what they found.
pub(crate) fn run(root: &Path, args: &[String]) -> Result<()> {
    crate::no_arguments(args)?;
    let tree = Tree::of_checkout(root)?;
    let mut report = Report::default();
    for check in CHECKS {
        report.begin(check.name);
        (check.run)(&tree, &mut report);
    }
    print!("{report}");
    let findings = report.findings().len();
    println!(
        "tidy: {} checks, {} files, {findings} findings",
        CHECKS.len(),
        tree.len()
    );
    if findings == 0 {
        Ok(())
    } else {
        Err(Error::OnScreen)
    }
}

/// The findings of a check in its fixture, as `path:line` each, in order.
#[cfg(test)]
fn found(name: &'static str, check: impl Fn(&Tree, &mut Report)) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name);
    let tree = Tree::of_folder(&root).unwrap();
    let mut report = Report::default();
    report.begin(name);
    check(&tree, &mut report);
    report
        .findings()
        .iter()
        .map(|finding| format!("{}:{}", finding.path, finding.line))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_check_has_a_fixture() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
        for check in CHECKS {
            assert!(
                fixtures.join(check.name).is_dir(),
                "no fixture for {}",
                check.name
            );
        }
    }
}
