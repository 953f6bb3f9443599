//! Citations of numbered facts: `[ERC-8 §2.1]`, lists of them, `[ERC-8 §2.1, §2.4, EDA §1.2]`, and
//! of whole chapters, `[ERC-8 §2]`, for a module that is about all of one.

use super::sheets::{self, SHEETS, Sheet};

/// A citation.
#[derive(Debug)]
pub(crate) enum Citation<'a> {
    /// A fact or chapter of a known page, whether or not it exists there.
    Section {
        sheet: &'static Sheet,
        number: &'a str,
    },
    /// A bracket with a section sign that does not read as a citation, and why.
    Broken { text: &'a str, why: &'static str },
}

/// Every citation in one line of text. A section sign outside brackets is prose.
pub(crate) fn in_line(line: &str) -> Vec<Citation<'_>> {
    let mut found = Vec::new();
    let mut rest = line;
    while let Some(sign) = rest.find('§') {
        let opened = rest[..sign]
            .rfind('[')
            .filter(|&at| !rest[at..sign].contains(']'));
        let after = sign + '§'.len_utf8();
        let Some(open) = opened else {
            rest = &rest[after..];
            continue;
        };
        let Some(len) = rest[after..].find(']') else {
            let why = "has no `]` on its line";
            found.push(Citation::Broken {
                text: &rest[open..],
                why,
            });
            break;
        };
        list(&rest[open + 1..after + len], &mut found);
        rest = &rest[after + len..];
    }
    found
}

/// The inside of one bracket. An item without a tag has that of the item before it.
fn list<'a>(inside: &'a str, found: &mut Vec<Citation<'a>>) {
    let mut sheet = None;
    for item in inside.split(',').map(str::trim) {
        let broken = |why| Citation::Broken { text: item, why };
        let Some((tag, number)) = item.split_once('§') else {
            found.push(broken("has no `§`"));
            continue;
        };
        if !tag.is_empty() {
            sheet = SHEETS
                .iter()
                .find(|sheet| tag.strip_suffix(' ') == Some(sheet.tag));
        }
        found.push(match sheet {
            None => broken("names no page that is known by this tag"),
            Some(_) if !is_section(number) => broken("is not `§2.1` nor `§2`"),
            Some(sheet) => Citation::Section { sheet, number },
        });
    }
}

fn is_section(text: &str) -> bool {
    sheets::is_number(text) || sheets::is_chapter(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(line: &str) -> Vec<String> {
        let spell = |citation| match citation {
            Citation::Section { sheet, number } => format!("{} {number}", sheet.tag),
            Citation::Broken { text, why } => format!("{text} {why}"),
        };
        in_line(line).into_iter().map(spell).collect()
    }

    #[test]
    fn lists_and_several_brackets() {
        let line = "/// [0] `[EDA9060A §4.6, §4.7, ERC-8 §1.1]` and [R55 §2](x), not §9";
        assert_eq!(
            said(line),
            ["EDA9060A 4.6", "EDA9060A 4.7", "ERC-8 1.1", "R55 2"]
        );
    }

    #[test]
    fn what_does_not_read_is_not_passed_over() {
        let unknown = "§1.1 names no page that is known by this tag";
        assert_eq!(said("[ERC8 §1.1]"), [format!("ERC8 {unknown}")]);
        assert_eq!(said("[§1.1]"), [unknown]);
        assert_eq!(
            said("[ERC-8 §1.1-3]"),
            ["ERC-8 §1.1-3 is not `§2.1` nor `§2`"]
        );
        assert_eq!(said("[ERC-8 §01]"), ["ERC-8 §01 is not `§2.1` nor `§2`"]);
        assert_eq!(
            said("// [ERC-8 §1.1,"),
            ["[ERC-8 §1.1, has no `]` on its line"]
        );
    }
}
