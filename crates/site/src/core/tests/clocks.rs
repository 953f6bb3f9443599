//! What is known of a line that is opened anew: its clock begins with it, and so does its traffic.

use super::super::*;
use super::world::{World, at, bit, ms};
use railbus_host::Event as BusEvent;

const FAR: &str = "[line.far]\nport = \"/dev/ttyS8\"\n\
    [module.pump]\nline = \"far\"\nmodel = \"erc8\"\naddress = ";
const HERE: &str = "\n[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
    [module.oven.point]\nk1.interlock = [\"oven.k2\"]\n";

/// The result of a raw frame is known only when the line has already been closed for a reload: what
/// is read from then on counts, not what is read once the line has been open for as long as the
/// site.
#[test]
fn what_ended_between_two_clocks_of_a_line_is_in_doubt_until_it_is_read() {
    for after in 0..30 {
        let mut world = World::new(&format!("{FAR}5{HERE}"), 1);
        world.pass(ms(60_000));
        let modules = ["oven".to_owned()];
        let outputs = world.state().doubt(&modules);
        let other = format!("{FAR}6{HERE}").replace("ttyS9\"\n", "ttyS9\"\nbaud = 19200\n");
        let reloaded = world.reload(&other, true);
        world.pass(ms(after));
        world.state().no_longer_doubt(&modules, &outputs);
        world.pass(ms(5_000));
        assert_eq!(reloaded.now().unwrap().opened, ["main"]);
        let on = world.write("li", ("oven", 1), true);
        world.pass(ms(1_000));
        assert!(on.now().is_ok(), "{after} ms: {:?}", on.now());
        assert_eq!(world.relays("oven"), bit(1));
        assert_eq!(world.state().known(&at("oven", 1)), Some(true));
    }
}

/// The line babbled when another program took it. Of one that is opened anew nothing is heard yet.
#[test]
fn a_line_that_is_opened_anew_does_not_babble() {
    let mut world = World::new(&format!("{FAR}5{HERE}"), 1);
    world.pass(ms(300));
    let at = world.state().at("oven").unwrap();
    world.line(at, &LineEvent::Bus(BusEvent::Babble));
    assert!(world.state().lines["main"].babble);
    let lent = world.lend("main");
    world.pass(ms(2_000));
    let loan = lent.now().unwrap().loan;
    world.give_back("main", loan, None);
    world.pass(ms(2_000));
    assert!(!world.state().lines["main"].babble);
}
