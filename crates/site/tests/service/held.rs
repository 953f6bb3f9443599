//! What is done to outputs later, while others want something else of them.

use crate::board::{self, k, until};
use crate::safety::{site, switch};
use railbus_host::{LineState, Presence};
use railbus_site::config::Place;
use railbus_site::{
    BadReason, BatchTerms, CommandError, Config, ExclusiveHold, LOAN_MAX, LeaseTerms, Leased,
    PointQuality, Pulse, Service, Within, WriteTerms,
};
use railbus_wire::Micros;
use std::time::Duration;

async fn hold(service: &Service, number: u8, millis: u64) -> Result<Leased, CommandError> {
    let held = (true, Micros::from_millis(millis));
    service
        .lease("oven", k(number), held, LeaseTerms::default())
        .await
}

#[tokio::test]
async fn a_lease_that_is_over_can_not_be_held_on() {
    let (service, boards) = site("").await;
    hold(&service, 1, 300).await.unwrap();
    boards.mute(3, true);
    let has_begun_to_end = || {
        let entries = service.audit();
        entries.iter().any(|entry| entry.origin.who == "lease")
    };
    until(has_begun_to_end).await;
    // Its end is on its way: to say that it is held on would not be true.
    let late = hold(&service, 1, 60_000).await;
    assert!(late.is_err(), "{late:?}");
    boards.mute(3, false);
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}

#[tokio::test]
async fn a_lease_taken_while_another_is_given_back_is_one_of_its_own() {
    let (service, boards) = site("").await;
    hold(&service, 1, 60_000).await.unwrap();
    let (ended, taken) = tokio::join!(service.end_lease("oven", k(1)), hold(&service, 1, 60_000));
    assert!(ended.unwrap().is_some());
    let taken = taken.unwrap();
    assert!(taken.written.is_some(), "it was given back already");
    assert_eq!(boards.relays(3), 1);
    let left = || service.point("oven", k(1)).unwrap().left.lease;
    assert!(left().is_some(), "and ends by itself");
    service.close().await;
    assert_eq!(boards.relays(3), 0);
}

#[tokio::test]
async fn a_command_that_fails_beside_one_that_is_carried_out_gives_nothing_back() {
    let (service, boards) = site("").await;
    let pulse = Pulse {
        width: Some(Micros::from_millis(500)),
        ..Pulse::default()
    };
    service.pulse("oven", k(1), pulse).await.unwrap();
    boards.refuse(1);
    let (refused, done) = tokio::join!(
        switch(&service, "oven", 1, true),
        switch(&service, "oven", 1, true)
    );
    assert!(refused.is_err() && done.is_ok(), "{refused:?} {done:?}");
    tokio::time::sleep(Duration::from_millis(1_000)).await;
    assert_eq!(boards.relays(3), 1, "it is switched on, and no pulse");
    service.close().await;
}

#[tokio::test]
async fn all_or_nothing_that_is_taken_back_leaves_a_pulse_its_end() {
    let (service, boards) = site("").await;
    hold(&service, 1, 2_000).await.unwrap();
    boards.mute(4, true);
    let both = [("oven", true), ("yard", true)].map(|(module, on)| (Place::new(module, k(1)), on));
    let terms = BatchTerms {
        all_or_nothing: true,
        ..BatchTerms::default()
    };
    let done = service.batch(&both, terms).await.unwrap();
    assert_eq!(done.parts[0].end, Err(CommandError::Undone));
    let left = || service.point("oven", k(1)).unwrap().left.lease;
    until(|| left().is_some() || boards.relays(3) == 0).await;
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}

/// Two boards, named so.
fn named(port: &str, third: &str, fourth: &str) -> String {
    let module = |name, address| {
        format!("[module.{name}]\nline = \"main\"\nmodel = \"erc8\"\naddress = {address}\n")
    };
    let modules = [module(third, 3), module(fourth, 4)].concat();
    format!("[line.main]\nport = \"{port}\"\n{modules}")
}

/// A site in which both boards are known.
async fn two(port: &str) -> Service {
    let config = Config::parse(&named(port, "oven", "yard")).unwrap();
    let service = Service::start(config).unwrap();
    let good = |module| service.point(module, k(1)).unwrap().quality == PointQuality::Good;
    until(|| good("oven") && good("yard")).await;
    service
}

const LONG: Pulse = Pulse {
    width: Some(Micros::from_secs(600)),
    by: railbus_site::By::Host,
    off: false,
    confirm: false,
    within: Within::DEFAULT,
};

#[tokio::test]
async fn a_pulse_of_a_module_that_gets_another_name_ends_before_that() {
    let (port, boards) = board::start().await;
    let service = two(&port).await;
    service.pulse("oven", k(1), LONG).await.unwrap();
    service.pulse("yard", k(2), LONG).await.unwrap();
    let renamed = named(&port, "kiln", "yard");
    service.reload(&renamed).await.unwrap();
    assert_eq!(boards.relays(3), 0, "nobody could end it any more");
    assert_eq!(boards.relays(4), 0b10, "it is where it was");
    let left = service.point("yard", k(2)).unwrap().left.pulse;
    assert!(left.is_some(), "{left:?}");
    service.close().await;
}

