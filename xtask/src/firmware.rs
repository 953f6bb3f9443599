//! The modules as firmware: whether the core crates can be built for it at all, and the images.
//!
//! `toolchain.rs` finds what compiles for a Cortex-M3 on this machine, `image.rs` builds a board's
//! image for a family, `size.rs` maintains the table of sizes, `stack.rs` computes the stack, and
//! `trial.rs` runs the images in QEMU.

mod elf;
mod image;
mod size;
mod stack;
mod toolchain;
mod trial;

use std::path::Path;

use crate::run::{self, Error, Result};
use toolchain::{TARGET, build, choose};
pub(crate) use toolchain::{linker_there, target_installed};
pub(crate) use trial::demo;

/// Crates that a module's firmware uses.
const CRATES: &[&str] = &["wire", "device", "nvm", "bus"];

/// Builds the core crates for the target.
pub(crate) fn check(root: &Path, args: &[String]) -> Result<()> {
    crate::no_arguments(args)?;
    let mut command = build(root, choose(root)?);
    command.args(["--target", TARGET, "--target-dir", "target/thumb"]);
    for name in CRATES {
        command.arg("-p").arg(format!("railbus-{name}"));
    }
    run::run(&mut command)
}

/// `cargo xtask firmware build [--family F]`, `cargo xtask firmware test [WORD...]`,
/// `cargo xtask firmware size [--update]`.
pub(crate) fn run(root: &Path, args: &[String]) -> Result<()> {
    let words: Vec<&str> = args.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["build"] => image::build_all(root),
        ["build", "--family", family] => image::build_boards(root, image::family(family)?),
        ["test", words @ ..] => trial::run(root, words),
        ["size"] => size::check(root),
        ["size", "--update"] => size::update(root),
        _ => Err(Error::new(
            format!("`{}` is not understood", words.join(" ")),
            "say `build`, `build --family F`, `test [WORD...]`, `size` or `size --update`",
        )),
    }
}

/// What can be said of the firmware without running it: the tests of what boards share, and of the
/// codecs as boards use them, and the images of every family for every board, also for those that
/// can't be run here.
pub(crate) fn images(root: &Path) -> Result<()> {
    let args = ["test", "--manifest-path", "firmware/Cargo.toml"];
    run::run(&mut run::cargo(root, &args))?;
    let args = [
        "test",
        "--quiet",
        "-p",
        "railbus-wire",
        "--features",
        "small",
    ];
    run::run(&mut run::cargo(root, &args))?;
    image::build_all(root)?;
    size::check(root)
}

/// The trials of the images in QEMU.
pub(crate) fn trials(root: &Path) -> Result<()> {
    trial::run(root, &[])
}
