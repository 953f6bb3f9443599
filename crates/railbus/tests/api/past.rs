//! The daemon's history: samples, events, and the audit log.

use super::daemon::{Daemon, folder, railbus};
use serde_json::{Value, json};
use std::path::Path;

/// Waits until the history knows that the output of the pump was switched on.
fn switched_on(daemon: &Daemon) {
    daemon.until("the sample is kept", |daemon| {
        let history = daemon.get("/api/v1/history?point=pump.do0").json();
        let samples = history["samples"].as_array().expect("few").clone();
        let last = samples.last().expect("one at least");
        history["raw"] == true && last["v"] == 1.0 && last["q"] == "good"
    });
}

#[test]
fn a_write_is_in_the_history_the_events_and_the_audit_log() {
    let daemon = Daemon::demo("write");
    let done = daemon.as_owner("PUT", "/api/v1/points/pump/do0", r#"{"value":true}"#);
    let done = done.json();
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
    let acked = daemon.send("POST", &ack, r#"{"comment":"好"}"#).json();
    assert_eq!(acked["acked"]["comment"], "好");
    let nobody = daemon.send("POST", "/api/v1/events/nobody/ack", "");
    assert_eq!(nobody.end(), (404, "E0173".to_owned()));

    switched_on(&daemon);
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

/// What the command line shows of the daemon in this folder.
fn run(folder: &Path, line: &str) -> (i32, String, String) {
    run_with(line, "--socket", &folder.join("socket"))
}

/// What it shows from the files of this configuration without a daemon.
fn run_on_files(config: &Path, line: &str) -> (i32, String, String) {
    run_with(line, "--config", config)
}

fn run_with(line: &str, flag: &str, path: &Path) -> (i32, String, String) {
    let output = railbus()
        .args(line.split(' '))
        .arg(flag)
        .arg(path)
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
    switched_on(&daemon);
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
    assert!(code == 1 && why.contains("E0109"), "{code}: {why}");
}

#[test]
fn the_command_line_shows_as_much_of_a_history_as_is_wanted() {
    let daemon = Daemon::demo("limits");
    daemon.until("several samples are kept", |daemon| {
        let history = daemon.get("/api/v1/history?point=tank.ai1").json();
        history["samples"].as_array().map_or(0, Vec::len) >= 8
    });
    let run = |line: &str| run(&daemon.folder, line);
    let rows = |text: &str| text.lines().count() - 1;

    let (code, table, note) = run("history tank.ai1 --limit 3");
    assert_eq!((code, rows(&table)), (0, 3), "{table}");
    assert!(note.contains("--limit"), "more is there: {note}");
    let (_, all, note) = run("history tank.ai1 --limit 4000");
    assert_eq!(note, "");
    // These were the last ones: five and more came before them, and some since.
    let samples = |table: &str| table.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    let (last, all) = (samples(&table), samples(&all));
    let at = all.windows(3).position(|three| *three == last);
    assert!(at.is_some_and(|at| at >= 5), "{last:#?}{all:#?}");

    let (code, json, _) = run("history tank.ai1 --since 1h --step 10m -o json");
    let told: Value = serde_json::from_str(&json).expect("JSON");
    let steps = told["history"].as_array().expect("steps").clone();
    assert!(code == 0 && (1..=6).contains(&steps.len()), "{json}");
    let mean = steps.last().expect("one")["value"]
        .as_f64()
        .expect("a mean");
    assert!(
        (mean * 100.0 - (mean * 100.0).round()).abs() < 1e-6,
        "{mean}"
    );
    let (_, table, _) = run("history tank.ai1 --step 10m");
    assert!(table.starts_with("FROM"), "{table}");
    assert!(table.contains("MEAN") && table.contains("MIN") && table.contains("MAX"));

    // Before the daemon was there, nothing was.
    let (code, none, _) = run("history tank.ai1 --since 2h --until 1h -o csv");
    assert_eq!((code, rows(&none)), (0, 0), "{none}");
    let (_, csv, _) = run("history pump.di0 -o csv");
    assert!(
        csv.lines()
            .last()
            .is_some_and(|last| last.contains("Z,off,")),
        "{csv}"
    );
    for wrong in [
        "--limit 0",
        "--limit 9999999",
        "--step 0s",
        "--since 1h --until 2h",
        "--until never",
    ] {
        let (code, _, why) = run(&format!("history tank.ai1 {wrong}"));
        assert_eq!(code, 2, "{wrong}: {why}");
    }
    let (code, _, why) = run("history tank.ai1 --since 2d --step 1s");
    assert!(code == 1 && why.contains("E0174"), "{why}");
}

/// A long history without a given step is shown in steps and does not flood the terminal.
#[test]
fn a_long_history_is_parted_into_steps() {
    let daemon = Daemon::demo("flood-of-samples");
    let kept = |daemon: &Daemon| {
        let history = daemon
            .get("/api/v1/history?point=tank.ai1&limit=200")
            .json();
        history["samples"].as_array().map_or(0, Vec::len)
    };
    daemon.until("more samples are kept than are shown", |daemon| {
        kept(daemon) > 101
    });
    let (code, table, note) = run(&daemon.folder, "history tank.ai1");
    assert_eq!(code, 0, "{note}");
    assert!(table.lines().count() <= 101, "{table}");
    assert!(table.starts_with("FROM"), "{table}");
    assert!(
        note.contains("--step") && note.contains("--limit"),
        "{note}"
    );
}

/// Whether each of these texts is as published for `railbus audit -o json`.
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
        (0, "intact: entries 1, records 3, from number 1\n")
    );
    let (_, verified, _) = run(&daemon.folder, "audit verify -o json");
    let (_, records, _) = run(&daemon.folder, "audit export");
    let texts: Vec<&str> = std::iter::once(verified.as_str())
        .chain(records.lines())
        .collect();
    assert_eq!(texts.len(), 4, "{records}");
    assert!(is_published(&daemon.folder, &texts), "{texts:?}");
    let (_, told, _) = run(&daemon.folder, "audit export -o csv");

    // The same for files without a daemon: those of a site whose daemon was killed.
    let file = daemon.get("/api/v1/config").json()["file"].clone();
    let file = Path::new(file.as_str().expect("a path"));
    let state = file.parent().expect("a folder").join(".railbus");
    let copy = daemon.folder.join(".railbus");
    std::fs::create_dir_all(&copy).expect("a folder");
    for name in ["audit.log", "audit.head"] {
        std::fs::copy(state.join(name), copy.join(name)).expect("a copy");
    }
    // While a daemon that answers elsewhere writes the log, it can't be verified.
    let held = run_on_files(file, "audit verify");
    assert!(held.0 == 1 && held.2.contains("E0175"), "{held:?}");
    daemon.child.kill().expect("it runs");
    let config = daemon.folder.join("railbus.toml");
    std::fs::write(&config, "").expect("a file");
    let of_files = |command: &str| run_on_files(&config, command);
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
        let told = daemon.get(&format!("/api/v1{path}")).end();
        assert_eq!(told, (status, code.to_owned()), "{path}");
    }
}

