//! `POST /api/v1/lines/{line}/send`: sends a raw frame.

use super::access::Need;
use super::doc::Doc;
use super::order::Order;
use super::route::{Answer, Asked, Route};
use super::{answer, language};
use axum::extract::Path;
use axum::routing::post;
use railbus_api::sending::{SendAnswer, SendPlan, SendRequest};
use railbus_app::api::sending;
use railbus_site::Service;

/// The routes of this file.
pub(super) const ROUTES: &[Route] =
    &[
        Route::new("POST", "/lines/{line}/send", Need::ENGINEER, || post(send))
            .within_points()
            .doc(
                Doc::new("Send a frame of one's own, or say what it may do")
                    .query(&[DRY_RUN])
                    .takes::<SendRequest>()
                    .answers::<SendAnswer>()
                    .plans::<SendPlan>(),
            ),
    ];

const DRY_RUN: (&str, &str) = ("dry_run", "1: say what it is and may do, and send nothing");

async fn send(Path(line): Path<String>, asked: Asked, order: Order) -> Answer {
    let lang = language::spoken(&order.headers, order.site.lang);
    if asked.get("dry_run").is_some_and(|value| value == "1") {
        let plan = order.read().and_then(|wanted| {
            let plan = sending::plan(&order.site.service, lang, &line, &wanted)?;
            Ok(plan.told)
        });
        return answer::json(plan);
    }
    let may = move |service: &Service, line: &str, wanted: &SendRequest| {
        let plan = sending::plan(service, lang, line, wanted)?;
        sending::check_rights(service, &plan)?;
        sending::check_meant(&plan, wanted)
    };
    let run = move |service: Service, line: String, wanted: SendRequest| async move {
        let plan = sending::plan(&service, lang, &line, &wanted)?;
        sending::check_meant(&plan, &wanted)?;
        // The site asks for the rights once more.
        sending::carry_out(&service, lang, plan).await
    };
    order.carry_out_if(("send", line), may, run).await
}
