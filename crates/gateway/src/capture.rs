//! `GET /api/v1/frames`: records the traffic of a line for some seconds, as a file.

use super::access::{Caller, Need};
use super::doc::Doc;
use super::frame_listener::{FrameListener, modules};
use super::order::bad_request;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, language};
use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE, HeaderValue};
use axum::http::{HeaderMap, Response};
use axum::routing::get;
use http_body_util::channel::{Channel, Sender};
use railbus_api::problem::Problem;
use railbus_app::api::{ask, convert, failures};
use railbus_app::frames::packet::packet;
use railbus_app::frames::{Facts, as_json};
use railbus_host::Tap;
use railbus_site::Service;
use railbus_sniff::{SniffEvent, capture};
use railbus_wire::SerialSettings;
use railbus_words::Lang;
use std::convert::Infallible;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[Route::new("GET", "/frames", Need::VIEWER, || get(download))
    .stream()
    .doc(
        Doc::new("What passes on a line for some seconds, as a file")
            .query(&[
                ("line", "the line; may be left out where there is only one"),
                ("format", "pcapng or ndjson"),
                ("seconds", "how long, 1 to 600; 10 where it is not said"),
                ("lang", "en or zh"),
            ])
            .media(&["application/octet-stream", "application/x-ndjson"]),
    )];

/// How many chunks are buffered for a slow reader; more wait at the line, which drops the oldest.
const PIECES_MAX: usize = 64;
/// The default and the longest duration.
const SECONDS: u64 = 10;
const SECONDS_MAX: u64 = 600;

/// The file format.
#[derive(Clone, Copy)]
enum Form {
    Pcapng,
    Ndjson,
}

/// The recording of one line.
struct Recording {
    service: Service,
    line: String,
    settings: SerialSettings,
    lang: Lang,
    form: Form,
    end: Instant,
}

async fn download(
    State(site): State<Site>,
    asked: Asked,
    who: Extension<Caller>,
    headers: HeaderMap,
) -> Answer {
    let form = match asked.get("format").map(String::as_str) {
        None | Some("pcapng") => Form::Pcapng,
        Some("ndjson") => Form::Ndjson,
        Some(_) => return bad_request("\"format\" is pcapng or ndjson"),
    };
    let seconds = asked
        .get("seconds")
        .map_or(Ok(SECONDS), |text| text.parse());
    let Ok(seconds @ 1..=SECONDS_MAX) = seconds else {
        return bad_request("\"seconds\" is 1 to 600");
    };
    let lang = language::of(&site, &asked, &headers);
    match begin(&site, asked.get("line"), lang, form, seconds).await {
        Ok((recording, start, tap)) => {
            let (sender, body) = Channel::<Bytes, Infallible>::new(PIECES_MAX);
            let mut response = Response::new(Body::new(body));
            name(&mut response, form);
            tokio::spawn(recording.run(start, tap, sender, site.over(&who)));
            response
        }
        Err(problem) => answer::problem(&problem),
    }
}

fn name(response: &mut Answer, form: Form) {
    let (kind, name) = match form {
        Form::Pcapng => (
            "application/octet-stream",
            "attachment; filename=\"frames.pcapng\"",
        ),
        Form::Ndjson => (
            "application/x-ndjson",
            "attachment; filename=\"frames.ndjson\"",
        ),
    };
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(CONTENT_DISPOSITION, HeaderValue::from_static(name));
}

async fn begin(
    site: &Site,
    line: Option<&String>,
    lang: Lang,
    form: Form,
    seconds: u64,
) -> Result<(Recording, u64, Tap), Problem> {
    let service = site.service.clone();
    let line = match line {
        Some(line) => line.clone(),
        None => ask::only_line(&service)?,
    };
    let tap = service.tap(&line).await;
    let (now, tap) = tap.map_err(|failure| failures::of_line(&service, &line, &failure))?;
    let settings = service.line(&line).map(|status| status.serial);
    let recording = Recording {
        service,
        line,
        settings: settings.unwrap_or(SerialSettings::FACTORY),
        lang,
        form,
        end: Instant::now() + Duration::from_secs(seconds),
    };
    Ok((recording, convert::start_of(now), tap))
}

impl Recording {
    /// Until its time is over, the reader has gone, or loses its permission.
    async fn run(
        self,
        start: u64,
        mut tap: Tap,
        mut sender: Sender<Bytes, Infallible>,
        over: impl Future<Output = ()>,
    ) {
        let mut over = std::pin::pin!(over);
        let mut listener = FrameListener::new(start, self.settings);
        let mut heard = Vec::new();
        let mut pieces = self.head();
        loop {
            for piece in pieces.drain(..) {
                let sent = tokio::select! {
                    () = &mut over => return,
                    sent = sender.send_data(Bytes::from(piece)) => sent,
                };
                if sent.is_err() {
                    return;
                }
            }
            let due = listener.hear(&mut heard);
            tokio::select! {
                // What has arrived goes first: it decides what a deadline means.
                biased;
                () = &mut over => return,
                () = sleep_until(self.end) => return,
                passed = tap.next() => match passed {
                    None => return,
                    Some(Ok(passed)) => listener.take(&passed, &mut heard),
                    // A capture file has no place to say so; its times show it.
                    Some(Err(_)) => {}
                },
                () = listener.until(due) => listener.timeout(),
            }
            listener.hear(&mut heard);
            pieces = self.pieces(&mut heard);
        }
    }

    fn head(&self) -> Vec<Vec<u8>> {
        let program = concat!("railbus ", env!("CARGO_PKG_VERSION"));
        match self.form {
            Form::Pcapng => vec![
                capture::header(program),
                capture::interface(&self.line, &self.settings.to_string()),
            ],
            Form::Ndjson => Vec::new(),
        }
    }

    fn pieces(&self, heard: &mut Vec<SniffEvent>) -> Vec<Vec<u8>> {
        let modules = modules(&self.service, &self.line);
        let piece = |heard: SniffEvent| match self.form {
            Form::Pcapng => packet(self.lang, 0, &heard),
            Form::Ndjson => {
                let facts = Facts::of(&heard, &modules);
                let json = as_json(self.lang, &self.line, &heard, &facts);
                Some(format!("{json}\n").into_bytes())
            }
        };
        heard.drain(..).filter_map(piece).collect()
    }
}
