//! Updates as they are sent.

use crate::daemon::Daemon;
use crate::websocket::Client;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

fn is(message: &Value, kind: &str, topic: &str) -> bool {
    message["type"] == kind && message["topic"] == topic
}

#[test]
fn a_topic_begins_with_how_everything_is_and_then_tells_what_changes() {
    let daemon = Daemon::demo("delta");
    let mut client = Client::open(&daemon);
    client.send(r#"{"sub":["points/#","modules","lines"]}"#);
    let all = client.until("all points", |m| is(m, "snapshot", "points/#"));
    assert_eq!(all["seq"], 0);
    let points = all["data"].as_array().expect("a list");
    assert_eq!(points.len(), 43);
    assert!(points.iter().all(|point| point["quality"] == "good"));

    let mut one = Client::open(&daemon);
    one.send(r#"{"sub":["points/pump/do0"]}"#);
    let first = one.next().expect("a snapshot");
    assert_eq!(first["data"].as_array().map(Vec::len), Some(1));
    assert_eq!(first["data"][0]["value"], false);

    let answer = daemon.send("PUT", "/api/v1/points/pump/do0", r#"{"value":true}"#);
    assert_eq!(answer.status, 200, "{}", answer.text());
    // On a busy machine the value may become too old before, and be read again.
    for seq in 1.. {
        let delta = one.next().expect("a delta");
        assert!(is(&delta, "delta", "points/pump/do0"), "{delta}");
        assert_eq!(delta["seq"], seq);
        assert_eq!(delta["points"].as_array().map(Vec::len), Some(1));
        if delta["points"][0]["value"] == true {
            break;
        }
    }
    client.until("it is told to all", |m| {
        let told = m["points"].as_array();
        let path = |point: &Value| point["path"] == "pump.do0" && point["value"] == true;
        is(m, "delta", "points/#") && told.is_some_and(|told| told.iter().any(path))
    });
    client.until("the module shows it", |m| {
        let modules = m["modules"].as_array();
        let pump = modules.and_then(|all| all.iter().find(|module| module["module"] == "pump"));
        is(m, "delta", "modules")
            && pump.is_some_and(|pump| pump["outputs"].as_str().is_some_and(|o| o.starts_with('1')))
    });
}

#[test]
fn what_is_not_subscribed_to_any_more_is_not_told() {
    let daemon = Daemon::demo("unsub");
    let mut client = Client::open(&daemon);
    client.send(r#"{"sub":["points/pump/do1"]}"#);
    client.until("it begins", |m| is(m, "snapshot", "points/pump/do1"));
    client.send(r#"{"unsub":["points/pump/do1"],"sub":["lines"]}"#);
    client.until("the other begins", |m| is(m, "snapshot", "lines"));
    daemon.send("PUT", "/api/v1/points/pump/do1", r#"{"value":true}"#);
    client.send(r#"{"sub":["points/pump/do0"]}"#);
    let next = client.next().expect("a message");
    assert!(is(&next, "snapshot", "points/pump/do0"), "{next}");
}

#[test]
fn frames_are_told_in_words_of_either_language() {
    let daemon = Daemon::demo("frames");
    for (lang, word) in [("en", "read"), ("zh", "读")] {
        let path = format!("/api/v1/ws?lang={lang}");
        let mut client = Client::try_open(&daemon, "", &path).expect("it is let in");
        client.send(r#"{"sub":["frames/main"]}"#);
        let begin = client.next().expect("a snapshot");
        assert_eq!(
            begin,
            json!({"type": "snapshot", "topic": "frames/main", "seq": 0, "data": []})
        );
        let mut seen = Vec::new();
        while seen.len() < 30 {
            let message = client.until("frames", |m| is(m, "delta", "frames/main"));
            seen.extend(message["frames"].as_array().expect("a list").clone());
        }
        // On a busy machine the simulator may answer too late, and its reply then belongs to no
        // request.
        let in_time = seen
            .iter()
            .take_while(|frame| frame["verdict"] != "missing");
        for frame in in_time {
            assert_eq!(frame["verdict"], "ok", "{seen:?}");
        }
        let told = seen.iter().any(|frame| {
            let meaning = frame["meaning"].as_str().expect("words");
            frame["module"].is_string() && meaning.contains(word)
        });
        assert!(told, "{seen:?}");
        for role in ["request", "reply"] {
            assert!(seen.iter().any(|frame| frame["role"] == role), "{role}");
        }
    }
}

#[test]
fn a_slow_client_is_told_what_it_lost_and_gets_everything_anew() {
    let daemon = Daemon::demo("slow");
    let (mut client, socket) = Client::over_socket(&daemon);
    client.send(r#"{"sub":["frames/main"]}"#);
    client.until("it begins", |m| is(m, "snapshot", "frames/main"));
    // It requests much and reads nothing, until the buffers between are full: then nothing more
    // comes, neither answers nor frames.
    let waiting = || rustix::io::ioctl_fionread(&socket).expect("a socket");
    let mut before = None;
    while before != Some(waiting()) {
        before = Some(waiting());
        client.send(r#"{"sub":["points/#"]}"#);
        let asked = Instant::now();
        while before == Some(waiting()) && asked.elapsed() < Duration::from_secs(2) {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
    // More frames pass than the line buffers for one subscriber; one that reads misses none.
    let mut quick = Client::open(&daemon);
    quick.send(r#"{"sub":["frames/main"]}"#);
    let mut passed = 0;
    while passed < 450 {
        let message = quick.next().expect("the connection lasts");
        assert_ne!(message["type"], "dropped", "{message}");
        passed += message["frames"].as_array().map_or(0, Vec::len);
    }
    let lost = client.until("it is told", |m| is(m, "dropped", "frames/main"));
    assert!(lost["n"].as_u64().is_some_and(|n| n > 0), "{lost}");
    let next = client.until("and how it goes on", |m| m["topic"] == "frames/main");
    assert_eq!(next["type"], "snapshot");
    assert_eq!(
        next["seq"].as_u64(),
        lost["seq"].as_u64().map(|seq| seq + 1)
    );
    client.until("it goes on", |m| is(m, "delta", "frames/main"));
}

#[test]
fn what_can_not_be_taken_is_refused_and_the_connection_lasts() {
    let daemon = Daemon::demo("refuse");
    let mut client = Client::open(&daemon);
    for (wrong, topic, code) in [
        (
            r#"{"sub":["points/nobody/#"]}"#,
            json!("points/nobody/#"),
            "E0801",
        ),
        (
            r#"{"sub":["points/pump/x9"]}"#,
            json!("points/pump/x9"),
            "E0802",
        ),
        (r#"{"sub":["frames/none"]}"#, json!("frames/none"), "E0803"),
        (r#"{"sub":["everything"]}"#, json!("everything"), "E0806"),
        (r#"{"sub":"lines"}"#, Value::Null, "E0806"),
        (r#"{"publish":[]}"#, Value::Null, "E0806"),
        ("hello", Value::Null, "E0806"),
    ] {
        client.send(wrong);
        let told = client.next().expect("an answer");
        assert_eq!(told["type"], "problem", "{told}");
        assert_eq!(told["topic"], topic, "{told}");
        assert_eq!(told["problem"]["code"], code, "{told}");
    }
    // Subscriptions are limited, and the existing ones continue.
    let points = daemon.get("/api/v1/points").json();
    let points = points["points"].as_array().expect("a list").iter();
    let topics: Vec<String> = points
        .map(|point| format!("points/{}", point["path"].as_str().expect("a path")))
        .map(|topic| topic.replace('.', "/"))
        .take(33)
        .collect();
    client.send(&json!({ "sub": topics }).to_string());
    let refused = client.until("one is too many", |m| m["type"] == "problem");
    assert_eq!(refused["topic"], *topics.last().expect("many"));
    assert_eq!(refused["problem"]["code"], "E0105");
    client.send(&json!({ "unsub": topics, "sub": ["lines"] }).to_string());
    client.until("it still answers", |m| is(m, "snapshot", "lines"));
    client.send(&format!("{{\"sub\":[\"{}\"]}}", "x".repeat(70_000)));
    while client.next().is_some() {}
}

#[test]
fn a_page_of_another_site_is_not_let_in() {
    let daemon = Daemon::demo("origin");
    let here = format!("Origin: http://{}\r\n", daemon.address);
    assert!(Client::try_open(&daemon, &here, "/api/v1/ws").is_ok());
    let evil = "Origin: http://evil.example\r\n";
    assert_eq!(
        Client::try_open(&daemon, evil, "/api/v1/ws").err(),
        Some(403)
    );
    let plain = daemon.get("/api/v1/ws");
    assert_eq!(plain.status, 400, "{}", plain.text());
    assert!(
        plain.head.contains("application/problem+json"),
        "{}",
        plain.head
    );
}

#[test]
fn there_is_an_end_to_the_room_and_places_come_back() {
    let daemon = Daemon::demo("room");
    let mut clients: Vec<Client> = (0..512).map(|_| Client::open(&daemon)).collect();
    let refused = Client::try_open(&daemon, "", "/api/v1/ws");
    assert_eq!(refused.err(), Some(503));
    assert_eq!(daemon.get("/api/v1/lines").status, 200, "others are served");
    clients.pop();
    daemon.until("the place is free", |daemon| {
        Client::try_open(daemon, "", "/api/v1/ws").is_ok()
    });
}
