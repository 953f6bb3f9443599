//! The machine, without a broker and without a clock.

mod ledger;
mod past;
mod rules;
mod stage;

use super::super::payload::PropertyKind;
use super::commands::COMMANDS_MAX;
use super::*;
use railbus_host::Presence;
use railbus_site::{BadReason, ModuleStatus, Picture, PointQuality, PointValue};
use railbus_store::outbox::EntryKind;
use stage::{BEGIN, SITE, Stage, brief, picture, property, wall_time};

#[tokio::test]
async fn a_module_is_born_while_it_answers() {
    let mut stage = Stage::connected(false).await;
    assert_eq!(stage.judge.bd_seq, Some(7));
    stage.modules(&[("pump", true)]);
    assert_eq!(stage.settle(), ["DBIRTH pump", "NDATA Modules/Answering=2"]);
    stage.happens("oven.k1", true, PointQuality::Good);
    assert_eq!(stage.settle(), ["DDATA oven k1=true"]);
    stage.modules(&[("oven", false)]);
    assert_eq!(stage.settle(), ["DDEATH oven", "NDATA Modules/Answering=1"]);
    stage.happens("oven.k1", true, PointQuality::Bad(BadReason::Offline));
    assert_eq!(stage.settle(), [""; 0], "it is dead");
    stage.modules(&[("oven", true)]);
    assert_eq!(stage.settle(), ["DBIRTH oven", "NDATA Modules/Answering=2"]);
}

#[tokio::test]
async fn a_value_that_is_not_good_says_so_and_the_next_good_one_too() {
    let mut stage = Stage::connected(false).await;
    stage.happens("oven.k1", false, PointQuality::Stale);
    stage.happens("oven.k1", false, PointQuality::Bad(BadReason::NeverRead));
    stage.happens("oven.k1", false, PointQuality::Good);
    stage.happens("oven.k1", true, PointQuality::Good);
    let told = ["k1=false/500", "k1=null/0", "k1=false/192", "k1=true"];
    let told = told.map(|metric| format!("DDATA oven {metric}"));
    assert_eq!(stage.settle(), told);
}

/// The reply came after the value had become too old: its request is older than that moment.
#[tokio::test]
async fn what_is_told_later_has_no_earlier_time() {
    let mut stage = Stage::connected(false).await;
    stage.happens("oven.k1", false, PointQuality::Stale);
    stage.settle();
    let mut status = stage.status("oven.k1");
    (status.value, status.quality) = (Some(PointValue::Bool(true)), PointQuality::Good);
    status.time = Some(wall_time(stage.now - 2));
    stage.reading(status);
    stage.happens("oven.k1", true, PointQuality::Stale);
    let device = stage.node.devices.get_mut("oven").unwrap();
    let point = device.find("k1").unwrap().point;
    let metric = device.metric(point, stage.now + 9).unwrap();
    assert!(metric.timestamp >= Some(stage.now));
    let told = stage.settle();
    assert_eq!(told, ["DDATA oven k1=true/192", "DDATA oven k1=true/500"]);
    assert!(stage.judge.times.is_sorted(), "{:?}", stage.judge.times);
}

#[tokio::test]
async fn with_its_line_a_module_dies() {
    let mut stage = Stage::connected(false).await;
    stage.figures(&[("oven", false)]);
    assert_eq!(stage.settle(), ["DDEATH oven", "NDATA Modules/Answering=0"]);
    stage.figures(&[("oven", true)]);
    assert_eq!(stage.settle(), ["DBIRTH oven", "NDATA Modules/Answering=1"]);
}

