//! What is refused whoever asks: web pages of anywhere else, for which a browser that is logged
//! in here would gladly ask, and names that were made to lead here.

use super::answer;
use crate::api::problem::{Problem, codes};
use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, HeaderName, HeaderValue, ORIGIN, REFERRER_POLICY,
    UPGRADE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, Method};
use axum::middleware::Next;
use axum::response::Response;

/// What a page of ours may do: use what comes from here, and nothing that stands in the page.
const POLICY: &str = "default-src 'self'; img-src 'self' data:; object-src 'none'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What every answer carries.
const HEADERS: [(HeaderName, &str); 4] = [
    (CONTENT_SECURITY_POLICY, POLICY),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (REFERRER_POLICY, "no-referrer"),
    (CACHE_CONTROL, "no-store"),
];

/// Adds the headers that tell a browser what it must not do.
pub(super) async fn headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    for (name, value) in HEADERS {
        let value = HeaderValue::from_static(value);
        response.headers_mut().entry(name).or_insert(value);
    }
    response
}

/// Lets through what is meant for this machine and comes from it.
pub(super) async fn loopback(State(port): State<u16>, request: Request, next: Next) -> Response {
    match refused(request.method(), request.headers(), port) {
        Some(reason) => answer::problem(&Problem::new(codes::FORBIDDEN).with("reason", reason)),
        None => next.run(request).await,
    }
}

/// Why a request is not let through.
fn refused(method: &Method, headers: &HeaderMap, port: u16) -> Option<&'static str> {
    let text = |name| {
        headers
            .get(name)
            .map(|value| value.to_str().unwrap_or_default())
    };
    // A page whose name was made to lead here still sends its own name.
    let host = text(HOST).unwrap_or_default();
    if headers.get_all(HOST).iter().count() != 1 || !is_here(host, port) {
        return Some("the Host header does not name this machine");
    }
    // A WebSocket begins as a GET, and browsers let any page open one.
    let reads = matches!(*method, Method::GET | Method::HEAD) && !headers.contains_key(UPGRADE);
    let from_here = |origin: &str| {
        let host = origin.strip_prefix("http://");
        host.is_some_and(|host| is_here(host, port))
    };
    if !reads && text(ORIGIN).is_some_and(|origin| !from_here(origin)) {
        return Some("the request comes from a page of another site");
    }
    None
}

/// Whether `host` or `host:port` is this machine, at this port.
fn is_here(host: &str, port: u16) -> bool {
    let (name, named) = match host.rsplit_once(':') {
        Some((name, digits)) if !digits.ends_with(']') => (name, digits.parse().ok()),
        _ => (host, Some(80)),
    };
    let names = ["localhost", "127.0.0.1", "[::1]"];
    names.iter().any(|known| name.eq_ignore_ascii_case(known)) && named == Some(port)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_machine_pass() {
        for here in [
            "localhost:7485",
            "127.0.0.1:7485",
            "[::1]:7485",
            "LocalHost:7485",
        ] {
            assert!(is_here(here, 7485), "{here}");
        }
        for other in [
            "",
            "localhost",
            "localhost:80",
            "evil.example:7485",
            "127.0.0.1.evil.example:7485",
            "[::1]",
            "localhost:7485:7485",
            "localhost:",
            "0.0.0.0:7485",
        ] {
            assert!(!is_here(other, 7485), "{other}");
        }
        assert!(is_here("localhost", 80));
        assert!(is_here("[::1]", 80));
    }

    #[test]
    fn a_page_of_another_site_may_not_write() {
        let mut headers = HeaderMap::new();
        headers.insert(HOST, HeaderValue::from_static("localhost:7485"));
        assert_eq!(refused(&Method::PUT, &headers, 7485), None);
        headers.insert(ORIGIN, HeaderValue::from_static("http://evil.example"));
        assert!(refused(&Method::PUT, &headers, 7485).is_some());
        assert_eq!(refused(&Method::GET, &headers, 7485), None);
        headers.insert(ORIGIN, HeaderValue::from_static("null"));
        assert!(refused(&Method::POST, &headers, 7485).is_some());
        headers.insert(ORIGIN, HeaderValue::from_static("http://localhost:7485"));
        assert_eq!(refused(&Method::POST, &headers, 7485), None);
        assert!(refused(&Method::GET, &HeaderMap::new(), 7485).is_some());
        headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
        assert_eq!(refused(&Method::GET, &headers, 7485), None);
        headers.insert(ORIGIN, HeaderValue::from_static("http://evil.example"));
        assert!(refused(&Method::GET, &headers, 7485).is_some());
    }
}
