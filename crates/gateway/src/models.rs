//! `GET /api/v1/models`: the datasheets of the models that railbus knows.

use super::access::Need;
use super::doc::Doc;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, language};
use axum::extract::State;
use axum::http::HeaderMap;
use axum::routing::get;
use railbus_api::models::Models;
use railbus_app::api::models;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[Route::new("GET", "/models", Need::VIEWER, || get(list))
    .doc(
        Doc::new("The models that railbus knows: what their datasheets say")
            .query(&[("lang", "en or zh")])
            .answers::<Models>(),
    )];

async fn list(State(site): State<Site>, asked: Asked, headers: HeaderMap) -> Answer {
    answer::json(Ok(models::all(language::of(&site, &asked, &headers))))
}
