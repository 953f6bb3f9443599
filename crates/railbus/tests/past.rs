//! What the daemon remembers: samples, events, and the log of what was done. Nothing here uses a
//! crate of railbus.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A daemon that is stopped at the end of the test, however that comes.
struct Daemon {
    child: Child,
    folder: PathBuf,
}

impl Daemon {
    fn demo(name: &str) -> Daemon {
        let unique = format!("railbus-past-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        std::fs::create_dir_all(&folder).expect("a folder");
        let child = start(&folder);
        let daemon = Daemon { child, folder };
        daemon.until("all are good", |daemon| {
            let points = daemon.get("/api/v1/points").json();
            let points = points["points"].as_array().expect("a list").clone();
            points.iter().all(|point| point["quality"] == "good")
        });
        daemon
    }

    fn send(&self, method: &str, path: &str, headers: &str, body: &str) -> Answer {
        let socket = self.folder.join("socket");
        let mut stream = UnixStream::connect(socket).expect("it listens");
        let len = body.len();
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nConnection: close\r\nHost: localhost\r\n{headers}\
             Content-Length: {len}\r\n\r\n{body}"
        )
        .expect("it takes bytes");
        let mut text = String::new();
        stream.read_to_string(&mut text).expect("text");
        let (head, body) = text.split_once("\r\n\r\n").expect("a head");
        let status = head.split(' ').nth(1).expect("a status");
        Answer {
            status: status.parse().expect("a number"),
            body: body.to_owned(),
        }
    }

    fn get(&self, path: &str) -> Answer {
        self.send("GET", path, "", "")
    }

    fn put(&self, path: &str, body: &str) -> Answer {
        self.send("PUT", path, "", body)
    }

