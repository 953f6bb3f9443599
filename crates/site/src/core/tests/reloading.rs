//! What a reload, a loan and the end of one do to lines: which go on, which are opened anew, and
//! what waits for that.

use super::super::*;
use super::world::{World, bit, k, ms};
use crate::{BadReason, CommandError};
use railbus_host::Fault;

const PORT: &str = "/dev/ttyS9";
const OTHER: &str = "/dev/ttyS8";

/// One line with an oven at this address, and more.
fn one(address: u8, more: &str) -> String {
    format!(
        "[line.main]\nport = \"{PORT}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = {address}\n{more}"
    )
}

/// A second line, with a pump.
fn far(name: &str) -> String {
    format!(
        "[line.{name}]\nport = \"{OTHER}\"\n\
         [module.pump]\nline = \"{name}\"\nmodel = \"erc8\"\naddress = 3\n"
    )
}

fn site(text: &str) -> World {
    let mut world = World::new(text, 1);
    world.pass(ms(300));
    world
}

fn reload(world: &mut World, text: &str) -> Reloaded {
    let reloaded = world.reload(text, true);
    world.pass(ms(3_000));
    reloaded.now().unwrap()
}

fn lend(world: &mut World) -> LoanId {
    let lent = world.lend("main");
    world.pass(ms(2_000));
    lent.now().unwrap().loan
}

fn pulse(world: &mut World) {
    let pulse = Pulse {
        width: Some(ms(60_000)),
        ..Pulse::default()
    };
    let begun = world.pulse("li", ("oven", 1), pulse);
    world.pass(ms(300));
    assert!(begun.now().is_ok());
}

fn switches(world: &mut World, output: (&str, u8)) {
    let on = world.write("li", output, true);
    world.pass(ms(1_000));
    assert!(on.now().is_ok(), "{:?}", on.now());
}

/// Its name is another one: the port has to be free before it is opened.
#[test]
fn a_line_that_is_gone_is_closed_before_its_port_is_opened_again() {
    let mut world = site(&(one(3, "") + &far("far")));
    world.port_hangs = ms(500);
    let reloaded = reload(&mut world, &(one(3, "") + &far("away")));
    assert_eq!(
        (reloaded.closed, reloaded.opened),
        (vec!["far".to_owned()], vec!["away".to_owned()])
    );
    switches(&mut world, ("pump", 1));
    assert_eq!(world.relays_at(OTHER, 3), bit(1));
}

/// Until the line knows its new modules, commands for them wait.
#[test]
fn a_module_takes_commands_once_its_line_has_it() {
    for seed in 0..20 {
        let mut world = World::new(&one(3, ""), seed);
        world.pass(ms(300));
        world.reload(&one(4, ""), true);
        while world.state().site.config().modules["oven"].setup.address.0 == 3 {
            assert!(world.step(ms(5_000)));
        }
        switches(&mut world, ("oven", 1));
        assert_eq!(world.relays_at(PORT, 4), bit(1));
    }
}

/// What is another line, and what another module, to a line that goes on.
#[test]
fn a_line_goes_on_where_its_port_is_the_same() {
    let line = |more: &str| one(3, "").replacen("\"\n", &format!("\"\n{more}"), 1);
    for (text, is_kept) in [
        (line("name = \"Cellar\"\n"), true),
        (line("baud = 19200\n"), false),
        (line("echo = \"on\"\n"), false),
        (one(3, "").replace(PORT, OTHER), false),
    ] {
        let mut world = site(&one(3, ""));
        let reloaded = reload(&mut world, &text);
        let main = vec!["main".to_owned()];
        let wanted = if is_kept {
            (main, vec![])
        } else {
            (vec![], main)
        };
        assert_eq!((reloaded.kept, reloaded.opened), wanted, "{text}");
        switches(&mut world, ("oven", 1));
        let port = if text.contains(OTHER) { OTHER } else { PORT };
        assert_eq!(world.relays_at(port, 3), bit(1), "{text}");
    }
    let mut world = site(&one(3, ""));
    assert_eq!(reload(&mut world, &one(3, "")).modules_kept, ["oven"]);
    let reloaded = reload(&mut world, &one(3, "poll = \"700ms\"\n"));
    assert!(reloaded.modules_kept.is_empty());
}

