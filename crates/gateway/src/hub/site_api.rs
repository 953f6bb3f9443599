//! The API of a site, asked through the centre: `/s/plant7/api/v1/points` is `/api/v1/points` of
//! plant7.

use crate::{answer, remote_api};
use async_nats::client::RequestErrorKind;
use async_nats::{Client, Request};
use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HeaderValue};
use axum::http::{Method, Response, StatusCode};
use prost::Message as _;
use railbus_api::fleet::TRANSIT_HEADER;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::message::{ApiAnswer, ApiRequest};
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::Instant;

/// How long a site may take: its own limit, and the way.
const ANSWER_MAX: Duration = Duration::from_secs(25);
/// After a site has connected, servers know only after a moment that it listens.
const INTEREST: Duration = Duration::from_secs(1);
/// How long to wait before asking again meanwhile.
const INTEREST_STEP: Duration = Duration::from_millis(100);
/// What a site may send. Anything else could be a page with scripts for a browser.
const MEDIA: [&str; 5] = [
    "application/json",
    "application/problem+json",
    "application/x-ndjson",
    "text/csv",
    "text/plain",
];
/// What anything else is.
const OCTETS: &str = "application/octet-stream";

/// How a site is asked.
pub(super) struct SiteWay {
    pub(super) client: Client,
    pub(super) subject: String,
    /// Ends with the connection to the servers.
    pub(super) is_up: watch::Receiver<bool>,
}

/// What a site answers.
pub(super) async fn ask(way: SiteWay, site: &str, request: ApiRequest) -> Response<Body> {
    asked(way, request).await.unwrap_or_else(|reason| {
        let problem = Problem::new(codes::SITE_AWAY).with("name", site);
        answer::problem(&problem.with("reason", reason))
    })
}

/// The request that may be passed on to a site; the problem if it may not.
pub(super) fn request(method: &Method, path: &str, language: &str) -> Result<ApiRequest, Problem> {
    if method != Method::GET {
        return Err(remote_api::not_remote(method.as_str()));
    }
    Ok(ApiRequest {
        method: method.as_str().to_owned(),
        path: path.to_owned(),
        // Only the owner of the centre can open its socket.
        user: "owner".to_owned(),
        language: language.to_owned(),
    })
}

/// The answer; or why there is none.
async fn asked(mut way: SiteWay, request: ApiRequest) -> Result<Response<Body>, String> {
    let payload = request.encode_to_vec();
    let begun = Instant::now();
    let (message, passed) = loop {
        let sent = Instant::now();
        let request = Request::new()
            .payload(payload.clone().into())
            .timeout(Some(ANSWER_MAX));
        let answer = tokio::select! {
            answer = way.client.send_request(way.subject.clone(), request) => answer,
            _ = way.is_up.wait_for(|is_up| !is_up) => {
                return Err("the connection to the servers was lost".to_owned());
            }
        };
        match answer {
            Ok(message) => break (message, sent.elapsed()),
            Err(error) if error.kind() == RequestErrorKind::NoResponders => {
                if begun.elapsed() > INTEREST {
                    return Err("it is not connected".to_owned());
                }
                tokio::time::sleep(INTEREST_STEP).await;
            }
            Err(error) if error.kind() == RequestErrorKind::TimedOut => {
                return Err(format!("no answer within {} s", ANSWER_MAX.as_secs()));
            }
            Err(error) => return Err(error.to_string()),
        }
    };
    let answer = ApiAnswer::decode(message.payload).map_err(|error| error.to_string())?;
    if let Some(refusal) = answer.refusal {
        let reason = format!("{} {}", refusal.code, refusal.reason);
        return Err(reason.trim().to_owned());
    }
    let transit = passed.saturating_sub(Duration::from_millis(answer.took_ms));
    response(answer, transit)
}

/// What it answers, as HTTP; or what it lacks.
fn response(said: ApiAnswer, transit: Duration) -> Result<Response<Body>, String> {
    let status = u16::try_from(said.status).ok().map(StatusCode::from_u16);
    let Some(Ok(status)) = status else {
        return Err(format!("an answer with status {}", said.status));
    };
    let kind = said.content_type.split(';').next().unwrap_or_default();
    let is_known = MEDIA.contains(&kind.trim());
    let kind = match HeaderValue::from_str(&said.content_type) {
        Ok(kind) if is_known => kind,
        _ => HeaderValue::from_static(OCTETS),
    };
    let mut response = Response::new(Body::from(said.body));
    *response.status_mut() = status;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, kind);
    let transit = u64::try_from(transit.as_millis()).unwrap_or(u64::MAX);
    headers.insert(TRANSIT_HEADER, transit.into());
    Ok(response)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_site_can_send_no_page() {
        let kind = |content_type: &str| {
            let said = ApiAnswer {
                status: 200,
                content_type: content_type.to_owned(),
                ..ApiAnswer::default()
            };
            let response = response(said, Duration::from_millis(1_234)).unwrap();
            assert_eq!(response.headers()[TRANSIT_HEADER], "1234");
            response.headers()[CONTENT_TYPE]
                .to_str()
                .unwrap()
                .to_owned()
        };
        for plain in ["application/json", "text/csv; charset=utf-8"] {
            assert_eq!(kind(plain), plain);
        }
        for other in ["text/html", "image/svg+xml", "", "text/plainer", "\n"] {
            assert_eq!(kind(other), OCTETS, "{other:?}");
        }
    }

    #[test]
    fn an_answer_without_a_status_is_none() {
        for (status, is_one) in [(200, true), (503, true), (0, false), (70_000, false)] {
            let said = ApiAnswer {
                status,
                ..ApiAnswer::default()
            };
            let told = response(said, Duration::ZERO).ok();
            let told = told.map(|told| u32::from(told.status().as_u16()));
            assert_eq!(told, is_one.then_some(status));
        }
    }

    #[test]
    fn only_what_reads_is_passed_on() {
        for method in [Method::PUT, Method::POST, Method::PATCH, Method::DELETE] {
            let refused = request(&method, "/api/v1/points/oven/k1", "").unwrap_err();
            assert_eq!(refused.code, "E0937");
        }
        let passed = request(&Method::GET, "/api/v1/points", "zh").unwrap();
        assert_eq!((&*passed.method, &*passed.language), ("GET", "zh"));
    }
}
