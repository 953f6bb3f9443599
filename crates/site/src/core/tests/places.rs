//! Reloads and exclusive access to lines while commands are under way, and both at once.

use super::super::lines::WAITING_MAX;
use super::super::reload::TURN_MAX;
use super::super::*;
use super::world::{End, World, bit, k, ms, pulse, who_is};
use crate::rights::Who;
use crate::{BadReason, CommandError, Rights, Role};
use railbus_host::{Fault, LineState};

const PORT: &str = "/dev/ttyS9";

/// One line with these modules and addresses.
fn named(modules: &[(&str, u8)]) -> String {
    let line = format!("[line.main]\nport = \"{PORT}\"\n");
    let modules = modules.iter().map(|(name, address)| {
        format!("[module.{name}]\nline = \"main\"\nmodel = \"erc8\"\naddress = {address}\n")
    });
    line + &modules.collect::<String>()
}

fn here() -> String {
    named(&[("oven", 3), ("kiln", 4)])
}

fn swapped() -> String {
    named(&[("oven", 4), ("kiln", 3)])
}

fn site() -> World {
    let mut world = World::new(&here(), 1);
    world.pass(ms(300));
    world
}

fn closed<T>() -> Result<T, CommandError> {
    Err(CommandError::Line(Fault::Closed))
}

/// What is done to the board that got the name of another, by a command that was for that one.
fn obeyed_by(world: &World, address: u8) -> Vec<&str> {
    let acted = world.acted.iter().filter(|acted| acted.seat.1 == address);
    acted.map(|acted| &*acted.module).collect()
}

fn is_quiet(world: &mut World) {
    assert!(world.disk.is_empty(), "{:?}", world.disk);
    assert!(world.open.is_empty(), "{:?}", world.open);
    assert!(world.state().is_at_rest(), "{:?}", world.state());
}

/// Another model has the name while a scene waits: its outputs have other labels, which the rights
/// of the caller do not cover.
#[test]
fn rights_are_asked_again_by_the_configuration_of_the_moment() {
    let scene = "[scene.heat]\nsteps = [{ set = \"oven.LABEL\", to = true }, { wait = \"500ms\" }, \
         { set = \"oven.LABEL\", to = false }]\n";
    let before = here() + &scene.replace("LABEL", "k1");
    let mut world = World::new(&before, 1);
    world.pass(ms(300));
    let who = Who {
        rights: Rights {
            role: Role::Operator,
            points: ["oven.k1".to_owned()].into(),
        },
        ..who_is("li")
    };
    let terms = BatchTerms::default();
    let play = move |core: Context| async move { core.play(&who, "heat", terms).await };
    let done = world.order(play);
    world.pass(ms(200));
    let after = before.replace("k1", "do0").replacen("erc8", "eda9060a", 1);
    world.reload(&after, true);
    world.pass(ms(2_000));
    let ends: Vec<_> = done.now().unwrap().parts.into_iter().collect();
    assert!(ends[0].end.is_ok(), "{ends:?}");
    let refused = CommandError::NotPermitted {
        module: "oven".to_owned(),
        label: "do0".to_owned(),
    };
    assert_eq!(ends[1].end, Err(refused));
    assert_eq!(world.audit().len(), 1, "{:?}", world.audit());
}

/// Another reload comes first: what would have given a point another name would now take back what
/// that has changed.
#[test]
fn rights_to_reload_are_asked_again_by_the_configuration_of_the_moment() {
    let named = here() + "[module.oven.point]\nk1.name = \"Heat\"\n";
    for other_first in [false, true] {
        let mut world = site();
        let first = other_first.then(|| world.reload(&swapped(), true));
        let rights = Rights {
            role: Role::Engineer,
            points: ["oven.k1".to_owned()].into(),
        };
        let points = Arc::clone(&rights.points);
        let named = world.reload_as(rights, &named);
        world.pass(ms(2_000));
        assert!(first.is_none_or(|first| first.now().is_some()));
        match other_first {
            true => assert_eq!(named.now(), Err(CommandError::Limited(points))),
            false => assert!(named.now().is_ok_and(|reloaded| reloaded.is_some())),
        }
        let oven = world.state().site.config().modules["oven"].setup.address.0;
        assert_eq!(oven, if other_first { 4 } else { 3 });
    }
}

