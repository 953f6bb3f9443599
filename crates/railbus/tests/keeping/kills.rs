//! The daemon is killed while its configuration is changed and its outputs are switched: what it
//! acknowledged is there afterwards, and what was pending is there whole or not at all.

use crate::daemon::{Daemon, Folder, railbus};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// How often it is killed while it changes a module's settings.
const KILLS_IN_CHANGES: u64 = 6;
/// How often it is killed.
const KILLS: u64 = 100;
/// At least this many texts of one round are kept: besides them there may be one that was pending,
/// and one that was found again after it.
const KEPT: usize = 15;
/// A line whose port is missing: commands are logged, and fail.
const SITE: &str = "# our site\n[line.main]\nport = \"/dev/railbus-test-nothing\"\n\n\
                    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

/// What was acknowledged.
#[derive(Default)]
struct Acked {
    /// The marks of the texts, oldest first.
    texts: Vec<String>,
    /// How many commands.
    commands: usize,
}

/// What the clients and the killer know of each other.
#[derive(Default)]
struct Load {
    over: AtomicBool,
    changes: AtomicU64,
}

/// Sends requests, and returns the answers until the connection fails.
fn ask(socket: &Path, method: &str, path: &str, body: &Value) -> Option<Value> {
    let mut stream = UnixStream::connect(socket).ok()?;
    let body = body.to_string();
    let length = body.len();
    write!(
        stream,
        "{method} /api/v1{path} HTTP/1.1\r\nHost: any\r\nConnection: close\r\n\
         Content-Length: {length}\r\n\r\n{body}"
    )
    .ok()?;
    let mut text = String::new();
    stream.read_to_string(&mut text).ok()?;
    // An answer that was cut off acknowledges nothing.
    serde_json::from_str(text.split_once("\r\n\r\n")?.1).ok()
}

/// Changes the name of an output repeatedly.
fn change(socket: &Path, round: u64, load: &Load, acked: &mut Vec<String>) {
    for number in 0.. {
        let name = json!({"name": {"en": format!("Heater {round}.{number}")}});
        let told = ask(socket, "PATCH", "/config/points/oven/k1", &name);
        if let Some(etag) = told.as_ref().and_then(|told| told["etag"].as_str()) {
            acked.push(etag.to_owned());
            load.changes.fetch_add(1, Ordering::Relaxed);
        } else if load.over.load(Ordering::Relaxed) {
            return;
        }
    }
}

/// Switches the output repeatedly.
fn switch(socket: &Path, load: &Load, acked: &mut usize) {
    while !load.over.load(Ordering::Relaxed) {
        let told = ask(socket, "PUT", "/points/oven/k1", &json!({"value": true}));
        // The line has no port: that ends the command.
        *acked += usize::from(told.is_some_and(|told| told["code"] == "E0710"));
    }
}

/// Kills it under this load: some time after this many changes.
fn kill_under_load(daemon: &mut Daemon, round: u64, acked: &mut Acked) {
    let socket = daemon.folder.0.join("socket");
    let load = Load::default();
    std::thread::scope(|scope| {
        let (texts, commands) = (&mut acked.texts, &mut acked.commands);
        let (socket, load) = (&socket, &load);
        scope.spawn(move || change(socket, round, load, texts));
        scope.spawn(move || switch(socket, load, commands));
        daemon.until("changes", |_| {
            load.changes.load(Ordering::Relaxed) >= round % 3
        });
        // Moments spread over the time between two writes to the disk.
        std::thread::sleep(Duration::from_micros(round * 7_919 % 30_000));
        daemon.child.kill().expect("it runs");
        load.over.store(true, Ordering::Relaxed);
    });
}

