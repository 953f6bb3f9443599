//! The API of the centre, over its socket and over TCP, and what is required of its callers.

use super::command::{self, GivenCommand};
use super::driver::HubCall;
use super::site_api;
use super::view::SCHEMA;
use crate::access::{AccountsApi, Caller, Need, Reach, SESSION_ROUTES, USER_ROUTES, check};
use crate::guard::Front;
use crate::route::{BASE, Route, RouteHandler};
use crate::routes::{BODY_MAX, guarded, not_so};
use crate::{answer, localize};
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::header::ACCEPT_LANGUAGE;
use axum::http::{HeaderMap, Method, Response, Uri};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{any, get};
use axum::{Extension, Router};
use railbus_api::fleet::FleetAccounts;
use railbus_api::problem::{Problem, codes};
use railbus_words::Lang;
use std::path::Path as FilePath;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot};

pub(super) type Calls = mpsc::Sender<HubCall>;

/// The first user of a centre is added by the command line: it has no page for that.
const SETUP: &str = "/setup";

/// Who is served.
pub(super) enum HubAudience<'a> {
    /// Its owner, over the socket; with the accounts, where it listens, and the fleet's folder.
    Owner(Option<&'a AccountsApi>, &'a FilePath),
    /// Clients over TCP who have an account.
    Network(&'a AccountsApi, Arc<Front>),
}

/// All routes for these callers.
pub(super) fn router(lang: Lang, calls: Calls, audience: HubAudience<'_>) -> Router {
    let (accounts, of_owner, tcp) = match audience {
        HubAudience::Owner(accounts, folder) => {
            let folder = accounts.and_then(|_| folder.canonicalize().ok());
            let about = FleetAccounts {
                schema: SCHEMA,
                folder: folder.map(|folder| folder.display().to_string()),
            };
            let told = async move || answer::json(Ok(about.clone()));
            let of_owner = Router::new().route("/fleet/v1/accounts", get(told));
            (accounts, of_owner, None)
        }
        HubAudience::Network(accounts, front) => {
            let tcp = Some((Arc::clone(&accounts.access), front));
            (Some(accounts), Router::new(), tcp)
        }
    };
    let fleet = Router::new()
        .route("/fleet/v1/sites", get(sites))
        .route("/fleet/v1/sites/{site}", get(site))
        .route("/fleet/v1/commands", get(commands))
        .route_layer(from_fn_with_state((Need::VIEWER, Reach::Harmless), check))
        .layer(from_fn_with_state(lang, localize::problems));
    // Who is limited to some points of a site can't be held to them here.
    let reads = get(site_api).layer(from_fn_with_state((Need::VIEWER, Reach::Harmless), check));
    let orders = any(site_api).layer(from_fn_with_state((Need::OPERATOR, Reach::Beyond), check));
    let fleet = fleet.route("/s/{site}/{*path}", reads.merge(orders));
    let router = Router::new()
        .merge(fleet.with_state(calls))
        .merge(of_owner)
        .route("/healthz", get(async || "ok\n"));
    let router = match accounts {
        Some(accounts) => router.nest(BASE, account_routes(accounts, tcp.is_none())),
        None => router,
    };
    let router = router
        .fallback(async || answer::problem(&Problem::new(codes::NO_SUCH_PAGE)))
        .method_not_allowed_fallback(not_so);
    guarded(router, tcp)
}

/// Sessions, users and tokens.
fn account_routes(accounts: &AccountsApi, is_owner: bool) -> Router {
    let all = SESSION_ROUTES.iter().chain(USER_ROUTES);
    let is_there =
        |route: &&Route| !route.path.starts_with(SETUP) && (is_owner || route.need != Need::Owner);
    let add = |router: Router<AccountsApi>, route: &Route| match route.handler {
        RouteHandler::Accounts(handler) => {
            let rule = from_fn_with_state((route.need, route.reach), check);
            router.route(route.path, handler().layer(rule))
        }
        RouteHandler::Site(_) => router,
    };
    all.filter(is_there)
        .fold(Router::new(), add)
        .layer(DefaultBodyLimit::max(BODY_MAX))
        .layer(from_fn(localize::only_problems))
        .layer(from_fn_with_state(accounts.lang, localize::problems))
        .with_state(accounts.clone())
}

