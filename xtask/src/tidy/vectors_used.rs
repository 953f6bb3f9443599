//! `vectors-used`: a vector that no test reads proves nothing, and two with one name prove one.

use std::collections::BTreeMap;

use super::report::Report;
use super::tree::Tree;

pub(super) fn check(tree: &Tree, report: &mut Report) {
    let tests: Vec<&str> = tree
        .texts(&["crates/*/tests/**.rs"])
        .map(|(_, text)| text)
        .collect();
    let mut first: BTreeMap<&str, String> = BTreeMap::new();
    for (path, text) in tree.texts(&["vectors/*.json"]) {
        let name = path.rsplit('/').next().unwrap_or(path);
        if !tests.iter().any(|test| test.contains(name)) {
            let next = "read it in a test under crates/*/tests, by its name";
            report.add(path, 1, format!("no test names {name}"), next);
        }
        for (line, id) in ids(text) {
            let place = format!("{path}:{line}");
            if let Some(other) = first.get(id) {
                let what = format!("the id `{id}` is already that of {other}");
                report.add(path, line, what, "give one of them another id");
            } else {
                first.insert(id, place);
            }
        }
    }
}

/// Line and value of every `"id": "..."`.
fn ids(text: &str) -> Vec<(usize, &str)> {
    let mut found = Vec::new();
    for (at, key) in text.match_indices("\"id\"") {
        let value = text[at + key.len()..]
            .trim_start()
            .strip_prefix(':')
            .map(str::trim_start);
        let id = value.and_then(|value| value.strip_prefix('"')?.split_once('"'));
        if let Some((id, _)) = id {
            found.push((1 + text[..at].matches('\n').count(), id));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("vectors-used", check);
        assert_eq!(found, ["vectors/b.json:1", "vectors/b.json:3"]);
    }
}
