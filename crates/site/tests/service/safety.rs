//! What keeps outputs safe below everyone who commands them.

use crate::board::{self, Boards, k, until};
use railbus_site::{
    CommandError, Config, PointQuality, PointValue, Pulse, Service, ToggleTerms, WriteTerms,
};
use railbus_store::audit::End;
use railbus_wire::Micros;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;

/// Two boards; `points` is said of them.
pub(crate) fn text(port: &str, points: &str) -> String {
    format!(
        "[line.main]\nport = \"{port}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
         [module.yard]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n{points}"
    )
}

pub(crate) fn config(port: &str, points: &str) -> Config {
    Config::parse(&text(port, points)).unwrap()
}

pub(crate) async fn site(points: &str) -> (Service, Arc<Boards>) {
    let (port, boards) = board::start().await;
    let service = Service::start(config(&port, points)).unwrap();
    known(&service).await;
    (service, boards)
}

pub(crate) async fn known(service: &Service) {
    let good = |module| service.point(module, k(1)).unwrap().quality == PointQuality::Good;
    until(|| good("oven") && good("yard")).await;
}

pub(crate) async fn switch(
    service: &Service,
    module: &str,
    number: u8,
    on: bool,
) -> Result<(), CommandError> {
    let set = [(k(number), on)];
    let done = service.write(module, &set, WriteTerms::default()).await;
    done.map(|_| ())
}

pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("railbus-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

const LOCK: &str = "[module.oven.point.k1]\ninterlock = [\"oven.k2\", \"yard.k1\"]\n";

#[tokio::test]
async fn outputs_that_exclude_each_other_are_never_on_together() {
    let (service, boards) = site(LOCK).await;
    let locked = |failure, other: &str| match failure {
        Err(CommandError::Interlock { by, .. }) => by == other,
        _ => false,
    };
    switch(&service, "oven", 2, true).await.unwrap();
    let refused = switch(&service, "oven", 1, true).await;
    assert!(locked(refused, "oven.k2"));
    // Not even in one frame, nor by a pulse or a toggle.
    let both = [(k(1), true), (k(2), true)];
    let refused = service.write("oven", &both, WriteTerms::default()).await;
    assert!(locked(refused.map(|_| ()), "oven.k2"));
    let pulse = Pulse {
        width: Some(Micros::from_secs(1)),
        ..Pulse::default()
    };
    let refused = service.pulse("oven", k(1), pulse).await;
    assert!(locked(refused.map(|_| ()), "oven.k2"));
    let refused = service.toggle("oven", k(1), ToggleTerms::default()).await;
    assert!(locked(refused.map(|_| ()), "oven.k2"));
    assert_eq!(boards.relays(3), 0b10);
    let last = service.audit().pop().unwrap();
    assert_eq!(
        last.end,
        Some(End::not_done("interlock")),
        "it is written down"
    );

    switch(&service, "oven", 2, false).await.unwrap();
    switch(&service, "oven", 1, true).await.unwrap();
    // It holds both ways, and across modules.
    assert!(locked(switch(&service, "yard", 1, true).await, "oven.k1"));
    switch(&service, "yard", 2, true).await.unwrap();
    service.close().await;
}

#[tokio::test]
async fn what_nobody_knows_may_be_on() {
    let (service, boards) = site(LOCK).await;
    boards.mute(4, true);
    let offline = || {
        matches!(
            service.point("yard", k(1)).unwrap().quality,
            PointQuality::Bad(_)
        )
    };
    until(offline).await;
    let refused = switch(&service, "oven", 1, true).await;
    assert!(matches!(refused, Err(CommandError::Interlock { by, .. }) if by == "yard.k1"));
    // Off is always allowed, and what is not concerned goes on.
    switch(&service, "oven", 1, false).await.unwrap();
    switch(&service, "oven", 3, true).await.unwrap();
    boards.mute(4, false);
    until(|| service.point("yard", k(1)).unwrap().quality == PointQuality::Good).await;
    switch(&service, "oven", 1, true).await.unwrap();

    // One that is not read by itself asks before it says no.
    let (port, _boards) = board::start().await;
    let quiet = Service::start_quiet(config(&port, LOCK)).unwrap();
    quiet.opened("main").await.unwrap();
    switch(&quiet, "oven", 1, true).await.unwrap();
    let refused = switch(&quiet, "yard", 1, true).await;
    assert!(matches!(refused, Err(CommandError::Interlock { .. })));
}

fn runtime() -> Runtime {
    Builder::new_current_thread().enable_all().build().unwrap()
}

/// Runs something on a thread of its own: what waits for a lock does so at the same time.
fn on_a_thread<T: Send + 'static>(
    what: impl Future<Output = T> + Send + 'static,
) -> oneshot::Receiver<T> {
    let (tell, told) = oneshot::channel();
    std::thread::spawn(move || tell.send(runtime().block_on(what)));
    told
}

/// Numbers that look like chance, the same for the same seed.
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn below(&mut self, most: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % most
    }
}

