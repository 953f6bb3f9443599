//! One rule in virtual time.

use crate::rule;
use jiff::Timestamp;
use jiff::tz::TimeZone;
use proptest::prelude::*;
use railbus_site::rules::{
    ACTS_PER_HOUR, Deadline, Fact, LATE_MAX_MS, Moment, Output, Phase, RuleEngine,
};
use railbus_wire::Micros;

const THEN: &str = "then = [{ notify = \"now\" }]";

/// Both clocks, so many milliseconds after the beginning.
const fn at(ms: u64) -> Moment {
    Moment {
        steady: Micros::from_millis(ms),
        wall: 1_800_000_000_000 + ms as i64,
    }
}

fn engine(when: &str) -> RuleEngine {
    RuleEngine::new(&rule(&format!("{when}\n{THEN}")), TimeZone::UTC)
}

/// How often it acts at a moment.
fn acts(engine: &mut RuleEngine, ms: u64) -> usize {
    let mut count = 0;
    while engine.poll(at(ms)) == Output::Act {
        count += 1;
    }
    count
}

#[test]
fn it_acts_once_when_the_condition_has_held_long_enough() {
    let mut engine = engine("when = { point = \"oven.k1\", is = true }\nfor = \"30s\"");
    assert_eq!(engine.poll(at(0)), Output::Wait(None));
    engine.handle(at(1_000), Fact::Is(true));
    let due = Output::Wait(Some(Deadline::Steady(Micros::from_secs(31))));
    assert_eq!(engine.poll(at(1_000)), due);
    engine.handle(at(20_000), Fact::Is(true));
    assert_eq!(
        engine.poll(at(30_999)),
        due,
        "that it holds still is nothing new"
    );
    assert_eq!(acts(&mut engine, 31_000), 1);
    assert_eq!(acts(&mut engine, 90_000), 0);
    engine.handle(at(91_000), Fact::Is(false));
    engine.handle(at(92_000), Fact::Is(true));
    assert_eq!(acts(&mut engine, 121_999), 0);
    assert_eq!(acts(&mut engine, 122_000), 1);
}

#[test]
fn what_is_not_known_fulfils_nothing_and_is_no_end_either() {
    let mut engine = engine("when = { point = \"oven.k1\", is = false }\nfor = \"10s\"");
    engine.handle(at(0), Fact::Is(false));
    engine.handle(at(9_999), Fact::Unknown);
    assert_eq!(
        acts(&mut engine, 60_000),
        0,
        "it was not known to hold for long enough"
    );
    engine.handle(at(60_000), Fact::Is(false));
    assert_eq!(acts(&mut engine, 69_999), 0);
    assert_eq!(acts(&mut engine, 70_000), 1);
    engine.handle(at(71_000), Fact::Unknown);
    engine.handle(at(72_000), Fact::Is(false));
    assert_eq!(
        acts(&mut engine, 90_000),
        0,
        "it is not known to have ceased"
    );
}

#[test]
fn a_value_comes_back_by_its_hysteresis() {
    let when = "when = { point = \"tank.ai1\", below = 1.0, hysteresis = 0.5 }";
    let mut engine = engine(when);
    let mut after = |ms, value| {
        engine.handle(at(ms), Fact::Value(value));
        acts(&mut engine, ms)
    };
    assert_eq!(after(0, 1.0), 0, "the limit itself is on neither side");
    assert_eq!(after(10_000, 0.9), 1);
    assert_eq!(after(20_000, 1.4), 0);
    assert_eq!(after(30_000, 0.9), 0, "it has not come back");
    assert_eq!(after(40_000, 1.5), 0);
    assert_eq!(after(50_000, 0.9), 1);
}

#[test]
fn two_rules_that_undo_each_other_come_to_rest() {
    let mut off = engine("when = { point = \"oven.k1\", is = true }");
    let mut on = engine("when = { point = \"oven.k1\", is = false }");
    let (mut is, mut switched, mut stopped) = (true, 0, 0);
    for ms in (0..600_000).step_by(10) {
        off.handle(at(ms), Fact::Is(is));
        on.handle(at(ms), Fact::Is(is));
        for (engine, to) in [(&mut off, false), (&mut on, true)] {
            loop {
                match engine.poll(at(ms)) {
                    Output::Act => (is, switched) = (to, switched + 1),
                    Output::Stop => stopped += 1,
                    Output::Wait(_) => break,
                }
            }
        }
    }
    assert_eq!(stopped, 1, "one is enough");
    assert_eq!(switched, 2 * ACTS_PER_HOUR);
    let stopped = [off, on].map(|engine| engine.phase() == Phase::Stopped);
    assert!(stopped.contains(&true));
}

