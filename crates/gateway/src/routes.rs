//! The addresses of the API, and who may use each. Every file of handlers brings a table of its
//! routes; [`ALL`] is the list of tables, and nothing is served that is in none of them.

use super::access::{Caller, Gate, Need, Reach, SESSION_ROUTES, USER_ROUTES, check, identify};
use super::config::{self, Desk};
use super::doc::Doc;
use super::guard::Front;
use super::keys::Keys;
use super::listen::ended;
use super::tls::Tls;
use super::{
    about, answer, capture, compress, control, events, guard, happening, history, loan, metrics,
    openapi, ops, points, ports, scans, send, settings, sim, spoken, web, webhook, ws,
};
use axum::body::Body;
use axum::extract::{DefaultBodyLimit, Query};
use axum::http::{Response, StatusCode};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{MethodRouter, get};
use axum::{Extension, Router};
use railbus_api::problem::{Problem, codes};
use railbus_plant::remote::Remote;
use railbus_site::Service;
use railbus_words::Lang;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::watch;

/// The longest request body.
const BODY_MAX: usize = 64 << 10;

/// Where all routes of the API begin.
pub(super) const BASE: &str = "/api/v1";

/// One method of one address of the API.
pub(super) struct Route {
    /// Its method, as HTTP writes it.
    pub(super) method: &'static str,
    /// Its address below [`BASE`].
    pub(super) path: &'static str,
    /// Who may use it.
    pub(super) need: Need,
    /// What it is to those who are limited to points.
    pub(super) reach: Reach,
    /// Its answer holds what only its reader may know, and so is not compressed: how short it
    /// becomes would tell of it.
    pub(super) is_secret: bool,
    /// What the API's document says of it.
    pub(super) doc: Option<Doc>,
    /// What answers.
    handler: fn() -> MethodRouter<Site>,
}

impl Route {
    pub(super) const fn new(
        method: &'static str,
        path: &'static str,
        need: Need,
        handler: fn() -> MethodRouter<Site>,
    ) -> Route {
        Route {
            method,
            path,
            need,
            reach: Reach::of(method, need),
            is_secret: false,
            doc: None,
            handler,
        }
    }

    /// Its answer holds a secret of its reader.
    pub(super) const fn secret(self) -> Route {
        Route {
            is_secret: true,
            ..self
        }
    }

    /// Its handler holds those who are limited to points to these.
    pub(super) const fn within_points(self) -> Route {
        Route {
            reach: Reach::Points,
            ..self
        }
    }

    /// It reaches no output and no configuration, though it is no GET.
    pub(super) const fn reads(self) -> Route {
        Route {
            reach: Reach::Harmless,
            ..self
        }
    }

    /// Says what it is for. A route of which nothing is said fails a test.
    pub(super) const fn doc(self, doc: Doc) -> Route {
        Route {
            doc: Some(doc),
            ..self
        }
    }
}

/// Every route of the API.
pub(super) const ALL: &[&[Route]] = &[
    points::ROUTES,
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
    happening::ROUTES,
    scans::ROUTES,
    send::ROUTES,
    settings::ROUTES,
    sim::ROUTES,
    ws::ROUTES,
    webhook::ROUTES,
];

/// What is asked by those who watch the daemon, beside the API.
pub(super) const TOP: &[Route] = &[
    Route::new("GET", "/healthz", Need::Nothing, || get(async || "ok\n"))
        .doc(Doc::new("Whether the daemon answers").media(&["text/plain"])),
    Route::new("GET", "/readyz", Need::Nothing, || get(about::ready))
        .doc(Doc::new("Whether every line was tried").media(&["text/plain"])),
    Route::new("GET", "/metrics", Need::VIEWER, || get(metrics::metrics))
        .doc(Doc::new("Figures for Prometheus").media(&["text/plain"])),
];

