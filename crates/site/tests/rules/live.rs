//! Rules at a line.

use crate::board::{self, Boards, k, until};
use railbus_site::rules::Phase;
use railbus_site::{Config, Events, Quality, Service};
use railbus_store::history::{Event, EventKind};
use std::sync::Arc;
use std::time::Duration;

fn text(port: &str, points: &str, rules: &str) -> String {
    format!(
        "[line.main]\nport = \"{port}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\npoll = \"50ms\"\n\
         [module.yard]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\npoll = \"50ms\"\n\
         {points}{rules}"
    )
}

struct Bench {
    service: Service,
    boards: Arc<Boards>,
    port: String,
    events: Events,
}

async fn bench(points: &str, rules: &str) -> Bench {
    let (port, boards) = board::start().await;
    let config = Config::parse(&text(&port, points, rules)).unwrap();
    let service = Service::start(config).unwrap();
    for module in ["oven", "yard"] {
        until(|| service.point(module, k(1)).unwrap().quality == Quality::Good).await;
    }
    let events = service.follow_events();
    service.run_rules();
    Bench {
        service,
        boards,
        port,
        events,
    }
}

impl Bench {
    /// The next event of a rule.
    async fn told(&mut self) -> Event {
        let next = async {
            loop {
                let event = self.events.next().await.unwrap().unwrap();
                if event.kind == EventKind::Rule {
                    return event;
                }
            }
        };
        tokio::time::timeout(Duration::from_secs(30), next)
            .await
            .unwrap()
    }

    async fn code(&mut self) -> String {
        self.told().await.code.unwrap()
    }

    fn phase(&self, id: &str) -> Option<Phase> {
        let rules = self.service.rules();
        rules.into_iter().find(|rule| rule.id == id).unwrap().phase
    }
}

const NIGHT: &str = "[rule.night]\nwhen = { point = \"oven.k1\", is = true }\nfor = \"300ms\"\n\
    then = [{ set = \"yard.k2\", to = true }, { notify = \"night\" }]\narmed = true\n";

#[tokio::test]
async fn a_rule_switches_in_its_own_name_and_once() {
    let mut bench = bench("", NIGHT).await;
    assert_eq!(bench.phase("night"), Some(Phase::Resting));
    bench.boards.set(3, 1);
    let fired = bench.told().await;
    assert_eq!(fired.code.as_deref(), Some("rule_fired"));
    assert_eq!(fired.who.as_deref(), Some("rule:night"));
    assert_eq!(fired.what.as_deref(), Some("yard.k2=on, notify"));
    assert_eq!(
        (fired.module.as_deref(), fired.point.as_deref()),
        (Some("oven"), Some("k1"))
    );
    let notice = bench.told().await;
    assert_eq!(
        (notice.code.as_deref(), notice.text.as_deref()),
        (Some("notify"), Some("night"))
    );
    assert_eq!(bench.boards.relays(4), 0b10);
    let entry = bench.service.audit().pop().unwrap();
    assert_eq!(
        (entry.origin.who.as_str(), entry.what.as_str()),
        ("rule:night", "k2=on")
    );
    assert_eq!(bench.phase("night"), Some(Phase::Acted));
    bench.boards.set(3, 0);
    until(|| bench.phase("night") == Some(Phase::Resting)).await;
    bench.boards.set(3, 1);
    assert_eq!(bench.code().await, "rule_fired");
    let status = bench.service.rules().remove(0);
    assert_eq!((status.count, status.is_known), (2, true));
    bench.service.close().await;
}

#[tokio::test]
async fn what_holds_for_everybody_holds_for_a_rule() {
    let points = "[module.yard.point]\nk2.locked = true\n";
    let mut bench = bench(points, NIGHT).await;
    bench.boards.set(3, 1);
    assert_eq!(bench.code().await, "rule_fired");
    let failed = bench.told().await;
    assert_eq!(failed.code.as_deref(), Some("rule_failed"));
    assert_eq!(
        (failed.end.as_deref(), failed.point.as_deref()),
        (Some("locked"), Some("k2"))
    );
    assert_eq!(
        bench.code().await,
        "notify",
        "who is to be told is told all the same"
    );
    assert_eq!(bench.boards.relays(4), 0);
    bench.service.close().await;
}

#[tokio::test]
async fn a_module_that_is_lost_is_known_to_be_and_its_points_are_not() {
    let lost = "[rule.lost]\nwhen = { module_offline = \"oven\" }\nfor = \"100ms\"\n\
        then = [{ notify = \"lost\" }]\narmed = true\n\
        [rule.off]\nwhen = { point = \"oven.k1\", is = false }\nfor = \"20s\"\n\
        then = [{ notify = \"off\" }]\narmed = true\n";
    let mut bench = bench("", lost).await;
    until(|| matches!(bench.phase("off"), Some(Phase::Holding(_)))).await;
    bench.boards.mute(3, true);
    assert_eq!(bench.told().await.who.as_deref(), Some("rule:lost"));
    until(|| bench.phase("off") == Some(Phase::Resting)).await;
    bench.boards.mute(3, false);
    until(|| bench.phase("lost") == Some(Phase::Resting)).await;
    until(|| matches!(bench.phase("off"), Some(Phase::Holding(_)))).await;
    bench.service.close().await;
}

#[tokio::test]
async fn another_configuration_leaves_running_delays_alone() {
    let long = NIGHT.replace("300ms", "600s");
    let bench = bench("", &long).await;
    bench.boards.set(3, 1);
    until(|| matches!(bench.phase("night"), Some(Phase::Holding(_)))).await;
    let holding = bench.phase("night");
    let more = "[rule.other]\nwhen = { time = \"06:30\" }\nthen = [{ notify = \"x\" }]\n";
    let with = |rules: &str| text(&bench.port, "", rules);
    bench
        .service
        .reload(&with(&format!("{long}{more}")))
        .await
        .unwrap();
    assert_eq!(
        (bench.phase("night"), bench.phase("other")),
        (holding, None)
    );
    // Another name is not another rule; another time is.
    bench
        .service
        .reload(&with(&format!("{long}name = \"Night\"\n")))
        .await
        .unwrap();
    assert_eq!(bench.phase("night"), holding);
    bench
        .service
        .reload(&with(&long.replace("600s", "601s")))
        .await
        .unwrap();
    until(|| matches!(bench.phase("night"), Some(Phase::Holding(_)))).await;
    assert_ne!(bench.phase("night"), holding);
    bench
        .service
        .reload(&with(&long.replace("armed = true", "armed = false")))
        .await
        .unwrap();
    assert_eq!(bench.phase("night"), None);
    bench.service.close().await;
}

#[tokio::test]
async fn rules_that_swing_act_once_a_second_at_most() {
    let swing = "[rule.off]\nwhen = { point = \"oven.k1\", is = true }\n\
        then = [{ set = \"oven.k1\", to = false }]\narmed = true\n\
        [rule.on]\nwhen = { point = \"oven.k1\", is = false }\n\
        then = [{ set = \"oven.k1\", to = true }]\narmed = true\n";
    let mut bench = bench("", swing).await;
    // At most one act a second: after the first of both, each waits for its second.
    let begun = std::time::Instant::now();
    for _ in 0..4 {
        assert_eq!(bench.code().await, "rule_fired");
    }
    assert!(
        begun.elapsed() >= Duration::from_millis(900),
        "{:?}",
        begun.elapsed()
    );
    bench.service.close().await;
}
