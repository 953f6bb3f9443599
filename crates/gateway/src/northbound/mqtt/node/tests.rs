//! The machine, without a broker and without a clock.

use super::super::orders::{Target, Wish};
use super::super::topics::TOPIC_MAX;
use super::commands::COMMANDS_MAX;
use super::*;
use railbus_site::{
    BadReason, Batch, Config, Picture, PointQuality, PointReading, PointValue, Service,
};
use railbus_store::history::{EventKind, Severity};
use railbus_wire::Micros;
use std::sync::Arc;
use std::time::SystemTime;

mod values;

const OVEN: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n";
const PUMP: &str = "[module.pump]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 4\n";
const ZERO: Duration = Duration::ZERO;

/// How a site with this configuration is at its beginning.
async fn picture(text: &str) -> Arc<Picture> {
    let config = Config::parse(text).unwrap();
    let service = Service::start(config).unwrap();
    match service.follow().next().await.unwrap() {
        News::Picture(picture) => picture,
        News::Batch(_) => panic!("a picture comes first"),
    }
}

/// A change of one point.
fn change(of: &Picture, path: &str, value: PointValue, quality: PointQuality) -> News {
    let is_it =
        |status: &&railbus_site::PointStatus| format!("{}.{}", status.module, status.label) == path;
    let mut status = of.points.iter().find(is_it).unwrap().clone();
    (status.value, status.quality) = (Some(value), quality);
    status.time = Some(SystemTime::UNIX_EPOCH + Duration::from_secs(1));
    let at = SystemTime::UNIX_EPOCH;
    News::Batch(Arc::new(Batch {
        seq: of.seq + 1,
        changes: of.changes + 1,
        at,
        config: Arc::clone(&of.config),
        points: [PointReading { at, status }].into(),
        modules: Box::default(),
        figures: Box::default(),
        lines: Box::default(),
    }))
}

fn node(old: &[&str]) -> Node {
    Node::new(Setup {
        site: "plant".to_owned(),
        topics: Topics::new("railbus", "plant", BTreeSet::new()),
        events: BTreeSet::new(),
        has_outbox: false,
        old: old.iter().map(|topic| (*topic).to_owned()).collect(),
    })
}

/// Everything that it wants done, each message taken at once.
fn settle(node: &mut Node, now: Duration) -> Vec<(String, String)> {
    let mut told = Vec::new();
    while let Some(output) = node.poll(now) {
        if let Output::Publish(number, message) = output {
            let topic = message.topic.strip_prefix("railbus/plant/");
            let topic = topic.unwrap_or(&message.topic).to_owned();
            let flag = if message.is_retained { "" } else { "!" };
            let payload = String::from_utf8(message.payload).unwrap();
            told.push((format!("{flag}{topic}"), payload));
            node.handle(now, Input::Taken(number, Verdict::Taken));
        }
    }
    told
}

async fn connected(text: &str) -> (Node, Arc<Picture>) {
    let (mut node, picture) = (node(&[]), picture(text).await);
    node.handle(ZERO, Input::News(&News::Picture(Arc::clone(&picture))));
    node.handle(ZERO, Input::Connected);
    settle(&mut node, ZERO);
    (node, picture)
}

fn set(payload: &str) -> Received {
    Received {
        topic: "railbus/plant/oven/k1/set".to_owned(),
        payload: payload.as_bytes().to_vec(),
        ..Received::default()
    }
}

/// The commands and the results that come of a message.
fn given(node: &mut Node, message: Received) -> (Vec<Job>, Vec<(String, Value)>) {
    node.handle(ZERO, Input::Received(message));
    let (mut jobs, mut results) = (Vec::new(), Vec::new());
    while let Some(output) = node.poll(ZERO) {
        match output {
            Output::Carry(job) => jobs.push(*job),
            Output::Publish(number, message) => {
                let result = serde_json::from_slice(&message.payload).unwrap();
                results.push((message.topic, result));
                node.handle(ZERO, Input::Taken(number, Verdict::Taken));
            }
            _ => {}
        }
    }
    (jobs, results)
}

