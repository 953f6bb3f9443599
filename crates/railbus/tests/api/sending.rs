//! Raw frames over HTTP.

use crate::daemon::{Answer, Daemon};
use serde_json::{Value, json};

const SEND: &str = "/api/v1/lines/main/send";
/// Switches k1 of the oven on, without its checksum.
const ON: &str = "03 05 00 3C FF 00";

fn dry(daemon: &Daemon, frame: &Value) -> Value {
    let told = daemon.send("POST", &format!("{SEND}?dry_run=1"), &frame.to_string());
    assert_eq!(told.status, 200, "{frame}: {}", told.text());
    told.json()
}

fn send(daemon: &Daemon, frame: &Value) -> Answer {
    daemon.send("POST", SEND, &frame.to_string())
}

fn oven_k1(daemon: &Daemon) -> Value {
    daemon.get("/api/v1/points/oven/k1?fresh=1").json()["value"].clone()
}

#[test]
fn what_a_frame_may_do_is_told_before_it_is_sent() {
    let daemon = Daemon::demo("send-plan");
    for (protocol, bytes, whole, risk, answered) in [
        (
            "rtu",
            "03 01 00 3C 00 08",
            "03 01 00 3C 00 08 FC 22",
            "read",
            true,
        ),
        ("rtu", ON, "03 05 00 3C FF 00 4D D4", "output", true),
        (
            "rtu",
            "03 06 00 00 00 09",
            "03 06 00 00 00 09 48 2E",
            "settings",
            true,
        ),
        (
            "rtu",
            "00 05 00 3C FF 00",
            "00 05 00 3C FF 00 4D E7",
            "broadcast",
            false,
        ),
        ("ascii", "$016", "24 30 31 36 0D", "read", true),
        (
            "r55",
            "55 F5 13 00 00 00 FF",
            "55 F5 13 00 00 00 FF 5C",
            "broadcast",
            false,
        ),
    ] {
        let told = dry(
            &daemon,
            &json!({"protocol": protocol, "bytes": bytes, "complete": true}),
        );
        assert_eq!(told["bytes"], whole, "{told}");
        assert_eq!(
            (&told["risk"], &told["answered"]),
            (&json!(risk), &json!(answered)),
            "{told}"
        );
        let needs = if risk == "read" {
            json!([])
        } else {
            json!([risk])
        };
        assert_eq!(told["needs"], needs, "{told}");
        assert_eq!(
            told["may"].as_array().map(Vec::is_empty),
            Some(risk == "read"),
            "{told}"
        );
        assert!(!told["meaning"].as_str().expect("words").is_empty());
    }
    let broadcast = dry(
        &daemon,
        &json!({"protocol": "rtu", "bytes": "00 05 00 3C FF 00 4D E7"}),
    );
    let modules = broadcast["modules"].as_array().expect("a list");
    assert!(
        modules.contains(&json!("oven")) && !modules.contains(&json!("yard")),
        "{broadcast}"
    );
    let wrong = send(
        &daemon,
        &json!({"protocol": "rtu", "bytes": "03 05 00 3C FF 00 4D D5"}),
    );
    assert_eq!(
        (wrong.status, &wrong.json()["code"]),
        (422, &json!("E0808"))
    );
    let none = daemon.send(
        "POST",
        "/api/v1/lines/none/send",
        r#"{"protocol":"rtu","bytes":"03"}"#,
    );
    assert_eq!((none.status, &none.json()["code"]), (404, &json!("E0803")));
    assert_eq!(oven_k1(&daemon), false);
}

#[test]
fn a_frame_that_may_change_something_is_sent_where_it_is_meant() {
    let daemon = Daemon::demo("send");
    let on = |confirm: Value| {
        let complete = true;
        json!({"protocol": "rtu", "bytes": ON, "complete": complete, "confirm": confirm})
    };
    for confirm in [json!([]), json!(["read"]), json!(["settings", "override"])] {
        let refused = send(&daemon, &on(confirm));
        let problem = refused.json();
        assert_eq!(
            (refused.status, &problem["code"]),
            (409, &json!("E0458")),
            "{problem}"
        );
        assert_eq!(problem["needs"], json!(["output"]));
    }
    assert_eq!(oven_k1(&daemon), false, "nothing was sent");

    let sent = send(&daemon, &on(json!(["output"])));
    assert_eq!(sent.status, 200, "{}", sent.text());
    let sent = sent.json();
    assert_eq!(
        (&sent["outcome"], &sent["refused"]),
        (&json!("answered"), &json!(false))
    );
    // All that was heard: on a busy machine a late reply to a poll comes before it.
    let heard = sent["bytes"].as_str().unwrap_or_default();
    assert!(heard.ends_with("03 05 00 3C FF 00 4D D4"), "{heard}");
    let known = daemon.get("/api/v1/points/oven/k1").json();
    assert_eq!(
        (&known["value"], &known["quality"]),
        (&json!(true), &json!("good"))
    );
    let audit = daemon.get("/api/v1/audit").json();
    let entry = &audit["items"][0];
    assert_eq!(
        (&entry["id"], &entry["module"]),
        (&sent["audit"], &json!("oven")),
        "{audit}"
    );
    assert_eq!(entry["what"], "send output: 03 05 00 3C FF 00 4D D4 (main)");
    assert_eq!(entry["end"], "reply");

    // A locked output is switched only if that is confirmed as well.
    let lock = r#"{"locked":true}"#;
    let locked = daemon.send("PATCH", "/api/v1/config/points/oven/k2", lock);
    assert_eq!(locked.status, 200, "{}", locked.text());
    let told = dry(&daemon, &on(json!([])));
    assert_eq!(told["needs"], json!(["output", "override"]));
    assert_eq!(
        told["overrides"],
        json!([{"point": "oven.k2", "rules": ["locked"]}])
    );
    let refused = send(&daemon, &on(json!(["output"])));
    assert_eq!(
        (refused.status, &refused.json()["code"]),
        (409, &json!("E0458"))
    );
    let sent = send(&daemon, &on(json!(["override", "output"])));
    assert_eq!(sent.status, 200, "{}", sent.text());
    let refusal = json!({
        "protocol": "rtu", "bytes": "03 05 00 10 FF 00", "complete": true,
        "confirm": ["output", "override"],
    });
    let sent = send(&daemon, &refusal).json();
    assert_eq!(
        (&sent["outcome"], &sent["refused"]),
        (&json!("answered"), &json!(true)),
        "{sent}"
    );
    let audit = daemon.get("/api/v1/audit").json();
    assert_eq!(audit["items"][0]["end"], "refused");
}

/// A scan that is cancelled leaves its request pending, and no other caller is refused because of
/// that.
#[test]
fn a_scan_that_was_cancelled_is_in_nobodys_way() {
    let daemon = Daemon::demo("send-scan");
    for _ in 0..5 {
        let begun = daemon.send("POST", "/api/v1/scans", r#"{"depth":"deep"}"#);
        let op = begun.json()["op"].as_str().expect("a number").to_owned();
        daemon.until("it asks", |daemon| {
            daemon.get(&format!("/api/v1/ops/{op}")).json()["done"].as_u64() > Some(3)
        });
        let cancelled = daemon.send("DELETE", &format!("/api/v1/ops/{op}"), "");
        assert_eq!(
            cancelled.json()["state"],
            "cancelled",
            "{}",
            cancelled.text()
        );
        let read = json!({"protocol": "rtu", "bytes": "03 01 00 3C 00 08", "complete": true});
        let read = send(&daemon, &read);
        assert_eq!(read.status, 200, "{}", read.text());
        assert_eq!(read.json()["outcome"], "answered");
    }
}
