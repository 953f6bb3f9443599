//! The stream of a site, for several who follow it.

use crate::board::{self, k, until};
use crate::{start, start_absent};
use railbus_site::{
    Config, News, Picture, PointQuality, PointReading, PointValue, Service, WriteTerms,
};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

async fn picture(follower: &mut railbus_site::Follower) -> Arc<Picture> {
    match follower.next().await {
        Some(News::Picture(picture)) => picture,
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn all_who_follow_are_given_the_same() {
    let (port, _relays) = board::start().await;
    let service = start(&port);
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    let (mut one, mut other) = (service.follow(), service.follow());
    let known = picture(&mut one).await;
    assert!(Arc::ptr_eq(&known, &picture(&mut other).await));
    assert_eq!(known.points[0].quality, PointQuality::Good);
    let set = [(k(1), true)];
    let written = service.write("oven", &set, WriteTerms::default());
    written.await.unwrap();
    let is_on = |reading: &PointReading| {
        reading.status.point == k(1) && reading.status.value == Some(PointValue::Bool(true))
    };
    loop {
        let (News::Batch(a), News::Batch(b)) =
            (one.next().await.unwrap(), other.next().await.unwrap())
        else {
            panic!("a picture");
        };
        assert!(Arc::ptr_eq(&a, &b));
        if let Some(reading) = a.points.iter().find(|reading| is_on(reading)) {
            let read = reading.status.time.unwrap();
            assert!(known.at < read && read <= reading.at && reading.at <= SystemTime::now());
            assert_eq!(service.point("oven", k(1)).unwrap().time, Some(read));
            break;
        }
    }
    service.close().await;
}

#[tokio::test]
async fn a_value_that_nobody_reads_any_more_is_told_to_be_stale() {
    let (port, _relays) = board::start().await;
    let text = format!(
        "[line.main]\nport = \"{port}\"\n[module.oven]\nline = \"main\"\nmodel = \"erc8\"\n\
         address = 3\npoll = \"1h\"\nmax_age = \"300ms\"\n"
    );
    let service = Service::start(Config::parse(&text).unwrap()).unwrap();
    let mut follower = service.follow();
    let mut seen = Vec::new();
    while seen != [PointQuality::Good, PointQuality::Stale] {
        if let Some(News::Batch(batch)) = follower.next().await {
            let of_first = batch.points.iter().filter(|p| p.status.point == k(1));
            seen.extend(of_first.map(|reading| reading.status.quality));
        }
    }
    service.close().await;
}

#[tokio::test]
async fn who_is_too_slow_is_given_a_picture_and_how_much_it_missed() {
    let service = start_absent();
    let mut slow = service.follow();
    let before = picture(&mut slow).await;
    // Each reload is told as a picture: more of them than wait for anybody.
    let text = crate::text("/dev/railbus-test-nothing-here");
    for _ in 0..300 {
        service.reload(&text).await.unwrap();
    }
    let after = picture(&mut slow).await;
    assert!(after.seq >= before.seq + 300);
    assert_eq!(slow.missed(), after.changes - before.changes);
    let mut prompt = service.follow();
    let newest = picture(&mut prompt).await;
    assert_eq!((newest.seq, prompt.missed()), (after.seq, 0));
    service.close().await;
}

#[tokio::test]
async fn a_follower_does_not_keep_the_site() {
    let service = start_absent();
    let mut follower = service.follow();
    service.close().await;
    drop(service);
    let end = async { while follower.next().await.is_some() {} };
    tokio::time::timeout(Duration::from_secs(20), end)
        .await
        .expect("it has gone");
}

/// Commands follow each other faster than batches do.
#[tokio::test]
async fn the_effect_of_a_command_is_known_at_once_to_a_follower_that_asks_for_it() {
    let (port, _relays) = board::start().await;
    let service = start(&port);
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    let mut follower = service.follow();
    assert!(matches!(follower.next_now(), Some(News::Picture(_))));
    for is_on in [true, false, true, false] {
        let set = [(k(1), is_on)];
        let written = service.write("oven", &set, WriteTerms::default());
        written.await.unwrap();
        let mut known = None;
        while let Some(News::Batch(batch)) = follower.next_now() {
            let readings = batch.points.iter();
            for reading in readings.filter(|reading| reading.status.point == k(1)) {
                known = reading.status.value;
            }
        }
        assert_eq!(known, Some(PointValue::Bool(is_on)));
    }
    service.close().await;
}
