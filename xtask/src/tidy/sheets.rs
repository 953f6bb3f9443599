//! The pages under `docs/datasheets` and their numbered facts.

use super::tree::Tree;

/// One page of facts.
#[derive(Debug)]
pub(crate) struct Sheet {
    /// How code cites it.
    pub(crate) tag: &'static str,
    pub(crate) path: &'static str,
    /// Whether every fact of it needs a test in a device crate. The public protocols have their
    /// vectors instead.
    pub(crate) tested: bool,
}

/// All pages.
pub(crate) const SHEETS: &[Sheet] = &[
    Sheet {
        tag: "EDA",
        path: "docs/datasheets/eda.md",
        tested: true,
    },
    Sheet {
        tag: "EDA9060A",
        path: "docs/datasheets/eda9060a.md",
        tested: true,
    },
    Sheet {
        tag: "EDA9050",
        path: "docs/datasheets/eda9050.md",
        tested: true,
    },
    Sheet {
        tag: "ERC-8",
        path: "docs/datasheets/erc8.md",
        tested: true,
    },
    Sheet {
        tag: "EMD-2A2Q",
        path: "docs/datasheets/emd2a2q.md",
        tested: true,
    },
    Sheet {
        tag: "R55",
        path: "docs/datasheets/r55.md",
        tested: true,
    },
    Sheet {
        tag: "MODBUS",
        path: "docs/datasheets/modbus.md",
        tested: false,
    },
    Sheet {
        tag: "ADAM",
        path: "docs/datasheets/adam.md",
        tested: false,
    },
    Sheet {
        tag: "BEYOND",
        path: "docs/datasheets/beyond.md",
        tested: true,
    },
];

/// The prefix of a line that states a fact.
pub(crate) const FACT: &str = "- **§";

/// A fact's number and where it is stated.
#[derive(Debug, PartialEq)]
pub(crate) struct Fact<'a> {
    /// `4.6`
    pub(crate) number: &'a str,
    /// From 1.
    pub(crate) line: usize,
}

/// The facts of one page that have a valid number.
pub(crate) fn facts<'a>(tree: &'a Tree, sheet: &Sheet) -> Vec<Fact<'a>> {
    let text = tree.text(sheet.path).unwrap_or_default();
    let lines = text.lines().enumerate();
    lines
        .filter_map(|(index, line)| {
            let (number, _) = line.strip_prefix(FACT)?.split_once("**")?;
            is_number(number).then_some(Fact {
                number,
                line: index + 1,
            })
        })
        .collect()
}

/// Whether the page has the fact `4.6`, or the chapter `4`.
pub(crate) fn has(tree: &Tree, sheet: &Sheet, section: &str) -> bool {
    if section.contains('.') {
        return facts(tree, sheet).iter().any(|fact| fact.number == section);
    }
    let heading = format!("## {section} ");
    let text = tree.text(sheet.path).unwrap_or_default();
    text.lines().any(|line| line.starts_with(&heading))
}

/// Whether this is the number of a fact: its chapter, a dot, and its position in the chapter.
pub(crate) fn is_number(text: &str) -> bool {
    text.split_once('.')
        .is_some_and(|(chapter, place)| is_chapter(chapter) && is_chapter(place))
}

/// Whether this is the number of a chapter: decimal, without leading zeros.
pub(crate) fn is_chapter(text: &str) -> bool {
    !text.is_empty() && !text.starts_with('0') && text.bytes().all(|byte| byte.is_ascii_digit())
}
