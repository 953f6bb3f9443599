//! Outlets over the API: which kinds there are, which outlets, how they do, and tests.

use super::kind::{ENABLED, Field, Invited, Joined, OutletKind, Pair, Shape, TABLE, Work};
use super::outlet::Outlet;
use super::supervisor::{OutletId, Supervised};
use super::{NORTHBOUND, missing, of_name};
use crate::access::Need;
use crate::access::secret::Secret;
use crate::config::{edit, edits, keys};
use crate::doc::Doc;
use crate::events::LANG;
use crate::order::Order;
use crate::order::bad_request;
use crate::route::{Answer, Asked, Route};
use crate::site::Site;
use crate::{answer, export, language, localize};
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::routing::{delete, get, post, put};
use jiff::Timestamp;
use railbus_api::outlets::{
    BothLanguages, OutletChoice, OutletField, OutletFieldType, OutletInfo, OutletJoined,
    OutletKindInfo, OutletKinds, OutletList, OutletMap, OutletTest,
};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_site::Config;
use railbus_site::config::change::Keys;
use railbus_site::config::{OUTLET_TYPE, is_slug};
use railbus_store::history::{Event, EventKind, Severity};
use railbus_words::Lang;
use railbus_words::time::rfc3339;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use utoipa::ToSchema;

/// The routes of kinds that are older than the routes of this file.
pub(crate) const OF_KINDS: &[Route] = super::webhook::routes::ROUTES;

/// The longest time of a test.
const TEST_MAX: Duration = Duration::from_secs(15);

const MAP_FORMAT: (&str, &str) = ("format", "json or csv");

/// The routes of this file.
pub(crate) const ROUTES: &[Route] = &[
    Route::new("GET", "/outlet-kinds", Need::VIEWER, || get(kinds)).doc(
        Doc::new("The kinds of integrations, and the settings of each").answers::<OutletKinds>(),
    ),
    Route::new("GET", "/outlets", Need::ENGINEER, || get(list))
        .doc(Doc::new("The integrations, and how they do").answers::<OutletList>()),
    Route::new("PUT", "/outlets/{kind}/{outlet}", Need::ADMIN, || {
        put(change)
    })
    .doc(Doc::new("Add an integration, or replace its settings").takes_object()),
    Route::new("DELETE", "/outlets/{kind}/{outlet}", Need::ADMIN, || {
        delete(remove)
    })
    .doc(Doc::new("Remove an integration and its secret")),
    Route::new(
        "PUT",
        "/outlets/{kind}/{outlet}/secret",
        Need::ADMIN,
        || put(set_secret),
    )
    .doc(
        Doc::new("Set the secret of an integration, or remove it")
            .takes::<SecretRequest>()
            .answers::<SecretState>(),
    ),
    Route::new("POST", "/outlets/{kind}/{outlet}/join", Need::ADMIN, || {
        post(join)
    })
    .doc(
        Doc::new("Accept an invitation of the other side; adds the integration if it is not there")
            .takes::<JoinRequest>()
            .answers::<OutletJoined>(),
    ),
    Route::new(
        "GET",
        "/outlets/{kind}/{outlet}/map",
        Need::ENGINEER,
        || get(map),
    )
    .doc(
        Doc::new("Where each point stands at the other side of an integration")
            .query(&[MAP_FORMAT, LANG])
            .answers::<OutletMap>(),
    ),
    Route::new(
        "POST",
        "/outlets/{kind}/{outlet}/test",
        Need::ENGINEER,
        || post(test),
    )
    .doc(Doc::new("Try an integration once, beside its work").answers::<OutletTest>()),
];

/// A secret; null for none.
#[derive(Deserialize, ToSchema)]
#[schema(as = OutletSecretRequest)]
#[serde(deny_unknown_fields)]
struct SecretRequest {
    #[schema(value_type = Option<String>)]
    secret: Option<Secret>,
}

