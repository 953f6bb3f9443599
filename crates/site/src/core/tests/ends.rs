//! What is done to outputs later, at the edges: limits that change, policies that wait for each
//! other, turns that are given back, ends that are put forward, a site that closes.

use super::super::*;
use super::world::{World, bit, k, ms, pulse, who_is};
use crate::CommandError;
use railbus_host::Fault;

const OVEN: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
const FAR: &str = "[line.far]\nport = \"/dev/ttyS8\"\n\
    [module.pump]\nline = \"far\"\nmodel = \"erc8\"\naddress = 3\n";

fn site(text: &str) -> World {
    let mut world = World::new(text, 1);
    world.pass(ms(300));
    world
}

fn with(points: &str) -> String {
    format!("{OVEN}[module.oven.point]\n{points}")
}

/// Of two limits of an output the newer one counts alone; a limit takes no pulse its end.
#[test]
fn a_limit_gives_way_to_a_newer_one_and_a_pulse_to_none() {
    let mut world = site(&with("k1.max_on = \"5s\"\n"));
    let on = world.write("li", ("oven", 1), true);
    world.pass(ms(1_000));
    assert!(on.now().is_ok());
    let longer = world.reload(&with("k1.max_on = \"60s\"\n"), true);
    world.pass(ms(20_000));
    assert!(longer.now().is_some());
    assert_eq!(
        world.relays("oven"),
        bit(1),
        "it may be on for longer by now"
    );
    world.pass(ms(45_000));
    assert_eq!(world.relays("oven"), 0);
    let begun = world.pulse("li", ("oven", 1), pulse(2_000));
    world.pass(ms(3_000));
    assert!(begun.now().is_ok());
    assert_eq!(world.relays("oven"), 0);
    assert!(world.disk.is_empty(), "{:?}", world.disk);
}

/// A module comes and goes, and its policy can't be carried out: it is tried for once.
#[test]
fn a_policy_gives_way_to_the_same_one() {
    let mut world = site(&with("k1.on_return = \"off\"\n"));
    world.weld("oven", bit(1));
    world.move_by_hand("oven", bit(1));
    for _ in 0..5 {
        world.dead("oven", true);
        world.pass(ms(2_000));
        world.dead("oven", false);
        world.pass(ms(2_000));
    }
    assert_eq!(world.state().schedule.held(|_| true).len(), 1);
    world.weld("oven", 0);
    world.pass(ms(120_000));
    assert_eq!(world.relays("oven"), 0);
    assert!(world.disk.is_empty(), "{:?}", world.disk);
}

/// What goes on when its module returns waits for what goes off by the same policy, however often
/// that is tried, and not for what somebody else has switched on.
#[test]
fn a_policy_waits_for_what_goes_off_by_it_and_for_nothing_else() {
    for goes_off in [true, false] {
        let off = if goes_off {
            "k2.on_return = \"off\"\n"
        } else {
            ""
        };
        let points = format!("k1.on_return = \"on\"\nk1.interlock = [\"oven.k2\"]\n{off}");
        let mut world = site(&with(&points));
        let on = world.write("li", ("oven", 2), true);
        world.pass(ms(500));
        assert!(on.now().is_ok());
        world.weld("oven", bit(2));
        world.dead("oven", true);
        world.pass(ms(2_000));
        world.dead("oven", false);
        world.pass(ms(1_500));
        assert_eq!(world.relays("oven"), bit(2), "k2 can't be switched off yet");
        world.weld("oven", 0);
        if !goes_off {
            world.move_by_hand("oven", 0);
        }
        world.pass(ms(120_000));
        let wanted = if goes_off { bit(1) } else { 0 };
        assert_eq!(world.relays("oven"), wanted, "{goes_off}");
        assert!(world.disk.is_empty(), "{:?}", world.disk);
    }
}

fn toggle(world: &mut World) -> super::world::End<Result<BatchDone, CommandError>> {
    world.order(|core| async move {
        let (who, terms) = (who_is("li"), BatchTerms::default());
        core.set_group(&who, "all", GroupState::Toggle, terms).await
    })
}

const BOTH: &str = "[group.all]\nmembers = [\"oven.k1\", \"pump.k1\"]\n";

/// Somebody has switched an output by hand since it was read.
#[test]
fn a_group_is_toggled_from_what_it_is_in_its_turn() {
    for by_hand in [0, bit(1)] {
        let mut world = site(&format!("{OVEN}{FAR}{BOTH}"));
        if by_hand == 0 {
            let on = world.write("li", ("oven", 1), true);
            world.pass(ms(500));
            assert!(on.now().is_ok());
        }
        world.polls = false;
        world.move_by_hand("oven", by_hand);
        let toggled = toggle(&mut world);
        world.pass(ms(2_000));
        assert!(toggled.now().is_ok());
        let wanted = if by_hand == 0 { bit(1) } else { 0 };
        assert_eq!(world.relays("oven"), wanted);
        assert_eq!(world.relays("pump"), wanted);
    }
}