/// A pulse or lease waits for the audit log, and the line comes back with another board of that
/// name: that is not switched.
#[test]
fn what_begins_while_its_line_is_lent_goes_to_its_own_board_or_nowhere() {
    for after in [0, 1, 5, 100, 400] {
        for leases in [false, true] {
            let mut world = site();
            world.audit_takes = Some(ms(4_000));
            let pulse = (!leases).then(|| world.pulse("li", ("oven", 1), pulse(60_000)));
            let lease = leases.then(|| world.lease("li", ("oven", 1), (true, ms(60_000))));
            world.pass(ms(after));
            let lent = world.lend("main");
            world.pass(ms(1_500));
            let loan = lent.now().unwrap().loan;
            world.give_back("main", loan, Some(&swapped()));
            world.pass(ms(60_000));
            let end = pulse.and_then(|end| end.now().err());
            let end = end.or_else(|| lease.and_then(|end| end.now().err()));
            assert_eq!(end, Some(CommandError::Line(Fault::Closed)), "{after} ms");
            assert!(world.acted.is_empty(), "{after} ms: {:?}", world.acted);
            is_quiet(&mut world);
        }
    }
}

/// Whenever a reload comes that gives the name to another board, a command is for the board that
/// had the name when it was asked for; a pulse or lease of that is released before it loses it.
#[test]
fn a_command_is_for_the_board_that_it_was_asked_of() {
    for after in (0..200).step_by(3) {
        for what in 0..3 {
            for first in [false, true] {
                let mut world = site();
                world.disk_takes = Some(ms(after % 40 * 10));
                let reload = |world: &mut World| {
                    world.pass(ms(after));
                    world.reload(&swapped(), true)
                };
                // Of the reload, too, one may come first that holds it up.
                let held = world.write("wang", ("oven", 2), true);
                let reloaded = first.then(|| reload(&mut world));
                let mut ends = Vec::new();
                match what {
                    0 => drop(world.write("li", ("oven", 1), true)),
                    1 => ends.push(world.pulse("li", ("oven", 1), pulse(60_000))),
                    _ => drop(world.lease("li", ("oven", 1), (true, ms(60_000)))),
                }
                let reloaded = reloaded.unwrap_or_else(|| reload(&mut world));
                world.pass(ms(10_000));
                assert!(held.get().is_some() && reloaded.now().is_some());
                let strangers = obeyed_by(&world, 4);
                let when = format!("{what} after {after} ms: {:?}", world.acted);
                assert!(strangers.is_empty(), "{when}");
                let relays = world.relays_at(PORT, 3);
                assert!(what == 0 || relays & bit(1) == 0, "{when}");
                assert_eq!(world.events.len(), 0, "all of it could be done");
                is_quiet(&mut world);
            }
        }
    }
}

/// Its module does not hear its end: the reload says which output that is, and the board that has
/// the name now is left alone.
#[test]
fn an_end_that_could_not_be_done_is_reported_and_meets_no_other_board() {
    let mut world = site();
    let begun = world.pulse("li", ("oven", 1), pulse(5_000));
    world.pass(ms(500));
    assert!(begun.now().is_ok());
    world.move_by_hand("kiln", bit(1));
    world.dead("oven", true);
    let reloaded = world.reload(&swapped(), true);
    world.pass(ms(60_000));
    assert!(reloaded.now().is_some());
    assert_eq!(world.relays_at(PORT, 4), bit(1));
    let told: Vec<_> = world
        .events
        .iter()
        .map(|e| (e.code.as_deref(), e.text.as_deref()))
        .collect();
    assert_eq!(told, [(Some("end_dropped"), Some("address 3, output 1"))]);
    is_quiet(&mut world);
}

/// The disk keeps a pulse waiting for longer than a reload waits for it.
#[test]
fn a_promise_that_a_reload_drops_begins_nothing() {
    for takes in [29_900, 30_000, 30_100, 40_000] {
        let mut world = site();
        world.disk_takes = Some(ms(takes));
        let begun = world.pulse("li", ("oven", 1), pulse(60_000));
        world.pass(ms(1));
        let reloaded = world.reload(&swapped(), true);
        world.pass(ms(200_000));
        assert!(reloaded.now().is_some() && begun.now().is_err());
        assert!(world.acted.is_empty(), "{:?}", world.acted);
        is_quiet(&mut world);
    }
}

/// What can't be written does not come into force; what was ended for it is over.
#[test]
fn a_configuration_that_is_not_written_changes_nothing() {
    let mut world = site();
    let begun = world.pulse("li", ("oven", 1), pulse(60_000));
    world.pass(ms(500));
    assert!(begun.now().is_ok());
    world.dead("oven", true);
    let reloaded = world.reload(&swapped(), false);
    world.pass(TURN_MAX);
    assert_eq!(reloaded.now(), None);
    assert_eq!(
        world.state().site.config().modules["oven"].setup.address.0,
        3
    );
    world.dead("oven", false);
    world.pass(ms(2_000));
    assert_eq!(
        world.relays("oven"),
        0,
        "its end was put forward, and is done"
    );
    is_quiet(&mut world);
}

