//! What can compile for a Cortex-M3 here.
//!
//! There are two toolchains, tried in this order:
//! 1. Debian's `rustc-web`, `cargo-web` and `rust-web-src`, which build `core` from source and for
//!    size. Only their images are as small as `docs/firmware-size.md` says;
//! 2. the one that runs xtask, if its `thumbv7m-none-eabi` target is installed
//!    (`rustup target add thumbv7m-none-eabi`).

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::run::{self, Error, Result};

pub(super) const TARGET: &str = "thumbv7m-none-eabi";

/// The variables of cargo for the compiler's flags and the linker.
pub(super) const FLAGS: &str = "CARGO_TARGET_THUMBV7M_NONE_EABI_RUSTFLAGS";
const LINKER: &str = "CARGO_TARGET_THUMBV7M_NONE_EABI_LINKER";
/// Debian's linker.
const DEBIAN_LINKER: &str = "/usr/bin/ld.lld";

/// Variables set by `cargo run` and rustup. With these a cargo of another toolchain would start the
/// wrong compiler or load the wrong libraries.
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

/// Debian's compiler and cargo; a rustup may precede them in the PATH, so the folder matters.
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";

/// A way to compile for [`TARGET`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Toolchain {
    /// The running toolchain has the target's libraries.
    Installed,
    /// Debian's toolchain, with `core` and `alloc` built from source.
    DebianSource,
}

/// Whether the toolchain that runs xtask has the target, so that no other one is needed.
pub(crate) fn target_installed(root: &Path) -> bool {
    sysroot(root, "rustc").is_ok_and(|sysroot| has_target(&sysroot))
}

pub(super) fn choose(root: &Path) -> Result<Toolchain> {
    // The size limits apply to this one.
    let source = |sysroot: PathBuf| sysroot.join("lib/rustlib/src/rust/library").is_dir();
    if Path::new(DEBIAN_CARGO).is_file() && sysroot(root, DEBIAN_RUSTC).is_ok_and(source) {
        return Ok(Toolchain::DebianSource);
    }
    if target_installed(root) {
        return Ok(Toolchain::Installed);
    }
    Err(Error::new(
        format!("no compiler here can build for {TARGET}"),
        format!(
            "on Debian run `apt-get install rustc-web cargo-web rust-web-src`, elsewhere \
             `rustup target add {TARGET}`"
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

pub(super) fn build(root: &Path, toolchain: Toolchain) -> Command {
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

/// Whether there is a linker for the target without Debian's `lld`.
pub(crate) fn linker_there(root: &Path) -> bool {
    target_installed(root) || rust_lld(root).is_some()
}

/// Makes cargo use a linker that is installed: rustup's toolchains have one for every target,
/// Debian's do not.
pub(super) fn with_linker(root: &Path, command: &mut Command) {
    let linker = rust_lld(root).unwrap_or_else(|| PathBuf::from(DEBIAN_LINKER));
    command.env(LINKER, linker);
}

/// The linker of the toolchain that runs xtask.
fn rust_lld(root: &Path) -> Option<PathBuf> {
    let host = run::read(run::program(root, "rustc").arg("-vV")).ok()?;
    let host = host.lines().find_map(|line| line.strip_prefix("host: "))?;
    let own = Path::new("lib/rustlib").join(host).join("bin/rust-lld");
    let linker = sysroot(root, "rustc").ok()?.join(own);
    linker.is_file().then_some(linker)
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
