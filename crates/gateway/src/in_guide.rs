//! Whether the guide documents every route, in both languages: required role, parameters, and an
//! example. The examples themselves are tested by `crates/railbus/tests/guide.rs`.

use super::access::{Need, Role};
use super::doc::{Doc, Shapes};
use super::route::{BASE, Route};
use super::routes::{TOP, all};
use serde_json::Value;
use std::path::Path;
use utoipa::openapi::{RefOr, Schema};

/// A language of the guide, and the words by which a section is known.
struct Words {
    lang: &'static str,
    anybody: &'static str,
    table: &'static str,
}

const GUIDES: [Words; 2] = [
    Words {
        lang: "en",
        anybody: "anybody",
        table: "| parameter | meaning |",
    },
    Words {
        lang: "zh",
        anybody: "任何人",
        table: "| 参数 | 含义 |",
    },
];

const HOW: &str = "Both languages show the same commands. \
    `UPDATE=1 cargo test -p railbus --test guide` writes below them what they print.";

/// What a page says of one route.
struct Section {
    page: String,
    route: String,
    text: String,
}

/// A route as a page names it, and as it is asked for.
struct Told {
    route: &'static Route,
    name: String,
    address: String,
}

fn told() -> Vec<Told> {
    let tell = |base: &'static str| {
        move |route: &'static Route| Told {
            route,
            name: format!("{} {}", route.method, route.path),
            address: format!("{base}{}", route.path),
        }
    };
    let api = all().map(tell(BASE));
    api.chain(TOP.iter().map(tell(""))).collect()
}

/// The sections of the pages `api*.md` that begin with ``### `METHOD /path` ``.
fn sections(lang: &str) -> Vec<Section> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/guide");
    let folder = folder.join(lang).join("src");
    let mut sections = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let page = path.file_name().unwrap().to_string_lossy().into_owned();
        if !page.starts_with("api") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        for section in text.split("\n### `").skip(1) {
            let (route, rest) = section.split_once('`').unwrap();
            let text = rest.split("\n## ").next().unwrap();
            sections.push(Section {
                page: format!("docs/guide/{lang}/src/{page}"),
                route: route.to_owned(),
                text: text.to_owned(),
            });
        }
    }
    sections
}

/// The names of what the body holds.
fn fields(shape: fn(&mut Shapes) -> RefOr<Schema>) -> Vec<String> {
    let mut shapes = Shapes::new();
    shape(&mut shapes);
    let Some((_, whole)) = shapes.pop() else {
        return Vec::new();
    };
    let whole = serde_json::to_value(whole).unwrap();
    let properties = whole.get("properties").and_then(Value::as_object);
    properties.map_or_else(Vec::new, |map| map.keys().cloned().collect())
}

/// Who may use a route, as a page says it.
fn role(need: Need, words: &Words) -> String {
    let role = match need {
        Need::Nothing => words.anybody,
        Need::Role(Role::Viewer) => "viewer",
        Need::Role(Role::Operator) => "operator",
        Need::Role(Role::Engineer) => "engineer",
        Need::Role(Role::Admin) => "admin",
        Need::Owner => "owner",
    };
    format!("**{role}**")
}

/// What a section must name: parameters and the fields of the body, each with what is known of it.
fn names(doc: &Doc) -> Vec<(String, &'static str)> {
    let asked = doc
        .query
        .iter()
        .map(|(name, about)| ((*name).to_owned(), *about));
    let taken = doc.takes.map_or_else(Vec::new, fields);
    asked
        .chain(taken.into_iter().map(|name| (name, "…")))
        .collect()
}

/// Whether a line of a page asks for this route.
fn asks(line: &str, told: &Told) -> bool {
    if let Some(path) = line.strip_prefix("```websocket,") {
        return path.split('?').next() == Some(&told.address);
    }
    let Some(command) = line.strip_prefix("$ ") else {
        return false;
    };
    let words: Vec<&str> = command.split_whitespace().collect();
    let ends = |word: &&str| ["|", "&&", "&", "{"].contains(word) || word.ends_with(';');
    words.split(ends).any(|words| is_request(words, told))
}

