//! What each image needs: a committed table, so that growth shows in a review.

use std::path::Path;

use super::elf::{self, Needs};
use super::image;
use crate::run::{Error, Result};

/// The table.
const TABLE: &str = "docs/firmware-size.md";

const HEAD: &str = "\
# What the firmware needs

Bytes of the images for `mps2-an385`, written by `cargo xtask firmware size --update`. Flash is
vectors, code, constants and first values; RAM is what has a fixed place, without the stack.

| family | flash | RAM |
|---|---|---|
";

/// Compares the table with what the images need now.
pub(super) fn check(root: &Path) -> Result<()> {
    let table = table(root)?;
    print!("{table}");
    if std::fs::read_to_string(root.join(TABLE)).is_ok_and(|committed| committed == table) {
        return Ok(());
    }
    Err(Error::new(
        format!("{TABLE} says otherwise"),
        "if the images may be so large: `cargo xtask firmware size --update`",
    ))
}

/// Writes the table.
pub(super) fn update(root: &Path) -> Result<()> {
    let table = table(root)?;
    print!("{table}");
    std::fs::write(root.join(TABLE), table)
        .map_err(|error| Error::new(format!("{TABLE}: {error}"), "see that it can be written to"))
}

fn table(root: &Path) -> Result<String> {
    let mut text = String::from(HEAD);
    for family in image::FAMILIES {
        let path = image::build(root, family)?;
        let file = std::fs::read(&path)
            .map_err(|error| Error::new(format!("{}: {error}", path.display()), "build it anew"))?;
        let needs = elf::needs(&file).ok_or_else(|| {
            let what = format!("{} is no image for ARM", path.display());
            Error::new(what, "build it anew")
        })?;
        let Needs { flash, ram } = needs;
        text.push_str(&format!("| `{family}` | {flash} | {ram} |\n"));
    }
    Ok(text)
}
