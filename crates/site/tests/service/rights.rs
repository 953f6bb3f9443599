//! Whoever brings a command, the site asks whether it is allowed.

use crate::board::k;
use crate::several::set;
use railbus_site::{
    BatchTerms, Config, Failure, GroupState, Pulse, Rights, Role, Service, ToggleTerms, WriteTerms,
};
use railbus_store::audit::Origin;
use railbus_wire::Micros;
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
async fn all(service: &Service) -> Vec<(&'static str, Result<(), Failure>)> {
    let second = Micros::from_secs(1);
    let both = [(k(1), true), (k(2), true)];
    let terms = BatchTerms::default();
    let batch = set(&[("oven", 1, true), ("oven", 2, true)]);
    let write = service.write("oven", &both, WriteTerms::default()).await;
    let toggle = service.toggle("oven", k(2), ToggleTerms::default()).await;
    let pulse = service.pulse("oven", k(2), Pulse::default()).await;
    let lease = service.lease("oven", k(2), (true, second), false).await;
    let end_lease = service.end_lease("oven", k(2)).await;
    let batch = service.batch(&batch, terms).await;
    let group = service
        .set_group("heat", GroupState::Set(true), terms)
        .await;
    let play = service.play("heat", terms).await;
    vec![
        ("write", write.map(drop)),
        ("toggle", toggle.map(drop)),
        ("pulse", pulse.map(drop)),
        ("lease", lease.map(drop)),
        ("end_lease", end_lease.map(drop)),
        ("batch", batch.map(drop)),
        ("set_group", group.map(drop)),
        ("play", play.map(drop)),
    ]
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
            let refused = Err(Failure::NotPermitted {
                module: "oven".to_owned(),
                label: "k2".to_owned(),
            });
            assert_eq!(end, refused, "{name}, limited to {points:?}");
        }
    }
    for points in [&[][..], &["oven"]] {
        for (name, end) in all(&acting(&service, Role::Viewer, points)).await {
            assert_eq!(end, Err(Failure::RoleTooLow(Role::Viewer)), "{name}");
        }
    }
    assert_eq!(service.audit(), [], "nothing was begun");

    for role in [Role::Operator, Role::Engineer, Role::Admin] {
        for points in [&[][..], &["oven.*"], &["oven.k1", "oven.k2"]] {
            for (name, end) in all(&acting(&service, role, points)).await {
                let refused = matches!(
                    end,
                    Err(Failure::NotPermitted { .. } | Failure::RoleTooLow(_))
                );
                assert!(!refused, "{name} of {role:?}, limited to {points:?}");
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
    assert_eq!(end.map(drop), Err(Failure::NoSuchScene));
    service.close().await;
}
