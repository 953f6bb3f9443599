//! The configuration over HTTP: the file as text, and changes of single lines, modules and points,
//! which keep its comments.

mod bring;
mod desk;
pub(super) mod edits;
mod part;
mod rules;
mod tables;

use super::access::{Caller, Need};
use super::doc::Doc;
use super::order::Order;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, language, northbound};
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::HeaderMap;
use axum::http::header::{ETAG, HeaderValue, IF_MATCH};
use axum::routing::{MethodRouter, delete, get, patch, post, put};
pub(super) use desk::{Asks, Changed, Desk};
use jiff::Timestamp;
#[cfg(feature = "fleet")]
pub(super) use part::NotApplied;
pub(super) use part::{RemoteConfig, RemoteConfigCalls, remote_config};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures::bad_config;
use railbus_app::config_check::warnings;
use railbus_site::Config;
use railbus_site::config::keeper::{Generation, TEXT_MAX, etag};
use railbus_words::Lang;
use railbus_words::time;
pub(super) use rules::ROUTES as RULES;
use serde::Deserialize;
use serde_json::{Value, json};
pub(super) use tables::{ROUTES as TABLES, keys};
use utoipa::ToSchema;

/// The largest body with a whole configuration: each of its bytes may be escaped.
const BODY_MAX: usize = 2 * TEXT_MAX;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/config", Need::ENGINEER, || get(show))
        .doc(Doc::new("The configuration as a text, with its ETag")),
    Route::new("PUT", "/config", Need::ENGINEER, || whole(put(replace)))
        .doc(Doc::new("Replace the configuration; If-Match is needed").takes::<Text>()),
    Route::new("POST", "/config/check", Need::ENGINEER, || {
        whole(post(check))
    })
    .reads()
    .doc(Doc::new("What would be wrong or unwise with a configuration").takes::<Text>()),
    Route::new("GET", "/config/generations", Need::ENGINEER, || {
        get(generations)
    })
    .doc(Doc::new("The texts that the configuration had before")),
    Route::new("GET", "/config/generations/{id}", Need::ENGINEER, || {
        get(generation)
    })
    .doc(Doc::new("One of them")),
    Route::new("POST", "/config/undo", Need::ENGINEER, || post(undo))
        .doc(Doc::new("Bring an earlier text back").takes::<Undo>()),
    Route::new("POST", "/config/lines", Need::ENGINEER, || post(add_line))
        .doc(Doc::new("Add a line").takes_object()),
    Route::new("GET", "/config/lines/{line}", Need::ENGINEER, || {
        get(show_line)
    })
    .doc(Doc::new("The keys of a line as they are written")),
    Route::new("PATCH", "/config/lines/{line}", Need::ENGINEER, || {
        patch(change_line)
    })
    .doc(Doc::new("Change keys of a line").takes_object()),
    Route::new("DELETE", "/config/lines/{line}", Need::ENGINEER, || {
        delete(remove_line)
    })
    .doc(Doc::new("Take a line out").query(&[("modules", "1: with the modules on it")])),
    Route::new("POST", "/config/modules", Need::ENGINEER, || {
        post(add_modules)
    })
    .doc(Doc::new("Add modules, such as a scan found").takes_object()),
    Route::new("GET", "/config/modules/{module}", Need::ENGINEER, || {
        get(show_module)
    })
    .doc(Doc::new("The keys of a module as they are written")),
    Route::new("PATCH", "/config/modules/{module}", Need::ENGINEER, || {
        patch(change_module)
    })
    .doc(Doc::new("Change keys of a module, or its name").takes_object()),
    Route::new("DELETE", "/config/modules/{module}", Need::ENGINEER, || {
        delete(remove_module)
    })
    .doc(Doc::new("Take a module out")),
    Route::new(
        "PATCH",
        "/config/points/{module}/{label}",
        Need::ENGINEER,
        || patch(change_point),
    )
    .within_points()
    .doc(Doc::new("Change keys of a point").takes_object()),
];

fn whole(handler: MethodRouter<Site>) -> MethodRouter<Site> {
    handler.layer(DefaultBodyLimit::max(BODY_MAX))
}

