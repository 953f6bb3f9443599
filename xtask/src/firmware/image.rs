//! A board's image for a family of modules.

use std::path::{Path, PathBuf};

use super::toolchain::{self, TARGET};
use crate::run::{self, Error, Result};

/// The families, as the features of the boards' crates name them.
pub(crate) const FAMILIES: &[&str] = &["eda9060a", "eda9050", "erc8", "r55", "emd2a2q"];

/// The board that QEMU emulates.
const BOARD: &str = "mps2-an385";

/// All boards, by their crates' names.
const BOARDS: &[&str] = &[BOARD, "bluepill"];

/// The family of that name.
pub(crate) fn family(name: &str) -> Result<&'static str> {
    let found = FAMILIES.iter().copied().find(|family| *family == name);
    found.ok_or_else(|| {
        Error::new(
            format!("there is no family `{name}`"),
            format!("say one of {}", FAMILIES.join(", ")),
        )
    })
}

/// Where built images are.
pub(crate) fn folder(root: &Path) -> PathBuf {
    root.join("target/firmware")
}

/// Builds the images of all families for all boards.
pub(crate) fn build_all(root: &Path) -> Result<()> {
    FAMILIES
        .iter()
        .try_for_each(|family| build_boards(root, family))
}

/// Builds the images of a family for all boards.
pub(crate) fn build_boards(root: &Path, family: &str) -> Result<()> {
    BOARDS
        .iter()
        .try_for_each(|board| build_for(root, board, family).map(drop))
}

/// Builds the image of a family for QEMU.
pub(crate) fn build(root: &Path, family: &str) -> Result<PathBuf> {
    build_for(root, BOARD, family)
}

fn build_for(root: &Path, board: &str, family: &str) -> Result<PathBuf> {
    let target = root.join("target/thumb");
    let mut command = toolchain::build(root, toolchain::choose(root)?);
    toolchain::with_linker(root, &mut command);
    // The same image and size wherever the repository is: panics contain paths of files.
    let remap = format!("--remap-path-prefix={}/=", root.display());
    command.env(toolchain::FLAGS, remap);
    command
        // The folder's own settings and lock file apply.
        .current_dir(root.join("firmware"))
        .args(["--release", "--locked", "-p", board, "--features", family])
        .args(["--target", TARGET, "--target-dir"])
        .arg(&target);
    run::run(&mut command)?;
    let folder = folder(root);
    let image = folder.join(format!("{board}-{family}.elf"));
    let built = target.join(TARGET).join("release").join(board);
    let copied = std::fs::create_dir_all(&folder).and_then(|()| std::fs::copy(&built, &image));
    match copied {
        Ok(_) => Ok(image),
        Err(error) => Err(Error::new(
            format!("{} could not be written: {error}", image.display()),
            "see that the folder can be written to and has room",
        )),
    }
}
