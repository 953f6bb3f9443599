//! What the centre tells over its socket.

use super::driver::HubCall;
use crate::{answer, guard};
use axum::Router;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::Response;
use axum::middleware::from_fn;
use axum::routing::get;
use railbus_api::problem::{Problem, codes};
use tokio::sync::{mpsc, oneshot};

type Calls = mpsc::Sender<HubCall>;

/// All routes, for its owner.
pub(super) fn router(calls: Calls) -> Router {
    Router::new()
        .route("/fleet/v1/sites", get(sites))
        .route("/fleet/v1/sites/{site}", get(site))
        .fallback(async || answer::problem(&Problem::new(codes::NO_SUCH_PAGE)))
        .with_state(calls)
        .layer(from_fn(guard::headers))
}

async fn sites(State(calls): State<Calls>) -> Response<Body> {
    answer::json(ask(&calls, HubCall::Sites).await)
}

async fn site(State(calls): State<Calls>, Path(name): Path<String>) -> Response<Body> {
    let found = ask(&calls, |to| HubCall::Site(name, to)).await;
    answer::json(found.and_then(|found| found))
}

async fn ask<T>(
    calls: &Calls,
    call: impl FnOnce(oneshot::Sender<T>) -> HubCall,
) -> Result<T, Problem> {
    let (to, told) = oneshot::channel();
    // Fails once the centre is stopping.
    let _ = calls.send(call(to)).await;
    told.await
        .map_err(|_| Problem::new(codes::DAEMON).with("reason", "stopping"))
}
