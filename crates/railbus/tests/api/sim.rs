//! The simulated modules themselves, compared with what the line reported of them.

use crate::daemon::Daemon;
use crate::websocket::Client;
use serde_json::{Value, json};

impl Daemon {
    fn module(&self, name: &str) -> Value {
        let lines = self.get("/api/v1/sim").json();
        let modules = lines["lines"][0]["modules"].as_array().cloned();
        let mut modules = modules.expect("a list").into_iter();
        let found = modules.find(|module| module["module"] == name);
        found.expect("a module")
    }

    /// What is at a terminal.
    fn at(&self, path: &str) -> Value {
        let (module, label) = path.split_once('.').expect("a path");
        let module = self.module(module);
        let mut points = module["points"].as_array().expect("a list").iter();
        let found = points.find(|point| point["label"] == label);
        found.expect("a terminal").clone()
    }

    /// What the site knows of a point.
    fn known(&self, path: &str) -> Value {
        self.get(&format!("/api/v1/points/{}", path.replace('.', "/")))
            .json()
    }

    fn order(&self, method: &str, path: &str, body: &Value) -> Value {
        let answer = self.send(method, &format!("/api/v1/sim/{path}"), &body.to_string());
        assert_eq!(answer.status, 200, "{path}: {}", answer.text());
        answer.json()
    }

    fn fault(&self, module: &str, faults: &str) -> Value {
        let path = format!("main/{module}/faults");
        self.order("POST", &path, &json!({ "faults": faults }))
    }

    fn write(&self, path: &str, value: bool) -> (u16, Value) {
        let path = format!("/api/v1/points/{}", path.replace('.', "/"));
        let answer = self.send("PUT", &path, &json!({ "value": value }).to_string());
        (answer.status, answer.json())
    }
}

#[test]
fn the_panel_shows_the_modules_themselves() {
    let daemon = Daemon::demo("sim-panel");
    let lines = daemon.get("/api/v1/sim").json();
    let line = &lines["lines"][0];
    assert_eq!(
        (&line["line"], &line["plugged"]),
        (&json!("main"), &json!(true))
    );
    let gate = daemon.module("gate");
    for (key, value) in [
        ("model", json!("eda9050")),
        ("address", json!(2)),
        ("protocol", json!("lc02")),
        ("baud", json!(9600)),
        ("init", json!(true)),
        ("powered", json!(true)),
        ("faults", json!([])),
    ] {
        assert_eq!(gate[key], value, "{key}");
    }
    let labels = |name: &str| {
        let module = daemon.module(name);
        let points = module["points"].as_array().expect("a list");
        let label = |point: &Value| point["label"].as_str().map(str::to_owned);
        points
            .iter()
            .filter_map(label)
            .collect::<Vec<_>>()
            .join(" ")
    };
    assert_eq!(labels("pump"), "do0 do1 do2 do3 di0 di1 di2 di3");
    assert_eq!(labels("tank"), "k1 k2 ai1 ai2");
    assert_eq!(daemon.at("oven.k1")["value"], false);
    assert_eq!(daemon.write("oven.k1", true).0, 200);
    assert_eq!(daemon.at("oven.k1")["value"], true);
}

#[test]
fn inputs_are_moved_by_hand_and_given_back() {
    let daemon = Daemon::demo("sim-inputs");
    let set = json!({ "set": { "ai1": 3.21, "ai2": 5 } });
    let tank = daemon.order("PUT", "main/tank/inputs", &set);
    assert_eq!(tank["points"][2]["value"], 3.21);
    assert_eq!(tank["points"][2]["by_hand"], true);
    assert_eq!(tank["points"][2]["range"], json!([0.0, 10.0]));
    daemon.until("the line tells it", |daemon| {
        daemon.known("tank.ai1")["value"] == 3.21
    });
    let back = json!({ "set": { "ai1": null } });
    daemon.order("PUT", "main/tank/inputs", &back);
    daemon.until("it moves by itself again", |daemon| {
        daemon.known("tank.ai1")["value"] != 3.21
    });
    assert_eq!(daemon.at("tank.ai2")["value"], 5.0);
    let low = json!({ "set": { "di3": false } });
    daemon.order("PUT", "main/gate/inputs", &low);
    daemon.until("the line tells this, too", |daemon| {
        daemon.known("gate.di3")["value"] == false
    });
}

#[test]
fn a_write_to_a_stuck_relay_is_never_ok() {
    let daemon = Daemon::demo("sim-stuck");
    let oven = daemon.fault("oven", "stuck k1");
    assert_eq!(oven["points"][0]["stuck"], true);
    let (status, told) = daemon.write("oven.k1", true);
    assert_eq!((status, &told["code"]), (409, &json!("E0601")), "{told}");
    assert_eq!(daemon.at("oven.k1")["value"], false);
    assert_eq!(daemon.known("oven.k1")["value"], false);
    assert_eq!(daemon.write("oven.k2", true).0, 200, "the others are free");
    daemon.fault("oven", "stuck k4, duplicate 1%");
    let one = daemon.order("DELETE", "main/oven/faults?fault=stuck%20k4", &json!({}));
    assert_eq!(one["faults"].as_array().map(Vec::len), Some(2), "{one}");
    let cleared = daemon.order("DELETE", "main/oven/faults", &json!({}));
    assert_eq!(cleared["faults"], json!([]));
    assert_eq!(daemon.write("oven.k1", true).0, 200);
    assert_eq!(daemon.at("oven.k1")["value"], true);
}

