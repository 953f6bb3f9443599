//! What is said of readings: their time, how good they are, and what follows from that.

use super::super::*;
use super::world::{World, at, k, ms};
use crate::PointStatus;
use crate::{BadReason, PointQuality, PointValue};
use railbus_device::{Bank, Observation, PointKind};
use railbus_host::{Event, LineState, PortError, Presence};
use railbus_wire::PulseWidth;
use std::time::Duration;

const TEXT: &str = "[line.main]\nport = \"/dev/ttyS9\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\nmax_age = \"2s\"\n";

fn oven() -> World {
    let mut world = World::new(TEXT, 1);
    world.pass(ms(300));
    world
}

fn outputs(on: u32) -> Observation {
    Observation::Channels {
        outputs: Bank::new(0xFF, on),
        inputs: Bank::default(),
    }
}

const OVEN: At = At {
    line: LineId(0),
    module: ModuleId(0),
};

#[test]
fn a_reading_has_the_time_at_which_its_request_began_and_keeps_it() {
    let mut world = oven();
    world.polls = false;
    world.pass(ms(1_000));
    let asked = world.time().wall - Duration::from_millis(40);
    let begun = world.now - ms(40);
    world.saw_since(OVEN, &Op::ReadOutputs, outputs(1), begun);
    let time = |world: &mut World| {
        let now = world.time();
        let state = world.core.as_mut().unwrap().state(now);
        state.point_of("oven", k(1)).unwrap().time
    };
    assert_eq!(time(&mut world), Some(asked));
    world.pass(ms(700));
    assert_eq!(time(&mut world), Some(asked), "however old it is by now");
    world.wall_behind = ms(5_000_000);
    assert_eq!(
        time(&mut world),
        Some(asked),
        "the clock on the wall was set"
    );
    let now = world.now;
    world.saw_since(OVEN, &Op::ReadOutputs, outputs(1), now);
    assert_eq!(time(&mut world), Some(world.time().wall), "read anew");
}

/// How good the first relay is told to be, one change after the other, since this was last asked.
fn told(world: &mut World) -> Vec<PointQuality> {
    let updates = std::mem::take(&mut world.updates);
    let of_first = |update: &&Update| **update == Update::Quality(at("oven", 1));
    let told = updates.iter().filter(of_first);
    told.map(|_| quality(world)).collect()
}

fn quality(world: &World) -> PointQuality {
    let core = world.core.as_ref().unwrap();
    core.state.point_of("oven", k(1)).unwrap().quality
}

#[test]
fn a_value_becomes_stale_at_its_age_limit_and_that_is_told_once() {
    let mut world = oven();
    told(&mut world);
    world.pass(ms(10_000));
    assert_eq!(told(&mut world), [], "read anew again and again");
    world.polls = false;
    world.pass(ms(200));
    // The last poll was at 10,250 ms and a microsecond.
    world.pass(ms(1_750));
    assert_eq!(
        (quality(&world), world.now),
        (PointQuality::Good, ms(12_250))
    );
    let deadline = world.core.as_ref().unwrap().deadline();
    assert_eq!(deadline, Some(Micros(12_250_002)));
    assert_eq!(told(&mut world), []);
    world.pass(Micros(2));
    assert_eq!(told(&mut world), [PointQuality::Stale]);
    world.pass(ms(60_000));
    assert_eq!(told(&mut world), [], "once");
    world.saw(OVEN, &Op::ReadOutputs, outputs(0));
    assert_eq!(told(&mut world), [PointQuality::Good]);
    // It has a limit again.
    world.pass(ms(2_000));
    assert_eq!(told(&mut world), []);
    world.pass(Micros(1));
    assert_eq!(told(&mut world), [PointQuality::Stale]);
}

/// However old the value of a silent module is, that is another fault.
#[test]
fn what_a_module_does_is_told_of_its_points() {
    let mut world = oven();
    told(&mut world);
    world.dead("oven", true);
    world.pass(ms(250));
    assert_eq!(told(&mut world), [PointQuality::Bad(BadReason::Offline)]);
    world.pass(ms(10_000));
    assert_eq!(told(&mut world), []);
    world.dead("oven", false);
    world.pass(ms(250));
    assert_eq!(told(&mut world).last(), Some(&PointQuality::Good));
    let presence = |presence| {
        LineEvent::Bus(Event::Presence {
            module: OVEN.module,
            presence,
        })
    };
    world.line(OVEN, &presence(Presence::OtherModel));
    assert_eq!(told(&mut world), [PointQuality::Bad(BadReason::OtherModel)]);
    world.line(OVEN, &presence(Presence::Online));
    assert_eq!(told(&mut world), [PointQuality::Bad(BadReason::NeverRead)]);
}

