//! What there is to read and to switch: lines, modules and points.

use super::access::{Caller, Need, may_write};
use super::doc::Doc;
use super::keys::{End, KEY_LEN_MAX};
use super::routes::{Answer, Asked, Route, Site};
use super::{answer, body, frames, stream};
use crate::api::ask;
use crate::api::problem::{Problem, codes};
use crate::api::types::{
    CommandInfo, FrameEvent, Lines, Modules, OutputsRequest, OutputsWritten, PointInfo, Points,
    PulseRequest, Pulsed, RawAnswer, RawRequest, SCHEMA, ToggleRequest, WatchEvent, WriteRequest,
    Written,
};
use axum::Extension;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::routing::{get, post, put};
use railbus_site::Service;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/lines", Need::VIEWER, || get(lines))
        .doc(Doc::new("All lines").answers::<Lines>()),
    Route::new("GET", "/modules", Need::VIEWER, || get(modules))
        .doc(Doc::new("All modules").answers::<Modules>()),
    Route::new("PUT", "/modules/{module}/outputs", Need::OPERATOR, || {
        put(outputs)
    })
    .doc(
        Doc::new("Switch several outputs of a module at once")
            .takes::<OutputsRequest>()
            .answers::<OutputsWritten>(),
    ),
    Route::new("GET", "/points", Need::VIEWER, || get(points)).doc(
        Doc::new("All points, or those that are named")
            .query(&[SELECT, FRESH])
            .answers::<Points>(),
    ),
    Route::new("GET", "/points/{module}/{label}", Need::VIEWER, || {
        get(point)
    })
    .doc(Doc::new("A point").query(&[FRESH]).answers::<PointInfo>()),
    Route::new("PUT", "/points/{module}/{label}", Need::OPERATOR, || {
        put(write)
    })
    .doc(
        Doc::new("Switch an output")
            .takes::<WriteRequest>()
            .answers::<Written>(),
    ),
    Route::new(
        "POST",
        "/points/{module}/{label}/toggle",
        Need::OPERATOR,
        || post(toggle),
    )
    .doc(
        Doc::new("Switch an output over")
            .takes::<ToggleRequest>()
            .answers::<Written>(),
    ),
    Route::new(
        "POST",
        "/points/{module}/{label}/pulse",
        Need::OPERATOR,
        || post(pulse),
    )
    .doc(
        Doc::new("Switch an output for a time")
            .takes::<PulseRequest>()
            .answers::<Pulsed>(),
    ),
    Route::new("POST", "/raw", Need::ENGINEER, || post(raw)).doc(
        Doc::new("Send a read of one's own")
            .takes::<RawRequest>()
            .answers::<RawAnswer>(),
    ),
    Route::new("GET", "/commands/{id}", Need::VIEWER, || get(given)).doc(
        Doc::new("A command that was given lately, and how it ended").answers::<CommandInfo>(),
    ),
    Route::new("GET", "/frames/stream", Need::VIEWER, || {
        get(frames::stream)
    })
    .doc(
        Doc::new("What passes on a line, as it passes")
            .query(&[("line", "the line; may be left out where there is only one")])
            .media("application/x-ndjson")
            .answers::<FrameEvent>(),
    ),
    Route::new("GET", "/watch", Need::VIEWER, || get(stream::watch)).doc(
        Doc::new("What changes, as it changes")
            .query(&[SELECT])
            .media("application/x-ndjson")
            .answers::<WatchEvent>(),
    ),
];

/// How points are named in a query.
const SELECT: (&str, &str) = (
    "select",
    "paths or modules, with `*` and `?`, divided by commas",
);
const FRESH: (&str, &str) = ("fresh", "1: read them now");

async fn lines(State(site): State<Site>) -> Answer {
    let lines = ask::lines(&site.service);
    let schema = SCHEMA;
    answer::json(Ok(Lines { schema, lines }))
}

async fn modules(State(site): State<Site>) -> Answer {
    let modules = ask::modules(&site.service);
    let schema = SCHEMA;
    answer::json(Ok(Modules { schema, modules }))
}

async fn points(State(site): State<Site>, asked: Asked) -> Answer {
    let selectors = match selectors(&site.service, &asked) {
        Ok(selectors) => selectors,
        Err(problem) => return answer::problem(&problem),
    };
    let points = match is_set(&asked, "fresh") {
        true => ask::fresh_points(&site.service, &selectors).await,
        false => Ok(ask::points(&site.service, &selectors)),
    };
    let schema = SCHEMA;
    answer::json(points.map(|points| Points { schema, points }))
}

async fn point(
    State(site): State<Site>,
    Path((module, label)): Path<(String, String)>,
    asked: Asked,
) -> Answer {
    let path = format!("{module}.{label}");
    answer::json(ask::point(&site.service, &path, is_set(&asked, "fresh")).await)
}

