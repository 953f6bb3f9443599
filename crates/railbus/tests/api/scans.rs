//! Scans of the daemon for a page.

use crate::daemon::{Daemon, folder};
use crate::liar::slave;
use crate::websocket::Client;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

fn begin(daemon: &Daemon, wanted: &Value) -> String {
    let begun = daemon.send("POST", "/api/v1/scans", &wanted.to_string());
    assert_eq!(begun.status, 202, "{}", begun.text());
    begun.json()["op"].as_str().expect("a number").to_owned()
}

#[test]
fn a_scan_finds_everyone_while_the_modules_are_polled() {
    let daemon = Daemon::demo("scan");
    let op = begin(&daemon, &json!({"depth": "quick", "addresses": "1-8"}));
    let mut client = Client::open(&daemon);
    client.send(&json!({"sub": [format!("ops/{op}")]}).to_string());
    let first = client.next().expect("how it is");
    assert_eq!(first["type"], "snapshot", "{first}");
    let mut percent = first["data"]["percent"].as_f64().expect("a number");
    let mut steps = 0;
    let end = loop {
        let told = client.next().expect("how it goes on");
        let now = told["op"]["percent"].as_f64().expect("a number");
        assert!(now >= percent, "{now} after {percent}");
        percent = now;
        steps += 1;
        if told["op"]["state"] != "running" {
            break told["op"].clone();
        }
    };
    assert!(steps > 3, "{steps}");
    assert_eq!(end["state"], "done", "{end}");
    assert_eq!(
        (&end["percent"], &end["left_ms"]),
        (&json!(100.0), &json!(0))
    );
    assert_eq!(end["result"]["complete"], true);
    assert_eq!(end["result"]["missing"], json!([]));
    let modules = end["result"]["modules"].as_array().expect("a list");
    let known = daemon.get("/api/v1/modules").json();
    for module in known["modules"].as_array().expect("a list") {
        let found = modules
            .iter()
            .find(|found| found["name"] == module["module"]);
        let found = found.unwrap_or_else(|| panic!("{} in {end}", module["module"]));
        for same in ["line", "address", "protocol", "baud", "format"] {
            assert_eq!(found[same], module[same], "{same}");
        }
        assert!(!found["evidence"].as_array().expect("a list").is_empty());
    }
    assert_eq!(daemon.get(&format!("/api/v1/ops/{op}")).json(), end);
    let points = daemon.get("/api/v1/points").json();
    let points = points["points"].as_array().expect("a list").clone();
    assert!(
        points.iter().all(|point| point["quality"] == "good"),
        "it went beside the polls"
    );
}

#[test]
fn a_scan_is_ended_by_whoever_may_and_what_it_found_stays() {
    let daemon = Daemon::demo("cancel");
    let op = begin(&daemon, &json!({"lines": ["main"], "depth": "deep"}));
    let second = daemon.send("POST", "/api/v1/scans", r#"{"lines":["main"]}"#);
    assert_eq!(second.status, 409, "{}", second.text());
    assert_eq!(second.json()["code"], "E0210");
    assert_eq!(second.json()["op"], json!(op));
    let path = format!("/api/v1/ops/{op}");
    daemon.until("the known modules are found", |daemon| {
        daemon.get(&path).json()["found"].as_u64() >= Some(1)
    });
    let ended = daemon.send("DELETE", &path, "");
    assert_eq!(ended.status, 200);
    let ended = ended.json();
    assert_eq!(ended["state"], "cancelled");
    assert_eq!(ended["result"]["complete"], false);
    let left_out = ended["result"]["left_out"].as_array().expect("a list");
    assert!(!left_out.is_empty());
    assert!(ended["found"].as_u64() >= Some(1));
    assert_eq!(daemon.send("DELETE", &path, "").json(), ended, "again");
    let next = begin(&daemon, &json!({"addresses": "1"}));
    let all = daemon.get("/api/v1/ops").json();
    let all = all["ops"].as_array().expect("a list");
    assert_eq!(all.len(), 2);
    assert_eq!(all[1]["op"], json!(next));
}

#[test]
fn what_can_not_be_scanned_is_refused() {
    let daemon = Daemon::demo("scan-refuse");
    for (wanted, status, code) in [
        (json!({"lines": ["none"]}), 404, "E0803"),
        (json!({"depth": "deeper"}), 422, "E0806"),
        (json!({"protocols": ["x"]}), 422, "E0806"),
        (json!({"bauds": [1]}), 422, "E0806"),
        (json!({"addresses": "9-1"}), 422, "E0806"),
        (json!({"addresses": "1-300"}), 422, "E0806"),
        (json!({"protocols": []}), 422, "E0806"),
        (json!({"everything": true}), 422, "E0806"),
    ] {
        let refused = daemon.send("POST", "/api/v1/scans", &wanted.to_string());
        assert_eq!(refused.status, status, "{wanted}: {}", refused.text());
        assert_eq!(refused.json()["code"], code, "{wanted}");
    }
    let unknown = daemon.get("/api/v1/ops/01ARZ3NDEKTSV4RRFFQ69G5FAV");
    assert_eq!(
        (unknown.status, &unknown.json()["code"]),
        (404, &json!("E0110"))
    );
    assert_eq!(daemon.get("/api/v1/ops").json()["ops"], json!([]));
}

/// Lines on which a module was found only by waiting longer are named.
#[test]
fn a_line_on_which_modules_are_slow_is_named() {
    // A module answers only the second request, and later than the reply timeout, whether or not
    // the machine is busy.
    let late = Duration::from_millis(60);
    let asked = AtomicUsize::new(0);
    let port = slave(move |_, frame| match frame {
        [1, 1, 0, 0, 0, 8, ..] if asked.fetch_add(1, Ordering::Relaxed) % 2 == 1 => {
            let mut reply = vec![1, 1, 1, 0];
            reply.extend(railbus_wire::crc16(&reply).to_le_bytes());
            vec![(late, reply)]
        }
        _ => Vec::new(),
    });
    let folder = folder("scan-slow");
    let file = folder.join("railbus.toml");
    std::fs::write(&file, format!("[line.far]\nport = \"pty:{port}\"\n")).expect("a file");
    let daemon = Daemon::start_in(folder, &["--config", file.to_str().expect("text")]);
    daemon.until("the line is open", |daemon| {
        daemon.get("/api/v1/lines").json()["lines"][0]["state"] == "up"
    });
    let slow = |addresses: &str| {
        let wanted = json!({"addresses": addresses, "protocols": ["rtu"]});
        let path = format!("/api/v1/ops/{}", begin(&daemon, &wanted));
        daemon.until("it is done", |daemon| {
            daemon.get(&path).json()["state"] == "done"
        });
        let result = daemon.get(&path).json()["result"].clone();
        assert_eq!(result["modules"][0]["address"], 1, "{result}");
        result["slow"].clone()
    };
    assert_eq!(slow("1-17"), json!(["far"]));
    // All were waited for.
    assert_eq!(slow("1-2"), json!([]));
}
