//! A rule at a real line. What else rules do is tried in virtual time, with the site's core.

use crate::board::{self, Boards, k, until};
use railbus_site::rules::Phase;
use railbus_site::{Config, Events, PointQuality, Service};
use railbus_store::history::{Event, EventKind};
use std::sync::Arc;
use std::time::Duration;

fn text(port: &str, rules: &str) -> String {
    format!(
        "[line.main]\nport = \"{port}\"\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\npoll = \"50ms\"\n\
         [module.yard]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\npoll = \"50ms\"\n\
         {rules}"
    )
}

struct Bench {
    service: Service,
    boards: Arc<Boards>,
    events: Events,
}

async fn bench(rules: &str) -> Bench {
    let (port, boards) = board::start().await;
    let config = Config::parse(&text(&port, rules)).unwrap();
    let service = Service::start(config).unwrap();
    for module in ["oven", "yard"] {
        until(|| service.point(module, k(1)).unwrap().quality == PointQuality::Good).await;
    }
    let events = service.follow_events();
    service.run_rules();
    Bench {
        service,
        boards,
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

    fn phase(&self, id: &str) -> Option<Phase> {
        let rules = self.service.rules();
        rules.into_iter().find(|rule| rule.id == id).unwrap().phase
    }
}

const NIGHT: &str = "[rule.night]\nwhen = { point = \"oven.k1\", is = true }\nfor = \"300ms\"\n\
    then = [{ set = \"yard.k2\", to = true }, { notify = \"night\" }]\narmed = true\n";

#[tokio::test]
async fn a_rule_switches_in_its_own_name_and_once() {
    let mut bench = bench(NIGHT).await;
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
    assert_eq!(bench.told().await.code.as_deref(), Some("rule_fired"));
    let status = bench.service.rules().remove(0);
    assert_eq!((status.count, status.is_known), (2, true));
    bench.service.close().await;
}
