//! Pulses that modules time by themselves: the output still changes without a command, whatever
//! becomes of the process, of its disk and of the names.

use super::super::*;
use super::world::{End, Faults, World, at, bit, ms, who_is};
use crate::CommandError;
use railbus_host::Fault;

const OVEN: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
const GATE: &str = "[module.gate]\nline = \"main\"\nmodel = \"r55\"\naddress = 4\n";

fn site(text: &str) -> World {
    let mut world = World::new(text, 1);
    world.pass(ms(300));
    world
}

fn pulse(width: u64) -> Pulse {
    Pulse {
        width: Some(ms(width)),
        ..Pulse::default()
    }
}

/// A batch ends a pulse that the module times by itself, and is undone: nothing would release the
/// output, so it goes where the pulse would have left it.
#[test]
fn an_undone_batch_leaves_no_pulse_of_a_module_without_an_end() {
    for off in [false, true] {
        let mut world = site(&format!("{OVEN}{GATE}"));
        world.move_by_hand("gate", if off { bit(1) } else { 0 });
        world.pass(ms(500));
        let asks = Pulse {
            off,
            ..pulse(5_000)
        };
        let begun = world.pulse("li", ("gate", 1), asks);
        world.pass(ms(500));
        assert_eq!(begun.now().unwrap().by, By::Device);
        world.dead("oven", true);
        let set = [(at("gate", 1), !off), (at("oven", 1), true)];
        let terms = BatchTerms {
            all_or_nothing: true,
            ..BatchTerms::default()
        };
        let done =
            world.order(move |core| async move { core.batch(&who_is("li"), &set, terms).await });
        world.pass(ms(10_000));
        let done = done.now();
        assert_eq!(done.parts[0].end, Err(CommandError::NotUndone));
        assert!(!done.undone);
        assert_eq!(world.relays("gate"), if off { bit(1) } else { 0 });
    }
}

/// The same where the pulse ends by itself between the reading and the first command: what was read
/// is over. Found by seed 6715.
#[test]
fn an_undone_batch_does_not_bring_back_a_pulse_that_ended_meanwhile() {
    for after in (700..1_200).step_by(7) {
        let mut world = site(&format!("{OVEN}{GATE}"));
        world.pass(ms(500));
        let begun = world.pulse("li", ("gate", 1), pulse(1_000));
        world.pass(ms(after));
        assert_eq!(begun.now().unwrap().by, By::Device);
        world.dead("oven", true);
        let set = [(at("gate", 1), true), (at("oven", 1), true)];
        let terms = BatchTerms {
            all_or_nothing: true,
            ..BatchTerms::default()
        };
        let done =
            world.order(move |core| async move { core.batch(&who_is("li"), &set, terms).await });
        world.pass(ms(10_000));
        assert_eq!(world.relays("gate"), 0, "{after} ms");
        let end = done.now().parts[0].end.clone();
        // A pulse that ended before the first command was not cut short.
        let is_over = after >= 1_000;
        assert!(!is_over || end == Err(CommandError::Undone), "{after} ms");
        assert!(matches!(
            end,
            Err(CommandError::Undone | CommandError::NotUndone)
        ));
    }
}

/// A later command that was not read back has ended the pulse as well, or perhaps has: what the
/// output was before the batch is what was read of it, or is not known.
#[test]
fn an_undone_batch_does_not_bring_back_the_end_of_a_pulse_that_was_taken_over() {
    for is_acknowledged in [true, false] {
        for after in (0..1_500).step_by(10) {
            let mut world = site(&format!("{OVEN}{GATE}"));
            world.pass(ms(500));
            let begun = world.pulse("li", ("gate", 1), pulse(1_000));
            world.pass(ms(200));
            assert_eq!(begun.now().unwrap().by, By::Device);
            if is_acknowledged {
                world.only_acknowledged = true;
            } else {
                world.faults.reply_lost = 1;
            }
            let on = world.write("wang", ("gate", 1), true);
            world.pass(ms(200));
            world.only_acknowledged = false;
            world.faults = Faults::default();
            assert!(on.now().is_ok() || !is_acknowledged);
            world.pass(ms(after));
            let before = world.relays("gate");
            world.dead("oven", true);
            let set = [(at("gate", 1), true), (at("oven", 1), true)];
            let terms = BatchTerms {
                all_or_nothing: true,
                ..BatchTerms::default()
            };
            let done = world
                .order(move |core| async move { core.batch(&who_is("li"), &set, terms).await });
            world.pass(ms(10_000));
            let end = done.now().parts[0].end.clone();
            let is_as_before = world.relays("gate") == before;
            assert!(
                end != Err(CommandError::Undone) || is_as_before,
                "{after} ms"
            );
            assert!(
                !is_acknowledged || end == Err(CommandError::Undone),
                "{after} ms"
            );
        }
    }
}

/// All or nothing with the oven, which is dead.
fn fails_with(world: &mut World, module: &str, on: bool) -> End<BatchDone> {
    world.dead("oven", true);
    let set = [(at(module, 1), on), (at("oven", 1), true)];
    let terms = BatchTerms {
        all_or_nothing: true,
        ..BatchTerms::default()
    };
    world.order(move |core| async move { core.batch(&who_is("li"), &set, terms).await })
}

