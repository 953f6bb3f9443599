//! In which language somebody is answered.

use super::routes::Site;
use axum::http::HeaderMap;
use axum::http::header::ACCEPT_LANGUAGE;
use railbus_words::Lang;
use std::collections::BTreeMap;

/// As `?lang=` says, or else the browser, or else as the daemon speaks.
pub(super) fn of(site: &Site, asked: &BTreeMap<String, String>, headers: &HeaderMap) -> Lang {
    match asked.get("lang").map(String::as_str) {
        Some("en") => Lang::En,
        Some("zh") => Lang::Zh,
        _ => spoken(headers, site.lang),
    }
}

/// The language that a browser asks for, or else the daemon's.
pub(super) fn spoken(headers: &HeaderMap, otherwise: Lang) -> Lang {
    let accepted = headers.get(ACCEPT_LANGUAGE);
    let accepted = accepted.and_then(|value| value.to_str().ok());
    accepted.and_then(language).unwrap_or(otherwise)
}

/// The first language of a list that is one of ours.
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
