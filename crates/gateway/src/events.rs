//! Events and the audit log.

use super::access::{Caller, Need};
use super::doc::Doc;
use super::export::{self, File};
use super::history::kept;
use super::order::bad_request;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, body, language};
use axum::Extension;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::routing::{get, post};
use railbus_api::past::{AckRequest, AuditPage, EventInfo, EventPage, VerifiedInfo};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_app::api::past::{self, AUDIT_COLUMNS, audit_text, unread};
use railbus_site::paths::split;
use railbus_store::audit::{AuditLog, Filter};
use railbus_store::history::{Ack, EventKind, EventQuery, millis};
use std::time::SystemTime;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/events", Need::VIEWER, || get(events)).doc(
        Doc::new("What happened, the newest first")
            .query(&[KIND, MODULE, POINT, LIMIT, CURSOR])
            .answers::<EventPage>(),
    ),
    Route::new("POST", "/events/{id}/ack", Need::OPERATOR, || {
        post(acknowledge)
    })
    .reads()
    .doc(
        Doc::new("Say that an event was seen")
            .takes::<AckRequest>()
            .answers::<EventInfo>(),
    ),
    Route::new("GET", "/audit", Need::ENGINEER, || get(audit)).doc(
        Doc::new("What was done and by whom, the newest first")
            .query(&[MODULE, POINT, LIMIT, CURSOR])
            .answers::<AuditPage>(),
    ),
    Route::new("GET", "/audit/verify", Need::ADMIN, || get(verify))
        .doc(Doc::new("Whether the audit log is as it was written").answers::<VerifiedInfo>()),
    Route::new("GET", "/audit/export", Need::ADMIN, || get(save)).doc(
        Doc::new("Every record of the audit log, with its hash")
            .query(&[FORMAT, LANG])
            .media(&["text/csv", "application/x-ndjson"]),
    ),
];

const KIND: (&str, &str) = (
    "kind",
    "write, module, line, config, login, alarm, rule or system",
);
const MODULE: (&str, &str) = ("module", "those of this module");
const POINT: (&str, &str) = ("point", "those of this point, as pump.do0");
const LIMIT: (&str, &str) = ("limit", "how many, 1 to 500; 50 where it is not said");
const CURSOR: (&str, &str) = ("cursor", "what the page before says as its `next`");
pub(super) const FORMAT: (&str, &str) = ("format", "csv or ndjson");
pub(super) const LANG: (&str, &str) = ("lang", "zh: a CSV file begins with the mark of UTF-8");

/// The default and the largest number of items on a page.
const PAGE: usize = 50;
const PAGE_MAX: usize = 500;
/// The longest comment, in characters.
const COMMENT_MAX: usize = 500;

async fn events(State(site): State<Site>, asked: Asked) -> Answer {
    answer::json(page(&site, &asked).await)
}

async fn page(site: &Site, asked: &Asked) -> Result<EventPage, Problem> {
    let kind = match asked.get("kind") {
        None => None,
        Some(name) => Some(EventKind::from_name(name).ok_or_else(|| unreadable("kind"))?),
    };
    let filter = filter(asked)?;
    let wanted = EventQuery {
        before: asked.get("cursor").cloned(),
        limit: limit(asked)?,
        kind,
        module: filter.module,
        point: filter.label,
    };
    let found = kept(site)?.events(wanted).await;
    let found = found.map_err(|error| past::problem(&error))?;
    Ok(EventPage {
        schema: SCHEMA,
        items: found.events.into_iter().map(past::of_kept).collect(),
        next: found.next,
    })
}

fn limit(asked: &Asked) -> Result<usize, Problem> {
    match asked.get("limit").map(|limit| limit.parse()) {
        None => Ok(PAGE),
        Some(Ok(limit)) if (1..=PAGE_MAX).contains(&limit) => Ok(limit),
        Some(_) => Err(unreadable("limit")),
    }
}