async fn show(State(site): State<Site>) -> Answer {
    let text = match site.desk.text().await {
        Ok(text) => text,
        Err(problem) => return answer::problem(&problem),
    };
    let tag = etag(&text);
    let in_force = Config::parse(&text).is_ok_and(|config| config == *site.service.config());
    let file = site.desk.file().display().to_string();
    let told = json!({
        "schema": 1, "file": file, "text": text, "etag": tag, "in_force": in_force,
    });
    tagged(answer::json(Ok(told)), &tag)
}

#[derive(Deserialize, ToSchema)]
#[schema(as = ConfigText)]
struct Text {
    text: String,
}

async fn replace(order: Order) -> Answer {
    if !order.headers.contains_key(IF_MATCH) {
        return answer::problem(&Problem::new(codes::NO_IF_MATCH));
    }
    let change = |before: &str| {
        let text = order.read::<Text>()?.text;
        bring::may_bring((&order.who, &order.site), before, &text)?;
        Ok(text)
    };
    edit(&order, change).await
}

async fn check(order: Order) -> Answer {
    let text = match order.read::<Text>() {
        Ok(body) => body.text,
        Err(problem) => return answer::problem(&problem),
    };
    let lang = language::spoken(&order.headers, order.site.lang);
    let file = order.site.desk.file().display().to_string();
    // Listing the adapters needs the disk.
    let told = tokio::task::spawn_blocking(move || checked(lang, &file, &text)).await;
    answer::json(told.map_err(broken))
}

fn wrong(problem: &Problem) -> Value {
    json!({ "schema": 1, "problems": problem.with["problems"], "warnings": [] })
}

fn checked(lang: Lang, file: &str, text: &str) -> Value {
    match Config::parse(text) {
        Ok(config) => {
            if let Err(problem) = northbound::check(lang, file, text, &config) {
                return wrong(&problem);
            }
            let warnings = warnings(lang, file, text, &config);
            let (lines, modules) = (config.lines.len(), config.modules.len());
            json!({
                "schema": 1, "problems": [], "warnings": warnings,
                "lines": lines, "modules": modules,
            })
        }
        Err(problems) => wrong(&bad_config(lang, file, &problems)),
    }
}

async fn generations(State(site): State<Site>) -> Answer {
    let kept = site.desk.generations().await;
    let rows = kept.map(|kept| kept.iter().rev().map(about).collect::<Vec<_>>());
    answer::json(rows.map(|rows| json!({ "schema": 1, "generations": rows })))
}

async fn generation(State(site): State<Site>, Path(id): Path<u64>) -> Answer {
    let found = site.desk.generation(Some(id)).await;
    answer::json(found.map(|found| {
        let mut told = about(&found);
        told["text"] = found.text.into();
        told
    }))
}

fn about(kept: &Generation) -> Value {
    let at = Timestamp::try_from(kept.at()).unwrap_or(Timestamp::UNIX_EPOCH);
    json!({
        "id": kept.id, "at": time::rfc3339(at), "who": kept.who, "bytes": kept.text.len(),
        "etag": etag(&kept.text),
    })
}

#[derive(Deserialize, ToSchema)]
#[schema(as = ConfigUndo)]
struct Undo {
    to: Option<u64>,
}

async fn undo(order: Order) -> Answer {
    let found = match order.read::<Undo>() {
        Ok(undo) => order.site.desk.generation(undo.to).await,
        Err(problem) => Err(problem),
    };
    match found {
        Ok(found) => {
            let change = |before: &str| {
                bring::may_bring((&order.who, &order.site), before, &found.text)?;
                Ok(found.text)
            };
            edit(&order, change).await
        }
        Err(problem) => answer::problem(&problem),
    }
}

async fn show_line(State(site): State<Site>, Path(line): Path<String>) -> Answer {
    keys_of(&site, "line", &line).await
}

async fn show_module(State(site): State<Site>, Path(module): Path<String>) -> Answer {
    keys_of(&site, "module", &module).await
}

