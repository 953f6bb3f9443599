//! What is to be done later, on a disk that works and on one that does not.

use super::super::*;
use super::world::{World, at, bit, k, ms, pulse};
use crate::CommandError;

const TEXT: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

fn oven() -> World {
    let mut world = World::new(TEXT, 7);
    world.pass(ms(300));
    world
}

#[test]
fn what_is_promised_outlives_who_promised_it() {
    let mut world = oven();
    let begun = world.pulse("li", ("oven", 1), pulse(60_000));
    let held = world.lease("li", ("oven", 2), (true, ms(60_000)));
    world.pass(ms(1_000));
    assert!(begun.now().is_ok() && held.now().is_ok());
    assert!(world.write("li", ("oven", 2), true).get().is_none());
    world.pass(ms(1_000));
    world.kill();
    assert_eq!(world.disk.len(), 1);
    world.pass(ms(30_000));
    world.start();
    world.pass(ms(26_000));
    assert_eq!(world.relays("oven"), bit(1) | bit(2));
    world.pass(ms(3_000));
    assert_eq!(world.relays("oven"), bit(2), "one is no lease any more");
    assert!(world.disk.is_empty());
}

/// Nothing is switched whose end could not be written down.
#[test]
fn a_disk_that_refuses_begins_no_pulse() {
    let mut world = oven();
    world.faults.disk = 1;
    let begun = world.pulse("li", ("oven", 1), pulse(1_000));
    world.pass(ms(1_000));
    assert_eq!(
        begun.now(),
        Err(CommandError::NotKept(ErrorKind::StorageFull))
    );
    assert!(world.acted.is_empty());
}

/// A takeover that the disk refuses is said to be none, and the pulse ends.
#[test]
fn a_takeover_is_done_or_refused_and_never_half() {
    let mut world = oven();
    let begun = world.pulse("li", ("oven", 1), pulse(5_000));
    world.pass(ms(1_000));
    assert!(begun.now().is_ok());
    world.faults.disk = 1;
    let taken = world.write("wang", ("oven", 1), true);
    world.pass(ms(1_000));
    world.faults.disk = 0;
    assert_eq!(
        taken.now(),
        Err(CommandError::NotTakenOver(ErrorKind::StorageFull))
    );
    world.pass(ms(5_000));
    assert_eq!(world.relays("oven"), 0);
}

/// Who says again that an output is held has it from then on, and no pulse ends that.
#[test]
fn a_lease_that_could_not_take_over_does_so_when_it_is_said_again() {
    let mut world = oven();
    let begun = world.pulse("li", ("oven", 1), pulse(10_000));
    world.pass(ms(1_000));
    assert!(begun.now().is_ok());
    let held = world.lease("wang", ("oven", 1), (false, ms(4_000)));
    // Its promise is on the disk, and the takeover is not.
    while world.log.len() < 2 && world.step(ms(2_000)) {}
    world.faults.disk = 1;
    world.pass(ms(500));
    world.faults.disk = 0;
    assert_eq!(
        held.now(),
        Err(CommandError::NotTakenOver(ErrorKind::StorageFull))
    );
    world.pass(ms(2_000));
    let again = world.lease("wang", ("oven", 1), (false, ms(15_000)));
    world.pass(ms(10_000));
    assert!(again.now().is_ok());
    assert_eq!(world.relays("oven"), 0, "where the pulse would have ended");
    world.pass(ms(8_000));
    assert_eq!(world.relays("oven"), bit(1), "it goes where a lease ends");
}

/// A takeover is on its way to the disk, the pulse falls due meanwhile, the disk refuses.
#[test]
fn a_pulse_that_falls_due_during_a_refused_takeover_ends() {
    let mut stuck = Vec::new();
    for before in 0..200 {
        let mut world = oven();
        let begun = world.pulse("li", ("oven", 1), pulse(1_000));
        world.pass(ms(800));
        assert!(begun.now().is_ok());
        world.pass(ms(before));
        world.faults.disk = 1;
        let taken = world.write("wang", ("oven", 1), true);
        world.pass(ms(1_000));
        world.faults.disk = 0;
        if taken.now() != Err(CommandError::NotTakenOver(ErrorKind::StorageFull)) {
            continue;
        }
        world.pass(ms(600_000));
        if world.relays("oven") != 0 {
            stuck.push((
                before,
                world.state().left("oven", k(1)).pulse,
                world.disk.len(),
            ));
        }
    }
    assert!(stuck.is_empty(), "on for ever: {stuck:?}");
}