#[tokio::test]
async fn a_birth_says_what_a_metric_is() {
    let mut stage = Stage::connected(false).await;
    let birth = stage.node.devices.get_mut("oven").unwrap();
    let metrics = birth.birth(&stage.node.setup.rights, BEGIN + 50);
    let of = |name: &str| {
        let mut all = metrics.iter();
        all.find(|metric| metric.name.as_deref() == Some(name))
            .unwrap()
    };
    let k1 = of("k1");
    assert_eq!(k1.datatype, Some(11));
    assert_eq!(property(k1, "readOnly"), Some(PropertyKind::Boolean(false)));
    assert_eq!(property(k1, "Quality"), None);
    assert_eq!(k1.timestamp, Some(BEGIN + 2), "when it was read");
    let k2 = of("k2");
    assert_eq!(property(k2, "readOnly"), Some(PropertyKind::Boolean(true)));
    assert_eq!(property(k2, "Quality"), Some(PropertyKind::Int(0)));
    assert_eq!((k2.is_null, &k2.value), (Some(true), &None), "never read");
    for name in ["Metric", "End", "Code", "Time"] {
        assert_eq!(of(&format!("Last Command/{name}")).is_null, Some(true));
    }
}

#[tokio::test]
async fn a_command_is_answered_with_what_is_so_afterwards() {
    let mut stage = Stage::connected(false).await;
    stage.order("k1", MetricValue::Boolean(true));
    assert_eq!(stage.settle(), [""; 0]);
    let job = stage.jobs.pop().unwrap();
    assert_eq!((&*job.device, &*job.label, job.on), ("oven", "k1", true));
    stage.happens("oven.k1", true, PointQuality::Good);
    let end = |end, code: &str| JobEnd {
        device: "oven".to_owned(),
        label: "k1".to_owned(),
        end,
        code: code.to_owned(),
    };
    stage.handle(Input::Ended(end("readback", "")));
    let time = stage.now;
    let last = |end: &str, code: &str| {
        format!(
            "Last Command/Metric=\"k1\" Last Command/End=\"{end}\" Last Command/Code=\"{code}\" \
             Last Command/Time={time}"
        )
    };
    let told = stage.settle();
    assert_eq!(told[0], "DDATA oven k1=true");
    assert_eq!(
        told[1],
        format!("DDATA oven k1=true {}", last("readback", ""))
    );
    // What is not known is not said to be: here the module fell silent.
    stage.order("k1", MetricValue::Boolean(false));
    stage.settle();
    stage.modules(&[("oven", false)]);
    stage.handle(Input::Ended(end("unknown", "E0302")));
    assert_eq!(stage.settle(), ["DDEATH oven", "NDATA Modules/Answering=0"]);
    assert_eq!(
        stage.node.devices["oven"].last.as_ref().unwrap().end,
        "unknown"
    );
}

#[tokio::test]
async fn what_is_no_command_moves_nothing_and_says_why() {
    let mut stage = Stage::connected(false).await;
    let on = || MetricValue::Boolean(true);
    let code = |stage: &mut Stage| {
        let told = stage.settle().concat();
        assert!(stage.jobs.is_empty(), "{told}");
        assert!(told.contains("Last Command/End=\"failed\""), "{told}");
        let (_, code) = told.split_once("Code=\"").unwrap();
        code[..5].to_owned()
    };
    stage.order("k9", on());
    assert_eq!(code(&mut stage), "E0802");
    stage.order("x1", on());
    assert!(["E0802", "E0807"].contains(&&*code(&mut stage)));
    stage.order("k1", MetricValue::Int(1));
    assert_eq!(code(&mut stage), "E0806");
    for (name, time) in [
        ("old", Some(stage.now - 5_001)),
        ("ahead", Some(stage.now + 5_001)),
        ("none", None),
    ] {
        let payload = Payload {
            timestamp: time,
            ..Payload::new(vec![Metric::new("k1", 0, Some(on()))])
        };
        stage.command("DCMD/n/oven", &payload);
        assert_eq!(code(&mut stage), "E0106", "{name}");
    }
    assert_eq!(stage.wrong.len(), 6);
    // Here there is nobody who could be told.
    let payload = Payload {
        timestamp: Some(stage.now),
        ..Payload::new(vec![Metric::new("k1", 0, Some(on()))])
    };
    for topic in ["DCMD/n/pump", "DCMD/n/nothing"] {
        stage.command(topic, &payload);
    }
    stage.handle(Input::Received(Received {
        topic: "spBv1.0/g/DCMD/n/oven".to_owned(),
        payload: payload.bytes(),
        is_retained: true,
        ..Received::default()
    }));
    // The metrics of a flood would each get an answer.
    let flood = Payload::new(vec![Metric::new("k1", 0, Some(on())); COMMANDS_MAX + 1]);
    let flood = Payload {
        timestamp: Some(stage.now),
        ..flood
    };
    let long = Metric::new(&"k".repeat(70_000), 0, Some(on()));
    let long = Payload {
        timestamp: Some(stage.now),
        ..Payload::new(vec![long])
    };
    for bytes in [&b"\xff\xff\xff"[..], &flood.bytes(), &long.bytes()] {
        stage.handle(Input::Received(Received {
            topic: "spBv1.0/g/DCMD/n/oven".to_owned(),
            payload: bytes.to_vec(),
            ..Received::default()
        }));
    }
    assert_eq!(code(&mut stage), "E0806", "retained");
    assert_eq!(stage.wrong.len(), 12, "{:?}", stage.wrong);
    stage.command("DCMD/other/oven", &payload);
    stage.settle();
    assert!(
        stage.jobs.is_empty() && stage.wrong.len() == 12,
        "of another node"
    );
}

