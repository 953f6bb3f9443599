//! `POST /api/v1/lines/{line}/send`: sends a raw frame.

use super::access::{Need, limited, may_write};
use super::doc::Doc;
use super::order::Order;
use super::route::{Answer, Asked, Route};
use super::{answer, language};
use axum::extract::Path;
use axum::routing::post;
use railbus_api::problem::{Problem, codes};
use railbus_api::sending::{SendAnswer, SendPlan, SendRequest};
use railbus_app::api::sending::{self, Plan};
use railbus_commission::Risk;
use railbus_device::PointKind;
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
    let rights = order.rights();
    let may = move |service: &Service, line: &str, wanted: &SendRequest| {
        let plan = sending::plan(service, lang, line, wanted)?;
        may_send(service, &rights, &plan)?;
        sending::check_meant(&plan, wanted)
    };
    let rights = order.rights();
    let run = move |service: Service, line: String, wanted: SendRequest| async move {
        let plan = sending::plan(&service, lang, &line, &wanted)?;
        // Once more: the configuration may have changed.
        may_send(&service, &rights, &plan)?;
        sending::check_meant(&plan, &wanted)?;
        sending::carry_out(&service, lang, plan).await
    };
    order.carry_out_if(("send", line), may, run).await
}

/// Whether the rights cover everything that the frame may do: a caller limited to some points sends
/// nothing that could affect others.
fn may_send(service: &Service, rights: &[String], plan: &Plan) -> Result<(), Problem> {
    if rights.is_empty() || !plan.changes() {
        return Ok(());
    }
    // Stored settings include the address: another module would answer to the name of this one.
    if plan.risk() > Risk::Output {
        return Err(limited(rights));
    }
    if plan.modules.is_empty() {
        let problem = Problem::new(codes::POINT_RIGHT);
        return Err(problem.with("line", plan.told.line.as_str()));
    }
    let points = plan
        .modules
        .iter()
        .flat_map(|module| service.points(module));
    let mut outputs = points.filter(|status| status.point.kind == PointKind::Output);
    outputs.try_for_each(|status| may_write(rights, &status.module, &status.label))
}
