//! Webhooks over the API as they were before there were other outlets: what there is, how it does,
//! and what comes back from a receiver.

use super::{KIND, Tested, tried};
use crate::access::Need;
use crate::answer;
use crate::config::{edit, edits, keys};
use crate::doc::Doc;
use crate::northbound::kind::Work;
use crate::northbound::outlet::Outlet;
use crate::northbound::routes::{in_words, removed, secret_of};
use crate::northbound::supervisor::{OutletId, Supervised};
use crate::order::Order;
use crate::route::{Answer, Route};
use crate::site::Site;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::routing::{delete, get, post, put};
use railbus_api::problem::Problem;
use railbus_api::types::SCHEMA;
use railbus_api::webhooks::{WebhookError, WebhookInfo, WebhookList, WebhookTest, WebhookText};
use railbus_site::config::Webhook;
use railbus_words::time::rfc3339;
use serde::{Deserialize, Serialize};
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;
use utoipa::ToSchema;

/// The routes of this file.
pub(in crate::northbound) const ROUTES: &[Route] = &[
    Route::new("GET", "/webhooks", Need::ENGINEER, || get(list)).doc(
        Doc::new("Who is told of events over HTTP, and how that goes").answers::<WebhookList>(),
    ),
    Route::new("PUT", "/webhooks/{webhook}", Need::ADMIN, || put(change))
        .doc(Doc::new("Say who is told of which events").takes::<WebhookText>()),
    Route::new("DELETE", "/webhooks/{webhook}", Need::ADMIN, || {
        delete(remove)
    })
    .doc(Doc::new("Tell a receiver of events no more")),
    Route::new("PUT", "/webhooks/{webhook}/secret", Need::ADMIN, || {
        put(set_secret)
    })
    .doc(
        Doc::new("Set the secret by which what is sent is signed, or take it away")
            .takes::<SecretRequest>()
            .answers::<SecretTold>(),
    ),
    Route::new("POST", "/webhooks/{webhook}/test", Need::ENGINEER, || {
        post(test)
    })
    .doc(Doc::new("Send an event for a test, and say what came back").answers::<WebhookTest>()),
];

/// A secret for a webhook; null for none. It is read as that of any outlet.
#[derive(Deserialize, ToSchema)]
#[schema(as = WebhookSecretRequest)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "it describes the body in the document of the API")]
struct SecretRequest {
    secret: Option<String>,
}

/// Whether a webhook has a secret now, but not the secret itself.
#[derive(Serialize, ToSchema)]
#[schema(as = WebhookSecret)]
struct SecretTold {
    webhook: String,
    secret: bool,
}

fn id(name: &str) -> OutletId {
    OutletId {
        kind: KIND.name,
        name: name.to_owned(),
    }
}

async fn list(State(site): State<Site>, headers: HeaderMap) -> Answer {
    let config = site.service.config();
    let each = config.webhooks.iter();
    let webhooks = each.map(|(name, wish)| about(&site, &headers, name, wish));
    answer::json(Ok(WebhookList {
        schema: SCHEMA,
        webhooks: webhooks.collect(),
    }))
}

fn about(site: &Site, headers: &HeaderMap, name: &str, wish: &Webhook) -> WebhookInfo {
    let mut about = WebhookInfo {
        webhook: name.to_owned(),
        url: wish.url.clone(),
        events: wish
            .events
            .iter()
            .map(|kind| kind.name().to_owned())
            .collect(),
        severity: wish.severity.name().to_owned(),
        lines: wish.lines.iter().cloned().collect(),
        modules: wish.modules.iter().cloned().collect(),
        enabled: wish.enabled,
        secret: site.northbound.has_secret(&KIND, name),
        state: if wish.enabled { "idle" } else { "off" }.to_owned(),
        queue: 0,
        delivered: 0,
        failed: 0,
        dropped: 0,
        last_delivery: None,
        last_error: None,
    };
    let tell = |outlet: &Supervised| tell(&mut about, outlet);
    site.northbound.look(&id(name), tell);
    if let Some(error) = &mut about.last_error {
        error.problem = in_words(site, headers, error.problem.clone());
    }
    about
}

/// How a webhook does, in the words of this list.
fn tell(about: &mut WebhookInfo, outlet: &Supervised) {
    let counts = outlet.counts();
    about.queue = counts.queue.load(Relaxed);
    about.delivered = counts.sent.load(Relaxed);
    about.failed = counts.refused.load(Relaxed) + counts.given_up.load(Relaxed);
    about.dropped = counts.dropped.load(Relaxed);
    about.last_delivery = outlet.worked().map(rfc3339);
    about.last_error = outlet.error().map(|error| WebhookError {
        at: error.at.clone(),
        tries: error.tries,
        problem: error.problem.clone(),
    });
    let state = match (about.enabled, outlet.failures(), outlet.worked()) {
        (false, ..) => "off",
        (_, 1.., _) => "failing",
        (_, 0, Some(_)) => "ok",
        (_, 0, None) => "idle",
    };
    state.clone_into(&mut about.state);
}

async fn change(Path(webhook): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::put(text, KIND.table, &webhook, &keys::<WebhookText>(&order)?);
    edit(&order, change).await
}

async fn remove(Path(webhook): Path<String>, order: Order) -> Answer {
    removed(&order, &KIND, &webhook).await
}

async fn set_secret(Path(webhook): Path<String>, order: Order) -> Answer {
    let end = secret_of(&order, &KIND, &webhook).await;
    answer::json(end.map(|secret| SecretTold { webhook, secret }))
}

async fn test(Path(webhook): Path<String>, order: Order) -> Answer {
    answer::json(tested(&order, &webhook).await)
}

/// What a test does on its own thread.
fn once(outlet: Outlet) -> Work<Result<Tested, Problem>> {
    Box::pin(async move { tried(&outlet).await })
}

async fn tested(order: &Order, webhook: &str) -> Result<WebhookTest, Problem> {
    let begun = Instant::now();
    let origin = order.who.origin();
    let (event, end) = order
        .site
        .northbound
        .aside(&id(webhook), origin, once)
        .await??;
    let failed = end.as_ref().err();
    let error = failed.map(|failed| in_words(&order.site, &order.headers, failed.problem()));
    Ok(WebhookTest {
        schema: SCHEMA,
        id: event,
        delivered: end.is_ok(),
        status: end
            .as_ref()
            .ok()
            .copied()
            .or(failed.and_then(super::Failed::status)),
        took_ms: u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX),
        error,
    })
}
