//! Lines, modules and points: reading and switching.

use super::access::{Need, may_write};
use super::doc::Doc;
use super::order::Order;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, frames, stream};
use axum::extract::{Path, State};
use axum::routing::{get, post, put};
use railbus_api::problem::Problem;
use railbus_api::types::{
    CommandInfo, FrameEvent, Lines, Modules, OutputsRequest, OutputsWritten, PointInfo, Points,
    PulseRequest, Pulsed, SCHEMA, ToggleRequest, WatchEvent, WriteRequest, Written,
};
use railbus_app::api::{ask, print};
use railbus_site::Service;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/lines", Need::VIEWER, || get(lines))
        .doc(Doc::new("All lines").answers::<Lines>()),
    Route::new("GET", "/modules", Need::VIEWER, || get(modules))
        .doc(Doc::new("All modules").answers::<Modules>()),
    Route::new("PUT", "/modules/{module}/outputs", Need::OPERATOR, || {
        put(outputs)
    })
    .within_points()
    .command()
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
    .within_points()
    .command()
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
    .within_points()
    .command()
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
    .within_points()
    .command()
    .doc(
        Doc::new("Switch an output for a time")
            .takes::<PulseRequest>()
            .answers::<Pulsed>(),
    ),
    Route::new("GET", "/commands/{id}", Need::VIEWER, || get(given)).doc(
        Doc::new("A command that was given lately, and how it ended").answers::<CommandInfo>(),
    ),
    Route::new("GET", "/frames/stream", Need::VIEWER, || {
        get(frames::stream)
    })
    .stream()
    .doc(
        Doc::new("What passes on a line, as it passes")
            .query(&[("line", "the line; may be left out where there is only one")])
            .media(&["application/x-ndjson"])
            .answers::<FrameEvent>(),
    ),
    Route::new("GET", "/watch", Need::VIEWER, || get(stream::watch))
        .stream()
        .doc(
            Doc::new("What changes, as it changes")
                .query(&[SELECT])
                .media(&["application/x-ndjson"])
                .answers::<WatchEvent>(),
        ),
];

/// How points are selected in a query.
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
    if !is_set(&asked, "fresh") {
        return answer::text(Ok(print::points(&site.service, &selectors)));
    }
    let points = ask::fresh_points(&site.service, &selectors).await;
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

async fn write(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let run = |service: Service, path: String, wanted| async move {
        ask::write(&service, &path, wanted).await
    };
    order.on_point("write", place, run).await
}

async fn outputs(Path(module): Path<String>, order: Order) -> Answer {
    let rights = order.rights();
    let may = move |_: &Service, module: &str, wanted: &OutputsRequest| {
        let mut labels = wanted.set.keys();
        labels.try_for_each(|label| may_write(&rights, module, label))
    };
    let run = |service: Service, module: String, wanted| async move {
        ask::outputs(&service, &module, wanted).await
    };
    order.carry_out_if(("outputs", module), may, run).await
}

async fn toggle(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let run = |service: Service, path: String, wanted| async move {
        ask::toggle(&service, &path, wanted).await
    };
    order.on_point("toggle", place, run).await
}

async fn pulse(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let run = |service: Service, path: String, wanted| async move {
        ask::pulse(&service, &path, wanted).await
    };
    order.on_point("pulse", place, run).await
}

async fn given(State(site): State<Site>, Path(id): Path<String>) -> Answer {
    answer::json(ask::command(&site.service, &id))
}

fn is_set(asked: &Asked, key: &str) -> bool {
    asked
        .get(key)
        .is_some_and(|value| value != "0" && value != "false")
}

/// The selectors in `select` and `module`.
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
