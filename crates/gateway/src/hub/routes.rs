//! What the centre tells over its socket.

use super::command::{self, GivenCommand};
use super::driver::HubCall;
use super::site_api;
use crate::{answer, guard};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::header::ACCEPT_LANGUAGE;
use axum::http::{HeaderMap, Method, Response, Uri};
use axum::middleware::from_fn;
use axum::routing::{any, get};
use railbus_api::problem::{Problem, codes};
use tokio::sync::{mpsc, oneshot};

pub(super) type Calls = mpsc::Sender<HubCall>;

/// All routes, for its owner.
pub(super) fn router(calls: Calls) -> Router {
    Router::new()
        .route("/fleet/v1/sites", get(sites))
        .route("/fleet/v1/sites/{site}", get(site))
        .route("/fleet/v1/commands", get(commands))
        .route("/s/{site}/{*path}", any(site_api))
        .fallback(async || answer::problem(&Problem::new(codes::NO_SUCH_PAGE)))
        .with_state(calls)
        .layer(from_fn(guard::headers))
}

async fn sites(State(calls): State<Calls>) -> Response<Body> {
    answer::json(call(&calls, HubCall::Sites).await)
}

async fn commands(State(calls): State<Calls>) -> Response<Body> {
    answer::json(call(&calls, HubCall::Commands).await)
}

async fn site(State(calls): State<Calls>, Path(name): Path<String>) -> Response<Body> {
    let found = call(&calls, |to| HubCall::Site(name, to)).await;
    answer::json(found.and_then(|found| found))
}

/// The API of a site: the path behind its name, with the query.
async fn site_api(
    State(calls): State<Calls>,
    Path((name, _)): Path<(String, String)>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
    body: Bytes,
) -> Response<Body> {
    let path = uri.path_and_query().map_or("", |path| path.as_str());
    let path = path.splitn(4, '/').nth(3).unwrap_or_default();
    let language = headers.get(ACCEPT_LANGUAGE);
    let language = language.and_then(|value| value.to_str().ok());
    let language = language.unwrap_or_default();
    let path = format!("/{path}");
    if method == Method::PUT || method == Method::POST {
        let key = headers.get("idempotency-key");
        // What is no text is no key.
        let key = key.map(|key| key.to_str().unwrap_or_default());
        let given = GivenCommand::new((name, key), (method.as_str(), &path), body, language);
        return match given {
            Ok(given) => command::give(&calls, given).await,
            Err(problem) => answer::problem(&problem),
        };
    }
    let request = site_api::request(&method, &path, language);
    let asked = async { site_api::ask(&calls, &name, request?).await };
    asked
        .await
        .unwrap_or_else(|problem| answer::problem(&problem))
}

/// Asks the driver.
pub(super) async fn call<T>(
    calls: &Calls,
    what: impl FnOnce(oneshot::Sender<T>) -> HubCall,
) -> Result<T, Problem> {
    let (to, told) = oneshot::channel();
    // Fails once the centre is stopping.
    let _ = calls.send(what(to)).await;
    told.await
        .map_err(|_| Problem::new(codes::DAEMON).with("reason", "stopping"))
}
