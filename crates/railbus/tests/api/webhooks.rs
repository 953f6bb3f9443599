//! Webhooks as operators of a site see them, and the events of their changes.

use crate::daemon::Daemon;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpListener;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

const SECRET: &str = "canary of more than sixteen";
const PATIENCE: Duration = Duration::from_secs(60);

/// A receiver that accepts everything, and returns head and body of each request.
fn receiver() -> (String, Receiver<(String, Value)>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let url = format!("http://{}/hook", listener.local_addr().expect("an address"));
    let (heard, requests) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.expect("a connection");
            let mut text = Vec::new();
            let request = loop {
                let mut piece = [0; 4096];
                let count = stream.read(&mut piece).expect("bytes");
                text.extend_from_slice(&piece[..count]);
                let whole = String::from_utf8(text.clone()).expect("text");
                if let Some((head, body)) = whole.split_once("\r\n\r\n")
                    && let Ok(body) = serde_json::from_str(body)
                {
                    break (head.to_ascii_lowercase(), body);
                }
            };
            let _ = stream.write_all(b"HTTP/1.1 204 No Content\r\n\r\n");
            if heard.send(request).is_err() {
                return;
            }
        }
    });
    (url, requests)
}

fn put(daemon: &Daemon, path: &str, body: &Value) -> Value {
    // Receivers of these tests are on this machine, which its owner has to allow.
    let answer = daemon.as_owner("PUT", &format!("/api/v1{path}"), &body.to_string());
    assert_eq!(answer.status, 200, "{path}: {}", answer.text());
    answer.json()
}

#[test]
fn a_webhook_is_told_what_it_asks_for_and_its_secret_is_never_told() {
    let daemon = Daemon::demo("webhooks");
    let (url, requests) = receiver();
    put(
        &daemon,
        "/webhooks/alerts",
        &json!({"url": url, "events": ["write"], "lines": ["main"]}),
    );
    let told = put(
        &daemon,
        "/webhooks/alerts/secret",
        &json!({"secret": SECRET}),
    );
    assert_eq!(told, json!({"webhook": "alerts", "secret": true}));

    let test = daemon
        .send("POST", "/api/v1/webhooks/alerts/test", "")
        .json();
    assert_eq!(
        (&test["delivered"], &test["status"]),
        (&json!(true), &json!(204))
    );
    let (head, body) = requests.recv_timeout(PATIENCE).expect("the test");
    assert_eq!(
        (&body["event"]["code"], &body["event"]["id"]),
        (&json!("webhook_test"), &test["id"])
    );
    assert!(head.contains("x-railbus-signature: sha256="), "{head}");

    put(
        &daemon,
        "/points/oven/k1",
        &json!({"value": true, "confirm": true}),
    );
    let (_, body) = requests.recv_timeout(PATIENCE).expect("the event");
    assert_eq!(
        (&body["schema"], &body["site"]),
        (&json!(1), &json!("demo"))
    );
    assert_eq!(body["event"]["point"], "oven.k1");
    let hook = || daemon.get("/api/v1/webhooks").json()["webhooks"][0].clone();
    daemon.until("it is counted", |_| hook()["delivered"] == 1);
    assert_eq!(
        (&hook()["state"], &hook()["secret"]),
        (&json!("ok"), &json!(true))
    );
    let metrics = daemon.get("/metrics");
    let counted = "railbus_webhook_deliveries_total{webhook=\"alerts\",result=\"ok\"} 1\n";
    assert!(metrics.text().contains(counted), "{}", metrics.text());
    assert!(
        metrics
            .text()
            .contains("railbus_webhook_queue{webhook=\"alerts\"} 0\n")
    );

    for path in [
        "/webhooks",
        "/config",
        "/config/generations",
        "/events",
        "/audit",
    ] {
        let told = daemon.get(&format!("/api/v1{path}"));
        assert!(!told.text().contains("canary"), "{path}");
    }
    let gone = daemon.send("DELETE", "/api/v1/webhooks/alerts", "");
    assert_eq!(gone.status, 200, "{}", gone.text());
    put(&daemon, "/webhooks/alerts", &json!({"url": url}));
    assert_eq!(hook()["secret"], false, "it went with the webhook before");
}

