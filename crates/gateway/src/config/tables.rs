//! Groups and scenes of the configuration, and the schema of it all.

use super::super::access::Need;
use super::super::answer;
use super::super::doc::Doc;
use super::super::order::Order;
use super::super::route::{Answer, Route};
use super::{edit, edits};
use axum::extract::Path;
use axum::http::StatusCode;
use axum::routing::{delete, get, put};
use railbus_api::problem::Problem;
use railbus_site::config::SCHEMA;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The routes of this file.
pub(crate) const ROUTES: &[Route] = &[
    Route::new("GET", "/config/schema", Need::VIEWER, || get(schema))
        .doc(Doc::new("The JSON Schema of the configuration").media(&["application/schema+json"])),
    Route::new("PUT", "/config/groups/{group}", Need::ENGINEER, || {
        put(put_group)
    })
    .doc(Doc::new("Say what a group is").takes::<GroupText>()),
    Route::new("DELETE", "/config/groups/{group}", Need::ENGINEER, || {
        delete(remove_group)
    })
    .doc(Doc::new("Take a group out")),
    Route::new("PUT", "/config/scenes/{scene}", Need::ENGINEER, || {
        put(put_scene)
    })
    .doc(Doc::new("Say what a scene is").takes::<SceneText>()),
    Route::new("DELETE", "/config/scenes/{scene}", Need::ENGINEER, || {
        delete(remove_scene)
    })
    .doc(Doc::new("Take a scene out")),
];

async fn schema() -> Answer {
    answer::with(StatusCode::OK, "application/schema+json", SCHEMA)
}

/// A display name.
#[derive(Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
enum Name {
    /// The same in all languages.
    One(String),
    /// In each language.
    Each(BTreeMap<String, String>),
}

/// A group as the configuration has it.
#[derive(Serialize, Deserialize, ToSchema)]
struct GroupText {
    name: Option<Name>,
    /// Paths of outputs.
    members: Vec<String>,
}

/// A scene as the configuration has it.
#[derive(Serialize, Deserialize, ToSchema)]
struct SceneText {
    name: Option<Name>,
    steps: Vec<StepText>,
}

/// An output and its new state, or a pause.
#[derive(Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct StepText {
    #[serde(rename(serialize = "set"))]
    path: Option<String>,
    #[serde(rename(serialize = "to"))]
    value: Option<bool>,
    wait_ms: Option<u64>,
}

async fn put_group(Path(group): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::put(text, "group", &group, &keys::<GroupText>(&order)?);
    edit(&order, change).await
}

async fn remove_group(Path(group): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::remove(text, "group", &group);
    edit(&order, change).await
}

async fn put_scene(Path(scene): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::put(text, "scene", &scene, &keys::<SceneText>(&order)?);
    edit(&order, change).await
}

async fn remove_scene(Path(scene): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::remove(text, "scene", &scene);
    edit(&order, change).await
}

/// A body as fields of the configuration.
pub(crate) fn keys<T: Serialize + DeserializeOwned>(order: &Order) -> Result<edits::Keys, Problem> {
    let said = serde_json::to_value(order.read::<T>()?);
    match said {
        Ok(Value::Object(keys)) => Ok(keys),
        // The bodies of this file are all objects.
        _ => Ok(edits::Keys::new()),
    }
}
