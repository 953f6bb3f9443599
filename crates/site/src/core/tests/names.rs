//! What takes more than one command, while a reload gives the names that it uses to other boards.

use super::super::*;
use super::world::{End, World, at, bit, ms, who_is};
use crate::CommandError;
use railbus_host::Fault;

const PORT: &str = "/dev/ttyS9";

/// The oven and the kiln at these addresses, and more.
fn site_of(oven: u8, kiln: u8, more: &str) -> String {
    format!(
        "[line.main]\nport = \"{PORT}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = {oven}\n\
         [module.kiln]\nline = \"main\"\nmodel = \"erc8\"\naddress = {kiln}\n{more}"
    )
}

/// What the board has done that has the name of the oven after the reload.
fn done_by_other(world: &World) -> usize {
    let done = world.acted.iter().filter(|acted| acted.seat.1 == 4);
    done.count()
}

/// Gives the name of the oven to the board at address 4.
fn swap(world: &mut World, more: &str) {
    let reloaded = world.reload(&site_of(4, 6, more), true);
    world.pass(ms(2_000));
    assert!(reloaded.now().is_some());
}

fn closed() -> CommandError {
    CommandError::Line(Fault::Closed)
}

fn batch(world: &mut World, set: &[(Place, bool)], all_or_nothing: bool) -> End<BatchDone> {
    let set = set.to_vec();
    let terms = BatchTerms {
        all_or_nothing,
        ..BatchTerms::default()
    };
    world.order(move |core| async move { core.batch(&who_is("li"), &set, terms).await })
}

/// It asks a module of which nothing is known, before its turn.
#[test]
fn a_batch_is_for_the_boards_that_it_was_asked_of() {
    for after in (0..150).step_by(5) {
        let mut world = World::new(&site_of(3, 6, ""), 1);
        world.pass(ms(300));
        world.dead("kiln", true);
        world.pass(ms(300));
        let set = [(at("oven", 1), true), (at("kiln", 1), true)];
        let end = batch(&mut world, &set, true);
        world.pass(ms(after));
        swap(&mut world, "");
        world.pass(ms(10_000));
        assert_eq!(done_by_other(&world), 0, "{after} ms: {:?}", world.acted);
        assert!(end.get().is_some());
        assert_eq!(
            world.relays_at(PORT, 3),
            0,
            "{after} ms: nothing stays done"
        );
        assert!(world.state().is_at_rest());
    }
}

/// The members of a group are those of the configuration in which it is toggled.
#[test]
fn a_group_is_toggled_at_the_boards_that_it_had() {
    let group = "[group.all]\nmembers = [\"oven.k1\", \"kiln.k1\"]\n";
    for after in (0..150).step_by(5) {
        let mut world = World::new(&site_of(3, 6, group), 1);
        world.pass(ms(300));
        world.dead("kiln", true);
        world.pass(ms(300));
        let end = world.order(|core| async move {
            let (who, to) = (who_is("li"), GroupState::Toggle);
            core.set_group(&who, "all", to, BatchTerms::default()).await
        });
        world.pass(ms(after));
        swap(&mut world, group);
        world.pass(ms(10_000));
        assert_eq!(done_by_other(&world), 0, "{after} ms: {:?}", world.acted);
        assert!(end.get().is_some());
        assert!(world.state().is_at_rest());
    }
}

/// What excludes each other is switched in two commands.
#[test]
fn the_second_command_of_a_batch_is_for_the_board_of_the_first() {
    let excluded = "[module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = 9\n\
                    [module.oven.point]\nk1.interlock = [\"pump.k1\"]\n";
    for after in (0..100).step_by(2) {
        let mut world = World::new(&site_of(3, 6, excluded), 1);
        world.move_by_hand("pump", bit(1));
        world.pass(ms(300));
        let set = [(at("pump", 1), false), (at("oven", 1), true)];
        let end = batch(&mut world, &set, false);
        world.pass(ms(after));
        swap(&mut world, excluded);
        world.pass(ms(10_000));
        assert_eq!(done_by_other(&world), 0, "{after} ms: {:?}", world.acted);
        let ends: Vec<_> = end.now().parts.into_iter().map(|part| part.end).collect();
        assert!(ends[0].is_ok(), "{after} ms: {ends:?}");
        let obeyed = world.relays_at(PORT, 3) & bit(1) != 0;
        assert_eq!(ends[1].is_ok(), obeyed, "{after} ms: {ends:?}");
        assert!(obeyed || ends[1] == Err(closed()), "{after} ms: {ends:?}");
    }
}