/// The first one was only acknowledged: what it switched is read before the second decides.
#[test]
fn two_toggles_of_a_group_that_are_not_read_back_bring_it_back() {
    for after in [0, 5, 20, 40] {
        let mut world = site(&format!("{OVEN}{FAR}{BOTH}"));
        for module in ["oven", "pump"] {
            world.write("li", (module, 1), true);
        }
        world.pass(ms(500));
        (world.polls, world.only_acknowledged) = (false, true);
        let first = toggle(&mut world);
        world.pass(ms(after));
        let second = toggle(&mut world);
        world.pass(ms(3_000));
        assert!(first.now().is_ok() && second.now().is_ok());
        assert_eq!(world.relays("oven"), bit(1), "{after} ms");
        assert_eq!(world.relays("pump"), bit(1), "{after} ms");
    }
}

/// Its outputs are no longer leased, and nothing ends what the second toggle began.
#[test]
fn a_group_that_is_toggled_takes_its_outputs_over() {
    let mut world = site(&format!("{OVEN}{FAR}{BOTH}"));
    let leased = world.lease("li", ("oven", 1), (true, ms(5_000)));
    world.pass(ms(500));
    assert!(leased.now().is_ok());
    for wanted in [0, bit(1)] {
        let toggled = toggle(&mut world);
        world.pass(ms(1_000));
        assert!(
            toggled
                .now()
                .unwrap()
                .parts
                .iter()
                .all(|part| part.end.is_ok())
        );
        assert_eq!(world.relays("oven"), wanted);
    }
    world.pass(ms(10_000));
    assert_eq!(world.relays("oven"), bit(1));
    assert!(world.disk.is_empty(), "nothing is promised");
}

/// One line is slow: the outputs of the other are free as soon as they are switched.
#[test]
fn outputs_of_a_group_are_given_back_with_the_end_of_their_own_command() {
    let mut world = site(&format!("{OVEN}{FAR}{BOTH}"));
    let toggled = toggle(&mut world);
    // Both were read in their turn.
    while world.log.len() < 2 && world.step(ms(1_000)) {}
    world.hold_port("/dev/ttyS8", ms(3_000));
    let off = world.write("wang", ("oven", 1), false);
    world.pass(ms(1_000));
    assert!(toggled.get().is_none(), "it waits for the slow line");
    assert!(off.now().is_ok());
    assert_eq!(world.relays("oven"), 0);
    world.pass(ms(5_000));
    assert!(toggled.now().is_ok());
    assert_eq!((world.relays("oven"), world.relays("pump")), (0, bit(1)));
}

/// The end of a lease was acknowledged and not seen: it is tried again, and not at its time only.
#[test]
fn the_end_of_a_lease_that_was_not_seen_is_tried_again_at_once() {
    let mut world = site(OVEN);
    let held = world.lease("li", ("oven", 1), (true, ms(600_000)));
    world.pass(ms(500));
    assert!(held.now().is_ok());
    world.only_acknowledged = true;
    world.weld("oven", bit(1));
    let point = k(1);
    let ended =
        world.order(move |core| async move { core.end_lease(&who_is("li"), "oven", point).await });
    world.pass(ms(200));
    assert!(ended.now().is_ok());
    world.only_acknowledged = false;
    world.weld("oven", 0);
    world.pass(ms(5_000));
    assert_eq!(world.relays("oven"), 0);
    assert!(world.disk.is_empty(), "{:?}", world.disk);
}

/// The site begins to close while a module is asked how it keeps the time of pulses: nobody would
/// wait for the end of one that began then. Its line is open for as long as another output takes.
#[test]
fn no_pulse_begins_while_the_site_is_being_closed() {
    let gate = "[module.gate]\nline = \"far\"\nmodel = \"eda9060a\"\naddress = 1\n";
    let mut closed = 0;
    for after in 0..60 {
        let mut world = site(&format!("{OVEN}{FAR}{gate}"));
        let other = world.pulse("li", ("oven", 1), pulse(60_000));
        world.pass(ms(300));
        assert!(other.now().is_ok());
        world.dead("oven", true);
        let asks = Pulse {
            by: By::Host,
            ..pulse(60_000)
        };
        let begun = world.pulse("li", ("gate", 1), asks);
        world.pass(ms(after));
        world.close();
        world.pass(ms(5_000));
        let is_closed = begun.now().err() == Some(CommandError::Line(Fault::Closed));
        let acted = world.acted.iter().any(|acted| acted.module == "gate");
        closed += u8::from(is_closed && !acted);
        assert_eq!(world.relays("gate"), 0, "{after} ms");
        assert_eq!(world.state().left("gate", k(1)), crate::Left::default());
    }
    assert!(closed > 10, "{closed} came while it was asked");
}
