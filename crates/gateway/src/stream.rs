//! Changes as they happen: as JSON lines, or as events for a browser.

use super::access::Caller;
use super::answer;
use super::points::selectors;
use super::site::Site;
use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::{Query, State};
use axum::http::header::{ACCEPT, CONTENT_TYPE, HeaderValue};
use axum::http::{HeaderMap, Response};
use http_body_util::channel::{Channel, Sender};
use railbus_api::types::WatchEvent;
use railbus_app::api::watching::Watching;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::time::Duration;

/// How many chunks are buffered for a slow reader; further changes wait at the site, which drops
/// the oldest and reports how many.
const PIECES_MAX: usize = 16;
/// After this time without an event something is sent, to detect readers that have gone.
const ALIVE: Duration = Duration::from_secs(15);

/// The two forms.
#[derive(Clone, Copy)]
enum Form {
    Ndjson,
    Events,
}

/// `GET /api/v1/watch`.
pub(super) async fn watch(
    State(site): State<Site>,
    asked: Query<BTreeMap<String, String>>,
    who: Extension<Caller>,
    headers: HeaderMap,
) -> Response<Body> {
    let selectors = match selectors(&site.service, &asked) {
        Ok(selectors) => selectors,
        Err(problem) => return answer::problem(&problem),
    };
    let accepted = headers.get(ACCEPT).and_then(|value| value.to_str().ok());
    let form = if accepted.is_some_and(|accepted| accepted.contains("text/event-stream")) {
        Form::Events
    } else {
        Form::Ndjson
    };
    let (sender, body) = Channel::<Bytes, Infallible>::new(PIECES_MAX);
    let watching = Watching::new(site.service.clone(), &selectors);
    tokio::spawn(send(form, watching, sender, site.over(&who)));
    let mut response = Response::new(Body::new(body));
    let content_type = HeaderValue::from_static(match form {
        Form::Ndjson => "application/x-ndjson",
        Form::Events => "text/event-stream",
    });
    response.headers_mut().insert(CONTENT_TYPE, content_type);
    response
}

/// Sends until the reader has gone or loses its permission, or the daemon stops.
async fn send(
    form: Form,
    mut watching: Watching,
    mut sender: Sender<Bytes, Infallible>,
    over: impl Future<Output = ()>,
) {
    let mut over = std::pin::pin!(over);
    loop {
        let piece = tokio::select! {
            () = &mut over => return,
            event = tokio::time::timeout(ALIVE, watching.next()) => match event {
                Ok(Some(event)) => piece(form, &event),
                Ok(None) => return,
                Err(_) => match form {
                    Form::Ndjson => Bytes::from_static(b"\n"),
                    Form::Events => Bytes::from_static(b":\n\n"),
                },
            },
        };
        let sent = tokio::select! {
            () = &mut over => return,
            sent = sender.send_data(piece) => sent,
        };
        if sent.is_err() {
            return;
        }
    }
}

fn piece(form: Form, event: &WatchEvent) -> Bytes {
    let json = serde_json::to_string(event).unwrap_or_default();
    let name = match event {
        WatchEvent::Point { .. } => "point",
        WatchEvent::Module { .. } => "module",
        WatchEvent::Line { .. } => "line",
        WatchEvent::Gap { .. } => "gap",
    };
    Bytes::from(match form {
        Form::Ndjson => format!("{json}\n"),
        Form::Events => format!("event: {name}\ndata: {json}\n\n"),
    })
}
