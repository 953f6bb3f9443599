//! When Home Assistant is told, and in which order.

use super::super::super::settings;
use super::super::*;
use super::AGAIN_WAIT;
use railbus_site::{Config, Service};

const TEXT: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n";
const ZERO: Duration = Duration::ZERO;
const STATUS: &str = "homeassistant/status";
const OVEN: &str = "homeassistant/device/railbus_plant_oven/config";

async fn node(form: &str) -> Node {
    after(form, &[]).await
}

/// After a run that has left something at these topics.
async fn after(form: &str, old: &[String]) -> Node {
    let keys = json!({ "discovery": form, "write": ["oven"] });
    let topics = settings::topics(&keys.as_object().cloned().unwrap(), "plant");
    let mut node = Node::new(Setup {
        has_outbox: false,
        site: "plant".to_owned(),
        topics,
        events: BTreeSet::new(),
        old: old.iter().cloned().collect(),
    });
    let service = Service::start(Config::parse(TEXT).unwrap()).unwrap();
    let news = service.follow().next().await.unwrap();
    node.handle(ZERO, Input::News(&news));
    node
}

/// Everything that is to be done, each message taken at once: its topics.
fn settle(node: &mut Node, now: Duration) -> Vec<String> {
    let mut told = Vec::new();
    while let Some(output) = node.poll(now) {
        match output {
            Output::Publish(number, message) => {
                node.handle(now, Input::Taken(number, Verdict::Taken));
                told.push(message.topic);
            }
            Output::Subscribe(filters) => told.extend(filters),
            _ => {}
        }
    }
    told
}

fn status(payload: &str) -> Input<'static> {
    Input::Received(Received {
        topic: STATUS.to_owned(),
        payload: payload.as_bytes().to_vec(),
        ..Received::default()
    })
}

#[tokio::test]
async fn it_is_told_after_the_values_and_before_what_is_there() {
    for (form, count) in [("device", 1), ("component", 9), ("off", 0)] {
        let mut node = node(form).await;
        node.handle(ZERO, Input::Connected);
        let told = settle(&mut node, ZERO);
        let is_listened = told[..3].contains(&STATUS.to_owned());
        assert_eq!(is_listened, form != "off", "{told:?}");
        let places = |of: &dyn Fn(&String) -> bool| {
            let places = told.iter().enumerate().filter(|(_, topic)| of(topic));
            places.map(|(place, _)| place).collect::<Vec<_>>()
        };
        let described = places(&|topic| topic.ends_with("/config"));
        assert_eq!(described.len(), count, "{told:?}");
        let values = places(&|topic| topic.ends_with("/attr"));
        let there = places(&|topic| topic.ends_with("/availability"));
        assert_eq!((values.len(), there.len()), (8, 1));
        let bridge = places(&|topic| topic.ends_with("/bridge/state"));
        assert_eq!(bridge.last(), Some(&(told.len() - 1)));
        for place in described {
            assert!(values.iter().all(|value| *value < place));
            assert!(place < there[0]);
        }
    }
}

/// Not by all gateways at the same moment, and by each of them once.
#[tokio::test]
async fn home_assistant_is_told_all_again_when_it_has_come_back() {
    let mut node = node("device").await;
    node.handle(ZERO, status("online"));
    node.handle(ZERO, Input::Connected);
    settle(&mut node, ZERO);
    let idle = node.deadline();
    let begun = Duration::from_secs(3);
    for other in ["offline", "", "ONLINE", "onlin"] {
        node.handle(begun, status(other));
        assert_eq!(node.deadline(), idle, "{other}");
    }
    node.handle(begun, status("online"));
    let due = node.deadline().unwrap();
    let spread = node.topics.discovery().unwrap().spread();
    assert_eq!(due, begun + spread);
    assert!(
        spread > ZERO && spread <= Duration::from_secs(5),
        "{spread:?}"
    );
    // Once more meanwhile is the same.
    node.handle(begun + spread / 2, status("online"));
    assert_eq!(node.deadline(), Some(due));
    assert!(settle(&mut node, due - Duration::from_millis(1)).is_empty());
    assert_eq!(settle(&mut node, due), [OVEN]);
    assert_eq!(node.deadline(), idle);
    node.handle(due, status("online"));
    node.handle(due, Input::Stop { is_gone: false });
    let told = settle(&mut node, 2 * due);
    assert_eq!(told, ["railbus/plant/bridge/state"], "it ends");
}