#[tokio::test]
async fn commands_at_once_never_pass_an_interlock_together() {
    let points = "[module.oven.point]\nk1.interlock = [\"oven.k2\", \"yard.k1\"]\n\
                  k2.interlock = [\"yard.k1\"]\n";
    for seed in [1, 7, 42] {
        let (service, boards) = site(points).await;
        let places = [("oven", 1), ("oven", 2), ("yard", 1)];
        let client = |number: u64| {
            let service = service.clone();
            let mut dice = Dice(seed * 1_000_003 + number);
            async move {
                let mut ends = (0, 0);
                for _ in 0..15 {
                    let (module, number) = places[dice.below(3) as usize];
                    match switch(&service, module, number, dice.below(3) > 0).await {
                        Ok(()) => ends.0 += 1,
                        Err(CommandError::Interlock { .. }) => ends.1 += 1,
                        Err(other) => panic!("seed {seed}: {other:?}"),
                    }
                }
                ends
            }
        };
        let clients = (0..6).map(|number| on_a_thread(client(number)));
        let mut ends = (0, 0);
        for client in clients.collect::<Vec<_>>() {
            let (done, refused) = client.await.unwrap();
            ends = (ends.0 + done, ends.1 + refused);
        }
        for state in boards.states() {
            let on = (state[3] & 0b11).count_ones() + (state[4] & 1).count_ones();
            assert!(on <= 1, "seed {seed}: {state:?}");
        }
        assert!(ends.0 > 10 && ends.1 > 10, "seed {seed}: {ends:?}");
        service.close().await;
    }
}

#[tokio::test]
async fn an_output_stays_off_for_as_long_as_it_must() {
    let points = "[module.oven.point]\nk1.min_off = \"1500ms\"\n";
    let folder = folder("min-off");
    let (port, boards) = board::start().await;
    let service = Service::start_in(config(&port, points), &folder).unwrap();
    known(&service).await;
    // Nobody knows when it went off before: the time counts from the start.
    let refused = switch(&service, "oven", 1, true).await;
    assert!(matches!(refused, Err(CommandError::MinOff { left, .. }) if left.0 <= 1_500_000));
    let on = async |service: &Service| {
        for _ in 0..500 {
            match switch(service, "oven", 1, true).await {
                Err(CommandError::MinOff { .. }) => {
                    tokio::time::sleep(Duration::from_millis(20)).await
                }
                end => return end.unwrap(),
            }
        }
        panic!("it never may");
    };
    on(&service).await;
    // To switch on what is on is nothing.
    switch(&service, "oven", 1, true).await.unwrap();
    let off = std::time::Instant::now();
    switch(&service, "oven", 1, false).await.unwrap();
    assert!(matches!(
        switch(&service, "oven", 1, true).await,
        Err(CommandError::MinOff { .. })
    ));
    on(&service).await;
    assert!(off.elapsed() >= Duration::from_millis(1_500));

    // Somebody switches it by hand; and a restart changes nothing.
    let off = std::time::Instant::now();
    boards.set(3, 0);
    let is_off = || service.point("oven", k(1)).unwrap().value == Some(PointValue::Bool(false));
    until(is_off).await;
    until(|| folder.join("promises.json").exists()).await;
    service.close().await;
    let service = Service::start_in(config(&port, points), &folder).unwrap();
    known(&service).await;
    assert!(matches!(
        switch(&service, "oven", 1, true).await,
        Err(CommandError::MinOff { .. })
    ));
    on(&service).await;
    assert!(off.elapsed() >= Duration::from_millis(1_500));
    service.close().await;
    let _ = std::fs::remove_dir_all(folder);
}

#[tokio::test]
async fn an_output_is_switched_off_when_it_has_been_on_for_too_long() {
    let (service, boards) = site("[module.oven.point]\nk1.max_on = \"300ms\"\n").await;
    switch(&service, "oven", 1, true).await.unwrap();
    assert!(service.point("oven", k(1)).unwrap().left.max_on.is_some());
    until(|| boards.relays(3) == 0).await;
    let told = || {
        let entries = service.audit();
        let by_itself = entries.iter().find(|entry| entry.origin.who == "max_on");
        by_itself.is_some_and(|entry| entry.end == Some(End::Readback))
    };
    until(told).await;
    // Whoever switches it on.
    boards.set(3, 1);
    until(|| service.point("oven", k(1)).unwrap().left.max_on.is_some()).await;
    until(|| boards.relays(3) == 0).await;
    service.close().await;

    let (port, _boards) = board::start().await;
    let points = "[module.oven.point]\nk1.max_on = \"300ms\"\n";
    let quiet = Service::start_quiet(config(&port, points)).unwrap();
    quiet.opened("main").await.unwrap();
    let refused = switch(&quiet, "oven", 1, true).await;
    assert_eq!(
        refused,
        Err(CommandError::Unwatched(k(1))),
        "nobody stays to see to it"
    );
}

