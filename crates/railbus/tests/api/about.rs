//! What the daemon reports about itself and its lines, and what it records of them.

use crate::daemon::{Daemon, exchange};
use crate::websocket::Client;
use std::io::{BufRead, BufReader, Write};

#[test]
fn it_knows_how_its_line_is_used_and_what_is_wrong() {
    let daemon = Daemon::demo("about");
    let system = daemon.get("/api/v1/system").json();
    assert_eq!(system["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(
        (&system["modules"], &system["points"]),
        (&5.into(), &43.into())
    );
    assert!(system["rss_bytes"].as_u64() > Some(1 << 20));
    let load = daemon.get("/api/v1/lines/main/load").json();
    assert!(load["exchanges"].as_u64() > Some(4), "{load}");
    let busy = load["busy_percent"].as_f64().expect("a number");
    assert!(busy > 0.0 && busy <= 100.0, "{load}");
    assert_eq!(load["polls"].as_array().map(Vec::len), Some(5));
    let none = daemon.get("/api/v1/lines/none/load");
    assert_eq!((none.status, &none.json()["code"]), (404, &"E0803".into()));
    let doctor = daemon.get("/api/v1/doctor?lang=zh").json();
    let findings = doctor["findings"].as_array().expect("a list");
    let modules = findings.iter().find(|found| found["section"] == "modules");
    let modules = modules.expect("the modules are looked at");
    assert_eq!(modules["state"], "ok", "{doctor}");
    for name in ["pump", "gate", "oven", "yard", "tank"] {
        assert!(
            modules["message"]
                .as_str()
                .is_some_and(|m| m.contains(name))
        );
    }
    assert_eq!(daemon.get("/readyz").status, 200);
}

#[test]
fn the_doctor_says_what_is_unwise_with_the_configuration() {
    let daemon = Daemon::demo("doctor-config");
    let config = || {
        let doctor = daemon.get("/api/v1/doctor?lang=en").json();
        let all = doctor["findings"].as_array().expect("a list").clone();
        let of = |found: &serde_json::Value| found["section"] == "config";
        all.into_iter().filter(of).collect::<Vec<_>>()
    };
    let found = config();
    assert_eq!(
        (found.len(), &found[0]["state"]),
        (1, &"ok".into()),
        "{found:?}"
    );
    // More polls than the line has time for.
    let body = r#"{"poll":"10ms"}"#;
    assert_eq!(
        daemon
            .send("PATCH", "/api/v1/config/modules/pump", body)
            .status,
        200
    );
    let text = daemon.get("/api/v1/config").json()["text"].to_string();
    let check = daemon.send(
        "POST",
        "/api/v1/config/check",
        &format!("{{\"text\":{text}}}"),
    );
    let warnings = check.json()["warnings"].as_array().expect("a list").len();
    assert_ne!(warnings, 0, "{}", check.text());
    let found = config();
    assert_eq!(found.len(), warnings, "{found:?}");
    assert!(
        found.iter().all(|one| one["state"] == "warning"),
        "{found:?}"
    );
}

#[test]
fn metrics_say_what_the_line_did() {
    let daemon = Daemon::demo("metrics");
    let answer = daemon.get("/metrics");
    assert_eq!(answer.status, 200);
    assert!(
        answer.head.contains("application/openmetrics-text"),
        "{}",
        answer.head
    );
    let text = answer.text();
    assert!(text.ends_with("# EOF\n"), "{text}");
    let of = |start: &str| -> f64 {
        let line = text.lines().find(|line| line.starts_with(start));
        let value = line.and_then(|line| line.rsplit_once(' '));
        value
            .unwrap_or_else(|| panic!("{start} in {text}"))
            .1
            .parse()
            .expect("a number")
    };
    let labels = r#"line="main",module="pump",protocol="ascii""#;
    let asked = of(&format!("railbus_requests_total{{{labels},result=\"ok\"}}"));
    assert!(asked >= 1.0);
    assert_eq!(
        of(&format!("railbus_request_seconds_count{{{labels}}}")),
        asked
    );
    // Every histogram ends with a bucket without an end.
    let last = format!("railbus_request_seconds_bucket{{le=\"+Inf\",{labels}}}");
    assert_eq!(of(&last), asked);
    assert_eq!(of(r#"railbus_module_up{line="main",module="pump"}"#), 1.0);
    assert!(of(r#"railbus_line_busy_ratio{line="main"}"#) > 0.0);
    assert!(
        !text.contains("railbus_point_value"),
        "only where it is asked for"
    );
    let points = daemon.get("/metrics?points=1");
    assert!(
        points
            .text()
            .contains(r#"railbus_point_value{module="pump",point="do0"} 0"#)
    );
}

#[test]
fn what_passes_is_recorded_for_some_seconds() {
    let daemon = Daemon::demo("capture");
    let file = daemon.get("/api/v1/frames?seconds=1");
    assert_eq!(file.status, 200, "{}", file.head);
    assert!(file.head.contains("frames.pcapng"), "{}", file.head);
    // The block that begins every such file, in the order of bytes of this machine.
    assert_eq!(file.body[..4], [0x0A, 0x0D, 0x0D, 0x0A]);
    assert!(file.body.len() > 500, "{}", file.body.len());
    let text = daemon.get("/api/v1/frames?seconds=1&format=ndjson&line=main");
    let frames: Vec<serde_json::Value> = text
        .text()
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert!(frames.len() > 4, "{}", frames.len());
    // A busy machine may delay a simulated module in the middle of a frame: that is reported.
    let whole = frames.iter().filter(|frame| frame["verdict"] == "ok");
    assert!(2 * whole.count() > frames.len(), "{}", text.text());
    for wrong in ["seconds=0", "seconds=601", "seconds=x", "format=doc"] {
        let refused = daemon.get(&format!("/api/v1/frames?{wrong}"));
        assert_eq!(refused.status, 422, "{wrong}");
    }
    assert_eq!(daemon.get("/api/v1/frames?line=none").status, 404);
}

#[test]
fn events_are_told_as_they_happen() {
    let daemon = Daemon::demo("events");
    let mut client = Client::open(&daemon);
    client.send(r#"{"sub":["events"]}"#);
    client.until("it begins", |m| m["type"] == "snapshot");
    let mut stream = daemon.connect();
    write!(
        stream,
        "GET /api/v1/events/stream HTTP/1.1\r\n{}\r\n",
        daemon.head()
    )
    .expect("bytes");
    let mut lines = BufReader::new(stream)
        .lines()
        .map(|line| line.expect("text"));
    assert!(lines.any(|line| line.starts_with(':')), "it has begun");
    let answer = daemon.send("PUT", "/api/v1/points/oven/k1", r#"{"value":true}"#);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let told = client.until("the write is told", |m| m["type"] == "delta");
    let event = &told["events"][0];
    assert_eq!(
        (&event["kind"], &event["module"]),
        (&"write".into(), &"oven".into())
    );
    let data = lines.find_map(|line| line.strip_prefix("data: ").map(str::to_owned));
    let data: serde_json::Value = serde_json::from_str(&data.expect("an event")).expect("JSON");
    assert_eq!(&data, event);
}

#[test]
fn nobody_unknown_reads_metrics_or_listens() {
    let daemon = Daemon::demo("unknown");
    let host = format!("Host: {}\r\n", daemon.address);
    for path in [
        "/metrics",
        "/api/v1/ws",
        "/api/v1/frames",
        "/api/v1/ops",
        "/api/v1/events/stream",
    ] {
        let answer = exchange(daemon.connect(), "GET", path, &host, "");
        assert_eq!(answer.status, 401, "{path}");
        assert!(answer.head.contains("application/problem+json"), "{path}");
    }
    for path in ["/healthz", "/readyz", "/api/v1/openapi.json"] {
        let answer = exchange(daemon.connect(), "GET", path, &host, "");
        assert_eq!(answer.status, 200, "{path}");
    }
}