#[test]
fn a_scene_goes_on_at_the_boards_with_which_it_began() {
    let scene = "[scene.bake]\nsteps = [{ set = \"kiln.k2\", to = true }, { wait = \"5s\" }, \
                 { set = \"oven.k1\", to = true }]\n";
    let mut world = World::new(&site_of(3, 6, scene), 1);
    world.pass(ms(300));
    let play = |world: &mut World| {
        world.order(|core| async move {
            let terms = BatchTerms::default();
            core.play(&who_is("li"), "bake", terms).await.unwrap()
        })
    };
    let played = play(&mut world);
    world.pass(ms(1_000));
    swap(&mut world, scene);
    world.pass(ms(10_000));
    assert_eq!(done_by_other(&world), 0, "{:?}", world.acted);
    let last = played.now().parts.pop().unwrap();
    assert_eq!(last.end, Err(closed()));
    // The next one is for those that have the names now.
    let played = play(&mut world);
    world.pass(ms(10_000));
    assert!(played.now().parts.iter().all(|part| part.end.is_ok()));
    assert_eq!(world.relays_at(PORT, 4), bit(1));
}

/// A module answers again while a reload holds its outputs: what that asks for is not done to the
/// board that has its name afterwards.
#[test]
fn the_return_of_a_board_switches_no_other() {
    let policy = "[module.oven.point]\nk1.on_return = \"on\"\nk2.on_return = \"off\"\n";
    for after in (0..600).step_by(20) {
        let mut world = World::new(&site_of(3, 6, policy), 1);
        world.pass(ms(300));
        world.dead("oven", true);
        world.pass(ms(300));
        world.disk_takes = Some(ms(300));
        let reloaded = world.reload(&site_of(4, 6, policy), true);
        world.pass(ms(after));
        if reloaded.get().is_none() {
            world.dead("oven", false);
        }
        world.pass(ms(10_000));
        assert_eq!(done_by_other(&world), 0, "{after} ms: {:?}", world.acted);
        assert!(world.state().is_at_rest());
    }
}

/// A caller that wanted the line for itself is gone before it has it, and a reload is next: no
/// other program can have moved the module, so its end is not for the board with its name.
#[test]
fn what_is_promised_of_a_line_that_was_never_lent_meets_no_other_board() {
    let mut were_closing = 0;
    for after in 0..300 {
        let mut world = World::new(&site_of(3, 6, ""), 1);
        world.pass(ms(300));
        let pulse = Pulse {
            width: Some(ms(60_000)),
            ..Pulse::default()
        };
        world.pulse("li", ("oven", 1), pulse);
        world.pass(ms(300));
        world.dead("oven", true);
        let now = world.time();
        let core = world.core.as_mut().unwrap();
        let lend = |core: Context| async move { core.lend_line("main").await };
        let task = core.start(now, lend, |_| {});
        world.pass(ms(after));
        let line = &world.state().lines["main"];
        if line.id.is_none() {
            break;
        }
        were_closing += usize::from(line.open().is_none());
        let reloaded = world.reload(&site_of(4, 6, ""), true);
        let now = world.time();
        world.core.as_mut().unwrap().cancel(now, task);
        world.pass(ms(100_000));
        assert!(reloaded.now().is_some());
        assert_eq!(done_by_other(&world), 0, "{after} ms: {:?}", world.acted);
        let codes: Vec<_> = world.events.iter().map(|e| e.code.as_deref()).collect();
        assert_eq!(codes, [Some("end_dropped")], "{after} ms");
        assert!(world.disk.is_empty(), "{after} ms: {:?}", world.disk);
    }
    assert!(were_closing > 0);
}

/// Its speed, or the pause before a request, is changed: it is the same board, whose longest time
/// does not begin anew and whose lease goes on.
#[test]
fn a_board_that_is_spoken_to_otherwise_keeps_what_is_promised_of_it() {
    let limit = "[module.oven.point]\nk1.max_on = \"20s\"\n";
    let before = site_of(3, 6, limit);
    let slower = before.replacen("address = 3\n", "address = 3\ngap = \"30ms\"\n", 1);
    let faster = before.replacen("\"\n", "\"\nbaud = 19200\n", 1);
    for after in [slower, faster] {
        assert_ne!(after, before);
        let mut world = World::new(&before, 1);
        world.pass(ms(300));
        world.write("li", ("oven", 1), true);
        world.lease("li", ("oven", 2), (true, ms(60_000)));
        world.pass(ms(15_000));
        let reloaded = world.reload(&after, true);
        world.pass(ms(4_000));
        let kept = reloaded.now().unwrap().modules_kept;
        assert!(
            !kept.contains(&"oven".to_owned()),
            "it begins anew on its line"
        );
        assert_eq!(world.relays_at(PORT, 3), bit(1) | bit(2));
        world.pass(ms(2_000));
        assert_eq!(world.relays_at(PORT, 3), bit(2), "20 s are over");
        world.pass(ms(60_000));
        assert_eq!(world.relays_at(PORT, 3), 0);
    }
}