/// Sites come back to Home Assistant at times of their own.
#[test]
fn every_site_has_its_own_time() {
    let spread = |site: &str| {
        let keys = json!({ "discovery": "device" });
        let topics = settings::topics(&keys.as_object().cloned().unwrap(), site);
        topics.discovery().unwrap().spread()
    };
    let all: BTreeSet<Duration> = (0..100).map(|nth| spread(&format!("plant{nth}"))).collect();
    assert!(all.len() > 90, "{}", all.len());
    assert!(all.last() <= Some(&Duration::from_secs(5)));
    assert!(all.last() > Some(&Duration::from_secs(4)));
    assert!(all.first() < Some(&Duration::from_secs(1)));
}

#[tokio::test]
async fn no_answer_goes_where_home_assistant_is_told() {
    let node = node("device").await;
    assert!(!node.topics.may_respond(OVEN));
    assert!(!node.topics.may_respond("homeassistant/switch/a/b/config"));
    assert!(node.topics.may_respond("homeassistant/answers"));
    assert!(
        node.topics.is_own(OVEN),
        "who may not publish there is told"
    );
}

/// Everything that is published, each message taken at once.
fn published(node: &mut Node, now: Duration) -> Vec<(String, String)> {
    let mut told = Vec::new();
    while let Some(output) = node.poll(now) {
        if let Output::Publish(number, message) = output {
            node.handle(now, Input::Taken(number, Verdict::Taken));
            assert!(message.is_retained || message.topic.ends_with("/health"));
            told.push((message.topic, String::from_utf8(message.payload).unwrap()));
        }
    }
    told
}

/// What people have named and put into rooms stays so.
#[tokio::test]
async fn another_form_takes_over_from_the_one_before() {
    let moves = "{\"migrate_discovery\":true}";
    for (before, form, count) in [("component", "device", 9), ("device", "component", 1)] {
        let gone = "homeassistant/switch/railbus_plant_oven/k9/config".to_owned();
        let mut left = node(before).await.told.kept();
        left.push(gone.clone());
        let mut node = after(form, &left).await;
        let old = self::node(before).await.told.described();
        let new = self::node(form).await.told.described();
        assert_eq!(old.len(), count);
        // Twice: the first connection is lost before it is done.
        for is_last in [false, true] {
            node.handle(ZERO, Input::Connected);
            let told = published(&mut node, ZERO);
            let at = |topic: &String| {
                let its = told.iter().filter(|(told, _)| told == topic);
                its.map(|(_, payload)| &**payload).collect::<Vec<_>>()
            };
            assert!(old.iter().all(|topic| at(topic) == [moves]), "{told:?}");
            assert!(new.iter().all(|topic| at(topic).is_empty()));
            assert_eq!(at(&gone).len(), usize::from(!is_last), "cleared at once");
            assert_eq!(told.last().unwrap().1, "online");
            if !is_last {
                node.handle(ZERO, Input::Lost);
            }
        }
        let wait = Duration::from_secs(3);
        assert_eq!(node.deadline(), Some(wait));
        assert_eq!(published(&mut node, wait - Duration::from_millis(1)), []);
        let told = published(&mut node, wait);
        let (first, last) = told.split_at(old.len());
        let cleared = old.iter().map(|topic| (topic.clone(), String::new()));
        assert!(cleared.eq(first.iter().cloned()), "{first:?}");
        let is_new = |(topic, payload): &(String, String)| new.contains(topic) && payload != moves;
        assert!(
            last.len() == new.len() && last.iter().all(is_new),
            "{last:?}"
        );
        let again = wait + AGAIN_WAIT;
        // A health message comes before.
        published(&mut node, HEALTH_EVERY);
        assert_eq!(node.deadline(), Some(again), "it may still have been busy");
        assert_eq!(published(&mut node, again), last);
        node.handle(wait, Input::Lost);
        node.handle(wait, Input::Connected);
        let told = published(&mut node, wait);
        assert!(
            !told.iter().any(|(_, payload)| payload == moves),
            "it is over"
        );
        assert!(
            new.iter()
                .all(|topic| told.iter().any(|(told, _)| told == topic))
        );
        assert!(!old.iter().any(|topic| node.told.kept().contains(topic)));
    }
}

