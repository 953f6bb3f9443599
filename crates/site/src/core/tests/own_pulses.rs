//! Pulses that modules time by themselves: the output still changes without a command, whatever
//! becomes of the process, of its disk and of the names.

use super::super::*;
use super::world::{End, Faults, World, at, bit, ms, pulse, who_is};
use crate::CommandError;
use railbus_host::Fault;
use std::time::Duration;

const OVEN: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
const GATE: &str = "[module.gate]\nline = \"main\"\nmodel = \"r55\"\naddress = 4\n";

fn site(text: &str) -> World {
    let mut world = World::new(text, 1);
    world.pass(ms(300));
    world
}

fn all_or_nothing(world: &mut World, set: &[(Place, bool)]) -> End<BatchDone> {
    let set = set.to_vec();
    let terms = BatchTerms {
        all_or_nothing: true,
        ..BatchTerms::default()
    };
    world.order(move |core| async move { core.batch(&who_is("li"), &set, terms).await })
}

/// The same of an output and one of the oven, which is dead.
fn fails_with(world: &mut World, module: &str, on: bool) -> End<BatchDone> {
    world.dead("oven", true);
    all_or_nothing(world, &[(at(module, 1), on), (at("oven", 1), true)])
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
        let done = fails_with(&mut world, "gate", !off);
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
        let done = fails_with(&mut world, "gate", true);
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
            let done = fails_with(&mut world, "gate", true);
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

/// The oven is excluded by the gate.
fn excludes(gate: &str, address: u8, line: &str) -> String {
    let own = format!("[module.{gate}]\nline = \"{line}\"\nmodel = \"r55\"\n");
    let excluded = format!("[module.oven.point]\nk1.interlock = [\"{gate}.k1\"]\n");
    format!("{}{own}address = {address}\n{excluded}", without_gate(line))
}

fn without_gate(line: &str) -> String {
    OVEN.replace("main", line)
}

/// The gate and the door at these addresses.
fn two_boards(gate: u8, door: u8) -> String {
    let board = |name, address| {
        format!("[module.{name}]\nline = \"main\"\nmodel = \"r55\"\naddress = {address}\n")
    };
    format!("{OVEN}{}{}", board("gate", gate), board("door", door))
}

fn reload(world: &mut World, text: &str) {
    let done = world.reload(text, true);
    world.pass(ms(2_000));
    assert!(done.now().is_some());
}

/// The gate releases its output, and switches it on again after so many milliseconds.
fn lets_go(world: &mut World, width: u64) {
    world.move_by_hand("gate", bit(1));
    world.pass(ms(500));
    let asks = Pulse {
        off: true,
        ..pulse(width)
    };
    let begun = world.pulse("li", ("gate", 1), asks);
    world.pass(ms(1_000));
    assert!(begun.now().is_ok());
}

fn assert_oven_is_excluded(world: &mut World, why: &str) {
    world.pass(ms(2_000));
    assert_eq!(world.relays_at("/dev/ttyS9", 4), 0, "{why}");
    let early = world.write("wang", ("oven", 1), true);
    world.pass(ms(500));
    let early = early.now();
    let is_refused = matches!(early, Err(CommandError::Interlock { .. }));
    world.pass(ms(70_000));
    let both = [4, 3].map(|address| world.relays_at("/dev/ttyS9", address) & bit(1));
    assert!(is_refused, "{why}: {early:?}, then {both:?} are on");
    assert_eq!(both, [bit(1), 0], "{why}");
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
    // A pulse that did not begin changes no later result.
    let done = fails_with(&mut world, "gate", true);
    world.pass(ms(10_000));
    assert_eq!(done.now().parts[0].end, Err(CommandError::Undone));
}

/// A board releases a relay for a minute and switches it on again by itself. Until then the relay
/// counts as on, over restarts and new names too.
#[test]
fn an_output_that_comes_on_by_itself_is_excluded_until_then() {
    let restart = |world: &mut World| {
        world.kill();
        world.start();
    };
    for way in 0..6 {
        let mut world = site(&excludes("gate", 4, "main"));
        lets_go(&mut world, 60_000);
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

/// However often names change until then, the pulse is of the same board, or of one that may be it.
#[test]
fn a_pulse_goes_on_whatever_names_its_board_has() {
    type Changes<'a> = &'a [&'a dyn Fn(&mut World)];
    let is = |gate: &'static str, line: &'static str| {
        move |world: &mut World| reload(world, &excludes(gate, 4, line))
    };
    let starts_as = |text: String| {
        move |world: &mut World| {
            world.become_other(&text);
            world.kill();
            world.start();
        }
    };
    let leaves = |world: &mut World| reload(world, &without_gate("main"));
    let writes = |world: &mut World| {
        let led = world.lease("li", ("oven", 2), (true, ms(1_000)));
        world.pass(ms(500));
        assert!(led.now().is_ok());
    };
    let moves = |world: &mut World| reload(world, &excludes("gate", 7, "main"));
    let (cellar, door) = (is("gate", "cellar"), is("door", "cellar"));
    let door_at_start = starts_as(excludes("door", 4, "cellar"));
    let gate_at_start = starts_as(excludes("gate", 4, "cellar"));
    let gate = is("gate", "main");
    let cases: [(&str, Changes<'_>); 7] = [
        ("two reloads", &[&cellar, &door]),
        ("and a start", &[&cellar, &door, &door_at_start]),
        ("one reload", &[&door]),
        ("one start", &[&door_at_start]),
        ("removed and added", &[&leaves, &cellar]),
        ("added by a start", &[&leaves, &writes, &gate_at_start]),
        ("moved and back", &[&moves, &gate]),
    ];
    for (why, changes) in cases {
        let mut world = site(&excludes("gate", 4, "main"));
        lets_go(&mut world, 60_000);
        for change in changes {
            change(&mut world);
        }
        assert_oven_is_excluded(&mut world, why);
    }
}

/// A module that one reload removes is added at another address by the next one, or by a start.
#[test]
fn a_pulse_is_known_where_a_removed_module_comes_back_at_another_address() {
    for is_restarted in [false, true] {
        let mut world = site(&excludes("gate", 4, "main"));
        lets_go(&mut world, 60_000);
        reload(&mut world, &without_gate("main"));
        let port = "/dev/ttyS9".to_owned();
        world.move_board(&(port.clone(), 4), &(port, 7));
        if is_restarted {
            world.become_other(&excludes("gate", 7, "main"));
            world.kill();
            world.start();
        } else {
            reload(&mut world, &excludes("gate", 7, "main"));
        }
        world.pass(ms(2_000));
        assert_eq!(world.relays("gate"), 0);
        let early = world.write("wang", ("oven", 1), true);
        world.pass(ms(500));
        assert!(
            matches!(early.now(), Err(CommandError::Interlock { .. })),
            "restarted: {is_restarted}"
        );
    }
}

/// What a reload finds out is on the disk with it.
#[test]
fn the_disk_knows_which_boards_may_have_a_pulse() {
    let mut world = site(&excludes("gate", 4, "main"));
    lets_go(&mut world, 3_600_000);
    reload(&mut world, &excludes("gate", 7, "main"));
    let boards = world.disk.iter().filter_map(|(.., board)| board.as_ref());
    let addresses: BTreeSet<u8> = boards.map(|board| board.address).collect();
    assert_eq!(addresses, BTreeSet::from([4, 7]));
}

/// A host without a clock of its own starts with an old time, and gets the right one then.
#[test]
fn a_pulse_goes_on_where_the_clock_is_set_forward() {
    let mut world = World::new(&excludes("gate", 4, "main"), 1);
    world.wall_behind = ms(7_200_000);
    world.now = ms(7_200_000);
    world.kill();
    world.start();
    world.pass(ms(300));
    lets_go(&mut world, 60_000);
    world.wall_behind = Micros::ZERO;
    world.pass(ms(5_000));
    world.kill();
    world.start();
    assert_oven_is_excluded(&mut world, "clock");
}

/// The interlock refuses it after it was written down, or the disk takes too long.
#[test]
fn a_pulse_that_was_never_sent_leaves_the_disk() {
    let mut world = site(&excludes("gate", 4, "main"));
    assert!(world.write("li", ("oven", 1), true).get().is_none());
    world.pass(ms(500));
    let refused = world.pulse("li", ("gate", 1), pulse(14_400_000));
    world.pass(ms(500));
    assert!(matches!(refused.now(), Err(CommandError::Interlock { .. })));
    assert_eq!(world.disk, []);
    let mut world = site(&excludes("gate", 4, "main"));
    world.disk_takes = Some(ms(7_000));
    let late = world.pulse("li", ("gate", 1), pulse(14_400_000));
    world.pass(ms(6_000));
    assert_eq!(late.now(), Err(CommandError::Line(Fault::Expired)));
    world.disk_takes = None;
    world.pass(ms(20_000));
    assert_eq!(world.disk, []);
}

/// An undone batch does not switch an output on that was off before it because another board had a
/// pulse.
#[test]
fn the_end_of_a_pulse_is_of_its_board_alone() {
    let mut world = site(&format!("{OVEN}{GATE}"));
    lets_go(&mut world, 3_600_000);
    // Another model is at its address.
    reload(
        &mut world,
        &format!("{OVEN}{}", GATE.replace("r55", "erc8")),
    );
    fails_with(&mut world, "gate", false);
    world.pass(ms(10_000));
    assert_eq!(world.relays("gate"), 0);

    // Two boards have got each other's address.
    let mut world = site(&two_boards(4, 5));
    lets_go(&mut world, 3_600_000);
    let port = "/dev/ttyS9".to_owned();
    world.move_board(&(port.clone(), 4), &(port, 5));
    reload(&mut world, &two_boards(5, 4));
    fails_with(&mut world, "door", false);
    world.pass(ms(10_000));
    assert_eq!(world.relays("door"), 0);
}

/// The command of the batch that ends the pulse is obeyed, and its reply lost.
#[test]
fn a_batch_is_not_undone_that_may_have_ended_a_pulse() {
    let mut world = site(&format!("{OVEN}{GATE}"));
    world.pass(ms(500));
    let begun = world.pulse("li", ("gate", 1), pulse(3_600_000));
    world.pass(ms(500));
    assert!(begun.now().is_ok());
    let set = [(at("gate", 1), true)];
    let done = all_or_nothing(&mut world, &set);
    let before = world.acted.len();
    world.faults.reply_lost = 1;
    let until = world.now + ms(5_000);
    while world.acted.len() == before {
        assert!(world.step(until));
    }
    world.faults = Faults::default();
    world.pass(ms(10_000));
    let done = done.now();
    assert!(done.parts[0].end.is_err());
    assert!(!done.undone, "{done:?}");
    assert_eq!(world.relays("gate"), 0);
}

/// The line is busy until the deadline of the command, and the process is killed on the way: the
/// disk has no end that comes before that of the pulse.
#[test]
fn a_pulse_that_began_at_the_last_moment_is_known() {
    let mut began = 0;
    for seed in 0..40 {
        let mut world = World::new(&format!("{OVEN}{GATE}"), seed);
        world.pass(ms(800));
        world.hold_line(ms(4_995));
        world.pulse("li", ("gate", 1), pulse(1_000));
        world.pass(ms(5_035));
        world.kill();
        if world.relays("gate") == 0 {
            continue;
        }
        began += 1;
        let ago = world.now - world.acted[0].at;
        let ends = world.time().wall + Duration::from_secs(1) - Duration::from_micros(ago.0);
        let known = world.disk.iter().map(|(_, promise, _)| promise.at);
        assert!(known.max() >= Some(ends), "seed {seed}");
    }
    assert!(began > 10, "{began}");
}

/// Two commands for one board under two names: the end of the first takes nothing of the second.
#[test]
fn a_pulse_stays_on_the_disk_while_another_one_of_its_board_fails() {
    let mut world = site(&two_boards(4, 5));
    let lent = world.lend("main");
    world.pass(ms(2_000));
    let loan = lent.now().unwrap().loan;
    world.disk_takes = Some(ms(50));
    world.audit_takes = Some(ms(1_500));
    world.pulse("li", ("gate", 1), pulse(3_600_000));
    world.pass(ms(60));
    world.give_back("main", loan, Some(&two_boards(5, 4)));
    world.pass(ms(600));
    world.pulse("li", ("door", 1), pulse(3_600_000));
    world.faults.reply_lost = 1;
    let (until, mut seen) = (world.now + ms(5_000), 0);
    while world.step(until) {
        if world.relays_at("/dev/ttyS9", 4) & bit(1) != 0 {
            let now = world.time();
            let kept = world.state().schedule.promises(now);
            let mut boards = kept.iter().filter_map(|(.., board)| board.as_ref());
            assert!(boards.any(|board| board.address == 4), "{:?}", world.now);
            seen += 1;
        }
    }
    assert!(seen > 0);
}

/// An EDA9060A gives pulses of the width that it keeps: a write begins one.
#[test]
fn a_pulse_that_a_write_begins_is_known_after_a_restart() {
    let lamp = "[module.lamp]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 6\n";
    let mut knew = 0;
    for after in (0..1_500).step_by(50) {
        let mut world = World::new(&format!("{OVEN}{lamp}"), 1);
        world.give_pulses("lamp", 1);
        world.kill();
        world.start();
        world.pass(ms(1_000));
        let begun = world.pulse("li", ("lamp", 1), Pulse::default());
        world.pass(ms(300));
        assert_eq!(begun.now().unwrap().by, By::Device);
        assert_eq!(world.disk.len(), 1);
        // This one gives none.
        let other = world.write("li", ("lamp", 2), true);
        world.pass(ms(after));
        assert!(after < 200 || other.now().is_ok() && world.disk.len() <= 1);
        world.kill();
        world.start();
        world.pass(ms(200));
        knew += usize::from(world.state().changes_by_itself(&at("lamp", 1)));
        let done = fails_with(&mut world, "lamp", true);
        world.pass(ms(10_000));
        let end = done.now().parts[0].end.clone();
        assert_eq!(world.relays("lamp") & bit(1), 0, "{after} ms: {end:?}");
    }
    assert!((5..25).contains(&knew), "{knew}");
}