#[tokio::test]
async fn a_command_that_is_delivered_again_is_one() {
    let mut stage = Stage::connected(false).await;
    let payload = Payload {
        timestamp: Some(stage.now),
        ..Payload::new(vec![Metric::new("k1", 0, Some(MetricValue::Boolean(true)))])
    };
    for is_again in [false, true, false] {
        stage.handle(Input::Received(Received {
            topic: "spBv1.0/g/DCMD/n/oven".to_owned(),
            payload: payload.bytes(),
            packet: Some(5),
            is_again,
            ..Received::default()
        }));
    }
    stage.settle();
    assert_eq!(
        stage.jobs.len(),
        2,
        "the third one is not said to be the first"
    );
}

#[tokio::test]
async fn only_so_many_commands_are_under_way() {
    let mut stage = Stage::connected(false).await;
    for _ in 0..=COMMANDS_MAX {
        stage.order("k1", MetricValue::Boolean(true));
    }
    let told = stage.settle().concat();
    assert_eq!(stage.jobs.len(), COMMANDS_MAX);
    assert!(told.contains("E0105"), "{told}");
}

#[tokio::test]
async fn a_host_that_asks_gets_all_births_again_in_one_block() {
    let mut stage = Stage::connected(false).await;
    stage.happens("oven.k1", true, PointQuality::Good);
    let rebirth = |on| Metric::new("Node Control/Rebirth", 0, Some(MetricValue::Boolean(on)));
    // Without any time, as the TCK asks.
    stage.command("NCMD/n", &Payload::new(vec![rebirth(true)]));
    stage.command("NCMD/n", &Payload::new(vec![rebirth(true)]));
    let told = stage.settle();
    assert_eq!(
        told,
        ["NBIRTH", "DBIRTH oven"],
        "the change is in the birth"
    );
    stage.happens("oven.k1", false, PointQuality::Good);
    stage.command("NCMD/n", &Payload::new(vec![rebirth(false)]));
    assert_eq!(stage.settle(), ["DDATA oven k1=false"]);
    stage.command("NCMD/n", &Payload::new(vec![Metric::new("x", 0, None)]));
    stage.handle(Input::Received(Received {
        topic: "spBv1.0/g/NCMD/n".to_owned(),
        payload: Payload::new(vec![rebirth(true)]).bytes(),
        is_retained: true,
        ..Received::default()
    }));
    assert_eq!(stage.settle(), [""; 0]);
    assert_eq!(stage.wrong.len(), 2);
}