async fn write(
    State(site): State<Site>,
    Path((module, label)): Path<(String, String)>,
    who: Extension<Caller>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let what = ("write", format!("{module}.{label}"));
    if let Err(problem) = who.may_write(&what.1) {
        return answer::problem(&problem);
    }
    let run = |service: Service, path: String, wanted| async move {
        ask::write(&service, &path, wanted).await
    };
    command(&site, &who, &headers, what, &body, run).await
}

async fn outputs(
    State(site): State<Site>,
    Path(module): Path<String>,
    who: Extension<Caller>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let rights = Arc::clone(&who.points);
    let run = |service: Service, module: String, wanted: OutputsRequest| async move {
        let mut labels = wanted.set.keys();
        labels.try_for_each(|label| may_write(&rights, &module, label))?;
        ask::outputs(&service, &module, wanted).await
    };
    command(&site, &who, &headers, ("outputs", module), &body, run).await
}

async fn toggle(
    State(site): State<Site>,
    Path((module, label)): Path<(String, String)>,
    who: Extension<Caller>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let what = ("toggle", format!("{module}.{label}"));
    if let Err(problem) = who.may_write(&what.1) {
        return answer::problem(&problem);
    }
    let run = |service: Service, path: String, wanted| async move {
        ask::toggle(&service, &path, wanted).await
    };
    command(&site, &who, &headers, what, &body, run).await
}

async fn pulse(
    State(site): State<Site>,
    Path((module, label)): Path<(String, String)>,
    who: Extension<Caller>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let what = ("pulse", format!("{module}.{label}"));
    if let Err(problem) = who.may_write(&what.1) {
        return answer::problem(&problem);
    }
    let run = |service: Service, path: String, wanted| async move {
        ask::pulse(&service, &path, wanted).await
    };
    command(&site, &who, &headers, what, &body, run).await
}

async fn given(State(site): State<Site>, Path(id): Path<String>) -> Answer {
    answer::json(ask::command(&site.service, &id))
}

async fn raw(
    State(site): State<Site>,
    who: Extension<Caller>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let run = |service: Service, _, wanted| async move { ask::raw(&service, wanted).await };
    command(&site, &who, &headers, ("raw", String::new()), &body, run).await
}

/// Reads the body, and carries a command out on a task of its own: who asked may go away, the
/// command still ends as it should. Under an `Idempotency-Key` it is carried out once.
pub(super) async fn command<T, R, F, Fut>(
    site: &Site,
    who: &Caller,
    headers: &HeaderMap,
    what: (&'static str, String),
    body: &Bytes,
    run: F,
) -> Answer
where
    T: DeserializeOwned,
    R: Serialize,
    F: FnOnce(Service, String, T) -> Fut,
    Fut: Future<Output = Result<R, Problem>> + Send + 'static,
{
    let slot = match headers.get("idempotency-key").map(|key| key.to_str()) {
        None => None,
        Some(Ok(key)) if (1..=KEY_LEN_MAX).contains(&key.len()) => {
            match site.keys.slot(key, (&who.name, &what, &body[..])) {
                Some(slot) => Some(slot),
                None => return bad_request("this Idempotency-Key stands for another command"),
            }
        }
        Some(_) => return bad_request("an Idempotency-Key has 1 to 128 characters of ASCII"),
    };
    let text: &[u8] = if body.is_empty() { b"{}" } else { body };
    let wanted = match body::parse(text) {
        Ok(wanted) => wanted,
        Err(error) => return bad_request(&error.to_string()),
    };
    let service = site.service.on_behalf_of(who.origin());
    let end = run(service, what.1, wanted);
    let end = async move { end.await.map(as_json) };
    let task = tokio::spawn(async move {
        match slot {
            Some(slot) => slot.get_or_init(|| end).await.clone(),
            None => end.await,
        }
    });
    let broken = |error: tokio::task::JoinError| -> End {
        Err(Problem::new(codes::INTERNAL).with("reason", error.to_string()))
    };
    answer::text(task.await.unwrap_or_else(broken))
}

fn as_json(value: impl Serialize) -> Bytes {
    // The API's own types are all JSON.
    Bytes::from(serde_json::to_vec(&value).unwrap_or_default())
}

pub(super) fn bad_request(reason: &str) -> Answer {
    answer::problem(&Problem::new(codes::BAD_REQUEST).with("reason", reason))
}

fn is_set(asked: &Asked, key: &str) -> bool {
    asked
        .get(key)
        .is_some_and(|value| value != "0" && value != "false")
}

/// What `select` and `module` name.
pub(super) fn selectors(service: &Service, asked: &Asked) -> Result<Vec<String>, Problem> {
    let named = ["select", "module"]
        .into_iter()
        .filter_map(|key| asked.get(key));
    let named = named.flat_map(|names| names.split(','));
    let selectors: Vec<String> = named
        .filter(|name| !name.is_empty())
        .map(str::to_owned)
        .collect();
    for selector in &selectors {
        ask::check_selector(service, selector)?;
    }
    Ok(selectors)
}