/// An invitation, as it was handed over.
#[derive(Deserialize, ToSchema)]
#[schema(as = OutletJoinRequest)]
#[serde(deny_unknown_fields)]
struct JoinRequest {
    #[schema(value_type = String)]
    invitation: Secret,
    /// The other side may say the configuration of this site.
    #[serde(default)]
    managed: bool,
}

/// Whether there is a secret now. The secret itself is never shown.
#[derive(Serialize, ToSchema)]
#[schema(as = OutletSecret)]
struct SecretState {
    outlet: String,
    secret: bool,
}

async fn kinds() -> Answer {
    answer::json(Ok(OutletKinds {
        schema: SCHEMA,
        kinds: NORTHBOUND.iter().map(|kind| about_kind(kind)).collect(),
    }))
}

fn both([en, zh]: Pair) -> BothLanguages {
    BothLanguages {
        en: en.to_owned(),
        zh: zh.to_owned(),
    }
}

fn about_kind(kind: &OutletKind) -> OutletKindInfo {
    OutletKindInfo {
        kind: kind.name.to_owned(),
        title: both(kind.title),
        about: both(kind.about),
        has_map: kind.map.is_some(),
        notes: kind.notes.iter().copied().map(both).collect(),
        fields: kind.fields.iter().map(about_field).collect(),
    }
}

fn about_field(field: &Field) -> OutletField {
    let choices = |words: &[(&str, Pair)]| {
        let each = words.iter().map(|(value, title)| OutletChoice {
            value: (*value).to_owned(),
            title: both(*title),
        });
        each.collect()
    };
    let size = |size: usize| i64::try_from(size).ok();
    let mut told = OutletField {
        key: field.key.to_owned(),
        title: both(field.title),
        hint: (!field.hint[0].is_empty()).then(|| both(field.hint)),
        r#type: OutletFieldType::Text,
        required: field.is_required,
        min: None,
        max: None,
        default: None,
        choices: Vec::new(),
    };
    told.r#type = match field.shape {
        Shape::Text(most) => {
            told.max = size(most);
            OutletFieldType::Text
        }
        Shape::Url(most) => {
            told.max = size(most);
            OutletFieldType::Url
        }
        Shape::Flag => {
            told.default = Some(false.into());
            OutletFieldType::Flag
        }
        Shape::Number(low, high, usual) => {
            (told.min, told.max) = (Some(low), Some(high));
            told.default = Some(usual.into());
            OutletFieldType::Number
        }
        Shape::Choice(words) => {
            told.default = words.first().map(|(word, _)| (*word).into());
            told.choices = choices(words);
            OutletFieldType::Choice
        }
        Shape::Choices(words) => {
            told.choices = choices(words);
            OutletFieldType::Choices
        }
        Shape::Texts => OutletFieldType::Texts,
        Shape::Line => OutletFieldType::Line,
        Shape::Lines => OutletFieldType::Lines,
        Shape::Modules => OutletFieldType::Modules,
        Shape::Points => OutletFieldType::Points,
        Shape::Secret(least, most) => {
            (told.min, told.max) = (size(least), size(most));
            OutletFieldType::Secret
        }
    };
    told
}

async fn list(State(site): State<Site>, headers: HeaderMap) -> Answer {
    answer::json(Ok(OutletList {
        schema: SCHEMA,
        outlets: all(&site, &headers),
    }))
}

/// Every outlet, with its last error in the language of the request.
pub(crate) fn all(site: &Site, headers: &HeaderMap) -> Vec<OutletInfo> {
    let look = |id: &OutletId, outlet: &Supervised| about(site, headers, id, outlet);
    site.northbound.each(look)
}

