//! The API of a site, asked through the centre: `/s/plant7/api/v1/points` is `/api/v1/points` of
//! plant7.

use super::driver::HubCall;
use super::routes::{Calls, call};
use crate::clock::since_boot;
use crate::localize::ToldElsewhere;
use crate::remote_api;
use async_nats::client::RequestErrorKind;
use async_nats::{Client, Message, Request};
use axum::body::{Body, Bytes};
use axum::http::header::{CONTENT_TYPE, HeaderValue};
use axum::http::{Method, Response, StatusCode};
use prost::Message as _;
use railbus_api::fleet::TRANSIT_HEADER;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::API_ANSWER_MAX;
use railbus_fleet::message::{ApiAnswer, ApiRequest, FleetRefusal};
use railbus_words::width::is_shown;
use std::time::Duration;
use tokio::sync::watch;

/// After a site has connected, servers know only after a moment that it listens.
pub(super) const INTEREST: Duration = Duration::from_secs(1);
/// How long to wait before asking again meanwhile.
pub(super) const INTEREST_STEP: Duration = Duration::from_millis(100);
/// How long an answer may be on its way that tells how something is now. What it tells of states
/// has no age, and people look at it as at what is so.
const TRANSIT_MAX: Duration = Duration::from_secs(2);
/// How much two clocks may differ over a moment, besides a thousandth.
const CLOCKS_DIFFER: Duration = Duration::from_millis(5);
/// What tells of the past, and may take its time.
const PAST: [&str; 2] = ["/api/v1/history", "/api/v1/events"];
/// The longest reason of a refusal, in characters.
const REASON_MAX: usize = 200;
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

/// Why a request to a site has no answer.
pub(super) enum Unanswered {
    /// Not delivered: no responders on the subject.
    NotDelivered,
    /// No answer in time. It may have been delivered.
    TimedOut,
    /// The centre lost its own connection. It may have been delivered.
    Disconnected,
    /// It could not be sent, or its answer not be received, for this reason.
    Failed(String),
}

impl SiteWay {
    /// Sends one request.
    pub(super) async fn request(&self, payload: Bytes) -> Result<Message, Unanswered> {
        let request = Request::new()
            .payload(payload)
            .timeout(Some(API_ANSWER_MAX));
        let mut is_up = self.is_up.clone();
        let answer = tokio::select! {
            answer = self.client.send_request(self.subject.clone(), request) => answer,
            _ = is_up.wait_for(|is_up| !is_up) => return Err(Unanswered::Disconnected),
        };
        answer.map_err(|error| match error.kind() {
            RequestErrorKind::NoResponders => Unanswered::NotDelivered,
            RequestErrorKind::TimedOut => Unanswered::TimedOut,
            _ => Unanswered::Failed(error.to_string()),
        })
    }
}

