//! What becomes of outputs: pulses, leases, limits, policies, batches.

use super::super::*;
use super::world::{Faults, World, at, bit, k, ms, pulse, who_is};
use crate::CommandError;
use railbus_host::Fault;

const TEXT: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

fn oven(points: &str) -> World {
    let mut world = World::new(&format!("{TEXT}[module.oven.point]\n{points}"), 1);
    world.pass(ms(300));
    world
}

#[test]
fn a_pulse_ends_and_a_command_takes_it_over() {
    let mut world = oven("");
    let begun = world.pulse("li", ("oven", 1), pulse(1_000));
    let kept = world.pulse("li", ("oven", 2), pulse(1_000));
    world.pass(ms(400));
    assert_eq!(begun.now().unwrap().by, By::Host);
    assert!(kept.now().is_ok());
    assert_eq!(world.relays("oven"), bit(1) | bit(2));
    assert!(world.write("wang", ("oven", 2), true).get().is_none());
    world.pass(ms(2_000));
    assert_eq!(world.relays("oven"), bit(2), "one is no pulse any more");
    assert!(world.disk.is_empty(), "{:?}", world.disk);
}

/// The fault for which the core was made: an `off` comes between the promise of a pulse and its
/// frame. Whatever the order, the relay is off in the end, and nothing is left.
#[test]
fn an_off_that_comes_just_after_a_pulse_is_its_end() {
    for after in 0..300 {
        let mut world = oven("");
        let begun = world.pulse("li", ("oven", 1), pulse(10_000));
        world.pass(Micros(after * 1_000));
        let off = world.write("wang", ("oven", 1), false);
        world.pass(ms(2_000));
        assert!(begun.now().is_ok() && off.now().is_ok());
        assert_eq!(world.relays("oven"), 0, "{after} ms");
        assert_eq!(world.state().left("oven", k(1)), crate::Left::default());
        world.pass(ms(20_000));
        assert_eq!(world.relays("oven"), 0, "{after} ms");
    }
}

/// The same where the module refuses the `off`, or does not hear it: the pulse keeps its end.
#[test]
fn an_off_that_fails_leaves_a_pulse_its_end() {
    for after in 0..200 {
        let mut world = oven("");
        let begun = world.pulse("li", ("oven", 1), pulse(3_000));
        world.pass(Micros(after * 1_000));
        let off = world.write("wang", ("oven", 1), false);
        // The pulse is under way, and the module hears nothing after it.
        while begun.get().is_none() && world.step(ms(10_000)) {}
        world.faults.refused = 1;
        world.pass(ms(1_000));
        world.faults = Faults::default();
        assert!(off.get().is_some());
        world.pass(ms(70_000));
        assert_eq!(world.relays("oven"), 0, "{after} ms");
        assert!(world.disk.is_empty());
    }
}

#[test]
fn an_output_is_released_as_soon_as_its_module_is_heard_again() {
    let mut world = oven("");
    let begun = world.pulse("li", ("oven", 1), pulse(1_000));
    world.pass(ms(500));
    assert!(begun.now().is_ok());
    world.dead("oven", true);
    world.pass(ms(100_000));
    assert_eq!(world.relays("oven"), bit(1));
    let tries = world.acted.len();
    world.dead("oven", false);
    world.pass(ms(600));
    assert_eq!(world.relays("oven"), 0, "nobody waits for the next try");
    assert_eq!(world.acted.len(), tries + 1);
    let entries: Vec<_> = world.audit();
    assert_eq!(
        entries,
        [
            ("pulse k1 1000ms by host", Some("readback")),
            ("end of pulse k1", Some("no_reply")),
            ("end of pulse k1", Some("readback")),
        ]
    );
}

#[test]
fn a_welded_relay_is_not_said_to_be_released() {
    let mut world = oven("");
    let begun = world.pulse("li", ("oven", 1), pulse(1_000));
    world.pass(ms(500));
    assert!(begun.now().is_ok());
    world.weld("oven", bit(1));
    world.pass(ms(30_000));
    assert!(!world.disk.is_empty(), "it is promised still");
    world.weld("oven", 0);
    world.pass(ms(70_000));
    assert_eq!(world.relays("oven"), 0);
    assert!(world.disk.is_empty());
}

#[test]
fn a_lease_lasts_as_long_as_that_is_said_again() {
    let mut world = oven("");
    for _ in 0..20 {
        let held = world.lease("li", ("oven", 1), (true, ms(1_000)));
        world.pass(ms(600));
        assert!(held.now().unwrap().left > std::time::Duration::from_millis(500));
        assert_eq!(world.relays("oven"), bit(1));
    }
    assert_eq!(world.acted.len(), 1, "it is switched once");
    world.pass(ms(1_000));
    assert_eq!(world.relays("oven"), 0);
    let lost = world.order(|core| async move { core.end_lease(&who_is("li"), "oven", k(1)).await });
    assert_eq!(lost.now(), Err(CommandError::NoLease(k(1))));
}