#[tokio::test]
async fn online_comes_after_everything_else() {
    let (mut node, picture) = (node(&[]), picture(OVEN).await);
    node.handle(ZERO, Input::News(&News::Picture(picture)));
    assert!(matches!(node.poll(ZERO), Some(Output::Keep(topics)) if topics.len() == 19));
    assert_eq!(node.poll(ZERO), None, "there is no broker");
    node.handle(ZERO, Input::Connected);
    let subscribe = node.poll(ZERO);
    assert!(matches!(subscribe, Some(Output::Subscribe(_))));
    let told = settle(&mut node, ZERO);
    let topics: Vec<&str> = told.iter().map(|(topic, _)| &**topic).collect();
    assert_eq!(
        topics[..4],
        [
            "bridge/state",
            "bridge/info",
            "oven/k1/state",
            "oven/k1/attr"
        ]
    );
    assert_eq!(topics[18..], ["oven/availability", "bridge/state"]);
    let payload = |topic: &str| {
        let found = told.iter().rev().find(|(told, _)| told == topic);
        found.map(|(_, payload)| payload.as_str())
    };
    assert_eq!(told[0].1, "offline");
    assert_eq!(payload("bridge/state"), Some("online"));
    assert_eq!(payload("oven/k1/state"), Some("None"));
    assert_eq!(payload("oven/availability"), Some("offline"));
}

#[tokio::test]
async fn it_is_online_when_the_broker_has_everything() {
    let (mut node, picture) = (node(&[]), picture(OVEN).await);
    node.handle(ZERO, Input::News(&News::Picture(picture)));
    node.handle(ZERO, Input::Connected);
    let mut numbers = Vec::new();
    while let Some(output) = node.poll(ZERO) {
        assert_ne!(output, Output::Online);
        if let Output::Publish(number, _) = output {
            numbers.push(number);
        }
    }
    for number in numbers {
        assert_eq!(node.poll(ZERO), None);
        node.handle(ZERO, Input::Taken(number, Verdict::Taken));
    }
    let Some(Output::Publish(number, message)) = node.poll(ZERO) else {
        panic!("now it is there");
    };
    assert_eq!(message.payload, b"online");
    assert_eq!(node.poll(ZERO), None);
    node.handle(ZERO, Input::Taken(number, Verdict::Taken));
    assert_eq!(node.poll(ZERO), Some(Output::Online));
}

#[tokio::test]
async fn a_command_is_carried_out_and_its_end_told() {
    let (mut node, _) = connected(OVEN).await;
    let (jobs, results) = given(
        &mut node,
        Received {
            response: Some("answers/7".to_owned()),
            correlation: Some(vec![1, 2]),
            ..set("{\"value\": \"ON\", \"id\": \"a\", \"within_ms\": 900}")
        },
    );
    assert_eq!(results, []);
    let [job] = &jobs[..] else {
        panic!("{jobs:?}");
    };
    let output = Target::Output("oven".to_owned(), "k1".to_owned());
    assert_eq!(
        (&job.order.target, job.order.wish),
        (&output, Wish::Set(true))
    );
    assert_eq!(job.key.as_deref(), Some("a"));
    assert_eq!(Some(job.within), Within::new(Micros(900_000)));
    let end = json!({ "end": "readback", "value": true });
    node.handle(ZERO, Input::Ended(job.reply.clone(), end));
    let mut told = Vec::new();
    while let Some(Output::Publish(_, message)) = node.poll(ZERO) {
        told.push(message);
    }
    let [all, one] = &told[..] else {
        panic!("{told:?}");
    };
    assert_eq!(all.topic, "railbus/plant/oven/k1/result");
    assert_eq!(one.topic, "answers/7");
    assert_eq!(one.correlation, Some(vec![1, 2]));
    assert!(!all.is_retained && all.is_sure);
    let result: Value = serde_json::from_slice(&all.payload).unwrap();
    assert_eq!(
        result,
        json!({ "id": "a", "end": "readback", "value": true })
    );
}

