//! Rules at a line.

use super::super::*;
use super::world::{World, bit, ms};
use crate::rules::Phase;
use jiff::Timestamp;
use railbus_store::history::Event;

const NIGHT: &str = "[rule.night]\nwhen = { point = \"oven.k1\", is = true }\nfor = \"300ms\"\n\
    then = [{ set = \"yard.k2\", to = true }, { notify = \"night\" }]\narmed = true\n";

fn named(oven: u8, yard: u8, more: &str) -> String {
    format!(
        "[line.main]\nport = \"/dev/ttyS9\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = {oven}\nmax_age = \"2s\"\n\
         [module.yard]\nline = \"main\"\nmodel = \"erc8\"\naddress = {yard}\n{more}"
    )
}

/// Rules at work over modules that were read.
fn site(rules: &str) -> World {
    let mut world = World::new(&named(3, 4, rules), 1);
    world.pass(ms(300));
    world.run_rules();
    world.events.clear();
    world
}

impl World {
    fn phase(&mut self, id: &str) -> Option<Phase> {
        let rules = self.state().rules_now();
        rules.into_iter().find(|rule| rule.id == id).unwrap().phase
    }

    /// What rules told since this was last asked.
    fn told(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    /// The same, by rule and code.
    fn codes(&mut self) -> Vec<String> {
        let code = |event: Event| {
            let who = event.who.unwrap();
            format!("{} {}", who.replace("rule:", ""), event.code.unwrap())
        };
        self.told().into_iter().map(code).collect()
    }

    /// What was written down of commands of rules, and how it ended.
    fn by_rules(&self) -> Vec<(&str, &str, Option<&str>)> {
        let each = self.log.iter();
        each.map(|entry| (&*entry.who, &*entry.what, entry.ended.map(|(_, end)| end)))
            .collect()
    }
}

#[test]
fn a_rule_acts_in_its_own_name_when_its_time_is_over_and_once() {
    let mut world = site(NIGHT);
    assert_eq!(world.phase("night"), Some(Phase::Resting));
    world.reads("oven", 1, world.now);
    let since = world.time().site;
    assert_eq!(world.phase("night"), Some(Phase::Holding(since)));
    world.polls = false;
    world.pass(ms(300) - Micros(1));
    assert_eq!(world.told(), []);
    world.pass(Micros(1));
    let told = world.told();
    let [fired] = &told[..] else {
        panic!("{told:?}");
    };
    let of = |text: &Option<String>| text.clone().unwrap_or_default();
    assert_eq!(
        [&fired.code, &fired.who, &fired.via, &fired.what].map(of),
        ["rule_fired", "rule:night", "program", "yard.k2=on, notify"]
    );
    assert_eq!([&fired.module, &fired.point].map(of), ["oven", "k1"]);
    world.pass(ms(1_000));
    let notice = world.told();
    assert_eq!(of(&notice[0].code) + &of(&notice[0].text), "notifynight");
    assert_eq!(notice.len(), 1);
    assert_eq!(world.relays("yard"), bit(2));
    let written = [("rule:night", "k2=on", Some("readback"))];
    assert_eq!(world.by_rules(), written);
    assert_eq!(world.phase("night"), Some(Phase::Acted));
    // Again only once it was seen to have ended.
    world.reads("oven", 1, world.now);
    world.pass(ms(1_000));
    assert_eq!(world.codes(), [""; 0]);
    world.reads("oven", 0, world.now);
    world.reads("oven", 1, world.now);
    world.pass(ms(1_000));
    assert_eq!(world.codes(), ["night rule_fired", "night notify"]);
    let status = world.state().rules_now().remove(0);
    assert_eq!((status.count, status.is_known), (2, true));
}

/// In the very moment in which the time is over the value is too old.
#[test]
fn what_is_not_known_any_more_does_not_act() {
    for late in [0, 1] {
        let mut world = site(&NIGHT.replace("300ms", "2s"));
        world.polls = false;
        let asked = world.now - Micros(late);
        world.reads("oven", 1, asked);
        // It is two seconds old then, or one microsecond more.
        world.pass(ms(2_000));
        match late {
            0 => assert_eq!(world.codes(), ["night rule_fired"]),
            _ => {
                assert_eq!(world.codes(), [""; 0]);
                assert_eq!(world.phase("night"), Some(Phase::Resting));
            }
        }
    }
}

#[test]
fn what_holds_for_everybody_holds_for_a_rule() {
    let mut world = site(&format!(
        "[module.yard.point]\nk2.locked = true\n{}",
        NIGHT.replace(
            "{ notify",
            "{ pulse = \"yard.k3\", width = \"1s\" }, { notify"
        )
    ));
    world.move_by_hand("oven", 1);
    world.pass(ms(1_000));
    let told = world.told();
    let each = told.iter().map(|event| {
        let end = event.end.clone().unwrap_or_default();
        let point = event.point.clone().unwrap_or_default();
        format!("{} {point} {end}", event.code.as_deref().unwrap())
    });
    assert_eq!(
        each.collect::<Vec<_>>(),
        [
            "rule_fired k1 ",
            "rule_failed k2 locked",
            "rule_failed k3 not_tried",
            "notify k1 ",
        ],
        "who is to be told is told all the same"
    );
    assert_eq!(world.acted.len(), 0);
}

#[test]
fn a_module_that_is_lost_is_known_to_be_and_its_points_are_not() {
    let mut world = site(
        "[rule.lost]\nwhen = { module_offline = \"oven\" }\nfor = \"100ms\"\n\
         then = [{ notify = \"lost\" }]\narmed = true\n\
         [rule.off]\nwhen = { point = \"oven.k1\", is = false }\nfor = \"20s\"\n\
         then = [{ notify = \"off\" }]\narmed = true\n",
    );
    let is_holding = |world: &mut World, id| matches!(world.phase(id), Some(Phase::Holding(_)));
    assert!(is_holding(&mut world, "off") && !is_holding(&mut world, "lost"));
    world.dead("oven", true);
    world.pass(ms(250));
    assert!(!is_holding(&mut world, "off") && is_holding(&mut world, "lost"));
    world.pass(ms(30_000));
    assert_eq!(world.codes(), ["lost rule_fired", "lost notify"]);
    world.dead("oven", false);
    world.pass(ms(250));
    assert!(is_holding(&mut world, "off"));
    assert_eq!(world.phase("lost"), Some(Phase::Resting));
}

/// Nobody knows how a line is that another program has.
#[test]
fn a_line_that_is_lent_is_neither_here_nor_gone() {
    let gone = "[rule.gone]\nwhen = { line_offline = \"main\" }\nfor = \"10s\"\n\
        then = [{ notify = \"gone\" }]\narmed = true\n";
    let mut world = site(gone);
    world.unplug("/dev/ttyS9", true);
    let since = world.time().site;
    assert_eq!(world.phase("gone"), Some(Phase::Holding(since)));
    world.pass(ms(9_000));
    let lent = world.lend("main");
    assert_eq!(world.phase("gone"), Some(Phase::Resting), "from then on");
    world.pass(ms(20_000));
    let (_, lent) = lent.get().unwrap();
    assert_eq!(world.codes(), [""; 0]);
    world.give_back("main", lent.unwrap().loan, None);
    world.pass(ms(9_000));
    assert_eq!(world.codes(), [""; 0]);
    world.pass(ms(2_000));
    assert_eq!(world.codes(), ["gone rule_fired", "gone notify"]);
}

#[test]
fn another_configuration_leaves_running_delays_alone() {
    let long = NIGHT.replace("300ms", "600s");
    let mut world = site(&long);
    world.move_by_hand("oven", 1);
    world.pass(ms(300));
    let holding = world.phase("night");
    assert!(matches!(holding, Some(Phase::Holding(_))), "{holding:?}");
    let more = "[rule.other]\nwhen = { time = \"06:30\" }\nthen = [{ notify = \"x\" }]\n";
    let reload = |world: &mut World, rules: &str| {
        let end = world.reload(&named(3, 4, rules), true);
        world.pass(ms(100));
        assert!(end.now().is_some());
    };
    reload(&mut world, &format!("{long}{more}"));
    assert_eq!(world.phase("night"), holding);
    assert_eq!(world.phase("other"), None, "not armed");
    // What is not stopped is not begun anew.
    let now = world.time();
    let core = world.core.as_mut().unwrap();
    core.change(now, |state| state.rules.begin_anew("night", now.site));
    assert_eq!(world.phase("night"), holding);
    // Another name is not another rule; another time is.
    reload(&mut world, &format!("{long}name = \"Night\"\n"));
    assert_eq!(world.phase("night"), holding);
    reload(&mut world, &long.replace("600s", "601s"));
    let other = world.phase("night");
    assert!(matches!(other, Some(Phase::Holding(_))), "{other:?}");
    assert_ne!(other, holding);
    reload(&mut world, &long.replace("armed = true", "armed = false"));
    assert_eq!(world.phase("night"), None);
    world.pass(ms(700_000));
    assert_eq!(world.codes(), [""; 0]);
}

/// The rule is another one from the same step on as the names.
#[test]
fn a_rule_does_not_act_on_what_another_board_was() {
    let rule = NIGHT.replace("300ms", "0s");
    for after in 0..40 {
        let mut world = site(&rule.replace("oven.k1", "yard.k1"));
        world.move_by_hand("oven", 1);
        world.pass(ms(300));
        // The board at 3 has its k1 on, and gets the name that the rule waits for.
        let end = world.reload(&named(4, 3, &rule.replace("oven.k1", "yard.k1")), true);
        world.pass(ms(after));
        let is_named = end.get().is_some();
        if !is_named {
            assert_eq!(world.codes(), [""; 0], "after {after}");
        }
        world.pass(ms(2_000));
        assert_eq!(world.codes(), ["night rule_fired", "night notify"]);
        assert_eq!(world.relays_at("/dev/ttyS9", 3), 0b11, "after {after}");
    }
}

/// What a rule began at one board it does not go on with at another that gets the name of the next.
#[test]
fn an_act_does_not_go_on_at_a_board_that_gets_the_name() {
    let gate = "[module.gate]\nline = \"main\"\nmodel = \"erc8\"\naddress = 7\n";
    for next in [
        "{ set = \"yard.k4\", to = true }",
        "{ pulse = \"yard.k4\", width = \"1s\" }",
    ] {
        let then = format!("then = [{{ set = \"gate.k2\", to = true }}, {next}]");
        let when = "when = { point = \"gate.k1\", is = true }";
        let more = format!("{gate}[rule.night]\n{when}\n{then}\narmed = true\n");
        let mut ways = BTreeSet::new();
        for after in (0..300).step_by(5) {
            let mut world = site(&more);
            world.polls = false;
            world.disk_takes = Some(ms(2));
            world.hold_line(ms(150));
            world.reads("gate", 1, world.now);
            world.pass(ms(after));
            world.reload(&named(4, 3, &more), true);
            world.pass(ms(4_000));
            let acted = world.acted.iter().map(|acted| acted.seat.1);
            let acted: BTreeSet<u8> = acted.collect();
            assert!(!acted.contains(&3), "{next} after {after}: {acted:?}");
            assert!(acted.contains(&7), "{next} after {after}: {acted:?}");
            assert!(world.state().is_at_rest(), "{next} after {after}");
            ways.insert(acted);
        }
        assert_eq!(
            ways.len(),
            2,
            "before the reload, and cut short by it: {ways:?}"
        );
    }
}

#[test]
fn an_act_that_is_in_progress_is_not_begun_again() {
    let mut world = site(&NIGHT.replace("300ms", "0s"));
    world.hold_line(ms(4_000));
    world.polls = false;
    for relays in [1, 0] {
        world.reads("oven", relays, world.now);
    }
    assert_eq!(world.codes(), ["night rule_fired"]);
    world.pass(ms(1_500));
    world.reads("oven", 1, world.now);
    let told = world.told();
    assert_eq!(told[0].code.as_deref(), Some("rule_failed"));
    assert_eq!(told[0].text.as_deref(), Some("busy"));
    assert_eq!(world.state().rules_now()[0].count, 1, "it acted once");
    world.pass(ms(4_000));
    assert_eq!(world.codes(), ["night notify"]);
    assert_eq!(world.acted.len(), 1);
    // It has ended, and may be begun again.
    for relays in [0, 1] {
        world.reads("oven", relays, world.now);
    }
    world.pass(ms(1_000));
    assert_eq!(world.codes(), ["night rule_fired", "night notify"]);
}

#[test]
fn rules_that_swing_act_once_a_second_and_are_stopped() {
    let mut world = site(
        "[rule.off]\nwhen = { point = \"oven.k1\", is = true }\n\
         then = [{ set = \"oven.k1\", to = false }]\narmed = true\n\
         [rule.on]\nwhen = { point = \"oven.k1\", is = false }\n\
         then = [{ set = \"oven.k1\", to = true }]\narmed = true\n",
    );
    world.pass(ms(10_000));
    let fired = world.codes();
    let of = |id: &str| fired.iter().filter(|code| code.starts_with(id)).count();
    assert!((9..=11).contains(&of("on ")), "{fired:?}");
    assert!((9..=11).contains(&of("off ")), "{fired:?}");
    world.pass(ms(200_000));
    let stopped = world.codes();
    let stops = stopped.iter().filter(|code| code.ends_with("rule_stopped"));
    let stops: Vec<_> = stops.collect();
    assert_eq!(stops, ["on rule_stopped"], "the other has nothing to undo");
    assert_eq!(world.phase("on"), Some(Phase::Stopped));
    let status = world.state().rules_now().remove(1);
    assert_eq!((&*status.id, status.count), ("on", 60));
    // Until somebody says otherwise.
    let now = world.time();
    let core = world.core.as_mut().unwrap();
    core.change(now, |state| state.rules.begin_anew("off", now.site));
    assert_eq!(world.phase("on"), Some(Phase::Stopped));
    let core = world.core.as_mut().unwrap();
    core.change(now, |state| state.rules.begin_anew("on", now.site));
    world.pass(ms(500));
    assert_eq!(
        world.codes().first().map(String::as_str),
        Some("on rule_fired")
    );
}

/// The clock of the world begins at 13:46:40.
#[test]
fn a_time_of_day_is_that_of_the_clock_on_the_wall_however_that_is_set() {
    let mut world = site(
        "[rule.two]\nwhen = { time = \"14:00\" }\n\
         then = [{ set = \"yard.k2\", to = true }]\narmed = true\n",
    );
    world.polls = false;
    let two: Timestamp = "1970-01-12T14:00:00Z".parse().unwrap();
    let status = world.state().rules_now().remove(0);
    let next = Some(two.as_millisecond());
    assert_eq!((status.next, status.is_known), (next, true));
    world.pass(ms(800_000) - world.now - Micros(1));
    assert_eq!(world.codes(), [""; 0]);
    // It is set back by half an hour, which counts as much.
    world.wall_behind = ms(1_800_000);
    world.pass(ms(1_800_000));
    assert_eq!(world.codes(), [""; 0]);
    world.pass(Micros(1));
    assert_eq!(world.codes(), ["two rule_fired"]);
}

/// A time of day that is passed over is kept for a minute, and noticed within half of one.
#[test]
fn a_time_of_day_that_the_clock_is_set_over_is_skipped_if_that_is_too_far() {
    let rule = "[rule.two]\nwhen = { time = \"14:00\" }\n\
         then = [{ set = \"yard.k2\", to = true }]\narmed = true\n";
    for (over, codes) in [(20, &["two rule_fired"][..]), (61, &[])] {
        let mut world = World::new(&named(3, 4, rule), 1);
        world.polls = false;
        world.wall_behind = ms(3_600_000);
        world.pass(ms(300));
        world.run_rules();
        world.pass(ms(40_000) - world.now);
        assert_eq!(world.codes(), [""; 0]);
        // From 12:47:20 to so many seconds after two.
        world.pass(ms(2_000_000));
        world.wall_behind = world.now - ms(800_000 + over * 1_000);
        world.pass(ms(31_000));
        assert_eq!(world.codes(), codes);
    }
}

/// A site that ends begins nothing, however long that takes.
#[test]
fn no_rule_acts_while_the_site_ends() {
    let mut world = site(&NIGHT.replace("300ms", "0s"));
    let width = Some(ms(10_000));
    let pulse = Pulse {
        width,
        ..Pulse::default()
    };
    world.pulse("mara", ("yard", 5), pulse);
    world.pass(ms(500));
    world.hold_line(ms(1_000));
    let closed = world.close();
    world.pass(ms(500));
    assert!(closed.get().is_none());
    world.reads("oven", 1, world.now);
    world.pass(ms(3_000));
    assert_eq!(world.codes(), [""; 0]);
    assert!(closed.get().is_some());
    assert_eq!(world.core.as_ref().unwrap().deadline(), None);
}

#[test]
fn each_rule_has_its_own_time() {
    let [soon, late] = [("soon", "300ms"), ("late", "900ms")]
        .map(|(id, time)| NIGHT.replace("night", id).replace("300ms", time));
    let mut world = site(&(late + &soon));
    world.polls = false;
    world.reads("oven", 1, world.now);
    world.pass(ms(300));
    assert_eq!(world.codes(), ["soon rule_fired"]);
    world.pass(ms(600));
    assert_eq!(world.codes(), ["soon notify", "late rule_fired"]);
}

/// A port that can't be opened is known to be gone when the rules begin.
#[test]
fn what_is_known_before_the_rules_begin_counts() {
    let gone = "[rule.gone]\nwhen = { line_offline = \"main\" }\nfor = \"1s\"\n\
        then = [{ notify = \"gone\" }]\narmed = true\n";
    let mut world = World::new(&named(3, 4, gone), 1);
    world.unplug("/dev/ttyS9", true);
    world.pass(ms(5_000));
    assert_eq!(world.codes(), [""; 0], "nobody has them act");
    world.run_rules();
    world.pass(ms(1_000));
    assert_eq!(world.codes(), ["gone rule_fired", "gone notify"]);
}
