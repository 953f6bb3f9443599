//! Events about logins, and about changes of permissions.

use super::{AccountsApi, Caller, Gate};
use railbus_api::problem::{Problem, codes};
use railbus_app::render::out;
use railbus_site::Service;
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity};
use std::time::Instant;

/// What is printed by whoever reports it.
#[cfg(feature = "fleet")]
const PRINTED: [&str; 3] = ["logged_in", "login_refused", "logins_many"];

/// Where logins and changes of permissions are recorded.
#[derive(Clone, Debug)]
pub(crate) enum AccountsLog {
    /// The events of a site.
    History(Service),
    /// Standard error, of a program without events.
    #[cfg(feature = "fleet")]
    Printed,
}

impl AccountsLog {
    fn record(&self, event: Event) {
        match self {
            AccountsLog::History(service) => service.tell_event(event),
            // Logins are printed by whoever reports them.
            #[cfg(feature = "fleet")]
            AccountsLog::Printed
                if PRINTED.contains(&event.code.as_deref().unwrap_or_default()) => {}
            #[cfg(feature = "fleet")]
            AccountsLog::Printed => {
                let words = [&event.code, &event.what, &event.text];
                let words: Vec<&str> = words.into_iter().flatten().map(String::as_str).collect();
                let [who, via] =
                    [&event.who, &event.via].map(|text| text.as_deref().unwrap_or("–"));
                out::note(&format!("accounts: {} by {who} via {via}", words.join(" ")));
            }
        }
    }
}

/// Reports a login attempt; nothing else does. An unknown name may be a password typed into the
/// wrong field, so it is not recorded.
pub(crate) fn note_login(
    (access, log): (&Gate, &AccountsLog),
    name: Option<&str>,
    via: &str,
    refused: Option<&Problem>,
) {
    if refused.is_some_and(|why| why.code == codes::TRIES.code) {
        return note_tries(access, log, via);
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
    log.record(event.by(&origin));
}

/// Reports too many attempts at a limited rate, so that they cannot flood the history.
fn note_tries(access: &Gate, log: &AccountsLog, via: &str) {
    if !access.is_time_to_tell(Instant::now()) {
        return;
    }
    out::note(&format!("login: too many tries, the last via {via}"));
    let event = Event::new(EventKind::Login, Severity::Warning, "logins_many");
    log.record(event.by(&Origin {
        who: "an unknown name".to_owned(),
        via: via.to_owned(),
    }));
}

/// Reports a change of permissions, and whom it concerns.
pub(super) fn note_change(
    api: &AccountsApi,
    who: &Caller,
    code: &str,
    of: &str,
    text: Option<&str>,
) {
    let event = Event::new(EventKind::Login, Severity::Info, code).by(&who.origin());
    let event = match of {
        "" => event,
        of => event.what(of),
    };
    api.log.record(match text {
        Some(text) => event.text(text),
        None => event,
    });
}
