//! The pages of the centre, and those of each of its sites: the same files as at a site.

use crate::route::Answer;
use crate::{answer, web};
use axum::http::{HeaderMap, Method, Uri};
use railbus_api::problem::{Problem, codes};
use railbus_words::Lang;

/// Everything that is not a path of an API.
pub(super) fn page(lang: Lang, method: &Method, uri: &Uri, headers: &HeaderMap) -> Answer {
    let path = file_at(uri.path().trim_start_matches('/'));
    let Some(path) = path.filter(|_| matches!(*method, Method::GET | Method::HEAD)) else {
        return answer::problem(&Problem::new(codes::NO_SUCH_PAGE));
    };
    let works = ["railbus fleet ls", "railbus fleet commands"];
    web::shown(path, (headers, lang), works)
}

/// The file that stands for a path; none if it is one of an API.
fn file_at(path: &str) -> Option<&str> {
    let (first, rest) = path.split_once('/').unwrap_or((path, ""));
    let (site, below) = rest.split_once('/').unwrap_or((rest, ""));
    match first {
        // What a site has there for monitoring must not be taken for a page.
        "api" | "fleet" | "metrics" | "readyz" => None,
        "s" if below == "api" || below.starts_with("api/") => None,
        // The files of its pages are those of the centre, at the top.
        "s" if !site.is_empty() => Some(""),
        _ => Some(path),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_a_centre_every_address_but_those_of_apis_is_the_page() {
        for (path, wanted) in [
            ("", Some("")),
            ("sites", Some("sites")),
            ("icon.svg", Some("icon.svg")),
            ("s", Some("s")),
            ("s/", Some("s/")),
            ("s/plant7", Some("")),
            ("s/plant7/", Some("")),
            ("s/plant7/module/oven", Some("")),
            ("s/plant7/apis", Some("")),
            ("s/plant7/icon.svg", Some("")),
            ("s/plant7/api", None),
            ("s/plant7/api/", None),
            ("s/plant7/api/v1/points", None),
            ("api", None),
            ("api/v1/points", None),
            ("fleet", None),
            ("metrics", None),
            ("readyz", None),
            ("fleet/v1/none", None),
        ] {
            assert_eq!(file_at(path), wanted, "{path}");
        }
    }
}
