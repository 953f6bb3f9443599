//! What the daemon remembers: samples, events, and the log of what was done. Nothing here uses a
//! crate of railbus.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A daemon that is stopped at the end of the test, however that comes.
struct Daemon {
    child: Child,
    folder: PathBuf,
}

impl Daemon {
    fn demo(name: &str) -> Daemon {
        let folder = folder(name);
        let child = start(&folder, &["--demo"]);
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

    /// Waits until the history knows that the output of the pump was switched on.
    fn switched_on(&self) {
        self.until("the sample is kept", |daemon| {
            let history = daemon.get("/api/v1/history?point=pump.do0").json();
            let samples = history["samples"].as_array().expect("few").clone();
            let last = samples.last().expect("one at least");
            history["raw"] == true && last["v"] == 1.0 && last["q"] == "good"
        });
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

fn start(folder: &Path, site: &[&str]) -> Child {
    let mut child = Command::new(env!("CARGO_BIN_EXE_railbus"))
        .env("RAILBUS_LANG", "en")
        .env("TMPDIR", folder)
        .env_remove("RAILBUS_STATE")
        .env_remove("RAILBUS_CONFIG")
        .args(["serve", "--listen", "127.0.0.1:0", "--socket"])
        .arg(folder.join("socket"))
        .args(site)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("railbus starts");
    let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    loop {
        let mut line = String::new();
        assert_ne!(stdout.read_line(&mut line).expect("text"), 0, "it ended");
        if line.contains("Ctrl-C") {
            break;
        }
    }
    child
}

/// A folder of this test alone.
fn folder(name: &str) -> PathBuf {
    let unique = format!("railbus-past-{}-{name}", std::process::id());
    let folder = std::env::temp_dir().join(unique);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
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

    daemon.switched_on();
    let history = daemon.get("/api/v1/history?point=pump.do0").json();
    let mut values: Vec<&Value> = history["samples"]
        .as_array()
        .expect("few")
        .iter()
        .map(|sample| &sample["v"])
        .collect();
    // A machine under load may find a value stale in between.
    values.dedup();
    assert_eq!(values, [&json!(0.0), &json!(1.0)]);
    let unit = daemon.get("/api/v1/history?point=tank.ai1").json();
    assert!(unit["unit"].is_string(), "{unit}");
    let storage = daemon.get("/api/v1/storage").json();
    assert!(storage["samples"].as_u64() >= Some(43), "{storage}");
    assert_eq!(storage["failing"], false);
}

/// What the command line shows.
fn run(folder: &Path, line: &str) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_railbus"))
        .env("RAILBUS_LANG", "en")
        .env_remove("RAILBUS_CONFIG")
        .args(line.split(' '))
        .arg("--socket")
        .arg(folder.join("socket"))
        .output()
        .expect("railbus starts");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    let code = output.status.code().expect("it ended by itself");
    (code, text(output.stdout), text(output.stderr))
}

#[test]
fn the_command_line_shows_what_a_point_was() {
    let daemon = Daemon::demo("command");
    daemon.put("/api/v1/points/pump/do0", r#"{"value":true}"#);
    daemon.switched_on();
    let (code, table, _) = run(&daemon.folder, "history pump.do0 --since 1d");
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(code, 0);
    assert!(lines[0].starts_with("TIME"), "{table}");
    assert!(lines[1].ends_with("off    good"), "{table}");
    let last = lines.last().expect("more than a head");
    assert!(last.ends_with("on     good"), "{table}");
    let (_, json, _) = run(&daemon.folder, "history pump.do0 -o json");
    let told: Value = serde_json::from_str(&json).expect("JSON");
    let (_, schema, _) = run(&daemon.folder, "schema history");
    let schema = serde_json::from_str(&schema).expect("JSON");
    let valid = jsonschema::validator_for(&schema).expect("a schema");
    assert!(valid.is_valid(&told), "{told}");
    let last = told["history"].as_array().and_then(|all| all.last());
    assert_eq!(last.map(|sample| &sample["value"]), Some(&json!(1.0)));

    let (code, _, why) = run(&daemon.folder, "history pump.no");
    assert!(code == 8 && why.contains("E0802"), "{code}: {why}");
    let (code, _, why) = run(&daemon.folder.join("nobody"), "history pump.do0");
    assert!(code == 1 && why.contains("E0170"), "{code}: {why}");
}

/// Whether each of these texts is what `railbus audit -o json` is published to say.
fn is_published(folder: &Path, texts: &[&str]) -> bool {
    let (_, schema, _) = run(folder, "schema audit");
    let schema = serde_json::from_str(&schema).expect("JSON");
    let valid = jsonschema::validator_for(&schema).expect("a schema");
    let told = texts
        .iter()
        .map(|text| serde_json::from_str(text).expect("JSON"));
    told.into_iter().all(|told: Value| valid.is_valid(&told))
}

#[test]
fn the_command_line_checks_and_prints_the_audit_log() {
    let mut daemon = Daemon::demo("audit");
    daemon.put("/api/v1/points/pump/do0", r#"{"value":true}"#);
    let (code, text, _) = run(&daemon.folder, "audit verify");
    assert_eq!(
        (code, text.as_str()),
        (0, "whole: 1 entries, 3 records from number 1 on\n")
    );
    let (_, verified, _) = run(&daemon.folder, "audit verify -o json");
    let (_, records, _) = run(&daemon.folder, "audit export");
    let texts: Vec<&str> = std::iter::once(verified.as_str())
        .chain(records.lines())
        .collect();
    assert_eq!(texts.len(), 4, "{records}");
    assert!(is_published(&daemon.folder, &texts), "{texts:?}");
    let (_, told, _) = run(&daemon.folder, "audit export -o csv");

    // The same of files that no daemon has: those of a site whose daemon was killed.
    let state = daemon.get("/api/v1/config").json()["file"].clone();
    let state = Path::new(state.as_str().expect("a path"))
        .parent()
        .expect("a folder")
        .join(".railbus");
    let copy = daemon.folder.join(".railbus");
    std::fs::create_dir_all(&copy).expect("a folder");
    for name in ["audit.log", "audit.head"] {
        std::fs::copy(state.join(name), copy.join(name)).expect("a copy");
    }
    daemon.child.kill().expect("it runs");
    let config = daemon.folder.join("railbus.toml");
    std::fs::write(&config, "").expect("a file");
    let of_files = |command: &str| {
        run(
            &daemon.folder,
            &format!("{command} --config {}", config.display()),
        )
    };
    assert_eq!(of_files("audit verify").1, text);
    assert_eq!(of_files("audit export -o csv").1, told);
    let log = copy.join("audit.log");
    let changed = std::fs::read_to_string(&log)
        .expect("text")
        .replace("do0=on", "do1=on");
    std::fs::write(&log, changed).expect("a file");
    let (code, _, why) = of_files("audit verify");
    assert!(
        code == 8 && why.contains("E0894") && why.contains("record 2"),
        "{code}: {why}"
    );
    std::fs::remove_file(&log).expect("a file");
    let (code, _, why) = of_files("audit export");
    assert!(code == 1 && why.contains("E0170"), "{code}: {why}");
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
fn files_are_exported() {
    let daemon = Daemon::demo("export");
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
}

/// A site whose line has no port: what is tried is written down all the same.
const SITE: &str = r#"
[line.main]
port = "/dev/no-such-port"

[module.oven]
line = "main"
model = "erc8"
address = 3

[history]
keep = "30d"
max_bytes = "100MB"

[audit]
required = true
"#;

#[test]
fn what_was_done_outlives_the_daemon() {
    let folder = folder("restart");
    let file = folder.join("railbus.toml");
    std::fs::write(&file, SITE).expect("a file");
    let config = file.display().to_string();
    let site = ["--config", config.as_str()];
    let mut daemon = Daemon {
        child: start(&folder, &site),
        folder,
    };
    let refused = daemon.put("/api/v1/points/oven/k1", r#"{"value":true}"#);
    assert_eq!(refused.json()["code"], "E0710", "{}", refused.body);
    let storage = daemon.get("/api/v1/storage").json();
    let kept = (&storage["keep_ms"], &storage["max_bytes"]);
    assert_eq!(kept, (&json!(30_i64 * 86_400_000), &json!(100_000_000)));

    // As if the power had failed.
    daemon.child.kill().expect("it runs");
    daemon.child.wait().expect("it ends");
    daemon.child = start(&daemon.folder, &site);
    let audit = daemon.get("/api/v1/audit").json();
    assert_eq!(audit["items"].as_array().map(Vec::len), Some(1));
    assert_eq!(audit["items"][0]["end"], "closed");
    assert_eq!(daemon.get("/api/v1/audit/verify").json()["ok"], true);
    let events = daemon.get("/api/v1/events?kind=system").json();
    let items = events["items"].as_array().expect("some");
    let starts = items.iter().filter(|event| event["code"] == "started");
    assert_eq!(starts.count(), 2, "{events}");
}
