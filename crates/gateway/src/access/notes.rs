//! Events about logins, and about changes of permissions.

use super::{AccountsApi, Caller, Gate};
use railbus_api::problem::{Problem, codes};
use railbus_app::render::out;
use railbus_site::Service;
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity};
use std::time::Instant;

/// Reports a login attempt; nothing else does. An unknown name may be a password typed into the
/// wrong field, so it is not recorded.
pub(crate) fn note_login(
    (access, events): (&Gate, Option<&Service>),
    name: Option<&str>,
    via: &str,
    refused: Option<&Problem>,
) {
    if refused.is_some_and(|why| why.code == codes::TRIES.code) {
        return note_tries(access, events, via);
    }
    let known = |name: &&str| access.read(|accounts| accounts.user(name).is_some());
    let name = name.filter(|name| refused.is_none() || known(name));
    let name = name.unwrap_or("an unknown name");
    let end = refused.map_or("logged in", |problem| problem.title.as_str());
    out::note(&format!("login: {name} via {via}: {end}"));
    let origin = Origin {
        who: name.to_owned(),
        via: via.to_owned(),
    };
    let event = match refused {
        None => Event::new(EventKind::Login, Severity::Info, "logged_in"),
        Some(why) => {
            Event::new(EventKind::Login, Severity::Warning, "login_refused").text(&why.code)
        }
    };
    record(events, event.by(&origin));
}

/// Reports too many attempts at a limited rate, so that they cannot flood the history.
fn note_tries(access: &Gate, events: Option<&Service>, via: &str) {
    if !access.is_time_to_tell(Instant::now()) {
        return;
    }
    out::note(&format!("login: too many tries, the last via {via}"));
    let event = Event::new(EventKind::Login, Severity::Warning, "logins_many");
    let origin = Origin {
        who: "an unknown name".to_owned(),
        via: via.to_owned(),
    };
    record(events, event.by(&origin));
}

/// Records it, in a program that has events.
fn record(events: Option<&Service>, event: Event) {
    if let Some(service) = events {
        service.tell_event(event);
    }
}

/// Reports a change of permissions, and whom it concerns.
pub(super) fn note_change(
    api: &AccountsApi,
    who: &Caller,
    code: &str,
    of: &str,
    text: Option<&str>,
) {
    let origin = who.origin();
    let words = [code, of, text.unwrap_or_default()].join(" ");
    let (words, by) = (words.trim_end(), &origin.who);
    out::note(&format!("accounts: {words} by {by} via {}", origin.via));
    let event = Event::new(EventKind::Login, Severity::Info, code).by(&origin);
    let event = match of {
        "" => event,
        of => event.what(of),
    };
    let event = match text {
        Some(text) => event.text(text),
        None => event,
    };
    record(api.events.as_ref(), event);
}
