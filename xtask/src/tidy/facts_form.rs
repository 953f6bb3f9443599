//! `facts-form`: a fact is one numbered line that names its source.
//!
//! `- **§2.3** The reply comes before the pulse ends. (printed)` under a heading `## 2 ...`.

use super::report::Report;
use super::sheets::{FACT, is_number};
use super::tree::Tree;

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, text) in tree.texts(&["docs/datasheets/*.md"]) {
        let mut chapter = "";
        let mut seen: Vec<&str> = Vec::new();
        let mut lines = text.lines().enumerate().peekable();
        while let Some((index, line)) = lines.next() {
            if let Some(heading) = line.strip_prefix("## ") {
                chapter = heading.split_whitespace().next().unwrap_or_default();
            }
            let Some(fact) = line.strip_prefix(FACT) else {
                continue;
            };
            // A long fact may continue in indented lines; its source is at the very end.
            let mut last = line;
            while let Some((_, more)) = lines.next_if(|(_, next)| next.starts_with("  ")) {
                last = more;
            }
            if let Err((what, next)) = form(fact, last, chapter, &mut seen) {
                report.add(path, index + 1, what, next);
            }
        }
    }
}

/// Checks one fact, of which `fact` begins with its number and `last` is the last line.
fn form<'a>(
    fact: &'a str,
    last: &str,
    chapter: &str,
    seen: &mut Vec<&'a str>,
) -> Result<(), (String, &'static str)> {
    let number = match fact.split_once("** ") {
        Some((number, text)) if is_number(number) && !text.is_empty() => number,
        _ => {
            return Err((
                "this fact has no number".into(),
                "begin it with `- **§2.3** `",
            ));
        }
    };
    if seen.contains(&number) {
        return Err((
            format!("§{number} is stated twice"),
            "give the later one a new number",
        ));
    }
    seen.push(number);
    if number.split_once('.').is_none_or(|(own, _)| own != chapter) {
        let what = format!("§{number} stands under the heading `## {chapter} ...`");
        return Err((what, "move it, or number it after its heading"));
    }
    // There may be several sources; the last one shows that there is one at all.
    match last
        .strip_suffix(')')
        .and_then(|text| text.rsplit_once(" ("))
    {
        Some((_, mark)) if is_mark(mark) => Ok(()),
        _ => Err((
            format!("§{number} does not end with where it comes from"),
            "end it with (printed), (public), (choice 07) or (misprint E-09)",
        )),
    }
}

fn is_mark(mark: &str) -> bool {
    let two_digits = |text: &str| text.len() == 2 && text.bytes().all(|b| b.is_ascii_digit());
    matches!(mark, "printed" | "public")
        || mark.strip_prefix("choice ").is_some_and(two_digits)
        || mark.strip_prefix("misprint E-").is_some_and(two_digits)
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("facts-form", check);
        let lines =
            ["7", "8", "9", "10", "11"].map(|line| format!("docs/datasheets/erc8.md:{line}"));
        assert_eq!(found, lines);
    }
}
