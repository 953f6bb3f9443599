//! Several outputs at once, groups, scenes, and outputs that are held.

use crate::board::{k, until};
use crate::safety::{site, switch};
use railbus_site::config::Place;
use railbus_site::{
    BatchDone, BatchTerms, CommandError, GroupState, LeaseTerms, PointQuality, Service, Within,
};
use railbus_wire::Micros;
use std::time::Duration;

pub(crate) fn set(outputs: &[(&str, u8, bool)]) -> Vec<(Place, bool)> {
    let place = |(module, number, on): &(&str, u8, bool)| (Place::new(module, k(*number)), *on);
    outputs.iter().map(place).collect()
}

pub(crate) const ALL: BatchTerms = BatchTerms {
    verify: true,
    confirm: false,
    all_or_nothing: true,
    within: Within::DEFAULT,
};

pub(crate) fn failures(done: &BatchDone) -> Vec<Option<&'static str>> {
    let end = |part: &railbus_site::Part| part.end.as_ref().err().map(CommandError::name);
    done.parts.iter().map(end).collect()
}

#[tokio::test]
async fn outputs_of_a_module_go_in_one_frame() {
    let (service, boards) = site("").await;
    let all = set(&[("oven", 1, true), ("yard", 8, true), ("oven", 2, true)]);
    let done = service.batch(&all, BatchTerms::default()).await.unwrap();
    assert_eq!(failures(&done), [None; 3]);
    let first = done.parts[0].end.as_ref().unwrap();
    assert_eq!((first.value, first.before), (Some(true), Some(false)));
    assert_eq!((boards.relays(3), boards.relays(4)), (0b11, 0x80));
    assert_eq!(boards.states().len(), 2, "one frame for each module");
    let places: Vec<Place> = all.into_iter().map(|(place, _)| place).collect();
    assert_eq!(service.frames_of(&places), 2);
    // One frame of these boards has no gaps.
    let gap = [Place::new("oven", k(1)), Place::new("oven", k(3))];
    assert_eq!(service.frames_of(&gap), 2);
    service.close().await;
}

#[tokio::test]
async fn some_may_fail_and_all_or_nothing_takes_back() {
    let (service, boards) = site("[module.oven.point]\nk8.locked = true\n").await;
    switch(&service, "oven", 2, true).await.unwrap();
    let locked = set(&[("oven", 1, true), ("oven", 8, true)]);
    let done = service.batch(&locked, BatchTerms::default()).await.unwrap();
    assert_eq!(failures(&done), [None, Some("locked")]);
    assert_eq!(boards.relays(3), 0b11);
    // What can be known before is: nothing is sent.
    let frames = boards.states().len();
    let done = service
        .batch(&set(&[("oven", 3, true), ("oven", 8, true)]), ALL)
        .await
        .unwrap();
    assert_eq!(failures(&done), [Some("not_tried"), Some("locked")]);
    assert_eq!((boards.states().len(), done.undone), (frames, false));

    boards.mute(4, true);
    let bad = || {
        matches!(
            service.point("yard", k(1)).unwrap().quality,
            PointQuality::Bad(_)
        )
    };
    until(bad).await;
    let mixed = set(&[("oven", 1, false), ("oven", 3, true), ("yard", 1, true)]);
    let done = service.batch(&mixed, ALL).await.unwrap();
    assert_eq!(
        failures(&done),
        [Some("undone"), Some("undone"), Some("no_reply")]
    );
    assert_eq!(boards.relays(3), 0b11, "as it was");
    assert!(!done.undone, "nobody knows what the silent one did");
    service.close().await;
}

#[tokio::test]
async fn what_can_not_be_taken_back_is_told() {
    let points = "[module.oven.point]\nk1.min_off = \"10m\"\n";
    let (service, boards) = site(points).await;
    // By hand: it may be switched off, and not on again for a while.
    boards.set(3, 0b1);
    let is_on = || {
        let known = service.point("oven", k(1)).unwrap().value;
        known == Some(railbus_site::PointValue::Bool(true))
    };
    until(is_on).await;
    boards.mute(4, true);
    let bad = || {
        matches!(
            service.point("yard", k(1)).unwrap().quality,
            PointQuality::Bad(_)
        )
    };
    until(bad).await;
    let mixed = set(&[("oven", 1, false), ("yard", 1, true)]);
    let done = service.batch(&mixed, ALL).await.unwrap();
    assert_eq!(failures(&done), [Some("not_undone"), Some("no_reply")]);
    assert!(!done.undone);
    assert_eq!(boards.relays(3), 0);
    service.close().await;
}

#[tokio::test]
async fn what_excludes_goes_off_before_the_other_goes_on() {
    let (service, boards) = site("[module.oven.point]\nk1.interlock = [\"oven.k2\"]\n").await;
    switch(&service, "oven", 1, true).await.unwrap();
    let over = set(&[("oven", 2, true), ("oven", 1, false)]);
    let done = service.batch(&over, ALL).await.unwrap();
    assert_eq!(failures(&done), [None, None]);
    assert!(boards.states().iter().all(|state| state[3] != 0b11));
    // One that must not be leaves the others.
    let both = set(&[("oven", 1, true), ("oven", 3, true)]);
    let done = service.batch(&both, BatchTerms::default()).await.unwrap();
    assert_eq!(failures(&done), [Some("interlock"), None]);
    assert_eq!(boards.relays(3), 0b110);
    service.close().await;
}