#[tokio::test]
async fn an_output_wants_to_be_told_that_it_is_meant() {
    let (service, boards) = site("[module.oven.point]\nk1.confirm = true\n").await;
    assert_eq!(
        switch(&service, "oven", 1, true).await,
        Err(CommandError::Confirm(k(1)))
    );
    assert_eq!(boards.states().len(), 0);
    let meant = WriteTerms {
        confirm: true,
        ..WriteTerms::default()
    };
    let done = service.write("oven", &[(k(1), true)], meant).await.unwrap();
    let command = service.command(&done.audit).unwrap();
    assert_eq!(
        (command.end, command.what.as_str()),
        (Some(End::Readback), "k1=on")
    );
    assert!(service.command("nothing").is_none());
    service.close().await;
}

#[test]
fn a_pulse_ends_though_the_process_ends_in_the_middle_of_it() {
    let folder = folder("pulse");
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        runtime().block_on(async {
            tell.send(board::start().await).unwrap();
            std::future::pending::<()>().await;
        });
    });
    let (port, boards) = told.recv().unwrap();
    let pulse = |seconds| Pulse {
        width: Some(Micros::from_millis(seconds)),
        ..Pulse::default()
    };
    let process = runtime();
    process.block_on(async {
        let service = Service::start_in(config(&port, ""), &folder).unwrap();
        service.opened("main").await.unwrap();
        // Longer than a busy machine takes until the process ends.
        service.pulse("oven", k(1), pulse(3_000)).await.unwrap();
        service.pulse("oven", k(2), pulse(600_000)).await.unwrap();
        // Another command takes one over: it is nobody's pulse any more.
        service.pulse("oven", k(3), pulse(400)).await.unwrap();
        switch(&service, "oven", 3, true).await.unwrap();
        let kept = || std::fs::read_to_string(folder.join("promises.json")).unwrap();
        until(|| !kept().contains("\"output\":2")).await;
    });
    // All at once, as a signal that can't be caught does.
    process.shutdown_background();
    std::thread::sleep(Duration::from_millis(3_100));
    assert_eq!(boards.relays(3), 0b111, "nobody is there to end it");

    runtime().block_on(async {
        let service = Service::start_in(config(&port, ""), &folder).unwrap();
        until(|| boards.relays(3) == 0b110).await;
        let left = service.point("oven", k(2)).unwrap().left.pulse.unwrap();
        assert!(left <= Duration::from_secs(600) && left > Duration::from_secs(300));
        service.close().await;
        assert_eq!(boards.relays(3), 0b100, "the other one ends with the site");
    });
    let text = std::fs::read_to_string(folder.join("promises.json")).unwrap();
    assert!(!text.contains("pulse"), "{text}");
    let _ = std::fs::remove_dir_all(folder);
}

#[tokio::test]
async fn outputs_go_where_their_policy_says() {
    let points = "[module.oven.point]\nk1.on_exit = \"off\"\nk2.on_exit = \"on\"\n\
                  [module.yard.point]\nk1.on_return = \"on\"\nk2.on_return = \"off\"\n";
    let (service, boards) = site(points).await;
    boards.mute(4, true);
    let quality = || service.point("yard", k(1)).unwrap().quality;
    until(|| matches!(quality(), PointQuality::Bad(_))).await;
    boards.set(4, 0b1010);
    boards.mute(4, false);
    until(|| boards.relays(4) == 0b1001).await;
    for number in [1, 4] {
        switch(&service, "oven", number, true).await.unwrap();
    }
    service.close().await;
    assert_eq!(boards.relays(3), 0b1010, "k4 is held");
    let late = switch(&service, "oven", 1, true).await;
    assert!(late.is_err(), "it is closed");
}

#[tokio::test]
async fn a_command_that_fails_leaves_a_pulse_its_end() {
    let (service, boards) = site("").await;
    let pulse = Pulse {
        width: Some(Micros::from_millis(1_500)),
        ..Pulse::default()
    };
    service.pulse("oven", k(1), pulse).await.unwrap();
    boards.mute(3, true);
    switch(&service, "oven", 1, false).await.unwrap_err();
    assert_eq!(boards.relays(3), 1);
    boards.mute(3, false);
    until(|| boards.relays(3) == 0).await;
    service.close().await;
}

/// A command to switch on lost its reply, and the module has not acted on it.
#[tokio::test]
async fn a_longest_time_that_began_for_nothing_makes_the_next_one_no_shorter() {
    let (service, boards) = site("[module.oven.point.k1]\nmax_on = \"60s\"\n").await;
    let left = || service.point("oven", k(1)).unwrap().left.max_on;
    boards.mute(3, true);
    switch(&service, "oven", 1, true).await.unwrap_err();
    assert!(left().is_some(), "it may be on");
    // Nobody knows that it is off: the time goes on.
    let before = left();
    switch(&service, "oven", 1, true).await.unwrap_err();
    assert!(left() < before);
    boards.mute(3, false);
    until(|| {
        let is_good = service.point("oven", k(1)).unwrap().quality == PointQuality::Good;
        is_good && left() < Some(Duration::from_secs(57))
    })
    .await;
    let before = left();
    switch(&service, "oven", 1, true).await.unwrap();
    assert!(left() > before, "{:?} after {before:?}", left());
    service.close().await;
}
