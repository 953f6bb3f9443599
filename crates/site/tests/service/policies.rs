//! Policies of outputs: they are done, however long that takes and whoever else waits.

use crate::board::{Boards, k, until};
use crate::safety::{config, folder, known, site, switch};
use railbus_host::Fault;
use railbus_site::{CommandError, PointQuality, Service};
use railbus_store::audit::End;
use std::time::Duration;

fn ends(service: &Service, of: &str) -> Vec<Option<&'static str>> {
    let audit = service.audit().into_iter();
    let audit = audit.filter(|entry| entry.origin.who == "on_return" && entry.what == of);
    audit.map(|entry| entry.end.map(End::name)).collect()
}

/// A board has left the line, with its relays so, and comes back.
async fn comes_back(service: &Service, boards: &Boards) {
    boards.mute(4, true);
    let quality = || service.point("yard", k(1)).unwrap().quality;
    until(|| matches!(quality(), PointQuality::Bad(_))).await;
    boards.mute(4, false);
}

/// The module refuses: two entries tell it.
#[tokio::test]
async fn a_policy_is_tried_until_it_is_done() {
    let points = "[module.yard.point]\nk3.on_return = \"off\"\nk4.on_return = \"on\"\n";
    let (service, boards) = site(points).await;
    boards.set(4, 0b0100);
    boards.refuse(3);
    comes_back(&service, &boards).await;
    until(|| boards.relays(4) == 0b1000).await;
    until(|| ends(&service, "k3=off").last() == Some(&Some("readback"))).await;
    assert!(ends(&service, "k3=off").len() <= 2);
    service.close().await;
}

/// Relays that are welded; then somebody switches one, and the other one's policy is no more.
#[tokio::test]
async fn a_later_command_or_another_configuration_ends_a_policy() {
    let points = "[module.yard.point]\nk1.on_return = \"off\"\nk2.on_return = \"off\"\n";
    let (port, boards) = crate::board::start().await;
    let service = Service::start(config(&port, points)).unwrap();
    known(&service).await;
    boards.set(4, 0b11);
    boards.weld(4, 0b11);
    comes_back(&service, &boards).await;
    until(|| !ends(&service, "k1=off").is_empty() && !ends(&service, "k2=off").is_empty()).await;
    switch(&service, "yard", 1, true).await.unwrap();
    let without = crate::safety::text(&port, "[module.yard.point.k1]\non_return = \"off\"\n");
    service.reload(&without).await.unwrap();
    boards.weld(4, 0);
    let before = boards.writes().len();
    tokio::time::sleep(Duration::from_secs(5)).await;
    assert_eq!(boards.relays(4), 0b11);
    assert_eq!(boards.writes().len(), before, "{:?}", boards.writes());
    service.close().await;
}

#[tokio::test]
async fn a_policy_waits_beside_as_many_commands_as_there_are() {
    let (service, boards) = site("[module.oven.point]\nk1.on_return = \"off\"\n").await;
    boards.mute(3, true);
    let quality = || service.point("oven", k(1)).unwrap().quality;
    until(|| matches!(quality(), PointQuality::Bad(_))).await;
    boards.slow(200);
    let asks = |_| {
        let service = service.clone();
        tokio::spawn(async move { switch(&service, "oven", 1, true).await })
    };
    let asked: Vec<_> = (0..100).map(asks).collect();
    boards.mute(3, false);
    let mut ends = Vec::new();
    for one in asked {
        ends.push(one.await.unwrap());
    }
    assert!(ends.contains(&Err(CommandError::Line(Fault::Overloaded))));
    boards.slow(0);
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}

/// The process ends in the middle of it.
#[tokio::test]
async fn a_policy_is_done_after_a_restart_where_it_is_one_still() {
    let folder = folder("policy");
    let points = "[module.yard.point]\nk1.on_return = \"off\"\nk2.on_return = \"off\"\n";
    let (port, boards) = crate::board::start().await;
    let service = Service::start_in(config(&port, points), &folder).unwrap();
    known(&service).await;
    boards.set(4, 0b11);
    boards.weld(4, 0b11);
    comes_back(&service, &boards).await;
    until(|| !ends(&service, "k1=off").is_empty() && !ends(&service, "k2=off").is_empty()).await;
    service.close().await;
    boards.weld(4, 0);
    assert_eq!(boards.relays(4), 0b11);
    let points = "[module.yard.point]\nk1.on_return = \"off\"\nk2.on_return = \"hold\"\n";
    let service = Service::start_in(config(&port, points), &folder).unwrap();
    until(|| boards.relays(4) == 0b10).await;
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert_eq!(boards.relays(4), 0b10);
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}
