//! Protects browsers: refuses requests from pages of other sites, which a browser that is logged in
//! here would send, and host names that were made to point here (DNS rebinding).

use super::answer;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, HeaderName, HeaderValue, ORIGIN, REFERRER_POLICY,
    STRICT_TRANSPORT_SECURITY, UPGRADE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, Method};
use axum::middleware::Next;
use axum::response::Response;
use hyper::body::{Body as _, Frame};
use railbus_api::problem::{Problem, codes};
use std::net::{Ipv4Addr, Ipv6Addr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::time::Sleep;

/// The timeout of a request's body.
const BODY_WITHIN: Duration = Duration::from_secs(20);
/// What our pages may do: use resources from here, and no inline code.
const POLICY: &str = "default-src 'self'; img-src 'self' data:; object-src 'none'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Headers of every response.
const HEADERS: [(HeaderName, &str); 4] = [
    (CONTENT_SECURITY_POLICY, POLICY),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (REFERRER_POLICY, "no-referrer"),
    (CACHE_CONTROL, "no-store"),
];

/// Adds security headers.
pub(super) async fn headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    for (name, value) in HEADERS {
        let value = HeaderValue::from_static(value);
        response.headers_mut().entry(name).or_insert(value);
    }
    response
}

/// Adds HSTS.
pub(super) async fn strict(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let value = HeaderValue::from_static("max-age=31536000");
    response
        .headers_mut()
        .insert(STRICT_TRANSPORT_SECURITY, value);
    response
}

/// How clients reach the daemon over TCP.
#[derive(Debug)]
pub(super) struct Front {
    pub(super) port: u16,
    pub(super) is_tls: bool,
    /// It is reachable from other machines.
    pub(super) is_wide: bool,
    /// Names by which it is reached, besides its addresses.
    pub(super) names: Vec<String>,
    /// The certificate is trusted by browsers.
    pub(super) is_trusted: bool,
}

/// Lets requests through that are for this daemon and come from its own pages, or from no page.
pub(super) async fn front(
    State(front): State<Arc<Front>>,
    request: Request,
    next: Next,
) -> Response {
    match front.refused(request.method(), request.headers()) {
        Some(reason) => answer::problem(&Problem::new(codes::FORBIDDEN).with("reason", reason)),
        None => next.run(request).await,
    }
}

impl Front {
    /// Why a request is refused.
    fn refused(&self, method: &Method, headers: &HeaderMap) -> Option<&'static str> {
        let text = |name| {
            headers
                .get(name)
                .map(|value| value.to_str().unwrap_or_default())
        };
        // A page whose name was made to point here still sends its own name.
        let host = text(HOST).unwrap_or_default();
        if headers.get_all(HOST).iter().count() != 1 || !self.is_here(host) {
            return Some("the Host header does not name this machine");
        }
        // A WebSocket begins as a GET, and browsers let any page open one.
        let reads = matches!(*method, Method::GET | Method::HEAD) && !headers.contains_key(UPGRADE);
        let scheme = if self.is_tls { "https://" } else { "http://" };
        let from_here = |origin: &str| {
            let host = origin.strip_prefix(scheme);
            host.is_some_and(|host| self.is_here(host))
        };
        if !reads && text(ORIGIN).is_some_and(|origin| !from_here(origin)) {
            return Some("the request comes from a page of another site");
        }
        None
    }

    /// Whether `host` or `host:port` is this daemon. Unlike a name, an address can't be made to
    /// point here by a third party.
    fn is_here(&self, host: &str) -> bool {
        let usual = if self.is_tls { 443 } else { 80 };
        let (name, named) = match host.rsplit_once(':') {
            Some((name, digits)) if !digits.ends_with(']') => (name, digits.parse().ok()),
            _ => (host, Some(usual)),
        };
        let here = ["localhost", "127.0.0.1", "[::1]"];
        let known = here
            .into_iter()
            .chain(self.names.iter().map(String::as_str));
        let is_known = known
            .into_iter()
            .any(|known| name.eq_ignore_ascii_case(known));
        (is_known || self.is_wide && is_address(name)) && named == Some(self.port)
    }
}

