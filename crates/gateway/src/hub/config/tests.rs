//! What may be wanted of a site, and how what it says is told.

use super::*;
use crate::hub::sites::tests::{CLOCK_S, three};
use serde_json::{Value, json};
use std::collections::BTreeMap;

const TEXT: &str = "[line.hall]\nport = \"/dev/ttyS1\"\n";

fn given(site: &str, wanted: SetSiteConfig) -> Result<GivenConfig, Problem> {
    GivenConfig::new(Lang::En, site.to_owned(), wanted, "li")
}

fn of_text(text: &str) -> SetSiteConfig {
    SetSiteConfig {
        text: text.to_owned(),
        ..SetSiteConfig::default()
    }
}

fn report(phase: ConfigPhaseKind) -> ConfigReport {
    ConfigReport {
        phase: phase.into(),
        version: 4,
        kept: 3,
        hash: vec![0xAB; 32],
        ..ConfigReport::default()
    }
}

/// What somebody wants who has seen no version, and looked at what has this hash.
fn looked_at(hash: &[u8]) -> GivenConfig {
    let wanted = SetSiteConfig {
        replaces: Some(hex(hash)).filter(|_| !hash.is_empty()),
        ..of_text(TEXT)
    };
    given("plant1", wanted).unwrap_or_else(|problem| panic!("{problem:?}"))
}

#[test]
fn what_can_be_no_configuration_is_refused_in_this_order() {
    let wrong = |site: &str, wanted: SetSiteConfig| {
        let problem = given(site, wanted).err();
        problem.map_or(json!(null), |problem| {
            serde_json::to_value(problem).unwrap()
        })
    };
    let own = "[outlet.hq]\ntype = \"fleet\"\n[audit]\n[module.oven]\nmodel = \"none\"\n";
    let long = "#".repeat(CONFIG_TEXT_MAX + 1);
    let all_wrong = SetSiteConfig {
        replaces: Some("xyz".to_owned()),
        ..of_text(&(own.to_owned() + &long))
    };
    let reason = |problem: &Value| problem["reason"].as_str().unwrap_or_default().to_owned();
    // Each time what was said last is right.
    let name = wrong("Plant7", all_wrong.clone());
    assert!(reason(&name).contains("a site's name"), "{name}");
    let length = wrong("plant7", all_wrong.clone());
    assert_eq!(reason(&length), "the configuration has more than 512 KiB");
    let replaces = wrong(
        "plant7",
        SetSiteConfig {
            text: own.to_owned(),
            ..all_wrong
        },
    );
    assert_eq!(reason(&replaces), "\"replaces\" can't be read");
    assert_eq!(
        [&name["code"], &length["code"], &replaces["code"]],
        [&json!("E0806"); 3]
    );
    let of_site = wrong("plant7", of_text(own));
    assert_eq!(
        (&of_site["code"], reason(&of_site).as_str()),
        (&json!("E0947"), "outlet audit")
    );
    let bad = wrong("plant7", of_text("[module.oven]\nmodel = \"none\"\n"));
    assert_eq!(bad["file"], "plant7.toml");
    let first = &bad["problems"][0];
    assert_eq!(
        (&first["line"], &first["column"], &first["path"]),
        (&json!(1), &json!(1), &json!("module.oven")),
        "{bad}"
    );
    let syntax = wrong("plant7", of_text("[line.hall]\nport =\n"));
    let first = &syntax["problems"][0];
    assert_eq!(
        (&first["line"], &first["code"]),
        (&json!(2), &json!("E0811"))
    );
    assert_eq!(wrong("plant7", of_text(TEXT)), json!(null));
    // All may be taken away.
    assert_eq!(wrong("plant7", of_text("")), json!(null));
    let fits = "#".repeat(CONFIG_TEXT_MAX);
    assert_eq!(wrong("plant7", of_text(&fits)), json!(null));
}

#[test]
fn the_tables_that_are_a_sites_own_are_named() {
    let text = "audit = true\nports.allow = []\nwebhooks = 1\n[webhook.a]\n[outlet]\n[history]\n\
                [rule.a]\n[sim]\n[group.b]\n";
    let own = ["audit", "ports", "webhooks", "webhook", "outlet", "history"];
    assert_eq!(own_tables(text), own);
    assert_eq!(own_tables(TEXT), Vec::<String>::new());
    assert_eq!(own_tables("[outlet"), Vec::<String>::new());
}

