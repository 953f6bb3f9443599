//! History: charts of points, their samples as a file, and how much is stored.

use super::access::{Caller, Need};
use super::doc::Doc;
use super::events::{FORMAT, LANG};
use super::export::{self, File};
use super::order::bad_request;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, language};
use axum::Extension;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::routing::get;
use jiff::Timestamp;
use railbus_api::past::{HistoryInfo, StorageInfo};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::{ask, past};
use railbus_app::render::csv::csv;
use railbus_site::PointStatus;
use railbus_store::history::{Chart, History, HistoryError, PIECE_MAX, Sample, millis};
use serde_json::json;
use std::str::FromStr;
use std::time::SystemTime;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/history", Need::VIEWER, || get(chart)).doc(
        Doc::new("The values that a point had")
            .query(&[POINT, FROM, TO, STRETCHES, STEP, LIMIT])
            .answers::<HistoryInfo>(),
    ),
    Route::new("GET", "/history/export", Need::VIEWER, || get(save)).doc(
        Doc::new("The samples of points, as a file")
            .query(&[
                ("point", "paths, divided by commas"),
                FROM,
                TO,
                FORMAT,
                LANG,
            ])
            .media(&["text/csv", "application/x-ndjson"]),
    ),
    Route::new("GET", "/storage", Need::VIEWER, || get(storage))
        .doc(Doc::new("How much is kept").answers::<StorageInfo>()),
];

const POINT: (&str, &str) = ("point", "its path, as pump.do0");
const FROM: (&str, &str) = (
    "from",
    "since when: RFC 3339, or milliseconds since 1970; an hour before `to` if not said",
);
const TO: (&str, &str) = ("to", "before when, in the same way; now if not said");
const STRETCHES: (&str, &str) = (
    "buckets",
    "into how many stretches of time many samples are made; 600 if not said",
);

const STEP: (&str, &str) = (
    "step",
    "stretches of so many milliseconds, however few the samples are; 4000 of them at most",
);
const LIMIT: (&str, &str) = (
    "limit",
    "only the last samples, at most so many, and no stretches",
);

/// The default number of intervals of a chart.
const BUCKETS: usize = 600;
/// The default period.
const HOUR_MS: i64 = 3_600_000;
/// The most points in one file.
const POINTS_MAX: usize = 64;

/// The history, or why there is none.
pub(super) fn kept(site: &Site) -> Result<&History, Problem> {
    let history = site.service.history();
    history.ok_or_else(|| Problem::new(codes::NO_HISTORY))
}

async fn chart(State(site): State<Site>, asked: Asked) -> Answer {
    answer::json(drawn(&site, &asked).await)
}

async fn drawn(site: &Site, asked: &Asked) -> Result<HistoryInfo, Problem> {
    let history = kept(site)?;
    let (from, to) = span(asked)?;
    let buckets = number(asked, "buckets")?.unwrap_or(BUCKETS);
    let (step, limit) = (number(asked, "step")?, number(asked, "limit")?);
    let path = asked.get("point").ok_or_else(|| unreadable("point"))?;
    let known = known(site, path);
    let chart = match (step, limit) {
        (Some(_), Some(_)) => return Err(unreadable("limit")),
        (Some(step), None) => history.steps(path, from, to, step).await,
        (None, Some(limit)) => {
            let last = history.last(path, from, to, limit).await;
            last.map(Chart::Samples)
        }
        (None, None) => history.chart(path, from, to, buckets).await,
    };
    let chart = match chart {
        // It exists, but has never been read.
        Err(HistoryError::NoSuchPoint) if known.is_ok() => Ok(Chart::Samples(Vec::new())),
        Err(HistoryError::NoSuchPoint) => return Err(known.err().unwrap_or_else(nothing)),
        chart => chart,
    };
    let chart = chart.map_err(|error| past::problem(&error))?;
    let unit = known.ok().and_then(|status| Some(status.range?.unit));
    Ok(past::chart(path, (from, to), unit, chart))
}

/// A number, if given.
fn number<T: FromStr>(asked: &Asked, key: &str) -> Result<Option<T>, Problem> {
    let number = asked.get(key).map(|text| text.parse());
    number.transpose().map_err(|_| unreadable(key))
}