#[test]
fn a_silent_module_is_told_as_such_while_its_panel_is_seen() {
    let daemon = Daemon::demo("sim-mute");
    let pump = daemon.fault("pump", "mute 10m");
    assert_eq!(pump["faults"][0]["fault"], "mute 10m");
    assert!(
        pump["faults"][0]["left_ms"]
            .as_u64()
            .is_some_and(|left| left <= 600_000)
    );
    daemon.until("it is offline", |daemon| {
        daemon.known("pump.do0")["quality"] == "bad"
    });
    // It receives and executes anyway: the panel and the line differ.
    let (status, told) = daemon.write("pump.do0", true);
    assert!(status >= 400, "{told}");
    daemon.until("it obeyed", |daemon| daemon.at("pump.do0")["value"] == true);
    daemon.order("DELETE", "main/pump/faults", &json!({}));
    daemon.until("it is back", |daemon| {
        let point = daemon.known("pump.do0");
        point["quality"] == "good" && point["value"] == true
    });
    let events = daemon.get("/api/v1/events?kind=system").json();
    let events = events["items"].as_array().expect("a list").clone();
    let told = |what: &str| {
        events
            .iter()
            .any(|event| event["code"] == "sim_order" && event["what"] == what)
    };
    assert!(
        told("fault pump mute 10m") && told("fault pump clear"),
        "{events:?}"
    );
}

