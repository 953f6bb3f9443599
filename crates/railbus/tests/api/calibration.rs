//! A module is calibrated from a page, which confirms each step.

use crate::daemon::Daemon;
use serde_json::{Value, json};

const CALIBRATE: &str = "/api/v1/modules/tank/settings/calibrate";

fn begin(daemon: &Daemon, wanted: &str) -> String {
    let begun = daemon.send("POST", CALIBRATE, wanted);
    assert_eq!(begun.status, 202, "{}", begun.text());
    let op = begun.json()["op"].as_str().expect("a number").to_owned();
    format!("/api/v1/ops/{op}")
}

/// Waits until it asks for a step, or has ended.
fn asked(daemon: &Daemon, op: &str, step: &str) -> Value {
    daemon.until(step, |daemon| {
        let told = daemon.get(op).json();
        told["settings"]["question"]["step"] == step || told["state"] != "running"
    });
    let told = daemon.get(op).json();
    assert_eq!(told["settings"]["question"]["step"], step, "{told}");
    told["settings"]["question"].clone()
}

fn ended(daemon: &Daemon, op: &str) -> Value {
    daemon.until("its end", |daemon| {
        daemon.get(op).json()["state"] != "running"
    });
    daemon.get(op).json()
}

fn answer(daemon: &Daemon, op: &str, go: bool) -> u16 {
    let answer = json!({"go": go}).to_string();
    daemon.send("POST", &format!("{op}/answer"), &answer).status
}

fn audited(daemon: &Daemon) -> Value {
    let audit = daemon.get("/api/v1/audit").json();
    json!([audit["items"][0]["what"], audit["items"][0]["end"]])
}

#[test]
fn a_calibration_asks_before_each_step_and_can_end_at_any() {
    let daemon = Daemon::demo("calibrate");
    let other = daemon.send("POST", "/api/v1/modules/oven/settings/calibrate", "{}");
    assert_eq!(
        (other.status, &other.json()["code"]),
        (422, &json!("E0842")),
        "{}",
        other.text()
    );
    let wrong = daemon.send("POST", CALIBRATE, r#"{"voltage":"90 V"}"#);
    assert_eq!(wrong.status, 422, "{}", wrong.text());

    let op = begin(&daemon, "{}");
    let question = asked(&daemon, &op, "zero");
    assert!(question["readings"][0].is_number(), "{question}");
    assert_eq!(answer(&daemon, &op, true), 200);
    let question = asked(&daemon, &op, "span");
    assert_eq!(question["voltage"], 5.0, "{question}");
    assert_eq!(answer(&daemon, &op, true), 200);
    let end = ended(&daemon, &op);
    assert_eq!(
        (&end["state"], &end["settings"]["end"]),
        (&json!("done"), &json!("done")),
        "{end}"
    );
    for readings in ["before", "zero", "span"] {
        assert!(
            end["settings"]["calibration"][readings][1].is_number(),
            "{readings}: {end}"
        );
    }
    assert_eq!(answer(&daemon, &op, true), 422, "it asks nothing any more");
    assert_eq!(
        audited(&daemon),
        json!(["calibrate zero, span at 5.00 V", "reply"])
    );
    let log = daemon.get("/api/v1/modules/tank/settings/log").json();
    assert_eq!(log["changes"][0]["by"], "calibrate", "{log}");
    assert_eq!(log["changes"][0]["undoable"], false, "{log}");

    // It ends if it is cancelled or refused; the line is given back.
    let op = begin(&daemon, r#"{"voltage":"10 V"}"#);
    asked(&daemon, &op, "zero");
    let taken = daemon.send("POST", CALIBRATE, "{}");
    assert_eq!(taken.status, 409, "{}", taken.text());
    assert_eq!(answer(&daemon, &op, true), 200);
    asked(&daemon, &op, "span");
    let end = daemon.send("DELETE", &op, "").json();
    assert_eq!(end["state"], "cancelled", "{end}");
    assert_eq!(end["settings"]["calibration"]["span"], Value::Null, "{end}");
    assert!(
        end["settings"]["calibration"]["zero"][0].is_number(),
        "{end}"
    );
    let op = begin(&daemon, "{}");
    asked(&daemon, &op, "zero");
    assert_eq!(answer(&daemon, &op, false), 200);
    assert_eq!(ended(&daemon, &op)["state"], "cancelled");
    assert_eq!(
        audited(&daemon),
        json!(["calibrate zero, span at 5.00 V", "not_tried"])
    );
    daemon.until("the tank is polled again", |daemon| {
        daemon.get("/api/v1/points/tank/ai1").json()["quality"] == "good"
    });
}
