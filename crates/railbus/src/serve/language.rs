//! In which language somebody is answered.

use super::routes::Site;
use super::web::spoken;
use crate::i18n::Lang;
use axum::http::HeaderMap;
use std::collections::BTreeMap;

/// As `?lang=` says, or else the browser, or else as the daemon speaks.
pub(super) fn of(site: &Site, asked: &BTreeMap<String, String>, headers: &HeaderMap) -> Lang {
    match asked.get("lang").map(String::as_str) {
        Some("en") => Lang::En,
        Some("zh") => Lang::Zh,
        _ => spoken(headers, site.lang),
    }
}