/// What was acknowledged after this many texts is there, and the file is whole.
fn is_whole(daemon: &Daemon, acked: &Acked, before: usize) {
    let config = daemon.get("/config");
    assert_eq!(config["in_force"], true, "{config}");
    let text = config["text"].as_str().expect("a text");
    assert!(
        text.starts_with("# our site\n") && text.ends_with('\n'),
        "{text}"
    );
    let check = daemon
        .send("POST", "/config/check", &json!({ "text": text }))
        .json();
    assert_eq!(check["problems"], json!([]), "{text}");

    let kept = daemon.get("/config/generations")["generations"].clone();
    let kept = kept.as_array().expect("a list").iter();
    let kept: Vec<&str> = kept.filter_map(|kept| kept["etag"].as_str()).collect();
    for etag in acked.texts.iter().skip(before).rev().take(KEPT) {
        assert!(
            kept.contains(&etag.as_str()),
            "{etag} was acknowledged: {kept:?}"
        );
    }
    // It is the last that was acknowledged, or the one after it, which was pending.
    let place = |etag: &str| kept.iter().position(|kept| *kept == etag);
    let now = place(config["etag"].as_str().expect("a mark"));
    let last = acked.texts.last().and_then(|etag| place(etag));
    assert!(
        acked.texts.is_empty() || now <= last,
        "{now:?} after {last:?}"
    );
    assert_eq!(daemon.get("/audit/verify")["ok"], true);
}

/// Every command that was acknowledged is in the log, with its end.
fn all_are_in_the_log(daemon: &Daemon, acked: &Acked) {
    let (mut ended, mut cursor) = (0, String::new());
    loop {
        let page = daemon.get(&format!("/audit?limit=500{cursor}"));
        let items = page["items"].as_array().expect("a list").iter();
        ended += items.filter(|item| item["end"] == "closed").count();
        let Some(next) = page["next"].as_str() else {
            break;
        };
        cursor = format!("&cursor={next}");
    }
    assert!(ended >= acked.commands, "{ended} of {}", acked.commands);
}

#[test]
fn kill_loses_no_change_that_was_acknowledged() {
    let folder = Folder::new("kills");
    let file = folder.file("railbus.toml", SITE);
    let arguments = ["--config", file.to_str().expect("text")];
    let mut daemon = Daemon::start_in(folder, &arguments);
    let mut acked = Acked::default();
    for round in 0..KILLS {
        let before = acked.texts.len();
        kill_under_load(&mut daemon, round, &mut acked);
        daemon.start_again(&arguments);
        is_whole(&daemon, &acked, before);
    }
    all_are_in_the_log(&daemon, &acked);
    let (texts, commands) = (acked.texts.len(), acked.commands);
    assert!(texts.min(commands) as u64 > KILLS / 2, "{texts} {commands}");
    let files = std::fs::read_dir(&daemon.folder.0)
        .expect("a folder")
        .count();
    assert!(files < 16, "{files} files: what was begun is cleared away");
}

/// The plant of a module whose address is changed, and the site that has it.
const BENCH: &str = "[line.main]\nport = \"PORT\"\n\n\
                     [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
const SETTINGS: &str = "/modules/oven/settings";

/// The simulator of that module, which keeps its settings whatever happens to the daemon.
struct Plant(Child);

impl Plant {
    fn start(folder: &Folder) -> (Plant, String) {
        let port = folder.0.join("line").display().to_string();
        let text = BENCH.replace("PORT", &format!("pty:{port}"));
        let child = railbus()
            .arg("sim")
            .arg(folder.file("plant.toml", &text))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn();
        let mut plant = Plant(child.expect("railbus starts"));
        while !Path::new(&port).exists() {
            assert!(plant.0.try_wait().expect("ours").is_none(), "it ended");
            std::thread::sleep(Duration::from_millis(20));
        }
        (plant, port)
    }
}

