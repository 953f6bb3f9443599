//! Invalid bodies, methods and addresses: each is refused with a problem that says why, and nothing
//! is switched.

use crate::daemon::{Answer, Daemon};
use serde_json::Value;

/// Bodies that no route accepts.
const BODIES: [&str; 7] = [
    "{",
    "[]",
    "7",
    "\"value\"",
    "\u{0}",
    "{\"value\":\"on\",\"ms\":\"long\",\"set\":7,\"bytes\":7,\"text\":7,\"modules\":7,\"name\":7,\
     \"password\":7,\"depth\":7,\"key\":7,\"old\":7,\"to\":\"x\",\"raw\":7,\"comment\":7,\
     \"role\":7,\"locked\":7,\"port\":7,\"value_of\":7,\"interlock\":7}",
    "{\"value\":true,\"value\":false,\"ms\":-1,\"set\":{\"do0\":\"on\"},\"raw\":null,\"to\":-1,\
     \"lines\":7}",
];

fn outputs(daemon: &Daemon) -> Vec<Value> {
    let points = daemon.get("/api/v1/points?fresh=1").json();
    let points = points["points"].as_array().expect("a list").iter();
    let outputs = points.filter(|point| point["kind"] == "output");
    outputs.map(|point| point["value"].clone()).collect()
}

/// Every operation of the API's own document that takes a body, at an address that exists.
fn operations(daemon: &Daemon) -> Vec<(String, String)> {
    let document = daemon.get("/api/v1/openapi.json").json();
    let mut all = Vec::new();
    for (path, item) in document["paths"].as_object().expect("paths") {
        for (method, operation) in item.as_object().expect("methods") {
            if !operation["requestBody"].is_null() && path != "/setup" {
                let path = path.replace("{module}", "pump").replace("{label}", "do0");
                let path = path.replace("{line}", "main").replace("{name}", "nobody");
                let path = path.replace("{group}", "none").replace("{scene}", "none");
                let path = path.replace("{id}", "none");
                all.push((method.to_ascii_uppercase(), format!("/api/v1{path}")));
            }
        }
    }
    assert!(all.len() > 10, "{all:?}");
    all
}

fn is_problem(answer: &Answer, what: &str) {
    let (status, head) = (answer.status, &answer.head);
    assert!((400..500).contains(&status), "{what}: {head}");
    assert!(
        head.contains("content-type: application/problem+json"),
        "{what}: {head}"
    );
    let problem = answer.json();
    assert_eq!(problem["status"], status, "{what}");
    let code = problem["code"].as_str().expect("a code");
    assert!(code.starts_with('E') && code.len() == 5, "{what}: {code}");
    assert!(
        problem["title"]
            .as_str()
            .is_some_and(|title| !title.is_empty()),
        "{what}"
    );
}

#[test]
fn bodies_that_are_none_are_refused_and_nothing_is_switched() {
    let daemon = Daemon::demo("bodies");
    let before = outputs(&daemon);
    let long = format!("{{\"value\":true,\"x\":\"{}\"}}", "x".repeat(9 << 20));
    for (method, path) in operations(&daemon) {
        for body in BODIES {
            let answer = daemon.send(&method, &path, body);
            is_problem(&answer, &format!("{method} {path} {body:.40}"));
        }
        let answer = daemon.try_send(&method, &path, &long);
        // It may be disconnected while it still sends.
        if let Some(answer) = answer {
            is_problem(&answer, &format!("{method} {path} with a long body"));
        }
    }
    assert_eq!(outputs(&daemon), before);
}

#[test]
fn addresses_and_methods_that_are_none_are_refused() {
    let daemon = Daemon::demo("addresses");
    for (method, path, status) in [
        ("GET", "/api/v1/nothing", 404),
        ("GET", "/api/v1", 404),
        ("GET", "/api/v2/points", 404),
        ("DELETE", "/api/v1/points", 405),
        ("PATCH", "/api/v1/points/pump/do0", 405),
        ("TRACE", "/api/v1/lines", 405),
        ("GET", "/api/v1/points/pump/%FF", 400),
        ("GET", "/api/v1/points/pump/do99", 404),
        ("GET", "/api/v1/points/nobody/do0", 404),
        ("GET", "/api/v1/points?select=nobody.do0", 404),
        ("GET", "/api/v1/ops/x", 404),
    ] {
        let answer = daemon.send(method, path, "");
        is_problem(&answer, &format!("{method} {path}"));
        assert_eq!(answer.status, status, "{method} {path}");
    }
}
