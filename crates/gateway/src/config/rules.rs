//! Rules: their state, their text in the configuration, and test runs on the history.

use super::super::access::Need;
use super::super::answer;
use super::super::doc::Doc;
use super::super::history::kept;
use super::super::language;
use super::super::order::Order;
use super::super::route::{Answer, Route};
use super::super::site::Site;
use super::{edit, edits};
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::routing::{delete, get, post, put};
use jiff::tz::TimeZone;
use railbus_api::problem::{Problem, codes};
use railbus_api::rules::{RuleInfo, RuleText, Rules, TriedInfo, TryRequest};
use railbus_api::types::SCHEMA;
use railbus_app::api::failures::{bad_config, of_rights};
use railbus_app::api::{past, rules as told};
use railbus_site::config::Rule;
use railbus_site::{Config, Service};
use railbus_store::history::millis;
use serde_json::Value;
use std::time::SystemTime;

/// The routes of this file.
pub(crate) const ROUTES: &[Route] = &[
    Route::new("GET", "/rules", Need::VIEWER, || get(all))
        .doc(Doc::new("All rules, and how each is").answers::<Rules>()),
    Route::new("POST", "/rules/try-text", Need::ENGINEER, || post(try_text))
        .reads()
        .doc(
            Doc::new("When a rule would have acted that is not in the configuration yet")
                .takes::<TryRequest>()
                .answers::<TriedInfo>(),
        ),
    Route::new("GET", "/rules/{id}", Need::VIEWER, || get(one))
        .doc(Doc::new("One of them").answers::<RuleInfo>()),
    Route::new("PUT", "/rules/{id}", Need::ENGINEER, || put(write))
        .doc(Doc::new("Say what a rule is; one that changes is disarmed").takes::<RuleText>()),
    Route::new("DELETE", "/rules/{id}", Need::ENGINEER, || delete(remove))
        .doc(Doc::new("Take a rule out")),
    Route::new("POST", "/rules/{id}/try", Need::ENGINEER, || {
        post(try_known)
    })
    .reads()
    .doc(
        Doc::new("When a rule would have acted")
            .takes::<TryRequest>()
            .answers::<TriedInfo>(),
    ),
    Route::new("POST", "/rules/{id}/arm", Need::ENGINEER, || post(arm))
        .doc(Doc::new("Let a rule act that was tried as it is now")),
    Route::new("POST", "/rules/{id}/disarm", Need::ENGINEER, || {
        post(disarm)
    })
    .doc(Doc::new("Let a rule act no more")),
];

const HOUR_MS: i64 = 3_600_000;
/// The default and the longest period of a test run, in hours.
const HOURS: u64 = 24;
const HOURS_MAX: u64 = 168;
/// The name of a rule that is tested before it has one.
const NAMELESS: &str = "new_rule";

async fn all(State(site): State<Site>) -> Answer {
    let config = site.service.config();
    let rules = site.service.rules().into_iter();
    let zone = TimeZone::system();
    answer::json(Ok(Rules {
        schema: SCHEMA,
        time_zone: zone.iana_name().unwrap_or("UTC").to_owned(),
        rules: rules.map(|status| told::rule(&config, status)).collect(),
    }))
}

async fn one(State(site): State<Site>, Path(id): Path<String>) -> Answer {
    let config = site.service.config();
    let found = site.service.rules().into_iter().find(|rule| rule.id == id);
    let found = found.ok_or_else(|| no_such_rule(&id));
    answer::json(found.map(|status| told::rule(&config, status)))
}

fn no_such_rule(id: &str) -> Problem {
    Problem::new(codes::NO_SUCH_RULE).with("name", id)
}

fn known(service: &Service, id: &str) -> Result<Rule, Problem> {
    let found = service.config().rules.get(id).cloned();
    found.ok_or_else(|| no_such_rule(id))
}

/// A rule that acts differently from the previous one has not been tested, and is not armed.
async fn write(Path(id): Path<String>, order: Order) -> Answer {
    let change = |text: &str| {
        let wanted: RuleText = order.read()?;
        let disarmed = with_rule(text, &id, &wanted, false)?;
        let rule_of = |text: &str| Config::parse(text).ok()?.rules.remove(&id);
        match (rule_of(text), rule_of(&disarmed)) {
            (Some(old), Some(new)) if old.armed && old.acts_as(&new) => {
                with_rule(text, &id, &wanted, true)
            }
            _ => Ok(disarmed),
        }
    };
    edit(&order, change).await
}

async fn remove(Path(id): Path<String>, order: Order) -> Answer {
    edit(&order, |text| edits::remove(text, "rule", &id)).await
}

/// The text of the configuration with a rule added.
fn with_rule(text: &str, id: &str, rule: &RuleText, armed: bool) -> Result<String, Problem> {
    let mut keys = match serde_json::to_value(rule) {
        Ok(Value::Object(keys)) => keys,
        // A rule is always an object.
        _ => edits::Keys::new(),
    };
    if armed {
        keys.insert("armed".to_owned(), true.into());
    }
    edits::put(text, "rule", id, &keys)
}

