//! Whether the settings of outlets are what the fields of their kinds say.

use super::NORTHBOUND;
use super::kind::{ENABLED, Field, OutletKind, Shape, TABLE};
use crate::access::is_selector;
use railbus_site::Config;
use railbus_site::config::change::Keys;
use railbus_site::config::{ConfigProblem, Invalid, OUTLET_TYPE, is_url, place_of};
use serde_json::Value;

/// The most lines, modules or points that a setting names.
const NAMES_MAX: usize = 256;
/// The longest text in a list.
const TEXT_MAX: usize = 256;

/// What is wrong with the tables `[outlet.NAME]` of this text, whose configuration this is: each
/// with the line and column of its key.
pub(super) fn check(text: &str, config: &Config) -> Vec<ConfigProblem> {
    let mut found = Vec::new();
    for (name, outlet) in &config.outlets {
        let path = |key: &str| format!("{TABLE}.{name}.{key}");
        let kinds = || NORTHBOUND.iter().filter(|kind| kind.table == TABLE);
        match kinds().find(|kind| kind.name == outlet.kind) {
            Some(kind) => {
                let wrong = wrong(kind, name, &outlet.settings, config);
                found.extend(wrong.into_iter().map(|(key, why)| (path(&key), why)));
            }
            None => {
                let names = kinds().map(|kind| kind.name).collect();
                found.push((path(OUTLET_TYPE), Invalid::NotOneOf(names)));
            }
        }
    }
    let placed = found.into_iter().map(|(path, kind)| {
        let (line, column) = place_of(text, &path).unwrap_or((1, 1));
        ConfigProblem {
            line,
            column,
            path,
            kind,
        }
    });
    let mut placed: Vec<ConfigProblem> = placed.collect();
    placed.sort_by_key(|problem| (problem.line, problem.column));
    placed
}

/// The keys that are wrong, and why.
fn wrong(
    kind: &OutletKind,
    name: &str,
    settings: &Keys,
    config: &Config,
) -> Vec<(String, Invalid)> {
    let mut found = Vec::new();
    for (key, value) in settings {
        let field = kind.fields.iter().find(|field| field.key == key);
        let why = match field {
            Some(field) => why(field, value, config),
            None if key == ENABLED => (!value.is_boolean()).then(not_a_truth),
            None => Some(Invalid::UnknownKey(None)),
        };
        found.extend(why.map(|why| (key.clone(), why)));
    }
    for field in kind.fields {
        if field.is_required && !settings.contains_key(field.key) {
            found.push((field.key.to_owned(), Invalid::MissingKey(field.key)));
        }
    }
    if found.is_empty() {
        let wrong = (kind.check)(name, settings, config).into_iter();
        found.extend(wrong.map(|(key, why)| (key.to_owned(), why)));
    }
    found
}

fn not_a_truth() -> Invalid {
    Invalid::WrongType("true / false")
}

/// Why a setting can't be this.
fn why(field: &Field, value: &Value, config: &Config) -> Option<Invalid> {
    let text = value.as_str();
    let fits = |fits: bool, why: Invalid| (!fits).then_some(why);
    match field.shape {
        Shape::Text(most) => match text {
            Some(text) => fits((1..=most).contains(&text.len()), Invalid::BadText(most)),
            None => Some(Invalid::WrongType("text in quotes")),
        },
        Shape::Url(most) => {
            let is_one = text.is_some_and(|text| text.len() <= most && is_url(text));
            fits(is_one, Invalid::BadUrl)
        }
        Shape::Flag => fits(value.is_boolean(), not_a_truth()),
        Shape::Number(low, high, _) => match value.as_i64() {
            Some(number) => fits(
                (low..=high).contains(&number),
                Invalid::OutOfRange(low, high),
            ),
            None => Some(Invalid::WrongType("whole number")),
        },
        Shape::Choice(words) => {
            let names = || words.iter().map(|(name, _)| *name);
            let is_one = text.is_some_and(|text| names().any(|name| name == text));
            fits(is_one, Invalid::NotOneOf(names().collect()))
        }
        Shape::Choices(words) => {
            let names = || words.iter().map(|(name, _)| *name);
            each(value, |text| {
                let is_one = names().any(|name| name == text);
                fits(is_one, Invalid::NotOneOf(names().collect()))
            })
        }
        Shape::Texts => each(value, |text| {
            fits(
                (1..=TEXT_MAX).contains(&text.len()),
                Invalid::BadText(TEXT_MAX),
            )
        }),
        Shape::Line => match text {
            Some(name) => fits(config.lines.contains_key(name), Invalid::NoSuchLine),
            None => Some(Invalid::WrongType("text in quotes")),
        },
        Shape::Lines => each(value, |name| {
            fits(config.lines.contains_key(name), Invalid::NoSuchLine)
        }),
        Shape::Modules => each(value, |name| {
            fits(config.modules.contains_key(name), Invalid::NoSuchModule)
        }),
        Shape::Points => each(value, |text| fits(is_selector(text), Invalid::NoSuchPath)),
        // It does not stand in a file that others read.
        Shape::Secret(..) => Some(Invalid::UnknownKey(None)),
    }
}

/// What is wrong with a list of texts: the first of it.
fn each(value: &Value, why: impl Fn(&str) -> Option<Invalid>) -> Option<Invalid> {
    let Some(items) = value.as_array() else {
        return Some(Invalid::WrongType("list of names"));
    };
    if items.len() > NAMES_MAX {
        return Some(Invalid::TooMany(NAMES_MAX));
    }
    items.iter().find_map(|item| match item.as_str() {
        Some(text) => why(text),
        None => Some(Invalid::WrongType("text in quotes")),
    })
}
