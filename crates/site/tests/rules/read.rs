//! What a rule may say.

use crate::{rule, site};
use railbus_site::Config;
use railbus_site::config::change::{put, rename};
use railbus_site::config::{Action, Clock, Limit, RULES_MAX, When};
use railbus_wire::Micros;

const THEN: &str = "then = [{ notify = \"now\" }]";

#[test]
fn every_condition_and_action_is_read() {
    let tank = rule(
        "name = { en = \"Full\", zh = \"满\" }\n\
         when = { point = \"tank.ai1\", above = 4.2, hysteresis = 0.5, unit = \"m\" }\n\
         for = \"30s\"\n\
         then = [{ set = \"oven.k1\", to = false }, { pulse = \"pump.do0\" }, \
         { pulse = \"oven.k2\", width = \"2s\" }, { notify = \"full\" }]\narmed = true",
    );
    let limit = Limit {
        above: true,
        value: 4.2,
        hysteresis: 0.5,
    };
    assert!(matches!(tank.when, When::Analog(_, found) if found == limit));
    assert_eq!((tank.hold, tank.armed), (Micros::from_secs(30), true));
    assert!(matches!(&tank.then[..], [
        Action::Set(oven, false),
        Action::Pulse(pump, None),
        Action::Pulse(_, Some(Micros(2_000_000))),
        Action::Notify(text),
    ] if oven.module == "oven" && pump.module == "pump" && text == "full"));
    let clock = rule(&format!(
        "when = {{ time = \"06:30\", days = [\"sun\", \"mon\"] }}\n{THEN}"
    ));
    let When::Clock(at) = clock.when else {
        panic!("{clock:?}");
    };
    assert_eq!((at.hour, at.minute, at.days()), (6, 30, vec!["mon", "sun"]));
    assert!(!clock.armed, "a rule is armed by somebody");
    let daily = rule(&format!("when = {{ time = \"00:00\" }}\n{THEN}"));
    assert!(matches!(
        daily.when,
        When::Clock(Clock {
            days: Clock::DAILY,
            ..
        })
    ));
    for (text, wanted) in [
        (
            "{ module_offline = \"oven\" }",
            When::ModuleOffline("oven".to_owned()),
        ),
        (
            "{ line_offline = \"main\" }",
            When::LineOffline("main".to_owned()),
        ),
    ] {
        assert_eq!(
            rule(&format!("when = {text}\nfor = \"5m\"\n{THEN}")).when,
            wanted
        );
    }
}

/// The code of the first problem, and its column.
fn first(text: &str) -> (&'static str, usize) {
    let problems = Config::parse(&site(text)).unwrap_err();
    (problems[0].kind.code(), problems[0].column)
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    let when = |when: &str| first(&format!("when = {when}\n{THEN}"));
    assert_eq!(when("{ point = \"oven.k1\" }"), ("E0871", 8));
    assert_eq!(when("{ point = \"oven.k1\", above = 1 }"), ("E0871", 8));
    assert_eq!(when("{ point = \"tank.ai1\", is = true }"), ("E0871", 8));
    assert_eq!(when("{ point = \"oven.k9\", is = true }"), ("E0821", 18));
    assert_eq!(
        when("{ point = \"tank.ai1\", above = 1, below = 2 }"),
        ("E0871", 8)
    );
    assert_eq!(
        when("{ point = \"tank.ai1\", above = 1, unit = \"V\" }"),
        ("E0874", 48)
    );
    assert_eq!(when("{ point = \"tank.ai1\", above = nan }"), ("E0871", 38));
    assert_eq!(when("{ time = \"24:00\" }"), ("E0871", 17));
    assert_eq!(
        when("{ time = \"06:30\", days = [\"monday\"] }"),
        ("E0815", 34)
    );
    assert_eq!(when("{ time = \"06:30\", is = true }"), ("E0871", 8));
    assert_eq!(when("{ module_offline = \"open\" }"), ("E0801", 27));
    assert_eq!(when("{ line_offline = \"yard\" }"), ("E0820", 25));
    assert_eq!(when("{ line_ofline = \"main\" }"), ("E0812", 10));
    let held = "when = { time = \"06:30\" }\nfor = \"1s\"";
    assert_eq!(first(&format!("{held}\n{THEN}")), ("E0871", 7));
    let then = |then: &str| first(&format!("when = {{ time = \"06:30\" }}\nthen = {then}"));
    assert_eq!(then("[]"), ("E0872", 8));
    assert_eq!(then("[{ set = \"oven.k1\" }]"), ("E0872", 9));
    assert_eq!(then("[{ set = \"tank.ai1\", to = true }]"), ("E0865", 17));
    assert_eq!(then("[{ set = \"oven.k8\", to = true }]"), ("E0873", 17));
    assert_eq!(
        then("[{ pulse = \"oven.k8\", width = \"1s\" }]"),
        ("E0873", 19)
    );
    assert_eq!(then("[{ pulse = \"oven.k1\" }]"), ("E0813", 9));
    assert_eq!(
        then("[{ pulse = \"oven.k1\", width = \"5h\" }]"),
        ("E0868", 38)
    );
    assert_eq!(then("[{ notify = \" \" }]"), ("E0872", 20));
    let nine = ["{ notify = \"x\" }"; 9].join(", ");
    assert_eq!(then(&format!("[{nine}]")), ("E0868", 8));
    let one = |id| format!("[rule.r{id}]\nwhen = {{ time = \"06:30\" }}\n{THEN}\n");
    let many = |count: usize| (0..count).map(one).collect::<String>();
    assert!(Config::parse(&many(RULES_MAX)).is_ok());
    assert_eq!(
        Config::parse(&many(RULES_MAX + 1)).unwrap_err()[0]
            .kind
            .code(),
        "E0868"
    );
}

#[test]
fn a_rule_goes_with_what_it_names() {
    let text = site(
        "when = { module_offline = \"oven\" } # lost\nfor = \"30s\"\n\
         then = [{ set = \"oven.k1\", to = true }, { notify = \"oven\" }]",
    );
    let renamed = rename(&text, "module", "oven", "stove").unwrap();
    let wanted = text
        .replace("[module.oven", "[module.stove")
        .replace("oven.k1", "stove.k1")
        .replace("module_offline = \"oven\"", "module_offline = \"stove\"");
    assert_eq!(renamed, wanted);
    let text = site(&format!("when = {{ line_offline = \"main\" }}\n{THEN}"));
    let renamed = rename(&text, "line", "main", "south").unwrap();
    assert!(Config::parse(&renamed).is_ok(), "{renamed}");
}

#[test]
fn a_rule_is_written_as_a_person_would() {
    let keys = serde_json::json!({
        "then": [{ "set": "oven.k1", "to": true }], "for_ms": 30_000,
        "when": { "point": "tank.ai1", "above": 4.5 }, "armed": true,
    });
    let text = put(crate::SITE, &["rule", "full"], keys.as_object().unwrap()).unwrap();
    let wanted = "\n[rule.full]\nwhen = { point = \"tank.ai1\", above = 4.5 }\nfor = \"30s\"\n\
                  then = [{ set = \"oven.k1\", to = true }]\narmed = true\n";
    assert!(text.ends_with(wanted), "{text}");
    assert!(Config::parse(&text).is_ok());
}
