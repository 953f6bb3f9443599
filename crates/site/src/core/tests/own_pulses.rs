//! Pulses that modules time by themselves: the output still changes without a command, whatever
//! becomes of the process, of its disk and of the names.

use super::super::*;
use super::world::{Faults, World, at, bit, ms, who_is};
use crate::CommandError;

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