#[test]
fn a_hash_is_read_as_it_is_written() {
    let hash: Vec<u8> = (0..32).collect();
    assert_eq!(unhex(&hex(&hash)), Some(hash.clone()));
    assert_eq!(unhex(&hex(&hash).to_uppercase()), Some(hash));
    for wrong in ["", "00", &"0".repeat(63), &"+0".repeat(32), &"ä".repeat(32)] {
        assert_eq!(unhex(wrong), None, "{wrong}");
    }
}

#[test]
fn a_site_is_given_none_that_takes_none_or_has_its_own() {
    let centre = three();
    let views: BTreeMap<_, _> = centre
        .sites(Duration::from_secs(1_000))
        .map(|view| (view.name.to_owned(), view))
        .collect();
    let (here, away) = (&views["plant1"], &views["store"]);
    let code = |end: Result<u64, Problem>| end.map_err(|problem| problem.code);
    let given = looked_at(&[]);
    assert_eq!(code(given.may_go(Some(here))), Err("E0942".to_owned()));
    assert_eq!(code(given.may_go(Some(away))), Ok(0));
    assert_eq!(code(given.may_go(None)), Ok(0));
    let with = |given: &GivenConfig, report: ConfigReport| {
        let view = SiteView {
            config: Some(&report),
            ..here.clone()
        };
        code(given.may_go(Some(&view)))
    };
    let kept = report(ConfigPhaseKind::Current);
    assert_eq!(with(&given, kept.clone()), Ok(4));
    let local = ConfigReport {
        version: 3,
        kept: 7,
        is_local: true,
        ..report(ConfigPhaseKind::LocalChange)
    };
    assert_eq!(with(&given, local.clone()), Err("E0943".to_owned()));
    // Somebody has looked at it; or at what was there before.
    assert_eq!(with(&looked_at(&[0xAB; 32]), local.clone()), Ok(7));
    let earlier = looked_at(&[0xAC; 32]);
    assert_eq!(with(&earlier, local.clone()), Err("E0943".to_owned()));
    // Emptied at the site, or never filled.
    let emptied = ConfigReport {
        hash: part_hash(""),
        ..local
    };
    assert_eq!(with(&given, emptied.clone()), Err("E0943".to_owned()));
    let new = ConfigReport { kept: 0, ..emptied };
    assert_eq!(with(&given, new), Ok(3));
}

#[test]
fn who_has_seen_another_version_is_told_the_newest_one() {
    let seen = |seen: Option<u64>, newest: u64| {
        let wanted = SetSiteConfig {
            seen,
            ..of_text(TEXT)
        };
        let given = given("plant7", wanted).unwrap_or_else(|problem| panic!("{problem:?}"));
        given.conflict(newest)
    };
    assert_eq!(seen(None, 3), None);
    assert_eq!(seen(Some(3), 3), None);
    assert_eq!(seen(Some(0), 0), None);
    for (version, newest, etag) in [(2, 3, "3"), (0, 1, "1"), (1, 0, "0")] {
        let problem = seen(Some(version), newest).unwrap();
        assert_eq!((&*problem.code, problem.status), ("E0827", 412));
        assert_eq!(problem.text("file"), "plant7.toml");
        assert_eq!(problem.text("etag"), etag);
    }
}