fn about(site: &Site, headers: &HeaderMap, id: &OutletId, outlet: &Supervised) -> OutletInfo {
    let config = outlet.config();
    let counts = outlet.counts();
    let northbound = &site.northbound;
    let has_clients = of_name(id.kind).is_some_and(|kind| kind.has_clients);
    OutletInfo {
        kind: id.kind.to_owned(),
        outlet: id.name.clone(),
        enabled: config.is_some_and(|config| config.is_enabled),
        state: outlet.state(),
        since: rfc3339(outlet.since()),
        failures: outlet.failures(),
        retry_at: outlet.retry_at().map(|at| rfc3339(northbound.wall(at))),
        settings: config
            .map(|config| config.settings.clone())
            .unwrap_or_default(),
        secret: config.is_some_and(|config| northbound.has_secret(config.kind, &id.name)),
        sent: counts.sent.load(Relaxed),
        failed: counts.refused.load(Relaxed) + counts.given_up.load(Relaxed),
        dropped: counts.dropped.load(Relaxed),
        queue: counts.queue.load(Relaxed),
        clients: has_clients.then(|| counts.clients.load(Relaxed)),
        last_success: outlet.worked().map(rfc3339),
        last_error: outlet.error().cloned().map(|mut error| {
            error.problem = in_words(site, headers, error.problem);
            error
        }),
    }
}

/// A problem within an answer, worded as if it were the whole answer.
pub(super) fn in_words(site: &Site, headers: &HeaderMap, problem: Problem) -> Problem {
    localize::told(language::spoken(headers, site.lang), problem)
}

/// The kind of this name.
fn kind_of(name: &str) -> Result<&'static OutletKind, Problem> {
    of_name(name).ok_or_else(|| Problem::new(codes::NO_SUCH_OUTLET).with("name", name))
}

async fn change(Path((kind, outlet)): Path<(String, String)>, order: Order) -> Answer {
    let kind = match kind_of(&kind) {
        Ok(kind) => kind,
        Err(problem) => return answer::problem(&problem),
    };
    if let Err(problem) = not_of_another(&order.site.service.config(), kind, &outlet) {
        return answer::problem(&problem);
    }
    let change = |text: &str| {
        let mut settings = keys::<Keys>(&order)?;
        if kind.table == TABLE {
            settings.insert(OUTLET_TYPE.to_owned(), kind.name.into());
        }
        // It is on unless it says otherwise.
        if settings.get(ENABLED) == Some(&true.into()) {
            settings.remove(ENABLED);
        }
        edits::put(text, kind.table, &outlet, &settings)
    };
    edit(&order, change).await
}

/// Whether no outlet of another kind has this name.
fn not_of_another(config: &Config, kind: &OutletKind, outlet: &str) -> Result<(), Problem> {
    let other = config.outlets.get(outlet);
    if kind.table == TABLE && other.is_some_and(|other| other.kind != kind.name) {
        let taken = Problem::new(codes::ALREADY_THERE).with("kind", TABLE);
        return Err(taken.with("name", outlet));
    }
    Ok(())
}

async fn join(Path((kind, outlet)): Path<(String, String)>, order: Order) -> Answer {
    // One at a time: two could not both have the outlet.
    let joins = Arc::clone(&order.site.northbound.joins);
    let Ok(_turn) = joins.try_lock() else {
        let busy = "another invitation is being accepted";
        return answer::problem(&Problem::new(codes::NO_KEY).with("reason", busy));
    };
    let end = async {
        let kind = kind_of(&kind)?;
        Ok((kind, joined(&order, kind, &outlet).await?))
    };
    let (kind, joined) = match end.await {
        Ok(end) => end,
        Err(problem) => return answer::problem(&problem),
    };
    let edited = edit(&order, |text| {
        // As it is now: somebody may have changed it meanwhile.
        let config = Config::parse(text).unwrap_or_default();
        not_of_another(&config, kind, &outlet)?;
        let mut settings = settings_of(&config, kind, &outlet).unwrap_or_default();
        settings.extend(joined.settings.clone());
        settings.insert(OUTLET_TYPE.to_owned(), kind.name.into());
        settings.remove(ENABLED);
        edits::put(text, kind.table, &outlet, &settings)
    });
    let edited = edited.await;
    if !edited.status().is_success() {
        return edited;
    }
    let until = joined.until.and_then(|at| Timestamp::from_second(at).ok());
    answer::json(Ok(OutletJoined {
        schema: SCHEMA,
        outlet,
        called: joined.called,
        until: until.map(rfc3339),
    }))
}