/// The command was acknowledged, and the output not read since: the old value is not shown as good.
#[test]
fn a_value_from_before_a_command_is_stale_until_it_is_read_again() {
    let mut world = oven();
    (world.polls, world.only_acknowledged) = (false, true);
    let on = world.write("li", ("oven", 1), true);
    world.pass(ms(300));
    assert!(on.now().is_ok());
    let of = |world: &World, number| {
        let core = world.core.as_ref().unwrap();
        core.state.point_of("oven", k(number)).unwrap()
    };
    let first = of(&world, 1);
    assert_eq!(first.value, Some(PointValue::Bool(false)));
    assert_eq!(first.quality, PointQuality::Stale);
    assert_eq!(
        of(&world, 2).quality,
        PointQuality::Good,
        "nobody commanded it"
    );
    world.saw(OVEN, &Op::ReadOutputs, outputs(1));
    let read = of(&world, 1);
    assert_eq!(read.value, Some(PointValue::Bool(true)));
    assert_eq!(read.quality, PointQuality::Good);
}

/// It answers again, and may have been without power.
#[test]
fn a_value_from_before_a_silence_is_stale_until_it_is_read_again() {
    let mut world = oven();
    world.polls = false;
    told(&mut world);
    let presence = |presence| {
        LineEvent::Bus(Event::Presence {
            module: OVEN.module,
            presence,
        })
    };
    world.line(OVEN, &presence(Presence::Silent));
    assert_eq!(told(&mut world), [PointQuality::Bad(BadReason::Offline)]);
    world.line(OVEN, &presence(Presence::Online));
    assert_eq!(told(&mut world), [PointQuality::Stale]);
    world.saw(OVEN, &Op::ReadOutputs, outputs(0));
    assert_eq!(told(&mut world), [PointQuality::Good]);
}

#[test]
fn what_becomes_of_a_line_is_told_of_its_points() {
    let mut world = oven();
    world.polls = false;
    told(&mut world);
    let line_is = |world: &mut World, state| {
        world.line(OVEN, &LineEvent::State(state));
        told(world)
    };
    let absent = |why| LineState::Absent(Arc::new(why));
    let bad = |why| [PointQuality::Bad(why)];
    let gone = absent(PortError::Gone);
    assert_eq!(line_is(&mut world, gone), bad(BadReason::LineAbsent));
    let busy = absent(PortError::Busy { holder: None });
    assert_eq!(line_is(&mut world, busy), bad(BadReason::LineBusy));
    let closed = LineState::Closed;
    assert_eq!(line_is(&mut world, closed), bad(BadReason::LineClosed));
    assert_eq!(line_is(&mut world, LineState::Up), [PointQuality::Good]);
    let now = world.time();
    let lend = |world: &mut World, lent| {
        let core = world.core.as_mut().unwrap();
        core.change(now, |state| {
            state.lines.get_mut("main").unwrap().lent = lent
        });
        world.pass(Micros(0));
        told(world)
    };
    assert_eq!(lend(&mut world, Some(LoanId(1))), bad(BadReason::Exclusive));
    assert_eq!(lend(&mut world, None), [PointQuality::Good]);
}

#[test]
fn another_age_limit_counts_from_the_reload_on() {
    let mut world = oven();
    world.polls = false;
    world.pass(ms(1_000));
    told(&mut world);
    let now = world.time();
    let core = world.core.as_mut().unwrap();
    let strict = Config::parse(&TEXT.replace("2s", "500ms")).unwrap();
    core.change(now, |state| {
        state.reconfigure(Arc::new(strict), |_| true, |_| false);
    });
    world.pass(Micros(0));
    assert_eq!(told(&mut world), [PointQuality::Stale]);
}

/// Somebody follows from now on.
fn follow(world: &mut World) -> Arc<Picture> {
    let now = world.time();
    let picture = world.core.as_mut().unwrap().follow(now);
    world.pass(Micros(0));
    picture
}

/// The batches since this was last asked.
fn batches(world: &mut World) -> Vec<Arc<Batch>> {
    let news = std::mem::take(&mut world.news).into_iter();
    let batches = news.map(|news| match news {
        News::Batch(batch) => batch,
        News::Picture(_) => panic!("a picture"),
    });
    batches.collect()
}

/// What is told of the first relay.
fn values(batch: &Batch) -> Vec<(Option<PointValue>, PointQuality)> {
    let of_first = |reading: &&PointReading| reading.status.point == k(1);
    let readings = batch.points.iter().filter(of_first);
    let readings = readings.map(|reading| (reading.status.value, reading.status.quality));
    readings.collect()
}

