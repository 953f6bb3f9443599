//! Rules against the past.

use crate::{rule, site};
use jiff::tz::TimeZone;
use railbus_site::rules::{Fact, LISTED_MAX, Replay};
use railbus_site::{Config, Service};
use railbus_store::history::{History, Keep, Sample, SampleQuality};
use std::sync::Arc;

const THEN: &str = "then = [{ notify = \"now\" }]";
const SWITCH: &str = "when = { point = \"oven.k1\", is = true }\nfor = \"10s\"";

fn replay(when: &str, since: i64, until: i64) -> Replay {
    Replay::new(
        &rule(&format!("{when}\n{THEN}")),
        TimeZone::UTC,
        since,
        until,
    )
}

#[test]
fn what_was_so_before_counts_and_is_not_listed() {
    let mut tried = replay(SWITCH, 100_000, 200_000);
    tried.take(20_000, Fact::Is(true));
    assert_eq!(tried.end().count, 0, "it had acted before");
    let mut tried = replay(SWITCH, 100_000, 200_000);
    tried.take(95_000, Fact::Is(true));
    tried.take(120_000, Fact::Is(false));
    tried.take(130_000, Fact::Is(true));
    tried.take(139_999, Fact::Unknown);
    tried.take(150_000, Fact::Is(true));
    tried.take(195_000, Fact::Is(false));
    tried.take(250_000, Fact::Is(true));
    let tried = tried.end();
    assert_eq!((tried.acts, tried.count), (vec![105_000, 160_000], 2));
    assert_eq!((tried.unknown_ms, tried.stopped), (10_001, None));
}

#[test]
fn it_is_stopped_in_the_past_as_it_would_be_now() {
    let when = "when = { point = \"oven.k1\", is = true }";
    let mut tried = replay(when, 0, 10_000_000);
    for second in 0..4_000 {
        tried.take(second * 2_000, Fact::Is(true));
        tried.take(second * 2_000 + 1_000, Fact::Is(false));
    }
    let tried = tried.end();
    assert_eq!((tried.count, tried.stopped), (60, Some(120_000)));
    let mut slow = replay(when, 0, i64::from(u32::MAX) * 100);
    for hour in 0..1_000 {
        slow.take(hour * 3_600_000, Fact::Is(true));
        slow.take(hour * 3_600_000 + 1_000, Fact::Is(false));
    }
    let slow = slow.end();
    assert_eq!((slow.count, slow.acts.len()), (1_000, LISTED_MAX));
}

#[test]
fn a_time_of_day_needs_no_history() {
    let day = 86_400_000;
    let begin = 20_000 * day + 23_400_000;
    let tried = replay("when = { time = \"06:30\" }", begin, begin + 2 * day).end();
    assert_eq!(
        (tried.acts, tried.unknown_ms),
        (vec![begin, begin + day], 0)
    );
}

#[tokio::test]
async fn a_rule_is_tried_against_what_was_kept() {
    let folder = std::env::temp_dir().join(format!("railbus-rules-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let history = History::open(&folder, Keep::default()).unwrap();
    let text = site(&format!("{SWITCH}\n{THEN}"));
    let config = Config::parse(&text).unwrap();
    let service = Service::start_quiet(config.clone()).unwrap();
    let rule = &config.rules["night"];
    assert!(
        service.try_rule(rule, (0, 1)).await.is_err(),
        "there is no history"
    );
    service.keep_history(history.clone());
    let then = 1_700_000_000_000;
    let path: Arc<str> = Arc::from("oven.k1");
    // More samples than are read at a time.
    for n in 0..5_000 {
        let sample = Sample {
            t: then + n * 1_000,
            value: Some(f64::from(u8::from(n == 0 || n / 15 % 2 == 1))),
            grade: SampleQuality::Good,
        };
        while !history.sample(Arc::clone(&path), sample) {
            tokio::task::yield_now().await;
        }
    }
    assert!(!service.is_tried(rule));
    let tried = service
        .try_rule(rule, (then + 500, then + 5_000_000))
        .await
        .unwrap();
    assert_eq!(
        tried.count, 60,
        "each 15 s in which it was on, until that was too often"
    );
    assert_eq!(tried.stopped.map(|at| (at - then) / 1_000), Some(1_825));
    assert!(service.is_tried(rule));
    let mut other = rule.clone();
    other.armed = true;
    assert!(service.is_tried(&other), "it acts as that");
    other.hold = railbus_wire::Micros(1);
    assert!(!service.is_tried(&other));
    history.close().await;
    let _ = std::fs::remove_dir_all(&folder);
}
