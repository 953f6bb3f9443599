//! Webhooks: events sent over HTTP, in the order in which they happened.

mod hook;
mod request;
pub(super) mod routes;
mod schema;
mod target;

pub(super) use schema::KIND;

use super::kind::Work;
use super::outlet::Outlet;
use crate::access::secret::{hex, random};
use hook::{Hook, Tried};
use hyper::body::Bytes;
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_app::api::past;
use railbus_site::Events;
use railbus_store::history::{Event, EventKind, Severity};
use request::{Carrier, Failed, Parcel};
use serde_json::json;
use std::sync::Arc;
use std::time::Duration;

/// At the end, what waits has this time to be delivered.
const LINGER: Duration = Duration::from_millis(500);
/// How often it is looked whether anything waits then.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// The result of a test: the number of its event, and the status received.
type Tested = (String, Result<u16, Failed>);

/// Sends events until it is to stop; then what waits is delivered if that can be done at once.
fn work(outlet: Outlet, events: Events) -> Work<Result<(), Problem>> {
    Box::pin(async move {
        let report = &outlet.report;
        let carrier = Carrier::new(request::LIMIT);
        let hook = Hook::new(&url(&outlet), report.counts());
        let send = async |url: String, event: Arc<Event>| {
            carrier.carry(&parcel(&outlet, url, &event)).await
        };
        let tell = |tried| match tried {
            Tried::Delivered => report.worked(),
            Tried::Failed(problem, tries, wait) => report.failed(problem, tries, wait),
        };
        report.ready();
        let follow = async {
            follow(&outlet, events, &hook, &carrier).await;
            let _ = tokio::time::timeout(LINGER, emptied(&hook)).await;
        };
        tokio::select! {
            () = hook.work(send, tell) => {}
            () = follow => {}
        }
        Ok(())
    })
}

/// Where its events go; empty once it is not configured any more.
fn url(outlet: &Outlet) -> String {
    let hook = outlet.service.config().webhooks.get(&outlet.name).cloned();
    hook.map(|hook| hook.url).unwrap_or_default()
}

/// Gives it every event that is for it, until it is to stop.
async fn follow(outlet: &Outlet, mut events: Events, hook: &Hook<'_>, carrier: &Carrier) {
    let mut settings = outlet.settings.clone();
    loop {
        tokio::select! {
            biased;
            // Fails if the supervisor is gone.
            Ok(()) = settings.changed() => {
                carrier.trust_anew();
                hook.set(&url(outlet));
            }
            event = events.next() => match event {
                Some(Ok(event)) => take(outlet, hook, event),
                Some(Err(count)) => hook.missed(count),
                None => return,
            },
            () = outlet.stopped() => return,
        }
    }
}

fn take(outlet: &Outlet, hook: &Hook<'_>, event: Event) {
    let config = outlet.service.config();
    let wish = config.webhooks.get(&outlet.name);
    if !hook::is_own(&event) && wish.is_some_and(|wish| config.tells(wish, &event)) {
        hook.push(Arc::new(event));
    }
}

/// Waits until everything is delivered that does not fail.
async fn emptied(hook: &Hook<'_>) {
    while hook.delivers() {
        tokio::time::sleep(LOOK_EVERY).await;
    }
}

/// An event on its way to this address, and beyond it only where the owner allows.
fn parcel(outlet: &Outlet, url: String, event: &Event) -> Parcel {
    let told = past::of_event(event.clone());
    let body = json!({ "schema": SCHEMA, "site": *outlet.site, "event": told });
    Parcel {
        url,
        allowed: outlet.service.config().allowed.webhooks.clone(),
        id: event.id.clone(),
        body: Bytes::from(body.to_string()),
        secret: outlet.secret(),
    }
}

/// Sends an event past the queue, once. It is in the name of who asks for it.
async fn tried(outlet: &Outlet) -> Result<Tested, Problem> {
    let internal = |reason: String| Problem::new(codes::INTERNAL).with("reason", reason);
    let number = random::<8>().map_err(|error| internal(error.to_string()))?;
    let event = Event {
        id: format!("test-{}", hex(&number)),
        ..Event::new(EventKind::System, Severity::Info, "webhook_test").by(outlet.service.origin())
    };
    let carrier = Carrier::new(request::LIMIT);
    let end = carrier.carry(&parcel(outlet, url(outlet), &event)).await;
    Ok((event.id, end))
}

fn test(outlet: Outlet) -> Work<Result<String, Problem>> {
    Box::pin(async move {
        let (_, end) = tried(&outlet).await?;
        let status = end.map_err(|failed| failed.problem())?;
        Ok(format!("HTTP {status}"))
    })
}
