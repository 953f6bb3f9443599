//! The configuration is changed while the site is running.

use crate::daemon::{Daemon, Folder, railbus};
use crate::keys::{Board, started};
use serde_json::json;
use std::io::Write;
use std::os::unix::net::UnixStream;

const LINE: &str = "# our site\n[line.main] # the only one\nport = \"/dev/railbus-test-nothing\"\n";

fn with_line(name: &str) -> Daemon {
    let folder = Folder::new(name);
    let file = folder.file("railbus.toml", LINE);
    Daemon::start_in(folder, &["--config", file.to_str().expect("text")])
}

fn text(daemon: &Daemon) -> String {
    let text = daemon.get("/config")["text"].clone();
    text.as_str().expect("a text").to_owned()
}

#[test]
fn a_site_begins_with_nothing_and_grows() {
    let folder = Folder::new("empty");
    let file = folder.0.join("new.toml");
    let daemon = Daemon::start_in(folder, &["--config", file.to_str().expect("text")]);
    assert!(
        daemon.told.contains("does not exist yet"),
        "{}",
        daemon.told
    );
    assert_eq!(daemon.get("/config")["text"], "");
    let line = json!({"line": "main", "port": "/dev/railbus-test-nothing", "parity": "even"});
    let answer = daemon.send("POST", "/config/lines", &line);
    assert_eq!(answer.status, 200, "{}", answer.body);
    assert_eq!(answer.json()["opened"], json!(["main"]));
    let found = json!({"modules": [
        {"name": "oven", "line": "main", "model": "erc8", "address": 3, "protocol": "rtu",
         "baud": 9_600, "parity": "none", "checksum": false},
    ]});
    let answer = daemon.send("POST", "/config/modules", &found);
    assert_eq!(answer.status, 200, "{}", answer.body);
    let wanted = "[line.main]\nport = \"/dev/railbus-test-nothing\"\nformat = \"8E1\"\n\n\
                  [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
                  format = \"8N1\"\n";
    let written = std::fs::read_to_string(&file).expect("a file");
    assert_eq!(written.trim_start(), wanted);
    assert_eq!(daemon.get("/modules")["modules"][0]["module"], "oven");
    let mut check = railbus();
    let check = check.args(["serve", "--check", "--config"]).arg(&file);
    assert!(check.output().expect("it runs").status.success());
}

#[test]
fn changes_keep_comments_and_can_be_taken_back() {
    let daemon = with_line("undo");
    let oven = json!({"modules": [{"line": "main", "model": "erc8", "address": 3}]});
    assert_eq!(daemon.send("POST", "/config/modules", &oven).status, 200);
    let named = json!({"name": {"en": "Heater", "zh": "加热器"}, "locked": true});
    let answer = daemon.send("PATCH", "/config/points/erc8_3/k1", &named);
    assert_eq!(answer.status, 200, "{}", answer.body);
    let point = daemon.get("/points/erc8_3/k1");
    assert_eq!(
        (&point["name"]["zh"], &point["locked"]),
        (&json!("加热器"), &json!(true))
    );
    assert!(text(&daemon).starts_with(LINE), "{}", text(&daemon));

    let renamed = json!({"rename": "oven", "max_age_ms": 5_000, "address": 4});
    let answer = daemon.send("PATCH", "/config/modules/erc8_3", &renamed);
    assert_eq!(answer.status, 200, "{}", answer.body);
    let text_then = text(&daemon);
    assert!(
        text_then.contains("[module.oven.point]\nk1.name"),
        "{text_then}"
    );
    assert!(text_then.contains("max_age = \"5s\""), "{text_then}");

    let undone = daemon.send("POST", "/config/undo", &json!({}));
    assert_eq!(undone.status, 200, "{}", undone.body);
    assert_eq!(daemon.get("/modules")["modules"][0]["address"], 3);
    let kept = daemon.get("/config/generations")["generations"].clone();
    let kept = kept.as_array().expect("a list");
    assert_eq!(
        kept.len(),
        5,
        "the first text, three changes and the undo: {kept:?}"
    );
    assert!(
        kept[0]["who"].is_string() && kept[4]["who"].is_null(),
        "{kept:?}"
    );
    let first = kept[4]["id"].as_u64().expect("a number");
    assert_eq!(
        daemon.get(&format!("/config/generations/{first}"))["text"],
        LINE
    );
    let back = daemon.send("POST", "/config/undo", &json!({"to": first}));
    assert_eq!((back.status, text(&daemon).as_str()), (200, LINE));
    assert_eq!(daemon.get("/modules")["modules"], json!([]));
    let none = daemon.send("POST", "/config/undo", &json!({"to": 99}));
    assert_eq!(none.end(), (404, "E0831".to_owned()));
}