#[test]
fn an_output_that_was_on_for_long_enough_goes_off() {
    let mut world = oven("k1.max_on = \"10s\"\n");
    let on = world.write("li", ("oven", 1), true);
    world.pass(ms(9_500));
    assert!(on.now().is_ok());
    assert_eq!(world.relays("oven"), bit(1));
    // By hand it is the same.
    world.pass(ms(1_000));
    assert_eq!(world.relays("oven"), 0);
    world.move_by_hand("oven", bit(1));
    world.pass(ms(11_000));
    assert_eq!(world.relays("oven"), 0);
    assert_eq!(world.audit()[1].0, "k1=off after 10000ms");
}

/// A pump runs, and nothing is known of it for a moment.
#[test]
fn a_command_that_was_never_sent_leaves_the_longest_time_as_it_runs() {
    let mut world = oven("k1.max_on = \"1h\"\nk2.max_on = \"1h\"\n");
    let on = world.write("li", ("oven", 1), true);
    world.pass(ms(600_000));
    assert!(on.now().is_ok());
    let down = LineEvent::State(railbus_host::LineState::Closed);
    let now = world.time();
    let core = world.core.as_mut().unwrap();
    core.handle(now, Input::Line(LineId(0), "main", &down));
    for line in core.state(now).lines.values_mut() {
        line.id = None;
    }
    let left = |world: &mut World, number| world.state().left("oven", k(number)).max_on;
    let before = left(&mut world, 1);
    assert!(before.is_some());
    let both = [(k(1), true), (k(2), true)];
    let refused = world.order(move |core| async move {
        let (who, terms) = (who_is("li"), WriteTerms::default());
        core.write(&who, "oven", &both, terms).await
    });
    let asked = world.now;
    while refused.get().is_none() && world.step(asked + ms(1_000)) {}
    assert_eq!(refused.now(), Err(CommandError::Line(Fault::Closed)));
    let passed = std::time::Duration::from_micros((world.now - asked).0);
    assert_eq!(left(&mut world, 1), before.map(|before| before - passed));
    assert_eq!(left(&mut world, 2), None, "it was never switched on");
}

#[test]
fn outputs_that_exclude_each_other_are_never_on_together() {
    let points = "k1.interlock = [\"oven.k2\"]\nk2.interlock = [\"oven.k1\"]\n";
    for after in 0..120 {
        let mut world = oven(points);
        let first = world.write("li", ("oven", 1), true);
        world.pass(Micros(after * 1_000));
        let second = world.write("wang", ("oven", 2), true);
        world.pass(ms(1_000));
        // Whose entry was durable first.
        let (refused, on) = match first.now() {
            Ok(_) => (second.now(), bit(1)),
            refused => (refused, bit(2)),
        };
        assert!(
            matches!(refused, Err(CommandError::Interlock { .. })),
            "{refused:?}"
        );
        assert_eq!(world.relays("oven"), on);
    }
}

/// The reply to the `off` gets lost: what was read before it says nothing any more.
#[test]
fn an_output_that_may_have_gone_off_must_stay_off() {
    let mut world = oven("k1.min_off = \"5s\"\n");
    world.pass(ms(6_000));
    let on = world.write("li", ("oven", 1), true);
    // The next poll comes after all of this.
    world.pass(ms(210));
    assert!(on.now().is_ok());
    world.faults.reply_lost = 1;
    let off = world.write("li", ("oven", 1), false);
    let asked = world.now;
    while off.get().is_none() && world.step(asked + ms(400)) {}
    world.faults = Faults::default();
    assert!(matches!(
        off.now(),
        Err(CommandError::Line(Fault::NoReply(_)))
    ));
    let soon = world.write("wang", ("oven", 1), true);
    world.pass(ms(100));
    assert!(
        matches!(soon.now(), Err(CommandError::MinOff { .. })),
        "{:?}",
        soon.now()
    );
    assert_eq!(world.relays("oven"), 0);
}

