//! The size of each image: a committed table, so that growth shows in a review.

use std::path::Path;

use super::elf;
use super::{image, stack};
use crate::run::{self, Error, Result};

/// The table.
const TABLE: &str = "docs/firmware-size.md";

const HEAD: &str = "\
# What the firmware needs

Bytes of the images for `mps2-an385`, written by `cargo xtask firmware size --update`. Flash is
vectors, code, constants and first values. Fixed is what has its place in memory; stack is the most
that can ever be in use beside it, interrupts included: the longest way down through the code, which
`xtask/src/firmware/stack.rs` reads out of the image. No image needs more than 24 KiB of flash and
4 KiB of memory. What a trial has really used, the console tells.

| family | flash | fixed | stack | memory |
|---|---|---|---|---|
";

/// How much more than in the table an image may need: compilers differ, and a fix may cost some.
const SLACK: u32 = 256;

/// The most that any image may need, whatever the table says.
const FLASH: u32 = 24 * 1024;
const MEMORY: u32 = 4 * 1024;

/// The size of an image, in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Needs {
    flash: u32,
    fixed: u32,
    stack: u32,
}

impl Needs {
    const fn memory(self) -> u32 {
        self.fixed + self.stack
    }

    const fn is_too_much(self) -> bool {
        self.flash > FLASH || self.memory() > MEMORY
    }
}

/// Compares the table with the images as built now.
pub(super) fn check(root: &Path) -> Result<()> {
    let now = table(root)?;
    run::say(&now);
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

/// The row of a family in a table.
fn row(table: &str, family: &str) -> Option<Needs> {
    let start = format!("| `{family}` | ");
    let rest = table.lines().find_map(|line| line.strip_prefix(&start))?;
    let mut cells = rest.strip_suffix(" |")?.split(" | ").map(str::parse);
    Some(Needs {
        flash: cells.next()?.ok()?,
        fixed: cells.next()?.ok()?,
        stack: cells.next()?.ok()?,
    })
}

/// Whether an image has grown; also if the table has no row for it.
fn has_grown(committed: Option<Needs>, now: Option<Needs>) -> bool {
    let (Some(committed), Some(now)) = (committed, now) else {
        return true;
    };
    now.flash > committed.flash + SLACK || now.memory() > committed.memory() + SLACK
}

/// Writes the table.
pub(super) fn update(root: &Path) -> Result<()> {
    let table = table(root)?;
    run::say(&table);
    std::fs::write(root.join(TABLE), table)
        .map_err(|error| Error::new(format!("{TABLE}: {error}"), "see that it can be written to"))
}

fn table(root: &Path) -> Result<String> {
    let mut text = String::from(HEAD);
    for family in image::FAMILIES {
        let needs = measure(&image::build(root, family)?)?;
        if needs.is_too_much() {
            let (flash, memory) = (needs.flash, needs.memory());
            return Err(Error::new(
                format!(
                    "{family} needs {flash} bytes of flash and {memory} of memory, of {FLASH} and \
                     {MEMORY}"
                ),
                "look at what has grown: `nm --size-sort` of the image, and the longest way down",
            ));
        }
        let Needs {
            flash,
            fixed,
            stack,
        } = needs;
        let memory = needs.memory();
        text.push_str(&format!(
            "| `{family}` | {flash} | {fixed} | {stack} | {memory} |\n"
        ));
    }
    Ok(text)
}

/// The size of the image in this file.
fn measure(path: &Path) -> Result<Needs> {
    let wrong =
        |why: &dyn std::fmt::Display, what| Error::new(format!("{}: {why}", path.display()), what);
    let file = std::fs::read(path).map_err(|error| wrong(&error, "build it anew"))?;
    let (Some(needs), Some(code)) = (elf::needs(&file), elf::code(&file)) else {
        return Err(wrong(
            &"this is no image for ARM, with symbols",
            "build it anew",
        ));
    };
    let stack = stack::most(&code).map_err(|why| {
        wrong(
            &why,
            "only code has a bound that calls nothing by an address in a register, and not itself",
        )
    })?;
    Ok(Needs {
        flash: needs.flash,
        fixed: needs.ram,
        stack,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn needs(flash: u32, fixed: u32, stack: u32) -> Needs {
        Needs {
            flash,
            fixed,
            stack,
        }
    }

    #[test]
    fn a_table_is_read_as_it_is_written() {
        let table = format!("{HEAD}| `erc8` | 24000 | 900 | 2700 | 3600 |\n");
        assert_eq!(row(&table, "erc8"), Some(needs(24000, 900, 2700)));
        assert_eq!(row(&table, "erc"), None);
    }

    #[test]
    fn growth_beyond_the_slack_is_seen() {
        let before = Some(needs(1000, 500, 1500));
        assert!(!has_grown(before, Some(needs(1000 + SLACK, 100, 100))));
        assert!(!has_grown(before, Some(needs(1000, 400, 1600 + SLACK))));
        assert!(has_grown(before, Some(needs(1001 + SLACK, 500, 1500))));
        assert!(has_grown(before, Some(needs(1000, 501, 1500 + SLACK))));
        assert!(has_grown(None, Some(needs(1, 1, 1))));
    }

    #[test]
    fn more_than_is_promised_is_too_much() {
        assert!(!needs(FLASH, 1000, MEMORY - 1000).is_too_much());
        assert!(needs(FLASH + 1, 1000, 1000).is_too_much());
        assert!(needs(1000, 1000, MEMORY - 999).is_too_much());
    }
}
