//! `sleep`: a fixed wait is a guess about the speed of something else. Wait for the event, or until
//! a deadline that somebody asked for.

use super::report::Report;
use super::rust::Source;
use super::tree::{Tree, matches};

/// Files that may sleep, and why.
const ALLOWED: &[(&str, &str)] = &[
    (
        "crates/qemu/src/board.rs",
        "QEMU tells nobody that a pin has changed",
    ),
    (
        "crates/qemu/src/ear.rs",
        "QEMU tells nobody that it has taken a character",
    ),
    (
        "crates/railbus/src/commands/fleet/revoke.rs",
        "the second of a revocation passes without an event",
    ),
    (
        "crates/store/src/audit/tail.rs",
        "who waits for a lock waits for good, or asks again",
    ),
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, source) in tree.rust(&["crates/*/src/"]) {
        if ALLOWED.iter().any(|(pattern, _)| matches(pattern, path)) {
            continue;
        }
        for line in sleeps(&source) {
            report.add(
                path,
                line,
                "sleeps for a fixed time",
                "wait for the event, or name the file and the reason in ALLOWED of \
                 xtask/src/tidy/sleep.rs",
            );
        }
    }
}

/// Lines of every blocking sleep, and of every sleep whose duration is given on the spot.
fn sleeps(source: &Source<'_>) -> Vec<usize> {
    let code = source.code();
    let calls = code
        .match_indices("sleep(")
        .filter(|&(at, _)| source.is_shipped(at));
    let fixed = calls.filter(|&(at, call)| {
        let argument = code[at + call.len()..]
            .split(';')
            .next()
            .unwrap_or_default();
        code[..at].ends_with("thread::") || argument.contains("Duration::from_")
    });
    fixed.map(|(at, _)| source.line_at(at)).collect()
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("sleep", check);
        assert_eq!(
            found,
            ["4", "5"].map(|line| format!("crates/host/src/lib.rs:{line}"))
        );
    }
}
