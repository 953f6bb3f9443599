//! A site at work, over TCP with relay boards of a few lines.

mod board;
mod following;
mod held;
mod keys;
mod otherwise;
mod owners;
mod policies;
mod promised;
mod rights;
mod safety;
mod sending;
mod several;
mod undone;

use board::{k, until};
use railbus_host::{Confirmation, Fault, LineState};
use railbus_site::{
    BadReason, By, CommandError, Config, PointQuality, PointValue, Pulse, ReloadError, Service,
    ToggleTerms, Update, WriteTerms,
};
use railbus_store::audit::End;
use railbus_wire::Micros;
use std::time::Duration;

fn text(port: &str) -> String {
    format!(
        "[line.main]\nport = \"{port}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
         [module.oven.point]\nk8.locked = true\n"
    )
}

fn start(port: &str) -> Service {
    Service::start(Config::parse(&text(port)).unwrap()).unwrap()
}

/// A site whose port is not there.
fn start_absent() -> Service {
    start("/dev/railbus-test-nothing-here")
}

#[tokio::test]
async fn a_write_tells_before_and_after_and_is_known_at_once() {
    let (port, relays) = board::start().await;
    let service = start(&port);
    let mut updates = service.subscribe();
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;

    let both = [(k(1), true), (k(3), true)];
    let done = service
        .write("oven", &both, WriteTerms::default())
        .await
        .unwrap();
    assert_eq!(done.confirmed, Confirmation::Readback);
    let told = [
        (k(1), Some(true), Some(false)),
        (k(3), Some(true), Some(false)),
    ];
    assert_eq!(done.outputs, told);
    assert_eq!(relays.relays(3), 0b101);
    let known = service.point("oven", k(3)).unwrap();
    assert_eq!(known.value, Some(PointValue::Bool(true)));
    assert!(service.module("oven").unwrap().rtt.is_some());

    let entry = service.audit().pop().unwrap();
    assert_eq!((entry.id, entry.end), (done.audit, Some(End::Readback)));
    assert_eq!(entry.what, "k1=on k3=on");

    let mut seen_on = false;
    while !seen_on {
        let update = tokio::time::timeout(Duration::from_secs(5), updates.next()).await;
        seen_on = matches!(
            update.unwrap().unwrap(),
            Update::Point(change) if change.point == k(1) && change.value == PointValue::Bool(true)
        );
    }
    service.close().await;
    assert_eq!(service.line("main").unwrap().state, LineState::Closed);
}

#[tokio::test]
async fn compare_and_set_and_toggle() {
    let (port, relays) = board::start().await;
    let service = start(&port);
    service.opened("main").await.unwrap();
    let if_on = WriteTerms {
        only_if: Some(true),
        ..WriteTerms::default()
    };
    let refused = service.write("oven", &[(k(2), false)], if_on).await;
    assert_eq!(refused, Err(CommandError::NotAsAsked(k(2), false)));
    let done = service
        .toggle("oven", k(2), ToggleTerms::default())
        .await
        .unwrap();
    assert!(done.read_then_set);
    assert_eq!(done.outputs, [(k(2), Some(true), Some(false))]);
    assert_eq!(relays.relays(3), 0b10);
    let raw = ToggleTerms {
        raw: true,
        ..ToggleTerms::default()
    };
    let raw = service.toggle("oven", k(2), raw).await;
    assert_eq!(raw, Err(CommandError::Line(Fault::Unsupported)));
}

#[tokio::test]
async fn a_pulse_is_released_though_the_caller_has_gone() {
    let (port, relays) = board::start().await;
    let service = start(&port);
    service.opened("main").await.unwrap();
    let pulse = Pulse {
        width: Some(Micros::from_millis(300)),
        ..Pulse::default()
    };
    let asking = service.clone();
    let caller = tokio::spawn(async move { asking.pulse("oven", k(4), pulse).await });
    until(|| relays.relays(3) == 0b1000).await;
    caller.abort();
    until(|| relays.relays(3) == 0).await;
    service.pulses_ended().await;
}