fn is(on: bool) -> (Option<PointValue>, PointQuality) {
    (Some(PointValue::Bool(on)), PointQuality::Good)
}

#[test]
fn nothing_is_made_while_nobody_follows() {
    let mut world = oven();
    world.saw(OVEN, &Op::ReadOutputs, outputs(1));
    world.pass(ms(5_000));
    assert!(world.news.is_empty());
    follow(&mut world);
    world.saw(OVEN, &Op::ReadOutputs, outputs(4));
    assert_eq!(batches(&mut world).len(), 1);
    // As the driver says who finds nobody there.
    world.core.as_mut().unwrap().is_not_followed();
    world.saw(OVEN, &Op::ReadOutputs, outputs(2));
    world.pass(ms(5_000));
    assert!(world.news.is_empty());
}

#[test]
fn the_first_change_is_told_at_once_and_the_next_ones_together() {
    let mut world = oven();
    world.polls = false;
    let picture = follow(&mut world);
    assert_eq!(picture.points.len(), 8);
    assert_eq!((picture.modules.len(), picture.lines.len()), (1, 1));
    world.pass(ms(100));
    world.saw(OVEN, &Op::ReadOutputs, outputs(1));
    let told = batches(&mut world);
    assert_eq!(told.len(), 1, "at once");
    assert_eq!(values(&told[0]), [is(true)]);
    assert_eq!(told[0].points.len(), 1);
    assert_eq!(
        (told[0].seq, told[0].changes),
        (picture.seq + 1, picture.changes + 1)
    );
    for on in [0, 1, 0] {
        world.pass(ms(10));
        world.saw(OVEN, &Op::ReadOutputs, outputs(on));
    }
    assert!(batches(&mut world).is_empty());
    world.pass(ms(19));
    assert!(batches(&mut world).is_empty());
    let begun = world.time().wall;
    world.pass(ms(1));
    let told = batches(&mut world);
    assert_eq!(told.len(), 1);
    assert_eq!(values(&told[0]), [is(false), is(true), is(false)]);
    assert_eq!(told[0].changes, picture.changes + 4);
    let at = told[0].points[2].at;
    assert_eq!(begun.duration_since(at).unwrap(), Duration::from_millis(19));
    world.pass(ms(50));
    world.saw(OVEN, &Op::ReadOutputs, outputs(1));
    assert_eq!(batches(&mut world).len(), 1, "at once again");
}

#[test]
fn who_begins_to_follow_has_all_that_was_told_before() {
    let mut world = oven();
    world.polls = false;
    follow(&mut world);
    world.pass(ms(100));
    world.saw(OVEN, &Op::ReadOutputs, outputs(1));
    world.saw(OVEN, &Op::ReadOutputs, outputs(2));
    assert_eq!(batches(&mut world).len(), 1);
    let picture = follow(&mut world);
    assert_eq!(picture.points[0].value, Some(PointValue::Bool(false)));
    assert_eq!(picture.points[1].value, Some(PointValue::Bool(true)));
    let told = batches(&mut world);
    assert_eq!(told.len(), 1, "the others need not wait any longer");
    assert_eq!(told[0].seq, picture.seq);
    assert!(Arc::ptr_eq(&picture, &follow(&mut world)), "one for all");
    world.pass(ms(60));
    assert!(
        !Arc::ptr_eq(&picture, &follow(&mut world)),
        "but with their ages"
    );
}

#[test]
fn the_stream_tells_of_quality_ends_modules_and_lines() {
    let mut world = oven();
    follow(&mut world);
    let pulse = Pulse {
        width: Some(ms(1_000)),
        ..Pulse::default()
    };
    let all = |told: &[Arc<Batch>]| {
        told.iter()
            .flat_map(|batch| values(batch))
            .collect::<Vec<_>>()
    };
    let _ends = world.pulse("li", ("oven", 1), pulse);
    world.pass(ms(500));
    let told = batches(&mut world);
    let left = |batch: &Arc<Batch>| batch.points.last().map(|p| p.status.left.pulse.is_some());
    assert_eq!(told.iter().filter_map(left).next_back(), Some(true));
    world.pass(ms(1_500));
    let told = batches(&mut world);
    assert_eq!(told.iter().filter_map(left).next_back(), Some(false));
    world.polls = false;
    world.pass(ms(3_000));
    let stale = (Some(PointValue::Bool(false)), PointQuality::Stale);
    assert_eq!(all(&batches(&mut world)), [stale]);
    let gone = LineState::Absent(Arc::new(PortError::Gone));
    world.line(OVEN, &LineEvent::State(gone));
    let told = batches(&mut world);
    let absent = (
        Some(PointValue::Bool(false)),
        PointQuality::Bad(BadReason::LineAbsent),
    );
    assert_eq!(all(&told), [absent]);
    assert_eq!(told[0].lines.len(), 1);
    assert_eq!(
        told[0].figures[0].presence,
        Presence::Silent,
        "over no line"
    );
    world.line(OVEN, &LineEvent::State(LineState::Up));
    world.pass(ms(100));
    batches(&mut world);
    world.dead("oven", true);
    world.polls = true;
    world.pass(ms(300));
    let told = batches(&mut world);
    assert_eq!(
        told.iter().map(|batch| batch.modules.len()).sum::<usize>(),
        1
    );
}

