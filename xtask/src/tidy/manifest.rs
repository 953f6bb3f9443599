//! The parts of `Cargo.toml` that the checks need: its keys and its dependencies.
//!
//! It reads the plain forms that cargo's own documentation uses. Arrays and inline tables may span
//! several lines; multi-line strings are not understood.

/// One `key = value`, with the name of its table prepended to the key.
#[derive(Debug)]
pub(crate) struct Entry {
    /// `["dependencies", "crc", "version"]` for `crc.version = "3"` under `[dependencies]`.
    pub(crate) path: Vec<String>,
    /// As written, without comments, on one line.
    pub(crate) value: String,
    /// From 1.
    pub(crate) line: usize,
}

/// What a dependency is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Role {
    Normal,
    Build,
    Dev,
}

/// A direct dependency of a crate.
#[derive(Debug)]
pub(crate) struct Dependency {
    /// The package's name, even if the crate renames it.
    pub(crate) package: String,
    pub(crate) role: Role,
    /// From 1.
    pub(crate) line: usize,
}

/// Every key of a manifest, in order.
pub(crate) fn entries(text: &str) -> Vec<Entry> {
    let mut found: Vec<Entry> = Vec::new();
    let mut table = Vec::new();
    // Whether the last value still has open brackets.
    let mut open = false;
    for (index, line) in text.lines().enumerate() {
        let line = without_comment(line).trim();
        if open {
            if let Some(entry) = found.last_mut() {
                entry.value.push_str(line);
                open = is_open(&entry.value);
            }
        } else if let Some(name) = line.strip_prefix('[') {
            table = dotted(name.trim_matches(['[', ']']));
        } else if let Some((key, value)) = split_key(line) {
            let path = table.iter().cloned().chain(dotted(key)).collect();
            let value = value.trim().to_owned();
            open = is_open(&value);
            found.push(Entry {
                path,
                value,
                line: index + 1,
            });
        }
    }
    found
}

/// Every package that the manifest itself depends on; those of `[workspace]` are only available.
pub(crate) fn dependencies(text: &str) -> Vec<Dependency> {
    let mut found: Vec<(String, Dependency)> = Vec::new();
    for Entry { path, value, line } in entries(text) {
        let role = |word: &String| match word.as_str() {
            "dependencies" => Some(Role::Normal),
            "build-dependencies" => Some(Role::Build),
            "dev-dependencies" => Some(Role::Dev),
            _ => None,
        };
        let Some((at, role)) = path
            .iter()
            .enumerate()
            .find_map(|(at, w)| Some((at, role(w)?)))
        else {
            continue;
        };
        let Some(name) = path.get(at + 1).filter(|_| path[0] != "workspace") else {
            continue;
        };
        let package = match path.get(at + 2).map(String::as_str) {
            Some("package") => Some(unquoted(&value)),
            Some(_) => None,
            None => inline(&value, "package"),
        };
        let known = found.iter().position(|(n, d)| n == name && d.role == role);
        match (known, package) {
            (Some(index), Some(package)) => found[index].1.package = package,
            (Some(_), None) => {}
            (None, package) => {
                let package = package.unwrap_or_else(|| name.clone());
                found.push((
                    name.clone(),
                    Dependency {
                        package,
                        role,
                        line,
                    },
                ));
            }
        }
    }
    found
        .into_iter()
        .map(|(_, dependency)| dependency)
        .collect()
}

/// The value of a key in `{ key = "value", ... }`.
fn inline(value: &str, key: &str) -> Option<String> {
    let body = value.strip_prefix('{')?.strip_suffix('}')?;
    body.split(',')
        .filter_map(split_key)
        .find(|(k, _)| k.trim() == key)
        .map(|(_, v)| unquoted(v))
}

fn unquoted(text: &str) -> String {
    text.trim().trim_matches(['"', '\'']).to_owned()
}

/// Splits at the first `=` outside quotes.
fn split_key(line: &str) -> Option<(&str, &str)> {
    let at = outside_quotes(line).find(|&(_, c)| c == '=')?.0;
    Some((line[..at].trim(), &line[at + 1..]))
}

fn without_comment(line: &str) -> &str {
    let end = outside_quotes(line)
        .find(|&(_, c)| c == '#')
        .map_or(line.len(), |(at, _)| at);
    &line[..end]
}

fn is_open(value: &str) -> bool {
    let count = |wanted: [char; 2]| {
        outside_quotes(value)
            .filter(|(_, c)| wanted.contains(c))
            .count()
    };
    count(['[', '{']) > count([']', '}'])
}

/// Splits `a."b.c".d` at the dots outside quotes, and removes the quotes.
fn dotted(name: &str) -> Vec<String> {
    let mut parts = Vec::new();
    let mut start = 0;
    for (at, _) in outside_quotes(name).filter(|&(_, c)| c == '.') {
        parts.push(unquoted(&name[start..at]));
        start = at + 1;
    }
    parts.push(unquoted(&name[start..]));
    parts
}

/// The characters outside quoted strings, with their positions.
fn outside_quotes(text: &str) -> impl Iterator<Item = (usize, char)> {
    let mut quote = None;
    text.char_indices().filter(move |&(_, c)| match quote {
        Some(open) => {
            if c == open {
                quote = None;
            }
            false
        }
        None if c == '"' || c == '\'' => {
            quote = Some(c);
            false
        }
        None => true,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_spelling_of_a_dependency() {
        let text = r#"
[package]
name = "x" # not a # dependency
[dependencies]
a = "1"
b = { version = "1", features = ["x", "y"] }
c.workspace = true
old = { package = "new", version = "1" }
[dependencies.d]
version = "1"
package = "e"
[target.'cfg(target_os = "linux")'.dependencies]
f = { version = "1", features = [
    "g", # a comment
] }
[dev-dependencies]
h = "1"
[workspace.dependencies]
offer = "1"
"#;
        let found: Vec<_> = dependencies(text)
            .into_iter()
            .map(|d| (d.package, d.role, d.line))
            .collect();
        let expected = [
            ("a", Role::Normal, 5),
            ("b", Role::Normal, 6),
            ("c", Role::Normal, 7),
            ("new", Role::Normal, 8),
            ("e", Role::Normal, 10),
            ("f", Role::Normal, 13),
            ("h", Role::Dev, 17),
        ];
        assert_eq!(
            found,
            expected.map(|(name, role, line)| (name.to_owned(), role, line))
        );
    }
}
