//! HTTP responses.

use axum::body::{Body, Bytes};
use axum::http::header::{CONTENT_TYPE, HeaderValue};
use axum::http::{Response, StatusCode};
use railbus_api::problem::Problem;
use serde::Serialize;

/// A value as JSON, or the problem.
pub(super) fn json(result: Result<impl Serialize, Problem>) -> Response<Body> {
    text(result.map(|value| serde_json::to_vec(&value).unwrap_or_default()))
}

/// The same for JSON that is text already.
pub(super) fn text(result: Result<impl Into<Bytes>, Problem>) -> Response<Body> {
    match result {
        Ok(body) => with(StatusCode::OK, "application/json", body),
        Err(why) => problem(&why),
    }
}

/// A problem [RFC 9457].
pub(super) fn problem(problem: &Problem) -> Response<Body> {
    let status = StatusCode::from_u16(problem.status);
    let status = status.unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let body = serde_json::to_vec(problem).unwrap_or_default();
    with(status, "application/problem+json", body)
}

/// Any body.
pub(super) fn with(
    status: StatusCode,
    content_type: &'static str,
    body: impl Into<Bytes>,
) -> Response<Body> {
    let mut response = Response::new(Body::from(body.into()));
    *response.status_mut() = status;
    let content_type = HeaderValue::from_static(content_type);
    response.headers_mut().insert(CONTENT_TYPE, content_type);
    response
}