#[test]
fn nobody_overwrites_what_he_has_not_seen() {
    let daemon = with_line("etag");
    let shown = daemon.ask("GET", "/config", "", "");
    let tag = shown.json()["etag"].as_str().expect("a tag").to_owned();
    assert!(
        shown.head.contains(&format!("etag: \"{tag}\"")),
        "{}",
        shown.head
    );
    let head = format!("If-Match: \"{tag}\"\r\n");
    let by_hand = format!("{LINE}# by hand\n");
    daemon.folder.file("railbus.toml", &by_hand);
    let body = json!({"text": "[line.other]\nport = \"/dev/ttyS9\"\n"}).to_string();
    let refused = daemon.ask("PUT", "/config", &head, &body);
    assert_eq!(refused.end(), (412, "E0827".to_owned()));
    let line = json!({"line": "yard", "port": "/dev/railbus-test-none"}).to_string();
    let refused = daemon.ask("POST", "/config/lines", &head, &line);
    assert_eq!(refused.status, 412);
    assert_eq!(
        daemon.ask("PUT", "/config", "", &body).end(),
        (428, "E0832".to_owned())
    );

    // A change of one key keeps the text written by hand.
    assert_eq!(daemon.ask("POST", "/config/lines", "", &line).status, 200);
    assert!(text(&daemon).starts_with(&by_hand), "{}", text(&daemon));
    let tag = daemon.get("/config")["etag"].clone();
    let head = format!("If-Match: \"{}\"\r\n", tag.as_str().expect("a tag"));
    let done = daemon.ask("PUT", "/config", &head, &body);
    assert_eq!(done.status, 200, "{}", done.body);
    assert_eq!(done.json()["closed"], json!(["main", "yard"]));
}

#[test]
fn a_bad_change_changes_nothing() {
    let daemon = with_line("bad");
    let tag = daemon.get("/config")["etag"].clone();
    let head = format!("If-Match: \"{}\"\r\n", tag.as_str().expect("a tag"));
    let wrong = "[line.main]\nprot = \"/dev/ttyUSB0\"\n";
    let body = json!({ "text": wrong }).to_string();
    let refused = daemon.ask("PUT", "/config", &head, &body);
    assert_eq!(refused.status, 422);
    let problems = refused.json()["problems"].clone();
    let unknown = problems.as_array().expect("a list").iter();
    let unknown = unknown.filter(|problem| problem["code"] == "E0812");
    let unknown: Vec<_> = unknown.collect();
    assert_eq!(
        (&unknown[0]["line"], &unknown[0]["column"]),
        (&json!(2), &json!(1))
    );
    let reason = unknown[0]["reason"].as_str().expect("words");
    assert!(reason.contains("did you mean \"port\""), "{reason}");
    let chinese = format!("{head}Accept-Language: zh-CN\r\n");
    let refused = daemon.ask("PUT", "/config", &chinese, &body);
    assert!(refused.body.contains("是否应为"), "{}", refused.body);

    let end = |method, path: &str, body| daemon.send(method, path, &body).end();
    let code = |status, code: &str| (status, code.to_owned());
    let line = json!({"line": "main", "port": "/dev/ttyUSB1"});
    assert_eq!(end("POST", "/config/lines", line), code(409, "E0829"));
    let line = json!({"line": "Yard", "port": "/dev/ttyUSB1"});
    assert_eq!(end("POST", "/config/lines", line), code(422, "E0810"));
    assert_eq!(
        end("DELETE", "/config/modules/oven", json!({})),
        code(404, "E0801")
    );
    assert_eq!(
        end("PATCH", "/config/points/oven/k1", json!({})),
        code(404, "E0801")
    );
    let module = json!({"modules": [{"line": "south", "model": "erc8", "address": 3}]});
    assert_eq!(end("POST", "/config/modules", module), code(422, "E0810"));
    assert_eq!(
        daemon.ask("POST", "/config/lines", "", "{").end(),
        code(422, "E0806")
    );
    assert_eq!(text(&daemon), LINE);
    assert_eq!(daemon.get("/config")["in_force"], true);
    assert_eq!(daemon.get("/config/generations")["generations"], json!([]));

    let check = daemon
        .send("POST", "/config/check", &json!({ "text": wrong }))
        .json();
    assert_eq!(
        check["problems"].as_array().map(Vec::len),
        Some(2),
        "{check}"
    );
    let usb = json!({"text": "[line.main]\nport = \"/dev/ttyUSB0\"\n"});
    let check = daemon.send("POST", "/config/check", &usb).json();
    assert_eq!(check["problems"], json!([]));
    assert_eq!(check["warnings"][0]["code"], "L020");
    let long = json!({ "text": "#".repeat(3 << 20) });
    assert_eq!(daemon.send("POST", "/config/check", &long).status, 413);
}

#[test]
fn changes_that_come_together_are_made_one_by_one() {
    let daemon = with_line("together");
    std::thread::scope(|scope| {
        for number in 1..=8 {
            let daemon = &daemon;
            scope.spawn(move || {
                let found = json!({"line": "main", "model": "erc8", "address": number});
                let body = json!({ "modules": [found] });
                let answer = daemon.send("POST", "/config/modules", &body);
                assert_eq!(answer.status, 200, "{}", answer.body);
            });
        }
    });
    let modules = daemon.get("/modules")["modules"].clone();
    assert_eq!(modules.as_array().map(Vec::len), Some(8));
}

