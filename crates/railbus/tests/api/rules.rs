//! Rules over HTTP: written, tried, armed, and acting in the demo.

use crate::daemon::{Answer, Daemon, exchange};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

fn code(answer: &Answer) -> (u16, Value) {
    (answer.status, answer.json()["code"].clone())
}

fn night(limit: f64) -> Value {
    json!({
        "name": { "en": "Night" },
        "when": { "point": "tank.ai1", "above": limit, "unit": "V" },
        "then": [{ "set": "yard.k2", "to": true }, { "notify": "above" }],
    })
}

#[test]
fn a_rule_is_tried_before_it_is_armed_and_acts_then() {
    let daemon = Daemon::demo("rules");
    let put = |rule: &Value| daemon.send("PUT", "/api/v1/rules/night", &rule.to_string());
    let post = |what: &str| daemon.send("POST", &format!("/api/v1/rules/night/{what}"), "{}");
    let shown = || daemon.get("/api/v1/rules/night").json();
    assert_eq!(
        code(&daemon.get("/api/v1/rules/night")),
        (404, "E0853".into())
    );
    assert_eq!(code(&post("arm")), (404, "E0853".into()));
    assert_eq!(code(&post("disarm")), (404, "E0853".into()));

    // It holds in any state of the tank.
    assert_eq!(put(&night(-1.0)).status, 200);
    assert_eq!(
        (&shown()["state"], &shown()["tried"]),
        (&json!("disarmed"), &json!(false))
    );
    assert_eq!(code(&post("arm")), (409, "E0854".into()));
    let tried = post("try").json();
    assert!(
        tried["count"].is_u64() && tried["acts"].is_array(),
        "{tried}"
    );
    assert!(tried["unknown_ms"].as_u64() > Some(80_000_000), "{tried}");
    // Another limit is another rule.
    assert_eq!(put(&night(-2.0)).status, 200);
    assert_eq!(code(&post("arm")), (409, "E0854".into()));
    assert_eq!(post("try").status, 200);
    assert_eq!(post("arm").status, 200);
    daemon.until("it acts", |daemon| {
        let rule = daemon.get("/api/v1/rules/night").json();
        rule["state"] == "acted" && daemon.get("/api/v1/points/yard/k2").json()["value"] == true
    });
    let shown_now = shown();
    assert_eq!(
        (&shown_now["count"], &shown_now["armed"]),
        (&json!(1), &json!(true))
    );
    assert!(shown_now["last"].is_string(), "{shown_now}");

    daemon.until("both are told", |daemon| {
        let events = daemon.get("/api/v1/events?kind=rule").json();
        let items = events["items"].as_array().expect("a list").clone();
        let codes: Vec<_> = items.iter().map(|event| &event["code"]).collect();
        codes == ["notify", "rule_fired"] && items[0]["who"] == "rule:night"
    });
    let audit = daemon.get("/api/v1/audit?limit=1").json();
    assert_eq!(audit["items"][0]["who"], "rule:night", "{audit}");

    // Unchanged it stays armed; changed it does not.
    let text = daemon.get("/api/v1/config").json()["text"].clone();
    assert!(
        text.as_str()
            .is_some_and(|text| text.contains("armed = true")),
        "{text}"
    );
    let mut renamed = night(-2.0);
    renamed["name"] = json!("Every night");
    assert_eq!(put(&renamed).status, 200);
    assert_eq!(
        (&shown()["armed"], &shown()["count"]),
        (&json!(true), &json!(1))
    );
    assert_eq!(put(&night(-3.0)).status, 200);
    assert_eq!(shown()["armed"], false);
    assert_eq!(post("disarm").status, 200);
    let all = daemon.get("/api/v1/rules").json();
    assert_eq!(all["rules"].as_array().map(Vec::len), Some(1));
    assert!(all["time_zone"].is_string());
    assert_eq!(daemon.send("DELETE", "/api/v1/rules/night", "").status, 200);
    assert_eq!(
        code(&daemon.get("/api/v1/rules/night")),
        (404, "E0853".into())
    );
}