#[tokio::test]
async fn what_is_no_command_is_refused_and_told() {
    let (mut node, _) = connected(OVEN).await;
    let mut code = |message: Received| {
        let (jobs, results) = given(&mut node, message);
        assert_eq!(jobs, []);
        let [(topic, result)] = &results[..] else {
            panic!("{results:?}");
        };
        assert_eq!(topic, "railbus/plant/oven/k1/result");
        assert_eq!(
            (&result["end"], &result["may_have_acted"]),
            (&json!("failed"), &json!(false))
        );
        result["code"].as_str().unwrap().to_owned()
    };
    assert_eq!(code(set("")), "E0806");
    assert_eq!(code(set("ONN")), "E0806");
    assert_eq!(code(set(&" ".repeat(5_000))), "E0806");
    assert_eq!(
        code(set("{\"value\": \"ON\", \"within_ms\": 199}")),
        "E0806"
    );
    let kept = Received {
        is_retained: true,
        ..set("ON")
    };
    assert_eq!(code(kept), "E0806");
    let late = Received {
        expiry: Some(0),
        ..set("ON")
    };
    assert_eq!(code(late), "E0106");
    let clears = Received {
        is_retained: true,
        ..set("")
    };
    assert_eq!(given(&mut node, clears), (vec![], vec![]), "it is none");
}

#[tokio::test]
async fn what_is_left_of_a_message_counts() {
    let (mut node, _) = connected(OVEN).await;
    let mut within = |payload: &str, expiry| {
        let message = Received {
            expiry,
            ..set(payload)
        };
        given(&mut node, message).0.pop().map(|job| job.within)
    };
    let of = |millis: u64| Within::new(Micros(millis * 1_000));
    assert_eq!(within("ON", None), of(5_000));
    assert_eq!(within("ON", Some(2)), of(2_000));
    assert_eq!(within("ON", Some(60)), of(5_000));
    let asked = "{\"value\": \"ON\", \"within_ms\": 9000}";
    assert_eq!(within(asked, Some(60)), of(9_000));
    assert_eq!(within(asked, Some(1)), of(1_000));
}

#[tokio::test]
async fn a_packet_that_comes_again_is_the_same_command() {
    let (mut node, _) = connected(OVEN).await;
    let packet = |packet, is_again, payload| Received {
        packet: Some(packet),
        is_again,
        ..set(payload)
    };
    let mut count = |message| {
        let (jobs, results) = given(&mut node, message);
        (jobs.len(), results.len())
    };
    assert_eq!(count(packet(1, false, "TOGGLE")), (1, 0));
    assert_eq!(count(packet(1, true, "TOGGLE")), (0, 0));
    assert_eq!(count(packet(2, true, "TOGGLE")), (1, 0), "it never came");
    assert_eq!(count(packet(1, true, "OFF")), (1, 0), "another one");
    assert_eq!(count(packet(1, false, "OFF")), (1, 0), "a new one");
    node.handle(ZERO, Input::Lost);
    node.handle(ZERO, Input::Connected);
    settle(&mut node, ZERO);
    let (jobs, _) = given(&mut node, packet(1, true, "OFF"));
    assert_eq!(jobs.len(), 1, "of another connection");
}

#[tokio::test]
async fn more_than_64_commands_at_a_time_are_too_many() {
    let (mut node, _) = connected(OVEN).await;
    let mut jobs = Vec::new();
    for _ in 0..COMMANDS_MAX {
        jobs.extend(given(&mut node, set("ON")).0);
    }
    assert_eq!(jobs.len(), COMMANDS_MAX);
    let (more, results) = given(&mut node, set("ON"));
    assert_eq!((more.len(), &results[0].1["code"]), (0, &json!("E0105")));
    let reply = jobs.pop().unwrap().reply;
    node.handle(ZERO, Input::Ended(reply, json!({})));
    settle(&mut node, ZERO);
    assert_eq!(given(&mut node, set("ON")).0.len(), 1);
}

