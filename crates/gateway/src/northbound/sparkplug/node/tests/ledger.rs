//! What of the past is where: on the disk, in memory, told, or missing and told so.

use super::*;

#[tokio::test]
async fn what_is_only_in_memory_stays_written_down_until_it_was_told() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.handle(Input::Lost);
    stage.happens("oven.k1", true, PointQuality::Good);
    let first = stage.now;
    stage.modules(&[("oven", false)]);
    stage.stored();
    stage.settle();
    assert_eq!(stage.held, Some((first, first)));
    assert_eq!(stage.delivered.last(), Some(&2), "it is deleted");
    // The module is back; the broker is not.
    stage.modules(&[("oven", true)]);
    stage.happens("oven.k1", false, PointQuality::Good);
    stage.stored();
    stage.settle();
    assert_eq!(
        stage.held,
        Some((first, first)),
        "it is still only in memory"
    );
    stage.connect(8);
    stage.settle();
    stage.answer();
    assert_eq!(stage.held, None);
}

/// The entries of an outage have later times than the births after it.
#[tokio::test]
async fn nothing_is_lost_where_the_clock_is_set_back_in_an_outage() {
    let mut stage = Stage::connected(true).await;
    stage.piece = 256;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.handle(Input::Lost);
    for round in 0..4_000 {
        stage.happens("oven.k1", round % 2 == 0, PointQuality::Good);
    }
    stage.now += 60_000;
    stage.happens("oven.k1", true, PointQuality::Good);
    let lost = stage.now;
    stage.now -= 30_000;
    stage.happens("oven.k1", false, PointQuality::Good);
    stage.stored();
    stage.settle();
    stage.connect(8);
    let mut told = stage.settle().concat();
    stage.now += 40_000;
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.stored();
    for _ in 0..40 {
        told += &stage.settle().concat();
        let last = stage.last;
        stage.handle(Input::Arrived(last));
    }
    told += &stage.settle().concat();
    let lost = format!("k1=true/192@{}", lost - BEGIN);
    assert!(told.contains(&lost));
    assert_eq!(stage.node.waiting(), 0);
}

#[tokio::test]
async fn what_happened_in_the_same_millisecond_is_not_taken_for_told() {
    let mut stage = Stage::connected(true).await;
    stage.modules(&[("pump", true)]);
    stage.stored();
    stage.settle();
    stage.answer();
    stage.together(&[("oven.k1", true)]);
    let (_, first) = stage.one();
    stage.now -= 1;
    stage.together(&[("pump.do1", true)]);
    stage.stored();
    stage.handle(Input::Went(first));
    stage.handle(Input::Arrived(first));
    stage.handle(Input::Lost);
    stage.connect(8);
    let told = stage.settle().concat();
    assert!(told.contains("DDATA pump do1=true/192@"), "{told}");
}

#[tokio::test]
async fn a_gap_in_a_span_that_is_known_is_told_as_well() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    for (from, until) in [(10, 90_000), (20, 80_000)] {
        stage.gap(from, until);
        stage.stored();
        assert!(stage.settle().concat().contains("Missing/Until"));
        stage.answer();
    }
    assert_eq!(stage.delivered.last(), Some(&3));
    assert_eq!(stage.node.waiting(), 0);
}

#[tokio::test]
async fn what_is_too_much_to_hold_is_told_whenever_it_is_found() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.handle(Input::Lost);
    let more = super::super::super::backlog::HELD_MAX + 5;
    stage.piece = more;
    let entry = stage.entries[0].clone();
    for nth in 0..more {
        let mut entry = entry.clone();
        entry.at = i64::try_from(BEGIN - 100_000 + nth as u64).unwrap();
        stage.entries.push(entry);
    }
    stage.stored();
    stage.settle();
    stage.connect(8);
    let (_, nbirth) = stage.one();
    stage.modules(&[("oven", false)]);
    stage.handle(Input::Went(nbirth));
    stage.handle(Input::Arrived(nbirth));
    stage.settle();
    let missing = (Some(BEGIN - 100_000), BEGIN - 100_000 + 4);
    assert_eq!(stage.judge.missing, Some(missing));
    let kept = stage.held.unwrap();
    assert_eq!(
        kept.0,
        missing.0.unwrap(),
        "and kept until that has arrived"
    );
    stage.answer();
    assert_eq!(stage.held.unwrap().0, missing.1 + 1);
}
