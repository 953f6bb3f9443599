//! What is promised of outputs, over the end of the process: what is on the disk at the moment of
//! an answer, and what a process that finds it does. The process ends as by a signal that can't
//! be caught: its file is taken as it is then.

use crate::board::{self, Boards, k, until};
use crate::safety::{config, folder, known, switch};
use railbus_site::{CommandError, Config, LeaseTerms, Pulse, Service, Within};
use railbus_store::audit::End;
use railbus_wire::Micros;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

const NAME: &str = "promises.json";

async fn site_in(folder: &Path) -> (Service, Arc<Boards>) {
    let (port, boards) = board::start().await;
    let service = Service::start_in(config(&port, ""), folder).unwrap();
    known(&service).await;
    (service, boards)
}

fn kept(folder: &Path) -> String {
    std::fs::read_to_string(folder.join(NAME)).unwrap_or_default()
}

const LONG: Pulse = Pulse {
    width: Some(Micros::from_secs(600)),
    by: railbus_site::By::Host,
    off: false,
    confirm: false,
    within: Within::DEFAULT,
};

async fn hold(service: &Service, millis: u64) -> Result<Duration, CommandError> {
    let held = (true, Micros::from_millis(millis));
    let held = service
        .lease("oven", k(1), held, LeaseTerms::default())
        .await;
    held.map(|held| held.left)
}

/// What the file says of when the first promise is due.
fn due(folder: &Path) -> SystemTime {
    let document: serde_json::Value = serde_json::from_str(&kept(folder)).unwrap();
    let at = document["promises"][0]["at_ms"].as_u64().unwrap();
    SystemTime::UNIX_EPOCH + Duration::from_millis(at)
}

/// A site that begins with what the file of another one was, at its own board.
async fn after_a_crash(folder: &Path, name: &str, relays: u8) -> (Service, Arc<Boards>, PathBuf) {
    let again = crate::safety::folder(name);
    std::fs::create_dir_all(&again).unwrap();
    std::fs::copy(folder.join(NAME), again.join(NAME)).unwrap();
    let (port, boards) = board::start().await;
    boards.set(3, relays);
    let service = Service::start_in(config(&port, ""), &again).unwrap();
    (service, boards, again)
}

