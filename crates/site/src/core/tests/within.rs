//! A command that was not sent within its time is not sent any more, whatever it waited for.

use super::super::*;
use super::world::{End as Ended, World, at, bit, k, ms, who_is};
use crate::CommandError;
use railbus_host::Fault;

const TEXT: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
    [group.all]\nmembers = [\"oven.k1\"]\n\
    [scene.dusk]\nsteps = [{ set = \"oven.k1\", to = true }]\n";
/// Its longest time has to be on the disk before it is switched on.
const LIMITED: &str = "[module.oven.point]\nk1.max_on = \"60s\"\n";

/// What switches k1 on.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Write,
    IfOff,
    Toggle,
    RawToggle,
    Pulse,
    Lease,
    Batch,
    AllOrNothing,
    Group,
    GroupToggle,
    Scene,
}

const KINDS: [Kind; 11] = [
    Kind::Write,
    Kind::IfOff,
    Kind::Toggle,
    Kind::RawToggle,
    Kind::Pulse,
    Kind::Lease,
    Kind::Batch,
    Kind::AllOrNothing,
    Kind::Group,
    Kind::GroupToggle,
    Kind::Scene,
];

/// What it has to wait for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cause {
    Turn,
    Log,
    Disk,
    Line,
}

const CAUSES: [Cause; 4] = [Cause::Turn, Cause::Log, Cause::Disk, Cause::Line];

/// For how long.
const WAITS: Micros = ms(7_000);

fn give(world: &mut World, kind: Kind, within: Within) -> Ended<Result<(), CommandError>> {
    let who = who_is("li");
    world.order(move |core| async move {
        let (module, point, set) = ("oven", k(1), [(k(1), true)]);
        let write = WriteTerms {
            within,
            ..WriteTerms::default()
        };
        let toggle = ToggleTerms {
            within,
            ..ToggleTerms::default()
        };
        let batch = BatchTerms {
            within,
            ..BatchTerms::default()
        };
        let done = match kind {
            Kind::Write => return core.write(&who, module, &set, write).await.map(drop),
            Kind::IfOff => {
                let only_if = Some(false);
                let terms = WriteTerms { only_if, ..write };
                return core.write(&who, module, &set, terms).await.map(drop);
            }
            Kind::Toggle => return core.toggle(&who, module, point, toggle).await.map(drop),
            Kind::RawToggle => {
                let terms = ToggleTerms {
                    raw: true,
                    ..toggle
                };
                return core.toggle(&who, module, point, terms).await.map(drop);
            }
            Kind::Pulse => {
                let pulse = Pulse {
                    width: Some(ms(30_000)),
                    within,
                    ..Pulse::default()
                };
                return core.pulse(&who, module, point, pulse).await.map(drop);
            }
            Kind::Lease => {
                let (held, confirm) = ((true, ms(30_000)), false);
                let terms = LeaseTerms { confirm, within };
                return core.lease(&who, module, point, held, terms).await.map(drop);
            }
            Kind::Batch => core.batch(&who, &[(at("oven", 1), true)], batch).await,
            Kind::AllOrNothing => {
                let terms = BatchTerms {
                    all_or_nothing: true,
                    ..batch
                };
                core.batch(&who, &[(at("oven", 1), true)], terms).await
            }
            Kind::Group => {
                let to = GroupState::Set(true);
                core.set_group(&who, "all", to, batch).await?
            }
            Kind::GroupToggle => {
                let to = GroupState::Toggle;
                core.set_group(&who, "all", to, batch).await?
            }
            Kind::Scene => core.play(&who, "dusk", batch).await?,
        };
        done.parts[0].end.clone().map(drop)
    })
}

/// A command that has to wait for [`WAITS`], with what came of it.
fn wait(kind: Kind, cause: Cause, within: Micros) -> (World, Result<(), CommandError>) {
    let mut world = World::new(&format!("{TEXT}{LIMITED}"), 7);
    world.pass(ms(300));
    match cause {
        Cause::Turn => {
            world.order(|core| async move {
                let _turn = core.turn_to_end([at("oven", 1)]).await;
                let until = core.now() + WAITS;
                core.until(until, std::future::pending::<()>()).await;
            });
        }
        Cause::Log => world.audit_takes = Some(WAITS),
        Cause::Disk => world.disk_takes = Some(WAITS),
        Cause::Line => world.hold_line(WAITS),
    }
    let ended = give(&mut world, kind, Within::new(within).unwrap());
    world.pass(ms(28_000));
    let end = ended.now();
    (world, end)
}

