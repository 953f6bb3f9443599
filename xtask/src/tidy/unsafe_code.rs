//! `unsafe`: only in the files that are listed here, so that a reviewer knows them all.

use super::report::Report;
use super::rust::find_word;
use super::tree::{Tree, matches};

/// Files that may use it, and why.
const ALLOWED: &[(&str, &str)] = &[
    ("crates/host/src/ioctl.rs", "raw ioctls of serial ports"),
    ("crates/qemu/src/taken.rs", "a raw ioctl of a socket"),
    ("firmware/", "registers of the board"),
    ("crates/*/tests/*alloc*.rs", "a counting global allocator"),
    ("crates/*/benches/", "a counting global allocator"),
    ("bench/", "a counting global allocator"),
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, source) in tree.rust(&["**"]) {
        if ALLOWED.iter().any(|(pattern, _)| matches(pattern, path)) {
            continue;
        }
        for (line, code) in source.code_lines() {
            if find_word(code, "unsafe").is_some() {
                let next = "use a safe call, or name the file and the reason in ALLOWED of \
                            xtask/src/tidy/unsafe_code.rs";
                report.add(
                    path,
                    line,
                    "`unsafe` in a file that is not allowed to",
                    next,
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
        let found = crate::tidy::found("unsafe", check);
        assert_eq!(found, ["crates/host/src/port.rs:5"]);
    }
}