async fn keys_of(site: &Site, kind: &'static str, name: &str) -> Answer {
    let read = async {
        let text = site.desk.text().await?;
        Ok((edits::read(&text, kind, name)?, etag(&text)))
    };
    match read.await {
        Ok((keys, tag)) => {
            let told = json!({ "schema": 1, kind: name, "keys": keys, "etag": tag });
            tagged(answer::json(Ok(told)), &tag)
        }
        Err(problem) => answer::problem(&problem),
    }
}

async fn add_line(order: Order) -> Answer {
    edit(&order, |text| edits::add_line(text, order.read()?)).await
}

async fn change_line(Path(line): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::change(text, "line", &line, order.read()?);
    edit(&order, change).await
}

async fn remove_line(Path(line): Path<String>, asked: Asked, order: Order) -> Answer {
    let with_modules = asked.get("modules").is_some_and(|value| value == "1");
    let change = |text: &str| edits::remove_line(text, &line, with_modules);
    edit(&order, change).await
}

#[derive(Deserialize)]
struct Modules {
    modules: Vec<edits::Keys>,
}

async fn add_modules(order: Order) -> Answer {
    let change = |text: &str| edits::add_modules(text, order.read::<Modules>()?.modules);
    edit(&order, change).await
}

async fn change_module(Path(module): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::change(text, "module", &module, order.read()?);
    edit(&order, change).await
}

async fn remove_module(Path(module): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::remove(text, "module", &module);
    edit(&order, change).await
}

async fn change_point(Path((module, label)): Path<(String, String)>, order: Order) -> Answer {
    let change = |text: &str| {
        let keys: edits::Keys = order.read()?;
        may_change_point(&order.who, &format!("{module}.{label}"), &keys)?;
        edits::change_point(text, &module, &label, &keys)
    };
    edit(&order, change).await
}

/// A caller limited to some points may name these; any other key may switch another.
fn may_change_point(who: &Caller, path: &str, keys: &edits::Keys) -> Result<(), Problem> {
    who.may_write(path)?;
    match who.is_limited() && keys.keys().any(|key| key != "name") {
        true => Err(who.limited()),
        false => Ok(()),
    }
}

/// Changes the file for a caller, and reports the result.
pub(super) async fn edit(
    order: &Order,
    change: impl FnOnce(&str) -> Result<String, Problem>,
) -> Answer {
    let Order {
        site, who, headers, ..
    } = order;
    let service = site.service.on_behalf_of(who.origin(), who.rights());
    let asks = Asks {
        service: &service,
        lang: language::spoken(headers, site.lang),
        who: &who.name,
        seen: seen(headers),
        is_fact: false,
    };
    let change = |before: &str| {
        let text = change(before)?;
        bring::may_lead((who, site), before, &text)?;
        Ok(text)
    };
    match site.desk.change(&asks, change).await {
        Ok(changed) => tagged(answer::json(Ok(told(&changed))), &changed.etag),
        Err(problem) => answer::problem(&problem),
    }
}

fn told(changed: &Changed) -> Value {
    let done = &changed.reloaded;
    json!({
        "schema": 1, "etag": changed.etag, "kept": done.kept, "opened": done.opened,
        "closed": done.closed, "modules_kept": done.modules_kept,
    })
}

/// The versions of the text that the caller accepts (`If-Match`); none if any is accepted.
pub(super) fn seen(headers: &HeaderMap) -> Option<Vec<String>> {
    let said = headers.get(IF_MATCH)?.to_str().unwrap_or_default();
    if said.trim() == "*" {
        return None;
    }
    let tags = said.split(',').map(|tag| tag.trim().trim_matches('"'));
    Some(tags.map(str::to_owned).collect())
}

pub(super) fn tagged(mut answer: Answer, etag: &str) -> Answer {
    if let Ok(tag) = HeaderValue::from_str(&format!("\"{etag}\"")) {
        answer.headers_mut().insert(ETAG, tag);
    }
    answer
}

fn broken(error: tokio::task::JoinError) -> Problem {
    Problem::new(codes::INTERNAL).with("reason", error.to_string())
}