#[tokio::test]
async fn nobody_is_told_anything_while_the_primary_host_is_away() {
    let mut stage = Stage::new(Some("scada"), false).await;
    stage.modules(&[("oven", true)]);
    stage.handle(Input::Connected(0));
    stage.handle(Input::Subscribed);
    assert_eq!(stage.settle(), [""; 0]);
    stage.order("k1", MetricValue::Boolean(true));
    stage.state(false, 10);
    assert_eq!(stage.settle(), [""; 0]);
    assert!(stage.jobs.is_empty(), "nothing was born");
    assert!(!stage.is_host_away, "it is given a moment");
    let by = stage.node.deadline().unwrap();
    stage.now = BEGIN + u64::try_from(by.as_millis()).unwrap();
    assert_eq!(stage.settle(), [""; 0]);
    assert!(stage.is_host_away);
    assert_eq!(stage.node.deadline(), None, "it is told once");
    stage.state(true, 10);
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven"]);
    assert!(!stage.is_host_away);
    stage.state(false, 9);
    stage.state(true, 11);
    assert_eq!(stage.settle(), [""; 0], "an older one, and the same");
    assert!(!stage.node.is_dead());
    stage.state(false, 11);
    assert_eq!(stage.settle(), ["NDEATH"]);
    assert!(stage.node.is_dead());
    stage.handle(Input::Lost);
    stage.handle(Input::Connected(1));
    stage.handle(Input::Subscribed);
    stage.state(true, 9);
    assert_eq!(
        stage.settle(),
        [""; 0],
        "kept by the broker, of another time"
    );
    stage.state(true, 12);
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven"]);
}

#[tokio::test]
async fn at_the_end_it_says_that_it_is_dead() {
    let mut stage = Stage::connected(false).await;
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.handle(Input::Stop);
    assert!(!stage.node.is_dead());
    assert_eq!(stage.settle(), ["NDEATH"]);
    assert!(stage.node.is_dead());
    let mut waits = Stage::new(Some("scada"), false).await;
    waits.handle(Input::Connected(0));
    waits.handle(Input::Subscribed);
    waits.settle();
    waits.handle(Input::Stop);
    assert!(waits.node.is_dead(), "nobody was told that it lives");
}

#[tokio::test]
async fn a_module_with_other_points_dies_and_is_born_again() {
    let mut stage = Stage::connected(false).await;
    let named = format!("{SITE}[module.oven.point.k1]\nlocked = true\n");
    let next = picture(&named).await;
    let mut modules = next.modules.clone();
    modules[0].presence = Presence::Online;
    let only = |module: &str| -> Box<[ModuleStatus]> {
        let all = modules.iter().filter(|one| one.name == module);
        all.cloned().collect()
    };
    let mut told = |modules| {
        let picture = Picture {
            seq: 9,
            changes: 9,
            at: wall_time(stage.now),
            config: Arc::clone(&next.config),
            points: next.points.clone(),
            modules,
            lines: next.lines.clone(),
        };
        stage.news(&News::Picture(Arc::new(picture)));
        stage.settle()
    };
    assert_eq!(told(only("oven")), ["DDEATH oven", "DBIRTH oven"]);
    assert_eq!(told(only("oven")), [""; 0], "nothing is new");
    let gone = told(only("pump"));
    assert_eq!(gone, ["DDEATH oven", "NDATA Modules/Answering=0"]);
}

#[tokio::test]
async fn a_broker_that_does_not_answer_is_left() {
    let mut stage = Stage::connected(false).await;
    stage.now += 2_000;
    stage.settle();
    assert_eq!(stage.asked, 1);
    stage.now += 9_999;
    stage.settle();
    assert!(!stage.node.is_stuck(stage.now()));
    stage.now += 1;
    assert!(stage.node.is_stuck(stage.now()));
    assert_eq!(
        stage.node.deadline(),
        Some(Duration::from_millis(stage.now - BEGIN))
    );
    let last = stage.last;
    stage.handle(Input::Arrived(last));
    assert!(!stage.node.is_stuck(stage.now()));
    assert_eq!(stage.node.deadline(), None, "there is nothing to ask for");
    stage.settle();
    assert_eq!(stage.asked, 1);
}

#[tokio::test]
async fn while_the_broker_is_slow_births_take_the_place_of_what_waits() {
    let mut stage = Stage::connected(false).await;
    for round in 0..=QUEUE_MAX {
        stage.happens("oven.k1", round % 2 == 0, PointQuality::Good);
    }
    let told = stage.settle();
    assert_eq!(told[0], "NBIRTH");
    assert!(told.len() < 10, "{}", told.len());
    assert_eq!(stage.node.counted().dropped, QUEUE_MAX as u64 + 1);
}