/// What has another name leaves nothing at the broker.
#[tokio::test]
async fn topics_of_names_that_are_gone_are_cleared() {
    let old = [
        "railbus/plant/stove/k1/state",
        "railbus/plant/oven/k1/state",
    ];
    let (mut node, first) = (node(&old), picture(&format!("{OVEN}{PUMP}")).await);
    node.handle(ZERO, Input::News(&News::Picture(first)));
    let Some(Output::Keep(kept)) = node.poll(ZERO) else {
        panic!("it is remembered before anything is published");
    };
    assert!(
        old.iter()
            .all(|topic| kept.iter().any(|known| known == topic))
    );
    node.handle(ZERO, Input::Connected);
    let told = settle(&mut node, ZERO);
    let stove = ("stove/k1/state".to_owned(), String::new());
    assert!(told.contains(&stove), "of an earlier run");
    let second = picture(OVEN).await;
    node.handle(ZERO, Input::News(&News::Picture(second)));
    let mut kept = Vec::new();
    let mut cleared = Vec::new();
    while let Some(output) = node.poll(ZERO) {
        match output {
            Output::Keep(topics) => kept = topics,
            Output::Publish(number, message) => {
                if message.payload.is_empty() {
                    assert!(message.is_retained && message.is_sure);
                    cleared.push(message.topic);
                }
                node.handle(ZERO, Input::Taken(number, Verdict::Taken));
            }
            _ => {}
        }
    }
    assert_eq!(
        cleared.len(),
        17,
        "eight points and whether it is there: {cleared:?}"
    );
    assert!(
        cleared
            .iter()
            .all(|topic| topic.starts_with("railbus/plant/pump/"))
    );
    assert!(
        !kept
            .iter()
            .any(|topic| topic.contains("pump") || topic.contains("stove"))
    );
}

#[tokio::test]
async fn what_was_on_its_way_is_published_again() {
    let (mut node, _) = connected(OVEN).await;
    let event = |text: &str| {
        let event = Event::new(EventKind::System, Severity::Info, "test").text(text);
        Input::Event(Box::new(event))
    };
    for text in ["a", "b", "c"] {
        node.handle(ZERO, event(text));
    }
    let Some(Output::Publish(first, _)) = node.poll(ZERO) else {
        panic!("an event");
    };
    assert!(matches!(node.poll(ZERO), Some(Output::Publish(..))));
    node.handle(ZERO, Input::Taken(first, Verdict::Taken));
    node.handle(ZERO, Input::Lost);
    assert_eq!(node.poll(ZERO), None);
    node.handle(ZERO, event("d"));
    node.handle(ZERO, Input::Connected);
    let told = settle(&mut node, ZERO);
    let events = told.iter().filter(|(topic, _)| topic == "!event");
    let texts: Vec<String> = events
        .map(|(_, payload)| {
            let event: Value = serde_json::from_str(payload).unwrap();
            event["event"]["text"].as_str().unwrap().to_owned()
        })
        .collect();
    assert_eq!(texts, ["b", "c", "d"]);
    node.handle(ZERO, Input::Lost);
    for _ in 0..QUEUE_MAX + 5 {
        node.handle(ZERO, event("e"));
    }
    assert_eq!(node.counted().dropped, 5);
    assert_eq!(node.waiting(), QUEUE_MAX);
}

#[tokio::test]
async fn it_says_every_ten_seconds_how_it_does() {
    let (mut node, _) = connected(OVEN).await;
    assert_eq!(node.deadline(), Some(HEALTH_EVERY));
    assert_eq!(
        settle(&mut node, HEALTH_EVERY - Duration::from_millis(1)),
        []
    );
    let told = settle(&mut node, HEALTH_EVERY);
    let [(topic, payload)] = &told[..] else {
        panic!("{told:?}");
    };
    assert_eq!(topic, "!bridge/health");
    let health: Value = serde_json::from_str(payload).unwrap();
    assert_eq!(health["modules"], json!({ "online": 0, "offline": 1 }));
    assert_eq!(health["waiting"], 0);
    assert_eq!(node.deadline(), Some(2 * HEALTH_EVERY));
}

#[tokio::test]
async fn at_the_end_it_says_that_it_is_gone() {
    let (mut node, picture) = connected(OVEN).await;
    node.handle(ZERO, Input::Stop { is_gone: false });
    let news = change(
        &picture,
        "oven.k1",
        PointValue::Bool(true),
        PointQuality::Good,
    );
    node.handle(ZERO, Input::News(&news));
    assert!(!node.is_done());
    let told = settle(&mut node, ZERO);
    assert_eq!(told, [("bridge/state".to_owned(), "offline".to_owned())]);
    assert!(node.is_done());
    let (mut node, _) = connected(OVEN).await;
    node.handle(ZERO, Input::Stop { is_gone: true });
    let told = settle(&mut node, ZERO);
    assert_eq!(told.len(), 20, "{told:?}");
    assert!(told[1..].iter().all(|(_, payload)| payload.is_empty()));
    assert_eq!(told[19].0, "bridge/state");
    assert!(node.is_done());
}

