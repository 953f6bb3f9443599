//! Who may what at the centre.

use super::*;
use crate::access::{AccountsPlace, Gate, Peer, desk};
use axum::http::Request;
use http_body_util::BodyExt as _;
use hyper::service::Service as _;
use hyper_util::service::TowerToHyperService;
use railbus_api::fleet::{FleetCommandEnd, FleetConfigPhase, FleetConfigState, FleetPresence};
use railbus_fleet::bulk::BulkTold;
use railbus_fleet::desired::CONFIG_TEXT_MAX;
use railbus_fleet::message::ApiAnswer;
use serde_json::{Value, json};
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::time::Duration;

const SITE: &str = "/s/plant7/api/v1/points/oven/k1";

/// A centre whose driver notes the users of what it is asked.
struct Here {
    accounts: AccountsApi,
    calls: Calls,
    users: mpsc::UnboundedReceiver<String>,
    folder: PathBuf,
}

impl Here {
    /// What was asked of the driver, by whom.
    fn asked(&mut self) -> Vec<String> {
        std::iter::from_fn(|| self.users.try_recv().ok()).collect()
    }

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
            place: AccountsPlace::Centre,
            origin: "http://127.0.0.1:7486".into(),
            is_tls: false,
        };
        let (calls, mut asked) = mpsc::channel(8);
        let (told, users) = mpsc::unbounded_channel();
        tokio::spawn(async move {
            while let Some(call) = asked.recv().await {
                match call {
                    HubCall::Commands(to) => {
                        let (schema, open, commands) = (1, 0, vec![refused()]);
                        let _ = to.send(FleetCommands {
                            schema,
                            open,
                            commands,
                            bulk: Vec::new(),
                        });
                    }
                    HubCall::Command(given, to) => {
                        let intent = given.intent(given.given, None, 0);
                        let _ = told.send(intent.map_or_else(|_| String::new(), |it| it.user));
                        let _ = to.send(Err(command::offline("plant7")));
                    }
                    HubCall::Way(site, _, to) => {
                        let _ = to.send(Err(command::offline(&site)));
                    }
                    HubCall::Remove(site, to) => {
                        let problem = Problem::new(codes::SITE_THERE).with("name", site);
                        let _ = to.send(Err(problem));
                    }
                    HubCall::Groups(site, groups, to) => {
                        let _ = told.send(format!("{site}: {}", groups.join(" ")));
                        let problem = Problem::new(codes::SITE_CHANGING).with("name", site);
                        let _ = to.send(Err(problem));
                    }
                    HubCall::Config(site, to) => {
                        let _ = to.send(Ok(taken_back(site)));
                    }
                    HubCall::SetConfig(given, to) => {
                        let _ = told.send(format!("{} for {}", given.user, given.site));
                        let _ = to.send(Err(Problem::new(codes::NO_CONFIG_KEY)));
                    }
                    HubCall::GiveBulk(given, to) => {
                        let (who, sites) = (given.order.user, given.order.sites.join(" "));
                        let _ = told.send(format!("{who}: {sites}"));
                        let _ = to.send(BulkTold::Known);
                    }
                    HubCall::StopBulk(id, who, to) => {
                        let _ = told.send(format!("{who} stops {id}"));
                        let _ = to.send(BulkTold::NoSuch);
                    }
                    HubCall::Bulk(_, _, to) => {
                        let _ = to.send(Err(Problem::new(codes::NO_SUCH_BULK)));
                    }
                    HubCall::Preview(..) | HubCall::Sites(..) | HubCall::Site(..) => {}
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

    /// An answer over TCP, or over the socket; with further headers of the request.
    async fn send(
        &self,
        is_tcp: bool,
        (method, path): (&str, &str),
        headers: &[(&str, &str)],
        body: &str,
    ) -> Response<Body> {
        let router = routes_of(self, is_tcp.then(Here::front));
        let mut request = Request::builder()
            .method(method)
            .uri(path)
            .header("host", "127.0.0.1:7486");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let mut request = request.body(Body::from(body.to_owned())).unwrap();
        let peer = Peer(IpAddr::V4(Ipv4Addr::LOCALHOST));
        request.extensions_mut().insert(peer);
        let Ok(answer) = TowerToHyperService::new(router).call(request).await;
        answer
    }

    /// Status and code of an answer over TCP; over the socket without a token.
    async fn ask(&self, token: Option<&str>, method: &str, path: &str) -> (StatusCode, String) {
        let bearer = token.map(|token| format!("Bearer {token}"));
        let bearer = bearer.as_deref().filter(|bearer| *bearer != "Bearer ");
        let headers: Vec<_> = bearer
            .map(|bearer| ("authorization", bearer))
            .into_iter()
            .collect();
        let body = "{\"value\":true}";
        let answer = self
            .send(token.is_some(), (method, path), &headers, body)
            .await;
        let status = answer.status();
        let body = json_of(answer).await;
        (status, body["code"].as_str().unwrap_or_default().to_owned())
    }
}

async fn json_of(answer: Response<Body>) -> Value {
    let body = answer.into_body().collect().await.unwrap().to_bytes();
    serde_json::from_slice(&body).unwrap_or_default()
}

/// A command that a site has refused.
fn refused() -> FleetCommand {
    let text = str::to_owned;
    FleetCommand {
        site: text("plant7"),
        id: text("a-1"),
        user: text("li"),
        at: text("2026-11-29T08:00:00Z"),
        method: text("PUT"),
        path: text("/api/v1/points/oven/k1"),
        body: String::new(),
        end: FleetCommandEnd {
            how: Some(text("answered")),
            code: Some(text("E0906")),
            ..FleetCommandEnd::default()
        },
    }
}

/// A configuration that a site has taken back.
fn taken_back(site: String) -> FleetConfig {
    FleetConfig {
        schema: 1,
        site,
        presence: FleetPresence::Online,
        wanted: None,
        state: Some(FleetConfigState {
            phase: FleetConfigPhase::RolledBack,
            version: Some(2),
            kept: None,
            hash: String::new(),
            changed_at_site: false,
            reason: None,
            problem: Some(Problem::new(codes::CONFIG_TAKEN_BACK)),
            heard_ms: 0,
        }),
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
        (
            "/fleet/v1/sites/plant7",
            "DELETE",
            ["E0902", "E0905", "E0905", "E0905", "E0179"],
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
        ("/api/v1/setup", "POST", ["E0806"; 5]),
        ("/fleet/v1/openapi.json", "GET", [""; 5]),
        (
            "/fleet/v1/sites?state=away",
            "GET",
            ["E0902", "E0806", "E0806", "E0806", "E0806"],
        ),
        ("/s/plant7/api/v1/session", "GET", [""; 5]),
        ("/s/plant7/api/v1/session", "PUT", ["E0110"; 5]),
        (
            "/s/plant7/api/v1/users",
            "POST",
            ["E0902", "E0905", "E0922", "E0937", "E0937"],
        ),
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
    let removes = here.ask(None, "DELETE", "/fleet/v1/sites/plant7").await;
    assert_eq!(removes, (StatusCode::CONFLICT, "E0179".to_owned()));
    assert_eq!(here.ask(None, "PUT", SITE).await.1, "E0168");
    assert_eq!(here.users.recv().await.as_deref(), Some("owner"));
}

#[tokio::test]
async fn an_engineer_sets_the_groups_of_a_site() {
    let mut here = Here::new("groups");
    let path = "/fleet/v1/sites/plant7/groups";
    let mut codes = Vec::new();
    for (name, role, points) in [
        ("ops", "operator", &[][..]),
        ("few", "engineer", &["oven.*"]),
        ("eng", "engineer", &[]),
    ] {
        let bearer = format!("Bearer {}", here.token(name, role, points).await);
        let headers = [("authorization", &*bearer)];
        let body = r#"{"groups":["north","hall-9"]}"#;
        let told = here.send(true, ("PUT", path), &headers, body).await;
        codes.push(json_of(told).await["code"].clone());
    }
    assert_eq!(codes, ["E0905", "E0922", "E0184"]);
    for body in ["", "[]", "{}", r#"{"groups":"north"}"#, r#"{"groups":[1]}"#] {
        let told = here.send(false, ("PUT", path), &[], body).await;
        assert_eq!(json_of(told).await["code"], "E0806", "{body}");
    }
    assert_eq!(here.asked(), ["plant7: north hall-9"]);
}

#[tokio::test]
async fn an_engineer_configures_a_site() {
    let mut here = Here::new("config");
    let path = "/fleet/v1/sites/plant7/config";
    let at_site = "/fleet/v1/sites/plant7/config/text";
    let good = json!({ "text": "[line.hall]\nport = \"/dev/ttyS1\"\n" }).to_string();
    let mut codes = Vec::new();
    for (name, role, points) in [
        ("ops", "operator", &[][..]),
        ("few", "engineer", &["oven.*"]),
        ("eng", "engineer", &[]),
    ] {
        let bearer = format!("Bearer {}", here.token(name, role, points).await);
        let headers = [("authorization", &*bearer)];
        for (method, path, body) in [
            ("GET", path, ""),
            ("GET", at_site, ""),
            ("PUT", path, &good),
        ] {
            let told = here.send(true, (method, path), &headers, body).await;
            codes.push(json_of(told).await["code"].clone());
        }
    }
    let none = Value::Null;
    assert_eq!(codes[..3], ["E0905", "E0905", "E0905"]);
    // Who is limited to some points may look.
    assert_eq!(codes[3..6], [none.clone(), json!("E0168"), json!("E0922")]);
    assert_eq!(codes[6..], [none, json!("E0168"), json!("E0946")]);
    // Nothing else gets as far as the centre's key.
    let longest = "\u{1}".repeat(CONFIG_TEXT_MAX);
    let over = "#".repeat(CONFIG_TEXT_MAX + 1);
    for (site, body, code) in [
        ("plant7", String::new(), "E0806"),
        ("plant7", "{}".to_owned(), "E0806"),
        ("plant7", r#"{"text":1}"#.to_owned(), "E0806"),
        ("plant7", r#"{"text":"","seen":-1}"#.to_owned(), "E0806"),
        (
            "plant7",
            r#"{"text":"","replaces":"00"}"#.to_owned(),
            "E0806",
        ),
        ("Plant7", r#"{"text":""}"#.to_owned(), "E0806"),
        ("plant7", json!({ "text": over }).to_string(), "E0806"),
        // As long as JSON can make it, and no configuration.
        ("plant7", json!({ "text": longest }).to_string(), "E0810"),
        ("plant7", r#"{"text":"[outlet.a]\n"}"#.to_owned(), "E0947"),
    ] {
        let path = format!("/fleet/v1/sites/{site}/config");
        let told = here.send(false, ("PUT", &path), &[], &body).await;
        let told = json_of(told).await;
        assert_eq!(told["code"], code, "{site}: {}", told);
    }
    assert_eq!(here.asked(), ["token:eng for plant7"]);
}

#[tokio::test]
async fn why_a_site_took_a_configuration_back_is_told_in_the_language_of_the_request() {
    let here = Here::new("taken-back");
    let path = "/fleet/v1/sites/plant7/config";
    let mut details = Vec::new();
    for headers in [
        &[][..],
        &[("accept-language", "en")],
        &[("accept-language", "zh")],
    ] {
        let told = json_of(here.send(false, ("GET", path), headers, "").await).await;
        assert_eq!(told["state"]["phase"], "rolled_back");
        details.push(told["state"]["problem"]["detail"].clone());
    }
    let page = Code::from_name("E0944").unwrap().page();
    assert_eq!(details[0], Value::Null);
    assert_eq!(details[1..], [page.title(Lang::En), page.title(Lang::Zh)]);
}

#[tokio::test]
async fn an_operator_commands_many_sites() {
    let mut here = Here::new("bulk");
    let many: Vec<String> = (0..10_000).map(|at| format!("plant-{at:06}")).collect();
    let few = vec!["a".to_owned(), "b".to_owned()];
    let body = |sites: &[String]| {
        let body = json!({ "value": true });
        json!({ "sites": sites, "method": "PUT", "path": "/api/v1/points/oven/k1", "body": body })
            .to_string()
    };
    let (path, mut codes) = ("/fleet/v1/commands", Vec::new());
    for (name, role, points) in [
        ("seer", "viewer", &[][..]),
        ("some", "operator", &["oven.*"]),
        ("ops", "operator", &[]),
    ] {
        let bearer = format!("Bearer {}", here.token(name, role, points).await);
        let headers = [("authorization", &*bearer)];
        for (path, body) in [
            (path, body(&few)),
            ("/fleet/v1/commands/b1/stop", String::new()),
        ] {
            let told = here.send(true, ("POST", path), &headers, &body).await;
            codes.push(json_of(told).await["code"].clone());
        }
        let told = here
            .send(true, ("GET", "/fleet/v1/commands/b1"), &headers, "")
            .await;
        codes.push(json_of(told).await["code"].clone());
    }
    let refused = ["E0905", "E0905", "E0837", "E0922", "E0922", "E0837"];
    assert_eq!(codes[..6], refused);
    assert_eq!(codes[6..], ["E0837", "E0837", "E0837"]);
    // The longest list fits, and what is none is refused.
    let told = here.send(false, ("POST", path), &[], &body(&many)).await;
    assert_eq!(json_of(told).await["code"], "E0837");
    for body in ["", "{}", r#"{"sites":"a"}"#, &body(&[])] {
        let told = here.send(false, ("POST", path), &[], body).await;
        assert_eq!(json_of(told).await["code"], "E0806", "{body}");
    }
    let mut asked = Vec::new();
    while let Ok(told) = here.users.try_recv() {
        asked.push(told.chars().take(20).collect::<String>());
    }
    assert_eq!(
        asked,
        [
            "token:ops: a b",
            "token:ops stops b1",
            "owner: plant-000000 "
        ]
    );
}

#[tokio::test]
async fn users_of_the_centre_log_in_at_the_pages_of_a_site() {
    let here = Here::new("far");
    let user = json!({ "name": "li", "role": "admin", "password": "a long password" });
    let added = desk::add_user(&here.accounts.access, user.to_string().as_bytes()).await;
    added.unwrap_or_else(|problem| panic!("{problem:?}"));
    let far = |path| ("POST", path);
    let login = json!({ "name": "li", "password": "a long password" }).to_string();
    let begun = here
        .send(true, far("/s/plant7/api/v1/login"), &[], &login)
        .await;
    assert_eq!(begun.status(), StatusCode::OK);
    let cookie = begun.headers()["set-cookie"].to_str().unwrap().to_owned();
    assert!(
        cookie.contains("Path=/") && cookie.contains("HttpOnly"),
        "{cookie}"
    );
    let cookie = cookie.split(';').next().unwrap();
    let told = json_of(begun).await;
    assert_eq!(
        (&told["site"], &told["user"]["role"]),
        (&json!("plant7"), &json!("operator"))
    );
    let csrf = told["csrf"].as_str().unwrap();
    // It is one session: at another site, and at the centre, where the role is not less.
    for (path, site, role, is_centre) in [
        ("/s/plant8/api/v1/session", "plant8", "operator", false),
        ("/api/v1/session", "acme", "admin", true),
    ] {
        let told = here
            .send(true, ("GET", path), &[("cookie", cookie)], "")
            .await;
        let told = json_of(told).await;
        assert_eq!(
            (&told["site"], &told["user"]["role"]),
            (&json!(site), &json!(role))
        );
        assert_eq!(
            (&told["csrf"], &told["setup"]),
            (&json!(csrf), &json!(false))
        );
        assert_eq!(told["centre"], is_centre);
    }
    // A page of another site knows no token.
    let logout = far("/s/plant7/api/v1/logout");
    let refused = here.send(true, logout, &[("cookie", cookie)], "").await;
    assert_eq!(json_of(refused).await["code"], "E0908");
    let ours = [("cookie", cookie), ("x-csrf-token", csrf)];
    let ended = here.send(true, logout, &ours, "").await;
    assert_eq!(ended.status(), StatusCode::OK);
    let told = here
        .send(true, ("GET", "/api/v1/session"), &[("cookie", cookie)], "")
        .await;
    assert_eq!(json_of(told).await["user"], Value::Null);
}

#[tokio::test]
async fn what_an_account_may_at_a_site_is_told_there() {
    let here = Here::new("told");
    for (name, role, points, at_site) in [
        ("look", "viewer", &[][..], "viewer"),
        ("ops", "operator", &[], "operator"),
        ("root", "admin", &[], "operator"),
        ("few", "admin", &["oven.*"], "viewer"),
    ] {
        let bearer = format!("Bearer {}", here.token(name, role, points).await);
        let headers = [("authorization", &*bearer)];
        for (path, wanted) in [
            ("/s/plant7/api/v1/session", at_site),
            ("/api/v1/session", role),
        ] {
            let told = here.send(true, ("GET", path), &headers, "").await;
            assert_eq!(json_of(told).await["user"]["role"], wanted, "{name} {path}");
        }
    }
    // There is no user yet; his owner is no less than others.
    let told = here
        .send(true, ("GET", "/s/plant7/api/v1/session"), &[], "")
        .await;
    let told = json_of(told).await;
    assert_eq!(
        (&told["setup"], &told["user"]),
        (&json!(true), &Value::Null)
    );
}

#[tokio::test]
async fn what_is_no_api_is_a_page_over_tcp_only() {
    let here = Here::new("pages");
    for (method, path, is_page) in [
        ("GET", "/", true),
        ("HEAD", "/sites", true),
        ("GET", "/s/plant7", true),
        ("GET", "/s/plant7/", true),
        ("GET", "/s/plant7/module/oven", true),
        ("POST", "/", false),
        ("GET", "/s/plant7/api", false),
        ("GET", "/s/plant7/api/", false),
        ("GET", "/fleet/v1/none", false),
        ("GET", "/fleet", false),
        ("GET", "/api/v1/none", false),
    ] {
        for is_tcp in [true, false] {
            let answer = here.send(is_tcp, (method, path), &[], "").await;
            let kind = answer.headers()["content-type"]
                .to_str()
                .unwrap()
                .to_owned();
            let wanted = match is_page && is_tcp {
                true => (StatusCode::OK, "text/html; charset=utf-8"),
                false => (StatusCode::NOT_FOUND, "application/problem+json"),
            };
            assert_eq!((answer.status(), &*kind), wanted, "{method} {path}");
            assert!(answer.headers().contains_key("content-security-policy"));
        }
    }
}

#[tokio::test]
async fn the_centre_says_why_in_the_language_of_the_request() {
    let here = Here::new("words");
    let bearer = format!("Bearer {}", here.token("ops", "operator", &[]).await);
    for path in [
        SITE,
        "/fleet/v1/sites/plant7",
        "/fleet/v1/none",
        "/s/plant7/api",
        "/api/v1/none",
    ] {
        for (lang, is_chinese) in [("zh", true), ("en", false)] {
            let headers = [("authorization", &*bearer), ("accept-language", lang)];
            let told = here.send(true, ("GET", path), &headers, "").await;
            let told = json_of(told).await;
            let detail = told["detail"].as_str().unwrap_or_default();
            assert!(!detail.is_empty(), "{path}: {told}");
            let has_some = detail
                .chars()
                .any(|letter| ('\u{4e00}'..='\u{9fff}').contains(&letter));
            assert_eq!(has_some, is_chinese, "{path}: {detail}");
        }
        let told = here
            .send(true, ("GET", path), &[("authorization", &*bearer)], "")
            .await;
        assert_eq!(json_of(told).await["detail"], Value::Null, "{path}");
    }
}

#[tokio::test]
async fn what_a_site_answers_keeps_its_own_words() {
    let own = "{\"type\":\"about:blank\",\"title\":\"no such point\",\"status\":404,\
               \"code\":\"E0802\",\"may_have_acted\":false,\"detail\":\"its own words\"}";
    let said = move || {
        let answer = ApiAnswer {
            status: 404,
            content_type: "application/problem+json".to_owned(),
            body: own.as_bytes().to_vec(),
            ..ApiAnswer::default()
        };
        site_api::response(answer, Duration::ZERO).unwrap()
    };
    let router = Router::new()
        .route("/", get(async move || said()))
        .layer(from_fn_with_state(Lang::Zh, localize::problems));
    let request = Request::builder().uri("/").header("accept-language", "zh");
    let request = request.body(Body::empty()).unwrap();
    let Ok(answer) = TowerToHyperService::new(router).call(request).await;
    let body = answer.into_body().collect().await.unwrap().to_bytes();
    assert_eq!(body, own);
}

#[tokio::test]
async fn the_first_user_comes_by_a_link() {
    let here = Here::new("link");
    let made = here
        .send(false, ("POST", "/api/v1/setup-link"), &[], "")
        .await;
    let made = json_of(made).await;
    let link = made["setup_link"].as_str().unwrap();
    let key = link.strip_prefix("http://127.0.0.1:7486/setup#k=").unwrap();
    let setup = ("POST", "/api/v1/setup");
    let wanted =
        |key: &str| json!({ "key": key, "name": "li", "password": "a long password" }).to_string();
    let wrong = here.send(true, setup, &[], &wanted("AAAA")).await;
    assert_eq!(json_of(wrong).await["code"], "E0909");
    let first = here.send(true, setup, &[], &wanted(key)).await;
    assert_eq!(first.status(), StatusCode::OK);
    assert_eq!(json_of(first).await["user"]["role"], "admin");
    // Once only.
    let again = here.send(true, setup, &[], &wanted(key)).await;
    assert_eq!(again.status(), StatusCode::CONFLICT);
    let link = here
        .send(false, ("POST", "/api/v1/setup-link"), &[], "")
        .await;
    assert_eq!(link.status(), StatusCode::CONFLICT);
}

#[tokio::test]
async fn the_code_of_a_command_has_a_title_in_the_language_of_the_request() {
    let here = Here::new("titles");
    let commands = ("GET", "/fleet/v1/commands");
    let mut titles = Vec::new();
    for headers in [
        &[][..],
        &[("accept-language", "en")],
        &[("accept-language", "zh")],
    ] {
        let told = json_of(here.send(false, commands, headers, "").await).await;
        assert_eq!(told["commands"][0]["code"], "E0906");
        titles.push(told["commands"][0]["title"].clone());
    }
    assert_eq!(titles[0], Value::Null);
    let page = Code::from_name("E0906").unwrap().page();
    assert_eq!(titles[1..], [page.title(Lang::En), page.title(Lang::Zh)]);
}