#[tokio::test]
async fn the_end_of_the_site_releases_pulses_and_a_command_takes_them_over() {
    let (port, relays) = board::start().await;
    let service = start(&port);
    service.opened("main").await.unwrap();
    let long = Pulse {
        width: Some(Micros::from_secs(600)),
        ..Pulse::default()
    };
    for number in [1, 2] {
        let begun = service.pulse("oven", k(number), long).await.unwrap();
        assert_eq!((begun.by, begun.value), (By::Host, true));
    }
    // Switched on by a command, it is no pulse any more.
    service
        .write("oven", &[(k(1), true)], WriteTerms::default())
        .await
        .unwrap();
    service.close().await;
    assert_eq!(relays.relays(3), 0b01);
}

#[tokio::test]
async fn what_must_not_be_written_is_refused() {
    let service = start_absent();
    let write = async |module: &str, point| {
        let end = service
            .write(module, &[(point, true)], WriteTerms::default())
            .await;
        end.expect_err("it is refused")
    };
    assert_eq!(write("oven", k(8)).await, CommandError::Locked(k(8)));
    assert_eq!(write("oven", k(9)).await, CommandError::NoSuchPoint);
    assert_eq!(write("shed", k(1)).await, CommandError::NoSuchModule);
    let none = service.write("oven", &[], WriteTerms::default()).await;
    assert_eq!(none, Err(CommandError::NoSuchPoint));
    let locked = service.pulse("oven", k(8), Pulse::default()).await;
    assert_eq!(locked, Err(CommandError::Locked(k(8))));
    assert!(service.audit().is_empty(), "nothing was tried");
}

#[tokio::test]
async fn a_port_that_is_not_there_is_a_state() {
    let service = start_absent();
    service.opened("main").await.unwrap();
    let status = service.line("main").unwrap();
    assert!(matches!(status.state, LineState::Absent(_)), "{status:?}");
    let end = service
        .write("oven", &[(k(1), true)], WriteTerms::default())
        .await;
    assert_eq!(end, Err(CommandError::Line(Fault::Closed)));
    assert_eq!(
        service.point("oven", k(1)).unwrap().quality,
        PointQuality::Bad(BadReason::LineAbsent)
    );
}

#[tokio::test]
async fn pulses_that_can_not_be_are_refused() {
    let service = start_absent();
    let refused = async |pulse| {
        service
            .pulse("oven", k(1), pulse)
            .await
            .expect_err("refused")
    };
    let wrong = |failure| matches!(failure, CommandError::PulseWidth { .. });
    assert!(
        wrong(refused(Pulse::default()).await),
        "the board has no width of its own"
    );
    let width = |micros| Pulse {
        width: Some(Micros(micros)),
        ..Pulse::default()
    };
    assert!(wrong(refused(width(0)).await));
    assert!(wrong(refused(width(u64::MAX)).await));
    let by_device = Pulse {
        by: By::Device,
        ..width(1_000_000)
    };
    assert!(wrong(refused(by_device).await));
}

#[tokio::test]
async fn a_refused_configuration_changes_nothing() {
    let (port, _) = board::start().await;
    let service = start(&port);
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    let before = service.config();
    let bad = text(&port).replace("erc8", "erc9").replace("k8", "k9");
    let refused = service.reload(&bad).await;
    assert!(
        matches!(&refused, Err(ReloadError::Problems(problems)) if !problems.is_empty()),
        "{refused:?}"
    );
    assert_eq!(service.config(), before);
    assert_eq!(
        service.point("oven", k(1)).unwrap().quality,
        PointQuality::Good
    );

    // Another lock is nothing to the line; another module is.
    let locks = text(&port).replace("k8", "k1");
    let done = service.reload(&locks).await.unwrap();
    assert_eq!((done.kept.len(), done.opened.len()), (1, 0));
    assert_eq!(
        service.point("oven", k(1)).unwrap().quality,
        PointQuality::Good
    );
    let refused = service
        .write("oven", &[(k(1), true)], WriteTerms::default())
        .await;
    assert_eq!(refused, Err(CommandError::Locked(k(1))));
    let renamed = text(&port).replace("module.oven", "module.kiln");
    let done = service.reload(&renamed).await.unwrap();
    assert_eq!((done.kept.len(), done.opened.len()), (1, 0));
    assert!(done.modules_kept.is_empty());
    assert!(service.module("oven").is_none());
    until(|| service.point("kiln", k(1)).unwrap().quality == PointQuality::Good).await;
}

