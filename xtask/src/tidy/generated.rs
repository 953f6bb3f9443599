//! `generated`: git contains sources, not what can be generated from them, nor third-party code.

use super::report::Report;
use super::tree::{File, Tree};

/// Folder names of generated and copied files.
const FOLDERS: &[&str] = &[
    "dist",
    "target",
    "node_modules",
    "vendor",
    "third_party",
    "__pycache__",
    ".venv",
];

const BINARY_MAX: usize = 256 * 1024;

pub(super) fn check(tree: &Tree, report: &mut Report) {
    check_sizes(tree, report, BINARY_MAX);
}

fn check_sizes(tree: &Tree, report: &mut Report, binary_max: usize) {
    for File { path, size, text } in tree.files() {
        let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
        if let Some(name) = folder.split('/').find(|part| FOLDERS.contains(part)) {
            let next = "take it out of git and make or fetch it in the build";
            report.add(path, 1, format!("`{name}/` is not for git"), next);
        }
        if text.is_none() && *size > binary_max {
            let what = format!("a binary file of {} KiB", size / 1024);
            let next = format!(
                "keep binaries under {} KiB or build them",
                binary_max / 1024
            );
            report.add(path, 1, what, next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixture() {
        let check = |tree: &Tree, report: &mut Report| check_sizes(tree, report, 8);
        let found = crate::tidy::found("generated", check);
        assert_eq!(found, ["docs/picture.bin:1", "web/dist/app.js:1"]);
    }
}