#[tokio::test]
async fn a_pulse_that_was_taken_over_is_off_the_disk_before_that_is_told() {
    let folder = folder("taken");
    let (service, _boards) = site_in(&folder).await;
    for _ in 0..10 {
        service.pulse("oven", k(1), LONG).await.unwrap();
        assert!(kept(&folder).contains("pulse"));
        switch(&service, "oven", 1, true).await.unwrap();
        assert!(!kept(&folder).contains("pulse"), "{}", kept(&folder));
        // Nor does an older one come back with a newer one.
        for _ in 0..2 {
            service.pulse("oven", k(1), LONG).await.unwrap();
        }
        assert_eq!(kept(&folder).matches("pulse").count(), 1);
    }
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

#[tokio::test]
async fn a_takeover_that_can_not_be_written_down_is_told_and_the_pulse_ends() {
    let folder = folder("refused");
    let (service, boards) = site_in(&folder).await;
    let pulse = Pulse {
        width: Some(Micros::from_millis(1_000)),
        ..LONG
    };
    service.pulse("oven", k(1), pulse).await.unwrap();
    // A folder in the place of the draft keeps everybody from writing, root as well.
    let draft = folder.join(format!("{NAME}.new"));
    std::fs::create_dir(&draft).unwrap();
    let refused = switch(&service, "oven", 1, true).await;
    assert!(
        matches!(refused, Err(CommandError::NotTakenOver(_))),
        "{refused:?}"
    );
    assert!(refused.unwrap_err().may_have_acted());
    assert!(service.point("oven", k(1)).unwrap().left.pulse.is_some());
    until(|| boards.relays(3) == 0).await;
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

#[tokio::test]
async fn a_lease_is_on_the_disk_as_it_was_told() {
    let folder = folder("lease");
    let (service, _boards) = site_in(&folder).await;
    for millis in [400, 60_000, 2_500] {
        let left = hold(&service, millis).await.unwrap();
        let told = SystemTime::now() + left;
        let off = told
            .duration_since(due(&folder))
            .unwrap_or_else(|error| error.duration());
        assert!(off < Duration::from_millis(100), "{millis}: {off:?}");
    }
    // Where the disk refuses it is not held on, and that is told.
    std::fs::create_dir(folder.join(format!("{NAME}.new"))).unwrap();
    let refused = hold(&service, 60_000).await;
    assert!(
        matches!(refused, Err(CommandError::NotKept(_))),
        "{refused:?}"
    );
    let left = service.point("oven", k(1)).unwrap().left.lease.unwrap();
    assert!(left <= Duration::from_millis(2_500), "{left:?}");
    std::fs::remove_dir(folder.join(format!("{NAME}.new"))).unwrap();
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

#[tokio::test]
async fn a_lease_ends_when_it_was_to_end_however_often_the_process_does() {
    let folder = folder("crashes");
    let (service, _boards) = site_in(&folder).await;
    hold(&service, 3_000).await.unwrap();
    let ends = due(&folder);
    let mut last = folder.clone();
    let mut copies = Vec::new();
    while ends.duration_since(SystemTime::now()).is_ok() {
        let name = format!("crash-{}", copies.len());
        let (again, boards, copy) = after_a_crash(&last, &name, 1).await;
        tokio::time::sleep(Duration::from_millis(700)).await;
        let left = again.point("oven", k(1)).unwrap().left.lease;
        let left = left.unwrap_or_default();
        let until_end = ends.duration_since(SystemTime::now()).unwrap_or_default();
        assert!(left <= until_end + Duration::from_millis(50), "{left:?}");
        last.clone_from(&copy);
        copies.push((again, boards, copy));
    }
    assert!(copies.len() > 2, "it was held over several of them");
    // Each of them ends it, the last one as well.
    for (_, boards, _) in &copies {
        until(|| boards.relays(3) == 0).await;
    }
    for (service, _, copy) in copies {
        service.close().await;
        let _ = std::fs::remove_dir_all(copy);
    }
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

#[tokio::test]
async fn a_lease_that_was_renewed_holds_after_a_crash_until_it_said() {
    let folder = folder("renewed");
    let (service, _boards) = site_in(&folder).await;
    hold(&service, 400).await.unwrap();
    hold(&service, 60_000).await.unwrap();
    let (again, _relays, copy) = after_a_crash(&folder, "renewed-again", 1).await;
    let left = again.point("oven", k(1)).unwrap().left.lease.unwrap();
    assert!(left > Duration::from_secs(30), "{left:?}");
    again.close().await;
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
    let _ = std::fs::remove_dir_all(copy);
}

#[tokio::test]
async fn a_clock_that_was_set_back_does_not_hold_an_output_at_every_start_anew() {
    let folder = folder("clock");
    std::fs::create_dir_all(&folder).unwrap();
    let hour = SystemTime::now() + Duration::from_secs(3_600);
    let at = hour.duration_since(SystemTime::UNIX_EPOCH).unwrap();
    let text = format!(
        "{{\"schema\":1,\"promises\":[{{\"module\":\"oven\",\"output\":0,\"why\":\"lease\",\
         \"end\":false,\"at_ms\":{},\"length_ms\":2000}}]}}",
        at.as_millis()
    );
    std::fs::write(folder.join(NAME), text).unwrap();
    let (port, _boards) = board::start().await;
    let service = Service::start_in(config(&port, ""), &folder).unwrap();
    let latest = SystemTime::now() + Duration::from_secs(2);
    until(|| due(&folder) <= latest).await;
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

/// While the daemon does not run, the names of two boards are exchanged in the file.
#[tokio::test]
async fn the_end_of_a_pulse_never_meets_another_board_of_that_name_after_a_restart() {
    let folder = folder("exchanged");
    let (service, boards) = site_in(&folder).await;
    let before = service.config().lines["main"].port.clone();
    service.pulse("oven", k(1), LONG).await.unwrap();
    service.pulse("yard", k(2), LONG).await.unwrap();
    let again = crate::safety::folder("exchanged-again");
    std::fs::create_dir_all(&again).unwrap();
    std::fs::copy(folder.join(NAME), again.join(NAME)).unwrap();
    service.close().await;
    assert!(kept(&again).contains("\"board\""), "{}", kept(&again));

    // The pulse of the board at address 3 is nobody's end now; the other is where it was.
    let text = format!(
        "[line.main]\nport = \"{before}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 5\n\
         [module.yard]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n"
    );
    boards.set(5, 1);
    let service = Service::start_in(Config::parse(&text).unwrap(), &again).unwrap();
    let left = |module, number| service.point(module, k(number)).unwrap().left.pulse;
    assert_eq!(left("oven", 1), None);
    assert!(left("yard", 2).is_some());
    let mut events = service.follow_events();
    service.tell_dropped_ends();
    let told = events.next().await.unwrap().unwrap();
    assert_eq!(told.code.as_deref(), Some("end_dropped"));
    assert_eq!(told.module.as_deref(), Some("oven"));
    assert_eq!(told.text.as_deref(), Some("address 3, output 1"));
    // It is off the disk as well.
    until(|| !kept(&again).contains("oven")).await;
    assert!(kept(&again).contains("yard"));
    service.close().await;
    assert_eq!(boards.relays(5), 1, "it gave no pulse");
    let _ = std::fs::remove_dir_all(folder);
    let _ = std::fs::remove_dir_all(again);
}

/// A file of a version that did not say of which board a promise is.
#[tokio::test]
async fn a_promise_without_a_board_is_that_of_the_name() {
    let folder = folder("older");
    std::fs::create_dir_all(&folder).unwrap();
    let text = "{\"schema\":1,\"promises\":[{\"module\":\"oven\",\"output\":0,\
                \"why\":\"pulse\",\"end\":false,\"at_ms\":0,\"length_ms\":2000}]}";
    std::fs::write(folder.join(NAME), text).unwrap();
    let (port, boards) = board::start().await;
    boards.set(3, 1);
    let service = Service::start_in(config(&port, ""), &folder).unwrap();
    until(|| boards.relays(3) == 0).await;
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

/// A welded relay: it is tried again, the less often the longer it lasts, and that is told once.
#[tokio::test]
async fn a_release_is_tried_until_it_is_seen_and_told_once() {
    let (port, boards) = board::start().await;
    let service = Service::start(config(&port, "")).unwrap();
    known(&service).await;
    let short = Pulse {
        width: Some(Micros::from_millis(100)),
        ..LONG
    };
    service.pulse("oven", k(1), short).await.unwrap();
    boards.weld(3, 1);
    let ends = || {
        let entries = service.audit().into_iter();
        let ends = entries.filter(|entry| entry.origin.who == "pulse");
        ends.map(|entry| entry.end.map(End::name))
            .collect::<Vec<_>>()
    };
    let tries = || boards.writes().iter().filter(|write| write.on == 0).count();
    until(|| tries() >= 3).await;
    assert!(ends().len() <= 2, "{:?}", ends());
    assert_eq!(ends()[0], Some("not_verified"));
    assert_eq!(boards.relays(3), 1);
    boards.weld(3, 0);
    until(|| boards.relays(3) == 0).await;
    until(|| ends().last() == Some(&Some("readback"))).await;
    assert_eq!(ends().len(), 2, "{:?}", ends());
    service.pulses_ended().await;
    service.close().await;
}

/// The names of the boards at 3 and 5 are exchanged.
fn exchanged(port: &str) -> String {
    format!(
        "[line.main]\nport = \"{port}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 5\n\
         [module.yard]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n"
    )
}

/// More ends than a reload waits for, of a board that does not answer.
#[tokio::test]
async fn an_end_never_meets_the_board_of_after_a_reload() {
    let (port, boards) = board::start().await;
    let service = Service::start(config(&port, "")).unwrap();
    known(&service).await;
    service.pulse("oven", k(1), LONG).await.unwrap();
    boards.mute(3, true);
    for _ in 0..2 {
        service.pulse("oven", k(1), LONG).await.unwrap_err();
        hold(&service, 600_000).await.unwrap_err();
    }
    boards.set(5, 1);
    service.reload(&exchanged(&port)).await.unwrap();
    tokio::time::sleep(Duration::from_secs(4)).await;
    assert!(boards.writes().iter().all(|write| write.address == 3));
    assert_eq!(boards.relays(5), 1, "it gave no pulse");
    service.close().await;
}

#[tokio::test]
async fn an_end_that_a_reload_could_not_do_is_told() {
    let (port, boards) = board::start().await;
    let service = Service::start(config(&port, "")).unwrap();
    known(&service).await;
    let mut events = service.follow_events();
    service.pulse("oven", k(1), LONG).await.unwrap();
    service.pulse("yard", k(2), LONG).await.unwrap();
    boards.mute(3, true);
    service.reload(&exchanged(&port)).await.unwrap();
    let told = async {
        loop {
            let told = events.next().await.unwrap().unwrap();
            if told.code.as_deref() == Some("end_dropped") {
                break told;
            }
        }
    };
    let told = tokio::time::timeout(Duration::from_secs(20), told).await;
    let told = told.expect("it is told");
    assert_eq!(told.module.as_deref(), Some("oven"));
    assert_eq!(told.text.as_deref(), Some("address 3, output 1"));
    assert!(service.point("yard", k(2)).unwrap().left.pulse.is_some());
    service.close().await;
}

/// What a reload tells of outputs that are on: nobody switches them off any more.
#[tokio::test]
async fn a_limit_that_a_reload_drops_is_told() {
    let (port, boards) = board::start().await;
    let limits = "[module.oven.point]\nk1.max_on = \"1h\"\nk2.max_on = \"1h\"\n\
                  [module.yard.point]\nk2.max_on = \"1h\"\n";
    let service = Service::start(config(&port, limits)).unwrap();
    known(&service).await;
    for module in ["oven", "yard"] {
        switch(&service, module, 2, true).await.unwrap();
    }
    let mut events = service.follow_events();
    let mut told = async |code: &str| loop {
        let told = tokio::time::timeout(Duration::from_secs(5), events.next()).await;
        let told = told.expect("it is told").unwrap().unwrap();
        if told.code.as_deref() == Some(code) {
            let (point, text) = (told.point, told.text);
            break (
                told.module.unwrap(),
                point.unwrap_or_default(),
                text.unwrap_or_default(),
            );
        }
    };
    service
        .reload(&crate::safety::text(&port, limits))
        .await
        .unwrap();
    let without = "[module.yard.point]\nk2.max_on = \"1h\"\n";
    service
        .reload(&crate::safety::text(&port, without))
        .await
        .unwrap();
    assert_eq!(
        told("limit_dropped").await,
        ("oven".into(), "k2".into(), String::new())
    );
    let left = |module| service.point(module, k(2)).unwrap().left.max_on;
    assert!(left("oven").is_none() && left("yard").is_some());
    // The name of another board.
    let moved = crate::safety::text(&port, without).replace("address = 4", "address = 5");
    service.reload(&moved).await.unwrap();
    let dropped = "address 4, output 2".into();
    assert_eq!(
        told("end_dropped").await,
        ("yard".into(), String::new(), dropped)
    );
    assert_eq!((boards.relays(3), boards.relays(4)), (2, 2));
    service.close().await;
}

/// Nothing is done at the end of such a lease, and a pulse goes on that only lost its reply.
#[tokio::test]
async fn a_pulse_that_may_have_begun_ends_though_a_lease_is_given_back() {
    let policy = "[module.oven.point.k1]\non_offline = \"hold\"\n";
    let (service, boards) = crate::safety::site(policy).await;
    let held = (false, Micros::from_secs(60));
    service
        .lease("oven", k(1), held, LeaseTerms::default())
        .await
        .unwrap();
    boards.mute(3, true);
    let width = Some(Micros::from_secs(3));
    let pulse = Pulse { width, ..LONG };
    service.pulse("oven", k(1), pulse).await.unwrap_err();
    boards.set(3, 1);
    boards.mute(3, false);
    until(|| service.point("oven", k(1)).unwrap().quality == railbus_site::PointQuality::Good)
        .await;
    let given = service.end_lease("oven", k(1)).await;
    assert_eq!(given.map(|done| done.is_none()), Ok(true));
    assert_eq!(service.point("oven", k(1)).unwrap().left.lease, None);
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}

/// Whoever asks again and again, of a board that does not answer, has one end more, not many.
#[tokio::test]
async fn promises_that_may_have_begun_do_not_pile_up() {
    let folder = folder("pile");
    let (service, boards) = site_in(&folder).await;
    service.pulse("oven", k(1), LONG).await.unwrap();
    let first = service.point("oven", k(1)).unwrap().left.pulse.unwrap();
    boards.mute(3, true);
    for _ in 0..5 {
        service.pulse("oven", k(1), LONG).await.unwrap_err();
        service.pulse("oven", k(2), LONG).await.unwrap_err();
    }
    // The one that surely began and the newest; the first that may have begun and the newest.
    assert_eq!(kept(&folder).matches("pulse").count(), 4);
    let left = service.point("oven", k(1)).unwrap().left.pulse.unwrap();
    assert!(left < first, "the first has the say");
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}
