//! Who may use which route: the table in `SECURITY.md` is generated from the routes, and every
//! handler is called as every caller, through the router but without a connection.

use super::access::{Caller, Gate, Known, Need, Reach, Role};
use super::clock::since_boot;
use super::config::Desk;
use super::northbound::Northbound;
use super::remote_api::{RemoteCommand, RemoteKind, RemoteRequest, Settled, remote_api};
use super::remote_order::RemoteOrder;
use super::route::{BASE, Route};
use super::routes::{Audience, TOP, all, handlers};
use super::site::Site;
use super::{ops, ws};
use axum::body::{Body, to_bytes};
use axum::http::{Request, StatusCode};
use axum::{Extension, Router};
use hyper::service::Service as _;
use hyper_util::service::TowerToHyperService;
use railbus_site::{Config, Rights, Service};
use railbus_words::Lang;
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;

const HEAD: &str = "| route | who | limited to points |\n|---|---|---|\n";
const TEXT: &str = r#"
[line.main]
port = "/dev/ttyS99"
[module.pump]
line = "main"
model = "eda9060a"
address = 1
[module.oven]
line = "main"
model = "erc8"
address = 3
[group.heat]
members = ["oven.k1"]
[scene.heat]
steps = [{ set = "oven.k1", to = true }]
"#;
/// Requests for somebody else's points to each route that checks points.
const OF_OTHERS: [(&str, &str, &str); 11] = [
    ("PUT", "/points/oven/k1", r#"{"value":true}"#),
    ("POST", "/points/oven/k1/toggle", ""),
    ("POST", "/points/oven/k1/pulse", r#"{"ms":100}"#),
    (
        "PUT",
        "/points/oven/k1/lease",
        r#"{"value":true,"ttl_ms":1000}"#,
    ),
    ("DELETE", "/points/oven/k1/lease", ""),
    ("PUT", "/modules/oven/outputs", r#"{"set":{"k1":true}}"#),
    (
        "POST",
        "/batch",
        r#"{"set":[{"path":"oven.k1","value":true}]}"#,
    ),
    ("POST", "/groups/heat/set", r#"{"value":true}"#),
    ("POST", "/scenes/heat/run", ""),
    ("PATCH", "/config/points/oven/k1", r#"{"name":"mine"}"#),
    (
        "POST",
        "/lines/main/send",
        r#"{"protocol":"rtu","bytes":"03 05 00 3C FF 00","complete":true,"confirm":["output"]}"#,
    ),
];

fn routes() -> impl Iterator<Item = (&'static str, &'static Route)> {
    let api = all().map(|route| (BASE, route));
    api.chain(TOP.iter().map(|route| ("", route)))
}

fn table() -> String {
    let mut table = HEAD.to_owned();
    for (_, route) in routes() {
        let who = match route.need {
            Need::Nothing => "anybody",
            Need::Role(role) => role.name(),
            Need::Owner => "owner",
        };
        let limited = match (route.need, route.reach) {
            // The owner, over the socket, is not limited.
            (Need::Owner, _) => "–",
            (_, Reach::Harmless) => "as others",
            (_, Reach::Points) => "their points",
            (_, Reach::Beyond) => "no",
        };
        let _ = writeln!(
            table,
            "| `{} {}` | {who} | {limited} |",
            route.method, route.path
        );
    }
    table
}

/// `UPDATE=1` rewrites it.
#[test]
fn the_table_of_rights_is_that_of_the_routes() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../SECURITY.md");
    let text = std::fs::read_to_string(&file).unwrap();
    let (before, rest) = text.split_once(HEAD).expect("a table");
    let after = rest.split_once("\n\n").map_or("", |(_, after)| after);
    let wanted = format!("{before}{}\n{after}", table());
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&file, wanted).unwrap();
    } else {
        assert!(text == wanted, "UPDATE=1 writes the table anew");
    }
}

/// A site in a temporary folder, none of whose lines can be opened.
pub(crate) struct Here {
    pub(crate) site: Site,
    pub(crate) folder: PathBuf,
    _stop: watch::Sender<bool>,
}

impl Here {
    fn new(name: &str) -> Here {
        Here::with(name, TEXT)
    }

    /// The same with this configuration.
    pub(crate) fn with(name: &str, text: &str) -> Here {
        let unique = format!("railbus-rights-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("railbus.toml");
        std::fs::write(&file, text).unwrap();
        let config = Config::parse(text).unwrap();
        let desk = Arc::new(Desk::new(&file, &folder, &config));
        let service = Service::start_in(config, &folder).unwrap();
        let access = Gate::open(&folder).unwrap_or_else(|problem| panic!("{problem:?}"));
        let access = Arc::new(access);
        let northbound = Northbound::new("here", &folder, &service, &access);
        northbound.run(desk.changes());
        let (stop, stopped) = watch::channel(false);
        let site = Site {
            service,
            lang: Lang::En,
            demo: false,
            simulated: Arc::default(),
            stop: stopped,
            sockets: ws::SocketLimit::new(),
            printer: Arc::default(),
            ops: Arc::new(ops::Ops::default()),
            desk,
            northbound,
            access,
            origin: "http://127.0.0.1:7485".into(),
            tls: None,
        };
        Here {
            site,
            folder,
            _stop: stop,
        }
    }

    fn router(&self, caller: Caller) -> Router {
        let is_owner = caller.known == Known::Owner;
        let audience = match is_owner {
            true => Audience::Owner,
            false => Audience::Network,
        };
        handlers(self.site.clone(), audience).layer(Extension(caller))
    }
}

impl Drop for Here {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// All kinds of callers: unauthenticated, each role, each role limited to `pump`, and the owner.
fn callers() -> Vec<Caller> {
    let with = |role: Option<Role>, points: &[&str]| Caller {
        name: "token:x".to_owned(),
        id: "token:x".to_owned(),
        role,
        via: "http".to_owned(),
        points: points.iter().map(|&points| points.to_owned()).collect(),
        known: match role {
            Some(_) => Known::Token("x".to_owned()),
            None => Known::Not,
        },
    };
    let mut all = vec![with(None, &[]), Caller::owner()];
    for role in Role::ALL {
        all.extend([with(Some(role), &[]), with(Some(role), &["pump.*"])]);
    }
    all
}

/// Status and code of an answer. Streams are dropped.
async fn ask(router: Router, method: &str, path: &str, body: &str) -> (StatusCode, String) {
    let request = Request::builder().method(method).uri(path);
    answered(router, request.body(Body::from(body.to_owned())).unwrap()).await
}

async fn answered(router: Router, request: Request<Body>) -> (StatusCode, String) {
    let Ok(answer) = TowerToHyperService::new(router).call(request).await;
    let status = answer.status();
    let text = match status.is_success() {
        true => return (status, String::new()),
        false => to_bytes(Body::new(answer.into_body()), 1 << 20)
            .await
            .unwrap(),
    };
    let problem: Value = serde_json::from_slice(&text).unwrap_or_default();
    (
        status,
        problem["code"].as_str().unwrap_or_default().to_owned(),
    )
}

/// The code with which a caller must be refused; none if it may use the route.
fn refusal(route: &Route, caller: &Caller) -> Option<&'static str> {
    match (route.need, caller.role) {
        (Need::Owner, _) if caller.known != Known::Owner => Some("E0110"),
        (Need::Owner | Need::Nothing, _) => None,
        (Need::Role(_), None) => Some("E0902"),
        (Need::Role(least), Some(role)) if role < least => Some("E0905"),
        _ if caller.is_limited() && route.reach == Reach::Beyond => Some("E0922"),
        _ => None,
    }
}

/// A path with names that do not exist.
fn filled(path: &str) -> String {
    let parts = path.split('/').map(|part| match part.starts_with('{') {
        true => "nothing",
        false => part,
    });
    parts.collect::<Vec<_>>().join("/")
}

#[tokio::test]
async fn every_handler_is_behind_its_rule_for_everybody() {
    let here = Here::new("walk");
    let mut asked = 0;
    for caller in callers() {
        let router = here.router(caller.clone());
        for (base, route) in routes() {
            let path = format!("{base}{}", filled(route.path));
            let (status, code) = ask(router.clone(), route.method, &path, "").await;
            let what = format!("{} {path} as {caller:?}: {status} {code}", route.method);
            match refusal(route, &caller) {
                Some(wanted) => assert_eq!(code, wanted, "{what}"),
                None => assert!(
                    !["E0902", "E0905", "E0922"].contains(&code.as_str())
                        && status != StatusCode::METHOD_NOT_ALLOWED,
                    "{what}"
                ),
            }
            asked += 1;
        }
    }
    assert!(asked > 900, "{asked}");
    assert_eq!(
        std::fs::read_to_string(here.folder.join("railbus.toml")).unwrap(),
        TEXT
    );
}

/// Remote callers can use the routes of a viewer that only read and are no streams.
#[tokio::test]
async fn remote_callers_read_as_viewers_and_do_nothing_else() {
    let here = Here::new("elsewhere");
    let (api, calls) = remote_api();
    let handlers = handlers(here.site.clone(), Audience::Remote);
    tokio::spawn(calls.serve(handlers, here.site.stop.clone()));
    let (mut answered, mut streams) = (0, 0);
    for route in all() {
        let path = format!("{BASE}{}", filled(route.path));
        let asked = RemoteRequest {
            method: route.method.to_owned(),
            path: path.clone(),
            user: "li".to_owned(),
            language: String::new(),
            command: None,
        };
        let permit = api.permit(RemoteKind::Read).unwrap();
        let answer = api.ask("hq", asked, permit).await.unwrap();
        let problem: Value = serde_json::from_slice(&answer.body).unwrap_or_default();
        let code = problem["code"].as_str().unwrap_or_default();
        streams += u8::from(route.is_stream);
        let wanted = match route.need {
            _ if route.method != "GET" => "E0937",
            Need::Owner => "E0110",
            _ if !route.is_remote() => "E0937",
            Need::Role(least) if least > Role::Viewer => "E0905",
            _ => {
                // E0168: one that does not end.
                let is_refused = ["E0168", "E0902", "E0905", "E0937"].contains(&code);
                assert!(!is_refused && answer.status != 405, "{path}: {code}");
                answered += 1;
                continue;
            }
        };
        assert_eq!(code, wanted, "{} {path}", route.method);
    }
    assert!(answered > 20, "{answered}");
    assert_eq!(streams, 5);
}

/// What switches outputs and has a key can be given from afar, with the rights of the outlet; and
/// nothing else.
#[tokio::test]
async fn remote_callers_give_commands_and_change_nothing_else() {
    let here = Here::new("commands");
    let (api, calls) = remote_api();
    let handlers = handlers(here.site.clone(), Audience::Remote);
    tokio::spawn(calls.serve(handlers, here.site.stop.clone()));
    let mut commands = 0;
    for (role, points) in [
        (Role::Viewer, &[][..]),
        (Role::Operator, &["oven.k1".to_owned()]),
        (Role::Operator, &["*".to_owned()]),
    ] {
        for (at, route) in all().enumerate() {
            let path = format!("{BASE}{}", filled(route.path));
            let order = RemoteOrder {
                by: Some(since_boot() + Duration::from_secs(60)),
                tell: false,
                given: None,
            };
            let rights = Rights {
                role,
                points: points.into(),
            };
            let asked = RemoteRequest {
                method: route.method.to_owned(),
                path: path.clone(),
                user: "li".to_owned(),
                language: String::new(),
                command: Some(RemoteCommand {
                    rights,
                    key: format!("c{at}"),
                    body: Vec::new(),
                    order,
                }),
            };
            let permit = api.permit(RemoteKind::Command).unwrap();
            let answer = api.ask("hq", asked, permit).await.unwrap();
            let problem: Value = serde_json::from_slice(&answer.body).unwrap_or_default();
            let code = problem["code"].as_str().unwrap_or_default();
            let what = format!("{} {path} as {role:?}: {code}", route.method);
            assert_eq!(answer.settled, Settled::Ended, "{what}");
            let wanted = match route.need {
                _ if !["PUT", "POST"].contains(&route.method) => "E0937",
                Need::Owner => "E0110",
                // Some are refused for their role or points already.
                _ if !route.is_command => {
                    assert!(
                        ["E0905", "E0922", "E0937", "E0941"].contains(&code),
                        "{what}"
                    );
                    continue;
                }
                _ if role == Role::Viewer => "E0941",
                _ => {
                    commands += 1;
                    assert!(!["E0905", "E0937", "E0941"].contains(&code), "{what}");
                    assert!(answer.status != 405, "{what}");
                    continue;
                }
            };
            assert_eq!(code, wanted, "{what}");
        }
    }
    // Outputs, one output, over, for a time, several, a group, a scene.
    assert_eq!(commands, 2 * 7);
    let all_have_points = all().filter(|route| route.is_command);
    assert!(
        all_have_points
            .into_iter()
            .all(|route| { route.need == Need::OPERATOR && route.reach == Reach::Points })
    );
}

/// What came of a command is said, also in words, and where its output is not to be switched any
/// more.
#[tokio::test]
async fn what_came_of_a_remote_command_is_told_in_any_language() {
    let here = Here::new("words");
    let (api, calls) = remote_api();
    let handlers = handlers(here.site.clone(), Audience::Remote);
    tokio::spawn(calls.serve(handlers, here.site.stop.clone()));
    let own = Instant::now();
    let over = Some(since_boot().saturating_sub(Duration::from_secs(1)));
    let coming = Some(since_boot() + Duration::from_secs(60));
    for language in ["", "zh", "en"] {
        for (point, points) in [
            ("oven/k1", &["oven", "nothing"][..]),
            ("nothing/k1", &["oven", "nothing"]),
            ("pump/do0", &["oven", "nothing"]),
            // Nothing at all any more.
            ("pump/do0", &[""]),
        ] {
            for (by, tell, given, wanted) in [
                (over, false, Some(own), Settled::Never),
                (over, true, Some(own), Settled::Never),
                (over, true, None, Settled::Lost),
                (None, true, None, Settled::Lost),
                (coming, true, Some(own), Settled::Later),
                (coming, true, None, Settled::Later),
            ] {
                let asked = RemoteRequest {
                    method: "PUT".to_owned(),
                    path: format!("{BASE}/points/{point}"),
                    user: "li".to_owned(),
                    language: language.to_owned(),
                    command: Some(RemoteCommand {
                        rights: Rights {
                            role: Role::Operator,
                            points: points.iter().map(|&point| point.to_owned()).collect(),
                        },
                        key: "c1".to_owned(),
                        body: b"{\"value\":true}".to_vec(),
                        order: RemoteOrder { by, tell, given },
                    }),
                };
                let permit = api.permit(RemoteKind::Tell).unwrap();
                let answer = api.ask("hq", asked, permit).await.unwrap();
                let what = format!("{language} {point} {by:?} {tell} {given:?}");
                // Without rights it was refused at once.
                let is_refused = point == "pump/do0" && !tell;
                let wanted = if is_refused { Settled::Ended } else { wanted };
                assert_eq!(answer.settled, wanted, "{what}");
            }
        }
    }
}

#[tokio::test]
async fn who_is_limited_is_held_to_his_points_by_each_handler_that_says_so() {
    let here = Here::new("points");
    let held = routes().filter(|(_, route)| route.reach == Reach::Points);
    assert_eq!(held.count(), OF_OTHERS.len(), "each is asked below");
    for caller in callers().into_iter().filter(Caller::is_limited) {
        for (method, path, body) in OF_OTHERS {
            let path = format!("{BASE}{path}");
            let (_, code) = ask(here.router(caller.clone()), method, &path, body).await;
            let what = format!("{method} {path} as {caller:?}");
            assert!(
                ["E0905", "E0906"].contains(&code.as_str()),
                "{what}: {code}"
            );
            let is_engineer = caller.role >= Some(Role::Engineer);
            assert!(!is_engineer || code == "E0906", "{what}: {code}");
        }
    }
    assert_eq!(
        std::fs::read_to_string(here.folder.join("railbus.toml")).unwrap(),
        TEXT
    );
}

/// A caller that has lost its permission does not learn the result of an earlier request, either.
#[tokio::test]
async fn an_answer_under_a_key_is_told_to_who_may_ask_for_it_only() {
    let here = Here::new("key");
    let [all, limited] = [&[][..], &["pump.*".to_owned()]].map(|points| Caller {
        name: "li".to_owned(),
        id: "li".to_owned(),
        role: Some(Role::Operator),
        via: "http".to_owned(),
        points: points.to_vec().into(),
        known: Known::Token("x".to_owned()),
    });
    let asked = OF_OTHERS.iter().filter(|(method, path, _)| {
        // Requests of engineers have no key, or nothing to send.
        *method != "PATCH" && !path.ends_with("/send")
    });
    for (number, (method, path, body)) in asked.enumerate() {
        let ask = async |caller: &Caller| {
            let request = Request::builder()
                .method(*method)
                .uri(format!("{BASE}{path}"))
                .header("idempotency-key", number.to_string())
                .body(Body::from(*body));
            answered(here.router(caller.clone()), request.unwrap())
                .await
                .1
        };
        let first = ask(&all).await;
        assert_ne!(first, "E0906", "{path}");
        assert_eq!(ask(&limited).await, "E0906", "{path}");
        assert_eq!(ask(&all).await, first, "{path}");
    }
}