/// A module that stores which outputs give pulses is asked; others give none of their own.
#[test]
fn it_is_told_when_it_is_known_which_outputs_give_pulses() {
    let text = TEXT.replace("erc8", "eda9060a");
    for (text, mask, is_asked) in [(&*text, 0, true), (&*text, 1, true), (TEXT, 0, false)] {
        let mut world = World::new(text, 1);
        world.polls = false;
        let picture = follow(&mut world);
        let outputs = |points: &[PointStatus]| {
            let outputs = points.iter().filter(|p| p.point.kind == PointKind::Output);
            let known = outputs.map(|output| (output.is_pulse_known, output.pulse.is_some()));
            known.collect::<Vec<_>>()
        };
        let before = outputs(&picture.points);
        assert!(before.iter().all(|known| *known == (!is_asked, false)));
        if is_asked {
            world.pass(ms(100));
            batches(&mut world);
            let width = PulseWidth::from_tenths(5).unwrap();
            world.saw(OVEN, &Op::ReadPulse, Observation::Pulse { mask, width });
            world.pass(ms(100));
            let told = batches(&mut world);
            let told = told.iter().flat_map(|batch| &batch.points);
            let told: Vec<_> = told.map(|reading| reading.status.clone()).collect();
            assert!(
                told.iter()
                    .all(|point| point.point.kind == PointKind::Output)
            );
            let told = outputs(&told);
            assert_eq!(told.len(), before.len(), "each of them once");
            assert_eq!(told[0], (true, mask == 1));
            assert!(told[1..].iter().all(|known| *known == (true, false)));
        }
    }
}

#[test]
fn another_configuration_is_another_picture() {
    let mut world = oven();
    follow(&mut world);
    let more = format!("{TEXT}[module.gate]\nline = \"main\"\nmodel = \"r55\"\naddress = 4\n");
    let reloaded = world.reload(&more, true);
    world.pass(ms(100));
    assert!(reloaded.now().is_some());
    let pictures: Vec<_> = world
        .news
        .iter()
        .filter_map(|news| match news {
            News::Picture(picture) => Some(picture.modules.len()),
            News::Batch(_) => None,
        })
        .collect();
    assert_eq!(pictures, [2]);
}

/// The names of what is told stand for the boards of the configuration that it has with it, also
/// while a reload waits for the disk.
#[test]
fn what_is_told_has_its_configuration_with_it() {
    let text = |oven: u8, pump: u8| {
        format!(
            "[line.main]\nport = \"/dev/ttyS9\"\n\
             [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = {oven}\n\
             [module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = {pump}\n"
        )
    };
    for after in (0..400).step_by(7) {
        let mut world = World::new(&text(3, 4), after);
        world.pass(ms(300));
        let on = world.write("li", ("oven", 1), true);
        world.pass(ms(300));
        assert!(on.now().is_ok());
        let pulse = Pulse {
            width: Some(ms(60_000)),
            ..Pulse::default()
        };
        world.pulse("li", ("pump", 2), pulse);
        world.pass(ms(300));
        follow(&mut world);
        world.pass(ms(after));
        world.disk_takes = Some(ms(1_500));
        world.reload(&text(4, 3), true);
        world.pass(ms(10_000));
        let mut is_other = false;
        for news in &world.news {
            let (config, points) = match news {
                News::Batch(batch) => {
                    let points = batch.points.iter().map(|point| &point.status);
                    (&batch.config, points.collect::<Vec<_>>())
                }
                News::Picture(picture) => (&picture.config, picture.points.iter().collect()),
            };
            let address = config.modules["oven"].setup.address.0;
            // The board at address 3 is the one whose first relay is on.
            for point in points {
                if let (Some(value), true) = (point.value, point.point == k(1)) {
                    let is_on = value == PointValue::Bool(true);
                    let is_first = (point.module == "oven") == (address == 3);
                    assert_eq!(is_on, is_first, "{after} ms, {point:?}");
                }
            }
            is_other |= address == 4;
        }
        assert!(is_other, "{after} ms");
    }
}