#[tokio::test]
async fn what_lines_and_modules_are_called_is_nothing_to_the_port() {
    let (port, _) = board::start().await;
    let service = start(&port);
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    let called = text(&port)
        .replace("[line.main]\n", "[line.main]\nname = \"Hall\"\n")
        .replace(
            "address = 3\n",
            "address = 3\nname = \"Oven\"\narea = \"Hall 2\"\n",
        );
    let done = service.reload(&called).await.unwrap();
    assert_eq!((done.kept.len(), done.opened.len()), (1, 0));
    assert_eq!(done.modules_kept, ["oven"]);
    assert_eq!(
        service.point("oven", k(1)).unwrap().quality,
        PointQuality::Good
    );
    let line = service.line("main").unwrap();
    assert_eq!(line.called.en.as_deref(), Some("Hall"));
    let oven = service.module("oven").unwrap();
    assert_eq!(oven.called.zh.as_deref(), Some("Oven"));
    assert_eq!(oven.area.as_deref(), Some("Hall 2"));
}

#[tokio::test]
async fn modules_come_and_go_and_the_others_notice_nothing() {
    let (port, _) = board::start().await;
    let service = start(&port);
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    let mut updates = service.subscribe();
    let more = format!(
        "{}[module.attic]\nline = \"main\"\nmodel = \"erc8\"\naddress = 9\n",
        text(&port)
    );
    for (text, kept) in [(&more, 1), (&text(&port), 1), (&more, 1), (&more, 2)] {
        let done = service.reload(text).await.unwrap();
        assert_eq!((done.kept.len(), done.opened.len()), (1, 0));
        assert_eq!(done.modules_kept.len(), kept);
        let oven = service.point("oven", k(1)).unwrap();
        assert_eq!(
            (oven.quality, oven.value),
            (PointQuality::Good, Some(PointValue::Bool(false)))
        );
    }
    assert_eq!(service.line("main").unwrap().modules, ["attic", "oven"]);
    until(|| service.point("attic", k(2)).unwrap().quality == PointQuality::Good).await;
    let terms = WriteTerms::default();
    let done = service.write("oven", &[(k(2), true)], terms).await.unwrap();
    assert_eq!(done.confirmed, Confirmation::Readback);
    let attic = service.point("attic", k(2)).unwrap();
    assert_eq!(attic.value, Some(PointValue::Bool(false)));

    // Another way of reading it makes a module begin anew, and nothing else.
    let slower = more.replace("address = 3\n", "address = 3\npoll = \"300ms\"\n");
    let done = service.reload(&slower).await.unwrap();
    assert_eq!(done.modules_kept, ["attic"]);
    until(|| service.point("oven", k(2)).unwrap().quality == PointQuality::Good).await;
    assert_eq!(
        service.point("oven", k(2)).unwrap().value,
        Some(PointValue::Bool(true))
    );
    let told = async {
        while let Some(update) = updates.next().await {
            assert!(!matches!(update, Update::Line(_)), "the line went on");
        }
    };
    let told = tokio::time::timeout(Duration::from_millis(50), told);
    assert!(told.await.is_err(), "the site is at work");
    service.close().await;
}

#[tokio::test]
async fn after_a_loan_every_command_meets_the_module_it_names() {
    let (port, relays) = board::start().await;
    let service = start(&port);
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    // It joins behind the other, before which it stands in the configuration.
    let more = format!(
        "{}[module.attic]\nline = \"main\"\nmodel = \"erc8\"\naddress = 2\n",
        text(&port)
    );
    service.reload(&more).await.unwrap();
    service.lend("main").await.unwrap().end(None).await;
    until(|| service.point("attic", k(2)).unwrap().quality == PointQuality::Good).await;

    let terms = WriteTerms::default();
    let done = service.write("attic", &[(k(2), true)], terms).await;
    assert_eq!(done.unwrap().confirmed, Confirmation::Readback);
    assert_eq!((relays.relays(2), relays.relays(3)), (0b10, 0));
    for (module, is_on) in [("attic", true), ("oven", false)] {
        until(|| service.point(module, k(2)).unwrap().quality == PointQuality::Good).await;
        let point = service.point(module, k(2)).unwrap();
        assert_eq!(point.value, Some(PointValue::Bool(is_on)), "{module}");
    }
    service.close().await;
}