fn is_address(name: &str) -> bool {
    match name
        .strip_prefix('[')
        .and_then(|name| name.strip_suffix(']'))
    {
        Some(name) => name.parse::<Ipv6Addr>().is_ok(),
        None => name.parse::<Ipv4Addr>().is_ok(),
    }
}

/// A body with a timeout: a client can't hold a connection by sending a byte now and then.
pub(super) async fn timely(request: Request, next: Next) -> Response {
    let (head, body) = request.into_parts();
    if body.is_end_stream() {
        return next.run(Request::from_parts(head, body)).await;
    }
    let timely = Timely {
        body,
        end: Box::pin(tokio::time::sleep(BODY_WITHIN)),
    };
    next.run(Request::from_parts(head, Body::new(timely))).await
}

/// A body and its deadline.
struct Timely {
    body: Body,
    end: Pin<Box<Sleep>>,
}

impl hyper::body::Body for Timely {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        if self.end.as_mut().poll(cx).is_ready() {
            let late = std::io::Error::from(std::io::ErrorKind::TimedOut);
            return Poll::Ready(Some(Err(axum::Error::new(late))));
        }
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> hyper::body::SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn here(port: u16) -> Front {
        Front {
            port,
            is_tls: false,
            is_wide: false,
            names: Vec::new(),
            is_trusted: false,
        }
    }

    #[test]
    fn only_names_of_this_machine_pass() {
        for name in [
            "localhost:7485",
            "127.0.0.1:7485",
            "[::1]:7485",
            "LocalHost:7485",
        ] {
            assert!(here(7485).is_here(name), "{name}");
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
            "10.0.0.7:7485",
        ] {
            assert!(!here(7485).is_here(other), "{other}");
        }
        assert!(here(80).is_here("localhost"));
        assert!(here(80).is_here("[::1]"));
    }

    #[test]
    fn other_machines_use_its_addresses_and_the_names_that_were_told() {
        let wide = Front {
            is_tls: true,
            is_wide: true,
            names: vec!["plant.example".to_owned()],
            ..here(443)
        };
        for name in [
            "10.0.0.7",
            "[fd00::7]",
            "plant.example:443",
            "Plant.Example",
        ] {
            assert!(wide.is_here(name), "{name}");
        }
        for other in [
            "evil.example",
            "10.0.0.7.evil.example",
            "10.0.0.7:80",
            "[x]",
        ] {
            assert!(!wide.is_here(other), "{other}");
        }
        let mut headers = HeaderMap::new();
        headers.insert(HOST, HeaderValue::from_static("plant.example"));
        headers.insert(ORIGIN, HeaderValue::from_static("https://plant.example"));
        assert_eq!(wide.refused(&Method::PUT, &headers), None);
        headers.insert(ORIGIN, HeaderValue::from_static("http://plant.example"));
        assert!(wide.refused(&Method::PUT, &headers).is_some());
    }

    #[test]
    fn a_page_of_another_site_may_not_write() {
        let refused = |method: &Method, headers: &HeaderMap| here(7485).refused(method, headers);
        let mut headers = HeaderMap::new();
        headers.insert(HOST, HeaderValue::from_static("localhost:7485"));
        assert_eq!(refused(&Method::PUT, &headers), None);
        headers.insert(ORIGIN, HeaderValue::from_static("http://evil.example"));
        assert!(refused(&Method::PUT, &headers).is_some());
        assert_eq!(refused(&Method::GET, &headers), None);
        headers.insert(ORIGIN, HeaderValue::from_static("null"));
        assert!(refused(&Method::POST, &headers).is_some());
        headers.insert(ORIGIN, HeaderValue::from_static("http://localhost:7485"));
        assert_eq!(refused(&Method::POST, &headers), None);
        assert!(refused(&Method::GET, &HeaderMap::new()).is_some());
        headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
        assert_eq!(refused(&Method::GET, &headers), None);
        headers.insert(ORIGIN, HeaderValue::from_static("http://evil.example"));
        assert!(refused(&Method::GET, &headers).is_some());
    }
}