#[test]
fn a_time_of_day_comes_by_the_wall_clock_and_is_left_out_when_slept_through() {
    let mut engine = engine("when = { time = \"06:30\" }");
    let wall = |text: &str| text.parse::<Timestamp>().unwrap().as_millisecond();
    let moment = |text: &str| Moment {
        steady: Micros(0),
        wall: wall(text),
    };
    let next = |text| Output::Wait(Some(Deadline::Wall(wall(text))));
    let poll = |engine: &mut RuleEngine, now: &str| engine.poll(moment(now));
    let first = next("2026-11-22T06:30:00Z");
    assert_eq!(poll(&mut engine, "2026-11-22T06:00:00Z"), first);
    assert_eq!(poll(&mut engine, "2026-11-22T06:30:00Z"), Output::Act);
    let second = next("2026-11-23T06:30:00Z");
    assert_eq!(poll(&mut engine, "2026-11-22T06:30:00Z"), second);
    // Put back by an hour: it is not so late a second time.
    assert_eq!(poll(&mut engine, "2026-11-22T06:29:30Z"), second);
    // A machine that stood still for an hour.
    let third = next("2026-11-24T06:30:00Z");
    assert_eq!(poll(&mut engine, "2026-11-23T07:30:00Z"), third);
    // A clock that was years ahead and is set right.
    assert_eq!(
        poll(&mut engine, "2020-01-01T00:00:00Z"),
        next("2020-01-01T06:30:00Z")
    );
    let late = Moment {
        steady: Micros(0),
        wall: wall("2020-01-01T06:30:00Z") + LATE_MAX_MS,
    };
    assert_eq!(
        engine.poll(late),
        Output::Act,
        "a little late is not too late"
    );
}

/// What may be known, and for how long: so many tenths of a second.
fn known() -> impl Strategy<Value = Vec<(u8, u64)>> {
    proptest::collection::vec((0_u8..3, 1_u64..40), 1..200)
}

proptest! {
    /// Whatever happens, and however often it is asked in between: a rule acts only when its
    /// condition was known to hold for so long without a break, never twice without its having
    /// ceased, and no more often than it may.
    #[test]
    fn a_rule_never_acts_on_what_is_not_known(
        steps in known(), hold in 0_u64..30, ask in 1_u64..7
    ) {
        let text = "when = { point = \"oven.k1\", is = true }\nfor";
        let text = format!("{text} = \"{}ms\"", hold * 100);
        let mut engine = engine(&text);
        let (mut now, mut held_since, mut ready) = (0_u64, None, true);
        let (mut acted, mut stopped): (Vec<u64>, bool) = (Vec::new(), false);
        for (what, length) in steps {
            let fact = [Fact::Is(true), Fact::Is(false), Fact::Unknown][usize::from(what)];
            engine.handle(at(now * 100), fact);
            held_since = (fact == Fact::Is(true)).then(|| held_since.unwrap_or(now));
            ready |= fact == Fact::Is(false);
            let end = now + length;
            while now < end {
                loop {
                    match engine.poll(at(now * 100)) {
                        Output::Act => {
                            prop_assert!(ready && !stopped);
                            prop_assert!(held_since.is_some_and(|since| now >= since + hold));
                            prop_assert!(acted.last().is_none_or(|last| now >= last + 10));
                            acted.push(now);
                            ready = false;
                        }
                        Output::Stop => stopped = true,
                        Output::Wait(deadline) => {
                            let rested = acted.last().is_none_or(|last| now >= last + 10);
                            let due = held_since.is_some_and(|since| now >= since + hold);
                            let missed = ready && due && rested && !stopped;
                            prop_assert!(!missed, "it missed its time");
                            if let Some(Deadline::Steady(due)) = deadline {
                                prop_assert!(due > at(now * 100).steady);
                            }
                            break;
                        }
                    }
                }
                now += ask.min(end - now);
            }
        }
        prop_assert!(acted.len() <= ACTS_PER_HOUR);
    }
}