/// MQTT names no sender: two of them may use the same correlation data, or empty ones.
#[tokio::test]
async fn correlation_data_makes_no_two_commands_one() {
    let (mut node, _) = connected(OVEN).await;

    for data in [vec![], vec![], vec![7], vec![7]] {
        let message = Received {
            response: Some("answers/7".to_owned()),
            correlation: Some(data.clone()),
            ..set("ON")
        };
        let (mut jobs, _) = given(&mut node, message);
        let job = jobs.pop().unwrap();
        assert_eq!(job.key, None);
        assert_eq!(job.reply.correlation, Some(data));
    }
    let (jobs, _) = given(&mut node, set("{\"value\": \"ON\", \"id\": \"a\"}"));
    assert_eq!(jobs[0].key.as_deref(), Some("a"));
}

/// What this outlet does not publish, it does not command either.
#[tokio::test]
async fn a_command_for_a_module_of_others_is_none() {
    let mut node = Node::new(Setup {
        site: "plant".to_owned(),
        topics: Topics::new("railbus", "plant", BTreeSet::from(["oven".to_owned()])),
        events: BTreeSet::new(),
        has_outbox: false,
        old: BTreeSet::new(),
    });
    node.handle(ZERO, Input::Connected);
    settle(&mut node, ZERO);
    for name in ["pump", "bridge", "event", "scene"] {
        let message = Received {
            topic: format!("railbus/plant/{name}/k1/set"),
            ..set("ON")
        };
        assert_eq!(given(&mut node, message), (vec![], vec![]), "{name}");
    }
    assert_eq!(given(&mut node, set("ON")).0.len(), 1);
}

/// Everything that is published, where the broker refuses these topics.
fn refusing(node: &mut Node, now: Duration, refused: &[&str]) -> Vec<(String, String)> {
    let mut told = Vec::new();
    while let Some(output) = node.poll(now) {
        if let Output::Publish(number, message) = output {
            let topic = message
                .topic
                .trim_start_matches("railbus/plant/")
                .to_owned();
            let verdict = match refused.contains(&&*topic) {
                true => Verdict::Refused,
                false => Verdict::Taken,
            };
            node.handle(now, Input::Taken(number, verdict));
            if topic != "bridge/health" {
                told.push((topic, String::from_utf8(message.payload).unwrap()));
            }
        }
    }
    told
}

fn bridge(word: &str) -> (String, String) {
    ("bridge/state".to_owned(), word.to_owned())
}

/// The broker keeps an older value then: nobody is to believe it.
#[tokio::test]
async fn it_is_offline_while_the_broker_refuses_a_value() {
    let (mut node, picture) = connected(OVEN).await;
    let (state, wait) = ("oven/k1/state", Duration::from_secs(10));
    let on = (PointValue::Bool(true), PointQuality::Good);
    node.handle(ZERO, Input::News(&change(&picture, "oven.k1", on.0, on.1)));
    let told = refusing(&mut node, ZERO, &[state]);
    assert!(told.contains(&bridge("offline")), "{told:?}");
    assert_eq!(node.deadline(), Some(wait));
    assert_eq!(
        refusing(&mut node, wait - Duration::from_millis(1), &[]),
        []
    );
    let value = (state.to_owned(), "ON".to_owned());
    assert_eq!(
        refusing(&mut node, wait, &[state]),
        std::slice::from_ref(&value)
    );
    let told = refusing(&mut node, 2 * wait, &[]);
    assert_eq!(told, [value, bridge("online")]);
    assert_eq!(refusing(&mut node, 2 * wait, &[]), []);
}

