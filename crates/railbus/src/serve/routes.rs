//! The addresses of the API, and what each does.

use super::keys::{End, KEY_LEN_MAX, Keys};
use super::{answer, frames, guard, loan, page, stream};
use crate::api::ask;
use crate::api::problem::{Problem, codes};
use crate::api::types::{Lines, Modules, Points, SCHEMA};
use crate::i18n::Lang;
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::{HeaderMap, Response, StatusCode};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{get, post, put};
use railbus_site::Service;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::sync::Arc;
use tokio::sync::watch;

/// The longest request body.
const BODY_MAX: usize = 64 << 10;

/// What every handler needs.
#[derive(Clone, Debug)]
pub(super) struct Site {
    pub(super) service: Service,
    /// The language of those who ask for none.
    pub(super) lang: Lang,
    /// Nothing is real.
    pub(super) demo: bool,
    /// Streams end when the daemon does.
    pub(super) stop: watch::Receiver<bool>,
    pub(super) keys: Arc<Keys>,
    /// The configuration's file; none for the demo.
    pub(super) file: Option<Arc<std::path::Path>>,
}

type Answer = Response<Body>;
type Asked = Query<BTreeMap<String, String>>;

/// All addresses; over TCP those who ask must be of this machine.
pub(super) fn router(site: Site, tcp_port: Option<u16>) -> Router {
    let api = Router::new()
        .route("/lines", get(lines))
        .route("/modules", get(modules))
        .route("/modules/{module}/outputs", put(outputs))
        .route("/points", get(points))
        .route("/points/{module}/{label}", get(point).put(write))
        .route("/points/{module}/{label}/toggle", post(toggle))
        .route("/points/{module}/{label}/pulse", post(pulse))
        .route("/raw", post(raw))
        .route("/frames/stream", get(frames::stream))
        .route("/watch", get(stream::watch));
    // A line is lent over the socket only, which none but the daemon's own user may open.
    let api = match tcp_port {
        Some(_) => api,
        None => api.route("/lines/{line}/loan", post(loan::lend)),
    };
    let router = Router::new()
        .nest("/api/v1", api)
        .route("/", get(page::status))
        .route("/style.css", get(page::style))
        .route("/healthz", get(async || "ok\n"))
        .fallback(nothing)
        .method_not_allowed_fallback(not_so)
        .with_state(site)
        .layer(DefaultBodyLimit::max(BODY_MAX));
    let router = match tcp_port {
        Some(port) => router.layer(from_fn_with_state(port, guard::loopback)),
        None => router,
    };
    router.layer(from_fn(guard::headers))
}

async fn nothing() -> Answer {
    answer::problem(&Problem::new(codes::NO_SUCH_PAGE))
}

async fn not_so() -> Answer {
    let problem = Problem {
        status: StatusCode::METHOD_NOT_ALLOWED.as_u16(),
        ..Problem::new(codes::NO_SUCH_PAGE)
    };
    answer::problem(&problem.with("reason", "not with this method"))
}

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
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let what = ("write", format!("{module}.{label}"));
    let run = |service: Service, path: String, wanted| async move {
        ask::write(&service, &path, wanted).await
    };
    command(&site, &headers, what, &body, run).await
}

async fn outputs(
    State(site): State<Site>,
    Path(module): Path<String>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let run = |service: Service, module: String, wanted| async move {
        ask::outputs(&service, &module, wanted).await
    };
    command(&site, &headers, ("outputs", module), &body, run).await
}

async fn toggle(
    State(site): State<Site>,
    Path((module, label)): Path<(String, String)>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let what = ("toggle", format!("{module}.{label}"));
    let run = |service: Service, path: String, wanted| async move {
        ask::toggle(&service, &path, wanted).await
    };
    command(&site, &headers, what, &body, run).await
}

async fn pulse(
    State(site): State<Site>,
    Path((module, label)): Path<(String, String)>,
    headers: HeaderMap,
    body: Bytes,
) -> Answer {
    let what = ("pulse", format!("{module}.{label}"));
    let run = |service: Service, path: String, wanted| async move {
        ask::pulse(&service, &path, wanted).await
    };
    command(&site, &headers, what, &body, run).await
}

async fn raw(State(site): State<Site>, headers: HeaderMap, body: Bytes) -> Answer {
    let run = |service: Service, _, wanted| async move { ask::raw(&service, wanted).await };
    command(&site, &headers, ("raw", String::new()), &body, run).await
}

/// Reads the body, and carries a command out on a task of its own: who asked may go away, the
/// command still ends as it should. Under an `Idempotency-Key` it is carried out once.
async fn command<T, R, F, Fut>(
    site: &Site,
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
            match site.keys.slot(key, (&what, &body[..])) {
                Some(slot) => Some(slot),
                None => return bad_request("this Idempotency-Key stands for another command"),
            }
        }
        Some(_) => return bad_request("an Idempotency-Key has 1 to 128 characters of ASCII"),
    };
    let text: &[u8] = if body.is_empty() { b"{}" } else { body };
    let wanted = match serde_json::from_slice(text) {
        Ok(wanted) => wanted,
        Err(error) => return bad_request(&error.to_string()),
    };
    let end = run(site.service.clone(), what.1, wanted);
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
