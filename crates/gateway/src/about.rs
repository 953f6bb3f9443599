//! The daemon about itself: what it is, how its lines are used, and what is wrong.

use super::access::Need;
use super::doc::Doc;
use super::northbound::routes::all as outlets;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, language};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::routing::get;
use jiff::{SignedDuration, Timestamp};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::{SCHEMA, SiteInfo};
use railbus_app::api::ask;
use railbus_app::api::failures::no_such_line;
use railbus_app::config_file;
use railbus_app::doctor;
use railbus_site::Service;
use railbus_site::config::load_percent;
use railbus_words::time::rfc3339;
use serde::Serialize;
use serde_json::json;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/system", Need::VIEWER, || get(system))
        .doc(Doc::new("The daemon itself").answers::<SystemInfo>()),
    Route::new("GET", "/site", Need::Owner, || get(site))
        .doc(Doc::new("Which site it serves, and where its files lie").answers::<SiteInfo>()),
    Route::new("GET", "/lines/{line}/load", Need::VIEWER, || get(load))
        .doc(Doc::new("How a line is used").answers::<LoadInfo>()),
    Route::new("GET", "/doctor", Need::ENGINEER, || get(examine))
        .doc(Doc::new("What is wrong, and how to mend it").query(&[("lang", "en or zh")])),
];

/// The daemon itself.
#[derive(Serialize, ToSchema)]
struct SystemInfo {
    schema: u8,
    version: String,
    /// How long it has been running.
    uptime_ms: u64,
    /// When it started.
    started: String,
    /// The memory that it uses.
    rss_bytes: Option<u64>,
    lines: usize,
    modules: usize,
    points: usize,
}

async fn system(State(site): State<Site>) -> Answer {
    let service = &site.service;
    let uptime_ms = service.age().0 / 1_000;
    let ago = SignedDuration::from_millis(i64::try_from(uptime_ms).unwrap_or_default());
    let started = Timestamp::now().checked_sub(ago).unwrap_or_default();
    answer::json(Ok(SystemInfo {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        uptime_ms,
        started: rfc3339(started),
        rss_bytes: resident(),
        lines: ask::lines(service).len(),
        modules: ask::modules(service).len(),
        points: ask::points(service, &[]).len(),
    }))
}

/// `GET /site`: commands compare it with the configuration that they find, so as not to switch
/// outputs of the wrong site.
async fn site(State(site): State<Site>) -> Answer {
    let text = |path: &std::path::Path| config_file::real(path).display().to_string();
    answer::json(Ok(SiteInfo {
        schema: SCHEMA,
        demo: site.demo,
        config: text(site.desk.file()),
        state: text(site.desk.state()),
    }))
}

/// The memory that the process uses, if the system reports it.
pub(super) fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mut lines = status.lines();
    let resident = lines.find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = resident.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes.saturating_mul(1_024))
}

/// How a line is used.
#[derive(Serialize, ToSchema)]
struct LoadInfo {
    schema: u8,
    line: String,
    /// The share of the last minute taken by exchanges that were answered.
    busy_percent: f64,
    /// The share that the polls of all modules take, as configured; more than 100 is too much.
    planned_percent: u32,
    polls: Vec<PollInfo>,
    /// Exchanges since the start.
    exchanges: u64,
    /// Failed exchanges, by the name of the failure.
    errors: BTreeMap<String, u64>,
    /// Late replies.
    late: u64,
}

/// The share of its line that the polls of a module take.
#[derive(Serialize, ToSchema)]
struct PollInfo {
    module: String,
    share_percent: u32,
    max_age_ms: u64,
}

async fn load(State(site): State<Site>, Path(line): Path<String>) -> Answer {
    answer::json(load_of(&site.service, line))
}

fn load_of(service: &Service, line: String) -> Result<LoadInfo, Problem> {
    let busy = service.busy(&line);
    let busy = busy.ok_or_else(|| no_such_line(service, &line))?;
    let config = service.config();
    let polls = config.modules_of(&line).map(|(name, module)| PollInfo {
        module: name.clone(),
        share_percent: load_percent(std::iter::once(module)),
        max_age_ms: module.plan.max_age.0 / 1_000,
    });
    let mut info = LoadInfo {
        schema: SCHEMA,
        busy_percent: (busy * 1_000.0).round() / 10.0,
        planned_percent: load_percent(config.modules_of(&line).map(|(_, module)| module)),
        polls: polls.collect(),
        exchanges: 0,
        errors: BTreeMap::new(),
        late: 0,
        line,
    };
    let counts = service.counts();
    for poll in &info.polls {
        let Some(counts) = counts.get(&poll.module) else {
            continue;
        };
        info.exchanges += counts.exchanges();
        info.late += counts.late;
        for (why, count) in &counts.failed {
            *info.errors.entry((*why).to_owned()).or_default() += count;
        }
    }
    Ok(info)
}

async fn examine(State(site): State<Site>, asked: Asked, headers: HeaderMap) -> Answer {
    let lang = language::of(&site, &asked, &headers);
    let (lines, modules) = (ask::lines(&site.service), ask::modules(&site.service));
    let points = ask::points(&site.service, &[]);
    let certificate = site.tls.as_ref().map(|tls| tls.expiry());
    let outlets = outlets(&site, &headers);
    let config = config_file::FoundConfig {
        config: (*site.service.config()).clone(),
        path: site.desk.file().to_owned(),
    };
    // It goes through all processes, and reads files.
    let found = tokio::task::spawn_blocking(move || {
        doctor::of_daemon(
            lang,
            lines,
            modules,
            &points,
            certificate,
            &outlets,
            &config,
        )
    });
    let found = found.await;
    let found =
        found.map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()));
    answer::json(found.map(|findings| json!({ "schema": SCHEMA, "findings": findings })))
}

/// `GET /readyz`: ready once every port was tried; whether it could be opened does not matter here.
pub(super) async fn ready(State(site): State<Site>) -> Answer {
    use railbus_api::types::PortState;
    let lines = ask::lines(&site.service);
    let opening = lines.iter().any(|line| line.state == PortState::Opening);
    let (status, text) = match opening {
        true => (StatusCode::SERVICE_UNAVAILABLE, "opening\n"),
        false => (StatusCode::OK, "ok\n"),
    };
    answer::with(status, "text/plain; charset=utf-8", text)
}
