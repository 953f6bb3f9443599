//! The images in QEMU: the trials, and the demo with five of them.

use std::path::{Path, PathBuf};

use super::image;
use crate::run::{self, Result, cargo};
use crate::{peers, programs};

/// Third-party masters against boards in QEMU.
const MASTERS: &str = "interop/firmware.py";

/// Builds all images and runs every trial, or those that have one of the words in their names.
pub(super) fn run(root: &Path, words: &[&str]) -> Result<()> {
    let images = images(root)?;
    programs::railbus(root)?;
    let railbus = built(root, "debug");
    let program = [
        "run",
        "--quiet",
        "-p",
        "railbus-qemu",
        "--example",
        "trial",
        "--",
    ];
    let mut trial = cargo(root, &program);
    let ours = run::run(trial.arg(&images).arg(railbus).args(words));
    if !words.is_empty() && !words.contains(&"masters") {
        return ours;
    }
    let build = ["build", "--quiet", "-p", "railbus-qemu", "--bins"];
    let theirs = run::run(&mut cargo(root, &build)).and_then(|()| {
        let mut python = run::program(root, &peers::python(root).to_string_lossy());
        run::run(python.arg(MASTERS).arg(&images))
    });
    ours.and(theirs)
}

/// `cargo xtask demo --qemu`: the demo's five modules as boards in QEMU on one line, under
/// `railbus serve`, until it is stopped.
pub(crate) fn demo(root: &Path, args: &[String]) -> Result<()> {
    let images = images(root)?;
    crate::web::build_or_tell(root);
    run::run(&mut cargo(
        root,
        &["build", "--quiet", "--release", "-p", "railbus"],
    ))?;
    let railbus = built(root, "release");
    let program = [
        "run",
        "--quiet",
        "-p",
        "railbus-qemu",
        "--bin",
        "railbus-qemu",
        "--",
        "demo",
    ];
    let mut command = cargo(root, &program);
    run::run_attended(command.arg(images).arg(railbus).args(args))
}

/// The folder with the images of all families for QEMU, built.
fn images(root: &Path) -> Result<PathBuf> {
    for family in image::FAMILIES {
        image::build(root, family)?;
    }
    Ok(image::folder(root))
}

/// Where cargo puts the host's program.
fn built(root: &Path, profile: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from);
    target.join(profile).join("railbus")
}
