//! The API of the centre, over its socket and over TCP, and what is required of its callers.

use super::bulk::{self, BULK_BODY_MAX, BulkWanted, GivenBulk, PreviewWanted};
use super::command::{self, GivenCommand};
use super::config::{self, CONFIG_BODY_MAX};
use super::driver::HubCall;
use super::pages;
use super::site_api;
use super::sites::SitesWanted;
use super::view::SCHEMA;
use crate::access::{
    AccountsApi, Caller, Need, Reach, SESSION_ROUTES, USER_ROUTES, check, to_its_end,
};
use crate::body;
use crate::doc::Doc;
use crate::guard::Front;
use crate::language::spoken;
use crate::openapi::{ApiAbout, text};
use crate::route::{Asked, BASE, Route, RouteHandler};
use crate::routes::{BODY_MAX, guarded, not_so};
use crate::{answer, compress, localize, web};
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::header::ACCEPT_LANGUAGE;
use axum::http::{HeaderMap, Method, Response, StatusCode, Uri};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{any, delete, get, post, put};
use axum::{Extension, Router};
use railbus_api::fleet::{
    FleetAccounts, FleetBulkPreview, FleetBulkSites, FleetCommand, FleetCommandEnd, FleetCommands,
    FleetConfig, FleetConfigText, FleetRemoval, FleetSitePoints, FleetSiteTold, FleetSites,
    GiveBulk, PreviewBulk, SetSiteConfig, SetSiteGroups,
};
use railbus_api::problem::{Problem, codes};
use railbus_app::render::out;
use railbus_words::width::is_shown;
use railbus_words::{Code, Lang};
use serde::de::DeserializeOwned;
use std::path::Path as FilePath;
use std::sync::{Arc, LazyLock};
use tokio::sync::{mpsc, oneshot};

pub(super) type Calls = mpsc::Sender<HubCall>;

/// The prefix of the centre's own routes.
const FLEET_BASE: &str = "/fleet/v1";
/// The prefix of the routes of a site that the centre answers itself.
const FAR_BASE: &str = "/s/{site}/api/v1";

/// The centre's own routes.
const ROUTES: &[Route] = &[
    Route::of_hub("GET", "/sites", Need::VIEWER, || get(sites)).doc(
        Doc::new("The sites of the fleet: all, or those that are searched for")
            .query(super::sites::QUERY)
            .answers::<FleetSites>(),
    ),
    Route::of_hub("GET", "/sites/{site}", Need::VIEWER, || get(site)).doc(
        Doc::new("A site, and what the centre knows of its points").answers::<FleetSitePoints>(),
    ),
    Route::of_hub("DELETE", "/sites/{site}", Need::ADMIN, || delete(remove)).doc(
        Doc::new("Remove a site that is offline. Its key stays valid: it can come back")
            .answers::<FleetRemoval>(),
    ),
    Route::of_hub("PUT", "/sites/{site}/groups", Need::ENGINEER, || {
        put(set_groups)
    })
    .doc(
        Doc::new("Set the groups that a site is in, also before it joins")
            .takes::<SetSiteGroups>()
            .answers::<FleetSiteTold>(),
    ),
    Route::of_hub("GET", "/sites/{site}/config", Need::ENGINEER, || {
        get(config::told)
    })
    .doc(
        Doc::new("The configuration that a site is to have, and how far it is")
            .answers::<FleetConfig>(),
    ),
    Route::of_hub("PUT", "/sites/{site}/config", Need::ENGINEER, || {
        put(config::set).layer(DefaultBodyLimit::max(CONFIG_BODY_MAX))
    })
    .doc(
        Doc::new(
            "Give a site another configuration. The site tries it for two minutes, and takes it \
             back unless it works as before. One that is away takes part when it comes",
        )
        .takes::<SetSiteConfig>()
        .answers::<FleetConfig>(),
    ),
    Route::of_hub("GET", "/sites/{site}/config/text", Need::ENGINEER, || {
        get(config::text)
    })
    .doc(Doc::new("Ask a site for the configuration that it has now").answers::<FleetConfigText>()),
    Route::of_hub("GET", "/commands", Need::VIEWER, || get(commands))
        .doc(Doc::new("The newest commands to sites, the newest last").answers::<FleetCommands>()),
    Route::of_hub("POST", "/commands/preview", Need::OPERATOR, || {
        post(preview)
    })
    .doc(
        Doc::new("Which sites a command would go to. Nothing is sent")
            .takes::<PreviewBulk>()
            .answers::<FleetBulkPreview>(),
    ),
    Route::of_hub("POST", "/commands", Need::OPERATOR, || {
        post(give_bulk).layer(DefaultBodyLimit::max(BULK_BODY_MAX))
    })
    .doc(
        Doc::new(
            "Give the same command to many sites. The answer comes once it is recorded; what came \
             of each site is told by its id",
        )
        .query(bulk::QUERY)
        .takes::<GiveBulk>()
        .answers::<FleetBulkSites>(),
    ),
    Route::of_hub("GET", "/commands/{id}", Need::VIEWER, || get(bulk_of)).doc(
        Doc::new("A command to many sites, and what came of each")
            .query(bulk::QUERY)
            .answers::<FleetBulkSites>(),
    ),
    Route::of_hub("POST", "/commands/{id}/stop", Need::OPERATOR, || {
        post(stop_bulk)
    })
    .doc(
        Doc::new("Send no more of its commands. What was sent goes on")
            .query(bulk::QUERY)
            .answers::<FleetBulkSites>(),
    ),
    Route::of_hub("GET", "/accounts", Need::Owner, || get(accounts))
        .doc(Doc::new("Which accounts the centre has").answers::<FleetAccounts>()),
    Route::of_hub("GET", "/openapi.json", Need::Nothing, || get(document))
        .doc(Doc::new("This document")),
];