/// Accepts the invitation in the body.
async fn joined(order: &Order, kind: &'static OutletKind, outlet: &str) -> Result<Joined, Problem> {
    let wrong = |reason: &str| Problem::new(codes::BAD_REQUEST).with("reason", reason);
    let join = kind
        .join
        .ok_or_else(|| wrong("there are no invitations for this kind"))?;
    // It is part of the names of files.
    if !is_slug(outlet) {
        return Err(wrong("a name has 1 to 32 of a-z, 0-9 and _"));
    }
    let config = order.site.service.config();
    not_of_another(&config, kind, outlet)?;
    let JoinRequest {
        invitation,
        managed,
    } = order.read_secret()?;
    let invited = Invited {
        name: outlet.to_owned(),
        invitation,
        managed,
        settings: settings_of(&config, kind, outlet),
        folder: order.site.northbound.folder(),
    };
    join(invited).await
}

/// The settings of an outlet; none if there is none of this kind and name.
fn settings_of(config: &Config, kind: &OutletKind, outlet: &str) -> Option<Keys> {
    let all = (kind.outlets)(kind, config).into_iter();
    let mut own = all.filter(|(name, _)| name == outlet);
    own.next().map(|(_, settings)| settings)
}

async fn remove(Path((kind, outlet)): Path<(String, String)>, order: Order) -> Answer {
    match kind_of(&kind) {
        Ok(kind) => removed(&order, kind, &outlet).await,
        Err(problem) => answer::problem(&problem),
    }
}

/// Takes an outlet out of the configuration, and forgets its secret.
pub(super) async fn removed(order: &Order, kind: &'static OutletKind, outlet: &str) -> Answer {
    if let Err(problem) = known(&order.site, kind, outlet) {
        return answer::problem(&problem);
    }
    let answer = edit(order, |text| edits::remove(text, kind.table, outlet)).await;
    let northbound = &order.site.northbound;
    if answer.status().is_success() && northbound.has_secret(kind, outlet) {
        // One that can't be forgotten is of no outlet any more.
        let _ = keep(&order.site, kind, outlet, None).await;
    }
    answer
}

/// Whether the configuration has this outlet.
pub(super) fn known(site: &Site, kind: &'static OutletKind, outlet: &str) -> Result<(), Problem> {
    let all = (kind.outlets)(kind, &site.service.config());
    match all.iter().any(|(name, _)| name == outlet) {
        true => Ok(()),
        false => Err(missing(&OutletId {
            kind: kind.name,
            name: outlet.to_owned(),
        })),
    }
}

async fn set_secret(Path((kind, outlet)): Path<(String, String)>, order: Order) -> Answer {
    let kind = match kind_of(&kind) {
        Ok(kind) => kind,
        Err(problem) => return answer::problem(&problem),
    };
    let end = secret_of(&order, kind, &outlet).await;
    answer::json(end.map(|secret| SecretState { outlet, secret }))
}

/// Sets the secret of the body, or removes it; whether there is one now.
pub(super) async fn secret_of(
    order: &Order,
    kind: &'static OutletKind,
    outlet: &str,
) -> Result<bool, Problem> {
    known(&order.site, kind, outlet)?;
    let wrong = |reason: String| Problem::new(codes::BAD_REQUEST).with("reason", reason);
    let (least, most) = kind
        .secret()
        .ok_or_else(|| wrong("secret: not for this kind".to_owned()))?;
    let SecretRequest { secret } = order.read_secret()?;
    let fits = |secret: &Secret| (least..=most).contains(&secret.expose().len());
    if !secret.as_ref().is_none_or(fits) {
        return Err(wrong(format!("secret: {least} to {most} bytes, or null")));
    }
    let is_set = secret.is_some();
    keep(&order.site, kind, outlet, secret).await?;
    let code = kind.event("secret_changed");
    let event = Event::new(EventKind::Config, Severity::Info, &code);
    let event = event.by(&order.who.origin()).what(outlet);
    order.site.service.tell_event(event);
    Ok(is_set)
}