#[test]
fn reloads_and_loans_come_one_after_the_other() {
    for after in 0..60 {
        let mut world = site();
        let begun = world.lease("li", ("oven", 1), (true, ms(60_000)));
        world.pass(ms(500));
        assert!(begun.now().is_ok());
        let other = format!("{}[line.other]\nport = \"/dev/ttyS8\"\n", swapped());
        let first = world.reload(&other, true);
        world.pass(ms(after));
        let lent = world.lend("main");
        let again = world.lend("main");
        world.pass(ms(after));
        let last = world.reload(&here(), true);
        world.pass(ms(5_000));
        assert_eq!(first.now().unwrap().opened, ["other"]);
        let loan = lent.now().unwrap().loan;
        assert!(matches!(again.now(), Err(CommandError::Lent)));
        // While it is lent, its modules have moved.
        assert_eq!(last.now().unwrap().closed, ["other"]);
        assert_eq!(world.state().line_fault("main"), Some(BadReason::Exclusive));
        world.give_back("main", loan, None);
        world.pass(ms(1_000));
        let on = world.write("li", ("oven", 2), true);
        world.pass(ms(1_000));
        assert!(on.now().is_ok());
        assert_eq!(world.relays_at(PORT, 3), bit(2), "the lease was ended");
        is_quiet(&mut world);
    }
}

/// The line of a loan is removed, comes again, and is lent to another: the first holder gives back
/// what is not its own any more.
#[test]
fn an_old_loan_does_not_take_back_a_newer_one() {
    let mut world = site();
    let old = world.lend("main");
    world.pass(ms(2_000));
    let old = old.now().unwrap().loan;
    let other = here().replace("main", "other").replace(PORT, "/dev/ttyS8");
    let gone = world.reload(&other, true);
    let back = world.reload(&here(), true);
    world.pass(ms(2_000));
    assert!(gone.now().is_some() && back.now().is_some());
    let new = world.lend("main");
    world.pass(ms(2_000));
    let new = new.now().unwrap().loan;
    assert_ne!(new, old);
    world.give_back("main", old, None);
    world.pass(ms(2_000));
    assert_eq!(world.state().line_fault("main"), Some(BadReason::Exclusive));
    assert_eq!(world.state().lines["main"].id, None);
    world.give_back("main", new, None);
    world.pass(ms(2_000));
    assert_eq!(world.state().line_fault("main"), None);
}

/// Whoever wants a line goes away at any moment: it comes back, or was never taken.
#[test]
fn a_line_comes_back_though_its_holder_is_gone_before_it_is_lent() {
    for after in 0..120 {
        let mut world = site();
        world.pulse("li", ("oven", 1), pulse(60_000));
        world.pass(ms(300));
        let now = world.time();
        let core = world.core.as_mut().unwrap();
        let lend = |core: Context| async move { core.lend_line("main").await };
        let task = core.start(now, lend, |_| {});
        world.pass(ms(after));
        let now = world.time();
        let granted = world.state().lines["main"].id.is_none();
        world.core.as_mut().unwrap().cancel(now, task);
        if granted {
            // It had it already.
            let loan = LoanId(1);
            world.give_back("main", loan, None);
        }
        world.pass(ms(3_000));
        let on = world.write("wang", ("kiln", 2), true);
        world.pass(ms(1_000));
        assert!(on.now().is_ok(), "{after} ms");
        assert_eq!(
            world.relays("oven"),
            0,
            "{after} ms: the pulse was ended for it"
        );
        is_quiet(&mut world);
    }
}

/// Where the holder finds a line may have changed until it is granted.
#[test]
fn a_line_is_not_lent_whose_output_is_switched_on_meanwhile_and_is_due() {
    let limits = format!("{}[module.oven.point]\nk2.max_on = \"60s\"\n", here());
    let mut world = World::new(&limits, 1);
    world.pass(ms(300));
    let held = world.pulse("li", ("oven", 1), pulse(60_000));
    world.pass(ms(300));
    assert!(held.now().is_ok());
    // Its end takes a moment.
    world.hold_line(ms(300));
    let lent = world.lend("main");
    world.write("wang", ("kiln", 1), true);
    world.move_by_hand("oven", bit(2));
    world.pass(ms(3_000));
    assert!(
        matches!(lent.now(), Err(CommandError::Due { .. })),
        "{:?}",
        lent.now()
    );
    let on = world.write("wang", ("kiln", 2), true);
    world.pass(ms(1_000));
    assert!(on.now().is_ok(), "the line was not closed");
}