#[tokio::test]
async fn nothing_takes_over_before_all_was_let_go() {
    let left = node("component").await.told.kept();
    let mut node = after("device", &left).await;
    node.handle(ZERO, Input::Connected);
    let mut asked = Vec::new();
    while let Some(output) = node.poll(ZERO) {
        if let Output::Publish(number, message) = output {
            match message.payload.starts_with(b"{\"migrate") {
                true => asked.push(number),
                false => node.handle(ZERO, Input::Taken(number, Verdict::Taken)),
            }
        }
    }
    let last = asked.pop().unwrap();
    for number in asked {
        node.handle(ZERO, Input::Taken(number, Verdict::Taken));
    }
    assert_eq!(node.link.as_ref().unwrap().describes, None);
    node.handle(ZERO, Input::Taken(last, Verdict::Refused));
    assert_eq!(node.link.as_ref().unwrap().describes, Some(MOVE_WAIT));
}

/// Home Assistant may have been busy with the message before.
#[tokio::test]
async fn what_is_something_else_is_told_twice() {
    let mut node = node("device").await;
    node.handle(ZERO, Input::Connected);
    settle(&mut node, ZERO);
    settle(&mut node, HEALTH_EVERY);
    let idle = node.deadline();
    let now = Duration::from_secs(2);
    for (text, is_other) in [
        (TEXT.to_owned(), false),
        (format!("{TEXT}name = \"Oven\"\n"), true),
    ] {
        let service = Service::start(Config::parse(&text).unwrap()).unwrap();
        let news = service.follow().next().await.unwrap();
        node.handle(now, Input::News(&news));
        let told = settle(&mut node, now);
        assert_eq!(told.contains(&OVEN.to_owned()), is_other, "{told:?}");
        // A health message comes before.
        settle(&mut node, HEALTH_EVERY);
        let again = is_other.then_some(now + AGAIN_WAIT);
        assert_eq!(node.deadline(), again.or(idle));
    }
    node.handle(now, status("online"));
    let spread = node.topics.discovery().unwrap().spread();
    assert_eq!(
        node.deadline(),
        Some(now + spread),
        "not later than it says"
    );
    assert_eq!(settle(&mut node, now + spread), [OVEN]);
    assert_eq!(node.deadline(), idle);
}

/// What is no more in the other form is removed, and does not move.
#[tokio::test]
async fn only_what_is_still_there_moves() {
    let mut left = node("component").await.told.kept();
    let k9 = "homeassistant/switch/railbus_plant_oven/k9/config".to_owned();
    let pump = "homeassistant/switch/railbus_plant_pump/do0/config".to_owned();
    // It was one in this form once, and is none any more.
    let once = format!("{OVEN}#switch/k9#");
    left.extend([k9.clone(), pump.clone(), once]);
    let mut node = after("device", &left).await;
    node.handle(ZERO, Input::Connected);
    let told = published(&mut node, ZERO);
    for gone in [k9, pump] {
        let its = told.iter().filter(|(topic, _)| *topic == gone);
        assert!(its.map(|(_, payload)| &**payload).eq([""]), "{gone}");
    }
    let mut node = after("off", &left).await;
    node.handle(ZERO, Input::Connected);
    let told = published(&mut node, ZERO);
    let its = told.iter().filter(|(topic, _)| topic.ends_with("/config"));
    let payloads: Vec<&str> = its.map(|(_, payload)| &**payload).collect();
    assert_eq!(payloads, [""; 11]);
}
