//! Modules' settings, changed by the daemon for a page.

use crate::daemon::{Answer, Daemon, exchange};
use serde_json::{Value, json};

const OVEN: &str = "/api/v1/modules/oven/settings";

/// A request with the settings it is based on.
fn matching(daemon: &Daemon, method: &str, path: &str, etag: &str, body: &Value) -> Answer {
    let head = format!(
        "{}Content-Type: application/json\r\nIf-Match: \"{etag}\"\r\n",
        daemon.head()
    );
    exchange(daemon.connect(), method, path, &head, &body.to_string())
}

fn settings(daemon: &Daemon, path: &str) -> Value {
    let read = daemon.get(path);
    assert_eq!(read.status, 200, "{}", read.text());
    let read = read.json();
    let tag = read["etag"].as_str().expect("a mark").to_owned();
    assert!(daemon.get(path).head.contains(&format!("etag: \"{tag}\"")));
    read
}

fn value(settings: &Value, name: &str) -> Value {
    let all = settings["settings"].as_array().expect("a list");
    let found = all.iter().find(|setting| setting["setting"] == name);
    found.expect("it has it")["value"].clone()
}

/// Begins a change and waits for its end.
fn carried(daemon: &Daemon, begun: &Answer) -> Value {
    assert_eq!(begun.status, 202, "{}", begun.text());
    let op = begun.json()["op"].as_str().expect("a number").to_owned();
    let path = format!("/api/v1/ops/{op}");
    daemon.until("it ends", |daemon| {
        daemon.get(&path).json()["state"] != "running"
    });
    daemon.get(&path).json()
}

fn oven_answers_at(daemon: &Daemon, address: u64) {
    daemon.until("the oven is polled where it is", |daemon| {
        let modules = daemon.get("/api/v1/modules").json();
        let modules = modules["modules"].as_array().expect("a list").clone();
        let oven = modules.iter().find(|module| module["module"] == "oven");
        let oven = oven.expect("it is there");
        oven["address"] == address && oven["state"] == "online"
    });
}

#[test]
fn an_address_is_changed_read_back_followed_and_taken_back() {
    let daemon = Daemon::demo("settings");
    let before = settings(&daemon, OVEN);
    assert_eq!(value(&before, "address"), "3");
    let etag = before["etag"].as_str().expect("a mark");

    let dry = format!("{OVEN}?dry_run=1");
    let plan = matching(&daemon, "PATCH", &dry, etag, &json!({"address": 9}));
    assert_eq!(plan.status, 200, "{}", plan.text());
    let plan = plan.json();
    let change = json!([{"setting": "address", "before": "3", "after": "9"}]);
    assert_eq!(plan["changes"], change);
    let frames = plan["frames"].as_array().expect("a list");
    assert_eq!(frames.len(), 1, "{plan}");
    assert!(
        frames[0]["frame"]
            .as_str()
            .expect("text")
            .starts_with("03 06 ")
    );
    assert_eq!(settings(&daemon, OVEN), before, "nothing was written");

    let begun = matching(&daemon, "PATCH", OVEN, etag, &json!({"address": 9}));
    let end = carried(&daemon, &begun);
    assert_eq!(end["state"], "done", "{end}");
    assert_eq!(end["settings"]["end"], "done");
    assert_eq!(end["settings"]["changes"], change);
    oven_answers_at(&daemon, 9);
    let config = daemon.get("/api/v1/config").json();
    let text = config["text"].as_str().expect("text");
    assert!(text.contains("model = \"erc8\"\naddress = 9\n"), "{text}");

    let log = daemon.get(&format!("{OVEN}/log")).json();
    let last = &log["changes"][0];
    assert_eq!(last["set"], json!({"address": ["3", "9"]}));
    assert_eq!(
        (&last["state"], &last["undoable"]),
        (&json!("filed"), &json!(true))
    );

    let audit = daemon.get("/api/v1/audit").json();
    let entry = &audit["items"][0];
    assert_eq!(entry["what"], "settings address=9", "{audit}");
    assert_eq!(entry["end"], "readback");

    let begun = daemon.send("POST", &format!("{OVEN}/undo"), "{}");
    let end = carried(&daemon, &begun);
    assert_eq!(end["state"], "done", "{end}");
    oven_answers_at(&daemon, 3);
    assert_eq!(settings(&daemon, OVEN), before);
    let log = daemon.get(&format!("{OVEN}/log")).json();
    assert_eq!(log["changes"][0]["undoes"], last["change"]);
}

