//! Commands under keys, for whoever brings them: no request of any network is needed.

use crate::board::{self, Boards, k, until};
use crate::text;
use railbus_site::{CommandKey, Config, KeyRefusal, Service, ToggleTerms};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

async fn site_in(folder: &Path) -> (Service, Arc<Boards>) {
    let (port, boards) = board::start().await;
    let config = Config::parse(&text(&port)).unwrap();
    let service = Service::start_in(config, folder).unwrap();
    service.opened("main").await.unwrap();
    (service, boards)
}

/// What an outlet would do with a message that it may get twice.
async fn toggle(service: &Service, key: &str) -> Result<Value, KeyRefusal> {
    let key = CommandKey {
        key: key.to_owned(),
        caller: "mqtt main".to_owned(),
        command: vec![b"toggle".to_vec(), b"oven.k1".to_vec()],
    };
    let site = service.clone();
    let work = async move {
        let done = site.toggle("oven", k(1), ToggleTerms::default()).await;
        json!(
            done.map(|done| done.outputs[0].1)
                .map_err(|failure| failure.name())
        )
    };
    service.once(key, work).await
}

#[tokio::test]
async fn a_command_that_comes_twice_acts_once() {
    let folder = crate::safety::folder("keys-twice");
    let (service, boards) = site_in(&folder).await;
    let (one, two) = tokio::join!(toggle(&service, "a"), toggle(&service, "a"));
    assert_eq!(one, Ok(json!({ "Ok": true })));
    assert_eq!(two, one);
    assert_eq!(
        (toggle(&service, "a").await, boards.writes().len()),
        (one, 1)
    );
    assert_eq!(toggle(&service, "b").await, Ok(json!({ "Ok": false })));
    service.close().await;

    let (service, boards) = site_in(&folder).await;
    assert_eq!(toggle(&service, "a").await, Ok(json!({ "Ok": true })));
    assert!(boards.writes().is_empty());
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

/// The program is killed between the frame and its end.
#[tokio::test]
async fn what_was_under_way_when_the_program_was_killed_is_not_done_again() {
    let folder = crate::safety::folder("keys-killed");
    let after = crate::safety::folder("keys-killed-after");
    std::fs::create_dir_all(&after).unwrap();
    let (service, boards) = site_in(&folder).await;
    let asked = service.clone();
    let under_way = tokio::spawn(async move { toggle(&asked, "a").await });
    until(|| !boards.writes().is_empty()).await;
    std::fs::copy(folder.join("keys.log"), after.join("keys.log")).unwrap();
    assert_eq!(under_way.await.unwrap(), Ok(json!({ "Ok": true })));
    service.close().await;

    let text = std::fs::read_to_string(after.join("keys.log")).unwrap();
    let begun = text.lines().next().unwrap_or_default().to_owned();
    // Whatever was written of its end by then.
    std::fs::write(after.join("keys.log"), begun + "\n").unwrap();
    let (service, boards) = site_in(&after).await;
    assert_eq!(toggle(&service, "a").await, Err(KeyRefusal::Begun));
    assert!(boards.writes().is_empty());
    service.close().await;
    for folder in [folder, after] {
        let _ = std::fs::remove_dir_all(folder);
    }
}

#[tokio::test]
async fn a_command_under_a_key_ends_though_nobody_waits() {
    let folder = crate::safety::folder("keys-gone");
    let (service, boards) = site_in(&folder).await;
    let gone = tokio::time::timeout(Duration::from_millis(1), toggle(&service, "a")).await;
    assert!(gone.is_err(), "{gone:?}");
    // Another one goes while the frame is on its way, and not before it.
    boards.slow(100);
    let asked = service.clone();
    let gone = tokio::spawn(async move { toggle(&asked, "b").await });
    until(|| boards.writes().len() == 2).await;
    gone.abort();
    boards.slow(0);
    assert_eq!(toggle(&service, "b").await, Ok(json!({ "Ok": false })));
    assert_eq!(boards.writes().len(), 2);
    assert_eq!(toggle(&service, "a").await, Ok(json!({ "Ok": true })));
    assert_eq!(boards.writes().len(), 2);
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

/// Without a folder nothing outlives the process: what asks for once is not carried out.
#[tokio::test]
async fn a_site_without_a_folder_takes_no_keys() {
    let (port, boards) = board::start().await;
    let service = Service::start(Config::parse(&text(&port)).unwrap()).unwrap();
    let refused = toggle(&service, "a").await;
    assert!(
        matches!(refused, Err(KeyRefusal::NotKept(_))),
        "{refused:?}"
    );
    assert!(service.keys_failed().is_some() && boards.writes().is_empty());
    service.close().await;
}