/// A rule named `try` does not hide the route of that name.
#[test]
fn a_rule_may_be_called_as_it_likes() {
    let daemon = Daemon::demo("rules-names");
    for name in ["try", "arm", "text", "rules"] {
        let path = format!("/api/v1/rules/{name}");
        assert_eq!(
            daemon.send("PUT", &path, &night(-1.0).to_string()).status,
            200,
            "{name}"
        );
        assert_eq!(daemon.get(&path).json()["rule"], name);
        for (step, status) in [("try", 200), ("arm", 200), ("disarm", 200)] {
            let answer = daemon.send("POST", &format!("{path}/{step}"), "{}");
            assert_eq!(answer.status, status, "{name} {step}");
        }
        assert_eq!(daemon.send("DELETE", &path, "").status, 200, "{name}");
    }
}

#[test]
fn a_whole_text_arms_no_rule_that_was_not_tried() {
    let daemon = Daemon::demo("rules-text");
    let text = || {
        let text = daemon.get("/api/v1/config").json()["text"].clone();
        text.as_str().expect("a text").to_owned()
    };
    let put = |text: &str| {
        let etag = daemon.get("/api/v1/config").json()["etag"].clone();
        let head = format!("{}If-Match: {etag}\r\n", daemon.head());
        let body = json!({ "text": text }).to_string();
        exchange(daemon.connect(), "PUT", "/api/v1/config", &head, &body)
    };
    let rule = |limit: &str, armed: bool| {
        format!(
            "[rule.night]\nwhen = {{ point = \"tank.ai1\", above = {limit}, unit = \"V\" }}\n\
             then = [{{ notify = \"above\" }}]\narmed = {armed}\n"
        )
    };
    let before = text();
    let armed = format!("{before}\n{}", rule("-1.0", true));
    let refused = put(&armed);
    assert_eq!(code(&refused), (409, "E0854".into()));
    assert_eq!(
        (&refused.json()["name"], &refused.json()["hint"][0]),
        (&json!("night"), &json!("POST /api/v1/rules/try-text"))
    );
    assert_eq!(text(), before, "nothing changes");
    // Disarmed it is accepted; tried, it may be armed, and an armed one may stay.
    assert_eq!(
        put(&format!("{before}\n{}", rule("-1.0", false))).status,
        200
    );
    assert_eq!(code(&put(&armed)), (409, "E0854".into()));
    assert_eq!(
        daemon.send("POST", "/api/v1/rules/night/try", "{}").status,
        200
    );
    assert_eq!(put(&armed).status, 200);
    assert_eq!(daemon.get("/api/v1/rules/night").json()["armed"], true);
    assert_eq!(put(&format!("{armed}# The same.\n")).status, 200);
    let other = format!("{before}\n{}", rule("-2.0", true));
    assert_eq!(
        code(&put(&other)),
        (409, "E0854".into()),
        "another limit is another rule"
    );
    // An earlier text that is restored is checked in the same way.
    assert_eq!(daemon.send("POST", "/api/v1/config/undo", "{}").status, 200);
    daemon.send("DELETE", "/api/v1/rules/night", "");
    assert_eq!(daemon.send("POST", "/api/v1/config/undo", "{}").status, 200);
    assert_eq!(daemon.get("/api/v1/rules/night").json()["armed"], true);
}