#[test]
fn what_is_not_as_seen_or_taken_or_no_setting_is_refused() {
    let daemon = Daemon::demo("settings-refuse");
    let etag = settings(&daemon, OVEN)["etag"].clone();
    let etag = etag.as_str().expect("a mark");
    let unseen = daemon.send("PATCH", OVEN, r#"{"address":9}"#);
    assert_eq!(
        (unseen.status, &unseen.json()["code"]),
        (428, &json!("E0882"))
    );
    let other = matching(&daemon, "PATCH", OVEN, "feed", &json!({"address": 9}));
    assert_eq!(
        (other.status, &other.json()["code"]),
        (412, &json!("E0881"))
    );
    assert_eq!(other.json()["etag"], etag);
    for (set, status, code) in [
        (json!({}), 422, "E0806"),
        (json!({"address": [1]}), 422, "E0806"),
        (json!({"address": 300}), 422, "E0841"),
        (json!({"address": 0}), 422, "E0841"),
        (json!({"colour": "red"}), 422, "E0840"),
    ] {
        let refused = matching(&daemon, "PATCH", OVEN, etag, &set);
        assert_eq!(refused.status, status, "{set}: {}", refused.text());
        assert_eq!(refused.json()["code"], code, "{set}");
    }
    let none = daemon.get("/api/v1/modules/none/settings");
    assert_eq!((none.status, &none.json()["code"]), (404, &json!("E0801")));
    let undo = daemon.send("POST", &format!("{OVEN}/undo"), "{}");
    assert_eq!((undo.status, &undo.json()["code"]), (404, &json!("E0846")));

    // The address is in use: that is found out before anything is written.
    let begun = matching(&daemon, "PATCH", OVEN, etag, &json!({"address": 5}));
    let end = carried(&daemon, &begun);
    assert_eq!(end["state"], "failed", "{end}");
    assert_eq!(end["error"]["code"], "E0440", "{end}");
    assert_eq!(end["settings"].get("end"), None);
    oven_answers_at(&daemon, 3);
    assert_eq!(
        daemon.get(&format!("{OVEN}/log")).json()["changes"],
        json!([])
    );
}

#[test]
fn a_board_waits_for_its_power_and_can_be_let_off() {
    let daemon = Daemon::demo("settings-board");
    // For 10 s after power-up a board accepts an address without a power cycle [R55 §4.6].
    std::thread::sleep(std::time::Duration::from_secs(11));
    let yard = "/api/v1/modules/yard/settings";
    let before = settings(&daemon, yard);
    let etag = before["etag"].as_str().expect("a mark");
    let begun = matching(&daemon, "PATCH", yard, etag, &json!({"address": "7"}));
    assert_eq!(begun.status, 202, "{}", begun.text());
    let op = begun.json()["op"].as_str().expect("a number").to_owned();
    let path = format!("/api/v1/ops/{op}");
    daemon.until("it waits for the power", |daemon| {
        let told = daemon.get(&path).json();
        assert_eq!(told["state"], "running", "{told}");
        told["settings"]["stage"] == "power_cycle" && told["settings"]["power_left_s"] != 0
    });
    let second = matching(&daemon, "PATCH", yard, etag, &json!({"address": "8"}));
    assert!(second.status >= 400, "the line is lent");
    let ended = daemon.send("DELETE", &path, "").json();
    assert_eq!(ended["state"], "cancelled", "{ended}");
    assert_eq!(ended["settings"]["end"], "unchanged");
    daemon.until("the board is polled again", |daemon| {
        daemon.get("/api/v1/points/yard/k1").json()["quality"] == "good"
    });
    assert_eq!(settings(&daemon, yard), before);
    assert_eq!(last_end(&daemon), "not_verified");

    // The adapter is lost after the address was sent: the board's settings are unknown.
    let begun = matching(&daemon, "PATCH", yard, etag, &json!({"address": "7"}));
    let op = begun.json()["op"].as_str().expect("a number").to_owned();
    let path = format!("/api/v1/ops/{op}");
    daemon.until("it waits for the power", |daemon| {
        daemon.get(&path).json()["settings"]["stage"] == "power_cycle"
    });
    let plug = |plugged: bool| {
        let body = json!({ "plugged": plugged }).to_string();
        daemon.send("PUT", "/api/v1/sim/main", &body)
    };
    assert_eq!(plug(false).status, 200);
    let ended = carried(&daemon, &begun);
    assert_eq!(ended["state"], "failed", "{ended}");
    assert_eq!(last_end(&daemon), "unknown");
}

/// The end of the last command in the audit log.
fn last_end(daemon: &Daemon) -> Value {
    let page = daemon.get("/api/v1/audit?limit=1").json();
    page["items"][0]["end"].clone()
}

#[test]
fn registers_are_told_byte_for_byte_and_after_the_data_sheet() {
    let daemon = Daemon::demo("registers");
    let read = |name: &str| {
        let read = daemon.get(&format!("/api/v1/modules/{name}/registers"));
        assert_eq!(read.status, 200, "{}", read.text());
        read.json()
    };
    let tank = read("tank");
    let reads = tank["reads"].as_array().expect("a list");
    let words = reads.last().expect("the registers are last");
    let cells = words["cells"].as_array().expect("a list");
    assert_eq!(cells.len(), 8, "{tank}");
    assert_eq!(
        (&cells[1]["name"], &cells[1]["value"]),
        (&json!("address"), &json!(5))
    );
    assert_eq!(cells[1]["fact"], "[EMD-2A2Q §4.2]");
    assert!(
        words["sent"]
            .as_str()
            .expect("text")
            .starts_with("05 03 00 00 00 08")
    );
    assert!(
        words["bytes"]
            .as_str()
            .expect("text")
            .starts_with("05 03 10")
    );
    let oven = read("oven");
    let coils = oven["reads"][0]["cells"].as_array().expect("a list");
    assert_eq!(
        (&coils[0]["at"], &coils[0]["name"]),
        (&json!(60), &json!("k1"))
    );
    let pump = read("pump");
    assert_eq!(pump["protocol"], "ascii");
    for read in pump["reads"].as_array().expect("a list") {
        assert!(
            read["says"].is_string() && read["cells"].is_null(),
            "{read}"
        );
    }
    let yard = read("yard");
    assert_eq!(
        yard["reads"].as_array().expect("a list").len(),
        1,
        "a board has one read"
    );
    let none = daemon.get("/api/v1/modules/none/registers");
    assert_eq!(none.status, 404);
}