async fn try_known(Path(id): Path<String>, order: Order) -> Answer {
    let tried = async {
        let rule = known(&order.site.service, &id)?;
        tried(&order.site, &rule, &order.read()?).await
    };
    answer::json(tried.await)
}

/// The rule is read as if it were in the file, so that errors are reported in the usual form.
async fn try_text(order: Order) -> Answer {
    let tried = async {
        let wanted: TryRequest = order.read()?;
        let id = wanted.id.as_deref().unwrap_or(NAMELESS);
        let missing = || Problem::new(codes::BAD_REQUEST).with("reason", "\"rule\" is missing");
        let rule = wanted.rule.as_ref().ok_or_else(missing)?;
        let text = order.site.desk.text().await?;
        let text = with_rule(&text, id, rule, false)?;
        let lang = language::spoken(&order.headers, order.site.lang);
        let config = Config::parse(&text).map_err(|problems| {
            let file = order.site.desk.file().display().to_string();
            bad_config(lang, &file, &problems)
        })?;
        let rule = config.rules.get(id).ok_or_else(|| no_such_rule(id))?;
        tried(&order.site, rule, &wanted).await
    };
    answer::json(tried.await)
}

async fn tried(site: &Site, rule: &Rule, wanted: &TryRequest) -> Result<TriedInfo, Problem> {
    kept(site)?;
    let span = span(wanted)?;
    let tried = site.service.try_rule(rule, span).await;
    tried
        .map(told::tried)
        .map_err(|error| past::problem(&error))
}

/// The period, in milliseconds since 1970. It can't be in the future.
fn span(wanted: &TryRequest) -> Result<(i64, i64), Problem> {
    let wrong = |reason: &str| Problem::new(codes::BAD_REQUEST).with("reason", reason);
    let now = millis(SystemTime::now());
    let until = wanted.until.map_or(now, |until| until.as_millisecond());
    let until = until.min(now);
    let hours = wanted.hours.unwrap_or(HOURS);
    if !(1..=HOURS_MAX).contains(&hours) {
        return Err(wrong("\"hours\" is 1 to 168"));
    }
    let ago = |hours: u64| until - i64::try_from(hours).unwrap_or_default() * HOUR_MS;
    let since = wanted
        .since
        .map_or_else(|| ago(hours), |since| since.as_millisecond());
    match (ago(HOURS_MAX)..until).contains(&since) && since > 0 {
        true => Ok((since, until)),
        false => Err(wrong("\"since\" is at most 168 hours before \"until\"")),
    }
}

async fn arm(Path(id): Path<String>, order: Order) -> Answer {
    let (who, site) = (&order.who, &order.site);
    let service = &site.service.on_behalf_of(who.origin(), who.rights());
    let rule = match known(service, &id) {
        Ok(rule) => rule,
        Err(problem) => return answer::problem(&problem),
    };
    let untried = || not_tried(&id, &format!("/rules/{id}/try"));
    if !service.is_tried(&rule) {
        return answer::problem(&untried());
    }
    let change = |text: &str| {
        // The file may differ from what was tested.
        let now = Config::parse(text).ok();
        let now = now.and_then(|mut config| config.rules.remove(&id));
        match now.is_some_and(|now| now.acts_as(&rule)) {
            true => set_armed(text, &id, true),
            false => Err(untried()),
        }
    };
    let answer = edit(&order, change).await;
    if answer.status() != StatusCode::OK {
        return answer;
    }
    match service.begin_rule_anew(&id) {
        Ok(()) => answer,
        Err(refused) => answer::problem(&of_rights(&refused)),
    }
}

/// A rule that is newly armed must have been tested exactly as it is.
pub(super) fn are_tried(service: &Service, old: &Config, new: &Config) -> Result<(), Problem> {
    let armed = new.rules.iter().filter(|(_, rule)| rule.armed);
    let acts_already = |id: &str, rule: &Rule| {
        let known = old.rules.get(id);
        known.is_some_and(|known| known.armed && known.acts_as(rule))
    };
    let mut acting = armed.filter(|(id, rule)| !acts_already(id, rule));
    acting.try_for_each(|(id, rule)| match service.is_tried(rule) {
        true => Ok(()),
        // The text is not part of the site yet, and neither is its rule.
        false => Err(not_tried(id, "/rules/try-text")),
    })
}

fn not_tried(id: &str, address: &str) -> Problem {
    let problem = Problem::new(codes::RULE_NOT_TRIED).with("name", id);
    problem.with_hint(format!("POST /api/v1{address}"))
}

async fn disarm(Path(id): Path<String>, order: Order) -> Answer {
    edit(&order, |text| set_armed(text, &id, false)).await
}

fn set_armed(text: &str, id: &str, armed: bool) -> Result<String, Problem> {
    let keys = edits::Keys::from_iter([("armed".to_owned(), armed.into())]);
    edits::change(text, "rule", id, keys)
}
