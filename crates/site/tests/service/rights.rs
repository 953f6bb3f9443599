//! Whichever interface something comes through, the site asks whether the caller may do it.

use crate::board::k;
use crate::sending::frame;
use crate::several::set;
use railbus_site::{
    BatchTerms, CommandError, Config, GroupState, LeaseTerms, Pulse, RawTerms, ReloadError, Rights,
    Role, Service, ToggleTerms, WriteTerms,
};
use railbus_store::audit::{End, Origin};
use railbus_wire::{Address, Exchange, Micros, rtu};
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::path::Path;
use std::sync::Arc;

const TEXT: &str = r#"
[line.main]
port = "/dev/railbus-test-nothing-here"
[module.oven]
line = "main"
model = "erc8"
address = 3
[group.heat]
members = ["oven.k1", "oven.k2"]
[scene.heat]
steps = [{ set = "oven.k1", to = true }, { wait = "1ms" }, { set = "oven.k2", to = true }]
"#;

/// Every command, by its name, and how it ended.
async fn all(service: &Service) -> Vec<(&'static str, Result<(), CommandError>)> {
    let second = Micros::from_secs(1);
    let both = [(k(1), true), (k(2), true)];
    let terms = BatchTerms::default();
    let batch = set(&[("oven", 1, true), ("oven", 2, true)]);
    let write = service.write("oven", &both, WriteTerms::default()).await;
    let labelled = ("oven", "k2");
    let labelled = service
        .write_labelled(labelled, true, WriteTerms::default())
        .await;
    let toggle_labelled = service
        .toggle_labelled(("oven", "k2"), ToggleTerms::default())
        .await;
    let pulse_labelled = service
        .pulse_labelled(("oven", "k2"), Pulse::default())
        .await;
    let config = service.config();
    let since = service
        .write_since(&config, "oven", &both, WriteTerms::default())
        .await;
    let toggle = service.toggle("oven", k(2), ToggleTerms::default()).await;
    let pulse = service.pulse("oven", k(2), Pulse::default()).await;
    let lease = service
        .lease("oven", k(2), (true, second), LeaseTerms::default())
        .await;
    let end_lease = service.end_lease("oven", k(2)).await;
    let batch = service.batch(&batch, terms).await;
    let group = service
        .set_group("heat", GroupState::Set(true), terms)
        .await;
    let play = service.play("heat", terms).await;
    vec![
        ("write", write.map(drop)),
        ("write_labelled", labelled.map(drop)),
        ("toggle_labelled", toggle_labelled.map(drop)),
        ("pulse_labelled", pulse_labelled.map(drop)),
        ("write_since", since.map(drop)),
        ("toggle", toggle.map(drop)),
        ("pulse", pulse.map(drop)),
        ("may_write", service.may_write("oven", "k2")),
        ("may_set_group", service.may_set_group("heat")),
        ("may_play", service.may_play("heat")),
        ("lease", lease.map(drop)),
        ("end_lease", end_lease.map(drop)),
        ("batch", batch.map(drop)),
        ("set_group", group.map(drop)),
        ("play", play.map(drop)),
    ]
}

/// Everything else that changes something, by its name, and how it ended.
async fn all_of_site(service: &Service) -> Vec<(&'static str, Result<(), CommandError>)> {
    let (terms, what) = (RawTerms::default(), String::new);
    let coils = rtu::BitSpan::new(60, 8).unwrap();
    let reading = Exchange::rtu(Address(3), rtu::Request::ReadCoils(coils));
    let written = async { Ok::<(), Infallible>(()) };
    let refused_only = |end: Result<(), ReloadError>| match end {
        Err(ReloadError::Refused(failure)) => Err(failure),
        end => {
            assert_eq!(end, Ok(()));
            Ok(())
        }
    };
    let lend = service.lend("main").await;
    let lend = match lend {
        Ok(loan) => {
            loan.end(None).await;
            Ok(())
        }
        Err(failure) => Err(failure),
    };
    let reload = service.reload(TEXT).await.map(drop);
    let reload_written = service.reload_written(TEXT, written).await.map(drop);
    let begin_work = service.begin_work("oven", what()).await;
    let begin_work = match begin_work {
        Ok(work) => {
            work.end(End::not_done("test")).await;
            Ok(())
        }
        Err(failure) => Err(failure),
    };
    let send = service.send("main", frame(3, 1, true), terms, what()).await;
    vec![
        ("lend", lend),
        ("reload", refused_only(reload)),
        ("reload_written", refused_only(reload_written)),
        ("begin_work", begin_work),
        ("begin_rule_anew", service.begin_rule_anew("night")),
        ("may_send", service.may_send("main", &frame(3, 1, true))),
        ("send", send.map(drop)),
        ("raw", service.raw("main", reading, terms).await.map(drop)),
    ]
}

