//! The language of an answer.

use super::site::Site;
use axum::http::HeaderMap;
use axum::http::header::ACCEPT_LANGUAGE;
use railbus_words::Lang;
use std::collections::BTreeMap;

/// From `?lang=`, or else the browser, or else the daemon's default.
pub(super) fn of(site: &Site, asked: &BTreeMap<String, String>, headers: &HeaderMap) -> Lang {
    match asked.get("lang").map(String::as_str) {
        Some("en") => Lang::En,
        Some("zh") => Lang::Zh,
        _ => spoken(headers, site.lang),
    }
}

/// The language that the browser prefers, or else the default.
pub(super) fn spoken(headers: &HeaderMap, otherwise: Lang) -> Lang {
    let accepted = headers.get(ACCEPT_LANGUAGE);
    let accepted = accepted.and_then(|value| value.to_str().ok());
    accepted.and_then(language).unwrap_or(otherwise)
}

/// The first supported language of a list.
fn language(list: &str) -> Option<Lang> {
    list.split(',').map(str::trim).find_map(|name| {
        let head = name.get(..2)?;
        match () {
            () if head.eq_ignore_ascii_case("zh") => Some(Lang::Zh),
            () if head.eq_ignore_ascii_case("en") => Some(Lang::En),
            () => None,
        }
    })
}
