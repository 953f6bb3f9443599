//! The end of the site, whatever else opens and closes lines: what it promises of outputs is done
//! at the boards that have their names, or is reported as not done.

use super::super::Pulse;
use super::world::{World, bit, ms};

const PORT: &str = "/dev/ttyS9";
const EXIT: &str = "[module.oven.point]\nk1.on_exit = \"off\"\n";

/// The oven and the kiln at these addresses, and more.
fn site_of(oven: u8, kiln: u8, more: &str) -> String {
    format!(
        "[line.main]\nport = \"{PORT}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = {oven}\n\
         [module.kiln]\nline = \"main\"\nmodel = \"erc8\"\naddress = {kiln}\n{more}"
    )
}

/// Both ovens are on: the one that has the name, and the one at another address.
fn heated(text: &str) -> World {
    let mut world = World::new(text, 1);
    world.pass(ms(300));
    for module in ["oven", "kiln"] {
        let on = world.write("li", (module, 1), true);
        world.pass(ms(300));
        assert!(on.now().is_ok());
    }
    world
}

fn not_done(world: &World) -> usize {
    let codes = world.events.iter().map(|event| event.code.as_deref());
    codes
        .filter(|code| *code == Some("on_exit_not_done"))
        .count()
}

/// Who is off: the board that had the name of the oven before, and the one that has it after.
fn off(world: &World) -> (bool, bool) {
    let is_off = |address| world.relays_at(PORT, address) & bit(1) == 0;
    (is_off(3), is_off(4))
}

/// A reload waits for the disk and has the outputs meanwhile. It gives them back: what it would
/// bring into force is not in force when the site ends.
#[test]
fn the_end_of_the_site_comes_before_a_configuration_that_is_not_in_force() {
    for after in [0, 1, 5, 50, 500, 2_000, 4_999, 9_999, 10_100] {
        let mut world = heated(&site_of(3, 4, EXIT));
        world.disk_takes = Some(ms(5_000));
        let reloaded = world.reload(&site_of(4, 3, EXIT), true);
        world.pass(ms(after));
        let began = world.now;
        let closed = world.close();
        world.pass(ms(10_000));
        let (ended, ()) = closed.get().unwrap();
        assert!(ended - began < ms(2_500), "{after} ms: {:?}", ended - began);
        assert!(reloaded.get().is_some(), "{after} ms");
        let is_old = world.state().site.config().modules["oven"].setup.address.0 == 3;
        assert_eq!(is_old, after < 10_000, "{after} ms");
        assert_eq!(is_old, reloaded.now().is_none(), "{after} ms");
        assert_eq!(
            off(&world),
            (is_old, !is_old),
            "{after} ms: {:?}",
            world.acted
        );
        assert_eq!(not_done(&world), 0, "{after} ms");
        assert!(world.state().is_at_rest());
    }
}

/// A reload closes a line and opens it again: its outputs are switched once the line is back, at
/// the boards that have their names then.
#[test]
fn the_end_of_the_site_waits_for_a_line_that_is_being_opened_anew() {
    let more = format!("{EXIT}[module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = 9\n");
    let mut were_closing = 0;
    for after in 0..60 {
        let mut world = heated(&site_of(3, 4, &more));
        world.hold_line(ms(900));
        let late = world.write("li", ("pump", 2), true);
        let faster = site_of(4, 3, &more).replacen("\"\n", "\"\nbaud = 19200\n", 1);
        let reloaded = world.reload(&faster, true);
        world.pass(ms(after * 20));
        let line = &world.state().lines["main"];
        were_closing += usize::from(line.id.is_some() && line.open().is_none());
        let closed = world.close();
        world.pass(ms(10_000));
        assert!(closed.get().is_some() && reloaded.get().is_some() && late.get().is_some());
        let is_old = world.state().site.config().modules["oven"].setup.address.0 == 3;
        assert_eq!(off(&world), (is_old, !is_old), "{after}: {:?}", world.acted);
        assert_eq!(not_done(&world), 0, "{after}");
        assert!(world.state().is_at_rest());
    }
    assert!(were_closing > 3, "{were_closing}");
}

/// The port of a line hangs that a reload closes: the site ends in time, does nothing to a board
/// that gets the name afterwards, and says what it could not do.
#[test]
fn the_end_of_the_site_does_not_wait_for_a_port_that_hangs() {
    let mut world = heated(&site_of(3, 4, EXIT));
    let acted = world.acted.len();
    world.port_hangs = ms(2_000);
    let faster = site_of(4, 3, EXIT).replacen("\"\n", "\"\nbaud = 19200\n", 1);
    let reloaded = world.reload(&faster, true);
    world.pass(ms(100));
    let began = world.now;
    let closed = world.close();
    world.pass(ms(10_000));
    let (ended, ()) = closed.get().unwrap();
    assert!(ended - began < ms(4_000), "{:?}", ended - began);
    assert!(reloaded.get().is_some());
    assert_eq!(world.acted.len(), acted, "{:?}", world.acted);
    let told = &world.events[0];
    let of = (told.module.as_deref(), told.point.as_deref());
    assert_eq!((not_done(&world), of), (1, (Some("oven"), Some("k1"))));
    assert!(world.state().is_at_rest());
}