#[test]
fn the_demo_has_a_configuration_of_its_own() {
    let daemon = Daemon::start("demo", &["--demo"]);
    let file = daemon.get("/config")["file"].clone();
    let file = std::path::PathBuf::from(file.as_str().expect("a path"));
    let named = json!({"name": {"en": "Well pump", "zh": "井泵"}});
    let answer = daemon.send("PATCH", "/config/points/pump/do0", &named);
    assert_eq!(answer.status, 200, "{}", answer.body);
    assert_eq!(answer.json()["kept"], json!(["main"]));
    assert_eq!(daemon.get("/points/pump/do0")["name"]["en"], "Well pump");
    let ports = daemon.get("/ports")["ports"].clone();
    let mut ports = ports.as_array().expect("a list").iter();
    assert!(ports.any(|port| port["line"] == "main"));

    use std::os::unix::fs::PermissionsExt;
    let folder = file.parent().expect("a folder").to_owned();
    let mode = std::fs::metadata(&folder)
        .expect("a folder")
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o700);
    let pid = rustix::process::Pid::from_child(&daemon.child);
    rustix::process::kill_process(pid, rustix::process::Signal::TERM).expect("it runs");
    daemon.until("the folder goes with the demo", |_| !folder.exists());
}

#[test]
fn groups_and_scenes_are_put_and_taken_out() {
    let daemon = with_line("groups");
    let boards =
        json!({"modules": [{"name": "oven", "line": "main", "model": "erc8", "address": 3}]});
    assert_eq!(daemon.send("POST", "/config/modules", &boards).status, 200);
    let night = json!({"name": {"en": "Night", "zh": "夜间"}, "members": ["oven.k1", "oven.k2"]});
    let answer = daemon.send("PUT", "/config/groups/night", &night);
    assert_eq!(answer.status, 200, "{}", answer.body);
    let evening = json!({"steps": [
        {"path": "oven.k1", "value": true}, {"wait_ms": 500}, {"path": "oven.k2", "value": false},
    ]});
    let answer = daemon.send("PUT", "/config/scenes/evening", &evening);
    assert_eq!(answer.status, 200, "{}", answer.body);
    let steps = "steps = [{ set = \"oven.k1\", to = true }, { wait = \"500ms\" }, \
                 { set = \"oven.k2\", to = false }]\n";
    assert!(text(&daemon).contains(steps), "{}", text(&daemon));

    // References to a module's outputs follow it to its new name.
    let renamed = daemon.send("PATCH", "/config/modules/oven", &json!({"rename": "kiln"}));
    assert_eq!(renamed.status, 200, "{}", renamed.body);
    assert!(!text(&daemon).contains("oven"), "{}", text(&daemon));
    let wrong = json!({"members": ["kiln.k9"]});
    let refused = daemon.send("PUT", "/config/groups/night", &wrong);
    assert_eq!(refused.end(), (422, "E0810".to_owned()));
    let wrong = json!({"steps": [{"path": "kiln.k1", "value": true, "wait": 3}]});
    let refused = daemon.send("PUT", "/config/scenes/evening", &wrong);
    assert_eq!(refused.end(), (422, "E0806".to_owned()));

    for path in ["/config/groups/night", "/config/scenes/evening"] {
        assert_eq!(daemon.send("DELETE", path, &json!({})).status, 200);
        assert_eq!(daemon.send("DELETE", path, &json!({})).status, 404);
    }
    assert!(!text(&daemon).contains("night") && !text(&daemon).contains("evening"));
    let schema = daemon.get("/config/schema");
    assert_eq!(schema["title"], "railbus.toml");
    let printed = railbus()
        .args(["schema", "config-file"])
        .output()
        .expect("it runs");
    assert_eq!(
        schema,
        serde_json::from_slice::<serde_json::Value>(&printed.stdout).expect("JSON")
    );
}

/// A pulse runs at a board whose name is given to another one. Once the file says so, a restart
/// after a crash finds nothing left to be done at the first one.
#[test]
fn what_was_promised_of_a_board_is_done_before_its_name_is_written_to_be_anothers() {
    let board = Board::new();
    let (mut daemon, file) = started(&board, "edits-promised");
    let begun = daemon.send("POST", "/points/oven/k1/pulse", &json!({ "ms": 600_000 }));
    assert_eq!((begun.status, board.relays()), (200, 1), "{}", begun.body);
    // Sent without waiting for the answer.
    let mut asked = UnixStream::connect(daemon.folder.0.join("socket")).expect("it listens");
    write!(
        asked,
        "PATCH /api/v1/config/modules/oven HTTP/1.1\r\nHost: any\r\nContent-Length: 13\r\n\r\n\
         {{\"address\":5}}"
    )
    .expect("it is read");
    while !std::fs::read_to_string(&file).is_ok_and(|text| text.contains("address = 5")) {
        std::thread::yield_now();
    }
    daemon.child.kill().expect("it runs");
    daemon.child.wait().expect("it ends");
    assert_eq!(board.relays(), 0);
}