/// What asks for no rights: what only looks, what starts the program and ends it, and what the
/// program itself records.
const WITHOUT_RIGHTS: &[&str] = &[
    "age",
    "audit",
    "audit_log",
    "busy",
    "close",
    "command",
    "concerned",
    "config",
    "counts",
    "follow",
    "follow_events",
    "frames_of",
    "history",
    "is_tried",
    "keep_audit",
    "keep_history",
    "keys_failed",
    "line",
    "lines",
    "miss_audit",
    "module",
    "modules",
    "on_behalf_of",
    "once",
    "opened",
    "origin",
    "point",
    "points",
    "points_now",
    "pulses_ended",
    "read_for_master",
    "read_fresh",
    "rules",
    "run_rules",
    "start",
    "start_in",
    "start_quiet",
    "subscribe",
    "tap",
    "tell_dropped_ends",
    "tell_event",
    "told",
    "try_rule",
];

/// The public functions of `Service`, by its source.
fn of_service(folder: &Path, found: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            of_service(&path, found);
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let mut is_inside = false;
        for line in text.lines() {
            is_inside = line == "impl Service {" || is_inside && line != "}";
            let line = line.strip_prefix("    pub ").filter(|_| is_inside);
            let words = line.into_iter().flat_map(str::split_whitespace);
            let mut words = words.skip_while(|word| *word != "fn");
            let name = words.nth(1).map(|name| name.split(['(', '<']).next());
            found.extend(name.flatten().map(str::to_owned));
        }
    }
}

#[tokio::test]
async fn every_function_of_the_site_that_acts_asks_for_rights() {
    let service = Service::start_quiet(Config::parse(TEXT).unwrap()).unwrap();
    let viewer = acting(&service, Role::Viewer, &[]);
    let walked = [all(&viewer).await, all_of_site(&viewer).await].concat();
    let mut walked: BTreeSet<String> = walked.into_iter().map(|one| one.0.to_owned()).collect();
    walked.extend(WITHOUT_RIGHTS.iter().map(|&name| name.to_owned()));
    let mut found = BTreeSet::new();
    of_service(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("src"),
        &mut found,
    );
    assert_eq!(found, walked);
    service.close().await;
}

fn is_of_rights(failure: &CommandError) -> bool {
    matches!(
        failure,
        CommandError::NotPermitted { .. }
            | CommandError::RoleTooLow { .. }
            | CommandError::Limited(_)
    )
}

#[tokio::test]
async fn what_may_affect_any_output_is_for_engineers_without_a_limit() {
    let service = Service::start_quiet(Config::parse(TEXT).unwrap()).unwrap();
    for role in [Role::Viewer, Role::Operator] {
        for (name, end) in all_of_site(&acting(&service, role, &[])).await {
            let need = Role::Engineer;
            assert_eq!(end, Err(CommandError::RoleTooLow { role, need }), "{name}");
        }
    }
    let limit = ["oven.k1"];
    for (name, end) in all_of_site(&acting(&service, Role::Admin, &limit)).await {
        match name {
            "may_send" | "send" => {
                let (module, label) = ("oven".to_owned(), "k2".to_owned());
                assert_eq!(
                    end,
                    Err(CommandError::NotPermitted { module, label }),
                    "{name}"
                );
            }
            // These change nothing.
            "reload" | "reload_written" => assert_eq!(end, Ok(()), "{name}"),
            "raw" => assert!(!end.is_err_and(|why| is_of_rights(&why))),
            _ => {
                let limit = limit.map(str::to_owned);
                assert_eq!(end, Err(CommandError::Limited(limit.into())), "{name}");
            }
        }
    }
    assert_eq!(service.audit(), [], "nothing was begun");
    for role in [Role::Engineer, Role::Admin] {
        for (name, end) in all_of_site(&acting(&service, role, &[])).await {
            assert!(!end.is_err_and(|why| is_of_rights(&why)), "{name}");
        }
    }
    service.close().await;
}