/// Its module does not answer, its line is lent, or its command is still waiting: that is said, and
/// only that.
#[test]
fn what_the_end_of_the_site_could_not_switch_is_reported() {
    let heated = || heated(&site_of(3, 4, EXIT));
    let close = |world: &mut World| {
        let closed = world.close();
        world.pass(ms(10_000));
        assert!(closed.get().is_some());
        not_done(world)
    };
    let mut world = heated();
    assert_eq!(close(&mut world), 0);
    let mut world = heated();
    world.dead("oven", true);
    assert_eq!(close(&mut world), 1);
    let mut world = heated();
    let lent = world.lend("main");
    world.pass(ms(2_000));
    assert!(lent.now().is_ok());
    assert_eq!(close(&mut world), 1);
    let mut world = heated();
    world.audit_takes = Some(ms(8_000));
    world.write("li", ("oven", 1), true);
    assert_eq!(close(&mut world), 1, "its turn never comes");
    let mut world = heated();
    world.hold_line(ms(1_500));
    assert_eq!(close(&mut world), 0, "the line ends what was sent");
    assert!(off(&world).0);
}

/// A loan waits for the disk and has the outputs of its line: it gives them back.
#[test]
fn the_end_of_the_site_comes_before_a_loan_that_is_not_granted() {
    let mut world = heated(&site_of(3, 4, EXIT));
    world.disk_takes = Some(ms(5_000));
    let pulse = Pulse {
        width: Some(ms(60_000)),
        ..Pulse::default()
    };
    world.pulse("li", ("kiln", 2), pulse);
    let lent = world.lend("main");
    world.pass(ms(100));
    let closed = world.close();
    world.pass(ms(20_000));
    assert!(closed.get().is_some() && lent.now().is_err());
    assert_eq!((off(&world).0, not_done(&world)), (true, 0));
}

/// Its holder has moved the modules, and the configuration that says so does not come into force
/// any more: nobody switches what is at those addresses now.
#[test]
fn a_line_is_not_opened_for_the_end_of_the_site_by_an_old_configuration() {
    let far = "[line.far]\nport = \"/dev/ttyS8\"\n\
        [module.pump]\nline = \"far\"\nmodel = \"erc8\"\naddress = 3\n";
    let more = format!("{EXIT}{far}");
    let mut world = heated(&site_of(3, 4, &more));
    let lent = world.lend("main");
    world.pass(ms(2_000));
    let loan = lent.now().unwrap().loan;
    let acted = world.acted.len();
    world.disk_takes = Some(ms(5_000));
    let pulse = Pulse {
        width: Some(ms(60_000)),
        ..Pulse::default()
    };
    world.pulse("li", ("pump", 2), pulse);
    world.give_back("main", loan, Some(&site_of(4, 3, &more)));
    world.pass(ms(100));
    world.close();
    world.pass(ms(20_000));
    assert_eq!(world.acted.len(), acted, "{:?}", world.acted);
    assert_eq!(not_done(&world), 1);
}

/// Who ends a site that is being ended already waits for the same, and switches nothing twice.
#[test]
fn the_end_of_the_site_comes_once_however_often_it_is_asked_for() {
    for (after, is_dead) in [0, 1, 300, 1_000, 1_399, 1_401, 2_000, 2_500]
        .into_iter()
        .flat_map(|after| [(after, false), (after, true)])
    {
        let mut world = heated(&site_of(3, 4, EXIT));
        let pulse = Pulse {
            width: Some(ms(60_000)),
            ..Pulse::default()
        };
        world.pulse("li", ("kiln", 2), pulse);
        world.pass(ms(300));
        world.dead("kiln", is_dead);
        world.dead("oven", is_dead);
        let tried = world.log.len();
        let first = world.close();
        world.pass(ms(after));
        let second = world.close();
        world.pass(ms(10_000));
        let ends = [first, second].map(|end| end.get().unwrap().0);
        let exits = world
            .log
            .iter()
            .skip(tried)
            .filter(|one| one.who == "on_exit");
        assert_eq!(exits.count(), 1, "{after} {is_dead}");
        assert_eq!(not_done(&world), usize::from(is_dead), "{after} {is_dead}");
        assert!(ends[0] <= ends[1], "{after} {is_dead}: {ends:?}");
    }
}