/// A module is found on another line: what was promised of its outputs is done where it was, and
/// commands go where it is.
#[test]
fn a_module_that_is_found_on_another_line_is_another_board() {
    let mut world = site(&(one(3, "") + &far("far")));
    pulse(&mut world);
    let moved = (one(3, "") + &far("far").replace("= 3\n", "= 5\n")).replace(
        "[module.oven]\nline = \"main\"",
        "[module.oven]\nline = \"far\"",
    );
    assert_eq!(reload(&mut world, &moved).kept, ["far", "main"]);
    assert_eq!(world.relays_at(PORT, 3), 0);
    switches(&mut world, ("oven", 2));
    assert_eq!(
        (world.relays_at(PORT, 3), world.relays_at(OTHER, 3)),
        (0, bit(2))
    );
}

/// It is opened when it is given back, whatever is changed of it meanwhile.
#[test]
fn a_line_that_is_lent_is_opened_by_no_reload() {
    let faster = one(3, "").replacen("\"\n", "\"\nbaud = 19200\n", 1);
    for (text, is_kept) in [(one(3, ""), true), (faster, false), (one(4, ""), false)] {
        let mut world = site(&one(3, ""));
        let loan = lend(&mut world);
        let reloaded = reload(&mut world, &text);
        assert_eq!(reloaded.kept.is_empty(), !is_kept, "{text}");
        assert_eq!(world.state().lines["main"].id, None, "{text}");
        assert_eq!(world.state().line_fault("main"), Some(BadReason::Exclusive));
        world.give_back("main", loan, None);
        world.pass(ms(1_000));
        switches(&mut world, ("oven", 1));
    }
}

/// Modules that leave keep their numbers: before these are too many, the line is opened anew.
#[test]
fn a_line_has_had_so_many_modules_and_no_more() {
    let mut world = site(&one(3, ""));
    let (mut most, mut opened) = (0, 0);
    for turn in 0..520 {
        let reloaded = world.reload(&one(if turn % 2 == 0 { 4 } else { 3 }, ""), true);
        world.pass(ms(200));
        opened += reloaded.now().unwrap().opened.len();
        most = most.max(world.state().lines["main"].modules.len());
    }
    assert_eq!((most, opened), (512, 1));
    switches(&mut world, ("oven", 1));
}

/// With its line its modules get other numbers.
#[test]
fn a_line_that_comes_back_has_its_modules_numbered_anew() {
    let mut world = site(&one(3, ""));
    reload(&mut world, &one(4, ""));
    let loan = lend(&mut world);
    world.give_back("main", loan, None);
    world.pass(ms(1_000));
    switches(&mut world, ("oven", 1));
    assert_eq!(world.relays_at(PORT, 4), bit(1));
}

/// How an output is was in doubt by the clock that the line had before it was lent.
#[test]
fn a_doubt_ends_with_the_clock_of_the_line() {
    let mut world = site(&one(
        3,
        "[module.oven.point]\nk1.interlock = [\"oven.k2\"]\n",
    ));
    world.pass(ms(60_000));
    switches(&mut world, ("oven", 2));
    world.only_acknowledged = true;
    let off = world.write("li", ("oven", 2), false);
    world.pass(ms(100));
    assert!(off.now().is_ok());
    world.only_acknowledged = false;
    let loan = lend(&mut world);
    world.give_back("main", loan, None);
    world.pass(ms(1_000));
    switches(&mut world, ("oven", 1));
}

/// Another board has the name: when that was switched off last, nobody knows.
#[test]
fn an_output_of_another_board_may_have_gone_off_just_now() {
    let pause = "[module.oven.point]\nk1.min_off = \"5s\"\n";
    let mut world = site(&one(3, pause));
    world.pass(ms(20_000));
    reload(&mut world, &one(4, pause));
    let early = world.write("li", ("oven", 1), true);
    world.pass(ms(1_000));
    assert!(
        matches!(early.now(), Err(CommandError::MinOff { .. })),
        "{:?}",
        early.now()
    );
    world.pass(ms(5_000));
    switches(&mut world, ("oven", 1));
}

/// What is promised after a reload is of the board that has the name then.
#[test]
fn a_promise_after_a_reload_is_of_the_board_with_the_name() {
    let mut world = site(&one(3, ""));
    reload(&mut world, &one(4, ""));
    pulse(&mut world);
    let boards: Vec<_> = world.disk.iter().map(|(.., board)| board.clone()).collect();
    let line = "main".to_owned();
    assert_eq!(boards, [Some(Board { line, address: 4 })]);
}