#[test]
fn one_bad_reply_is_counted_and_no_value_is_ever_wrong() {
    let daemon = Daemon::demo("sim-bad");
    // ASCII without a checksum most easily takes a bad reply for a good one.
    for module in ["pump", "oven", "gate", "yard", "tank"] {
        let set = match module {
            "tank" => json!({ "set": { "ai1": 1.5, "ai2": 2.5 } }),
            "oven" | "yard" => json!({ "set": {} }),
            _ => json!({ "set": { "di0": true, "di1": true, "di2": true, "di3": true } }),
        };
        daemon.order("PUT", &format!("main/{module}/inputs"), &set);
    }
    daemon.until("they are read", |daemon| {
        let is = |path, value: Value| daemon.known(path)["value"] == value;
        is("pump.di3", json!(true)) && is("gate.di3", json!(true)) && is("tank.ai2", json!(2.5))
    });
    let mut client = Client::open(&daemon);
    client.send(r#"{"sub":["points/#"]}"#);
    client.until("all points", |message| message["type"] == "snapshot");
    let errors = |daemon: &Daemon| {
        let modules = daemon.get("/api/v1/modules").json()["modules"].clone();
        let modules = modules.as_array().expect("a list").clone();
        let count = |module: &Value| module["errors_1h"].as_u64().unwrap_or_default();
        modules.iter().map(count).sum::<u64>()
    };
    let before = errors(&daemon);
    for module in ["pump", "oven", "gate", "yard", "tank"] {
        let told = daemon.fault(module, "bad once");
        assert_eq!(told["faults"][0]["left_replies"], 1);
        daemon.until("it was given", |daemon| {
            daemon.module(module)["faults"] == json!([])
        });
    }
    daemon.until("they are counted", |daemon| errors(daemon) >= before + 5);
    assert_eq!(daemon.write("yard.k8", true).0, 200);
    client.until("the line goes on, and nothing else was told", |message| {
        let points = message["points"].as_array().cloned().unwrap_or_default();
        for point in &points {
            let path = point["path"].as_str().unwrap_or_default();
            let meant = match path {
                "tank.ai1" => json!(1.5),
                "tank.ai2" => json!(2.5),
                "pump.di0" | "pump.di1" | "pump.di2" | "pump.di3" => json!(true),
                "gate.di0" | "gate.di1" | "gate.di2" | "gate.di3" => json!(true),
                _ => continue,
            };
            assert_eq!(point["value"], meant, "{point}");
        }
        let switched = |point: &Value| point["path"] == "yard.k8" && point["value"] == true;
        points.iter().any(switched)
    });
}

#[test]
fn a_vanished_adapter_and_a_lost_power_are_seen_and_come_back() {
    let daemon = Daemon::demo("sim-plug");
    let line = daemon.order("PUT", "main", &json!({ "plugged": false }));
    assert_eq!(line["plugged"], false);
    daemon.until("the points are bad", |daemon| {
        daemon.known("oven.k1")["quality"] == "bad"
    });
    assert_eq!(daemon.module("oven")["powered"], true);
    let line = daemon.order("PUT", "main", &json!({ "plugged": true }));
    assert_eq!(line["plugged"], true);
    let line = daemon.order("POST", "main/line-faults", &json!({ "faults": "noise 5m" }));
    assert_eq!(line["faults"][0]["fault"], "noise 5m");
    daemon.until("the points are good", |daemon| {
        daemon.known("oven.k1")["quality"] == "good"
    });
    let line = daemon.order("DELETE", "main/line-faults?fault=noise", &json!({}));
    assert_eq!(line["faults"], json!([]));

    assert_eq!(daemon.write("oven.k1", true).0, 200);
    let oven = daemon.order("PUT", "main/oven", &json!({ "powered": false }));
    assert_eq!(
        (&oven["powered"], &oven["lit"]),
        (&json!(false), &json!(false))
    );
    assert_eq!(daemon.at("oven.k1")["value"], false);
    let oven = daemon.order("PUT", "main/oven", &json!({ "powered": true }));
    assert_eq!(
        (&oven["powered"], &oven["restarts"]),
        (&json!(true), &json!(1))
    );
    let yard = daemon.order("PUT", "main/yard", &json!({ "dip": 9 }));
    assert_eq!((&yard["dip"], &yard["address"]), (&json!(9), &json!(9)));
}

#[test]
fn what_changes_at_the_modules_is_pushed() {
    let daemon = Daemon::demo("sim-push");
    let mut client = Client::open(&daemon);
    client.send(r#"{"sub":["sim/main"]}"#);
    let all = client.until("the line", |message| message["type"] == "snapshot");
    assert_eq!(all["data"]["modules"].as_array().map(Vec::len), Some(5));
    daemon.fault("yard", "stuck k3");
    let delta = client.until("the fault", |message| {
        let modules = message["sim"]["modules"].as_array();
        let yard = |module: &Value| module["module"] == "yard" && module["faults"] != json!([]);
        modules.is_some_and(|modules| modules.iter().any(yard))
    });
    assert_eq!(
        (&delta["type"], &delta["topic"]),
        (&json!("delta"), &json!("sim/main"))
    );
    client.send(r#"{"sub":["sim/nothing"]}"#);
    let refused = client.until("a problem", |message| message["type"] == "problem");
    assert_eq!(refused["problem"]["code"], "E0862");
}

#[test]
fn what_is_no_order_does_nothing() {
    let daemon = Daemon::demo("sim-refuse");
    let ask = |method: &str, path: &str, body: &str| {
        let answer = daemon.send(method, &format!("/api/v1/sim/{path}"), body);
        (
            answer.status,
            answer.json()["code"]
                .as_str()
                .unwrap_or_default()
                .to_owned(),
        )
    };
    let cases = [
        ("PUT", "cellar", r#"{"plugged":false}"#, 404, "E0862"),
        ("PUT", "main/shed", r#"{"powered":false}"#, 404, "E0863"),
        (
            "PUT",
            "main/pump/inputs",
            r#"{"set":{"di0":true,"di9":true}}"#,
            422,
            "E0290",
        ),
        (
            "PUT",
            "main/pump/inputs",
            r#"{"set":{"do0":true}}"#,
            422,
            "E0290",
        ),
        (
            "PUT",
            "main/tank/inputs",
            r#"{"set":{"ai1":1e9}}"#,
            422,
            "E0290",
        ),
        (
            "PUT",
            "main/tank/inputs",
            r#"{"set":{"ai1":"x"}}"#,
            422,
            "E0806",
        ),
        (
            "PUT",
            "main/pump/inputs",
            r#"{"set":{"di0 = 0, x":true}}"#,
            422,
            "E0290",
        ),
        (
            "POST",
            "main/pump/faults",
            r#"{"faults":"frob"}"#,
            422,
            "E0290",
        ),
        (
            "POST",
            "main/pump/faults",
            r#"{"faults":"mute, echo"}"#,
            422,
            "E0290",
        ),
        (
            "POST",
            "main/pump/faults",
            r#"{"faults":"stuck k1"}"#,
            422,
            "E0290",
        ),
        (
            "POST",
            "main/line-faults",
            r#"{"faults":"stuck k1"}"#,
            422,
            "E0290",
        ),
        ("PUT", "main", r#"{"plugged":"no"}"#, 422, "E0806"),
        ("PUT", "main", "{}", 422, "E0806"),
        (
            "PUT",
            "main/tank/inputs",
            r#"{"set":{"ai1":true}}"#,
            422,
            "E0290",
        ),
        (
            "PUT",
            "main/pump/inputs",
            r#"{"set":{"di0":2}}"#,
            422,
            "E0290",
        ),
        ("PUT", "main/pump", r#"{"dip":3}"#, 422, "E0290"),
        ("PUT", "main/yard", r#"{"init":true}"#, 422, "E0290"),
        ("PUT", "main/yard", r#"{"dip":256}"#, 422, "E0806"),
    ];
    let before = daemon.at("pump.di0")["by_hand"].clone();
    for (method, path, body, status, code) in cases {
        assert_eq!(
            ask(method, path, body),
            (status, code.to_owned()),
            "{path} {body}"
        );
    }
    assert_eq!(daemon.at("pump.di0")["by_hand"], before);
    assert_eq!(daemon.module("pump")["faults"], json!([]));
    assert_eq!(
        daemon.get("/api/v1/sim").json()["lines"][0]["plugged"],
        true
    );
}