const ABOUT: ApiAbout = ApiAbout {
    title: "railbus fleet",
    about: "The sites of a fleet, as its centre knows them, and the users of the centre. The API \
            of a site is at /s/SITE/api/v1, as its own document describes it: what can be read, \
            and commands. Fields are only ever added; readers ignore what they do not know.",
    base: None,
};

/// The document does not change while the program runs.
pub(crate) static DOCUMENT: LazyLock<String> = LazyLock::new(|| text(&ABOUT, documented()));

/// All routes of the centre, each with the prefix of its path.
pub(crate) fn documented() -> impl Iterator<Item = (&'static str, &'static Route)> {
    let own = ROUTES.iter().map(|route| (FLEET_BASE, route));
    let accounts = SESSION_ROUTES.iter().chain(USER_ROUTES);
    let far = SESSION_ROUTES
        .iter()
        .filter(|route| FAR.contains(&route.path));
    own.chain(accounts.map(|route| (BASE, route)))
        .chain(far.map(|route| (FAR_BASE, route)))
}

/// Routes of sessions that a page of a far site needs. Its users are those of the centre.
const FAR: [&str; 4] = ["/session", "/login", "/logout", "/password"];

/// What the centre's own handlers need.
#[derive(Clone, Debug)]
pub(crate) struct HubApi {
    pub(super) calls: Calls,
    pub(super) lang: Lang,
    /// Which accounts it has.
    accounts: FleetAccounts,
}

/// Who is served.
pub(super) enum HubAudience<'a> {
    /// Its owner, over the socket; with the accounts, where it listens, and the fleet's folder.
    Owner(Option<&'a AccountsApi>, &'a FilePath),
    /// Clients over TCP who have an account.
    Network(&'a AccountsApi, Arc<Front>),
}