/// The `on` before the `off` was never seen: no reading was news.
#[test]
fn an_output_that_was_on_unseen_must_stay_off_after_a_restart() {
    let mut world = oven("k1.min_off = \"5s\"\n");
    world.pass(ms(6_000));
    world.faults.reply_lost = 1;
    let on = world.write("li", ("oven", 1), true);
    let asked = world.now;
    while on.get().is_none() && world.step(asked + ms(200)) {}
    world.faults = Faults::default();
    let off = world.write("li", ("oven", 1), false);
    world.pass(ms(100));
    assert!(on.now().is_err() && off.now().is_ok());
    world.kill();
    world.start();
    let soon = world.write("li", ("oven", 1), true);
    world.pass(ms(500));
    assert!(matches!(soon.now(), Err(CommandError::MinOff { .. })));
    assert_eq!(world.acted.len(), 2);
}

#[test]
fn what_an_output_must_stay_off_outlives_the_process() {
    let mut world = oven("k1.min_off = \"1m\"\n");
    world.pass(ms(61_000));
    assert!(world.write("li", ("oven", 1), true).get().is_none());
    world.pass(ms(500));
    let off = world.write("li", ("oven", 1), false);
    world.pass(ms(20_000));
    assert!(off.now().is_ok());
    world.kill();
    world.start();
    world.pass(ms(1_000));
    let soon = world.write("li", ("oven", 1), true);
    world.pass(ms(500));
    assert!(matches!(soon.now(), Err(CommandError::MinOff { .. })));
    world.pass(ms(60_000));
    let later = world.write("li", ("oven", 1), true);
    world.pass(ms(500));
    assert!(later.now().is_ok());
}

#[test]
fn a_site_that_ends_releases_what_is_held_and_begins_nothing_more() {
    let mut world = oven("k3.on_exit = \"on\"\n");
    let held = world.lease("li", ("oven", 1), (true, ms(60_000)));
    world.pass(ms(500));
    assert!(held.now().is_ok());
    let ended = world.close();
    let late = world.write("li", ("oven", 2), true);
    assert_eq!(late.now(), Err(CommandError::Line(Fault::Closed)));
    let set = [(at("oven", 2), true)];
    let batch = world.order(move |core| async move {
        core.batch(&who_is("li"), &set, BatchTerms::default()).await
    });
    assert_eq!(
        batch.now().parts[0].end,
        Err(CommandError::Line(Fault::Closed))
    );
    world.pass(ms(2_000));
    assert!(ended.get().is_some());
    assert_eq!(world.relays("oven"), bit(3));
}

#[test]
fn a_module_that_returns_gets_what_its_policy_says_before_later_commands() {
    let mut world = oven("k1.on_return = \"off\"\nk2.on_return = \"on\"\n");
    assert!(world.write("li", ("oven", 1), true).get().is_none());
    world.pass(ms(500));
    world.dead("oven", true);
    world.pass(ms(2_000));
    world.dead("oven", false);
    world.pass(ms(800));
    assert_eq!(world.relays("oven"), bit(2));
    let who: Vec<_> = world.log.iter().map(|entry| &*entry.who).collect();
    assert_eq!(who, ["li", "on_return", "on_return"]);
}

#[test]
fn all_or_nothing_leaves_everything_as_it_was() {
    let mut world = World::new(
        &format!("{TEXT}[module.kiln]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n"),
        1,
    );
    world.pass(ms(300));
    assert!(world.write("li", ("oven", 2), true).get().is_none());
    world.pass(ms(500));
    world.dead("kiln", true);
    let set = [
        (at("oven", 1), true),
        (at("oven", 2), false),
        (at("kiln", 1), true),
    ];
    let terms = BatchTerms {
        all_or_nothing: true,
        ..BatchTerms::default()
    };
    let done = world.order(move |core| async move { core.batch(&who_is("li"), &set, terms).await });
    world.pass(ms(5_000));
    let done = done.now();
    assert!(matches!(
        done.parts[2].end,
        Err(CommandError::Line(Fault::NoReply(_)))
    ));
    assert_eq!(done.parts[0].end, Err(CommandError::Undone));
    assert_eq!(world.relays("oven"), bit(2));
}

/// Everything that grows has a bound.
#[test]
fn who_does_not_wait_for_the_end_of_the_site_any_more_is_forgotten() {
    let scene =
        "[scene.evening]\nsteps = [{ wait = \"10ms\" }, { set = \"oven.k1\", to = false }]\n";
    let mut world = World::new(&format!("{TEXT}{scene}"), 1);
    world.pass(ms(300));
    for _ in 0..100 {
        let played = world.order(|core| async move {
            let (who, terms) = (who_is("li"), BatchTerms::default());
            core.play(&who, "evening", terms).await
        });
        world.pass(ms(500));
        assert!(played.now().is_ok());
    }
    assert!(world.state().schedule.nobody_waits());
}

