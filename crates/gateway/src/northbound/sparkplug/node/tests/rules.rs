//! What hosts rely on in every message, whatever it is about. [`HostJudge`] holds the rest of it.

use super::stage::value;
use super::*;
use std::collections::BTreeSet;

/// A module of each kind of point: outputs, inputs, counters, analog values.
const EVERY: &str = "[line.main]\nport = \"/dev/ttyS99\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
    [module.hall]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 4\n\
    [module.door]\nline = \"main\"\nmodel = \"eda9050\"\naddress = 5\n\
    [module.tank]\nline = \"main\"\nmodel = \"emd2a2q\"\naddress = 6\n";
const REBIRTH: &str = "Node Control/Rebirth";

/// What is published until there is nothing more to do. A host hears it.
fn published(stage: &mut Stage) -> Vec<(Message, Payload)> {
    let mut all = Vec::new();
    while let Some(output) = stage.node.poll(stage.now()) {
        if let Output::Publish(number, message) = output {
            stage.judge.heard(&message);
            stage.handle(Input::Went(number));
            let payload = Payload::parse(&message.payload).unwrap();
            all.push((message, payload));
        }
    }
    all
}

fn rebirth(stage: &mut Stage) {
    let wanted = Metric::new(REBIRTH, 0, Some(MetricValue::Boolean(true)));
    stage.command("NCMD/n", &Payload::new(vec![wanted]));
}

/// One with modules of all kinds, all of which answer and none of which was read.
async fn with_every_module() -> Stage {
    let mut stage = Stage::new(None, true).await;
    stage.picture = picture(EVERY).await;
    let every = Arc::clone(&stage.picture);
    stage.news(&News::Picture(every));
    stage.modules(&["oven", "hall", "door", "tank"].map(|module| (module, true)));
    stage
}

#[tokio::test]
async fn every_message_has_its_topic_and_the_time_at_which_it_is_sent() {
    let mut stage = Stage::new(None, false).await;
    stage.modules(&[("oven", true)]);
    stage.handle(Input::Connected(7));
    stage.handle(Input::Subscribed);
    stage.now += 50;
    let mut all = published(&mut stage);
    assert!(all.iter().all(|(_, of)| of.timestamp == Some(stage.now)));
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.modules(&[("oven", false)]);
    stage.now += 50;
    let later = published(&mut stage);
    assert!(later.iter().all(|(_, of)| of.timestamp == Some(stage.now)));
    all.extend(later);
    let topics = all.iter().map(|(message, _)| &*message.topic);
    let expected = ["NBIRTH/n", "DBIRTH/n/oven", "DDATA/n/oven", "DDEATH/n/oven"];
    let expected = expected.into_iter().chain(["NDATA/n"]);
    let expected = expected.map(|topic| format!("spBv1.0/g/{topic}"));
    assert!(topics.eq(expected), "{all:?}");
}

#[tokio::test]
async fn births_and_data_say_all_that_a_host_needs_of_each_metric() {
    let mut stage = with_every_module().await;
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.handle(Input::Connected(7));
    stage.handle(Input::Subscribed);
    // The rules of metrics are held by the host.
    let births = published(&mut stage);
    let (node, _) = births.split_first().unwrap();
    let named = |name: &str| {
        let mut all = node.1.metrics.iter();
        all.find(|metric| metric.name.as_deref() == Some(name))
            .unwrap()
    };
    let rebirth_metric = named(REBIRTH);
    assert_eq!(rebirth_metric.datatype, Some(11));
    assert_eq!(rebirth_metric.value, Some(MetricValue::Boolean(false)));
    assert_eq!(named("Missing/From").is_null, Some(true));
    let typed = births.iter().flat_map(|(_, payload)| &payload.metrics);
    let types: BTreeSet<u32> = typed.filter_map(|metric| metric.datatype).collect();
    assert_eq!(
        types,
        BTreeSet::from([4, 10, 11, 12, 13]),
        "all of them occur"
    );
    let its = births.iter().flat_map(|(_, payload)| &payload.metrics);
    let k1 = |metric: &&Metric| metric.name.as_deref() == Some("k1") && metric.value.is_some();
    let known: Vec<_> = its.clone().filter(k1).map(|k1| &k1.value).collect();
    assert_eq!(known, [&Some(MetricValue::Boolean(true))], "as it is now");
    let has_unit = |metric: &Metric| property(metric, "engUnit").is_some();
    assert!(its.clone().any(has_unit));
    // Now as data: what was read, what is stale, what is gone, an answer, and the node itself.
    for quality in [
        PointQuality::Stale,
        PointQuality::Bad(BadReason::NeverRead),
        PointQuality::Good,
    ] {
        stage.happens("oven.k1", false, quality);
    }
    stage.order("k9", MetricValue::Boolean(true));
    stage.modules(&[("hall", false)]);
    assert_eq!(published(&mut stage).len(), 6);
    rebirth(&mut stage);
    let again = published(&mut stage);
    let kinds = again.iter().map(|(message, _)| message.topic.split('/'));
    let kinds = kinds.map(|mut levels| levels.nth(2).unwrap());
    assert!(kinds.eq(["NBIRTH", "DBIRTH", "DBIRTH", "DBIRTH"]));
    let of_oven = again
        .iter()
        .find(|(message, _)| message.topic.ends_with("oven"));
    let oven = &of_oven.unwrap().1;
    assert_eq!(value(oven, "k1"), Some(MetricValue::Boolean(false)));
    assert_eq!(
        value(oven, "Last Command/Metric"),
        Some(MetricValue::Text("k9".to_owned()))
    );
}