#[test]
fn what_is_no_webhook_is_refused_and_nothing_changes() {
    let daemon = Daemon::start("webhooks-wrong", &["--demo"]);
    let code = |method: &str, path: &str, body: Value| {
        let path = format!("/api/v1/webhooks{path}");
        let answer = daemon.send(method, &path, &body.to_string());
        assert!(!answer.text().contains("canary"), "{}", answer.text());
        let json = answer.json();
        let first = json["problems"][0]["code"].clone();
        (
            answer.status,
            json["code"].as_str().unwrap_or_default().to_owned(),
            first,
        )
    };
    let wrong = |status: u16, code: &str| (status, code.to_owned(), Value::Null);
    let in_config = |code: &str| (422, "E0810".to_owned(), json!(code));
    let url = "http://127.0.0.1:1/";
    for (body, code_of) in [
        (json!({"url": "ftp://a/"}), "E0876"),
        (json!({"url": "http://me:canary@a/"}), "E0876"),
        (json!({"url": url, "events": ["x"]}), "E0815"),
        (json!({"url": url, "lines": ["none"]}), "E0820"),
        (json!({"url": url, "modules": ["none"]}), "E0801"),
    ] {
        assert_eq!(
            code("PUT", "/a", body.clone()),
            in_config(code_of),
            "{body}"
        );
    }
    assert_eq!(code("PUT", "/A", json!({"url": url})), in_config("E0817"));
    assert_eq!(
        code("PUT", "/a", json!({"url": url, "secret": "x"})),
        wrong(422, "E0806")
    );
    assert_eq!(code("DELETE", "/a", json!({})), wrong(404, "E0877"));
    assert_eq!(code("POST", "/a/test", json!({})), wrong(404, "E0877"));
    assert_eq!(
        code("PUT", "/a/secret", json!({"secret": SECRET})),
        wrong(404, "E0877")
    );
    assert_eq!(daemon.get("/api/v1/webhooks").json()["webhooks"], json!([]));

    put(&daemon, "/webhooks/a", &json!({"url": url}));
    assert_eq!(
        code("PUT", "/a/secret", json!({"secret": "canary"})),
        wrong(422, "E0806")
    );
    assert_eq!(
        code("PUT", "/a/secret", json!({"secret": ["canary"]})),
        wrong(422, "E0806")
    );
    let test = daemon.send("POST", "/api/v1/webhooks/a/test", "").json();
    assert_eq!(
        (&test["delivered"], &test["error"]["code"]),
        (&json!(false), &json!("E0857"))
    );
}

#[test]
fn who_changes_users_tokens_and_the_configuration_is_told() {
    let daemon = Daemon::start("changes", &["--demo"]);
    let done = |method: &str, path: &str, body: Value| {
        let answer = daemon.send(method, &format!("/api/v1{path}"), &body.to_string());
        assert_eq!(answer.status, 200, "{method} {path}: {}", answer.text());
        answer.json()
    };
    let admin = json!({"name": "anna", "role": "admin", "password": "canary correct horse"});
    done("POST", "/users", admin);
    let user = json!({"name": "li", "role": "operator", "password": "canary correct horse"});
    done("POST", "/users", user);
    done(
        "PATCH",
        "/users/li",
        json!({"role": "viewer", "password": "canary other horse"}),
    );
    let token = json!({"name": "grafana", "role": "viewer", "expires_days": 1});
    let token = done("POST", "/tokens", token);
    done(
        "DELETE",
        &format!("/tokens/{}", token["id"].as_str().expect("an id")),
        json!({}),
    );
    done("DELETE", "/users/li", json!({}));
    done("PATCH", "/config/points/oven/k1", json!({"locked": true}));
    done("POST", "/config/undo", json!({}));
    let wrong = json!({"name": "canary", "password": "canary"}).to_string();
    for _ in 0..40 {
        daemon.send("POST", "/api/v1/login", &wrong);
    }
    let told = |kind: &str| {
        let page = daemon.get(&format!("/api/v1/events?kind={kind}&limit=500"));
        assert!(!page.text().contains("canary"), "{}", page.text());
        let mut items = page.json()["items"].as_array().expect("a list").clone();
        items.reverse();
        items
    };
    let row = |event: &Value| {
        let text = |key: &str| event[key].as_str().unwrap_or_default().to_owned();
        [text("code"), text("who"), text("what"), text("text")].join(" ")
    };
    let changes = [
        "token_created owner test admin",
        "user_added token:test anna admin",
        "user_added token:test li operator",
        "user_changed token:test li role password",
        "token_created token:test grafana viewer",
        "token_revoked token:test grafana ",
        "user_removed token:test li ",
    ];
    daemon.until("all is told", |_| {
        let rows: Vec<String> = told("login").iter().map(row).collect();
        rows.iter().any(|row| row.starts_with("logins_many"))
    });
    let rows: Vec<String> = told("login").iter().map(row).collect();
    assert_eq!(rows[..changes.len()], changes, "{rows:?}");
    let many = rows.iter().filter(|row| row.starts_with("logins_many"));
    assert_eq!(many.count(), 1, "{rows:?}");
    assert!(rows.len() < 30, "{rows:?}");
    let rows: Vec<String> = told("config").iter().map(row).collect();
    assert_eq!(rows, ["config_changed token:test module.oven "; 2]);
}