/// What the disk says is out of date for as long as it refuses, and no longer.
#[test]
fn a_disk_that_refused_is_tried_again() {
    let mut world = oven();
    let begun = world.pulse("li", ("oven", 1), pulse(2_000));
    world.pass(ms(1_500));
    assert!(begun.now().is_ok());
    world.faults.disk = 1;
    world.pass(ms(2_000));
    assert_eq!(world.relays("oven"), 0);
    assert!(!world.disk.is_empty() || world.is_disk_behind);
    world.faults.disk = 0;
    world.pass(ms(1_100));
    assert!(world.disk.is_empty() && !world.is_disk_behind);
}

/// A disk that refuses for days does not fill the memory.
#[test]
fn what_can_not_be_written_down_does_not_pile_up() {
    let mut world = oven();
    world.faults.disk = 1;
    for _ in 0..100 {
        let begun = world.pulse("li", ("oven", 1), pulse(1_000));
        world.pass(ms(500));
        assert!(begun.now().is_err());
    }
    let kept = world.state().schedule.len();
    assert!(kept <= 2, "{kept}");
}

/// The name of a module stands for another board after the restart.
#[test]
fn the_end_of_another_boards_pulse_is_told_and_not_done() {
    let mut world = oven();
    let begun = world.pulse("li", ("oven", 1), pulse(60_000));
    world.pass(ms(1_000));
    assert!(begun.now().is_ok());
    world.kill();
    world.become_other(&TEXT.replace("address = 3", "address = 4"));
    world.start();
    world.move_by_hand("oven", bit(1));
    world.pass(ms(100_000));
    assert_eq!(world.relays("oven"), bit(1), "it is not its output");
    let dropped = world.state().schedule.take_dropped();
    assert_eq!(dropped.len(), 1);
    assert_eq!(dropped[0].0, (at("oven", 1), Why::Pulse));
}

/// The clock on the wall is set back, and the process starts again and again.
#[test]
fn a_clock_that_was_set_back_makes_no_pulse_longer() {
    let mut world = oven();
    let begun = world.pulse("li", ("oven", 1), pulse(5_000));
    world.pass(ms(500));
    assert!(begun.now().is_ok());
    world.kill();
    world.wall_behind = ms(3_600_000);
    for _ in 0..3 {
        world.start();
        world.pass(ms(3_000));
        world.kill();
    }
    assert_eq!(world.relays("oven"), 0);
}

/// The disk is slow: what it says of an output that was on meanwhile is out of date by hours.
#[test]
fn an_output_that_went_off_just_before_the_end_stays_off_after_the_next_start() {
    let text = format!("{TEXT}[module.oven.point]\nk1.min_off = \"5s\"\n");
    for killed in 0..120 {
        let mut world = World::new(&text, 7);
        world.pass(ms(7_000));
        world.faults.slow_disk = 1;
        let on = world.write("li", ("oven", 1), true);
        while on.get().is_none() && world.step(ms(20_000)) {}
        assert!(on.now().is_ok());
        let off = world.write("li", ("oven", 1), false);
        world.pass(ms(killed));
        world.kill();
        let went_off = world.relays("oven") == 0;
        world.faults.slow_disk = 0;
        world.start();
        world.pass(ms(300));
        let soon = world.write("li", ("oven", 1), true);
        world.pass(ms(300));
        let _ = off.get();
        if went_off {
            let refused = matches!(soon.now(), Err(CommandError::MinOff { .. }));
            assert!(refused, "killed after {killed} ms: {:?}", soon.now());
        }
    }
}
