//! `railbus serve` as seen by its clients: HTTP over TCP and over the socket, signals, and what it
//! refuses.

use super::daemon::{Answer, Daemon, exchange, folder, railbus};
use rustix::process::Signal;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

#[test]
fn outputs_are_switched_and_read_back() {
    let daemon = Daemon::demo("write");
    let answer = daemon.put("/api/v1/points/pump/do0", r#"{"value":true}"#);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let done = answer.json();
    assert_eq!(done["value"], true);
    assert_eq!(done["before"], false);
    assert_eq!(done["confirmed"], "readback");
    assert!(done["took_ms"].is_u64());
    assert_eq!(done["audit"].as_str().map(str::len), Some(26));
    let point = daemon.get("/api/v1/points/pump/do0").json();
    assert_eq!(
        (&point["value"], &point["quality"]),
        (&json!(true), &json!("good"))
    );

    let both = daemon.put(
        "/api/v1/modules/oven/outputs",
        r#"{"set":{"k1":true,"k2":false}}"#,
    );
    assert_eq!(
        both.json()["set"]["k1"],
        json!({"value": true, "before": false})
    );

    let pulse = daemon
        .send("POST", "/api/v1/points/oven/k5/pulse", r#"{"ms":200}"#)
        .json();
    assert_eq!((&pulse["by"], &pulse["ms"]), (&json!("host"), &json!(200)));
    daemon.until("the pulse is over", |daemon| {
        daemon.get("/api/v1/points/oven/k5?fresh=1").json()["value"] == false
    });
    let toggle = daemon
        .send("POST", "/api/v1/points/gate/do1/toggle", "")
        .json();
    assert_eq!(
        (&toggle["value"], &toggle["read_then_set"]),
        (&json!(true), &json!(true))
    );
    let fresh = daemon.get("/api/v1/points/tank/ai1?fresh=1").json();
    assert_eq!(fresh["unit"], "V");
    let raw = r#"{"protocol":"rtu","bytes":"03 01 00 3C 00 08 FC 22"}"#;
    let raw = daemon.send("POST", "/api/v1/lines/main/send", raw).json();
    assert_eq!(raw["outcome"], "answered");
}

#[test]
fn a_command_under_a_key_is_done_once() {
    let daemon = Daemon::demo("key");
    let toggle = |body: &str| {
        let head = format!("{}Idempotency-Key: one\r\n", daemon.head());
        exchange(
            daemon.connect(),
            "POST",
            "/api/v1/points/yard/k1/toggle",
            &head,
            body,
        )
    };
    let (first, again) = (toggle(""), toggle(""));
    assert_eq!(first.text(), again.text());
    assert_eq!(
        daemon.get("/api/v1/points/yard/k1?fresh=1").json()["value"],
        true
    );
    assert_eq!(toggle(r#"{"raw":true}"#).status, 422, "another command");
}

#[test]
fn what_can_not_be_done_says_why() {
    let daemon = Daemon::demo("errors");
    let is = |answer: Answer, status, code: &str| {
        assert!(
            answer.head.contains("application/problem+json"),
            "{}",
            answer.head
        );
        assert_eq!(answer.end(), (status, code.to_owned()));
    };
    let on = r#"{"value":true}"#;
    is(daemon.get("/api/v1/points/shed/k1"), 404, "E0801");
    is(daemon.get("/api/v1/points/pump/do9"), 404, "E0802");
    is(daemon.get("/api/v1/points?select=shed"), 404, "E0801");
    is(daemon.put("/api/v1/points/pump/di0", on), 422, "E0807");
    is(
        daemon.put("/api/v1/points/pump/do0", r#"{"value":3}"#),
        422,
        "E0806",
    );
    is(daemon.put("/api/v1/points/pump/do0", "{"), 422, "E0806");
    is(
        daemon.put("/api/v1/points/pump/do0", r#"{"value":true,"if":true}"#),
        409,
        "E0108",
    );
    is(
        daemon.put("/api/v1/modules/pump/outputs", r#"{"set":{}}"#),
        422,
        "E0806",
    );
    let no_reply = r#"{"value":true,"no_reply":true}"#;
    is(daemon.put("/api/v1/points/oven/k1", no_reply), 422, "E0805");
    let width = daemon.send("POST", "/api/v1/points/pump/do3/pulse", r#"{"ms":750}"#);
    let tries = width.json()["hint"].as_array().map(Vec::len);
    is(width, 422, "E0804");
    assert_eq!(tries, Some(2));
    let write = r#"{"protocol":"rtu","bytes":"03 05 00 3C FF 00 4D D4"}"#;
    let send = "/api/v1/lines/main/send";
    is(daemon.send("POST", send, write), 409, "E0458");
    is(daemon.get("/api/v1/nothing"), 404, "E0110");
    is(daemon.send("DELETE", "/api/v1/lines", ""), 405, "E0110");
    let long = format!("{{\"value\":true{}}}", " ".repeat(70_000));
    assert_eq!(daemon.put("/api/v1/points/pump/do0", &long).status, 413);
}

#[test]
fn a_page_of_another_site_gets_nothing() {
    let daemon = Daemon::demo("guard");
    let on = r#"{"value":true}"#;
    let path = "/api/v1/points/pump/do0";
    let port = daemon.address.rsplit(':').next().expect("a port");
    let ask = |method, path, head: &str, body| exchange(daemon.connect(), method, path, head, body);
    for host in ["evil.example", "localhost", "127.0.0.1:1"] {
        let head = format!("Host: {host}\r\n");
        assert_eq!(ask("GET", "/", &head, "").status, 403, "{host}");
    }
    let local = format!("Host: localhost:{port}");
    assert_eq!(ask("GET", "/", &format!("{local}\r\n"), "").status, 200);
    let here = daemon
        .head()
        .replace(&format!("Host: {}", daemon.address), &local);
    let cross = format!("{here}Origin: http://evil.example\r\n");
    let refused = ask("PUT", path, &cross, on);
    assert_eq!(refused.end(), (403, "E0901".to_owned()));
    let own = format!("{here}Origin: http://localhost:{port}\r\n");
    assert_eq!(ask("PUT", path, &own, on).status, 200);
}

#[test]
fn the_socket_and_the_page_and_the_stream() {
    let daemon = Daemon::demo("socket");
    let path = daemon.folder.join("socket");
    let mode = std::fs::metadata(&path)
        .expect("it is there")
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o600);
    let lines = daemon.as_owner("GET", "/api/v1/lines", "").json();
    assert_eq!(lines["lines"][0]["state"], "up");

    // The web page, or where it was not built the page that says how.
    for path in ["/", "/module/pump"] {
        let page = daemon.get(path);
        assert!(page.head.contains("content-security-policy: default-src '"));
        assert!(!page.head.contains("unsafe-inline"), "{}", page.head);
        assert!(
            page.text().starts_with("<!doctype html>"),
            "{}",
            page.text()
        );
    }
    let nothing = daemon.get("/api/v1/nothing");
    assert_eq!(nothing.end(), (404, "E0110".to_owned()));
    assert_eq!(daemon.get("/style.css").status, 200);
    assert_eq!(daemon.get("/healthz").text(), "ok\n");

    let mut stream = BufReader::new(daemon.connect_to_socket());
    let request = b"GET /api/v1/watch?select=pump.do1 HTTP/1.1\r\nHost: any\r\n\r\n";
    stream.get_mut().write_all(request).expect("it takes bytes");
    let mut seen = String::new();
    for value in ["false", "true"] {
        let wanted = format!("\"value\":{value}");
        while !(seen.contains("\"path\":\"pump.do1\"") && seen.contains(&wanted)) {
            seen.clear();
            assert_ne!(stream.read_line(&mut seen).expect("text"), 0, "it ended");
        }
        if value == "false" {
            daemon.put("/api/v1/points/pump/do1", r#"{"value":true}"#);
        }
    }

    let second = railbus()
        .args(["serve", "--demo", "--listen", "127.0.0.1:0", "--socket"])
        .arg(&path)
        .output()
        .expect("it runs");
    assert_eq!(second.status.code(), Some(7), "one daemon at a socket");
}

/// `railbus raw` goes through the daemon, which gets the confirmation.
#[test]
fn a_frame_of_ones_own_goes_through_the_daemon() {
    let daemon = Daemon::demo("raw");
    let raw = |words: &str| {
        let socket = daemon.folder.join("socket");
        let words = words.split(' ');
        let run = railbus()
            .arg("raw")
            .args(words)
            .env("RAILBUS_SOCKET", socket)
            .output();
        let run = run.expect("it runs");
        (
            run.status.code(),
            String::from_utf8_lossy(&run.stderr).into_owned(),
        )
    };
    let k1 = || daemon.get("/api/v1/points/oven/k1?fresh=1").json()["value"].clone();
    assert_eq!(raw("--crc 03 05 00 3C FF 00").0, Some(0));
    assert_eq!(k1(), true);
    let lock = r#"{"locked":true}"#;
    let locked = daemon.send("PATCH", "/api/v1/config/points/oven/k2", lock);
    assert_eq!(locked.status, 200, "{}", locked.text());
    let (code, told) = raw("--crc 03 05 00 3C 00 00");
    assert!(code != Some(0) && told.contains("E0458"), "{told}");
    assert_eq!(k1(), true);
    assert_eq!(raw("--crc 03 05 00 3C 00 00 --override").0, Some(0));
    assert_eq!(k1(), false);
    let all = "55 F5 13 00 00 00 FF 5C";
    let (code, told) = raw(all);
    assert!(code == Some(2) && told.contains("E0202"), "{told}");
    assert_eq!(raw(&format!("{all} --yes")).0, Some(0));
    daemon.until("the yard is read anew", |daemon| {
        daemon.get("/api/v1/points/yard/k1").json()["value"] == true
    });
}

#[test]
fn it_listens_on_this_machine_only() {
    let output = railbus()
        .args(["serve", "--demo", "--listen", "0.0.0.0:7485"])
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(9));
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        told.contains("E0903") && told.contains("--listen 127.0.0.1:7485"),
        "{told}"
    );
}

#[test]
fn it_stops_cleanly() {
    for signal in [Signal::TERM, Signal::INT] {
        let mut daemon = Daemon::demo("stop");
        let idle = TcpStream::connect(&daemon.address).expect("it listens");
        let pulse = daemon.send("POST", "/api/v1/points/oven/k1/pulse", r#"{"ms":600000}"#);
        assert_eq!(pulse.status, 200);
        let start = Instant::now();
        daemon.signal(signal);
        let status = daemon.child.wait().expect("it ends");
        assert!(status.success(), "{status}");
        assert!(
            start.elapsed() < Duration::from_secs(5),
            "{:?}",
            start.elapsed()
        );
        assert!(!daemon.folder.join("socket").exists());
        assert!(TcpStream::connect(&daemon.address).is_err());
        drop(idle);
    }
}

#[test]
fn a_bad_configuration_is_refused_and_changes_nothing() {
    let folder = folder("config");
    let file = folder.join("railbus.toml");
    let good = "[line.main]\nport = \"/dev/railbus-test-nothing\"\n\
                [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
    std::fs::write(&file, good).expect("a file");
    let path = file.to_str().expect("text");
    let mut daemon = Daemon::start("reload", &["--config", path]);
    let oven = |daemon: &Daemon| daemon.get("/api/v1/modules").json()["modules"][0].clone();
    assert_eq!(oven(&daemon)["module"], "oven");
    // Until the first attempt, it is only being opened.
    daemon.until("the port is missed", |daemon| {
        let closed = daemon.put("/api/v1/points/oven/k1", r#"{"value":true}"#);
        closed.status == 503 && closed.json()["reason"] == json!("missing")
    });

    std::fs::write(&file, good.replace("erc8", "erc9")).expect("a file");
    daemon.signal(Signal::HUP);
    daemon.until("it is told", |daemon| {
        daemon.stderr().contains("no changes made")
    });
    let place = format!("{path}:5:9");
    assert!(daemon.stderr().contains(&place), "{}", daemon.stderr());
    assert_eq!(oven(&daemon)["model"], "erc8");
    let check = railbus()
        .args(["serve", "--check", "--config", path])
        .output()
        .expect("it runs");
    assert_eq!(check.status.code(), Some(8));

    std::fs::write(&file, good.replace("oven", "kiln")).expect("a file");
    daemon.signal(Signal::HUP);
    let mut told = String::new();
    daemon.stdout.read_line(&mut told).expect("text");
    assert!(told.contains("kept: main"), "{told}");
    assert_eq!(oven(&daemon)["module"], "kiln");
    let check = railbus()
        .args(["serve", "--check", "--config", path])
        .output()
        .expect("it runs");
    assert!(check.status.success());
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn several_outputs_are_switched_at_once() {
    let daemon = Daemon::demo("several");
    let post = |path: &str, body: &str| daemon.send("POST", &format!("/api/v1/{path}"), body);
    let code = |answer: Answer| answer.end();
    let both = r#"{"set":[{"path":"oven.k1","value":true},{"path":"gate.do0","value":true}]}"#;
    let done = post("batch", both).json();
    assert_eq!(done["results"].as_array().map(Vec::len), Some(2), "{done}");
    for result in done["results"].as_array().expect("a list") {
        assert_eq!(result["value"], true, "{result}");
        assert_eq!(result["confirmed"], "readback", "{result}");
    }
    let id = done["results"][0]["audit"].as_str().expect("a number");
    let command = daemon.get(&format!("/api/v1/commands/{id}")).json();
    assert_eq!(
        (&command["end"], &command["what"]),
        (&json!("readback"), &json!("k1=on"))
    );
    let twice = r#"{"set":[{"path":"oven.k1","value":true},{"path":"oven.k1","value":false}]}"#;
    assert_eq!(code(post("batch", twice)), (422, "E0806".to_owned()));
    let unknown = r#"{"set":[{"path":"oven.k9","value":true}]}"#;
    assert_eq!(code(post("batch", unknown)), (404, "E0802".to_owned()));

    let groups = daemon.get("/api/v1/groups").json();
    assert_eq!(groups["groups"][0]["group"], "night");
    assert_eq!(groups["groups"][0]["frames"], 3);
    let off = post("groups/night/set", r#"{"value":"toggle"}"#).json();
    let is_off = |result: &Value| result["value"] == false;
    assert!(
        off["results"]
            .as_array()
            .expect("a list")
            .iter()
            .all(is_off),
        "{off}"
    );
    assert_eq!(
        code(post("groups/day/set", r#"{"value":true}"#)),
        (404, "E0860".to_owned())
    );
    let played = post("scenes/evening/run", "").json();
    assert_eq!(played["results"][1]["value"], true, "{played}");
    assert_eq!(
        code(post("scenes/morning/run", "")),
        (404, "E0861".to_owned())
    );

    let lease = "/api/v1/points/oven/k3/lease";
    let held = daemon.put(lease, r#"{"value":true,"ttl_ms":60000}"#).json();
    let until = daemon.get("/api/v1/points/oven/k3").json()["lease"]["until"].clone();
    assert!(
        held["until"].is_string() && until.is_string(),
        "{held} {until}"
    );
    assert_eq!(daemon.send("DELETE", lease, "").json()["value"], false);
    assert_eq!(
        code(daemon.send("DELETE", lease, "")),
        (409, "E0454".to_owned())
    );
    let short = daemon.put(lease, r#"{"value":true,"ttl_ms":1}"#);
    assert_eq!(short.json()["reason"], "\"ttl_ms\" is 200 to 3600000");
    assert_eq!(code(short), (422, "E0806".to_owned()));
}

/// Every command takes it, and refuses what it can't be.
#[test]
fn a_command_says_within_which_time_it_must_be_sent() {
    let daemon = Daemon::demo("within");
    let commands = [
        ("PUT", "points/oven/k1", r#""value":true"#),
        ("PUT", "modules/oven/outputs", r#""set":{"k1":true}"#),
        ("POST", "points/oven/k1/toggle", r#""raw":false"#),
        ("POST", "points/oven/k1/pulse", r#""ms":100"#),
        (
            "PUT",
            "points/oven/k1/lease",
            r#""value":true,"ttl_ms":60000"#,
        ),
        (
            "POST",
            "batch",
            r#""set":[{"path":"oven.k1","value":true}]"#,
        ),
        ("POST", "groups/night/set", r#""value":true"#),
        ("POST", "scenes/evening/run", r#""confirm":true"#),
    ];
    for (method, path, body) in commands {
        let give = |within: u32| {
            let body = format!("{{{body},\"within_ms\":{within}}}");
            daemon.send(method, &format!("/api/v1/{path}"), &body)
        };
        assert_eq!(give(60_000).status, 200, "{path}");
        for wrong in [199, 60_001] {
            let refused = give(wrong);
            let reason = refused.json()["reason"].clone();
            assert_eq!(reason, "\"within_ms\" is 200 to 60000", "{path}");
            assert_eq!(refused.status, 422, "{path}");
        }
    }
}