/// Who had the line may have switched the output on and off again, whether or not the
/// configuration is another one then.
#[test]
fn an_output_of_a_line_that_was_lent_may_have_gone_off_just_now() {
    for text in [false, true] {
        let pause = format!("{}[module.oven.point]\nk1.min_off = \"5s\"\n", here());
        let mut world = World::new(&pause, 1);
        world.pass(ms(20_000));
        let lent = world.lend("main");
        world.pass(ms(1_000));
        let loan = lent.now().unwrap().loan;
        world.give_back("main", loan, text.then_some(&pause));
        world.pass(ms(500));
        let early = world.write("li", ("oven", 1), true);
        world.pass(ms(1_000));
        assert!(
            matches!(early.now(), Err(CommandError::MinOff { .. })),
            "{:?}",
            early.now()
        );
        world.pass(ms(5_000));
        let late = world.write("li", ("oven", 1), true);
        world.pass(ms(1_000));
        assert!(late.now().is_ok());
    }
}

#[test]
fn so_many_may_wait_for_a_line() {
    let mut world = site();
    world.dead("oven", true);
    world.pulse("li", ("oven", 1), pulse(60_000));
    world.disk_takes = Some(ms(20_000));
    let first = world.reload(&swapped(), true);
    let waiting: Vec<_> = (1..WAITING_MAX).map(|_| world.lend("main")).collect();
    let refused = world.lend("main");
    let overloaded = matches!(refused.now(), Err(CommandError::Line(Fault::Overloaded)));
    assert!(overloaded, "{:?}", refused.now());
    let refused = world.reload_as(Rights::all(), &here());
    assert_eq!(refused.now(), Err(CommandError::Line(Fault::Overloaded)));
    world.disk_takes = None;
    world.pass(ms(120_000));
    assert!(first.now().is_some());
    let lent = waiting.iter().filter(|lent| lent.now().is_ok()).count();
    assert_eq!(lent, 1, "the others find it lent");
}

fn ended<T: Clone>(end: &End<T>, what: &str, after: u64) {
    assert!(end.get().is_some(), "{what}, {after} ms");
}

/// The site closes at any moment of a reload or a loan: lines that it has closed stay closed.
#[test]
fn a_site_that_closes_during_a_reload_or_a_loan_opens_nothing_any_more() {
    for after in 0..100 {
        for what in 0..3 {
            let mut world = site();
            world.pulse("li", ("oven", 1), pulse(60_000));
            world.pass(ms(300));
            let moved = here().replace(
                "[module.kiln]",
                "[line.far]\nport = \"/dev/ttyS7\"\n[module.kiln]",
            );
            let baud = moved.replacen("port", "baud = 19200\nport", 1);
            let reloaded = (what == 0).then(|| world.reload(&baud, true));
            let lent = (what > 0).then(|| world.lend("main"));
            if what == 2 {
                world.pass(ms(2_000));
                let loan = lent.as_ref().unwrap().now().unwrap().loan;
                world.give_back("main", loan, Some(&baud));
            }
            world.pass(ms(after));
            let end = world.close();
            world.pass(ms(5_000));
            ended(&end, "close", after);
            if let Some(reloaded) = reloaded {
                ended(&reloaded, "reload", after);
            }
            let open = |line: &LineNowIs| line.1;
            let lines = world.state().lines.iter();
            let lines: Vec<LineNowIs> = lines
                .map(|(name, now)| (name.clone(), now.id.is_some()))
                .collect();
            assert!(
                !lines.iter().any(open),
                "{what} after {after} ms: {lines:?}"
            );
            assert_eq!(world.relays_at(PORT, 3), 0, "{what} after {after} ms");
            assert!(matches!(
                world.lend("main").now(),
                Err(CommandError::Line(Fault::Closed))
            ));
            let on = world.write("wang", ("kiln", 2), true);
            assert_eq!(on.now().map(drop), closed());
            assert!(world.state().left("oven", k(1)) == crate::Left::default());
            let state = world.state().lines["main"].state.clone();
            let is_over = matches!(state, LineState::Closed | LineState::Absent(_));
            assert!(is_over, "{what} after {after} ms: {state:?}");
        }
    }
}

type LineNowIs = (String, bool);