const NIGHT: &str = "[group.night]\nmembers = [\"oven.k1\", \"oven.k2\", \"yard.k1\"]\n\
    [scene.evening]\nsteps = [{ set = \"oven.k1\", to = true }, { set = \"oven.k2\", to = true }, \
    { wait = \"100ms\" }, { set = \"yard.k1\", to = true }, { set = \"oven.k1\", to = false }]\n";

async fn night(service: &Service, to: GroupState) -> BatchDone {
    let done = service.set_group("night", to, BatchTerms::default()).await;
    done.unwrap()
}

#[tokio::test]
async fn a_group_is_switched_at_once() {
    let (service, boards) = site(NIGHT).await;
    switch(&service, "yard", 1, true).await.unwrap();
    let frames = boards.states().len();
    // One of them is on: they all go off.
    assert_eq!(
        failures(&night(&service, GroupState::Toggle).await),
        [None; 3]
    );
    assert_eq!((boards.relays(3), boards.relays(4)), (0, 0));
    night(&service, GroupState::Toggle).await;
    assert_eq!((boards.relays(3), boards.relays(4)), (0b11, 1));
    assert_eq!(boards.states().len(), frames + 4);
    boards.mute(4, true);
    let some = night(&service, GroupState::Set(false)).await;
    assert_eq!(failures(&some), [None, None, Some("no_reply")]);
    let none = service.set_group("day", GroupState::Toggle, ALL).await;
    assert_eq!(none, Err(CommandError::NoSuchGroup));
    service.close().await;
}

#[tokio::test]
async fn of_two_toggles_of_a_group_at_once_the_later_sees_what_the_first_has_done() {
    let (service, boards) = site(NIGHT).await;
    let (first, later) = tokio::join!(
        night(&service, GroupState::Toggle),
        night(&service, GroupState::Toggle)
    );
    assert_eq!(
        (failures(&first), failures(&later)),
        (vec![None; 3], vec![None; 3])
    );
    assert_ne!(first.parts[0].wanted, later.parts[0].wanted);
    assert_eq!((boards.relays(3), boards.relays(4)), (0, 0), "on and off");
    // What was acknowledged alone is read before it is decided on.
    let unverified = BatchTerms {
        verify: false,
        ..BatchTerms::default()
    };
    for on in [0b11, 0] {
        let done = service.set_group("night", GroupState::Toggle, unverified);
        assert_eq!(failures(&done.await.unwrap()), [None; 3]);
        assert_eq!(boards.relays(3), on);
    }
    service.close().await;
}

#[tokio::test]
async fn a_scene_is_played_up_to_what_fails() {
    let (service, boards) = site(NIGHT).await;
    let again = service.clone();
    let playing = tokio::spawn(async move { again.play("evening", ALL).await });
    until(|| boards.relays(3) == 0b11).await;
    assert_eq!(boards.relays(4), 0, "there is a pause");
    let twice = service.play("evening", ALL).await;
    assert_eq!(twice, Err(CommandError::Playing));
    let done = playing.await.unwrap().unwrap();
    assert_eq!(failures(&done), [None; 4]);
    assert_eq!((boards.relays(3), boards.relays(4)), (0b10, 1));

    boards.mute(4, true);
    let done = service.play("evening", ALL).await.unwrap();
    let ends = [None, None, Some("no_reply"), Some("not_tried")];
    assert_eq!(failures(&done), ends);
    assert_eq!(boards.relays(3), 0b11, "the last step was left out");
    let none = service.play("morning", ALL).await;
    assert_eq!(none, Err(CommandError::NoSuchScene));
    service.close().await;
}

#[tokio::test]
async fn an_output_is_held_for_as_long_as_that_is_said_again() {
    let points = "[module.oven.point]\nk2.on_offline = \"hold\"\nk3.on_offline = \"on\"\n";
    let (service, boards) = site(points).await;
    let hold = async |number, value, millis| {
        let held = (value, Micros::from_millis(millis));
        service
            .lease("oven", k(number), held, LeaseTerms::default())
            .await
    };
    let taken = hold(1, true, 60_000).await.unwrap();
    assert!(taken.written.is_some());
    let frames = boards.states().len();
    let again = hold(1, true, 400).await.unwrap();
    assert!(again.written.is_none(), "it is held already");
    assert_eq!(boards.states().len(), frames);
    assert!(service.point("oven", k(1)).unwrap().left.lease.is_some());
    until(|| boards.relays(3) & 1 == 0).await;
    assert_eq!(service.audit().pop().unwrap().origin.who, "lease");

    // The policy of the output goes before.
    hold(2, true, 300).await.unwrap();
    hold(3, false, 300).await.unwrap();
    until(|| boards.relays(3) & 0b100 != 0).await;
    until(|| service.point("oven", k(2)).unwrap().left.lease.is_none()).await;
    assert_eq!(boards.relays(3), 0b110);

    // It can be given back, and another command takes it over.
    hold(4, true, 60_000).await.unwrap();
    service.end_lease("oven", k(4)).await.unwrap();
    assert_eq!(boards.relays(3), 0b110);
    let nothing = service.end_lease("oven", k(4)).await;
    assert_eq!(nothing, Err(CommandError::NoLease(k(4))));
    hold(5, true, 300).await.unwrap();
    switch(&service, "oven", 5, true).await.unwrap();
    tokio::time::sleep(Duration::from_millis(600)).await;
    assert_eq!(boards.relays(3), 0b1_0110);
    assert_eq!(hold(6, true, 1).await, Err(CommandError::LeaseTime(k(6))));
    hold(6, true, 60_000).await.unwrap();
    service.close().await;
    assert_eq!(
        boards.relays(3),
        0b1_0110,
        "who holds it can say so no more"
    );
}
