//! Webhooks over the API: what there is, how it does, and what comes back from a receiver.

use super::hook::Hook;
use super::request::Failed;
use crate::access::Need;
use crate::access::secret::{Secret, hex, random};
use crate::config::{edit, edits, keys};
use crate::doc::Doc;
use crate::order::Order;
use crate::route::{Answer, Route};
use crate::site::Site;
use crate::{answer, language, localize};
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::routing::{delete, get, post, put};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_api::webhooks::{WebhookInfo, WebhookList, WebhookTest, WebhookText};
use railbus_site::config::Webhook;
use railbus_store::history::{Event, EventKind, Severity};
use railbus_words::time::rfc3339;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;
use utoipa::ToSchema;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
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

/// The lengths that a secret may have, in bytes.
const SECRET_MIN: usize = 16;
const SECRET_MAX: usize = 256;

/// A secret for a webhook; null for none.
#[derive(Deserialize, ToSchema)]
#[schema(as = WebhookSecretRequest)]
#[serde(deny_unknown_fields)]
struct SecretRequest {
    #[schema(value_type = Option<String>)]
    secret: Option<Secret>,
}

/// Whether a webhook has a secret now. Which one, is not told.
#[derive(Serialize, ToSchema)]
#[schema(as = WebhookSecret)]
struct SecretTold {
    webhook: String,
    secret: bool,
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
    let at_work = site.hooks.find(name);
    let (figures, queue) = at_work
        .map(|hook: Arc<Hook>| hook.figures())
        .unwrap_or_default();
    let error = figures.error.map(|mut error| {
        error.problem = in_words(site, headers, error.problem);
        error
    });
    let state = match (wish.enabled, figures.in_a_row, figures.last) {
        (false, ..) => "off",
        (_, 1.., _) => "failing",
        (_, 0, Some(_)) => "ok",
        (_, 0, None) => "idle",
    };
    WebhookInfo {
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
        secret: site.hooks.secrets.of(name).is_some(),
        state: state.to_owned(),
        queue,
        delivered: figures.delivered,
        failed: figures.refused + figures.given_up,
        dropped: figures.dropped,
        last_delivery: figures.last.map(rfc3339),
        last_error: error,
    }
}

/// A problem within an answer, as it would be told alone.
fn in_words(site: &Site, headers: &HeaderMap, problem: Problem) -> Problem {
    localize::told(language::spoken(headers, site.lang), problem)
}

async fn change(Path(webhook): Path<String>, order: Order) -> Answer {
    let change = |text: &str| edits::put(text, "webhook", &webhook, &keys::<WebhookText>(&order)?);
    edit(&order, change).await
}

async fn remove(Path(webhook): Path<String>, order: Order) -> Answer {
    let answer = edit(&order, |text| edits::remove(text, "webhook", &webhook)).await;
    if answer.status().is_success() && order.site.hooks.secrets.of(&webhook).is_some() {
        // One that can't be forgotten is of no webhook any more.
        let _ = keep(&order.site, &webhook, None).await;
    }
    answer
}

/// The webhook of this name.
fn known(site: &Site, name: &str) -> Result<Webhook, Problem> {
    let found = site.service.config().webhooks.get(name).cloned();
    found.ok_or_else(|| Problem::new(codes::NO_SUCH_HOOK).with("name", name))
}

async fn set_secret(Path(webhook): Path<String>, order: Order) -> Answer {
    answer::json(
        secret_of(&order, &webhook)
            .await
            .map(|secret| SecretTold { webhook, secret }),
    )
}

async fn secret_of(order: &Order, webhook: &str) -> Result<bool, Problem> {
    known(&order.site, webhook)?;
    let SecretRequest { secret } = order.read_secret()?;
    let lengths = SECRET_MIN..=SECRET_MAX;
    if secret
        .as_ref()
        .is_some_and(|secret| !lengths.contains(&secret.expose().len()))
    {
        let words = format!("secret: {SECRET_MIN} to {SECRET_MAX} bytes, or null");
        return Err(Problem::new(codes::BAD_REQUEST).with("reason", words));
    }
    let is_set = secret.is_some();
    keep(&order.site, webhook, secret).await?;
    let event = Event::new(EventKind::Config, Severity::Info, "webhook_secret_changed");
    let event = event.by(&order.who.origin()).what(webhook);
    order.site.service.tell_event(event);
    Ok(is_set)
}

/// Keeps a secret. Disks may be slow, and the lines are not to wait for them.
async fn keep(site: &Site, webhook: &str, secret: Option<Secret>) -> Result<(), Problem> {
    let (hooks, config) = (Arc::clone(&site.hooks), site.service.config());
    let webhook = webhook.to_owned();
    let kept = tokio::task::spawn_blocking(move || {
        let is_one = |name: &str| config.webhooks.contains_key(name);
        hooks.secrets.set(&webhook, secret, is_one)
    });
    kept.await
        .map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?
}

async fn test(Path(webhook): Path<String>, order: Order) -> Answer {
    answer::json(tested(&order, webhook).await)
}

/// Sends an event past the queue, once.
async fn tested(order: &Order, webhook: String) -> Result<WebhookTest, Problem> {
    let url = known(&order.site, &webhook)?.url;
    let allowed = order.site.service.config().allowed.webhooks.clone();
    let internal = |reason: String| Problem::new(codes::INTERNAL).with("reason", reason);
    let number = random::<8>().map_err(|error| internal(error.to_string()))?;
    let event = Event {
        id: format!("test-{}", hex(&number)),
        ..Event::new(EventKind::System, Severity::Info, "webhook_test").by(&order.who.origin())
    };
    let (hooks, id) = (Arc::clone(&order.site.hooks), event.id.clone());
    let begun = Instant::now();
    let sent = hooks.thread.spawn({
        let hooks = Arc::clone(&hooks);
        async move { hooks.send((url, allowed), &webhook, &event).await }
    });
    let end = sent.await.map_err(|error| internal(error.to_string()))?;
    let failed = end.as_ref().err();
    let error = failed.map(|failed| in_words(&order.site, &order.headers, failed.problem()));
    Ok(WebhookTest {
        schema: SCHEMA,
        id,
        delivered: end.is_ok(),
        status: end
            .as_ref()
            .ok()
            .copied()
            .or(failed.and_then(Failed::status)),
        took_ms: u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX),
        error,
    })
}