#[tokio::test]
async fn it_is_not_online_before_the_broker_has_taken_every_value() {
    let (mut node, picture) = (node(&[]), picture(OVEN).await);
    node.handle(ZERO, Input::News(&News::Picture(picture)));
    node.handle(ZERO, Input::Connected);
    let refused = ["oven/availability", "oven/k2/state"];
    let told = refusing(&mut node, ZERO, &refused);
    assert!(!told.contains(&bridge("online")), "{told:?}");
    let wait = Duration::from_secs(10);
    let told = refusing(&mut node, wait, &refused[..1]);
    assert!(!told.contains(&bridge("online")), "{told:?}");
    let told = refusing(&mut node, 2 * wait, &[]);
    assert_eq!(told.last(), Some(&bridge("online")));
    // Whether it is there can be refused as well.
    node.handle(ZERO, Input::Lost);
    node.handle(ZERO, Input::Connected);
    refusing(&mut node, ZERO, &["bridge/state"]);
    assert_eq!(refusing(&mut node, wait, &[]), [bridge("online")]);
}

#[tokio::test]
async fn what_the_broker_refused_to_clear_is_cleared_with_the_next_connection() {
    let stove = "railbus/plant/stove/k1/state";
    let (mut node, picture) = (node(&[stove]), picture(OVEN).await);
    node.handle(ZERO, Input::News(&News::Picture(picture)));
    let cleared = ("stove/k1/state".to_owned(), String::new());
    for is_last in [false, true] {
        node.handle(ZERO, Input::Connected);
        let refused: &[&str] = if is_last { &[] } else { &["stove/k1/state"] };
        let told = refusing(&mut node, ZERO, refused);
        assert!(told.contains(&cleared), "{told:?}");
        assert_eq!(node.left().is_empty(), is_last);
        node.handle(ZERO, Input::Lost);
    }
    node.handle(ZERO, Input::Connected);
    assert!(!refusing(&mut node, ZERO, &[]).contains(&cleared));
    node.handle(ZERO, Input::Stop { is_gone: true });
    refusing(&mut node, ZERO, &["oven/k1/state"]);
    assert_eq!(node.left(), ["railbus/plant/oven/k1/state"]);
}

/// A result may be why the broker hangs up each time.
#[tokio::test]
async fn a_result_is_published_on_two_connections_and_no_more() {
    let (mut node, _) = connected(OVEN).await;
    node.handle(ZERO, Input::Received(set("what")));
    for round in 0..3 {
        let mut results = 0;
        while let Some(output) = node.poll(ZERO) {
            let Output::Publish(number, message) = output else {
                continue;
            };
            match message.topic.ends_with("/result") {
                true => results += 1,
                false => node.handle(ZERO, Input::Taken(number, Verdict::Taken)),
            }
        }
        assert_eq!(results, usize::from(round < 2), "{round}");
        node.handle(ZERO, Input::Lost);
        assert_eq!(node.counted().dropped, u64::from(round == 1), "{round}");
        node.handle(ZERO, Input::Connected);
    }
}

#[tokio::test]
async fn a_topic_whose_result_would_have_none_is_no_command() {
    let (mut node, _) = connected(OVEN).await;
    let rest = "railbus/plant/oven//set".len();
    let mut of = |len: usize| {
        let label = "k".repeat(len - rest);
        let topic = format!("railbus/plant/oven/{label}/set");
        let response = Some("a".repeat(TOPIC_MAX + 1));
        given(
            &mut node,
            Received {
                topic,
                response,
                ..set("ON")
            },
        )
        .0
    };
    assert_eq!(of(TOPIC_MAX), []);
    let jobs = of(TOPIC_MAX - "result".len() + "set".len());
    assert_eq!(jobs[0].reply.response, None);
}

/// The values at the broker are old then, and its will must say so.
#[tokio::test]
async fn a_broker_that_acknowledges_nothing_is_none() {
    let (mut node, picture) = connected(OVEN).await;
    let (next, limit) = (Duration::from_secs(3), Duration::from_secs(10));
    let (on, good) = (PointValue::Bool(true), PointQuality::Good);
    node.handle(ZERO, Input::News(&change(&picture, "oven.k1", on, good)));
    let Some(Output::Publish(number, _)) = node.poll(ZERO) else {
        panic!("a value");
    };
    while node.poll(next).is_some() {}
    assert_eq!(node.deadline(), Some(limit));
    assert!(!node.is_stuck(limit - Duration::from_millis(1)));
    assert!(node.is_stuck(limit));
    node.handle(limit, Input::Taken(number, Verdict::Taken));
    assert!(!node.is_stuck(limit), "of the next one");
    assert!(node.is_stuck(limit + next));
}