/// A process that was killed at any moment of a pulse knows of it when it starts again: a batch
/// that was undone did not bring the pulse back. Found by seed 7919.
#[test]
fn an_undone_batch_does_not_bring_back_a_pulse_from_before_a_restart() {
    let (mut ran, mut over) = (0, 0);
    // The disk has the latest time at which the pulse may have begun.
    let moments = (0..1_500).step_by(10).chain((2_000..15_000).step_by(500));
    for after in moments {
        let mut world = site(&format!("{OVEN}{GATE}"));
        world.pass(ms(500));
        world.pulse("li", ("gate", 1), pulse(1_000));
        world.pass(ms(after));
        world.kill();
        world.start();
        world.pass(ms(200));
        let before = world.relays("gate");
        let done = fails_with(&mut world, "gate", false);
        world.pass(ms(10_000));
        let end = done.now().parts[0].end.clone();
        match end {
            Err(CommandError::NotUndone) => ran += 1,
            Err(CommandError::Undone) => {
                assert_eq!(world.relays("gate"), before, "{after} ms");
                assert_eq!(before, 0, "{after} ms: nothing would release it");
                over += 1;
            }
            other => panic!("{after} ms: {other:?}"),
        }
    }
    assert!(ran > 50 && over > 10, "{ran}, {over}");
}

/// A command after it is the end of a pulse, and the disk forgets the pulse with it.
#[test]
fn a_pulse_that_was_ended_is_not_known_after_a_restart() {
    let mut world = site(&format!("{OVEN}{GATE}"));
    world.pass(ms(500));
    world.pulse("li", ("gate", 1), pulse(3_600_000));
    world.pass(ms(500));
    assert_eq!(world.disk.len(), 1);
    let on = world.write("wang", ("gate", 1), true);
    world.pass(ms(500));
    assert!(on.now().is_ok());
    assert_eq!(world.disk, []);
    world.kill();
    world.start();
    world.pass(ms(1_000));
    let done = fails_with(&mut world, "gate", false);
    world.pass(ms(10_000));
    assert_eq!(done.now().parts[0].end, Err(CommandError::Undone));
    assert_eq!(world.relays("gate"), bit(1));
}

/// The module would go on with what the next start does not know of.
#[test]
fn a_pulse_that_can_not_be_written_down_does_not_begin() {
    let mut world = site(&format!("{OVEN}{GATE}"));
    world.pass(ms(500));
    world.faults.disk = 1;
    let refused = world.pulse("li", ("gate", 1), pulse(1_000));
    world.pass(ms(500));
    let why = CommandError::NotKept(ErrorKind::StorageFull);
    assert_eq!(refused.now(), Err(why));
    world.faults = Faults::default();
    world.disk_takes = Some(ms(60_000));
    let late = world.pulse("li", ("gate", 1), pulse(1_000));
    world.pass(ms(30_000));
    assert_eq!(late.now(), Err(CommandError::Line(Fault::Expired)));
    assert!(world.acted.is_empty());
    world.disk_takes = None;
    world.pass(ms(60_000));
    // What did not begin keeps nobody from anything.
    let done = fails_with(&mut world, "gate", true);
    world.pass(ms(10_000));
    assert_eq!(done.now().parts[0].end, Err(CommandError::Undone));
}

/// A board lets go of a relay for a minute and pulls it in again by itself, however it is read
/// until then, and whoever starts or has its name.
#[test]
fn an_output_that_comes_on_by_itself_is_excluded_until_then() {
    let excludes = |gate: &str, address: u8, line: &str| {
        format!(
            "[line.{line}]\nport = \"/dev/ttyS9\"\n\
             [module.oven]\nline = \"{line}\"\nmodel = \"erc8\"\naddress = 3\n\
             [module.{gate}]\nline = \"{line}\"\nmodel = \"r55\"\naddress = {address}\n\
             [module.oven.point]\nk1.interlock = [\"{gate}.k1\"]\n"
        )
    };
    let restart = |world: &mut World| {
        world.kill();
        world.start();
    };
    let reload = |world: &mut World, text: &str| {
        let done = world.reload(text, true);
        world.pass(ms(2_000));
        assert!(done.now().is_some());
    };
    for way in 0..6 {
        let mut world = site(&excludes("gate", 4, "main"));
        world.move_by_hand("gate", bit(1));
        world.pass(ms(500));
        let asks = Pulse {
            off: true,
            ..pulse(60_000)
        };
        let begun = world.pulse("li", ("gate", 1), asks);
        world.pass(ms(1_000));
        assert!(begun.now().is_ok());
        match way {
            0 => {}
            1 => restart(&mut world),
            // The board has another name, its line has one.
            2 => reload(&mut world, &excludes("door", 4, "main")),
            3 => reload(&mut world, &excludes("gate", 4, "cellar")),
            4 => {
                world.become_other(&excludes("gate", 4, "cellar"));
                restart(&mut world);
            }
            _ => {
                world.become_other(&excludes("door", 4, "main"));
                restart(&mut world);
            }
        }
        world.pass(ms(2_000));
        assert_eq!(world.relays_at("/dev/ttyS9", 4), 0, "{way}");
        let early = world.write("wang", ("oven", 1), true);
        world.pass(ms(500));
        assert!(
            matches!(early.now(), Err(CommandError::Interlock { .. })),
            "{way}: {:?}",
            early.now()
        );
        // Once it is on it is excluded because of that.
        world.pass(ms(60_000));
        assert_eq!(world.relays_at("/dev/ttyS9", 4), bit(1), "{way}");
        let late = world.write("wang", ("oven", 1), true);
        world.pass(ms(500));
        assert!(matches!(late.now(), Err(CommandError::Interlock { .. })));
        let name = if matches!(way, 2 | 5) { "door" } else { "gate" };
        world.move_by_hand(name, 0);
        world.pass(ms(1_000));
        let free = world.write("wang", ("oven", 1), true);
        world.pass(ms(500));
        assert!(free.now().is_ok(), "{way}: {:?}", free.now());
    }
}
