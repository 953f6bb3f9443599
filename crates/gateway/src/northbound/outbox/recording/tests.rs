use super::*;
use railbus_site::{BadReason, Config, News, PointReading, PointValue, Service};
use std::sync::Arc;
use std::time::Duration;

const OVEN: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n";
const PUMP: &str = "[module.pump]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 4\n";

async fn picture(text: &str) -> Arc<Picture> {
    let service = Service::start(Config::parse(text).unwrap()).unwrap();
    match service.follow().next().await.unwrap() {
        News::Picture(picture) => Arc::new(again(&picture, 0, 0)),
        News::Batch(_) => panic!("a picture comes first"),
    }
}

/// The same at this time, after so many changes more.
fn again(picture: &Picture, seconds: u64, changes: u64) -> Picture {
    Picture {
        seq: picture.seq + changes,
        changes: picture.changes + changes,
        at: at(seconds),
        config: Arc::clone(&picture.config),
        points: picture.points.clone(),
        modules: Box::default(),
        lines: Box::default(),
    }
}

fn at(seconds: u64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)
}

/// The first relay, switched at this time.
fn switched(of: &Picture, seconds: u64, on: bool, quality: PointQuality) -> Batch {
    let mut status = of.points[0].clone();
    assert_eq!(path_of(&status), "oven.k1");
    (status.value, status.quality) = (Some(PointValue::Bool(on)), quality);
    status.time = Some(at(seconds));
    let reading = PointReading {
        at: at(seconds),
        status,
    };
    Batch {
        seq: of.seq + 1,
        changes: of.changes + 1,
        at: at(seconds),
        config: Arc::clone(&of.config),
        points: [reading].into(),
        modules: Box::default(),
        figures: Box::default(),
        lines: Box::default(),
    }
}

fn recording() -> Recording {
    Recording::new(Box::new(|module| module != "hidden"))
}

/// What is written now, in short.
fn write(recording: &mut Recording, seconds: u64) -> Vec<String> {
    let told = |entry: &OutboxEntry| match &entry.what {
        EntryKind::Reading {
            path,
            value,
            quality,
            ..
        } => {
            let value = value.as_deref().unwrap_or("-");
            format!("{} {path} {value} {quality}", entry.at / 1_000)
        }
        EntryKind::Gap { from, reason } => {
            let from = from.map(|from| from / 1_000);
            format!("{} gap {reason} {from:?}", entry.at / 1_000)
        }
    };
    let written = recording.waiting(at(seconds)).iter().map(told).collect();
    recording.written();
    assert!(!recording.is_waiting());
    written
}

#[tokio::test]
async fn everything_comes_first_and_then_only_what_is_new() {
    let picture = picture(OVEN).await;
    let mut recording = recording();
    recording.opened(None);
    recording.picture(&picture, 0);
    let first = write(&mut recording, 1);
    assert_eq!(first.len(), picture.points.len(), "{first:?}");
    assert!(
        first.iter().all(|told| told.ends_with(" - bad")),
        "{first:?}"
    );

    for (seconds, on) in [(2, true), (3, true), (4, false)] {
        recording.batch(&switched(&picture, seconds, on, PointQuality::Good));
    }
    let told = ["2 oven.k1 true good", "4 oven.k1 false good"];
    assert_eq!(write(&mut recording, 5), told);
    // What is bad is not known, whatever it was before.
    let bad = PointQuality::Bad(BadReason::Offline);
    recording.batch(&switched(&picture, 6, false, PointQuality::Stale));
    recording.batch(&switched(&picture, 7, false, bad));
    let told = ["6 oven.k1 false stale", "7 oven.k1 - bad"];
    assert_eq!(write(&mut recording, 8), told);
    assert_eq!(write(&mut recording, 9), [""; 0]);
}

#[tokio::test]
async fn after_a_gap_everything_is_told_and_since_when_it_may_be_missing() {
    let picture = picture(OVEN).await;
    let all = picture.points.len();
    let mut recording = recording();
    recording.opened(Some(100_000));
    recording.picture(&picture, 0);
    let told = write(&mut recording, 200);
    assert_eq!(
        (told.len(), &*told[0]),
        (1 + all, "200 gap stopped Some(100)")
    );

    recording.batch(&switched(&picture, 300, true, PointQuality::Good));
    assert_eq!(write(&mut recording, 301), ["300 oven.k1 true good"]);
    recording.batch(&switched(&picture, 302, false, PointQuality::Good));
    // It was too slow for the site: what waits is told as it is now.
    let mut later = again(&picture, 400, 900);
    later.points[0] = switched(&picture, 399, true, PointQuality::Good).points[0]
        .status
        .clone();
    recording.picture(&later, 7);
    let told = write(&mut recording, 401);
    assert_eq!(
        (told.len(), &*told[0]),
        (1 + all, "401 gap overrun Some(300)")
    );
    assert!(
        told.contains(&"400 oven.k1 true good".to_owned()),
        "{told:?}"
    );
}

#[tokio::test]
async fn while_the_disk_fails_no_more_waits_than_there_is_room_for() {
    let picture = picture(OVEN).await;
    let mut recording = recording();
    recording.opened(None);
    recording.picture(&picture, 0);
    write(&mut recording, 1);
    recording.batch(&switched(&picture, 2, true, PointQuality::Good));
    write(&mut recording, 3);
    for second in 0..50_000 {
        recording.batch(&switched(
            &picture,
            10 + second,
            second % 2 == 0,
            PointQuality::Good,
        ));
        let most = WAITING_MAX + picture.points.len() + 1;
        assert!(recording.waiting.len() <= most);
        // It is tried again and again, and fails.
        if second % 999 == 0 {
            recording.waiting(at(10 + second));
        }
    }
    let told = write(&mut recording, 60_000);
    assert!(told[0].ends_with(" gap disk Some(2)"), "{}", told[0]);
    assert_eq!(told.last().unwrap(), "50009 oven.k1 false good");
}

#[tokio::test]
async fn a_point_that_is_no_more_is_told_as_removed() {
    let both = picture(&format!("{OVEN}{PUMP}")).await;
    let mut recording = recording();
    recording.opened(None);
    recording.picture(&both, 0);
    write(&mut recording, 1);
    recording.picture(&*picture(OVEN).await, 0);
    let told = write(&mut recording, 2);
    assert_eq!(told.len(), both.points.len() - 8, "{told:?}");
    let is_pump = |told: &String| told.contains(" pump.") && told.ends_with(" - bad");
    assert!(told.iter().all(is_pump), "{told:?}");
    // And comes again.
    recording.picture(&both, 0);
    assert_eq!(write(&mut recording, 3).len(), told.len());
}

#[tokio::test]
async fn modules_that_are_not_told_are_not_written() {
    let picture = picture(&OVEN.replace("oven", "hidden")).await;
    let mut recording = recording();
    recording.opened(None);
    recording.picture(&picture, 0);
    assert_eq!(write(&mut recording, 1), [""; 0]);
}

#[tokio::test]
async fn a_gap_does_not_end_before_it_began() {
    let mut recording = recording();
    recording.opened(Some(500_000));
    assert_eq!(write(&mut recording, 200), ["200 gap stopped Some(200)"]);
}