async fn sites(State(calls): State<Calls>) -> Response<Body> {
    answer::json(call(&calls, HubCall::Sites).await)
}

async fn commands(State(calls): State<Calls>) -> Response<Body> {
    answer::json(call(&calls, HubCall::Commands).await)
}

async fn site(State(calls): State<Calls>, Path(name): Path<String>) -> Response<Body> {
    let found = call(&calls, |to| HubCall::Site(name, to)).await;
    answer::json(found.and_then(|found| found))
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
        let key = headers.get("idempotency-key");
        // What is no text is no key.
        let key = key.map(|key| key.to_str().unwrap_or_default());
        let given = GivenCommand::new(
            (name, key),
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
mod tests {
    use super::*;
    use crate::access::{Gate, Peer, desk};
    use axum::http::{Request, StatusCode};
    use http_body_util::BodyExt as _;
    use hyper::service::Service as _;
    use hyper_util::service::TowerToHyperService;
    use railbus_api::fleet::FleetCommands;
    use serde_json::{Value, json};
    use std::net::{IpAddr, Ipv4Addr};
    use std::path::PathBuf;

    const SITE: &str = "/s/plant7/api/v1/points/oven/k1";

    /// A centre whose driver notes the users of what it is asked.
    struct Here {
        accounts: AccountsApi,
        calls: Calls,
        users: mpsc::UnboundedReceiver<String>,
        folder: PathBuf,
    }

    impl Here {
        fn new(name: &str) -> Here {
            let unique = format!("railbus-hub-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(unique);
            let gate = Gate::open(&folder).unwrap_or_else(|problem| panic!("{problem:?}"));
            let accounts = AccountsApi {
                access: Arc::new(gate),
                events: None,
                lang: Lang::En,
                demo: false,
                simulated: false,
                name: "acme".into(),
                origin: "http://127.0.0.1:7486".into(),
                is_tls: false,
            };
            let (calls, mut asked) = mpsc::channel(8);
            let (told, users) = mpsc::unbounded_channel();
            tokio::spawn(async move {
                while let Some(call) = asked.recv().await {
                    match call {
                        HubCall::Commands(to) => {
                            let (schema, open, commands) = (1, 0, Vec::new());
                            let _ = to.send(FleetCommands {
                                schema,
                                open,
                                commands,
                            });
                        }
                        HubCall::Command(given, to) => {
                            let intent = given.intent(given.given, None, 0);
                            let _ = told.send(intent.map_or_else(|_| String::new(), |it| it.user));
                            let _ = to.send(Err(command::offline("plant7")));
                        }
                        HubCall::Way(site, to) => {
                            let _ = to.send(Err(command::offline(&site)));
                        }
                        HubCall::Sites(_) | HubCall::Site(..) => {}
                    }
                }
            });
            Here {
                accounts,
                calls,
                users,
                folder,
            }
        }

        async fn token(&self, name: &str, role: &str, points: &[&str]) -> String {
            let wanted = json!({ "name": name, "role": role, "points": points });
            let body = wanted.to_string();
            let made = desk::add_token(&self.accounts.access, "owner", body.as_bytes()).await;
            made.map_or_else(
                |problem| panic!("{problem:?}"),
                |made| made["token"].as_str().unwrap_or_default().to_owned(),
            )
        }

        fn front() -> Arc<Front> {
            Arc::new(Front {
                port: 7486,
                is_tls: false,
                is_wide: false,
                names: Vec::new(),
                is_trusted: false,
            })
        }

        /// Status and code of an answer over TCP; over the socket without a token.
        async fn ask(&self, token: Option<&str>, method: &str, path: &str) -> (StatusCode, String) {
            let front = token.map(|_| Here::front());
            let router = routes_of(self, front);
            let mut request = Request::builder()
                .method(method)
                .uri(path)
                .header("host", "127.0.0.1:7486");
            if let Some(token) = token.filter(|token| !token.is_empty()) {
                request = request.header("authorization", format!("Bearer {token}"));
            }
            let mut request = request.body(Body::from("{\"value\":true}")).unwrap();
            let peer = Peer(IpAddr::V4(Ipv4Addr::LOCALHOST));
            request.extensions_mut().insert(peer);
            let Ok(answer) = TowerToHyperService::new(router).call(request).await;
            let status = answer.status();
            let body = answer.into_body().collect().await.unwrap().to_bytes();
            let body: Value = serde_json::from_slice(&body).unwrap_or_default();
            (status, body["code"].as_str().unwrap_or_default().to_owned())
        }
    }

    impl Drop for Here {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }

    fn routes_of(here: &Here, front: Option<Arc<Front>>) -> Router {
        let audience = match front {
            Some(front) => HubAudience::Network(&here.accounts, front),
            None => HubAudience::Owner(Some(&here.accounts), &here.folder),
        };
        router(Lang::En, here.calls.clone(), audience)
    }

    #[tokio::test]
    async fn over_tcp_each_may_what_his_role_permits() {
        let mut here = Here::new("roles");
        let viewer = here.token("look", "viewer", &[]).await;
        let operator = here.token("ops", "operator", &[]).await;
        let limited = here.token("few", "operator", &["oven.*"]).await;
        let admin = here.token("root", "admin", &[]).await;
        let anonymous = String::new();
        let away = (StatusCode::SERVICE_UNAVAILABLE, "E0168".to_owned());
        for (path, method, codes) in [
            ("/healthz", "GET", ["", "", "", "", ""]),
            ("/fleet/v1/commands", "GET", ["E0902", "", "", "", ""]),
            // The driver of this test drops these calls.
            (
                "/fleet/v1/sites",
                "GET",
                ["E0902", "E0109", "E0109", "E0109", "E0109"],
            ),
            (
                "/fleet/v1/sites/plant7",
                "GET",
                ["E0902", "E0109", "E0109", "E0109", "E0109"],
            ),
            (SITE, "GET", ["E0902", "E0168", "E0168", "E0168", "E0168"]),
            (SITE, "PUT", ["E0902", "E0905", "E0922", "E0168", "E0168"]),
            (SITE, "PATCH", ["E0902", "E0905", "E0922", "E0937", "E0937"]),
            (
                "/api/v1/users",
                "GET",
                ["E0902", "E0905", "E0905", "E0905", ""],
            ),
            ("/fleet/v1/accounts", "GET", ["E0110"; 5]),
            ("/api/v1/setup-link", "POST", ["E0110"; 5]),
            ("/api/v1/setup", "POST", ["E0110"; 5]),
            ("/api/v1/points", "GET", ["E0110"; 5]),
        ] {
            let callers = [&anonymous, &viewer, &limited, &operator, &admin];
            for (caller, wanted) in callers.into_iter().zip(codes) {
                let (status, code) = here.ask(Some(caller), method, path).await;
                assert_eq!(code, wanted, "{method} {path} as {caller}: {status}");
                assert!(code != away.1 || status == away.0, "{status}");
            }
        }
        let mut users = Vec::new();
        while let Ok(user) = here.users.try_recv() {
            users.push(user);
        }
        assert_eq!(users, ["token:ops", "token:root"], "as the site records it");
        // What is revoked is let in no longer.
        desk::remove_token(&here.accounts.access, "look")
            .await
            .unwrap_or_default();
        let told = here.ask(Some(&viewer), "GET", "/fleet/v1/commands").await;
        assert_eq!(told.1, "E0902");
    }

    #[tokio::test]
    async fn its_owner_may_all_over_the_socket() {
        let mut here = Here::new("owner");
        assert_eq!(here.ask(None, "GET", "/fleet/v1/commands").await.1, "");
        assert_eq!(here.ask(None, "GET", "/api/v1/users").await.1, "");
        assert_eq!(here.ask(None, "PUT", SITE).await.1, "E0168");
        assert_eq!(here.users.recv().await.as_deref(), Some("owner"));
    }
}
