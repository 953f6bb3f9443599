//! Who comes when.

use super::super::turns::WAITING_MAX;
use super::super::*;
use super::world::{World, at, bit, k, ms, who_is};
use railbus_host::Fault;
use std::sync::Mutex;

const TEXT: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

/// Takes a turn for so long; says when it came.
fn take_for(
    world: &mut World,
    places: &[u8],
    is_end: bool,
    time: Micros,
) -> (Arc<Mutex<Option<Micros>>>, Micros) {
    let came = Arc::new(Mutex::new(None));
    let told = Arc::clone(&came);
    let places: Vec<Place> = places.iter().map(|number| at("oven", *number)).collect();
    world.order(move |core| async move {
        let turn = match is_end {
            true => core.turn_to_end(places).await,
            false => core.turn(places, core.now() + ms(5_000)).await.unwrap(),
        };
        *told.lock().unwrap() = Some(core.now());
        let until = core.now() + time;
        core.until(until, std::future::pending::<()>()).await;
        drop(turn);
    });
    (came, world.now)
}

fn take(world: &mut World, places: &[u8], is_end: bool) -> (Arc<Mutex<Option<Micros>>>, Micros) {
    take_for(world, places, is_end, ms(100))
}

#[test]
fn who_comes_first_goes_first_and_an_end_keeps_its_place() {
    let mut world = World::new(TEXT, 1);
    let each = [false, false, true, false, false];
    let came: Vec<_> = each.map(|is_end| take(&mut world, &[1], is_end).0).into();
    world.pass(ms(1_000));
    let came: Vec<u64> = came
        .iter()
        .map(|at| at.lock().unwrap().unwrap().0 / 1_000)
        .collect();
    assert_eq!(came, [0, 100, 200, 300, 400]);
}

#[test]
fn an_end_waits_for_nobody_who_waits_himself() {
    let mut world = World::new(TEXT, 1);
    let (busy, _) = take(&mut world, &[2], false);
    let (both, _) = take(&mut world, &[1, 2], false);
    // It has gone long before the others can come.
    let (end, _) = take_for(&mut world, &[1], true, ms(20));
    let (late, _) = take(&mut world, &[1], false);
    let at = |came: &Arc<Mutex<Option<Micros>>>| *came.lock().unwrap();
    assert_eq!(at(&busy), Some(ms(0)));
    assert_eq!(at(&end), Some(ms(0)), "nobody commands it");
    assert_eq!(at(&both), None);
    world.pass(ms(1_000));
    assert_eq!(at(&both), Some(ms(100)));
    assert_eq!(
        at(&late),
        Some(ms(200)),
        "it came after the one that waited"
    );
}

#[test]
fn so_many_may_wait_for_an_output() {
    let mut world = World::new(TEXT, 1);
    let hold = world.order(|core| async move {
        let turn = core.turn([at("oven", 1)], ms(10_000)).await.unwrap();
        core.until(ms(9_000), std::future::pending::<()>()).await;
        drop(turn);
    });
    let ask = |world: &mut World| {
        world.order(|core| async move {
            let until = core.now() + ms(500);
            core.turn([at("oven", 1)], until).await.err()
        })
    };
    let waiting: Vec<_> = (0..=WAITING_MAX).map(|_| ask(&mut world)).collect();
    world.pass(ms(600));
    let ends: Vec<_> = waiting.iter().map(|end| end.now().unwrap()).collect();
    let count = |fault| ends.iter().filter(|end| **end == fault).count();
    assert_eq!(count(Fault::Overloaded), 1);
    assert_eq!(count(Fault::Expired), WAITING_MAX);
    assert!(hold.get().is_none());
    world.pass(ms(9_000));
    let again = ask(&mut world);
    assert_eq!(
        again.now(),
        None,
        "who does not wait any more is in nobody's way"
    );
}

/// Another command, before this one, has made the output one that gives pulses by itself.
#[test]
fn who_keeps_the_time_of_a_pulse_is_decided_in_its_turn() {
    let text = "[line.main]\nport = \"/dev/ttyS9\"\n\
                [module.gate]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 1\n";
    let mut world = World::new(text, 1);
    world.pass(ms(10));
    let width = railbus_wire::PulseWidth::from_tenths(5).unwrap();
    let says = |world: &mut World, mask| {
        let seen = railbus_device::Observation::Pulse { mask, width };
        let state = world.state();
        let (read, time) = (railbus_wire::Instant(0), SystemTime::UNIX_EPOCH);
        state.site.saw("gate", &seen, read, time);
    };
    says(&mut world, 0);
    world.order(|core| async move {
        let turn = core.turn([at("gate", 1)], ms(10_000)).await.unwrap();
        core.until(ms(500), std::future::pending::<()>()).await;
        drop(turn);
    });
    let pulse = Pulse {
        width: Some(ms(500)),
        ..Pulse::default()
    };
    let given = world
        .order(move |core| async move { core.pulse(&who_is("li"), "gate", k(1), pulse).await });
    world.pass(ms(100));
    says(&mut world, 1);
    world.pass(ms(900));
    assert_eq!(given.now().unwrap().by, By::Device);
    assert_eq!(world.audit()[0].0, "pulse do0 500ms by device");
}

/// A procedure that panics ends alone: its turn is given back, and whoever drives the core goes on.
#[test]
fn a_procedure_that_panics_takes_nobody_with_it() {
    let mut world = World::new(TEXT, 1);
    world.pass(ms(300));
    let broken = world.order(|core| async move {
        let _turn = core.turn([at("oven", 1)], ms(10_000)).await.unwrap();
        core.until(core.now() + ms(50), std::future::pending::<()>())
            .await;
        panic!("breaks down");
    });
    let later = world.write("wang", ("oven", 1), true);
    world.pass(ms(1_000));
    assert!(broken.get().is_none());
    assert!(later.now().is_ok());
}