/// The line is busy for longer than a command may wait.
#[test]
fn a_command_that_has_expired_is_not_sent() {
    let mut world = oven("");
    world.hold_line(ms(6_000));
    let late = world.write("li", ("oven", 1), true);
    world.pass(ms(10_000));
    assert_eq!(late.now(), Err(CommandError::Line(Fault::Expired)));
    assert!(world.acted.is_empty());
}

/// A reading that began before a command and comes after its end says nothing of what it did.
#[test]
fn a_reading_from_before_a_command_does_not_say_that_an_output_is_off() {
    let mut world = oven("k1.interlock = [\"oven.k2\"]\nk2.interlock = [\"oven.k1\"]\n");
    world.pass(ms(210));
    let asked = world.now;
    world.faults.reply_lost = 1;
    let first = world.write("li", ("oven", 1), true);
    while first.get().is_none() && world.step(asked + ms(200)) {}
    world.faults = Faults::default();
    assert!(first.now().is_err());
    world.reads("oven", 0, asked);
    let second = world.write("wang", ("oven", 2), true);
    world.pass(ms(500));
    assert!(
        matches!(second.now(), Err(CommandError::Interlock { .. })),
        "{:?}",
        second.now()
    );
    assert_eq!(world.relays("oven"), bit(1));
}

/// What the configuration says may be another thing once the turn comes.
#[test]
fn what_may_be_commanded_is_asked_again_in_its_turn() {
    let mut world = oven("");
    let first = world.write("li", ("oven", 1), false);
    let write = world.write("li", ("oven", 1), true);
    let pulse = world.pulse("li", ("oven", 1), pulse(100));
    let text = format!("{TEXT}[module.oven.point]\nk1.confirm = true\n");
    let config = Config::parse(&text).unwrap();
    world
        .state()
        .reconfigure(Arc::new(config), |_| true, |_| false);
    world.pass(ms(1_000));
    assert!(first.get().is_some());
    let asked = CommandError::Confirm(k(1));
    assert_eq!(write.now(), Err(asked.clone()));
    assert_eq!(pulse.now(), Err(asked));
    assert_eq!(world.acted.len(), 1);
}

#[test]
fn what_a_line_tells_that_was_opened_anew_since_changes_nothing() {
    let mut world = oven("");
    let now = world.time();
    let closed = LineEvent::State(railbus_host::LineState::Closed);
    let core = world.core.as_mut().unwrap();
    core.handle(now, Input::Line(LineId(7), "main", &closed));
    let on = world.write("li", ("oven", 1), true);
    world.pass(ms(200));
    assert!(on.now().is_ok());
    let known = world.state().known(&at("oven", 1));
    assert_eq!(known, Some(true), "the line is open");
}

/// A pulse that may have begun gives way to an older one that surely did, and ends otherwise.
#[test]
fn the_older_of_two_pulses_has_the_say_where_the_newer_one_is_not_sure() {
    let mut world = oven("");
    let off = Pulse {
        off: true,
        ..pulse(10_000)
    };
    let older = world.pulse("li", ("oven", 1), off);
    world.pass(ms(300));
    assert!(older.now().is_ok());
    world.faults.reply_lost = 1;
    let newer = world.pulse("wang", ("oven", 1), pulse(1_000));
    world.pass(ms(200));
    world.faults = Faults::default();
    assert!(newer.now().is_err());
    world.pass(ms(15_000));
    assert_eq!(world.relays("oven"), bit(1), "where the older one ends");
}

/// Two that end alike: the first end is the end of both.
#[test]
fn what_was_released_is_not_released_once_more() {
    let mut world = oven("");
    let older = world.pulse("li", ("oven", 1), pulse(10_000));
    world.pass(ms(300));
    assert!(older.now().is_ok());
    world.faults.reply_lost = 1;
    let newer = world.pulse("wang", ("oven", 1), pulse(1_000));
    world.pass(ms(200));
    world.faults = Faults::default();
    assert!(newer.now().is_err());
    world.pass(ms(1_500));
    assert_eq!(world.relays("oven"), 0);
    world.move_by_hand("oven", bit(1));
    world.pass(ms(15_000));
    assert_eq!(world.relays("oven"), bit(1), "it is no pulse any more");
}

#[test]
fn pulses_at_a_module_that_does_not_answer_do_not_pile_up() {
    let mut world = oven("");
    world.dead("oven", true);
    for _ in 0..30 {
        let begun = world.pulse("li", ("oven", 1), pulse(600_000));
        world.pass(ms(300));
        assert!(begun.now().is_err());
    }
    let promised = world.state().schedule.len();
    assert!(promised <= 2, "{promised}");
}