    fn until(&self, what: &str, done: impl Fn(&Daemon) -> bool) {
        let start = Instant::now();
        while !done(self) {
            let waited = start.elapsed();
            assert!(waited < Duration::from_secs(60), "{what}: it never came");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

/// The state lies where the test can look at it.
fn start(folder: &std::path::Path) -> Child {
    let mut child = Command::new(env!("CARGO_BIN_EXE_railbus"))
        .env("RAILBUS_LANG", "en")
        .env("RAILBUS_STATE", folder.join("state"))
        .env_remove("RAILBUS_CONFIG")
        .args(["serve", "--demo", "--listen", "127.0.0.1:0", "--socket"])
        .arg(folder.join("socket"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("railbus starts");
    let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    loop {
        let mut line = String::new();
        assert_ne!(stdout.read_line(&mut line).expect("text"), 0, "it ended");
        if line.contains("Ctrl-C") {
            return child;
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// What came back.
struct Answer {
    status: u16,
    body: String,
}

impl Answer {
    fn json(&self) -> Value {
        serde_json::from_str(&self.body).expect("JSON")
    }

    /// The lines of a body that came in chunks, without what is between them.
    fn lines(&self) -> Vec<&str> {
        let lines = self.body.split("\r\n").flat_map(|part| part.split('\n'));
        lines.filter(|line| line.contains([',', '{'])).collect()
    }
}

#[test]
fn a_write_is_in_the_history_the_events_and_the_audit_log() {
    let daemon = Daemon::demo("write");
    let done = daemon
        .put("/api/v1/points/pump/do0", r#"{"value":true}"#)
        .json();
    let id = done["audit"].as_str().expect("a number").to_owned();

    let audit = daemon.get("/api/v1/audit?point=pump.do0").json();
    let entry = &audit["items"][0];
    let told = ["id", "who", "module", "what", "before", "after", "end"].map(|key| &entry[key]);
    let wanted = [
        &id, "owner", "pump", "do0=on", "do0=off", "do0=on", "readback",
    ];
    assert_eq!(told.map(|text| text.as_str().unwrap_or_default()), wanted);
    let verified = daemon.get("/api/v1/audit/verify").json();
    assert_eq!(
        (&verified["ok"], &verified["entries"]),
        (&json!(true), &json!(1))
    );

    let events = daemon.get("/api/v1/events?kind=write").json();
    let event = &events["items"][0];
    assert_eq!(
        (&event["id"], &event["point"]),
        (&json!(id), &json!("pump.do0"))
    );
    assert_eq!(
        (&event["who"], &event["end"]),
        (&json!("owner"), &json!("readback"))
    );
    let ack = format!("/api/v1/events/{id}/ack");
    let acked = daemon.send("POST", &ack, "", r#"{"comment":"好"}"#).json();
    assert_eq!(acked["acked"]["comment"], "好");
    let nobody = daemon.send("POST", "/api/v1/events/nobody/ack", "", "");
    assert_eq!(
        (nobody.status, &nobody.json()["code"]),
        (404, &json!("E0173"))
    );

    daemon.until("the sample is kept", |daemon| {
        let history = daemon.get("/api/v1/history?point=pump.do0").json();
        let samples = history["samples"].as_array().expect("few").clone();
        let last = samples.last().expect("one at least");
        history["raw"] == true && last["v"] == 1.0 && last["q"] == "good"
    });
    let history = daemon.get("/api/v1/history?point=pump.do0").json();
    let values: Vec<&Value> = history["samples"]
        .as_array()
        .expect("few")
        .iter()
        .map(|sample| &sample["v"])
        .collect();
    assert_eq!(values, [&json!(0.0), &json!(1.0)]);
    let unit = daemon.get("/api/v1/history?point=tank.ai1").json();
    assert!(unit["unit"].is_string(), "{unit}");
    let storage = daemon.get("/api/v1/storage").json();
    assert!(storage["samples"].as_u64() >= Some(43), "{storage}");
    assert_eq!(storage["failing"], false);
}

#[test]
fn what_is_asked_for_wrongly_is_refused() {
    let daemon = Daemon::demo("wrong");
    for (path, status, code) in [
        ("/history", 422, "E0806"),
        ("/history?point=pump.no", 404, "E0802"),
        ("/history?point=pump.do0&from=yesterday", 422, "E0806"),
        ("/history?point=pump.do0&from=5&to=4", 422, "E0806"),
        ("/history?point=pump.do0&buckets=-1", 422, "E0806"),
        ("/history/export?point=", 422, "E0806"),
        ("/history/export?point=pump.do0&format=xls", 422, "E0806"),
        ("/events?kind=party", 422, "E0806"),
        ("/events?limit=100000", 422, "E0806"),
        ("/audit?cursor=x", 422, "E0806"),
        ("/audit?point=pump", 422, "E0806"),
    ] {
        let answer = daemon.get(&format!("/api/v1{path}"));
        let told = (answer.status, answer.json()["code"].clone());
        assert_eq!(told, (status, json!(code)), "{path}");
    }
}

#[test]
fn files_are_exported_and_kept_over_a_restart() {
    let mut daemon = Daemon::demo("export");
    daemon.put("/api/v1/points/pump/do0", r#"{"value":true}"#);
    let csv = daemon.get("/api/v1/history/export?point=pump.do0,pump.do1&format=csv");
    let lines = csv.lines();
    assert_eq!(lines[0], "time,point,value,quality");
    assert!(lines[1].contains(",pump.do0,0,good"), "{lines:?}");
    assert!(lines.iter().any(|line| line.contains(",pump.do1,")));
    let chinese = daemon.get("/api/v1/audit/export?format=csv&lang=zh");
    assert!(chinese.lines()[0].starts_with("\u{FEFF}seq,at,kind"));
    let ndjson = daemon.get("/api/v1/audit/export?format=ndjson");
    let kinds: Vec<Value> = ndjson
        .lines()
        .iter()
        .filter_map(|line| serde_json::from_str::<Value>(line).ok())
        .map(|record| record["kind"].clone())
        .collect();
    assert_eq!(kinds, ["start", "begin", "end"]);

    // As if the power had failed.
    daemon.child.kill().expect("it runs");
    daemon.child.wait().expect("it ends");
    daemon.child = start(&daemon.folder);
    let audit = daemon.get("/api/v1/audit").json();
    assert_eq!(audit["items"].as_array().map(Vec::len), Some(1));
    assert_eq!(audit["items"][0]["end"], "readback");
    assert_eq!(daemon.get("/api/v1/audit/verify").json()["ok"], true);
    let events = daemon.get("/api/v1/events").json();
    let codes: Vec<&Value> = events["items"]
        .as_array()
        .expect("some")
        .iter()
        .map(|event| &event["code"])
        .collect();
    let starts = codes.iter().filter(|code| ***code == json!("started"));
    assert_eq!(starts.count(), 2, "{codes:?}");
}