#[test]
fn each_report_is_told_as_it_is() {
    let told = |report: &ConfigReport| {
        let state = state("plant7", report, Duration::from_millis(2_900));
        serde_json::to_value(state).unwrap()
    };
    let with = |phase: ConfigPhaseKind, reason: &str| ConfigReport {
        reason: reason.to_owned(),
        ..report(phase)
    };
    let plain = |phase: &str| {
        json!({
            "phase": phase, "version": 4, "kept": 3, "hash": "ab".repeat(32),
            "changed_at_site": false, "heard_ms": 2_900,
        })
    };
    for (phase, word) in [
        (ConfigPhaseKind::Unspecified, "other"),
        (ConfigPhaseKind::Unmanaged, "unmanaged"),
        (ConfigPhaseKind::Current, "current"),
        (ConfigPhaseKind::Pending, "pending"),
        (ConfigPhaseKind::Trying, "trying"),
        (ConfigPhaseKind::LocalChange, "local_change"),
    ] {
        let report = report(phase);
        assert_eq!(told(&report), plain(word));
        let brief = serde_json::to_value(brief(&report)).unwrap();
        assert_eq!(brief, json!({ "phase": word, "version": 4 }));
    }
    // One of a newer site.
    let newer = ConfigReport {
        phase: 99,
        ..report(ConfigPhaseKind::Current)
    };
    assert_eq!(told(&newer), plain("other"));
    let first = ConfigReport {
        phase: ConfigPhaseKind::Unmanaged.into(),
        hash: part_hash(""),
        is_local: true,
        ..ConfigReport::default()
    };
    let hash = hex(&part_hash(""));
    assert_eq!(
        told(&first),
        json!({
            "phase": "unmanaged", "hash": hash, "changed_at_site": true, "heard_ms": 2_900,
        })
    );
    let brief = serde_json::to_value(brief(&first)).unwrap();
    assert_eq!(brief, json!({ "phase": "unmanaged" }));

    let waits = told(&with(ConfigPhaseKind::Pending, "no storage space"));
    assert_eq!(waits["reason"], "no storage space");
    assert_eq!(waits.get("problem"), None);
    let back = told(&with(
        ConfigPhaseKind::RolledBack,
        "line hall is not open any more",
    ));
    assert_eq!(back["phase"], "rolled_back");
    assert_eq!(back["problem"]["code"], "E0944");
    assert_eq!(back["problem"]["reason"], "line hall is not open any more");
    assert_eq!(back.get("reason"), None);
    let refused = told(&with(ConfigPhaseKind::Refused, "it was changed"));
    assert_eq!(refused["phase"], "refused");
    assert_eq!(
        (&refused["problem"]["code"], &refused["problem"]["name"]),
        (&json!("E0943"), &json!("plant7"))
    );
    assert_eq!(refused["problem"]["reason"], "it was changed");
    let interrupted = told(&with(ConfigPhaseKind::Interrupted, "it was changed"));
    assert_eq!(
        (&interrupted["phase"], &interrupted["problem"]["code"]),
        (&json!("interrupted"), &json!("E0943"))
    );
    let silent = told(&with(ConfigPhaseKind::Refused, ""));
    assert_eq!(silent["problem"].get("reason"), None);
}

#[test]
fn the_problem_of_a_site_is_its_own() {
    let own = Problem::new(codes::PORT_NOT_ALLOWED)
        .with("port", "/dev/ttyS9")
        .with_hint("rm -rf /");
    let with = |problem: Vec<u8>| ConfigReport {
        reason: "the port is not allowed".to_owned(),
        problem,
        ..report(ConfigPhaseKind::Refused)
    };
    let told = state(
        "plant7",
        &with(serde_json::to_vec(&own).unwrap()),
        Duration::ZERO,
    );
    let problem = told.problem.unwrap();
    assert_eq!(problem.code, own.code);
    assert_eq!(problem.text("port"), "/dev/ttyS9");
    assert_eq!(problem.text(AT_SITE), "plant7");
    assert_eq!(
        problem.hint,
        Vec::<String>::new(),
        "commands are the centre's"
    );
    for none in ["{}", "[]", "{\"code\":\"E0301\"}", "\u{1}"] {
        let told = state("plant7", &with(none.as_bytes().to_vec()), Duration::ZERO);
        assert_eq!(told.problem.unwrap().code, "E0943", "{none}");
    }
}

#[test]
fn a_site_that_tells_no_configuration_says_why() {
    let told = |code: &str, reason: &str| {
        let refusal = FleetRefusal {
            code: code.to_owned(),
            reason: reason.to_owned(),
        };
        let problem = refused("plant7", &refusal);
        assert_eq!(problem.text("name"), "plant7");
        (problem.code.clone(), problem.text("reason"))
    };
    let is = |code: &str, reason: &str| (code.to_owned(), reason.to_owned());
    assert_eq!(told("E0942", "no key"), is("E0942", ""));
    // An older one.
    assert_eq!(told(codes::NO_SUCH_PAGE.code, ""), is("E0942", ""));
    assert_eq!(told("E0824", "gone"), is("E0824", "gone"));
    assert_eq!(told("E9999", "\u{1b}[2J"), is("E0168", "[2J"));
}

#[test]
fn what_was_wanted_is_told_with_its_text() {
    let told = wanted(ConfigDocument {
        site: "plant7".to_owned(),
        version: 3,
        text: TEXT.to_owned(),
        user: "li".to_owned(),
        at_ms: CLOCK_S * 1_000,
        replaces: vec![7; 32],
    });
    let at = moment(CLOCK_S * 1_000);
    assert_eq!(
        serde_json::to_value(told).unwrap(),
        json!({ "version": 3, "user": "li", "at": at, "text": TEXT })
    );
}