#[test]
fn files_are_exported() {
    let daemon = Daemon::demo("export");
    daemon.put("/api/v1/points/pump/do0", r#"{"value":true}"#);
    let csv = daemon.get("/api/v1/history/export?point=pump.do0,pump.do1&format=csv");
    let lines: Vec<&str> = csv.text().lines().collect();
    assert_eq!(lines[0], "time,point,value,quality");
    assert!(lines[1].contains(",pump.do0,0,good"), "{lines:?}");
    assert!(lines.iter().any(|line| line.contains(",pump.do1,")));
    let chinese = daemon.get("/api/v1/audit/export?format=csv&lang=zh");
    assert!(chinese.text().starts_with("\u{FEFF}seq,at,kind"));
    let ndjson = daemon.get("/api/v1/audit/export?format=ndjson");
    let kinds: Vec<Value> = ndjson
        .text()
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).expect("JSON")["kind"].clone())
        .collect();
    assert_eq!(kinds, ["start", "begin", "end"]);
}

/// A site whose line has no port: commands are logged anyway.
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
    let mut daemon = Daemon::start_in(folder, &site);
    let refused = daemon.put("/api/v1/points/oven/k1", r#"{"value":true}"#);
    assert_eq!(refused.json()["code"], "E0710", "{}", refused.text());
    let storage = daemon.get("/api/v1/storage").json();
    let kept = (&storage["keep_ms"], &storage["max_bytes"]);
    assert_eq!(kept, (&json!(30_i64 * 86_400_000), &json!(100_000_000)));

    // As after a power failure.
    daemon.child.kill().expect("it runs");
    daemon.start_again(&site);
    let audit = daemon.get("/api/v1/audit").json();
    assert_eq!(audit["items"].as_array().map(Vec::len), Some(1));
    assert_eq!(audit["items"][0]["end"], "closed");
    assert_eq!(daemon.get("/api/v1/audit/verify").json()["ok"], true);
    let events = daemon.get("/api/v1/events?kind=system").json();
    let items = events["items"].as_array().expect("some");
    let starts = items.iter().filter(|event| event["code"] == "started");
    assert_eq!(starts.count(), 2, "{events}");
}
