//! The traffic of a line as JSON lines. The line is not affected, and without subscribers it does
//! no work for this.

use super::access::Caller;
use super::answer;
use super::site::Site;
use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::{Query, State};
use axum::http::Response;
use axum::http::header::{CONTENT_TYPE, HeaderValue};
use http_body_util::channel::{Channel, Sender};
use railbus_api::problem::Problem;
use railbus_api::types::FrameEvent;
use railbus_app::api::{ask, convert, failures};
use railbus_host::Tap;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::time::Duration;

/// How many chunks are buffered for a slow reader; more wait at the line, which drops the oldest.
const PIECES_MAX: usize = 64;
/// After this time without an event an empty line is sent, to detect readers that have gone.
const ALIVE: Duration = Duration::from_secs(15);

/// `GET /api/v1/frames/stream`.
pub(super) async fn stream(
    State(site): State<Site>,
    asked: Query<BTreeMap<String, String>>,
    who: Extension<Caller>,
) -> Response<Body> {
    match begin(&site, &who, asked.get("line")).await {
        Ok(body) => {
            let mut response = Response::new(body);
            let kind = HeaderValue::from_static("application/x-ndjson");
            response.headers_mut().insert(CONTENT_TYPE, kind);
            response
        }
        Err(problem) => answer::problem(&problem),
    }
}

async fn begin(site: &Site, who: &Caller, line: Option<&String>) -> Result<Body, Problem> {
    let line = match line {
        Some(line) => line.clone(),
        None => ask::only_line(&site.service)?,
    };
    let tap = site.service.tap(&line).await;
    let (now, tap) = tap.map_err(|failure| failures::of_line(&site.service, &line, &failure))?;
    let epoch = jiff::Timestamp::now().as_microsecond();
    let start = u64::try_from(epoch)
        .unwrap_or_default()
        .saturating_sub(now.0);
    let (sender, body) = Channel::<Bytes, Infallible>::new(PIECES_MAX);
    let first = site.service.line(&line).map(|status| FrameEvent::Line {
        line: convert::line(status),
    });
    tokio::spawn(send(first, tap, start, sender, site.over(who)));
    Ok(Body::new(body))
}

/// Sends until the reader has gone or loses its permission, or the line or the daemon ends.
async fn send(
    first: Option<FrameEvent>,
    mut tap: Tap,
    start: u64,
    mut sender: Sender<Bytes, Infallible>,
    over: impl Future<Output = ()>,
) {
    let mut over = std::pin::pin!(over);
    let mut piece = first.map(|event| as_line(&event)).unwrap_or_default();
    loop {
        let sent = tokio::select! {
            () = &mut over => return,
            sent = sender.send_data(piece) => sent,
        };
        if sent.is_err() {
            return;
        }
        piece = tokio::select! {
            () = &mut over => return,
            passed = tokio::time::timeout(ALIVE, tap.next()) => match passed {
                Ok(Some(passed)) => as_line(&convert::passed(start, passed)),
                Ok(None) => return,
                Err(_) => Bytes::from_static(b"\n"),
            },
        };
    }
}

fn as_line(event: &FrameEvent) -> Bytes {
    let json = serde_json::to_string(event).unwrap_or_default();
    Bytes::from(json + "\n")
}