/// What every handler needs.
#[derive(Clone, Debug)]
pub(super) struct Site {
    pub(super) service: Service,
    /// The language of those who ask for none.
    pub(super) lang: Lang,
    /// Nothing is real.
    pub(super) demo: bool,
    /// The lines that are simulated here, and take orders.
    pub(super) simulated: Arc<[Remote]>,
    /// Streams end when the daemon does.
    pub(super) stop: watch::Receiver<bool>,
    pub(super) keys: Arc<Keys>,
    /// The room for WebSockets.
    pub(super) sockets: ws::Room,
    pub(super) ops: Arc<ops::Ops>,
    /// The configuration's file, and who may change it when.
    pub(super) desk: Arc<Desk>,
    /// Who is told of events.
    pub(super) hooks: Arc<webhook::Hooks>,
    /// Who may what.
    pub(super) access: Arc<Gate>,
    /// Where its pages are found: `http://127.0.0.1:7485`.
    pub(super) origin: Arc<str>,
    /// Browsers come by TLS.
    pub(super) tls: Option<Arc<Tls>>,
}

impl Site {
    /// Comes when what streams to somebody must end: the daemon does, or the caller's rights do.
    pub(super) fn over(&self, caller: &Caller) -> impl Future<Output = ()> + Send + use<> {
        let (mut stop, access, caller) =
            (self.stop.clone(), Arc::clone(&self.access), caller.clone());
        async move {
            tokio::select! {
                () = ended(&mut stop) => {}
                () = access.gone(&caller) => {}
            }
        }
    }

    /// What it is called: as the folder of its configuration.
    pub(super) fn name(&self) -> String {
        name_of(self.demo, self.desk.file())
    }
}

/// What a site is called whose configuration is this file.
pub(super) fn name_of(is_demo: bool, file: &Path) -> String {
    if is_demo {
        return "demo".to_owned();
    }
    let folder = file.parent().and_then(Path::file_name);
    folder.map_or_else(
        || "railbus".to_owned(),
        |name| name.to_string_lossy().into_owned(),
    )
}

pub(super) type Answer = Response<Body>;
pub(super) type Asked = Query<BTreeMap<String, String>>;

/// All addresses; over TCP those who ask must be known, and mean this daemon.
pub(super) fn router(site: Site, front: Option<Arc<Front>>) -> Router {
    let access = Arc::clone(&site.access);
    let router = handlers(site, front.is_none());
    let is_strict = front.as_ref().is_some_and(|front| front.is_trusted);
    let router = match front {
        Some(front) => router
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

/// All addresses and their handlers, each behind its rule: who asks must be known by then.
pub(super) fn handlers(site: Site, is_owners: bool) -> Router {
    // What only the daemon's own user may ask for is not there for anybody else.
    let is_there = |route: &&Route| route.need != Need::Owner || is_owners;
    let add = |router: Router<Site>, route: &Route| {
        let handler = match route.method == "GET" && !route.is_secret {
            true => (route.handler)().layer(from_fn(compress::answer)),
            false => (route.handler)(),
        };
        let ruled = handler.layer(from_fn_with_state((route.need, route.reach), check));
        router.route(route.path, ruled)
    };
    let routes = ALL.iter().copied().flatten().filter(is_there);
    let api = routes.fold(Router::new(), add);
    TOP.iter()
        .fold(Router::new(), add)
        .nest(BASE, api.layer(from_fn(spoken::only_problems)))
        .route("/style.css", get(web::style))
        .fallback(web::page)
        .method_not_allowed_fallback(not_so)
        .layer(from_fn_with_state(site.lang, spoken::problems))
        .with_state(site)
        .layer(DefaultBodyLimit::max(BODY_MAX))
}

async fn not_so() -> Answer {
    let problem = Problem {
        status: StatusCode::METHOD_NOT_ALLOWED.as_u16(),
        ..Problem::new(codes::NO_SUCH_PAGE)
    };
    answer::problem(&problem.with("reason", "not with this method"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names are made of `a-z`, `0-9` and `_`; a word of an address that stands where a name may
    /// stand has a hyphen, so that whatever has a name can be asked for.
    #[test]
    fn no_word_of_an_address_hides_a_name() {
        let routes = || ALL.iter().copied().flatten().map(|route| route.path);
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
