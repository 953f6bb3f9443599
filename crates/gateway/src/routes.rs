//! The routes of the API. Every file of handlers has a table of its routes; [`ALL`] is the list of
//! tables, and nothing else is served.

use super::access::{Caller, Gate, Need, SESSION_ROUTES, USER_ROUTES, check, identify};
use super::doc::Doc;
use super::guard::Front;
use super::northbound;
use super::route::{Answer, BASE, Route};
use super::site::Site;
use super::{
    about, answer, capture, compress, config, control, event_stream, events, guard, history, loan,
    localize, metrics, models, openapi, ops, points, ports, remote_api, scans, send, settings, sim,
    web, ws,
};
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, StatusCode};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{MethodFilter, MethodRouter, get, on};
use axum::{Extension, Router};
use railbus_api::problem::{Problem, codes};
use std::sync::Arc;

/// The longest request body.
pub(super) const BODY_MAX: usize = 64 << 10;

/// The tables of routes.
const ALL: &[&[Route]] = &[
    points::ROUTES,
    models::ROUTES,
    control::ROUTES,
    history::ROUTES,
    events::ROUTES,
    loan::ROUTES,
    config::ROUTES,
    config::TABLES,
    config::RULES,
    ports::ROUTES,
    openapi::ROUTES,
    SESSION_ROUTES,
    USER_ROUTES,
    ops::ROUTES,
    about::ROUTES,
    capture::ROUTES,
    event_stream::ROUTES,
    scans::ROUTES,
    send::ROUTES,
    settings::ROUTES,
    sim::ROUTES,
    ws::ROUTES,
    northbound::routes::ROUTES,
    northbound::routes::OF_KINDS,
];

/// Every route of the API.
pub(super) fn all() -> impl Iterator<Item = &'static Route> {
    ALL.iter().copied().flatten()
}

/// Routes for monitoring, outside the API.
pub(super) const TOP: &[Route] = &[
    Route::new("GET", "/healthz", Need::Nothing, || get(async || "ok\n"))
        .doc(Doc::new("Whether the daemon answers").media(&["text/plain"])),
    Route::new("GET", "/readyz", Need::Nothing, || get(about::ready))
        .doc(Doc::new("Whether every line was tried").media(&["text/plain"])),
    Route::new("GET", "/metrics", Need::VIEWER, || get(metrics::metrics))
        .doc(Doc::new("Figures for Prometheus").media(&["text/plain"])),
];

/// All routes; over TCP callers must be authenticated, and the request be meant for this daemon.
pub(super) fn router(site: Site, front: Option<Arc<Front>>) -> Router {
    let access = Arc::clone(&site.access);
    let audience = match &front {
        Some(_) => Audience::Network,
        None => Audience::Owner,
    };
    let router = handlers(site, audience);
    guarded(router, front.map(|front| (access, front)))
}

/// What every request has to pass: over TCP it must be meant for this program, and its caller is
/// identified by these accounts. Over the socket the caller is the owner.
pub(super) fn guarded(router: Router, tcp: Option<(Arc<Gate>, Arc<Front>)>) -> Router {
    let is_strict = tcp.as_ref().is_some_and(|(_, front)| front.is_trusted);
    let router = match tcp {
        Some((access, front)) => router
            .layer(from_fn_with_state(access, identify))
            .layer(from_fn(guard::timely))
            .layer(from_fn_with_state(front, guard::front)),
        None => router.layer(Extension(Caller::owner())),
    };
    let router = router.layer(from_fn(guard::headers));
    match is_strict {
        true => router.layer(from_fn(guard::strict)),
        false => router,
    }
}

/// Who is served.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Audience {
    /// The daemon's own user, over its socket.
    Owner,
    /// Clients over TCP.
    Network,
    /// Remote callers, through an outlet.
    Remote,
}

/// All routes and their handlers, each behind its permission check: the caller must be known by
/// then.
pub(super) fn handlers(site: Site, audience: Audience) -> Router {
    // Routes for the daemon's own user do not exist for others.
    let is_there = |route: &&Route| route.need != Need::Owner || audience == Audience::Owner;
    let accounts = site.accounts();
    let add = |router: Router<Site>, route: &Route| {
        let handler = match (audience, route.method == "GET" && !route.is_secret) {
            (Audience::Remote, _) if !route.is_remote() => any_of(route.method),
            (_, true) => {
                let handler = route.handler.of_site(&accounts);
                handler.layer(from_fn(compress::answer))
            }
            (_, false) => route.handler.of_site(&accounts),
        };
        let ruled = handler.layer(from_fn_with_state((route.need, route.reach), check));
        router.route(route.path, ruled)
    };
    let routes = all().filter(is_there);
    let api = routes.fold(Router::new(), add);
    TOP.iter()
        .fold(Router::new(), add)
        .nest(BASE, api.layer(from_fn(localize::only_problems)))
        .route("/style.css", get(web::style))
        .fallback(web::page)
        .method_not_allowed_fallback(not_so)
        .layer(from_fn_with_state(site.lang, localize::problems))
        .with_state(site)
        .layer(DefaultBodyLimit::max(BODY_MAX))
}

pub(super) async fn not_so() -> Answer {
    let problem = Problem {
        status: StatusCode::METHOD_NOT_ALLOWED.as_u16(),
        ..Problem::new(codes::NO_SUCH_PAGE)
    };
    answer::problem(&problem.with("reason", "not with this method"))
}

/// Whether this request is a command that can be given from afar.
#[cfg_attr(
    not(any(test, feature = "fleet")),
    expect(dead_code, reason = "there are no sites but this one")
)]
pub(super) fn is_command(method: &str, path: &str) -> bool {
    let path = path.split('?').next().unwrap_or_default();
    let Some(path) = path.strip_prefix(BASE) else {
        return false;
    };
    let fits = |pattern: &str| {
        let is_one = |(wanted, part): (&str, &str)| {
            wanted == part || wanted.starts_with('{') && !part.is_empty()
        };
        pattern.split('/').count() == path.split('/').count()
            && pattern.split('/').zip(path.split('/')).all(is_one)
    };
    let mut commands = all().filter(|route| route.is_command && route.method == method);
    commands.any(|route| fits(route.path))
}

/// The route exists, and not for remote callers.
fn any_of(method: &str) -> MethodRouter<Site> {
    let method = Method::from_bytes(method.as_bytes()).unwrap_or_default();
    let filter = MethodFilter::try_from(method).unwrap_or(MethodFilter::GET);
    on(filter, async |method: Method| {
        answer::problem(&remote_api::not_remote(method.as_str()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names consist of `a-z`, `0-9` and `_`; a fixed path segment in a place where a name is
    /// possible has a hyphen, so that every name can be used.
    #[test]
    fn no_word_of_an_address_hides_a_name() {
        let routes = || all().map(|route| route.path);
        let is_named = |part: &str| part.starts_with('{');
        for (named, word) in routes().flat_map(|path| routes().map(move |other| (path, other))) {
            let parts = || named.split('/').zip(word.split('/'));
            let is_both = named.split('/').count() == word.split('/').count()
                && parts().all(|(a, b)| a == b || is_named(a) || is_named(b));
            let hidden = |(a, b): &(&str, &str)| is_named(a) && !is_named(b) && !b.contains('-');
            let found = parts().find(hidden).filter(|_| is_both);
            assert_eq!(found, None, "{named} can't be asked for where {word} is");
        }
    }
}