/// A module does not answer when its line is lent, or about to be: what it holds is released as
/// soon as it is back, not when that was to end.
#[test]
fn an_end_that_a_loan_could_not_do_is_done_at_its_return() {
    for after in [20, 60, 2_000] {
        let mut world = site(&one(3, ""));
        pulse(&mut world);
        world.dead("oven", true);
        world.pass(ms(600));
        let lent = world.lend("main");
        world.pass(ms(after));
        assert_eq!(lent.get().is_some(), after == 2_000);
        world.dead("oven", false);
        match lent.get() {
            None => world.cancel(&lent),
            Some((_, lent)) => drop(world.give_back("main", lent.unwrap().loan, None)),
        }
        world.pass(ms(10_000));
        assert_eq!(world.relays("oven"), 0, "{after:?}");
        assert!(world.disk.is_empty(), "{after:?}: {:?}", world.disk);
    }
}

/// The site begins to end, or whoever wants the line goes, while its port is being closed.
#[test]
fn a_line_whose_port_is_being_closed_is_lent_to_nobody_who_has_gone() {
    for ends in [false, true] {
        let mut world = site(&one(3, ""));
        world.port_hangs = ms(1_000);
        let lent = world.lend("main");
        world.pass(ms(500));
        assert!(world.state().lines["main"].open().is_none() && lent.get().is_none());
        if ends {
            world.close();
            world.pass(ms(5_000));
            assert!(matches!(lent.now(), Err(CommandError::Line(Fault::Closed))));
            continue;
        }
        world.cancel(&lent);
        world.pass(ms(3_000));
        switches(&mut world, ("oven", 1));
    }
}

/// However long its outputs may yet be on.
#[test]
fn a_line_is_lent_for_a_quarter_of_an_hour_at_most() {
    let mut world = site(&one(3, "[module.oven.point]\nk1.max_on = \"2h\"\n"));
    switches(&mut world, ("oven", 1));
    let lent = world.lend("main");
    world.pass(ms(2_000));
    let left = lent.now().unwrap().until - world.time().site;
    assert!(ms(890_000) < left && left <= ms(900_000), "{left:?}");
}

/// Those who look at a line are told when it is lent and when it is back; or that it is not, since
/// the system refuses it.
#[test]
fn what_becomes_of_a_line_that_is_lent_is_told() {
    for refused in [false, true] {
        let mut world = site(&one(3, ""));
        let told = |world: &mut World| {
            let main = Update::Line("main".to_owned());
            let updates = std::mem::take(&mut world.updates);
            updates.iter().filter(|update| **update == main).count()
        };
        told(&mut world);
        let loan = lend(&mut world);
        assert_eq!(told(&mut world), 1);
        world.refuses_lines = refused;
        world.give_back("main", loan, None);
        assert_eq!(told(&mut world), 1 + usize::from(refused));
        world.pass(ms(1_000));
        let line = &world.state().lines["main"];
        assert_eq!(line.id.is_none(), refused);
        let fault = refused.then_some(BadReason::LineAbsent);
        assert_eq!(world.state().line_fault("main"), fault);
        assert_eq!(world.state().left("oven", k(1)), crate::Left::default());
    }
}

/// The end of a pulse that a reload can't keep, since its board loses its name. Whenever the
/// process is killed, that is reported, before or after. Found by seed 8653.
#[test]
fn an_end_that_is_dropped_is_told_whenever_the_process_is_killed() {
    let mut ways = BTreeSet::new();
    for after in (0..3_000).step_by(3) {
        let mut world = World::new(&one(3, ""), after);
        world.pass(ms(300));
        pulse(&mut world);
        world.dead("oven", true);
        let text = one(4, "");
        world.reload(&text, true);
        world.pass(ms(after));
        let told = |world: &World| {
            let codes = world
                .events
                .iter()
                .filter_map(|event| event.code.as_deref());
            codes.filter(|code| *code == "end_dropped").count()
        };
        let before = told(&world);
        world.kill();
        world.become_other(&text);
        world.start();
        // The logs take their time to open, and it is killed before anything can be told.
        world.pass(ms(5_000));
        world.kill();
        world.start();
        world.tell_dropped_ends();
        world.pass(ms(10));
        assert!(told(&world) > 0, "{after} ms");
        ways.insert((before > 0, told(&world) > before));
    }
    assert!(ways.len() > 1, "before and after: {ways:?}");
}