/// The answer of a site to a request of this kind, and how long it took; or why there is none.
///
/// # Errors
/// There is no such site, it is not connected or does not answer in time, or the centre has lost
/// its own connection.
pub(super) async fn send(
    calls: &Calls,
    (site, what): (&str, &'static str),
    payload: Bytes,
) -> Result<(Message, Duration), Problem> {
    let begun = since_boot();
    loop {
        // Each time anew: it may have got another session.
        let way = call(calls, |to| HubCall::Way(site.to_owned(), what, to)).await??;
        // What was suspended on the way is older, too.
        let sent = since_boot();
        match way.request(payload.clone()).await {
            Ok(message) => return Ok((message, since_boot().saturating_sub(sent))),
            Err(Unanswered::NotDelivered) => {
                if since_boot().saturating_sub(begun) > INTEREST {
                    return Err(away(site, "it is not connected"));
                }
                tokio::time::sleep(INTEREST_STEP).await;
            }
            Err(Unanswered::TimedOut) => {
                let waited = API_ANSWER_MAX.as_secs();
                return Err(away(site, &format!("nothing within {waited} s")));
            }
            Err(Unanswered::Disconnected) => {
                return Err(Problem::new(codes::FLEET_ENDED).with("reason", "disconnected"));
            }
            Err(Unanswered::Failed(reason)) => return Err(away(site, &reason)),
        }
    }
}

/// A site does not answer, for this reason.
pub(super) fn away(site: &str, reason: &str) -> Problem {
    let problem = Problem::new(codes::SITE_AWAY).with("name", site);
    problem.with("reason", reason)
}

/// What the API of a site answers; or why there is no answer.
///
/// # Errors
/// As of [`send`], or the site refuses it.
pub(super) async fn ask(
    calls: &Calls,
    site: &str,
    request: ApiRequest,
) -> Result<Response<Body>, Problem> {
    let none = |reason: String| away(site, &reason);
    let payload = Bytes::from(request.encode_to_vec());
    let (message, passed) = send(calls, (site, "api"), payload).await?;
    let answer = ApiAnswer::decode(message.payload).map_err(|error| none(error.to_string()))?;
    if let Some(refusal) = answer.refusal {
        return Err(none(shown(&refusal)));
    }
    let transit = transit(passed, Duration::from_millis(answer.took_ms));
    let is_of_now = !PAST.iter().any(|path| request.path.starts_with(path));
    if is_of_now && transit > TRANSIT_MAX {
        let way = transit.as_secs_f64();
        return Err(none(format!("its answer was {way:.1} s on the way")));
    }
    response(answer, transit).map_err(none)
}

/// Why a site, or the ledger, refused something.
pub(super) fn shown(refusal: &FleetRefusal) -> String {
    let said = match refusal.reason.is_empty() {
        true => &refusal.code,
        false => &refusal.reason,
    };
    let shown = said.chars().filter(|letter| is_shown(*letter));
    shown.take(REASON_MAX).collect()
}

/// How long an answer was on the way, there and back.
fn transit(passed: Duration, took: Duration) -> Duration {
    match passed.checked_sub(took) {
        Some(transit) => transit,
        // Clocks run a little faster or slower.
        None if took <= passed + passed / 1_000 + CLOCKS_DIFFER => Duration::ZERO,
        // It can't have taken longer than it was waited for.
        None => passed,
    }
}

/// The request that may be passed on to a site; the problem if it may not.
pub(super) fn request(
    method: &Method,
    path: &str,
    (user, language): (&str, &str),
) -> Result<ApiRequest, Problem> {
    if method != Method::GET {
        return Err(remote_api::not_remote(method.as_str()));
    }
    Ok(ApiRequest {
        method: method.as_str().to_owned(),
        path: path.to_owned(),
        user: user.to_owned(),
        language: language.to_owned(),
    })
}

/// What it answers, as HTTP; or what it lacks.
pub(super) fn response(said: ApiAnswer, transit: Duration) -> Result<Response<Body>, String> {
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
    response.extensions_mut().insert(ToldElsewhere);
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
    fn no_site_makes_its_answers_fresher() {
        let ms = Duration::from_millis;
        assert_eq!(transit(ms(900), ms(600)), ms(300));
        assert_eq!(transit(ms(900), ms(900)), ms(0));
        assert_eq!(transit(ms(900), ms(905)), ms(0));
        assert_eq!(transit(ms(900), ms(906)), ms(900));
        assert_eq!(transit(ms(900), Duration::MAX), ms(900));
    }

    #[test]
    fn only_what_reads_is_passed_on() {
        for method in [Method::PUT, Method::POST, Method::PATCH, Method::DELETE] {
            let refused = request(&method, "/api/v1/points/oven/k1", ("li", "")).unwrap_err();
            assert_eq!(refused.code, "E0937");
        }
        let passed = request(&Method::GET, "/api/v1/points", ("li", "zh")).unwrap();
        assert_eq!((&*passed.method, &*passed.language), ("GET", "zh"));
        assert_eq!(passed.user, "li");
    }
}
