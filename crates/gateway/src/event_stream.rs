//! `GET /api/v1/events/stream`: events as they happen, for a browser or `curl`.

use super::access::{Caller, Need};
use super::doc::Doc;
use super::route::{Answer, Route};
use super::site::Site;
use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::Response;
use axum::http::header::{CONTENT_TYPE, HeaderValue};
use axum::routing::get;
use http_body_util::channel::{Channel, Sender};
use railbus_api::past::EventInfo;
use railbus_app::api::past;
use railbus_site::Events;
use std::convert::Infallible;
use std::time::Duration;

/// The routes of this file.
pub(super) const ROUTES: &[Route] =
    &[
        Route::new("GET", "/events/stream", Need::VIEWER, || get(stream))
            .stream()
            .doc(
                Doc::new("What happens, as it happens")
                    .media(&["text/event-stream"])
                    .answers::<EventInfo>(),
            ),
    ];

/// How many chunks are buffered for a slow reader; more wait at the site, which drops the oldest.
const PIECES_MAX: usize = 16;
/// After this time without an event something is sent, to detect readers that have gone.
const ALIVE: Duration = Duration::from_secs(15);

async fn stream(State(site): State<Site>, who: Extension<Caller>) -> Answer {
    let (sender, body) = Channel::<Bytes, Infallible>::new(PIECES_MAX);
    tokio::spawn(send(site.service.follow_events(), sender, site.over(&who)));
    let mut response = Response::new(Body::new(body));
    let kind = HeaderValue::from_static("text/event-stream");
    response.headers_mut().insert(CONTENT_TYPE, kind);
    response
}

/// Sends until the reader has gone or loses its permission, or the daemon stops.
async fn send(
    mut events: Events,
    mut sender: Sender<Bytes, Infallible>,
    over: impl Future<Output = ()>,
) {
    let mut over = std::pin::pin!(over);
    // The first chunk shows the reader that it is connected.
    let mut piece = String::from(":\n\n");
    loop {
        let sent = tokio::select! {
            () = &mut over => return,
            sent = sender.send_data(Bytes::from(piece)) => sent,
        };
        if sent.is_err() {
            return;
        }
        piece = tokio::select! {
            () = &mut over => return,
            event = tokio::time::timeout(ALIVE, events.next()) => match event {
                Ok(None) => return,
                Ok(Some(Ok(event))) => told(&past::of_event(event)),
                Ok(Some(Err(dropped))) => format!("event: gap\ndata: {dropped}\n\n"),
                Err(_) => ":\n\n".to_owned(),
            },
        };
    }
}

fn told(event: &EventInfo) -> String {
    let json = serde_json::to_string(event).unwrap_or_default();
    format!("id: {}\nevent: {}\ndata: {json}\n\n", event.id, event.kind)
}