/// All routes for these callers.
pub(super) fn router(lang: Lang, calls: Calls, audience: HubAudience<'_>) -> Router {
    let (accounts, folder, tcp) = match audience {
        HubAudience::Owner(accounts, folder) => {
            let folder = accounts.and_then(|_| folder.canonicalize().ok());
            (accounts, folder, None)
        }
        HubAudience::Network(accounts, front) => {
            let tcp = Some((Arc::clone(&accounts.access), front));
            (Some(accounts), None, tcp)
        }
    };
    let is_owner = tcp.is_none();
    let accounts_told = FleetAccounts {
        schema: SCHEMA,
        folder: folder.map(|folder| folder.display().to_string()),
    };
    let api = HubApi {
        calls: calls.clone(),
        lang,
        accounts: accounts_told,
    };
    // Who is limited to some points of a site can't be held to them here.
    let reads = get(site_api).layer(from_fn_with_state((Need::VIEWER, Reach::Harmless), check));
    let orders = any(site_api).layer(from_fn_with_state((Need::OPERATOR, Reach::Beyond), check));
    let router = Router::new()
        .route("/s/{site}/api/{*path}", reads.merge(orders))
        .with_state(calls)
        .nest(FLEET_BASE, own_routes(api, is_owner))
        .route("/healthz", get(async || "ok\n"));
    let router = match accounts {
        Some(accounts) => router
            .nest(BASE, account_routes(accounts, is_owner, |_| true))
            .nest(
                FAR_BASE,
                account_routes(accounts, is_owner, |route| FAR.contains(&route.path)),
            ),
        None => router,
    };
    let router = match is_owner {
        true => router.fallback(async || answer::problem(&Problem::new(codes::NO_SUCH_PAGE))),
        // The socket is for programs, which would take a page for an answer.
        false => router.route("/style.css", get(web::style)).fallback(
            async move |method: Method, uri: Uri, headers: HeaderMap| {
                pages::page(lang, &method, &uri, &headers)
            },
        ),
    };
    let router = router
        .method_not_allowed_fallback(not_so)
        .layer(from_fn_with_state(lang, localize::problems));
    guarded(router, tcp)
}

/// What the centre knows of the fleet.
fn own_routes(api: HubApi, is_owner: bool) -> Router {
    let is_there = |route: &&Route| is_owner || route.need != Need::Owner;
    let add = |router: Router<HubApi>, route: &Route| match route.handler {
        RouteHandler::Hub(handler) => {
            let rule = from_fn_with_state((route.need, route.reach), check);
            let handler = handler().layer(from_fn(compress::answer));
            router.route(route.path, handler.layer(rule))
        }
        RouteHandler::Site(_) | RouteHandler::Accounts(_) => router,
    };
    let routes = ROUTES.iter().filter(is_there).fold(Router::new(), add);
    routes
        .layer(DefaultBodyLimit::max(BODY_MAX))
        .layer(from_fn(localize::only_problems))
        .with_state(api)
}

/// Sessions, users and tokens: the routes that are wanted.
fn account_routes(accounts: &AccountsApi, is_owner: bool, is_wanted: fn(&Route) -> bool) -> Router {
    let all = SESSION_ROUTES.iter().chain(USER_ROUTES);
    let is_there = |route: &&Route| is_wanted(route) && (is_owner || route.need != Need::Owner);
    let add = |router: Router<AccountsApi>, route: &Route| match route.handler {
        RouteHandler::Accounts(handler) => {
            let rule = from_fn_with_state((route.need, route.reach), check);
            router.route(route.path, handler().layer(rule))
        }
        RouteHandler::Site(_) | RouteHandler::Hub(_) => router,
    };
    all.filter(is_there)
        .fold(Router::new(), add)
        .layer(DefaultBodyLimit::max(BODY_MAX))
        .layer(from_fn(localize::only_problems))
        .with_state(accounts.clone())
}

async fn sites(State(api): State<HubApi>, asked: Asked, headers: HeaderMap) -> Response<Body> {
    let wanted = match SitesWanted::of(&asked) {
        Ok(wanted) => wanted,
        Err(problem) => return answer::problem(&problem),
    };
    let told = call(&api.calls, |to| HubCall::Sites(wanted, to)).await;
    answer::json(told.map(|mut told| {
        if headers.contains_key(ACCEPT_LANGUAGE) {
            let lang = spoken(&headers, api.lang);
            let error = told.connection.error.take();
            told.connection.error = error.map(|problem| localize::told(lang, problem));
        }
        told
    }))
}