fn nothing() -> Problem {
    Problem::new(codes::NO_SUCH_POINT)
}

/// A point of the site as it is now. One that was removed may still have a history.
fn known(site: &Site, path: &str) -> Result<PointStatus, Problem> {
    let (module, point) = ask::find(&site.service, path)?;
    site.service.point(&module, point).ok_or_else(nothing)
}

/// The period, in milliseconds since 1970.
fn span(asked: &Asked) -> Result<(i64, i64), Problem> {
    let now = millis(SystemTime::now());
    let to = time(asked, "to")?.unwrap_or(now + 1);
    let from = time(asked, "from")?.unwrap_or(to - HOUR_MS);
    if from >= to {
        let problem = Problem::new(codes::BAD_REQUEST);
        return Err(problem.with("reason", "\"from\" is not before \"to\""));
    }
    Ok((from, to))
}

/// A moment, as RFC 3339 or in milliseconds since 1970.
fn time(asked: &Asked, key: &str) -> Result<Option<i64>, Problem> {
    let Some(text) = asked.get(key) else {
        return Ok(None);
    };
    let millis = match text.parse::<i64>() {
        Ok(millis) => Some(millis),
        Err(_) => text.parse().ok().map(Timestamp::as_millisecond),
    };
    let in_reach = |millis: &i64| Timestamp::from_millisecond(*millis).is_ok();
    let millis = millis.filter(in_reach);
    millis.map(Some).ok_or_else(|| unreadable(key))
}

fn unreadable(key: &str) -> Problem {
    let reason = format!("\"{key}\" is missing, or can't be read");
    Problem::new(codes::BAD_REQUEST).with("reason", reason)
}

/// `GET /api/v1/history/export`: the samples of one point or several, one after the other.
async fn save(
    State(site): State<Site>,
    who: Extension<Caller>,
    asked: Asked,
    headers: HeaderMap,
) -> Answer {
    let (history, (from, to)) = match kept(&site).and_then(|kept| Ok((kept.clone(), span(&asked)?)))
    {
        Ok(wanted) => wanted,
        Err(problem) => return answer::problem(&problem),
    };
    let named = asked.get("point").map(String::as_str).unwrap_or_default();
    let points: Vec<String> = named
        .split(',')
        .filter(|path| !path.is_empty())
        .map(str::to_owned)
        .collect();
    if !(1..=POINTS_MAX).contains(&points.len()) {
        return bad_request("\"point\" names 1 to 64 points");
    }
    let lang = language::of(&site, &asked, &headers);
    let Some(file) = File::asked(&asked, lang, "history") else {
        return bad_request("\"format\" is csv or ndjson");
    };
    let (answer, mut sink) = export::stream(&site, &who, &file);
    tokio::spawn(async move {
        if !sink
            .send(file.head(&["time", "point", "value", "quality"]))
            .await
        {
            return;
        }
        for point in points {
            let mut from = from;
            loop {
                // A point without history has no rows.
                let samples = history.samples(&point, from, to).await.unwrap_or_default();
                let rows = samples.iter().map(|sample| row(&file, &point, sample));
                if !sink.send(rows.collect()).await {
                    return;
                }
                match samples.last() {
                    Some(last) if samples.len() >= PIECE_MAX => from = last.t + 1,
                    _ => break,
                }
            }
        }
    });
    answer
}

fn row(file: &File, point: &str, sample: &Sample) -> String {
    let time = past::moment(sample.t);
    let quality = sample.grade.name();
    if file.is_csv() {
        let value = sample.value.map(|value| value.to_string());
        let cells = [&time, point, &value.unwrap_or_default(), quality];
        return csv(&cells);
    }
    let told = json!({ "time": time, "point": point, "value": sample.value, "quality": quality });
    format!("{told}\n")
}

async fn storage(State(site): State<Site>) -> Answer {
    let history = match kept(&site) {
        Ok(history) => history,
        Err(problem) => return answer::problem(&problem),
    };
    let keep = site.service.config().past.history;
    let failing = site.service.audit_log().is_none_or(|log| log.is_failing());
    let storage = history.storage().await;
    let told = past::storage(storage, failing, (keep.age_ms, keep.bytes));
    answer::json(Ok(told))
}
