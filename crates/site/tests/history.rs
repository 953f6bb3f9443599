//! History and events: what was kept is told again, and nothing that goes wrong with it holds
//! anything up.

use railbus_site::{Config, Service};
use railbus_store::audit::Origin;
use railbus_store::history::{
    Ack, Chart, Event, EventKind, EventQuery, History, HistoryError, Keep, Sample, SampleQuality,
    Severity, Spread,
};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// A folder that goes with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("railbus-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        Folder(path)
    }

    fn open(&self) -> History {
        History::open(&self.0, Keep::default()).unwrap()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const fn sample(t: i64, value: f64) -> Sample {
    Sample {
        t,
        value: Some(value),
        grade: SampleQuality::Good,
    }
}

const fn gap(t: i64) -> Sample {
    Sample {
        t,
        value: None,
        grade: SampleQuality::Bad,
    }
}

/// A day, in milliseconds, and one long ago.
const DAY: i64 = 86_400_000;
const THEN: i64 = 1_700_000_000_000;

#[tokio::test]
async fn samples_come_back_as_they_were_kept() {
    let folder = Folder::new("history-samples");
    let history = folder.open();
    let path: Arc<str> = Arc::from("tank.ai1");
    let kept = [sample(THEN, 1.5), gap(THEN + 10), sample(THEN + 20, 2.0)];
    for sample in kept {
        assert!(history.sample(Arc::clone(&path), sample));
    }
    let chart = history.chart("tank.ai1", THEN, THEN + 1_000, 600).await;
    assert_eq!(chart, Ok(Chart::Samples(kept.to_vec())));
    // What was in force at the beginning comes first.
    let chart = history
        .chart("tank.ai1", THEN + 15, THEN + 1_000, 600)
        .await;
    assert_eq!(chart, Ok(Chart::Samples(kept[1..].to_vec())));
    let samples = history.samples("tank.ai1", THEN + 5, THEN + 20).await;
    assert_eq!(samples, Ok(vec![kept[1]]));
    let nobody = history.chart("tank.ai9", THEN, THEN + 1, 600).await;
    assert_eq!(nobody, Err(HistoryError::NoSuchPoint));
    assert_eq!(history.storage().await.samples, 3);
}

#[tokio::test]
async fn a_day_of_a_point_is_drawn_in_stretches() {
    let folder = Folder::new("history-day");
    let history = folder.open();
    let path: Arc<str> = Arc::from("tank.ai1");
    for second in 0..86_400_i64 {
        // It answers after what was given before: a full queue would leave a gap.
        if second % 8_000 == 0 {
            history.storage().await;
        }
        let sample = sample(THEN + second * 1_000, f64::from((second % 100) as u32));
        assert!(history.sample(Arc::clone(&path), sample));
    }
    let chart = history.chart("tank.ai1", THEN, THEN + DAY, 600).await;
    let chart = chart.unwrap();
    let Chart::Buckets(buckets) = chart else {
        panic!("too many to tell each");
    };
    assert_eq!(buckets.len(), 600);
    let spread = Spread {
        min: 0.0,
        max: 99.0,
        mean: buckets[0].values.unwrap().mean,
    };
    assert_eq!(buckets[0].values, Some(spread));
    assert!(buckets.iter().all(|bucket| bucket.n == 144));
}

#[tokio::test]
async fn what_was_in_force_when_the_program_ended_is_not_any_more() {
    let folder = Folder::new("history-gap");
    let now = railbus_store::history::millis(std::time::SystemTime::now());
    let history = folder.open();
    history.sample(Arc::from("pump.do0"), sample(now - 5_000, 1.0));
    history.close().await;
    let history = folder.open();
    let chart = history.chart("pump.do0", now - 10_000, now + 10_000, 600);
    let Ok(Chart::Samples(samples)) = chart.await else {
        panic!("they are few");
    };
    assert_eq!(samples.len(), 2);
    assert_eq!(samples[0], sample(now - 5_000, 1.0));
    assert_eq!(
        (samples[1].value, samples[1].grade),
        (None, SampleQuality::Bad)
    );
    assert!(
        samples[1].t >= now,
        "it was known as long as the program ran"
    );
}

#[tokio::test]
async fn events_are_told_in_pages_and_acknowledged() {
    let folder = Folder::new("history-events");
    let service = Service::start_quiet(Config::default()).unwrap();
    service.keep_history(folder.open());
    let mut followed = service.follow_events();
    let who = Origin {
        who: "li".to_owned(),
        via: "http".to_owned(),
    };
    for number in 0..7 {
        let kind = if number % 2 == 0 {
            EventKind::Login
        } else {
            EventKind::Alarm
        };
        let event = Event::new(kind, Severity::Warning, "test").by(&who);
        service.tell_event(event.module("pump").point("do0").text(number.to_string()));
    }
    let first = followed.next().await.unwrap().unwrap();
    assert_eq!((first.text.as_deref(), first.id.len()), (Some("0"), 26));
    let history = service.history().unwrap();
    let ask = |before: Option<String>, kind| EventQuery {
        before,
        limit: 3,
        kind,
        module: Some("pump".to_owned()),
        point: Some("do0".to_owned()),
    };
    let mut next = None;
    let mut texts = Vec::new();
    loop {
        let page = history.events(ask(next, None)).await.unwrap();
        texts.extend(page.events.into_iter().map(|kept| kept.event.text.unwrap()));
        next = page.next;
        if next.is_none() {
            break;
        }
    }
    assert_eq!(texts.join(""), "6543210");
    let logins = history
        .events(ask(None, Some(EventKind::Login)))
        .await
        .unwrap();
    assert_eq!((logins.events.len(), logins.next.is_some()), (3, true));

    let ack = Ack {
        who: "wang".to_owned(),
        at_ms: THEN,
        comment: "看过了".to_owned(),
    };
    assert_eq!(history.acknowledge(&first.id, ack.clone()).await, Ok(true));
    assert_eq!(history.acknowledge("nobody", ack.clone()).await, Ok(false));
    let kept = history.kept_event(&first.id).await.unwrap().unwrap();
    assert_eq!(kept.acked, Some(ack));
    assert_eq!(kept.event.who.as_deref(), Some("li"));
}

#[tokio::test]
async fn old_samples_are_forgotten_but_for_the_one_in_force() {
    let folder = Folder::new("history-age");
    let now = railbus_store::history::millis(std::time::SystemTime::now());
    let history = folder.open();
    let changing: Arc<str> = Arc::from("pump.do0");
    for day in 0..10 {
        let value = f64::from(day % 2);
        history.sample(
            Arc::clone(&changing),
            sample(now - i64::from(10 - day) * DAY, value),
        );
    }
    history.sample(Arc::from("pump.do1"), sample(now - 9 * DAY, 1.0));
    assert_eq!(history.storage().await.samples, 11);
    history.keep(Keep {
        age_ms: 3 * DAY + DAY / 2,
        ..Keep::default()
    });
    let samples = history.samples("pump.do0", 0, now).await.unwrap();
    let days: Vec<i64> = samples
        .iter()
        .map(|sample| (now - sample.t) / DAY)
        .collect();
    assert_eq!(days, [4, 3, 2, 1]);
    let samples = history.samples("pump.do1", 0, now).await.unwrap();
    assert_eq!(samples.len(), 1, "it is still in force");
    assert_eq!(history.storage().await.samples, 5);
}

#[tokio::test]
async fn too_much_is_forgotten_from_the_oldest_on() {
    let folder = Folder::new("history-bytes");
    let now = railbus_store::history::millis(std::time::SystemTime::now());
    let history = folder.open();
    let paths: Vec<Arc<str>> = (0..4).map(|n| Arc::from(format!("pump.do{n}"))).collect();
    for number in 0..20_000 {
        let sample = sample(now - (20_000 - number) * 1_000, 1.0);
        for path in &paths {
            while !history.sample(Arc::clone(path), sample) {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        }
    }
    let before = history.storage().await.bytes;
    history.keep(Keep {
        bytes: before / 2,
        ..Keep::default()
    });
    // On a slow disk it is said before all that is too much is gone.
    while history.storage().await.bytes > before / 2 {}
    let left = history.samples("pump.do0", 0, now).await.unwrap();
    assert!(!left.is_empty());
    assert!(left[0].t > now - 20_000_000, "the oldest went");
}

#[tokio::test]
async fn garbage_is_put_aside_and_a_new_history_begun() {
    let folder = Folder::new("history-garbage");
    std::fs::create_dir_all(&folder.0).unwrap();
    std::fs::write(folder.0.join("history.db"), [0x5A; 20_000]).unwrap();
    let service = Service::start_quiet(Config::default()).unwrap();
    let mut followed = service.follow_events();
    service.keep_history(folder.open());
    let event = followed.next().await.unwrap().unwrap();
    assert_eq!(event.code.as_deref(), Some("history_put_aside"));
    let history = service.history().unwrap();
    history.sample(Arc::from("pump.do0"), sample(THEN, 1.0));
    assert_eq!(history.storage().await.samples, 1);
    let aside = |entry: &std::fs::DirEntry| {
        let name = entry.file_name().into_string().unwrap();
        name.starts_with("history.broken-") && name.ends_with(".db")
    };
    let entries = std::fs::read_dir(&folder.0).unwrap().map(Result::unwrap);
    let aside: Vec<_> = entries.filter(aside).collect();
    assert_eq!(aside.len(), 1);
    assert_eq!(std::fs::read(aside[0].path()).unwrap(), [0x5A; 20_000]);
    let kept = history.events(EventQuery {
        limit: 10,
        ..EventQuery::default()
    });
    let kept = kept.await.unwrap();
    assert!(
        kept.events.iter().any(|kept| kept.event.id == event.id),
        "it is kept, too"
    );
}

#[tokio::test]
async fn a_history_that_breaks_while_it_is_used_is_begun_anew() {
    let folder = Folder::new("history-torn");
    let history = folder.open();
    let path: Arc<str> = Arc::from("pump.do0");
    for number in 0..5_000 {
        history.sample(Arc::clone(&path), sample(THEN + number, 1.0));
    }
    history.close().await;
    // A torn page, and a file that ends too early.
    let file = folder.0.join("history.db");
    let mut bytes = std::fs::read(&file).unwrap();
    let len = bytes.len();
    bytes[4_096..len / 2].fill(0xA5);
    bytes.truncate(len / 2 + 100);
    std::fs::write(&file, bytes).unwrap();
    let service = Service::start_quiet(Config::default()).unwrap();
    let mut followed = service.follow_events();
    let history = folder.open();
    service.keep_history(history.clone());
    history.sample(Arc::clone(&path), sample(THEN, 2.0));
    let event = followed.next().await.unwrap().unwrap();
    assert_eq!(event.code.as_deref(), Some("history_put_aside"));
    history.sample(Arc::clone(&path), sample(THEN + 1, 3.0));
    let samples = history.samples("pump.do0", THEN, THEN + 10).await.unwrap();
    assert_eq!(samples.last(), Some(&sample(THEN + 1, 3.0)));
}

#[tokio::test]
async fn a_folder_that_cannot_be_written_drops_and_counts() {
    let folder = Folder::new("history-nowhere");
    // A file where the folder should be.
    std::fs::write(&folder.0, "").unwrap();
    let history = folder.open();
    for number in 0..10 {
        history.sample(Arc::from("pump.do0"), sample(THEN + number, 1.0));
    }
    let storage = history.storage().await;
    assert!(storage.failing);
    assert_eq!((storage.dropped, storage.samples), (10, 0));
    // Once it can be written, it is.
    std::fs::remove_file(&folder.0).unwrap();
    history.sample(Arc::from("pump.do0"), sample(THEN, 1.0));
    let storage = history.storage().await;
    assert_eq!((storage.failing, storage.samples), (false, 1));
    let _ = std::fs::remove_dir_all(&folder.0);
}