/// Whether a command of the shell is a request of this route.
fn is_request(words: &[&str], told: &Told) -> bool {
    let after = |flag: &str| {
        let at = words.iter().position(|word| *word == flag)?;
        words.get(at + 1).copied()
    };
    let plain = match after("-d") {
        Some(_) => "POST",
        None => "GET",
    };
    after("-X").unwrap_or(plain) == told.route.method
        && words.iter().any(|word| is_address(word, &told.address))
}

/// Whether a word is this address: `'http://railbus/api/v1/ops/01M8?x=1'` is `/api/v1/ops/{op}`.
fn is_address(word: &str, address: &str) -> bool {
    let word = word.trim_matches(['\'', '"']);
    let Some((_, rest)) = word.split_once("://") else {
        return false;
    };
    let Some((_, path)) = rest.split_once('/') else {
        return false;
    };
    let path = path.split('?').next().unwrap_or(path);
    let wanted = address.trim_start_matches('/');
    let parts = |path: &str| -> Vec<String> { path.split('/').map(str::to_owned).collect() };
    let (asked, wanted) = (parts(path), parts(wanted));
    asked.len() == wanted.len()
        && asked
            .iter()
            .zip(&wanted)
            .all(|(asked, wanted)| wanted.starts_with('{') || asked == wanted)
}

/// A section to begin with.
fn template(told: &Told, words: &Words) -> String {
    let doc = told.route.doc.unwrap_or(Doc::new(""));
    let mut rows = String::new();
    for (name, about) in names(&doc) {
        rows += &format!("| `{name}` | {about} |\n");
    }
    if !rows.is_empty() {
        rows = format!("{}\n|---|---|\n{rows}\n", words.table);
    }
    let flags = match told.route.method {
        "GET" => String::new(),
        method if doc.takes.is_some() => format!(" -X {method} -d '{{…}}'"),
        method => format!(" -X {method}"),
    };
    format!(
        "### `{}`\n\n{}: {}.\n\n{rows}```console\n$ curl -K rb http://railbus{}{flags}\n```\n",
        told.name,
        role(told.route.need, words),
        doc.summary,
        told.address,
    )
}

/// What the guide in this language lacks of a route.
fn lacks(told: &Told, sections: &[Section], words: &Words) -> Vec<String> {
    let guide = format!("docs/guide/{}/src", words.lang);
    let is_its = |section: &&Section| section.route == told.name;
    let found: Vec<&Section> = sections.iter().filter(is_its).collect();
    let section = match found.as_slice() {
        [section] => section,
        [] => {
            let section = template(told, words);
            let what = format!("{guide}/api-*.md: put this section where it belongs:");
            return vec![format!("{what}\n\n{section}")];
        }
        _ => return vec![format!("{guide}: `{}` is told twice", told.name)],
    };
    let names = told.route.doc.map_or_else(Vec::new, |doc| names(&doc));
    let wanted = names.into_iter().map(|(name, _)| format!("`{name}`"));
    let wanted = wanted.chain([role(told.route.need, words)]);
    let about = format!("{}: `{}`", section.page, told.name);
    let mut lacks: Vec<String> = wanted
        .filter(|wanted| !section.text.contains(wanted))
        .map(|wanted| format!("{about} does not say {wanted}"))
        .collect();
    if !section.text.lines().any(|line| asks(line, told)) {
        let as_in = template(told, words);
        lacks.push(format!("{about} shows no request for it, as in\n\n{as_in}"));
    }
    lacks
}

/// What the guide in this language lacks, and what it has too much.
fn faults(words: &Words) -> Vec<String> {
    let (sections, routes) = (sections(words.lang), told());
    let lacks = routes.iter().flat_map(|told| lacks(told, &sections, words));
    let is_route = |section: &&Section| routes.iter().any(|told| told.name == section.route);
    let gone = sections.iter().filter(|section| !is_route(section));
    let gone = gone.map(|section| format!("{}: `{}` is no route", section.page, section.route));
    lacks.chain(gone).collect()
}

#[test]
fn the_guide_tells_of_every_route_and_of_no_other() {
    let faults: Vec<String> = GUIDES.iter().flat_map(faults).collect();
    assert!(faults.is_empty(), "\n{}\n{HOW}\n", faults.join("\n"));
}