#[tokio::test]
async fn a_frame_is_judged_by_all_that_it_may_do() {
    let service = Service::start_quiet(Config::parse(TEXT).unwrap()).unwrap();
    let keeps = rtu::Request::WriteRegister { at: 0, value: 1 };
    let keeps = Exchange::rtu(Address(3), keeps);
    let of_oven = acting(&service, Role::Engineer, &["oven"]);
    assert_eq!(of_oven.may_send("main", &frame(3, 1, true)), Ok(()));
    let no_module = CommandError::NotPermitted {
        module: String::new(),
        label: String::new(),
    };
    let end = of_oven.may_send("main", &frame(7, 1, true));
    assert_eq!(end, Err(no_module));
    for beyond in [frame(0, 1, true), keeps] {
        let end = of_oven.may_send("main", &beyond);
        assert!(matches!(end, Err(CommandError::Limited(_))), "{end:?}");
        let raw = of_oven.raw("main", beyond, RawTerms::default()).await;
        assert!(matches!(raw, Err(CommandError::Limited(_))), "{raw:?}");
        let unlimited = acting(&service, Role::Engineer, &[]);
        assert_eq!(unlimited.may_send("main", &beyond), Ok(()));
    }
    service.close().await;
}

#[tokio::test]
async fn with_a_limit_only_the_names_of_ones_points_can_be_changed() {
    let service = Service::start_quiet(Config::parse(TEXT).unwrap()).unwrap();
    let limited = acting(&service, Role::Engineer, &["oven.k1"]);
    let more = |more: &str| format!("{TEXT}[module.oven.point]\n{more}\n");
    for beyond in [
        "k2.name = \"Zone\"",
        "k1.locked = true",
        "k1 = { name = \"Zone\", hidden = true }",
    ] {
        let end = limited.reload(&more(beyond)).await;
        let refused = matches!(end, Err(ReloadError::Refused(CommandError::Limited(_))));
        assert!(refused, "{beyond}: {end:?}");
        assert_eq!(*service.config(), Config::parse(TEXT).unwrap(), "{beyond}");
    }
    let named = limited.reload(&more("k1.name = \"Zone\"")).await;
    assert!(named.is_ok(), "{named:?}");
    let unnamed = limited.reload(TEXT).await;
    assert!(unnamed.is_ok(), "{unnamed:?}");
    service.close().await;
}

fn acting(service: &Service, role: Role, points: &[&str]) -> Service {
    let origin = Origin {
        who: "li".to_owned(),
        via: "test".to_owned(),
    };
    let points: Vec<String> = points.iter().map(|&point| point.to_owned()).collect();
    let points = Arc::from(points);
    service.on_behalf_of(origin, Rights { role, points })
}

#[tokio::test]
async fn each_command_asks_for_the_role_and_for_each_output() {
    let service = Service::start_quiet(Config::parse(TEXT).unwrap()).unwrap();
    // The first is covered by all of these, the second by none.
    for points in [&["oven.k1"][..], &["*.k1", "pump"]] {
        for (name, end) in all(&acting(&service, Role::Admin, points)).await {
            let refused = Err(CommandError::NotPermitted {
                module: "oven".to_owned(),
                label: "k2".to_owned(),
            });
            assert_eq!(end, refused, "{name}, limited to {points:?}");
        }
    }
    for points in [&[][..], &["oven"]] {
        for (name, end) in all(&acting(&service, Role::Viewer, points)).await {
            let refused = CommandError::RoleTooLow {
                role: Role::Viewer,
                need: Role::Operator,
            };
            assert_eq!(end, Err(refused), "{name}");
        }
    }
    assert_eq!(service.audit(), [], "nothing was begun");

    for role in [Role::Operator, Role::Engineer, Role::Admin] {
        for points in [&[][..], &["oven.*"], &["oven.k1", "oven.k2"]] {
            for (name, end) in all(&acting(&service, role, points)).await {
                let is_refused = end.as_ref().is_err_and(is_of_rights);
                assert!(!is_refused, "{name} of {role:?}, limited to {points:?}");
            }
        }
    }
    assert!(!service.audit().is_empty(), "these were begun");
    service.close().await;
}

#[tokio::test]
async fn what_does_not_exist_is_nobodys() {
    let service = Service::start_quiet(Config::parse(TEXT).unwrap()).unwrap();
    let limited = acting(&service, Role::Operator, &["oven.k1"]);
    let on = [(k(1), true)];
    let end = limited.write("yard", &on, WriteTerms::default()).await;
    assert_eq!(end.map(drop).unwrap_err().name(), "not_permitted");
    let end = limited.play("cold", BatchTerms::default()).await;
    assert_eq!(end.map(drop), Err(CommandError::NoSuchScene));
    service.close().await;
}