#[tokio::test]
async fn the_end_of_a_pulse_never_meets_another_module_of_that_name() {
    let (port, boards) = board::start().await;
    let service = two(&port).await;
    let short = Pulse {
        width: Some(Micros::from_millis(2_000)),
        ..LONG
    };
    switch(&service, "yard", 1, true).await.unwrap();
    service.pulse("oven", k(1), short).await.unwrap();
    // It can't be ended in time.
    boards.mute(3, true);
    let swapped = named(&port, "yard", "oven");
    service.reload(&swapped).await.unwrap();
    tokio::time::sleep(Duration::from_millis(2_500)).await;
    assert_eq!(boards.relays(4), 1, "it gave no pulse");
    service.close().await;
}

#[tokio::test]
async fn a_line_is_lent_without_pulses_that_nobody_could_end() {
    let (port, boards) = board::start().await;
    let service = two(&port).await;
    service.pulse("oven", k(1), LONG).await.unwrap();
    let loan = service.lend("main").await.unwrap();
    assert_eq!(boards.relays(3), 0);
    // What is known from before is as old as it is.
    tokio::time::sleep(Duration::from_millis(300)).await;
    let age = service.point("oven", k(1)).unwrap().age.unwrap();
    assert!(age >= Micros::from_millis(300), "{age:?}");
    loan.end(None).await;
    service.close().await;
}

#[tokio::test]
async fn who_had_a_line_may_have_switched_an_output_off_just_now() {
    let (service, boards) = site("[module.oven.point]\nk1.min_off = \"1500ms\"\n").await;
    boards.set(3, 1);
    let is_on = |on| {
        let known = service.point("oven", k(1)).unwrap();
        known.value == Some(railbus_site::PointValue::Bool(on))
            && known.quality == PointQuality::Good
    };
    until(|| is_on(true)).await;
    tokio::time::sleep(Duration::from_millis(1_600)).await;
    let loan = service.lend("main").await.unwrap();
    boards.set(3, 0);
    loan.end(None).await;
    let too_early = switch(&service, "oven", 1, true).await;
    assert!(
        matches!(too_early, Err(CommandError::MinOff { .. })),
        "{too_early:?}"
    );
    service.close().await;
}

#[tokio::test]
async fn how_long_an_output_is_on_is_not_counted_for_another_module_of_that_name() {
    let (port, boards) = board::start().await;
    let service = two(&port).await;
    let limited = |text: String| format!("{text}[module.oven.point]\nk1.max_on = \"60s\"\n");
    let text = limited(named(&port, "oven", "yard"));
    service.reload(&text).await.unwrap();
    boards.set(3, 1);
    let left = || service.point("oven", k(1)).unwrap().left.max_on;
    until(|| left().is_some()).await;
    tokio::time::sleep(Duration::from_millis(2_000)).await;
    boards.set(4, 1);
    let swapped = limited(named(&port, "yard", "oven"));
    let before = left();
    service.reload(&swapped).await.unwrap();
    until(|| left().is_some()).await;
    assert!(left() > before, "{:?}", left());
    service.close().await;
}

#[tokio::test]
async fn a_module_that_left_while_its_line_was_lent_is_offline() {
    let (port, boards) = board::start().await;
    let service = two(&port).await;
    let loan = service.lend("main").await.unwrap();
    boards.mute(3, true);
    loan.end(None).await;
    let presence = |module| service.module(module).unwrap().presence;
    until(|| presence("oven") == Presence::Silent).await;
    until(|| presence("yard") == Presence::Online).await;
    let lost = service.point("oven", k(1)).unwrap().quality;
    assert_eq!(lost, PointQuality::Bad(BadReason::Offline));
    service.close().await;
}

#[tokio::test]
async fn a_line_that_is_borrowed_again_at_once_is_not_opened_between() {
    let (port, boards) = board::start().await;
    let service = two(&port).await;
    let text = named(&port, "oven", "yard");
    let other = format!("{text}[line.other]\nport = \"/dev/railbus-test-nothing-here\"\n");
    service.reload(&other).await.unwrap();
    let loan = service.lend("main").await.unwrap();
    // Who changes the configuration holds both up: they come one after the other then.
    let (_, (), again) = tokio::join!(
        service.reload(&text),
        loan.end(Some(&text)),
        service.lend("main")
    );
    let again = again.unwrap();
    let _ = service.opened("main").await;
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert!(switch(&service, "oven", 1, true).await.is_err());
    assert_eq!(boards.relays(3), 0, "it is lent");
    again.end(None).await;
    service.close().await;
}