async fn commands(State(api): State<HubApi>, headers: HeaderMap) -> Response<Body> {
    let told = call(&api.calls, HubCall::Commands).await;
    answer::json(told.map(|mut told| {
        if headers.contains_key(ACCEPT_LANGUAGE) {
            let lang = spoken(&headers, api.lang);
            for FleetCommand { end, .. } in &mut told.commands {
                title(lang, end);
            }
        }
        told
    }))
}

/// The parsed body of a request.
pub(super) fn parsed<T: DeserializeOwned>(body: &[u8]) -> Result<T, Problem> {
    body::parse(body)
        .map_err(|error| Problem::new(codes::BAD_REQUEST).with("reason", error.to_string()))
}

async fn preview(State(api): State<HubApi>, body: Bytes) -> Response<Body> {
    let wanted = parsed::<PreviewBulk>(&body).and_then(|wanted| PreviewWanted::new(&wanted));
    match wanted {
        Ok(wanted) => answer::json(call(&api.calls, |to| HubCall::Preview(wanted, to)).await),
        Err(problem) => answer::problem(&problem),
    }
}

/// An order to many sites. It goes on also if the caller goes away: once it is recorded, it is
/// known by its id.
async fn give_bulk(
    State(api): State<HubApi>,
    Extension(caller): Extension<Caller>,
    asked: Asked,
    headers: HeaderMap,
    body: Bytes,
) -> Response<Body> {
    let language = headers.get(ACCEPT_LANGUAGE);
    let language = language.and_then(|value| value.to_str().ok());
    let who = (caller.name.as_str(), language.unwrap_or_default());
    let given = parsed(&body).and_then(|wanted| GivenBulk::new(wanted, key(&headers), who));
    let (given, listed) = match (given, BulkWanted::of(&asked)) {
        (Ok(given), Ok(listed)) => (given, listed),
        (Err(problem), _) | (_, Err(problem)) => return answer::problem(&problem),
    };
    let told = bulk::give(&api.calls, given, listed).await;
    answer::json(told.map(|told| titled(&api, &headers, told)))
}

async fn bulk_of(
    State(api): State<HubApi>,
    Path(id): Path<String>,
    asked: Asked,
    headers: HeaderMap,
) -> Response<Body> {
    let told = match BulkWanted::of(&asked) {
        Ok(wanted) => bulk::see(&api.calls, id, wanted).await,
        Err(problem) => Err(problem),
    };
    answer::json(told.map(|told| titled(&api, &headers, told)))
}

async fn stop_bulk(
    State(api): State<HubApi>,
    Extension(caller): Extension<Caller>,
    Path(id): Path<String>,
    asked: Asked,
    headers: HeaderMap,
) -> Response<Body> {
    let told = match BulkWanted::of(&asked) {
        Ok(wanted) => bulk::stop(&api.calls, id, caller.name, wanted).await,
        Err(problem) => Err(problem),
    };
    answer::json(told.map(|told| titled(&api, &headers, told)))
}

/// What codes mean, if a language is asked for.
fn titled(api: &HubApi, headers: &HeaderMap, mut told: FleetBulkSites) -> FleetBulkSites {
    if headers.contains_key(ACCEPT_LANGUAGE) {
        let lang = spoken(headers, api.lang);
        for site in &mut told.sites {
            title(lang, &mut site.end);
        }
    }
    told
}

/// What the code of a result means.
fn title(lang: Lang, end: &mut FleetCommandEnd) {
    let code = end.code.as_deref().and_then(Code::from_name);
    end.title = code.map(|code| code.page().title(lang).to_owned());
}

async fn site(State(api): State<HubApi>, Path(name): Path<String>) -> Response<Body> {
    let found = call(&api.calls, |to| HubCall::Site(name, to)).await;
    answer::json(found.and_then(|found| found))
}

