//! A lost module is searched for, and two on one address are reported.

use crate::daemon::Daemon;
use serde_json::{Value, json};

/// Changes a module's settings without the configuration.
fn behind_its_back(daemon: &Daemon, bytes: &str) {
    let frame = json!({
        "protocol": "rtu", "bytes": bytes, "complete": true, "confirm": ["settings"],
    });
    let sent = daemon.send("POST", "/api/v1/lines/main/send", &frame.to_string());
    assert_eq!(
        (sent.status, &sent.json()["outcome"]),
        (200, &json!("answered"))
    );
}

fn recovered(daemon: &Daemon, module: &str) -> Value {
    let path = format!("/api/v1/modules/{module}/settings/recover");
    let begun = daemon.send("POST", &path, "");
    assert_eq!(begun.status, 202, "{}", begun.text());
    let op = format!(
        "/api/v1/ops/{}",
        begun.json()["op"].as_str().expect("a number")
    );
    daemon.until("its end", |daemon| {
        daemon.get(&op).json()["state"] != "running"
    });
    daemon.get(&op).json()
}

fn state_of(daemon: &Daemon, module: &str) -> Value {
    let modules = daemon.get("/api/v1/modules").json();
    let modules = modules["modules"].as_array().expect("a list").clone();
    let found = modules.into_iter().find(|one| one["module"] == module);
    let found = found.expect("it is there");
    json!([found["address"], found["state"]])
}

#[test]
fn a_lost_module_is_found_and_the_configuration_follows() {
    let daemon = Daemon::demo("recover");
    let end = recovered(&daemon, "oven");
    assert_eq!(
        (&end["state"], &end["settings"]["end"]),
        (&json!("done"), &json!("in_place")),
        "{end}"
    );
    // The line is restarted: a module that has not answered on it yet can't be lost there.
    daemon.until("it is heard again", |daemon| {
        state_of(daemon, "oven") == json!([3, "online"])
    });

    behind_its_back(&daemon, "03 06 00 00 00 09");
    daemon.until("it is missed", |daemon| {
        state_of(daemon, "oven") == json!([3, "offline"])
    });
    let end = recovered(&daemon, "oven");
    assert_eq!(
        (&end["state"], &end["settings"]["end"]),
        (&json!("done"), &json!("moved")),
        "{end}"
    );
    assert_eq!(end["settings"]["place"], "9 (09h), 9600 8N1");
    daemon.until("it is polled there", |daemon| {
        state_of(daemon, "oven") == json!([9, "online"])
    });

    // Two on one address: the search reports how to separate them.
    behind_its_back(&daemon, "05 06 00 01 00 09");
    let end = recovered(&daemon, "oven");
    assert_eq!(
        (&end["state"], &end["settings"]["end"]),
        (&json!("failed"), &json!("two")),
        "{end}"
    );
    assert_eq!(end["settings"]["parting"], "plug");
    assert_eq!(end["error"]["code"], "E0540");
    let none = daemon.send("POST", "/api/v1/modules/none/settings/recover", "");
    assert_eq!((none.status, &none.json()["code"]), (404, &json!("E0801")));
}

#[test]
fn a_search_can_be_ended() {
    let daemon = Daemon::demo("recover-stop");
    behind_its_back(&daemon, "03 06 00 00 00 1F");
    let begun = daemon.send("POST", "/api/v1/modules/oven/settings/recover", "");
    let op = format!(
        "/api/v1/ops/{}",
        begun.json()["op"].as_str().expect("a number")
    );
    daemon.until("it looks elsewhere", |daemon| {
        daemon.get(&op).json()["settings"]["looking"].is_string()
    });
    let end = daemon.send("DELETE", &op, "").json();
    assert_eq!(end["state"], "cancelled", "{end}");
    daemon.until("the others are polled again", |daemon| {
        daemon.get("/api/v1/points/pump/do0").json()["quality"] == "good"
    });
}