#[tokio::test]
async fn what_was_known_of_a_silent_module_is_not_what_was_before() {
    let (service, boards) = site("").await;
    boards.mute(3, true);
    let quality = || service.point("oven", k(1)).unwrap().quality;
    until(|| quality() == PointQuality::Bad(BadReason::Offline)).await;
    boards.set(3, 1);
    boards.mute(3, false);
    let set = [(k(1), true)];
    let done = service.write("oven", &set, WriteTerms::default()).await;
    let (_, _, before) = done.unwrap().outputs[0];
    assert_ne!(before, Some(false), "it was switched by hand meanwhile");
    service.close().await;
}

#[tokio::test]
async fn an_output_that_is_on_may_be_on_for_less_long_from_now_on() {
    let (port, boards) = board::start().await;
    let service = two(&port).await;
    let limited = |longest: &str| {
        let text = named(&port, "oven", "yard");
        format!("{text}[module.oven.point]\nk1.max_on = \"{longest}\"\n")
    };
    service.reload(&limited("1h")).await.unwrap();
    switch(&service, "oven", 1, true).await.unwrap();
    let left = || service.point("oven", k(1)).unwrap().left.max_on;
    assert!(left().is_some());
    service.reload(&limited("300ms")).await.unwrap();
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}

#[tokio::test]
async fn a_line_is_not_lent_while_an_output_must_be_switched_off_soon() {
    let (service, boards) =
        site("[module.oven.point]\nk1.max_on = \"2s\"\nk2.max_on = \"5m\"\n").await;
    switch(&service, "oven", 1, true).await.unwrap();
    let refused = service.lend("main").await;
    assert!(
        matches!(&refused, Err(CommandError::Due { path, .. }) if path == "oven.k1"),
        "{refused:?}"
    );
    until(|| boards.relays(3) == 0).await;
    // One that has the time bounds the loan.
    switch(&service, "oven", 2, true).await.unwrap();
    let loan = service.lend("main").await.unwrap();
    let time = |loan: &ExclusiveHold| loan.until() - tokio::time::Instant::now();
    let most = Duration::from_secs(270);
    assert!(most < LOAN_MAX && time(&loan) <= most, "{:?}", time(&loan));
    loan.end(None).await;
    until(|| service.point("oven", k(2)).unwrap().quality == PointQuality::Good).await;
    service.close().await;
}

#[tokio::test]
async fn a_line_comes_back_though_who_has_it_breaks_down() {
    let (service, boards) = site("").await;
    let borrower = service.clone();
    let work = tokio::spawn(async move {
        let _loan = borrower.lend("main").await.unwrap();
        panic!("as a fault of ours would");
    });
    assert!(work.await.is_err());
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    switch(&service, "oven", 1, true).await.unwrap();
    assert_eq!(boards.relays(3), 1);
    service.close().await;
}

/// The site's text with something more in the line's table and of the oven's points.
fn other_text(service: &Service, line: &str, points: &str) -> String {
    let port = service.config().lines["main"].port.clone();
    format!(
        "[line.main]\nport = \"{port}\"\n{line}\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
         [module.yard]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n{points}"
    )
}

/// Who asks goes away while a module that is silent is waited for.
async fn goes_away<T>(asks: impl Future<Output = T>) {
    let gone = tokio::time::timeout(Duration::from_millis(200), asks).await;
    assert!(gone.is_err(), "nothing was waited for");
}

const HELD: (bool, Micros) = (true, Micros::from_secs(600));

#[tokio::test]
async fn a_line_comes_back_though_nobody_waits_for_it_any_more() {
    let (service, boards) = site("").await;
    service
        .lease("oven", k(1), HELD, LeaseTerms::default())
        .await
        .unwrap();
    boards.mute(3, true);
    goes_away(service.lend("main")).await;
    boards.mute(3, false);
    until(|| service.line("main").unwrap().state == LineState::Up).await;
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}

#[tokio::test]
async fn a_configuration_comes_into_force_though_nobody_waits_for_it_any_more() {
    let (service, boards) = site("").await;
    service
        .lease("oven", k(1), HELD, LeaseTerms::default())
        .await
        .unwrap();
    boards.mute(3, true);
    let text = other_text(&service, "baud = 19200\n", "");
    goes_away(service.reload(&text.replace("address = 3", "address = 5"))).await;
    boards.mute(3, false);
    let is_in_force = || service.config().modules["oven"].setup.address.0 == 5;
    until(is_in_force).await;
    until(|| service.line("main").unwrap().state == LineState::Up).await;
    until(|| service.point("yard", k(1)).unwrap().quality == PointQuality::Good).await;
    service.close().await;
}

#[tokio::test]
async fn an_output_that_is_locked_meanwhile_has_its_end_all_the_same() {
    let (service, boards) = site("").await;
    let held = (true, Micros::from_millis(300));
    service
        .lease("oven", k(1), held, LeaseTerms::default())
        .await
        .unwrap();
    let text = other_text(&service, "", "[module.oven.point]\nk1.locked = true\n");
    boards.mute(3, true);
    service.reload(&text).await.unwrap();
    let has_failed = || {
        let mut entries = service.audit().into_iter();
        entries.any(|entry| entry.what == "end of lease k1" && entry.end.is_some())
    };
    until(has_failed).await;
    boards.mute(3, false);
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}
