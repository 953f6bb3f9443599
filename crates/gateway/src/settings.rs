//! `/api/v1/modules/{module}/settings`: the settings stored in a module. They are read between the
//! polls of its line; for a write the line is taken exclusively, and the procedure is that of
//! `railbus config set`.

mod apply;
mod calibrate;
mod drive;
mod look;
mod recover;
mod registers;
mod settings_request;

use super::access::Need;
use super::config::tagged;
use super::doc::Doc;
use super::order::Order;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, language};
use axum::extract::{Path, State};
use axum::http::header::IF_MATCH;
use axum::http::{HeaderMap, StatusCode};
use axum::routing::{get, patch, post};
use railbus_api::ops::OpBegun;
use railbus_api::problem::{Problem, codes};
use railbus_api::settings::{
    CalibrateRequest, Registers, Settings, SettingsLog, SettingsPlan, SettingsUndo,
};
use railbus_site::Service;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use settings_request::{SettingsRequest, Want};

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/modules/{module}/settings", Need::ENGINEER, || {
        get(show)
    })
    .doc(Doc::new("What a module keeps, read from it now, with an ETag").answers::<Settings>()),
    Route::new(
        "PATCH",
        "/modules/{module}/settings",
        Need::ENGINEER,
        || patch(change),
    )
    .doc(
        Doc::new("Change what a module keeps, and read it back; If-Match is needed")
            .query(&[DRY_RUN])
            .takes_object()
            .answers::<OpBegun>()
            .status("202")
            .plans::<SettingsPlan>(),
    ),
    Route::new("GET", "/modules/{module}/registers", Need::ENGINEER, || {
        get(registers)
    })
    .doc(Doc::new("What a module says of itself, byte for byte").answers::<Registers>()),
    Route::new(
        "GET",
        "/modules/{module}/settings/log",
        Need::ENGINEER,
        || get(log),
    )
    .doc(Doc::new("The journal of these changes").answers::<SettingsLog>()),
    Route::new(
        "POST",
        "/modules/{module}/settings/undo",
        Need::ENGINEER,
        || post(undo),
    )
    .doc(
        Doc::new("Take a change back")
            .query(&[DRY_RUN])
            .takes::<SettingsUndo>()
            .answers::<OpBegun>()
            .status("202")
            .plans::<SettingsPlan>(),
    ),
    Route::new(
        "POST",
        "/modules/{module}/settings/recover",
        Need::ENGINEER,
        || post(recovery),
    )
    .doc(
        Doc::new("Look for a module that is not where it should be, or whose change was cut short")
            .answers::<OpBegun>()
            .status("202"),
    ),
    Route::new(
        "POST",
        "/modules/{module}/settings/calibrate",
        Need::ENGINEER,
        || post(calibration),
    )
    .doc(
        Doc::new("Calibrate a module, which asks before each step")
            .takes::<CalibrateRequest>()
            .answers::<OpBegun>()
            .status("202"),
    ),
];

/// The default voltage at the inputs of a calibration.
const VOLTAGE: &str = "5.00V";

const DRY_RUN: (&str, &str) = ("dry_run", "1: say which frames it takes, and write nothing");

async fn show(
    State(site): State<Site>,
    Path(module): Path<String>,
    asked: Asked,
    headers: HeaderMap,
) -> Answer {
    let lang = language::of(&site, &asked, &headers);
    let wish = SettingsRequest::new(&site, &site.service, lang, module, None);
    match wish.settings().await {
        Ok(told) => {
            let etag = told.etag.clone();
            tagged(answer::json(Ok(told)), &etag)
        }
        Err(problem) => answer::problem(&problem),
    }
}

async fn registers(
    State(site): State<Site>,
    Path(module): Path<String>,
    asked: Asked,
    headers: HeaderMap,
) -> Answer {
    let lang = language::of(&site, &asked, &headers);
    let wish = SettingsRequest::new(&site, &site.service, lang, module, None);
    answer::json(wish.registers().await)
}

async fn log(State(site): State<Site>, Path(module): Path<String>) -> Answer {
    let wish = SettingsRequest::new(&site, &site.service, site.lang, module, None);
    answer::json(wish.log().await)
}

async fn change(Path(module): Path<String>, asked: Asked, order: Order) -> Answer {
    if !order.headers.contains_key(IF_MATCH) && !is_dry(&asked) {
        return answer::problem(&Problem::new(codes::NO_SETTINGS_MATCH));
    }
    carry_out(order, "settings", module, &asked, Want::Set).await
}

async fn undo(Path(module): Path<String>, asked: Asked, order: Order) -> Answer {
    let want = |wanted: SettingsUndo| Want::Undo(wanted.change);
    carry_out(order, "settings undo", module, &asked, want).await
}

async fn calibration(Path(module): Path<String>, order: Order) -> Answer {
    let lang = language::spoken(&order.headers, order.site.lang);
    let (site, who) = (order.site.clone(), order.who.name.clone());
    let run = move |service: Service, module: String, wanted: CalibrateRequest| async move {
        let wish = SettingsRequest::new(&site, &service, lang, module, None);
        let voltage = wanted.voltage.as_deref().unwrap_or(VOLTAGE);
        calibrate::begin(wish, who, voltage).await
    };
    accepted(order.carry_out(("calibrate", module), run).await)
}

async fn recovery(Path(module): Path<String>, order: Order) -> Answer {
    let lang = language::spoken(&order.headers, order.site.lang);
    let (site, who) = (order.site.clone(), order.who.name.clone());
    let run = move |service: Service, module: String, _: Map<String, Value>| async move {
        recover::begin(
            SettingsRequest::new(&site, &service, lang, module, None),
            who,
        )
        .await
    };
    accepted(order.carry_out(("recover", module), run).await)
}

/// A change that was started has no result yet.
fn accepted(mut answer: Answer) -> Answer {
    if answer.status() == StatusCode::OK {
        *answer.status_mut() = StatusCode::ACCEPTED;
    }
    answer
}

fn is_dry(asked: &Asked) -> bool {
    asked.get("dry_run").is_some_and(|value| value == "1")
}

/// Returns the plan, or starts the change.
async fn carry_out<T: DeserializeOwned + Send + 'static>(
    order: Order,
    what: &'static str,
    module: String,
    asked: &Asked,
    want: fn(T) -> Want,
) -> Answer {
    let lang = language::spoken(&order.headers, order.site.lang);
    let seen = super::config::seen(&order.headers);
    let site = order.site.clone();
    let who = order.who.name.clone();
    if is_dry(asked) {
        let wish = SettingsRequest::new(&site, &site.service, lang, module, seen);
        let told: Result<SettingsPlan, Problem> = match order.read().map(want) {
            Ok(want) => wish.plan(want).await.map(|plan| plan.told(lang)),
            Err(problem) => Err(problem),
        };
        return answer::json(told);
    }
    let run = move |service: Service, module: String, wanted: T| async move {
        let wish = SettingsRequest::new(&site, &service, lang, module, seen);
        let plan = wish.plan(want(wanted)).await?;
        apply::begin(wish, who, plan).await
    };
    accepted(order.carry_out((what, module), run).await)
}
