//! The routes of long-running operations.

use super::Op;
use crate::access::Need;
use crate::answer;
use crate::doc::Doc;
use crate::order::Order;
use crate::route::{Answer, Route};
use crate::site::Site;
use axum::extract::{Path, State};
use axum::routing::{delete, get, post};
use railbus_api::ops::{OpAnswer, OpInfo, OpState, Ops as OpList};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;

/// The routes of this file.
pub(crate) const ROUTES: &[Route] = &[
    Route::new("GET", "/ops", Need::VIEWER, || get(list))
        .doc(Doc::new("What runs, and what ended lately").answers::<OpList>()),
    Route::new("GET", "/ops/{op}", Need::VIEWER, || get(look))
        .doc(Doc::new("How something is that takes its time").answers::<OpInfo>()),
    Route::new("DELETE", "/ops/{op}", Need::ENGINEER, || delete(cancel))
        .doc(Doc::new("End it; what was found stays").answers::<OpInfo>()),
    Route::new("POST", "/ops/{op}/answer", Need::ENGINEER, || post(reply)).doc(
        Doc::new("Answer what it asks")
            .takes::<OpAnswer>()
            .answers::<OpInfo>(),
    ),
];

async fn list(State(site): State<Site>) -> Answer {
    let ops = site.ops.all().iter().map(Op::info).collect();
    let schema = SCHEMA;
    answer::json(Ok(OpList { schema, ops }))
}

async fn look(State(site): State<Site>, Path(op): Path<String>) -> Answer {
    answer::json(site.ops.get(&op).map(|op| op.info()))
}

async fn cancel(State(site): State<Site>, Path(op): Path<String>) -> Answer {
    let op = match site.ops.get(&op) {
        Ok(op) => op,
        Err(problem) => return answer::problem(&problem),
    };
    op.end_early();
    let mut told = op.follow();
    let ended = told.wait_for(|info| info.state != OpState::Running).await;
    let info = ended.map(|info| info.clone());
    answer::json(info.map_err(|_| Problem::new(codes::INTERNAL)))
}

async fn reply(Path(number): Path<String>, order: Order) -> Answer {
    let told = order.read::<OpAnswer>().and_then(|answer| {
        let op = order.site.ops.get(&number)?;
        let nothing = || Problem::new(codes::BAD_REQUEST).with("reason", "it asks nothing now");
        op.answer(answer.go).then(|| op.info()).ok_or_else(nothing)
    });
    answer::json(told)
}
