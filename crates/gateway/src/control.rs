//! Several outputs at once, groups, scenes, and leases.

use super::access::{Need, may_write};
use super::answer;
use super::doc::Doc;
use super::order::Order;
use super::route::{Answer, Route};
use super::site::Site;
use axum::extract::{Path, State};
use axum::routing::{delete, get, post, put};
use railbus_api::control::{
    BatchAnswer, BatchRequest, GroupRequest, Groups, LeaseAnswer, LeaseRequest, SceneRequest,
    Scenes,
};
use railbus_api::problem::Problem;
use railbus_api::types::SCHEMA;
use railbus_app::api::control;
use railbus_site::{Service, paths};
use serde_json::Value;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("POST", "/batch", Need::OPERATOR, || post(batch))
        .within_points()
        .command()
        .doc(
            Doc::new("Switch several outputs of any modules")
                .takes::<BatchRequest>()
                .answers::<BatchAnswer>(),
        ),
    Route::new("GET", "/groups", Need::VIEWER, || get(groups))
        .doc(Doc::new("All groups").answers::<Groups>()),
    Route::new("POST", "/groups/{group}/set", Need::OPERATOR, || {
        post(set_group)
    })
    .within_points()
    .command()
    .doc(
        Doc::new("Switch a group")
            .takes::<GroupRequest>()
            .answers::<BatchAnswer>(),
    ),
    Route::new("GET", "/scenes", Need::VIEWER, || get(scenes))
        .doc(Doc::new("All scenes").answers::<Scenes>()),
    Route::new("POST", "/scenes/{scene}/run", Need::OPERATOR, || post(play))
        .within_points()
        .command()
        .doc(
            Doc::new("Play a scene, up to the first step that fails")
                .takes::<SceneRequest>()
                .answers::<BatchAnswer>(),
        ),
    Route::new(
        "PUT",
        "/points/{module}/{label}/lease",
        Need::OPERATOR,
        || put(lease),
    )
    .within_points()
    .doc(
        Doc::new("Hold an output for as long as that is said again")
            .takes::<LeaseRequest>()
            .answers::<LeaseAnswer>(),
    ),
    Route::new(
        "DELETE",
        "/points/{module}/{label}/lease",
        Need::OPERATOR,
        || delete(end_lease),
    )
    .within_points()
    .doc(Doc::new("Give an output back").answers::<LeaseAnswer>()),
];

/// Whether the rights cover all of these outputs.
fn may_write_all(rights: &[String], outputs: &[String]) -> Result<(), Problem> {
    outputs.iter().try_for_each(|path| {
        let (module, label) = paths::split(path).unwrap_or((path, ""));
        may_write(rights, module, label)
    })
}

async fn batch(order: Order) -> Answer {
    let rights = order.rights();
    let may = move |_: &Service, _: &str, wanted: &BatchRequest| {
        let outputs: Vec<String> = wanted.set.iter().map(|item| item.path.clone()).collect();
        may_write_all(&rights, &outputs)
    };
    let run = |service: Service, _, wanted| async move { control::batch(&service, wanted).await };
    order.carry_out_if(("batch", String::new()), may, run).await
}

async fn groups(State(site): State<Site>) -> Answer {
    let groups = control::groups(&site.service);
    let schema = SCHEMA;
    answer::json(Ok(Groups { schema, groups }))
}

async fn set_group(Path(group): Path<String>, order: Order) -> Answer {
    let rights = order.rights();
    let may = move |service: &Service, group: &str, _: &GroupRequest| {
        may_write_all(&rights, &control::members(service, group)?)
    };
    let run = |service: Service, group: String, wanted| async move {
        control::set_group(&service, &group, wanted).await
    };
    order.carry_out_if(("group", group), may, run).await
}

async fn scenes(State(site): State<Site>) -> Answer {
    let scenes = control::scenes(&site.service);
    let schema = SCHEMA;
    answer::json(Ok(Scenes { schema, scenes }))
}

async fn play(Path(scene): Path<String>, order: Order) -> Answer {
    let rights = order.rights();
    let may = move |service: &Service, scene: &str, _: &SceneRequest| {
        may_write_all(&rights, &control::outputs_of_scene(service, scene)?)
    };
    let run = |service: Service, scene: String, wanted| async move {
        control::play(&service, &scene, wanted).await
    };
    order.carry_out_if(("scene", scene), may, run).await
}

async fn lease(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let run = |service: Service, path: String, wanted| async move {
        control::lease(&service, &path, wanted).await
    };
    order.on_point("lease", place, run).await
}

async fn end_lease(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let run = |service: Service, path: String, _: Value| async move {
        control::end_lease(&service, &path).await
    };
    order.on_point("end of lease", place, run).await
}
