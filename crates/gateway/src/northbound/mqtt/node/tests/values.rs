//! What is told of a value.

use super::*;

#[tokio::test]
async fn a_value_is_told_while_it_is_good() {
    let (mut node, picture) = connected(OVEN).await;
    let mut told = |value, quality| {
        let news = change(&picture, "oven.k1", value, quality);
        node.handle(ZERO, Input::News(&news));
        settle(&mut node, ZERO)
    };
    let (on, good) = (PointValue::Bool(true), PointQuality::Good);
    let first = told(on, good);
    assert_eq!(first[0], ("oven/k1/state".to_owned(), "ON".to_owned()));
    let attr: Value = serde_json::from_str(&first[1].1).unwrap();
    assert_eq!(attr["quality"], "good");
    assert_eq!(attr["time"], "1970-01-01T00:00:01.000Z");
    assert!(attr["max_age_ms"].is_u64(), "{attr}");
    assert_eq!(told(on, good), [], "nothing is new");
    let stale = told(on, PointQuality::Stale);
    assert_eq!(stale[0].1, "None");
    assert!(stale[1].1.contains("\"stale\""));
    assert_eq!(told(PointValue::Bool(false), good)[0].1, "OFF");
    let gone = told(on, PointQuality::Bad(BadReason::LineAbsent));
    assert_eq!(gone[0].1, "None");
    assert!(gone[1].1.contains("line_absent"), "{gone:?}");
}

/// Or a reader would take the quality and time of the new one for those of the value before.
#[tokio::test]
async fn a_value_is_told_before_its_quality_and_time() {
    let (mut node, picture) = connected(OVEN).await;
    let tell = |node: &mut Node, on| {
        let value = PointValue::Bool(on);
        let news = change(&picture, "oven.k1", value, PointQuality::Good);
        node.handle(ZERO, Input::News(&news));
    };
    let stale = change(
        &picture,
        "oven.k1",
        PointValue::Bool(true),
        PointQuality::Stale,
    );
    tell(&mut node, true);
    let Some(Output::Publish(number, first)) = node.poll(ZERO) else {
        panic!("the value");
    };
    node.handle(ZERO, Input::Taken(number, Verdict::Taken));
    assert_eq!(
        (&*first.topic, &*first.payload),
        ("railbus/plant/oven/k1/state", &b"ON"[..])
    );
    // Its quality is due, and then something else.
    node.handle(ZERO, Input::News(&stale));
    let told = settle(&mut node, ZERO);
    assert_eq!(told.len(), 2, "{told:?}");
    assert_eq!(told[0], ("oven/k1/state".to_owned(), "None".to_owned()));
    assert!(told[1].1.contains("\"stale\""), "{told:?}");
    // And with changes on top of it.
    tell(&mut node, true);
    tell(&mut node, false);
    let told = settle(&mut node, ZERO);
    assert_eq!(told.len(), 2, "{told:?}");
    assert_eq!(told[0], ("oven/k1/state".to_owned(), "OFF".to_owned()));
    assert_eq!(node.waiting(), 0);
}

/// A value that changes as fast as the broker takes messages.
#[tokio::test]
async fn a_restless_value_keeps_no_other_waiting() {
    let (mut node, picture) = connected(OVEN).await;
    let tell = |node: &mut Node, path, round: u64| {
        let value = PointValue::Bool(round.is_multiple_of(2));
        let mut news = change(&picture, path, value, PointQuality::Good);
        if let News::Batch(batch) = &mut news
            && let Some(batch) = Arc::get_mut(batch)
        {
            let read_at = SystemTime::UNIX_EPOCH + Duration::from_secs(round);
            batch.points[0].status.time = Some(read_at);
        }
        node.handle(ZERO, Input::News(&news));
    };
    tell(&mut node, "oven.k1", 2);
    tell(&mut node, "oven.k2", 2);
    let mut told = Vec::new();
    for round in 3..43 {
        tell(&mut node, "oven.k1", round);
        let Some(Output::Publish(number, message)) = node.poll(ZERO) else {
            panic!("{told:?}");
        };
        node.handle(ZERO, Input::Taken(number, Verdict::Taken));
        told.push(message.topic);
    }
    let count = |topic: &str| told.iter().filter(|told| told.ends_with(topic)).count();
    assert_eq!((count("k2/state"), count("k2/attr")), (1, 1), "{told:?}");
    assert!(count("k1/attr") > 5, "{told:?}");
    settle(&mut node, ZERO);
    assert_eq!(node.waiting(), 0);
}

/// While the broker is slow the newest value replaces the one before, and nothing piles up.
#[tokio::test]
async fn the_newest_value_wins() {
    let (mut node, picture) = connected(&format!("{OVEN}{PUMP}")).await;
    let mut held = Vec::new();
    for round in 0..1_000_u32 {
        for label in ["k1", "k2", "k3"] {
            let (path, on) = (format!("oven.{label}"), round % 2 == 0);
            let news = change(&picture, &path, PointValue::Bool(on), PointQuality::Good);
            node.handle(ZERO, Input::News(&news));
        }
        while let Some(output) = node.poll(ZERO) {
            let Output::Publish(number, _) = output else {
                panic!("{output:?}");
            };
            held.push(number);
        }
    }
    assert_eq!(held.len(), WINDOW);
    assert!(node.waiting() <= WINDOW + 6, "{}", node.waiting());
    for number in held {
        node.handle(ZERO, Input::Taken(number, Verdict::Taken));
    }
    let told = settle(&mut node, ZERO);
    let states = told.iter().filter(|(topic, _)| topic.ends_with("/state"));
    assert!(states.clone().count() <= 3);
    assert!(
        states.clone().all(|(_, payload)| payload == "OFF"),
        "{told:?}"
    );
    assert_eq!(node.waiting(), 0);
}