/// A batch of one module of which an interlock refuses one output is tried again output by output,
/// in the turn that it has: a command that came later is the later one. Found by seed 1212.
#[test]
fn a_batch_that_is_tried_in_parts_goes_before_later_commands() {
    for after in 0..150 {
        let text = format!("{TEXT}[module.oven.point]\nk2.interlock = [\"oven.k1\"]\n");
        let mut world = World::new(&text, 1);
        world.pass(ms(300));
        let excludes = world.write("li", ("oven", 1), true);
        world.pass(ms(500));
        assert!(excludes.now().is_ok());
        let set = [(at("oven", 2), true), (at("oven", 6), false)];
        let batch = world.order(move |core| async move {
            core.batch(&who_is("li"), &set, BatchTerms::default()).await
        });
        world.pass(ms(after));
        let is_later = batch.get().is_none();
        let later = world.write("wang", ("oven", 6), true);
        world.pass(ms(2_000));
        assert!(later.now().is_ok());
        let ends = batch.now().parts;
        assert!(matches!(
            ends[0].end,
            Err(crate::CommandError::Interlock { .. })
        ));
        assert!(ends[1].end.is_ok(), "{after} ms: {:?}", ends[1].end);
        assert_eq!(world.relays("oven"), bit(1) | bit(6), "{after} ms");
        assert!(after > 0 || is_later, "none came while the batch went on");
    }
}

/// An output that was refused when the batch came, and is not any more, has no turn.
#[test]
fn a_batch_in_two_steps_switches_only_what_it_has_the_turn_of() {
    let text = |locked: bool| {
        format!("{TEXT}[module.oven.point]\nk2.interlock = [\"oven.k1\"]\nk6.locked = {locked}\n")
    };
    let mut world = World::new(&text(true), 1);
    world.pass(ms(300));
    take_for(&mut world, &[2], false, ms(3_000));
    let set = [(1, false), (2, true), (6, true)].map(|(number, on)| (at("oven", number), on));
    let batch = world.order(move |core| async move {
        core.batch(&who_is("li"), &set, BatchTerms::default()).await
    });
    world.pass(ms(500));
    let reloaded = world.reload(&text(false), true);
    world.pass(ms(1_000));
    assert!(reloaded.get().is_some());
    let (came, _) = take_for(&mut world, &[6], false, ms(6_000));
    world.pass(ms(10_000));
    assert!(came.lock().unwrap().is_some());
    let ends = batch.now().parts;
    assert!(ends[0].end.is_ok() && ends[1].end.is_ok());
    assert_eq!(ends[2].end, Err(crate::CommandError::Locked(k(6))));
    assert_eq!(world.relays("oven"), bit(2));
}

/// An output that a batch names twice is its own until the second of its steps has ended.
#[test]
fn a_batch_in_two_steps_keeps_its_turn_to_the_end() {
    for after in 0..100 {
        let text = format!("{TEXT}[module.oven.point]\nk2.interlock = [\"oven.k1\"]\n");
        let mut world = World::new(&text, 1);
        world.pass(ms(300));
        let set = [(1, false), (2, true), (6, false), (6, true)];
        let set = set.map(|(number, on)| (at("oven", number), on));
        let batch = world.order(move |core| async move {
            core.batch(&who_is("li"), &set, BatchTerms::default()).await
        });
        world.pass(ms(after));
        let is_later = batch.get().is_none();
        let (came, asked) = take_for(&mut world, &[6], false, ms(1));
        world.pass(ms(2_000));
        let ended = batch.get().unwrap().0;
        let came = came.lock().unwrap().unwrap();
        // The answer comes when the end is in the log, a little behind the turn.
        let is_in_order = came + ms(5) >= ended || !is_later && asked >= ended;
        assert!(
            is_in_order,
            "{after} ms: {came:?} {ended:?} {:?}",
            batch.now().parts
        );
    }
}

/// A batch whose outputs exclude each other takes two steps, and has the turn of the second from
/// the beginning: a command that came later is the later one, and so is the end of its pulse.
#[test]
fn a_batch_in_two_steps_goes_before_later_commands() {
    for after in 0..150 {
        for is_pulse in [false, true] {
            let text = format!("{TEXT}[module.oven.point]\nk2.interlock = [\"oven.k1\"]\n");
            let mut world = World::new(&text, 1);
            world.pass(ms(300));
            let excludes = world.write("li", ("oven", 1), true);
            world.pass(ms(500));
            assert!(excludes.now().is_ok());
            let set = [(1, false), (2, true), (6, true)];
            let set = set.map(|(number, on)| (at("oven", number), on));
            let batch = world.order(move |core| async move {
                core.batch(&who_is("li"), &set, BatchTerms::default()).await
            });
            world.pass(ms(after));
            if is_pulse {
                let pulse = Pulse {
                    width: Some(ms(1_000)),
                    ..Pulse::default()
                };
                let later = world.pulse("wang", ("oven", 6), pulse);
                world.pass(ms(10_000));
                assert!(later.now().is_ok());
            } else {
                let later = world.write("wang", ("oven", 6), false);
                world.pass(ms(2_000));
                assert!(later.now().is_ok());
            }
            assert!(batch.now().parts.iter().all(|part| part.end.is_ok()));
            assert_eq!(world.relays("oven"), bit(2), "{after} ms, {is_pulse}");
        }
    }
}