impl Drop for Plant {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The address at which a module answers on the line, whatever any file says.
fn answers_at(port: &str) -> Vec<u64> {
    let at = |address: &u64| {
        let output = railbus()
            .args([
                "-l",
                &format!("pty:{port}"),
                "-m",
                "erc8",
                "-a",
                &address.to_string(),
            ])
            .args(["get", "erc8.k1", "-o", "value"])
            .output();
        output.expect("it runs").status.success()
    };
    [3, 9].into_iter().filter(at).collect()
}

/// How many changes the journal has.
fn changes(daemon: &Daemon) -> usize {
    let log = daemon.get(&format!("{SETTINGS}/log"));
    log["changes"].as_array().map_or(0, Vec::len)
}

/// The journal's last change, if there is any: its state, and whether it can be undone.
fn last_change(daemon: &Daemon) -> Option<(String, bool)> {
    let log = daemon.get(&format!("{SETTINGS}/log"));
    let last = log["changes"].get(0)?;
    let state = last["state"].as_str().expect("a state").to_owned();
    Some((state, last["undoable"] == true))
}

/// `railbus config recover` finds it with exclusive access to the line; then the change is undone
/// over HTTP, where it was made.
fn bring_back(daemon: &mut Daemon, config: &str, arguments: &[&str]) {
    daemon.child.kill().expect("it runs");
    daemon.child.wait().expect("it ends");
    let recover = railbus()
        .args(["--config", config, "config", "recover", "oven"])
        .output();
    let told = recover.expect("it runs");
    assert!(told.status.success(), "{told:?}");
    daemon.start_again(arguments);
    daemon.until("good", |daemon| daemon.quality("oven.k1") == "good");
    if daemon.get("/config")["text"]
        .to_string()
        .contains("address = 9")
    {
        assert_eq!(last_change(daemon), Some(("filed".to_owned(), true)));
        let undo = daemon.send("POST", &format!("{SETTINGS}/undo"), &json!({}));
        assert_eq!(undo.status, 202, "{}", undo.body);
        let op = format!("/ops/{}", undo.json()["op"].as_str().expect("a number"));
        daemon.until("it ends", |daemon| daemon.get(&op)["state"] != "running");
        assert_eq!(daemon.get(&op)["state"], "done");
    }
    let text = daemon.get("/config")["text"].to_string();
    assert!(text.contains("address = 3"), "{text}");
    daemon.until("good", |daemon| daemon.quality("oven.k1") == "good");
    let modules = daemon.get("/modules")["modules"].clone();
    assert_eq!(modules[0]["address"], 3);
}

/// The module answers at one address, and if that has changed the journal knows of it: recovery
/// finds it, and the change can be undone.
#[test]
fn kill_in_the_middle_of_a_change_of_settings_leaves_a_module_that_is_found() {
    let folder = Folder::new("kills-settings");
    let (_plant, port) = Plant::start(&folder);
    let file = folder.file("railbus.toml", &BENCH.replace("PORT", &port));
    let config = file.display().to_string();
    let arguments = ["--config", &config];
    let mut daemon = Daemon::start_in(Folder::new("kills-settings-daemon"), &arguments);
    let (mut moved, mut open) = (0, 0);
    for round in 0..KILLS_IN_CHANGES {
        daemon.until("good", |daemon| daemon.quality("oven.k1") == "good");
        let etag = daemon.get(SETTINGS)["etag"].clone();
        let before = changes(&daemon);
        let head = format!("If-Match: {etag}\r\n");
        let begun = daemon.ask("PATCH", SETTINGS, &head, r#"{"address":9}"#);
        assert_eq!(begun.status, 202, "{}", begun.body);
        // While it checks whether the new address is vacant; and from the moment at which the
        // journal has it, over the write and the read-back.
        if round % 4 != 0 {
            daemon.until("the intent", |daemon| changes(daemon) > before);
        }
        std::thread::sleep(Duration::from_millis(round * 37 % 200));
        daemon.child.kill().expect("it runs");
        daemon.child.wait().expect("it ends");
        let there = answers_at(&port);
        assert_eq!(there.len(), 1, "round {round}: it answers at {there:?}");

        daemon.start_again(&arguments);
        let told = last_change(&daemon);
        let is_open = told.as_ref().is_some_and(|(state, _)| state == "intent");
        let text = daemon.get("/config")["text"].to_string();
        let filed = if text.contains("address = 9") { 9 } else { 3 };
        let is_known =
            filed == there[0] || told.as_ref().is_some_and(|(state, _)| state != "filed");
        assert!(
            is_known,
            "round {round}: at {there:?}, {filed} in the file, {told:?}"
        );
        moved += u64::from(there == [9]);
        open += u64::from(is_open);
        bring_back(&mut daemon, &config, &arguments);
    }
    assert!(
        open + moved > 0,
        "no kill came in the middle: {open} {moved}"
    );
}
