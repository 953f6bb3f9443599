//! The core crates must build where there is no `std` at all: for a Cortex-M3.
//!
//! Two toolchains can do it, tried in this order:
//! 1. the one that runs xtask, if its `thumbv7m-none-eabi` target is installed
//!    (`rustup target add thumbv7m-none-eabi`);
//! 2. Debian's `rustc-web`, `cargo-web` and `rust-web-src`, which build `core` from source. This is
//!    the way for machines that cannot reach rustup's server.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::run::{self, Error, Result};

const TARGET: &str = "thumbv7m-none-eabi";

/// Crates that a module's firmware takes. Those that do not exist yet are left out, and said so.
const CRATES: &[&str] = &["wire", "device", "bus"];

/// What `cargo run` and rustup put into the environment. A cargo of another toolchain that heard
/// of it would start the wrong compiler or load the wrong libraries.
const INHERITED: &[&str] = &[
    "CARGO",
    "CARGO_BUILD_TARGET",
    "CARGO_ENCODED_RUSTFLAGS",
    "CARGO_TARGET_DIR",
    "LD_LIBRARY_PATH",
    "RUSTC",
    "RUSTC_WORKSPACE_WRAPPER",
    "RUSTC_WRAPPER",
    "RUSTDOC",
    "RUSTFLAGS",
    "RUSTUP_TOOLCHAIN",
];

/// Debian's compiler and cargo; they stand beside a rustup on the PATH, so the folder matters.
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";

/// A way to compile for [`TARGET`].
#[derive(Clone, Copy, Debug, PartialEq)]
enum Toolchain {
    /// The running toolchain has the target's libraries.
    Installed,
    /// Debian's toolchain, with `core` and `alloc` built from source.
    DebianSource,
}

/// Builds the core crates for the target.
pub(crate) fn check(root: &Path, args: &[String]) -> Result<()> {
    crate::no_arguments(args)?;
    let toolchain = toolchain(root)?;
    let (present, absent): (Vec<&str>, Vec<&str>) = CRATES
        .iter()
        .copied()
        .partition(|name| root.join("crates").join(name).join("Cargo.toml").is_file());
    for name in absent {
        println!("note: crates/{name} does not exist yet and is not built");
    }
    let mut command = build(root, toolchain);
    command.args(["--target", TARGET, "--target-dir", "target/thumb"]);
    for name in present {
        command.arg("-p").arg(format!("railbus-{name}"));
    }
    run::run(&mut command)
}

/// Whether the toolchain that runs xtask has the target, so that no other one is needed.
pub(crate) fn target_installed(root: &Path) -> bool {
    sysroot(root, "rustc").is_ok_and(|sysroot| has_target(&sysroot))
}

fn toolchain(root: &Path) -> Result<Toolchain> {
    if target_installed(root) {
        return Ok(Toolchain::Installed);
    }
    let source = |sysroot: PathBuf| sysroot.join("lib/rustlib/src/rust/library").is_dir();
    if Path::new(DEBIAN_CARGO).is_file() && sysroot(root, DEBIAN_RUSTC).is_ok_and(source) {
        return Ok(Toolchain::DebianSource);
    }
    Err(Error::new(
        format!("no compiler here can build for {TARGET}"),
        format!(
            "run `rustup target add {TARGET}`, or on Debian \
             `apt-get install rustc-web cargo-web rust-web-src`"
        ),
    ))
}

fn has_target(sysroot: &Path) -> bool {
    sysroot
        .join("lib/rustlib")
        .join(TARGET)
        .join("lib")
        .is_dir()
}

fn sysroot(root: &Path, rustc: &str) -> Result<PathBuf> {
    let mut command = run::program(root, rustc);
    if rustc == DEBIAN_RUSTC {
        scrub(&mut command);
    }
    let text = run::read(command.args(["--print", "sysroot"]))?;
    Ok(PathBuf::from(text.trim()))
}

fn build(root: &Path, toolchain: Toolchain) -> Command {
    match toolchain {
        Toolchain::Installed => run::cargo(root, &["build"]),
        Toolchain::DebianSource => {
            let mut command = run::program(root, DEBIAN_CARGO);
            scrub(&mut command);
            command
                .env("RUSTC", DEBIAN_RUSTC)
                // `-Zbuild-std` is a nightly flag; this lets a stable compiler take it.
                .env("RUSTC_BOOTSTRAP", "1")
                .args(["build", "-Zbuild-std=core,alloc,compiler_builtins"]);
            command
        }
    }
}

fn scrub(command: &mut Command) {
    for name in INHERITED {
        command.env_remove(name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debians_cargo_hears_nothing_of_the_running_toolchain() {
        let command = build(Path::new("."), Toolchain::DebianSource);
        let set = |name: &str| {
            command
                .get_envs()
                .find(|(key, _)| *key == name)
                .map(|pair| pair.1)
        };
        assert_eq!(set("RUSTUP_TOOLCHAIN"), Some(None), "removed");
        assert_eq!(set("RUSTFLAGS"), Some(None), "removed");
        assert_eq!(set("RUSTC"), Some(Some(DEBIAN_RUSTC.as_ref())));
    }

    #[test]
    fn a_sysroot_without_the_target_is_seen_as_such() {
        assert!(!has_target(Path::new(env!("CARGO_MANIFEST_DIR"))));
    }
}