/// The filter for `point` and `module`.
fn filter(asked: &Asked) -> Result<Filter, Problem> {
    let Some(path) = asked.get("point") else {
        return Ok(Filter {
            module: asked.get("module").cloned(),
            label: None,
        });
    };
    let (module, label) = split(path).ok_or_else(|| unreadable("point"))?;
    Ok(Filter {
        module: Some(module.to_owned()),
        label: Some(label.to_owned()),
    })
}

/// A parameter can't be read.
pub(super) fn unreadable(key: &str) -> Problem {
    let reason = format!("\"{key}\" can't be read");
    Problem::new(codes::BAD_REQUEST).with("reason", reason)
}

async fn acknowledge(
    State(site): State<Site>,
    Path(id): Path<String>,
    who: Extension<Caller>,
    body: Bytes,
) -> Answer {
    let text: &[u8] = if body.is_empty() { b"{}" } else { &body };
    let comment: AckRequest = match body::parse(text) {
        Ok(comment) => comment,
        Err(error) => return bad_request(&error.to_string()),
    };
    if comment.comment.chars().count() > COMMENT_MAX {
        return bad_request("a comment has at most 500 characters");
    }
    let ack = Ack {
        who: who.name.clone(),
        at_ms: millis(SystemTime::now()),
        comment: comment.comment,
    };
    answer::json(seen(&site, &id, ack).await)
}

async fn seen(site: &Site, id: &str, ack: Ack) -> Result<EventInfo, Problem> {
    let history = kept(site)?;
    let found = match history.acknowledge(id, ack).await {
        Ok(true) => history.kept_event(id).await,
        Ok(false) => Ok(None),
        Err(error) => Err(error),
    };
    let found = found.map_err(|error| past::problem(&error))?;
    let missing = || Problem::new(codes::NO_SUCH_EVENT).with("name", id);
    found.map(past::of_kept).ok_or_else(missing)
}

/// The log, or why there is none.
fn log(site: &Site) -> Result<&AuditLog, Problem> {
    let log = site.service.audit_log();
    log.ok_or_else(|| Problem::new(codes::NO_HISTORY))
}

async fn audit(State(site): State<Site>, asked: Asked) -> Answer {
    answer::json(entries(&site, &asked).await)
}

async fn entries(site: &Site, asked: &Asked) -> Result<AuditPage, Problem> {
    let before = match asked.get("cursor").map(|cursor| cursor.parse()) {
        None => None,
        Some(Ok(place)) => Some(place),
        Some(Err(_)) => return Err(unreadable("cursor")),
    };
    let found = log(site)?.page(before, limit(asked)?, filter(asked)?).await;
    let found = found.map_err(|error| unread(&error))?;
    Ok(AuditPage {
        schema: SCHEMA,
        items: found.entries.into_iter().map(past::of_logged).collect(),
        next: found.next.map(|place| place.to_string()),
    })
}

async fn verify(State(site): State<Site>) -> Answer {
    let log = match log(&site) {
        Ok(log) => log,
        Err(problem) => return answer::problem(&problem),
    };
    let found = log.verify().await.map_err(|error| unread(&error));
    answer::json(found.map(past::verified))
}

/// `GET /api/v1/audit/export`: every record of the log with its hash.
async fn save(
    State(site): State<Site>,
    who: Extension<Caller>,
    asked: Asked,
    headers: HeaderMap,
) -> Answer {
    let log = match log(&site) {
        Ok(log) => log.clone(),
        Err(problem) => return answer::problem(&problem),
    };
    let lang = language::of(&site, &asked, &headers);
    let Some(file) = File::asked(&asked, lang, "audit") else {
        return bad_request("\"format\" is csv or ndjson");
    };
    let (answer, mut sink) = export::stream(&site, &who, &file);
    tokio::spawn(async move {
        let mut from = None;
        let mut head = file.head(&AUDIT_COLUMNS);
        while let Ok(piece) = log.export(from).await {
            head += &audit_text(&piece.records, file.is_csv());
            let more = !piece.records.is_empty();
            from = Some(piece.next);
            if !sink.send(std::mem::take(&mut head)).await || !more {
                return;
            }
        }
    });
    answer
}