/// Keeps a secret. Disks may be slow, and lines must not wait for them.
async fn keep(
    site: &Site,
    kind: &'static OutletKind,
    outlet: &str,
    secret: Option<Secret>,
) -> Result<(), Problem> {
    let (secrets, config) = (Arc::clone(&site.northbound.secrets), site.service.config());
    let outlet = outlet.to_owned();
    let kept = tokio::task::spawn_blocking(move || {
        let all = (kind.outlets)(kind, &config);
        let is_there = |name: &str| all.iter().any(|(known, _)| known == name);
        secrets.set(kind, &outlet, secret, is_there)
    });
    kept.await
        .map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?
}

async fn map(
    Path((kind, outlet)): Path<(String, String)>,
    asked: Asked,
    State(site): State<Site>,
    headers: HeaderMap,
) -> Answer {
    let lang = language::of(&site, &asked, &headers);
    match mapped(&site, &kind, outlet, lang) {
        Ok((map, name)) => match asked.get("format").map(String::as_str) {
            None | Some("json") => answer::json(Ok(map)),
            Some("csv") => export::whole_csv(&name, lang, &titles(&map, lang), &map.rows),
            Some(_) => bad_request("\"format\" is json or csv"),
        },
        Err(problem) => answer::problem(&problem),
    }
}

fn titles(map: &OutletMap, lang: Lang) -> Vec<String> {
    let title = |both: &BothLanguages| match lang {
        Lang::En => both.en.clone(),
        Lang::Zh => both.zh.clone(),
    };
    map.columns.iter().map(title).collect()
}

/// The addresses of an outlet, and its name.
fn mapped(
    site: &Site,
    kind: &str,
    outlet: String,
    lang: Lang,
) -> Result<(OutletMap, String), Problem> {
    let kind = kind_of(kind)?;
    let config = site.service.config();
    let all = (kind.outlets)(kind, &config);
    let found = all.into_iter().find(|(name, _)| *name == outlet);
    let (Some((_, settings)), Some(map)) = (found, kind.map) else {
        return Err(missing(&OutletId {
            kind: kind.name,
            name: outlet,
        }));
    };
    let rows = (map.rows)(&settings, &config, lang);
    let columns = map.columns.iter().copied().map(both).collect();
    let map = OutletMap {
        schema: SCHEMA,
        columns,
        rows,
    };
    Ok((map, outlet))
}

async fn test(Path((kind, outlet)): Path<(String, String)>, order: Order) -> Answer {
    answer::json(tested(&order, &kind, outlet).await)
}

async fn tested(order: &Order, kind: &str, outlet: String) -> Result<OutletTest, Problem> {
    let kind = kind_of(kind)?;
    known(&order.site, kind, &outlet)?;
    let begun = Instant::now();
    let id = OutletId {
        kind: kind.name,
        name: outlet,
    };
    let end = tried(order, &id, kind.test).await?;
    let (answer, error) = match end {
        Ok(answer) => (Some(answer), None),
        Err(problem) => (None, Some(in_words(&order.site, &order.headers, problem))),
    };
    Ok(OutletTest {
        schema: SCHEMA,
        ok: error.is_none(),
        answer,
        took_ms: u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX),
        error,
    })
}

/// Runs a test, for so long at the most.
async fn tried(
    order: &Order,
    id: &OutletId,
    test: fn(Outlet) -> Work<Result<String, Problem>>,
) -> Result<Result<String, Problem>, Problem> {
    let late = || Problem::new(codes::OUTLET_STUCK).with("name", id.name.as_str());
    let end = tokio::time::timeout(
        TEST_MAX,
        order.site.northbound.aside(id, order.who.origin(), test),
    )
    .await;
    end.unwrap_or_else(|_| Ok(Err(late())))
}