#[test]
fn a_rule_that_was_stopped_begins_anew_when_it_is_armed_again() {
    let daemon = Daemon::demo("rules-stopped");
    let rule = |is: bool| {
        json!({
            "when": { "point": "yard.k1", "is": is }, "then": [{ "set": "yard.k1", "to": !is }],
        })
    };
    let post = |name: &str, what: &str| {
        let answer = daemon.send("POST", &format!("/api/v1/rules/{name}/{what}"), "{}");
        assert_eq!(answer.status, 200, "{name} {what}: {}", answer.text());
    };
    let shown = |name: &str| daemon.get(&format!("/api/v1/rules/{name}")).json();
    for (name, is) in [("off", true), ("on", false)] {
        let path = format!("/api/v1/rules/{name}");
        assert_eq!(daemon.send("PUT", &path, &rule(is).to_string()).status, 200);
        post(name, "try");
    }
    // They undo each other until one of them has acted too often.
    post("off", "arm");
    post("on", "arm");
    let names = ["off", "on"];
    let is_stopped = |name: &&str| shown(name)["state"] == "stopped";
    // A hundred writes and more, at the pace of the line.
    let begun = Instant::now();
    while !names.iter().any(is_stopped) {
        assert!(
            begun.elapsed() < Duration::from_secs(300),
            "none is stopped"
        );
        std::thread::sleep(Duration::from_millis(200));
    }
    let stopped = names.into_iter().find(is_stopped).expect("one of them");
    let acted = shown(stopped)["count"].as_u64().expect("a count");
    assert!(acted >= 60, "{acted}");
    let events = daemon.get("/api/v1/events?kind=rule").json();
    let told = events["items"].as_array().expect("a list").iter();
    let told: Vec<_> = told
        .filter(|event| event["code"] == "rule_stopped")
        .collect();
    assert_eq!(told.len(), 1, "{events}");

    // It was armed all the time; only arming it again lets it act.
    let other = if stopped == "off" { "on" } else { "off" };
    post(other, "disarm");
    let condition = stopped == "off";
    let set = |on: bool| {
        let body = json!({ "value": on }).to_string();
        assert_eq!(
            daemon.send("PUT", "/api/v1/points/yard/k1", &body).status,
            200
        );
    };
    let is = || daemon.get("/api/v1/points/yard/k1").json()["value"].clone();
    set(!condition);
    set(condition);
    assert_eq!(
        (
            shown(stopped)["armed"].clone(),
            shown(stopped)["state"].clone(),
            is()
        ),
        (json!(true), json!("stopped"), json!(condition))
    );
    post(stopped, "arm");
    set(!condition);
    set(condition);
    daemon.until("it acts again", |_| is() == json!(!condition));
    assert_ne!(shown(stopped)["state"], "stopped");
}

#[test]
fn a_rule_that_is_not_written_yet_is_tried_as_it_would_be_read() {
    let daemon = Daemon::demo("rules-try");
    let ask = |body: Value| daemon.send("POST", "/api/v1/rules/try-text", &body.to_string());
    let daily = json!({ "when": { "time": "06:30" }, "then": [{ "notify": "morning" }] });
    let week = ask(json!({ "rule": daily, "hours": 168 })).json();
    assert_eq!(
        (&week["count"], &week["unknown_ms"]),
        (&json!(7), &json!(0)),
        "{week}"
    );
    // A rule that was tried may be armed, by any way of writing it.
    assert_eq!(
        daemon
            .send("PUT", "/api/v1/rules/wake", &daily.to_string())
            .status,
        200
    );
    assert_eq!(
        daemon.send("POST", "/api/v1/rules/wake/arm", "").status,
        200
    );
    let rule = daemon.get("/api/v1/rules/wake").json();
    assert!(
        rule["due"].is_string() && rule["state"] == "waiting",
        "{rule}"
    );
    let with = |then: Value| ask(json!({ "rule": { "when": { "time": "06:30" }, "then": then } }));
    let wrong = with(json!([{ "set": "tank.ai1", "to": true }]));
    assert_eq!(code(&wrong), (422, "E0810".into()));
    assert_eq!(wrong.json()["problems"][0]["code"], "E0865");
    assert_eq!(
        code(&with(json!([{ "set": "yard.k1", "too": true }]))),
        (422, "E0806".into())
    );
    for wrong in [
        json!({}),
        json!({ "rule": daily, "hours": 169 }),
        json!({ "rule": daily, "hours": 0 }),
        json!({ "rule": daily, "since": "2020-01-01T00:00:00Z" }),
        json!({ "rule": daily, "since": "2999-01-01T00:00:00Z" }),
        json!({ "rule": daily, "since": "yesterday" }),
    ] {
        assert_eq!(code(&ask(wrong.clone())), (422, "E0806".into()), "{wrong}");
    }
}