#[test]
fn what_was_not_sent_within_its_time_is_not_sent() {
    for (kind, cause) in KINDS
        .iter()
        .flat_map(|kind| CAUSES.map(|cause| (*kind, cause)))
    {
        for within in [200, 5_000, 6_990] {
            let (mut world, end) = wait(kind, cause, ms(within));
            let what = format!("{kind:?} waits for {cause:?}, and has {within} ms");
            let Err(failure) = end else {
                panic!("{what}: it was sent");
            };
            let fault = (failure.name(), failure.may_have_acted());
            assert_eq!(fault, ("expired", false), "{what}");
            assert!(world.acted.is_empty(), "{what}: {:?}", world.acted);
            let ends: Vec<_> = world
                .log
                .iter()
                .map(|entry| entry.ended.unwrap().1)
                .collect();
            assert!(ends.iter().all(|end| *end == "expired"), "{what}: {ends:?}");
            assert!(world.disk.is_empty(), "{what}: {:?}", world.disk);
            assert!(world.state().is_at_rest(), "{what}");
        }
    }
}

/// No command waits longer than its time for a disk that does not answer, neither for the longest
/// time of an output nor for what is noted of how long it must stay off.
#[test]
fn who_gave_a_command_waits_no_longer_for_the_disk() {
    for points in ["k1 = { max_on = \"60s\" }\n", "k1 = { min_off = \"1s\" }\n"] {
        let text = format!("{TEXT}[module.oven.point]\n{points}");
        let mut world = World::new(&text, 7);
        for on in [true, false] {
            world.pass(ms(2_000));
            let done = world.write("li", ("oven", 1), on);
            world.pass(ms(500));
            assert!(done.now().is_ok());
        }
        world.pass(ms(2_000));
        (world.disk_takes, world.acted) = (Some(WAITS), Vec::new());
        let given = world.now;
        let ended = give(&mut world, Kind::Write, Within::new(ms(500)).unwrap());
        world.pass(ms(20_000));
        let (at, end) = ended.get().unwrap();
        assert_eq!(end, Err(CommandError::Line(Fault::Expired)), "{points}");
        assert!(at < given + ms(510), "{points}: after {:?}", at - given);
        assert!(world.acted.is_empty());
    }
}

/// So it was the time that they had, and one longer than usual is granted.
#[test]
fn with_more_time_it_is_sent() {
    for (kind, cause) in KINDS
        .iter()
        .flat_map(|kind| CAUSES.map(|cause| (*kind, cause)))
    {
        // A pulse and a lease wait for the disk once for their end, and once for the longest time.
        let (world, end) = wait(kind, cause, ms(15_000));
        // This module has no such command.
        if matches!(kind, Kind::RawToggle) {
            continue;
        }
        assert_eq!(end, Ok(()), "{kind:?} waits for {cause:?}");
        assert_eq!(world.acted.len(), 1);
        assert!(world.acted[0].at >= WAITS);
    }
}

/// Of two frames the first was in time; undoing it has its own time.
#[test]
fn what_was_sent_in_time_is_undone_later() {
    let points = "[module.oven.point]\nk1.interlock = [\"oven.k2\"]\n";
    let mut world = World::new(&format!("{TEXT}{points}"), 7);
    world.pass(ms(300));
    assert!(world.write("li", ("oven", 1), true).get().is_none());
    world.pass(ms(500));
    let given = world.now;
    world.audit_takes = Some(ms(200));
    let terms = BatchTerms {
        all_or_nothing: true,
        within: Within::new(ms(400)).unwrap(),
        ..BatchTerms::default()
    };
    let set = [(at("oven", 1), false), (at("oven", 2), true)];
    let done = world.order(move |core| async move { core.batch(&who_is("li"), &set, terms).await });
    world.pass(ms(3_000));
    let done = done.now();
    let ends: Vec<_> = done.parts.into_iter().map(|part| part.end).collect();
    let expired = CommandError::Line(Fault::Expired);
    assert_eq!(ends, [Err(CommandError::Undone), Err(expired)]);
    assert_eq!(world.relays("oven"), bit(1));
    let undone = world.acted.last().unwrap();
    assert!(undone.at > given + ms(400), "{undone:?}");
}

#[test]
fn the_time_is_from_200_ms_to_60_s() {
    let is_allowed = |micros| Within::new(Micros(micros)).is_some();
    let allowed = [199_999, 200_000, 60_000_000, 60_000_001].map(is_allowed);
    assert_eq!(allowed, [false, true, true, false]);
    assert_eq!(Within::new(ms(5_000)), Some(Within::default()));
}