/// Removes a site, to its end, even if the caller goes away: that somebody did it, or may have, is
/// always told.
async fn remove(
    State(api): State<HubApi>,
    Extension(caller): Extension<Caller>,
    Path(name): Path<String>,
) -> Response<Body> {
    to_its_end(async move {
        let what = format!("site_removed {name}");
        let removed = call(&api.calls, |to| HubCall::Remove(name, to)).await;
        let removed = changed(removed);
        note_change(&caller, &what, removed.as_ref().err());
        answer::json(removed)
    })
    .await
}

/// Sets the groups of a site, to the end, too.
async fn set_groups(
    State(api): State<HubApi>,
    Extension(caller): Extension<Caller>,
    Path(name): Path<String>,
    body: Bytes,
) -> Response<Body> {
    to_its_end(async move {
        let wanted: SetSiteGroups = match parsed(&body) {
            Ok(wanted) => wanted,
            Err(problem) => return answer::problem(&problem),
        };
        // As they are wanted: others may have changed them since.
        let groups = wanted.groups;
        let what = format!("groups_set {name} {}", groups.join(" "));
        let set = call(&api.calls, |to| HubCall::Groups(name, groups, to)).await;
        let set = changed(set);
        note_change(&caller, what.trim_end(), set.as_ref().err());
        answer::json(set)
    })
    .await
}

/// The result of a change: without an answer of the driver it may have been made.
pub(super) fn changed<T>(told: Result<Result<T, Problem>, Problem>) -> Result<T, Problem> {
    told.map_err(|problem| problem.perhaps_acted(true))?
}

/// Reports a change of a site, and who made it; also if it may have been made.
pub(super) fn note_change(who: &Caller, what: &str, why: Option<&Problem>) {
    let perhaps = match why {
        None => "",
        Some(problem) if problem.may_have_acted => " (perhaps)",
        Some(_) => return,
    };
    let origin = who.origin();
    let (by, via) = (origin.who, origin.via);
    // Names are checked by the driver, which may have stopped before.
    let what: String = what.chars().filter(|letter| is_shown(*letter)).collect();
    out::note(&format!("sites: {what}{perhaps} by {by} via {via}"));
}

async fn document() -> Response<Body> {
    answer::with(StatusCode::OK, "application/json", DOCUMENT.as_str())
}

async fn accounts(State(api): State<HubApi>) -> Response<Body> {
    answer::json(Ok(api.accounts))
}

/// The API of a site: the path behind its name, with the query.
async fn site_api(
    State(calls): State<Calls>,
    Extension(caller): Extension<Caller>,
    Path((name, _)): Path<(String, String)>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
    body: Bytes,
) -> Response<Body> {
    let path = uri.path_and_query().map_or("", |path| path.as_str());
    let path = path.splitn(4, '/').nth(3).unwrap_or_default();
    let language = headers.get(ACCEPT_LANGUAGE);
    let language = language.and_then(|value| value.to_str().ok());
    let language = language.unwrap_or_default();
    let path = format!("/{path}");
    if method == Method::PUT || method == Method::POST {
        let given = GivenCommand::new(
            (name, key(&headers)),
            (method.as_str(), &path),
            body,
            (&caller.name, language),
        );
        return match given {
            Ok(given) => command::give(&calls, given).await,
            Err(problem) => answer::problem(&problem),
        };
    }
    let request = site_api::request(&method, &path, (&caller.name, language));
    let asked = async { site_api::ask(&calls, &name, request?).await };
    asked
        .await
        .unwrap_or_else(|problem| answer::problem(&problem))
}

/// The key under which a command is carried out once. What is no text is no key.
fn key(headers: &HeaderMap) -> Option<&str> {
    let key = headers.get("idempotency-key")?;
    Some(key.to_str().unwrap_or_default())
}

/// Asks the driver.
pub(super) async fn call<T>(
    calls: &Calls,
    what: impl FnOnce(oneshot::Sender<T>) -> HubCall,
) -> Result<T, Problem> {
    let (to, told) = oneshot::channel();
    // Fails once the centre is stopping.
    let _ = calls.send(what(to)).await;
    told.await
        .map_err(|_| Problem::new(codes::DAEMON).with("reason", "stopping"))
}

#[cfg(test)]
mod tests;