#[tokio::test]
async fn no_two_metrics_differ_in_case_only() {
    let mut stage = with_every_module().await;
    stage.handle(Input::Connected(7));
    stage.handle(Input::Subscribed);
    for (message, payload) in published(&mut stage) {
        let names = payload.metrics.iter().map(|metric| metric.name.as_deref());
        let lower: BTreeSet<String> = names.map(|name| name.unwrap().to_lowercase()).collect();
        assert_eq!(lower.len(), payload.metrics.len(), "{}", message.topic);
    }
}

#[tokio::test]
async fn births_come_first_and_in_one_block() {
    let mut stage = Stage::new(None, true).await;
    stage.modules(&[("oven", true), ("pump", true)]);
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.stored();
    assert_eq!(published(&mut stage), [], "there is no connection");
    stage.handle(Input::Connected(7));
    let first = stage.node.poll(stage.now()).unwrap();
    assert!(matches!(first, Output::Subscribe(_)), "{first:?}");
    stage.happens("oven.k1", false, PointQuality::Good);
    stage.stored();
    assert_eq!(published(&mut stage), [], "nobody could ask for anything");
    stage.handle(Input::Subscribed);
    stage.happens("pump.do1", true, PointQuality::Good);
    stage.modules(&[("oven", false)]);
    stage.stored();
    let told = stage.settle();
    let births = ["NBIRTH", "DBIRTH oven", "DBIRTH pump"];
    assert_eq!(told[..3], births);
    assert!(told.len() > 5, "{told:?}");
    let is_birth = |message: &String| message.contains("BIRTH");
    assert!(!told[3..].iter().any(is_birth), "{told:?}");
    stage.modules(&[("oven", true)]);
    stage.settle();
    // What waits is told with the births.
    stage.happens("oven.k1", true, PointQuality::Good);
    rebirth(&mut stage);
    stage.happens("pump.do1", false, PointQuality::Good);
    let told = stage.settle();
    assert_eq!(told[..3], births);
    assert_eq!(told[3..], ["DDATA pump do1=false"]);
}

#[tokio::test]
async fn births_and_the_death_have_the_number_of_the_will() {
    let mut stage = Stage::connected(false).await;
    let will = death(&stage.node.setup.topics, 7);
    assert_eq!(will.topic, "spBv1.0/g/NDEATH/n");
    assert!(will.is_sure && !will.is_retained);
    let payload = Payload::parse(&will.payload).unwrap();
    assert_eq!((payload.seq, payload.metrics.len()), (None, 1));
    let number = |payload: &Payload| {
        let mut all = payload.metrics.iter();
        let metric = all.find(|metric| metric.name.as_deref() == Some("bdSeq"));
        let metric = metric.unwrap();
        (metric.datatype, metric.value.clone())
    };
    let seven = (Some(4), Some(MetricValue::Long(7)));
    assert_eq!(number(&payload), seven);
    assert_eq!(stage.judge.bd_seq, Some(7));
    rebirth(&mut stage);
    let again = published(&mut stage);
    assert_eq!(number(&again[0].1), seven);
    stage.handle(Input::Stop);
    let last = published(&mut stage);
    let messages: Vec<&Message> = last.iter().map(|(message, _)| message).collect();
    assert_eq!(messages, [&will]);
}

#[tokio::test]
async fn after_255_comes_0_whatever_is_told() {
    let mut stage = Stage::connected(false).await;
    let mut numbers: BTreeMap<String, BTreeSet<u64>> = BTreeMap::new();
    // Five messages each time, so that each of them has every number once.
    for round in 0..256 {
        stage.happens("oven.k1", round % 2 == 0, PointQuality::Good);
        stage.modules(&[("oven", false)]);
        stage.modules(&[("oven", true)]);
        for (message, payload) in published(&mut stage) {
            let kind = message.topic.split('/').nth(2).unwrap().to_owned();
            let of_kind = numbers.entry(kind).or_default();
            of_kind.insert(payload.seq.unwrap());
        }
    }
    let kinds: Vec<&str> = numbers.keys().map(String::as_str).collect();
    assert_eq!(kinds, ["DBIRTH", "DDATA", "DDEATH", "NDATA"]);
    let is_all = |of_kind: &BTreeSet<u64>| of_kind.iter().copied().eq(0..=255);
    assert!(numbers.values().all(is_all), "{numbers:?}");
}
