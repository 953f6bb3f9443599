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
vectors, code, constants and first values; RAM is what has a fixed place, without the stack, whose
highest use the console tells.

| family | flash | RAM |
|---|---|---|
";

/// How much more than the table says an image may need: compilers differ, and a fix may cost some.
const SLACK: u32 = 256;

/// Compares the table with what the images need now.
pub(super) fn check(root: &Path) -> Result<()> {
    let now = table(root)?;
    print!("{now}");
    let committed = std::fs::read_to_string(root.join(TABLE)).unwrap_or_default();
    let grown: Vec<&str> = image::FAMILIES
        .iter()
        .copied()
        .filter(|family| has_grown(row(&committed, family), row(&now, family)))
        .collect();
    if grown.is_empty() {
        return Ok(());
    }
    Err(Error::new(
        format!("{TABLE} says less for {}", grown.join(", ")),
        "if the images may be so large: `cargo xtask firmware size --update`",
    ))
}

/// What a table says of a family.
fn row(table: &str, family: &str) -> Option<Needs> {
    let start = format!("| `{family}` | ");
    let rest = table.lines().find_map(|line| line.strip_prefix(&start))?;
    let (flash, ram) = rest.strip_suffix(" |")?.split_once(" | ")?;
    Some(Needs {
        flash: flash.parse().ok()?,
        ram: ram.parse().ok()?,
    })
}

/// Whether one needs more now; also where the table does not say what it needed.
fn has_grown(committed: Option<Needs>, now: Option<Needs>) -> bool {
    let (Some(committed), Some(now)) = (committed, now) else {
        return true;
    };
    now.flash > committed.flash + SLACK || now.ram > committed.ram + SLACK
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_read_as_it_is_written() {
        let table = format!("{HEAD}| `erc8` | 24000 | 900 |\n");
        let (flash, ram) = (24000, 900);
        assert_eq!(row(&table, "erc8"), Some(Needs { flash, ram }));
        assert_eq!(row(&table, "erc"), None);
    }

    #[test]
    fn growth_beyond_the_slack_is_seen() {
        let needs = |flash, ram| Some(Needs { flash, ram });
        let before = needs(1000, 500);
        assert!(!has_grown(before, needs(1000 + SLACK, 100)));
        assert!(has_grown(before, needs(1001 + SLACK, 500)));
        assert!(has_grown(before, needs(1000, 501 + SLACK)));
        assert!(has_grown(None, needs(1, 1)));
    }
}
