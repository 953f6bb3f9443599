//! Modules whose names become those of other boards while commands are under way.

use super::super::*;
use super::world::{World, bit, ms};
use crate::Failure;
use railbus_host::Fault;

const TEXT: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

/// A pulse or lease waits for the disk, and its promise is dropped with the board that it is of:
/// what the board's name stands for now is not switched, for nobody would release it.
#[test]
fn what_begins_while_the_disk_is_slow_goes_to_its_own_board_or_nowhere() {
    for after in [0, 1, 5, 100, 2_000, 3_000] {
        for leases in [false, true] {
            let mut world = World::new(TEXT, 1);
            world.pass(ms(300));
            world.disk_takes = Some(ms(3_000));
            let width = Pulse {
                width: Some(ms(60_000)),
                ..Pulse::default()
            };
            let pulse = (!leases).then(|| world.pulse("li", ("oven", 1), width));
            let lease = leases.then(|| world.lease("li", ("oven", 1), (true, ms(60_000))));
            world.pass(ms(after));
            world.exchange("oven");
            world.pass(ms(20_000));
            let end = pulse.and_then(|end| end.now().err());
            let end = end.or_else(|| lease.and_then(|end| end.now().err()));
            assert_eq!(end, Some(Failure::Line(Fault::Closed)), "{after} ms");
            assert!(world.acted.is_empty(), "{after} ms: {:?}", world.acted);
            assert_eq!(world.relays("oven") & bit(1), 0);
            assert!(world.disk.is_empty(), "{:?}", world.disk);
            assert!(world.state().is_at_rest());
        }
    }
}