/// Nothing is known of the other output any more: it is asked for, and then decided.
#[test]
fn a_module_is_asked_before_an_output_is_refused() {
    let mut world = oven("k1.interlock = [\"oven.k2\"]\n");
    world.polls = false;
    world.pass(ms(600_000));
    let on = world.write("li", ("oven", 1), true);
    world.pass(ms(500));
    assert!(on.now().is_ok());
}

#[test]
fn the_longest_time_counts_anew_after_an_output_was_off() {
    let mut world = oven("k1.max_on = \"10s\"\n");
    world.move_by_hand("oven", bit(1));
    world.pass(ms(6_000));
    world.move_by_hand("oven", 0);
    world.pass(ms(1_000));
    world.move_by_hand("oven", bit(1));
    world.pass(ms(8_000));
    assert_eq!(world.relays("oven"), bit(1));
    world.pass(ms(3_000));
    assert_eq!(world.relays("oven"), 0);
}

/// Nobody answers such a frame, and it may not have been heard.
#[test]
fn a_frame_that_nobody_answers_takes_nothing_over() {
    let mut world = oven("");
    let begun = world.pulse("li", ("oven", 1), pulse(2_000));
    world.pass(ms(300));
    assert!(begun.now().is_ok());
    let set = [(k(1), true)];
    let terms = WriteTerms {
        silent: true,
        verify: false,
        ..WriteTerms::default()
    };
    let sent = world
        .order(move |core| async move { core.write(&who_is("wang"), "oven", &set, terms).await });
    world.pass(ms(300));
    assert_eq!(
        sent.now().unwrap().confirmed,
        railbus_host::Confirmation::Sent
    );
    world.pass(ms(2_000));
    assert_eq!(world.relays("oven"), 0);
}

/// The reply to a release that nobody has seen is not believed.
#[test]
fn an_acknowledgement_alone_releases_nothing() {
    let mut world = oven("");
    let begun = world.pulse("li", ("oven", 1), pulse(1_000));
    world.pass(ms(300));
    assert!(begun.now().is_ok());
    (world.polls, world.only_acknowledged) = (false, true);
    world.weld("oven", bit(1));
    world.pass(ms(20_000));
    assert!(!world.disk.is_empty(), "it is promised still");
    world.only_acknowledged = false;
    world.weld("oven", 0);
    world.pass(ms(70_000));
    assert_eq!(world.relays("oven"), 0);
    assert!(world.disk.is_empty());
}

/// The `on` never came to the module: the longest time did not begin with it.
#[test]
fn a_longest_time_that_began_for_nothing_makes_the_next_one_no_shorter() {
    let mut world = oven("k1.max_on = \"10s\"\n");
    world.faults.request_lost = 1;
    let lost = world.write("li", ("oven", 1), true);
    world.pass(ms(300));
    world.faults = Faults::default();
    assert!(lost.now().is_err());
    world.pass(ms(7_000));
    let on = world.write("li", ("oven", 1), true);
    world.pass(ms(5_000));
    assert!(on.now().is_ok());
    assert_eq!(world.relays("oven"), bit(1));
    world.pass(ms(6_000));
    assert_eq!(world.relays("oven"), 0);
}

/// What is answered survives the process. The output is free before that, but whoever has it next
/// is answered later.
#[test]
fn an_answer_comes_behind_the_end_in_the_audit_log() {
    let mut world = oven("");
    world.end_takes = Some(ms(100));
    let first = world.write("li", ("oven", 1), true);
    let next = world.pulse("wang", ("oven", 1), pulse(20));
    let set: Vec<_> = [2, 3].map(|number| (at("oven", number), true)).into();
    let many = world.order(|core| async move {
        let who = who_is("zhao");
        core.batch(&who, &set, BatchTerms::default()).await
    });
    world.pass(ms(2_000));
    let told = [
        first.get().unwrap().0,
        next.get().unwrap().0,
        many.get().unwrap().0,
    ];
    for (name, told) in ["li", "wang", "zhao"].into_iter().zip(told) {
        let mut of = world.log.iter().filter(|entry| entry.who == name);
        let (written, _) = of.next().unwrap().ended.unwrap();
        assert!(told >= written, "{name}: {told:?} before {written:?}");
    }
    assert!(told[0] < told[1]);
    let pulse = world.pulse("li", ("oven", 4), pulse(10_000));
    world.pass(ms(500));
    assert!(pulse.now().is_ok());
    let closed = world.close();
    world.pass(ms(2_000));
    let last = world.log.iter().map(|entry| entry.ended.unwrap().0).max();
    assert!(closed.get().unwrap().0 >= last.unwrap());
}
